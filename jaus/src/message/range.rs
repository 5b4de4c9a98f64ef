//! What a ladar measured: AS6060 RangeSensor 1.0.

use super::scaled::{Angle32, AngleRms32, Offset, Range, RangeRms, ScanRate, Unit};
use super::{Field, List16};
use crate::bytes::{Malformed, Reader, Writer};

/// Number that stands for all sensors.
pub const ALL_SENSORS: u16 = 0;
/// Frame of a report: the sensor's own.
pub const NATIVE: u8 = 0;
/// Frame of a report: the vehicle's.
pub const VEHICLE: u8 = 1;
/// [`RangeData::Error`]: the sensor gives nothing now.
pub const NOT_ACTIVE: u8 = 0;
/// [`RangeData::Error`]: no such compression here.
pub const BAD_COMPRESSION: u8 = 1;
/// [`RangeData::Error`] and [`Setting::Refused`]: something else.
pub const FAILURE: u8 = 255;

/// [`CompressedData`]: points as they are.
pub const UNCOMPRESSED: u8 = 0;
/// [`Setting::Refused`]: no such sensor.
pub const UNKNOWN_SENSOR: u8 = 0;
/// [`Setting::Refused`]: several faults at once.
pub const MANY_FAULTS: u8 = 6;

messages! {
    /// Sets sensors.
    SetRangeSensorConfiguration = 0x0802 {
        /// Comes back in the answer.
        request: u8,
        /// Which, and how.
        sensors: List16<RangeSensorConfiguration>,
    }
    /// Whether sensors were set.
    ConfirmSensorConfiguration = 0x0801 {
        /// That of the request.
        request: u8,
        /// One by one.
        sensors: List16<Setting>,
    }
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
    /// Asks for the same, compressed.
    QueryRangeSensorCompressedData = 0x2804 {
        /// Which, in which frame, how compressed, and what of it.
        sensors: List16<CompressedDataQuery>,
    }
    /// The same, compressed.
    ReportRangeSensorCompressedData = 0x4804 {
        /// One by one.
        sensors: List16<CompressedData>,
    }
    /// Asks where sensors sit.
    QuerySensorGeometricProperties = 0x2805 {
        /// Which.
        sensors: List16<u16>,
    }
    /// Where sensors sit.
    ReportSensorGeometricProperties = 0x4805 {
        /// One by one.
        sensors: List16<SensorGeometry>,
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
    /// A sensor, its frame, the compression, and what is wanted of each point.
    CompressedDataQuery {
        /// The sensor.
        sensor: u16,
        /// [`NATIVE`] or [`VEHICLE`].
        frame: u8,
        /// [`UNCOMPRESSED`], 1 DEFLATE, 2 bzip2, 3 LZMA.
        compression: u8,
        /// A bit for each optional field of [`RangePoint`].
        wanted: u16,
    }
    /// Where something sits: its origin in a parent's axes, and `d + ai + bj + ck`, which takes vectors from its axes to
    /// the parent's.
    Placement {
        /// Forward, metres.
        x: Offset,
        /// To the right, metres.
        y: Offset,
        /// Down, metres.
        z: Offset,
        /// Real part.
        d: Unit,
        /// Of i.
        a: Unit,
        /// Of j.
        b: Unit,
        /// Of k.
        c: Unit,
    }
    /// Where a sensor sits on the part of a manipulator that moves with a joint.
    OnJoint {
        /// Who reports the joint's angle.
        subsystem: u16,
        /// Of that.
        node: u8,
        /// Of that.
        component: u8,
        /// Counted from 1.
        joint: u8,
        /// In the moving part's axes.
        place: Placement,
    }
    /// Where a sensor sits.
    SensorGeometry {
        /// The sensor.
        sensor: u16,
        /// On what, and where there.
        mount: SensorMount,
    }
    /// Points of a sensor, as bytes.
    CompressedScan {
        /// The sensor.
        sensor: u16,
        /// [`NATIVE`] or [`VEHICLE`].
        frame: u8,
        /// When: see [`crate::time_stamp`].
        time: u32,
        /// [`UNCOMPRESSED`], 1 DEFLATE, 2 bzip2, 3 LZMA.
        compression: u8,
        /// The list of points.
        points: Vec<u8>,
    }
    /// Why a sensor was not set, or gives no data.
    RangeError {
        /// The sensor.
        sensor: u16,
        /// [`NOT_ACTIVE`], [`BAD_COMPRESSION`], [`FAILURE`]; [`UNKNOWN_SENSOR`] to [`MANY_FAULTS`] of a setting.
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
    /// One direction and what is there. Bearing is positive to the right and inclination up: both are right-handed turns, about
    /// z (down) and then y (right).
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

/// A field of one of several kinds, behind its tag.
macro_rules! variants {
    ($($(#[$doc:meta])* $name:ident { $($(#[$kind_doc:meta])* $tag:literal $kind:ident($value:ty),)+ })+) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq)]
        pub enum $name { $($(#[$kind_doc])* $kind($value),)+ }

        impl Field for $name {
            fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
                match reader.u8()? {
                    $($tag => Field::read(reader).map(Self::$kind),)+
                    _ => Err(Malformed::Tag),
                }
            }
            fn write(&self, out: &mut Writer) {
                match self {$(
                    Self::$kind(value) => {
                        out.u8($tag);
                        value.write(out);
                    }
                )+}
            }
        }
    )+};
}

variants! {
    /// What one sensor measured, or why nothing.
    RangeData {
        /// Nothing.
        0 Error(RangeError),
        /// Points.
        1 Scan(RangeScan),
    }
    /// The same, compressed.
    CompressedData {
        /// Nothing.
        0 Error(RangeError),
        /// Points.
        1 Scan(CompressedScan),
    }
    /// Whether a sensor was set.
    Setting {
        /// It is as was asked for; its number.
        0 Done(u16),
        /// It stays as it was.
        1 Refused(RangeError),
    }
    /// What a sensor sits on.
    SensorMount {
        /// It does not know; the tag of a variant without fields, 0.
        0 Unknown(u8),
        /// The vehicle.
        1 OnVehicle(Placement),
        /// A part that moves.
        2 OnJoint(OnJoint),
    }
}

impl Default for SensorMount {
    fn default() -> Self {
        Self::Unknown(0)
    }
}
