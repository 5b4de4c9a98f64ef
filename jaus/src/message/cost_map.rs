//! A map of costs seen from above: IOP CostMap2D 1.1.
//!
//! Cells begin in the north-west of the map before it is turned, run east, then row by row south.

use super::scaled::{Angle16, Extent, Latitude, Local, Longitude, Percent};
use super::{Field, List16};
use crate::bytes::{Malformed, Reader, Writer};

/// Cost of a cell that must not be driven.
pub const IMPASSABLE: u8 = 254;
/// Cost of a cell of which nothing is known.
pub const UNKNOWN: u8 = 255;
/// Most cells that the count of a list can name.
pub const CELLS_MAX: usize = 65_535;

presence! {
    /// Asks for a map.
    QueryCostMap2D: u8 {
        /// How large at most.
        may extent_max: MapExtent,
        /// Around which place; absent: around the vehicle.
        may center: MapPose,
    }
}

message_of_field! { QueryCostMap2D = 0xD738 }

records! {
    /// How large a map is.
    MapExtent {
        /// Metres along the rows.
        width: Extent,
        /// Metres along the columns.
        height: Extent,
    }
    /// A place on the globe.
    GlobalPlace {
        /// Degrees.
        latitude: Latitude,
        /// Degrees.
        longitude: Longitude,
        /// Turn of the map about the vertical, radians, clockwise seen from above.
        rotation: Angle16,
    }
    /// A place in a local frame.
    LocalPlace {
        /// Metres.
        x: Local,
        /// Metres.
        y: Local,
        /// Turn of the map about the vertical, radians, clockwise seen from above.
        rotation: Angle16,
    }
    /// A cost and how sure it is.
    CostAndConfidence {
        /// 0 to [`IMPASSABLE`].
        cost: u8,
        /// 0 is unknown.
        confidence: Percent,
    }
}

messages! {
    /// Asks for zones that must not be driven.
    QueryNoGoZones = 0xD739 {
        /// The zone, 0 is all.
        zone: u16,
    }
    /// A map.
    ReportCostMap2D = 0xD742 {
        /// Rows of cells.
        rows: u16,
        /// Columns of cells.
        columns: u16,
        /// How large it is.
        extent: MapExtent,
        /// Where its centre is.
        center: MapPose,
        /// The cells.
        cells: Cells,
    }
}

/// Where a map's centre is.
#[derive(Clone, Debug, PartialEq)]
pub enum MapPose {
    /// On the globe.
    Global(GlobalPlace),
    /// In a local frame.
    Local(LocalPlace),
}

impl Default for MapPose {
    fn default() -> Self {
        Self::Global(GlobalPlace::default())
    }
}

impl Field for MapPose {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        match reader.u8()? {
            0 => GlobalPlace::read(reader).map(Self::Global),
            1 => LocalPlace::read(reader).map(Self::Local),
            _ => Err(Malformed::Tag),
        }
    }
    fn write(&self, out: &mut Writer) {
        match self {
            Self::Global(place) => {
                out.u8(0);
                place.write(out);
            }
            Self::Local(place) => {
                out.u8(1);
                place.write(out);
            }
        }
    }
}

/// The cells of a map.
#[derive(Clone, Debug, PartialEq)]
pub enum Cells {
    /// A cost each.
    Costs(List16<u8>),
    /// A cost each and how sure it is.
    CostsAndConfidences(List16<CostAndConfidence>),
    /// Runs of like cells: bits 0 to 2 the cost, bit 3 whether it is known, bits 4 to 15 how many.
    Runs(List16<u16>),
}

impl Default for Cells {
    fn default() -> Self {
        Self::Costs(List16::default())
    }
}

impl Field for Cells {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        match reader.u8()? {
            0 => Field::read(reader).map(Self::Costs),
            1 => Field::read(reader).map(Self::CostsAndConfidences),
            2 => Field::read(reader).map(Self::Runs),
            _ => Err(Malformed::Tag),
        }
    }
    fn write(&self, out: &mut Writer) {
        match self {
            Self::Costs(cells) => {
                out.u8(0);
                cells.write(out);
            }
            Self::CostsAndConfidences(cells) => {
                out.u8(1);
                cells.write(out);
            }
            Self::Runs(cells) => {
                out.u8(2);
                cells.write(out);
            }
        }
    }
}
