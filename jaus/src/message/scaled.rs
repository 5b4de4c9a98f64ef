//! Scaled integers with their range and unit as types: what is inside is the real value.

use super::Field;
use crate::bytes::{Malformed, Reader, Writer};
use crate::scale::Scale;
use std::f64::consts::PI;

macro_rules! scaled {
    ($($(#[$doc:meta])* $name:ident: $bits:ident, $to:ident, $from:ident = $low:expr, $high:expr;)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct $name(pub f64);

        impl $name {
            /// Its range.
            pub const SCALE: Scale = Scale::new($low, $high);
        }

        impl Field for $name {
            fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
                reader.$bits().map(|integer| Self(Self::SCALE.$from(integer)))
            }
            fn write(&self, out: &mut Writer) {
                out.$bits(Self::SCALE.$to(self.0));
            }
        }
    )+};
}

scaled! {
    /// Degrees, north positive.
    Latitude: u32, to_u32, from_u32 = -90.0, 90.0;
    /// Degrees, east positive.
    Longitude: u32, to_u32, from_u32 = -180.0, 180.0;
    /// Metres above the WGS 84 ellipsoid.
    Altitude: u32, to_u32, from_u32 = -10_000.0, 35_000.0;
    /// One sigma, metres or metres per second.
    Rms: u32, to_u32, from_u32 = 0.0, 100.0;
    /// Radians, in 16 bits.
    Angle16: u16, to_u16, from_u16 = -PI, PI;
    /// Radians, in 32 bits.
    Angle32: u32, to_u32, from_u32 = -PI, PI;
    /// One sigma, radians, in 16 bits.
    AngleRms16: u16, to_u16, from_u16 = 0.0, PI;
    /// One sigma, radians, in 32 bits.
    AngleRms32: u32, to_u32, from_u32 = 0.0, PI;
    /// Metres per second.
    Speed: u32, to_u32, from_u32 = -327.68, 327.67;
    /// Radians per second.
    TurnRate: u16, to_u16, from_u16 = -32.768, 32.767;
    /// Events a second.
    EventRate: u16, to_u16, from_u16 = 0.0, 1092.0;
    /// Scans a second.
    ScanRate: u16, to_u16, from_u16 = 0.0, 1000.0;
    /// Width or height of a map, metres, in steps of 0.1526 m.
    Extent: u16, to_u16, from_u16 = 0.0, 10_000.0;
    /// A local coordinate, metres.
    Local: u32, to_u32, from_u32 = -100_000.0, 100_000.0;
    /// Distance along a beam, metres.
    Range: u32, to_u32, from_u32 = 0.0, 1e6;
    /// One sigma of a distance along a beam, metres.
    RangeRms: u32, to_u32, from_u32 = 0.0, 100_000.0;
    /// Along an axis of the vehicle or of a part of it, metres.
    Offset: u32, to_u32, from_u32 = -30.0, 30.0;
    /// A component of a unit quaternion.
    Unit: u32, to_u32, from_u32 = -1.0, 1.0;
    /// Bound of a joint's angle, radians.
    JointBound: u32, to_u32, from_u32 = -8.0 * PI, 8.0 * PI;
    /// Highest speed of a joint, radians per second.
    JointSpeed: u32, to_u32, from_u32 = 0.0, 10.0 * PI;
    /// Per cent.
    Percent: u8, to_u8, from_u8 = 0.0, 100.0;
}

macro_rules! signed {
    ($($(#[$doc:meta])* $name:ident = $low:expr, $high:expr;)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct $name(pub f64);

        impl Field for $name {
            fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
                reader.i32().map(|integer| Self(Scale::new($low, $high).from_signed(integer)))
            }
            fn write(&self, out: &mut Writer) {
                out.i32(Scale::new($low, $high).to_signed(self.0));
            }
        }
    )+};
}

signed! {
    /// Degrees, north positive, as RA 3.x writes them.
    SignedLatitude = -90.0, 90.0;
    /// Degrees, east positive, as RA 3.x writes them.
    SignedLongitude = -180.0, 180.0;
}
