//! Poses and joint angles as tf2_msgs/TFMessage and nav_msgs/Odometry. Time is in the messages; no clock here.
//!
//! In: topics `pose` and `joint`, the mounts. Out: `map -> odom`, `odom -> base_link`, the pan-tilt unit's joints, and the
//! constant transforms. REP-105 wants `odom` without jumps: where a pose says that it jumped, the shift goes into
//! `map -> odom`, and `odom -> base_link` goes on from where the speed had taken it.

use super::config::Frames;
use super::frames::{body_from_body, in_base, map_from_base, pose, vector};
use super::messages::{
    Covariance, Header, Odometry, PoseWithCovariance, TfMessage, TransformStamped, Twist, TwistWithCovariance,
};
use nalgebra::{Isometry3, Translation3, Vector3};
use tsense_contract::{Joint, POSE_JUMPED, Pose};
use tsense_geometry::{Mounting, PanTiltAngles, PanTiltBase, Tilt, Timestamp, Transform, base_from_tilt};

/// Longest time over which a rate of turn is taken from two poses, seconds: beyond it the turn may have gone on and back.
const TURN_SPAN_MAX_S: f64 = 0.5;

/// Where a ladar sits, and how far it sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Mount {
    /// The ladar's name; its frame is named the same, with an underscore for each dash.
    pub name: String,
    /// Nearest range that is a measurement, metres.
    pub range_min_m: f64,
    /// Farthest, metres.
    pub range_max_m: f64,
    /// The ladar in the part that tilts, or on the vehicle where there is no pan-tilt unit.
    pub tilt_from_ladar: Mounting,
}

impl Mount {
    /// Its frame: ROS allows no dashes in topic names, and both should read the same.
    pub fn frame(&self) -> String {
        self.name.replace('-', "_")
    }
}

/// Everything that is bolted to the vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mounts {
    /// The pan-tilt unit's base, where there is one.
    pub pan_tilt: Option<Mounting>,
    /// The ladars.
    pub ladars: Vec<Mount>,
}

/// The vehicle's way through `odom`.
#[derive(Debug)]
pub struct Motion {
    frames: Frames,
    origin_m: [f64; 3],
    map_from_odom: Translation3<f64>,
    last: Option<(Pose, Isometry3<f64>)>,
}

impl Motion {
    /// At rest in a map with this origin in UTM.
    pub fn new(frames: Frames, origin_m: [f64; 3]) -> Self {
        Self { frames, origin_m, map_from_odom: Translation3::identity(), last: None }
    }

    /// Takes every pose in, also those that are not published: a jump must not be missed. False where it is no newer.
    pub fn take(&mut self, given: &Pose) -> bool {
        let in_map = map_from_base(&given.global_from_vehicle(), self.origin_m);
        if let Some((last, last_in_map)) = &self.last {
            let passed_s = seconds_between(last, given);
            if passed_s <= 0.0 {
                return false;
            }
            if given.flags & POSE_JUMPED != 0 {
                let expected = last_in_map.translation.vector + mean_velocity(last, given) * passed_s;
                self.map_from_odom.vector += in_map.translation.vector - expected;
            }
        }
        self.last = Some((*given, in_map));
        true
    }

    fn odom_from_base(&self, in_map: &Isometry3<f64>) -> Isometry3<f64> {
        self.map_from_odom.inverse() * in_map
    }

    /// `map -> odom -> base_link` at the newest pose.
    pub fn transforms(&self) -> Option<TfMessage> {
        let (newest, in_map) = self.last.as_ref()?;
        let Frames { map, odom, base, .. } = &self.frames;
        let drift = Isometry3::from_parts(self.map_from_odom, nalgebra::UnitQuaternion::identity());
        let transforms = vec![
            stamped(newest.stamp_ns, map, odom, &drift),
            stamped(newest.stamp_ns, odom, base, &self.odom_from_base(in_map)),
        ];
        Some(TfMessage { transforms })
    }

    /// The newest pose and speed; `before` is the pose it turned from.
    pub fn odometry(&self, before: Option<&Pose>) -> Option<Odometry> {
        let (newest, in_map) = self.last.as_ref()?;
        let [roll, pitch, yaw] = newest.attitude_std_rad;
        let [east, north, up] = newest.position_std_m;
        let twist = Twist {
            linear: vector(&in_base(in_map, newest.velocity_m_s)),
            angular: vector(&before.and_then(|before| self.turn_rate(before)).unwrap_or_default()),
        };
        Some(Odometry {
            header: Header::new(newest.stamp_ns, &self.frames.odom),
            child_frame_id: self.frames.base.clone(),
            pose: PoseWithCovariance {
                pose: pose(&self.odom_from_base(in_map)),
                covariance: Covariance::diagonal([east, north, up, roll, pitch, yaw]),
            },
            twist: TwistWithCovariance { twist, covariance: Covariance::default() },
        })
    }

    /// Turn rate about x, y, z of the vehicle, radians per second, from the poses: no message carries one.
    fn turn_rate(&self, before: &Pose) -> Option<Vector3<f64>> {
        let (newest, in_map) = self.last.as_ref()?;
        let passed_s = seconds_between(before, newest);
        let from = map_from_base(&before.global_from_vehicle(), self.origin_m);
        let turn = (from.rotation.inverse() * in_map.rotation).scaled_axis();
        (0.0 < passed_s && passed_s <= TURN_SPAN_MAX_S).then(|| turn / passed_s)
    }

    /// The newest pose.
    pub fn newest(&self) -> Option<Pose> {
        self.last.map(|(pose, _)| pose)
    }

    /// `ptu_base -> ptu_pan -> ptu_tilt`.
    pub fn joint_transforms(&self, joint: &Joint) -> TfMessage {
        let Frames { ptu_base, ptu_pan, ptu_tilt, .. } = &self.frames;
        let turned = |pan_rad, tilt_rad| -> Isometry3<f64> {
            let turn: Transform<PanTiltBase, Tilt> = base_from_tilt(PanTiltAngles { pan_rad, tilt_rad });
            body_from_body(&turn)
        };
        let transforms = vec![
            stamped(joint.stamp_ns, ptu_base, ptu_pan, &turned(joint.pan_rad, 0.0)),
            stamped(joint.stamp_ns, ptu_pan, ptu_tilt, &turned(0.0, joint.tilt_rad)),
        ];
        TfMessage { transforms }
    }

    /// What does not move: the map in UTM, the pan-tilt unit's base, the ladars.
    pub fn static_transforms(&self, mounts: &Mounts, now: Timestamp) -> TfMessage {
        let Frames { utm, map, base, ptu_base, ptu_tilt, .. } = &self.frames;
        let [x, y, z] = self.origin_m;
        let mut transforms = vec![stamped(now.ns, utm, map, &Isometry3::translation(x, y, z))];
        if let Some(unit) = &mounts.pan_tilt {
            transforms.push(stamped(now.ns, base, ptu_base, &mounted(unit)));
        }
        let parent = if mounts.pan_tilt.is_some() { ptu_tilt } else { base };
        let ladars = mounts.ladars.iter();
        transforms.extend(ladars.map(|l| stamped(now.ns, parent, &l.frame(), &mounted(&l.tilt_from_ladar))));
        TfMessage { transforms }
    }
}

fn mounted(mounting: &Mounting) -> Isometry3<f64> {
    let transform: Transform<PanTiltBase, Tilt> = mounting.transform();
    body_from_body(&transform)
}

fn stamped(stamp_ns: i64, parent: &str, child: &str, transform: &Isometry3<f64>) -> TransformStamped {
    TransformStamped {
        header: Header::new(stamp_ns, parent),
        child_frame_id: child.into(),
        transform: pose(transform).into(),
    }
}

fn seconds_between(earlier: &Pose, later: &Pose) -> f64 {
    Timestamp::from_ns(later.stamp_ns).seconds_since(Timestamp::from_ns(earlier.stamp_ns))
}

fn mean_velocity(a: &Pose, b: &Pose) -> Vector3<f64> {
    Vector3::from_fn(|i, _| f64::midpoint(f64::from(a.velocity_m_s[i]), f64::from(b.velocity_m_s[i])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use std::f64::consts::FRAC_PI_2;

    fn at(seconds: f64, east_m: f64, flags: u8) -> Pose {
        let mut pose = Pose::zeroed();
        pose.stamp_ns = Timestamp::from_seconds(seconds).ns;
        (pose.easting_m, pose.northing_m, pose.altitude_m) = (east_m, 50.0, 10.0);
        (pose.yaw_rad, pose.flags, pose.velocity_m_s) = (FRAC_PI_2, flags, [2.0, 0.0, 0.0]);
        pose
    }

    fn motion() -> Motion {
        Motion::new(Frames::default(), [100.0, 50.0, 10.0])
    }

    #[test]
    fn a_jump_of_the_position_moves_odom_and_not_the_vehicle_in_it() {
        let mut motion = motion();
        assert!(motion.take(&at(1.0, 110.0, 0)));
        assert!(motion.take(&at(1.1, 110.2, 0)));
        assert!(motion.take(&at(1.2, 113.4, POSE_JUMPED)), "3 m farther than the speed explains");
        assert!(motion.take(&at(1.3, 113.6, 0)));
        assert!(!motion.take(&at(1.3, 113.6, 0)), "no newer");
        let tf = motion.transforms().unwrap();
        let [map_odom, odom_base] = &tf.transforms[..] else { panic!() };
        assert_eq!((map_odom.header.frame_id.as_str(), map_odom.child_frame_id.as_str()), ("map", "odom"));
        assert!((map_odom.transform.translation.x - 3.0).abs() < 1e-6, "{:?}", map_odom.transform);
        assert!((odom_base.transform.translation.x - 10.6).abs() < 1e-6, "{:?}", odom_base.transform);
        assert!((odom_base.transform.translation.y).abs() < 1e-6);
    }

    #[test]
    fn odometry_has_its_speed_in_the_vehicle_and_its_turn_from_two_poses() {
        let mut motion = motion();
        let before = Pose { yaw_rad: FRAC_PI_2 + 0.02, ..at(1.0, 110.0, 0) };
        motion.take(&before);
        motion.take(&at(1.1, 110.2, 0));
        let odometry = motion.odometry(Some(&before)).unwrap();
        let twist = &odometry.twist.twist;
        assert!((twist.linear.x - 2.0).abs() < 1e-9 && twist.linear.y.abs() < 1e-9);
        // The heading went back by 0.02 rad in 0.1 s, clockwise of north: to the left, which is positive in ROS.
        assert!((twist.angular.z - 0.2).abs() < 1e-6, "{:?}", twist.angular);
        assert_eq!((odometry.header.frame_id.as_str(), odometry.child_frame_id.as_str()), ("odom", "base_link"));
    }

    #[test]
    fn ladars_hang_on_the_tilting_part_or_on_the_vehicle() {
        let ladar = |name: &str| Mount {
            name: name.into(),
            range_min_m: 0.5,
            range_max_m: 50.0,
            tilt_from_ladar: Mounting { y_m: 0.3, z_m: -0.1, ..Mounting::default() },
        };
        let head = Mounting { x_m: 1.0, z_m: -2.0, ..Mounting::default() };
        let mut mounts = Mounts { pan_tilt: Some(head), ladars: vec![ladar("front-left")] };
        let tf = motion().static_transforms(&mounts, Timestamp::default());
        let names: Vec<_> =
            tf.transforms.iter().map(|t| format!("{} {}", t.header.frame_id, t.child_frame_id)).collect();
        assert_eq!(names, ["utm map", "base_link ptu_base", "ptu_tilt front_left"]);
        assert_eq!(tf.transforms[0].transform.translation.x, 100.0);
        let (base, ladar) = (&tf.transforms[1].transform.translation, &tf.transforms[2].transform.translation);
        assert!((base.z - 2.0).abs() < 1e-12 && (base.x - 1.0).abs() < 1e-12);
        assert!((ladar.y + 0.3).abs() < 1e-12 && (ladar.z - 0.1).abs() < 1e-12);
        mounts.pan_tilt = None;
        let tf = motion().static_transforms(&mounts, Timestamp::default());
        assert_eq!((tf.transforms.len(), tf.transforms[1].header.frame_id.as_str()), (2, "base_link"));
    }

    #[test]
    fn joints_pan_to_the_right_about_minus_z() {
        let joint = Joint { pan_rad: 0.5, tilt_rad: 0.25, ..Joint::zeroed() };
        let tf = motion().joint_transforms(&joint);
        let [pan, tilt] = &tf.transforms[..] else { panic!() };
        assert!((pan.transform.rotation.z + 0.25_f64.sin()).abs() < 1e-12);
        assert!((tilt.transform.rotation.y + 0.125_f64.sin()).abs() < 1e-12);
    }
}
