//! Where the vehicle is and where its head looks, over time: what poses and pan-tilt readings are accepted.
//!
//! In: `pose` and `joint` messages. Out: the transform of thesis (2-10) at a beam's own time. Refuses poses that are
//! not finite, off the Earth, of another UTM zone than the first one, invalid or frozen. A pose that the driver
//! marks as a jump starts the history anew, so that nothing is interpolated across the jump.

use crate::config::PlacingConfig;
use crate::drops::{DropCause, Drops};
use crate::ladar_mount::Extrinsics;
use tsense_contract::{JOINT_LIMIT_HIT, Joint, POSE_FROZEN, POSE_JUMPED, Pose, PoseQuality};
use tsense_geometry::{
    Global, Interpolate, Ladar, Limits, NoValue, PanTiltAngles, Timestamp, Trajectory, Transform, Vehicle, attitude_of,
};

/// Farthest from the UTM origin on any axis that is a place on Earth, metres: a northing ends at 10,000 km.
const POSITION_MAX_M: f64 = 1.0e7;

/// Samples kept: a second and more at 200 Hz, the fastest that the supported devices send. A scan waits at most
/// for its deadline, so older samples serve nobody.
const SAMPLES_MAX: usize = 512;

/// Angles, and the nod they belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadSample {
    /// Pan and tilt.
    pub angles: PanTiltAngles,
    /// Counts half nods.
    pub sweep: u32,
}

impl Interpolate for HeadSample {
    /// A nod ends at the sample that says so.
    fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        let sweep = if fraction < 1.0 { self.sweep } else { other.sweep };
        Self { angles: self.angles.interpolate(&other.angles, fraction), sweep }
    }
}

/// The vehicle's and the head's histories.
#[derive(Debug)]
pub struct Motion {
    poses: Trajectory<Transform<Global, Vehicle>>,
    heads: Trajectory<HeadSample>,
    last_pose: Option<Pose>,
}

impl Motion {
    /// No data yet.
    pub fn new(config: &PlacingConfig) -> Self {
        let limits =
            |gap_max_s| Limits { capacity: SAMPLES_MAX, gap_max_s, extrapolation_max_s: config.extrapolation_max_s };
        Self {
            poses: Trajectory::new(limits(config.pose_gap_max_s)),
            heads: Trajectory::new(limits(config.joint_gap_max_s)),
            last_pose: None,
        }
    }

    /// Takes in a pose, or counts why not.
    pub fn add_pose(&mut self, pose: &Pose, drops: &mut Drops) -> bool {
        if !self.pose_is_good(pose) {
            drops.count(DropCause::PoseRefused);
            return false;
        }
        if pose.flags & POSE_JUMPED != 0 {
            self.poses.clear();
        }
        let stamp = Timestamp::from_ns(pose.stamp_ns);
        if !self.poses.push(stamp, pose.global_from_vehicle()) {
            drops.count(DropCause::PoseRefused);
            return false;
        }
        self.last_pose = Some(*pose);
        true
    }

    fn pose_is_good(&self, pose: &Pose) -> bool {
        let position_m = [pose.easting_m, pose.northing_m, pose.altitude_m];
        let angles_rad = [pose.roll_rad, pose.pitch_rad, pose.yaw_rad];
        let newer = self.last_pose.is_none_or(|last| pose.stamp_ns > last.stamp_ns);
        let same_zone = self.zone().is_none_or(|zone| zone == (pose.zone, pose.south));
        newer
            && same_zone
            && (1..=60).contains(&pose.zone)
            && pose.quality() != PoseQuality::Invalid
            && pose.flags & POSE_FROZEN == 0
            && position_m.iter().all(|c| c.abs() <= POSITION_MAX_M)
            && angles_rad.iter().all(|a| a.is_finite())
            && self.last_pose.is_none_or(|last| distance_m(&last, pose) < POSITION_MAX_M)
    }

    /// Takes in a pan-tilt reading, or counts why not.
    pub fn add_joint(&mut self, joint: &Joint, drops: &mut Drops) -> bool {
        let good = joint.pan_rad.is_finite() && joint.tilt_rad.is_finite() && joint.flags & JOINT_LIMIT_HIT == 0;
        let sample = HeadSample { angles: joint.angles(), sweep: joint.sweep };
        let taken = good && self.heads.push(Timestamp::from_ns(joint.stamp_ns), sample);
        if !taken {
            drops.count(DropCause::JointRefused);
        }
        taken
    }

    /// The newest accepted pose.
    pub fn last_pose(&self) -> Option<&Pose> {
        self.last_pose.as_ref()
    }

    /// UTM zone and hemisphere of the first accepted pose: pinned.
    pub fn zone(&self) -> Option<(u8, u8)> {
        self.last_pose.map(|pose| (pose.zone, pose.south))
    }

    /// The vehicle at an instant.
    pub fn vehicle_at(&self, stamp: Timestamp) -> Result<Transform<Global, Vehicle>, NoValue> {
        self.poses.at(stamp)
    }

    /// The newest pose message, moved to an instant where the history covers it.
    pub fn pose_message_at(&self, stamp: Timestamp) -> Option<Pose> {
        let (pose, there) = (self.last_pose?, self.vehicle_at(stamp).ok()?);
        let (attitude, at) = (attitude_of(&there), there.origin());
        Some(Pose {
            stamp_ns: stamp.ns,
            easting_m: at.x(),
            northing_m: at.y(),
            altitude_m: at.z(),
            roll_rad: attitude.roll_rad,
            pitch_rad: attitude.pitch_rad,
            yaw_rad: attitude.yaw_rad,
            ..pose
        })
    }

    /// The head at an instant.
    pub fn head_at(&self, stamp: Timestamp) -> Result<HeadSample, NoValue> {
        self.heads.at(stamp)
    }

    /// Thesis (2-10): `T_L^G = T_V^G * T_L^V`, both factors at the beam's own time.
    pub fn global_from_ladar(&self, mount: &Extrinsics, stamp: Timestamp) -> Result<Transform<Global, Ladar>, NoValue> {
        let angles = if mount.on_pan_tilt() { self.head_at(stamp)?.angles } else { PanTiltAngles::default() };
        Ok(self.vehicle_at(stamp)? * mount.vehicle_from_ladar(angles))
    }
}

/// A stretch of time over which the ladar moves and turns without a kink.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<F> {
    /// Its last instant.
    pub until: Timestamp,
    /// The ladar turns no faster than this, all its axes added, radians a second.
    pub turn_rad_s: f64,
    /// Where the ladar is at an instant of it.
    pub global_from_ladar: F,
}

impl Motion {
    /// The stretch that begins with an instant: thesis (2-10) between the same two poses and the same two readings.
    pub fn stretch(
        &self,
        mount: &Extrinsics,
        stamp: Timestamp,
    ) -> Result<Stretch<impl Fn(Timestamp) -> Transform<Global, Ladar>>, NoValue> {
        let poses = self.poses.bracket(stamp)?;
        let heads = if mount.on_pan_tilt() { Some(self.heads.bracket(stamp)?) } else { None };
        let turn_rad = poses.from.1.isometry.rotation.angle_to(&poses.to.1.isometry.rotation);
        let nod_rad_s = heads.map_or(0.0, |heads| {
            let (from, to) = (heads.from.1.angles, heads.to.1.angles);
            rate((to.pan_rad - from.pan_rad).abs() + (to.tilt_rad - from.tilt_rad).abs(), heads.gap_s())
        });
        let (extrinsics, until) = (*mount, heads.map_or(poses.until, |heads| heads.until.min(poses.until)));
        let global_from_ladar = move |stamp| {
            let angles = heads.map_or(PanTiltAngles::default(), |heads| heads.at(stamp).angles);
            poses.at(stamp) * extrinsics.vehicle_from_ladar(angles)
        };
        Ok(Stretch { until, turn_rad_s: rate(turn_rad, poses.gap_s()) + nod_rad_s, global_from_ladar })
    }
}

/// No time, no rate: the oldest sample alone.
fn rate(angle_rad: f64, gap_s: f64) -> f64 {
    if gap_s > 0.0 { angle_rad / gap_s } else { 0.0 }
}

fn distance_m(a: &Pose, b: &Pose) -> f64 {
    let d = [a.easting_m - b.easting_m, a.northing_m - b.northing_m, a.altitude_m - b.altitude_m];
    d.iter().map(|c| c * c).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::pose_at;

    fn taken(pose: Pose) -> (bool, u64) {
        let (mut motion, mut drops) = (Motion::new(&PlacingConfig::default()), Drops::default());
        assert!(motion.add_pose(&pose_at(0.0, [500_000.0, 5.0e6, 100.0]), &mut drops));
        (motion.add_pose(&pose, &mut drops), drops.of(DropCause::PoseRefused))
    }

    #[test]
    fn a_pose_that_makes_no_sense_is_refused_and_counted() {
        let good = pose_at(0.1, [500_000.1, 5.0e6, 100.0]);
        assert_eq!(taken(good), (true, 0));
        let refused = [
            Pose { zone: 33, ..good },
            Pose { south: 1, ..good },
            Pose { zone: 0, ..good },
            Pose { easting_m: f64::NAN, ..good },
            Pose { yaw_rad: f64::INFINITY, ..good },
            Pose { northing_m: 1.5e7, ..good },
            Pose { northing_m: -9.0e6, ..good },
            Pose { stamp_ns: 0, ..good },
            Pose { quality: PoseQuality::Invalid.to_wire(), ..good },
            Pose { flags: POSE_FROZEN, ..good },
        ];
        for pose in refused {
            assert_eq!(taken(pose), (false, 1), "{pose:?}");
        }
    }

    #[test]
    fn nothing_is_interpolated_across_a_jump() {
        let (mut motion, mut drops) = (Motion::new(&PlacingConfig::default()), Drops::default());
        motion.add_pose(&pose_at(0.0, [0.0, 0.0, 0.0]), &mut drops);
        motion.add_pose(&Pose { flags: POSE_JUMPED, ..pose_at(0.1, [5.0, 0.0, 0.0]) }, &mut drops);
        motion.add_pose(&pose_at(0.2, [5.0, 0.0, 0.0]), &mut drops);
        assert!(motion.vehicle_at(Timestamp::from_seconds(0.05)).is_err());
        assert_eq!(motion.vehicle_at(Timestamp::from_seconds(0.15)).unwrap().origin().x(), 5.0);
        assert_eq!(drops.total(), 0);
    }
}
