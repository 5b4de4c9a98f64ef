//! Topics `pose` and `joint`: where the vehicle is, and where its head looks.

use crate::message::{message, wire_enum};
use crate::none::Nothing;
use crate::topic::{Qos, Topic};
use tsense_geometry::{Attitude, Global, PanTiltAngles, Point, Transform, Vehicle, global_from_vehicle};

wire_enum! {
    /// How far a pose may be trusted.
    PoseQuality, unknown = Invalid {
        /// No position.
        Invalid = 0 "invalid",
        /// Free inertial, dead reckoning or high variance.
        Degraded = 1 "degraded",
        /// Single-point GNSS.
        Single = 2 "single",
        /// Differential corrections.
        Differential = 3 "differential",
        /// Real-time kinematic, float ambiguities.
        RtkFloat = 4 "rtk float",
        /// Real-time kinematic, fixed ambiguities, or a good inertial solution.
        RtkFixed = 5 "rtk fixed",
    }
}

/// Bit of [`Pose::flags`]: the source repeats the same position while it reports speed.
pub const POSE_FROZEN: u8 = 1;
/// Bit of [`Pose::flags`]: this pose is farther from the last than its speed and deviations explain.
pub const POSE_JUMPED: u8 = 2;

message! {
    /// The vehicle's pose, thesis (2-7) and (2-8).
    Pose = "tsense.pose.v1" {
        /// Instant the pose was true, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// UTM easting, metres.
        easting_m: f64,
        /// UTM northing, metres.
        northing_m: f64,
        /// Height above the WGS 84 ellipsoid, metres.
        altitude_m: f64,
        /// phi, radians, right side down positive.
        roll_rad: f64,
        /// theta, radians, nose up positive.
        pitch_rad: f64,
        /// psi, radians from GRID north, clockwise positive.
        yaw_rad: f64,
        /// Grid convergence that was subtracted from true heading, radians.
        convergence_rad: f64,
        /// Speed east, north, up, metres per second.
        velocity_m_s: [f32; 3],
        /// One sigma of easting, northing, altitude, metres; NaN where the source does not say.
        position_std_m: [f32; 3],
        /// One sigma of roll, pitch, yaw, radians; NaN where the source does not say.
        attitude_std_rad: [f32; 3],
        /// UTM zone 1 to 60; 0 before the first valid pose. Pinned for the life of a graph.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// A [`PoseQuality`].
        quality: u8,
        /// [`POSE_FROZEN`], [`POSE_JUMPED`].
        flags: u8,
    }
}

impl Pose {
    /// The quality, parsed.
    pub fn quality(&self) -> PoseQuality {
        PoseQuality::from_wire(self.quality)
    }

    /// Roll, pitch, yaw.
    pub fn attitude(&self) -> Attitude {
        Attitude { roll_rad: self.roll_rad, pitch_rad: self.pitch_rad, yaw_rad: self.yaw_rad }
    }

    /// The transform of thesis (2-8).
    pub fn global_from_vehicle(&self) -> Transform<Global, Vehicle> {
        let position: Point<Global> = Point::new(self.easting_m, self.northing_m, self.altitude_m);
        global_from_vehicle(self.attitude(), position)
    }
}

/// The topic `pose`.
pub struct Poses;

impl Topic for Poses {
    type Header = Pose;
    type Item = Nothing;
    const NAME: &'static str = "pose";
    const QOS: Qos = Qos { publishers: 1, subscribers: 8, history: 1, buffer: 64, borrow: 4, loans: 2, event: true };
    const ITEMS_MAX: usize = 1;
}

/// Bit of [`Joint::flags`]: an axis hit its limit, so steps may be lost; angles are not to be trusted until reset.
pub const JOINT_LIMIT_HIT: u8 = 1;
/// Bit of [`Joint::flags`]: the head was told to stop.
pub const JOINT_HALTED: u8 = 2;

message! {
    /// Angles of the pan-tilt unit, signs and zero offsets already applied (thesis theta1, theta2).
    Joint = "tsense.joint.v1" {
        /// Instant the unit sampled its position, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// One sigma of that instant, nanoseconds: half of what the round trip leaves unexplained.
        stamp_std_ns: i64,
        /// theta1, radians, positive to the right.
        pan_rad: f64,
        /// theta2, radians, positive up.
        tilt_rad: f64,
        /// Rate of pan, radians per second.
        pan_rate_rad_s: f32,
        /// Rate of tilt, radians per second.
        tilt_rate_rad_s: f32,
        /// Counts half nods (turning points) since the driver started: one sweep each.
        sweep: u32,
        /// [`JOINT_LIMIT_HIT`], [`JOINT_HALTED`]; 0 is good.
        flags: u8,
        /// Zero.
        reserved: [u8; 3],
    }
}

impl Joint {
    /// The two angles.
    pub fn angles(&self) -> PanTiltAngles {
        PanTiltAngles { pan_rad: self.pan_rad, tilt_rad: self.tilt_rad }
    }
}

/// The topic `joint`.
pub struct Joints;

impl Topic for Joints {
    type Header = Joint;
    type Item = Nothing;
    const NAME: &'static str = "joint";
    const QOS: Qos = Qos { publishers: 1, subscribers: 8, history: 1, buffer: 64, borrow: 4, loans: 2, event: true };
    const ITEMS_MAX: usize = 1;
}
