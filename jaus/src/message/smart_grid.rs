//! The Smart Sensor Grid as a message of our own. EXPERIMENTAL: its codes are configuration, its layout `docs/jaus.md`.
//!
//! The thesis's planner reads a square raster centred on the vehicle with costs of four bits. This message carries
//! that raster, and says what the standard's cost map cannot: the exact edge of a cell, where the cells lie in UTM, and
//! several layers of the same instant. Cells run as in the cost map: from the north-west, east, then south.

use super::Field;
use crate::bytes::{Malformed, Reader, Writer};

/// Version of the layout, first byte of the report.
pub const VERSION: u8 = 1;
/// Bit of `layers`: traversability of 4 bits a cell, two cells a byte, the western one in the low half.
pub const TRAVERSABILITY: u8 = 1;
/// Bit of `layers`: height of vegetation, a byte a cell.
pub const VEGETATION: u8 = 2;
/// Bit of `layers`: what stands there, a byte a cell.
pub const CLASS: u8 = 4;
/// Bit of `layers`: ground height, a signed 16-bit number a cell, centimetres above the base.
pub const GROUND: u8 = 8;
/// Bit of `layers`: how dense vegetation stands, a byte a cell, percent, 255 unknown.
pub const DENSITY: u8 = 16;
/// All layers.
pub const LAYERS: u8 = TRAVERSABILITY | VEGETATION | CLASS | GROUND | DENSITY;
/// Ground height of a cell where none is known.
pub const GROUND_UNKNOWN: i16 = i16::MIN;

records! {
    /// Asks for the grid.
    QuerySmartGrid {
        /// Which layers.
        layers: u8,
    }
    /// Where a grid lies and how its values are to be read.
    SmartGridHeader {
        /// [`VERSION`].
        version: u8,
        /// When: see [`crate::time_stamp`].
        time: u32,
        /// When: see [`crate::date_stamp`].
        date: u16,
        /// Latitude of the centre, degrees.
        latitude_deg: f64,
        /// Longitude of the centre, degrees.
        longitude_deg: f64,
        /// From true north to the grid's north, clockwise, radians.
        rotation_rad: f32,
        /// Edge of a cell, metres.
        cell_m: f64,
        /// Column of the westernmost cells, counted from the UTM origin: its change is the shift in columns.
        west_column: i32,
        /// Row of the southernmost cells, counted from the UTM origin: its change is the shift in rows.
        south_row: i32,
        /// UTM zone.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// Height that the ground layer is relative to, metres above the ellipsoid.
        base_m: f64,
        /// Metres that one unit of the vegetation layer stands for; 255 units are unknown.
        vegetation_step_m: f32,
        /// Rows.
        rows: u16,
        /// Columns.
        columns: u16,
        /// Which layers follow, in the order of their bits.
        layers: u8,
    }
}

/// A grid. Layers that are not there are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SmartGrid {
    /// Where and how.
    pub header: SmartGridHeader,
    /// Values 0 to 15, one a cell.
    pub traversability: Vec<u8>,
    /// Units of `vegetation_step_m`.
    pub vegetation: Vec<u8>,
    /// What stands there.
    pub class: Vec<u8>,
    /// Centimetres above the base.
    pub ground: Vec<i16>,
    /// Percent.
    pub density: Vec<u8>,
}

impl SmartGrid {
    /// Code and fields.
    pub fn to_bytes(&self, code: u16) -> Vec<u8> {
        let mut out = Writer::default();
        out.u16(code);
        self.write(&mut out);
        out.into_bytes()
    }
}

impl Field for SmartGrid {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        let header = SmartGridHeader::read(reader)?;
        if header.version != VERSION || header.layers & !LAYERS != 0 {
            return Err(Malformed::Value);
        }
        let cells = usize::from(header.rows) * usize::from(header.columns);
        let has = |layer: u8| if header.layers & layer != 0 { cells } else { 0 };
        let nibbles = reader.bytes(has(TRAVERSABILITY).div_ceil(2))?;
        let both = nibbles.iter().flat_map(|byte| [byte & 15, byte >> 4]);
        let traversability = both.take(has(TRAVERSABILITY)).collect();
        let vegetation = reader.bytes(has(VEGETATION))?.to_vec();
        let class = reader.bytes(has(CLASS))?.to_vec();
        let (pairs, _) = reader.bytes(2 * has(GROUND))?.as_chunks();
        let ground = pairs.iter().map(|pair| i16::from_le_bytes(*pair)).collect();
        let density = reader.bytes(has(DENSITY))?.to_vec();
        Ok(Self { header, traversability, vegetation, class, ground, density })
    }

    fn write(&self, out: &mut Writer) {
        self.header.write(out);
        for pair in self.traversability.chunks(2) {
            out.u8(pair[0] & 15 | pair.get(1).map_or(0, |east| east << 4));
        }
        out.bytes(&self.vegetation);
        out.bytes(&self.class);
        self.ground.iter().for_each(|height| out.i16(*height));
        out.bytes(&self.density);
    }
}
