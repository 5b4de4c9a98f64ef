//! What a ladar measured: AS6060 RangeSensor 1.0.

use super::scaled::{Angle32, AngleRms32, Range, RangeRms, ScanRate};
use super::{Field, List16};
use crate::bytes::{Malformed, Reader, Writer};

/// Frame of a report: the sensor's own.
pub const NATIVE: u8 = 0;
/// Frame of a report: the vehicle's.
pub const VEHICLE: u8 = 1;
/// [`RangeData::Error`]: the sensor gives nothing now.
pub const NOT_ACTIVE: u8 = 0;
/// [`RangeData::Error`]: something else.
pub const FAILURE: u8 = 255;

messages! {
    /// Asks what sensors can do.
    QueryRangeSensorCapabilities = 0x2801 {
        /// Which, and what of them.
        sensors: List16<SensorQuery>,
    }
    /// What sensors can do.
    ReportRangeSensorCapabilities = 0x4801 {
        /// One by one.
        sensors: List16<RangeSensorCapabilities>,
    }
    /// Asks how sensors are set.
    QueryRangeSensorConfiguration = 0x2802 {
        /// Which, and what of them.
        sensors: List16<SensorQuery>,
    }
    /// How sensors are set.
    ReportRangeSensorConfiguration = 0x4802 {
        /// One by one.
        sensors: List16<RangeSensorConfiguration>,
    }
    /// Asks for what sensors measured.
    QueryRangeSensorData = 0x2803 {
        /// Which, in which frame, and what of it.
        sensors: List16<RangeDataQuery>,
    }
    /// What sensors measured.
    ReportRangeSensorData = 0x4803 {
        /// One by one.
        sensors: List16<RangeData>,
    }
}

records! {
    /// A sensor, and what is wanted of it.
    SensorQuery {
        /// The sensor.
        sensor: u16,
        /// A bit for each optional field.
        wanted: u16,
    }
    /// A sensor, its frame, and what is wanted of each point.
    RangeDataQuery {
        /// The sensor.
        sensor: u16,
        /// [`NATIVE`] or [`VEHICLE`].
        frame: u8,
        /// A bit for each optional field of [`RangePoint`].
        wanted: u16,
    }
    /// Why there is no data.
    RangeError {
        /// The sensor.
        sensor: u16,
        /// [`NOT_ACTIVE`], [`FAILURE`].
        code: u8,
        /// In words.
        words: String,
    }
    /// Points of a sensor.
    RangeScan {
        /// The sensor.
        sensor: u16,
        /// [`NATIVE`] or [`VEHICLE`].
        frame: u8,
        /// When: see [`crate::time_stamp`].
        time: u32,
        /// One by one.
        points: List16<RangePoint>,
    }
}

presence! {
    /// One direction and what is there. Bearing is positive to the right, inclination down.
    RangePoint: u16 {
        /// Its number.
        may id: u32,
        /// Metres.
        must range: Range,
        /// 1 where the range is one.
        may range_valid: u8,
        /// One sigma, metres.
        may range_rms: RangeRms,
        /// Radians.
        must bearing: Angle32,
        /// 1 where the bearing is one.
        may bearing_valid: u8,
        /// One sigma, radians.
        may bearing_rms: AngleRms32,
        /// Radians.
        must inclination: Angle32,
        /// 1 where the inclination is one.
        may inclination_valid: u8,
        /// One sigma, radians.
        may inclination_rms: AngleRms32,
    }
    /// What a sensor can do.
    RangeSensorCapabilities: u16 {
        /// The sensor.
        must sensor: u16,
        /// Its name.
        must name: String,
        /// Bit 0 active, 1 standby, 2 off.
        may states: u8,
        /// Radians.
        may horizontal_start: Angle32,
        /// Radians.
        may horizontal_stop: Angle32,
        /// Radians.
        may vertical_start: Angle32,
        /// Radians.
        may vertical_stop: Angle32,
        /// Hertz.
        may rate_min: ScanRate,
        /// Hertz.
        may rate_max: ScanRate,
        /// Metres.
        may range_min: Range,
        /// Metres.
        may range_max: Range,
        /// Bit 0 none, 1 DEFLATE, 2 bzip2, 3 LZMA.
        may compressions: u8,
        /// 1 where points can be had in the vehicle's frame.
        may transforms: u8,
    }
    /// How a sensor is set.
    RangeSensorConfiguration: u16 {
        /// The sensor.
        must sensor: u16,
        /// Radians.
        may horizontal_start: Angle32,
        /// Radians.
        may horizontal_stop: Angle32,
        /// Radians.
        may vertical_start: Angle32,
        /// Radians.
        may vertical_stop: Angle32,
        /// Hertz.
        may rate: ScanRate,
        /// Metres.
        may range_min: Range,
        /// Metres.
        may range_max: Range,
        /// 0 active, 1 standby, 2 off.
        may state: u8,
    }
}

/// What one sensor measured, or why nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum RangeData {
    /// Nothing.
    Error(RangeError),
    /// Points.
    Scan(RangeScan),
}

impl Field for RangeData {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        match reader.u8()? {
            0 => RangeError::read(reader).map(Self::Error),
            1 => RangeScan::read(reader).map(Self::Scan),
            _ => Err(Malformed::Tag),
        }
    }
    fn write(&self, out: &mut Writer) {
        match self {
            Self::Error(error) => {
                out.u8(0);
                error.write(out);
            }
            Self::Scan(scan) => {
                out.u8(1);
                scan.write(out);
            }
        }
    }
}
