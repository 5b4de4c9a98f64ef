//! Frames as ROS wants them: REP-103 axes (x forward, y left, z up; the map x east, y north, z up) and REP-105 names.
//!
//! In: transforms of `geometry`, whose vehicle-side frames have x forward, y right, z down. Out: transforms between
//! frames with y left and z up. Half a turn about x takes the one to the other, on both sides of a transform, so a
//! frame keeps its origin and its x axis. Pure.

use super::messages::{Pose, Quaternion, Vector3};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3 as V3};
use tsense_geometry::{Global, Transform, Vehicle};

/// Takes coordinates with y left, z up to coordinates with y right, z down, and back.
fn half_turn() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&V3::x_axis(), std::f64::consts::PI)
}

/// A transform between two frames of the vehicle's side.
pub fn body_from_body<To, From>(transform: &Transform<To, From>) -> Isometry3<f64> {
    let turn = Isometry3::from_parts(Translation3::identity(), half_turn());
    turn * transform.isometry * turn.inverse()
}

/// The vehicle in the map, whose origin lies at `origin_m` in UTM.
pub fn map_from_base(pose: &Transform<Global, Vehicle>, origin_m: [f64; 3]) -> Isometry3<f64> {
    let shift = Translation3::from(-V3::from(origin_m));
    shift * pose.isometry * half_turn()
}

/// A velocity east, north, up as the vehicle feels it: forward, left, up.
pub fn in_base(map_from_base: &Isometry3<f64>, velocity_m_s: [f32; 3]) -> V3<f64> {
    map_from_base.rotation.inverse() * V3::from(velocity_m_s.map(f64::from))
}

/// A shift as ROS writes it.
pub fn vector(v: &V3<f64>) -> Vector3 {
    Vector3 { x: v.x, y: v.y, z: v.z }
}

/// A transform as ROS writes it.
pub fn pose(isometry: &Isometry3<f64>) -> Pose {
    let q = isometry.rotation.coords;
    Pose { position: vector(&isometry.translation.vector), orientation: Quaternion { x: q.x, y: q.y, z: q.z, w: q.w } }
}

/// A place without rotation.
pub fn at(x: f64, y: f64, z: f64) -> Pose {
    pose(&Isometry3::translation(x, y, z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use std::f64::consts::FRAC_PI_2;
    use tsense_geometry::{
        Attitude, Ladar, Mounting, PanTiltAngles, PanTiltBase, Point, Tilt, base_from_tilt, beam_direction,
        global_from_vehicle,
    };

    fn close(got: Point3<f64>, expected: [f64; 3]) {
        assert!((got - Point3::from(expected)).norm() < 1e-9, "{got:?} is not {expected:?}");
    }

    #[test]
    fn a_vehicle_that_faces_east_has_its_left_in_the_north_and_its_up_above() {
        let attitude = Attitude { yaw_rad: FRAC_PI_2, ..Attitude::default() };
        let global = global_from_vehicle(attitude, Point::new(500_010.0, 4_000_020.0, 30.0));
        let map = map_from_base(&global, [500_000.0, 4_000_000.0, 20.0]);
        close(map * Point3::new(1.0, 0.0, 0.0), [11.0, 20.0, 10.0]);
        close(map * Point3::new(0.0, 1.0, 0.0), [10.0, 21.0, 10.0]);
        close(map * Point3::new(0.0, 0.0, 1.0), [10.0, 20.0, 11.0]);
        let q = pose(&map).orientation;
        assert!((q.w.abs() - 1.0).abs() < 1e-9, "x east is the map's own x: {q:?}");
        close(Point3::from(in_base(&map, [3.0, 1.0, 0.5])), [3.0, 1.0, 0.5]);
    }

    #[test]
    fn panning_right_and_tilting_up_turn_as_rep_103_says() {
        let pan = PanTiltAngles { pan_rad: FRAC_PI_2, tilt_rad: 0.0 };
        close(body_from_body(&base_from_tilt(pan)) * Point3::new(1.0, 0.0, 0.0), [0.0, -1.0, 0.0]);
        let tilt = PanTiltAngles { pan_rad: 0.0, tilt_rad: FRAC_PI_2 };
        close(body_from_body(&base_from_tilt(tilt)) * Point3::new(1.0, 0.0, 0.0), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_beam_ends_at_the_same_place_by_both_ways() {
        let base: Transform<Vehicle, PanTiltBase> =
            Mounting { x_m: 1.0, y_m: 0.2, z_m: -2.0, yaw_deg: 5.0, pitch_deg: -3.0, ..Mounting::default() }
                .transform();
        let joint = base_from_tilt(PanTiltAngles { pan_rad: 0.3, tilt_rad: -0.4 });
        let ladar: Transform<Tilt, Ladar> =
            Mounting { z_m: -0.1, x_m: 0.05, roll_deg: 2.0, ..Mounting::default() }.transform();
        let attitude = Attitude { roll_rad: 0.1, pitch_rad: -0.05, yaw_rad: 2.0 };
        let global = global_from_vehicle(attitude, Point::new(100.0, 200.0, 50.0));
        let device_rad = 0.7;
        let end =
            global * (base * joint * ladar) * (Point::new(0.0, 0.0, 0.0) + beam_direction(device_rad).scaled(9.0));
        // What a ROS listener does: the LaserScan's angle in the ladar's frame, then tf up to the map.
        let angle = device_rad - FRAC_PI_2;
        let chain = map_from_base(&global, [90.0, 180.0, 40.0])
            * body_from_body(&base)
            * body_from_body(&joint)
            * body_from_body(&ladar);
        let ros = chain * Point3::new(9.0 * angle.cos(), 9.0 * angle.sin(), 0.0);
        close(ros, [end.x() - 90.0, end.y() - 180.0, end.z() - 40.0]);
    }
}
