//! Where the vehicle is, how fast it goes, where its head looks: AS6009 and AS6057.
//!
//! Roll right side down, pitch nose up, yaw clockwise from true north; x forward, y right, z down; UTC.

use super::scaled::{
    Altitude, Angle16, Angle32, AngleRms16, JointBound, JointSpeed, Latitude, Longitude, Offset, Rms, Speed, TurnRate,
    Unit,
};

messages! {
    /// Asks for the global pose.
    QueryGlobalPose = 0x2402 {
        /// A bit for each field of [`ReportGlobalPose`].
        wanted: u16,
    }
    /// Asks for the velocity.
    QueryVelocityState = 0x2404 {
        /// A bit for each field of [`ReportVelocityState`].
        wanted: u16,
    }
    /// Asks where the pan-tilt unit sits and how far it turns.
    QueryPanTiltSpecifications = 0x2620 {
        /// A bit for each optional field of [`ReportPanTiltSpecifications`].
        wanted: u8,
    }
    /// Asks where the pan-tilt unit looks.
    QueryPanTiltJointPositions = 0x2622 {}
    /// Where the pan-tilt unit looks.
    ReportPanTiltJointPositions = 0x4622 {
        /// Pan, radians.
        pan: Angle32,
        /// Tilt, radians.
        tilt: Angle32,
    }
}

presence! {
    /// Where the vehicle is.
    ReportGlobalPose: u16 {
        /// Degrees.
        may latitude: Latitude,
        /// Degrees.
        may longitude: Longitude,
        /// Metres above the ellipsoid.
        may altitude: Altitude,
        /// One sigma of the position, metres.
        may position_rms: Rms,
        /// Radians.
        may roll: Angle16,
        /// Radians.
        may pitch: Angle16,
        /// Radians.
        may yaw: Angle16,
        /// One sigma of the attitude, radians.
        may attitude_rms: AngleRms16,
        /// When that was true: see [`crate::time_stamp`].
        may time: u32,
    }
    /// Where the pan-tilt unit's base sits on the vehicle, and how far and fast it turns. `d + ai + bj + ck` takes vectors
    /// from the base's axes to the vehicle's.
    ReportPanTiltSpecifications: u8 {
        /// Forward, metres.
        may x: Offset,
        /// To the right, metres.
        may y: Offset,
        /// Down, metres.
        may z: Offset,
        /// Real part.
        may d: Unit,
        /// Of i.
        may a: Unit,
        /// Of j.
        may b: Unit,
        /// Of k.
        may c: Unit,
        /// Least pan, radians.
        must pan_min: JointBound,
        /// Most pan, radians.
        must pan_max: JointBound,
        /// Radians per second.
        must pan_speed: JointSpeed,
        /// Least tilt, radians.
        must tilt_min: JointBound,
        /// Most tilt, radians.
        must tilt_max: JointBound,
        /// Radians per second.
        must tilt_speed: JointSpeed,
    }
    /// How fast the vehicle goes, along its own axes.
    ReportVelocityState: u16 {
        /// Forward, metres per second.
        may forward: Speed,
        /// To the right, metres per second.
        may right: Speed,
        /// Down, metres per second.
        may down: Speed,
        /// One sigma, metres per second.
        may speed_rms: Rms,
        /// Radians per second.
        may roll_rate: TurnRate,
        /// Radians per second.
        may pitch_rate: TurnRate,
        /// Radians per second.
        may yaw_rate: TurnRate,
        /// One sigma, radians per second.
        may rate_rms: AngleRms16,
        /// When that was true: see [`crate::time_stamp`].
        may time: u32,
    }
}

message_of_field! { ReportGlobalPose = 0x4402 }
message_of_field! { ReportVelocityState = 0x4404 }
message_of_field! { ReportPanTiltSpecifications = 0x4620 }
