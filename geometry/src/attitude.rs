//! Attitude and mounting: angles in, typed transforms out. Thesis (2-7) to (2-10).
//!
//! Angles are radians inside, degrees only in [`Mounting`], which people write in configuration files.

use crate::frame::{Global, Ladar, PanTiltBase, Point, Tilt, Transform, Vehicle};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// Roll, pitch and yaw of the vehicle, radians: yaw about z (0 = grid north, clockwise positive), then pitch
/// about the new y (nose up positive), then roll about the new x (right side down positive).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attitude {
    /// phi, radians.
    pub roll_rad: f64,
    /// theta, radians.
    pub pitch_rad: f64,
    /// psi, radians from grid north.
    pub yaw_rad: f64,
}

/// Takes x north, y east, z down to x east, y north, z up: the constant matrix of thesis (2-7).
fn global_from_north_east_down() -> UnitQuaternion<f64> {
    let swap = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(swap))
}

/// Thesis (2-7) and (2-8): the vehicle's pose from its attitude and UTM position.
pub fn global_from_vehicle(attitude: Attitude, position: Point<Global>) -> Transform<Global, Vehicle> {
    let Attitude { roll_rad, pitch_rad, yaw_rad } = attitude;
    // nalgebra's `from_euler_angles` is Rz(yaw) * Ry(pitch) * Rx(roll).
    let turn = UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad);
    Transform::new(global_from_north_east_down() * turn, position)
}

/// The attitude that [`global_from_vehicle`] would turn into this pose. Yaw in (-pi, pi].
pub fn attitude_of(pose: &Transform<Global, Vehicle>) -> Attitude {
    let turn = global_from_north_east_down().inverse() * pose.isometry.rotation;
    let (roll_rad, pitch_rad, yaw_rad) = turn.euler_angles();
    Attitude { roll_rad, pitch_rad, yaw_rad }
}

/// Joint angles of the pan-tilt unit, radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PanTiltAngles {
    /// theta1: about the base's z (down), positive to the right.
    pub pan_rad: f64,
    /// theta2: about the panned y (right), positive up.
    pub tilt_rad: f64,
}

/// Thesis (2-9): `T_L^V = T_base^V * Rz(theta1) * Ry(theta2) * T_L^tilt`.
pub fn vehicle_from_ladar(
    vehicle_from_base: Transform<Vehicle, PanTiltBase>,
    joint: PanTiltAngles,
    tilt_from_ladar: Transform<Tilt, Ladar>,
) -> Transform<Vehicle, Ladar> {
    vehicle_from_base * base_from_tilt(joint) * tilt_from_ladar
}

/// `Rz(theta1) * Ry(theta2)`: two intersecting perpendicular axes.
pub fn base_from_tilt(joint: PanTiltAngles) -> Transform<PanTiltBase, Tilt> {
    let turn = UnitQuaternion::from_euler_angles(0.0, joint.tilt_rad, joint.pan_rad);
    Transform::new(turn, Point::new(0.0, 0.0, 0.0))
}

/// A constant transform as a person measures it: where the child's origin sits in the parent, and how it is
/// turned (yaw, then pitch, then roll, as for the vehicle).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Mounting {
    /// Along the parent's x (forward), metres.
    pub x_m: f64,
    /// Along the parent's y (right), metres.
    pub y_m: f64,
    /// Along the parent's z (down: above the parent's origin is negative), metres.
    pub z_m: f64,
    /// About x, right side down positive, degrees.
    pub roll_deg: f64,
    /// About y, nose up positive, degrees.
    pub pitch_deg: f64,
    /// About z, to the right positive, degrees.
    pub yaw_deg: f64,
}

impl Mounting {
    /// The transform from the mounted part's frame to its parent's.
    pub fn transform<To, From>(&self) -> Transform<To, From> {
        let turn = UnitQuaternion::from_euler_angles(
            self.roll_deg.to_radians(),
            self.pitch_deg.to_radians(),
            self.yaw_deg.to_radians(),
        );
        Transform::new(turn, Point::new(self.x_m, self.y_m, self.z_m))
    }
}

/// Unit direction of a ladar beam in the [`Ladar`] frame, from the device's own angle: radians counter-clockwise
/// seen from the top cap, 0 to the right, 90 degrees straight ahead.
pub fn beam_direction(angle_rad: f64) -> crate::frame::Vector<Ladar> {
    crate::frame::Vector::new(angle_rad.sin(), angle_rad.cos(), 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use std::f64::consts::FRAC_PI_2;

    fn close(p: Point<Global>, x: f64, y: f64, z: f64) {
        assert!((p.xyz - Point3::new(x, y, z)).norm() < 1e-9, "{:?}", p.xyz);
    }

    #[test]
    fn yaw_zero_faces_north_and_yaw_90_faces_east() {
        let at = Point::new(500.0, 1000.0, 10.0);
        let north = global_from_vehicle(Attitude::default(), at);
        close(north * Point::new(2.0, 0.0, 0.0), 500.0, 1002.0, 10.0);
        close(north * Point::new(0.0, 2.0, 0.0), 502.0, 1000.0, 10.0);
        close(north * Point::new(0.0, 0.0, 2.0), 500.0, 1000.0, 8.0);
        let east = global_from_vehicle(Attitude { yaw_rad: FRAC_PI_2, ..Default::default() }, at);
        close(east * Point::new(2.0, 0.0, 0.0), 502.0, 1000.0, 10.0);
    }

    #[test]
    fn pitch_up_raises_the_nose_and_roll_right_lowers_the_right_side() {
        let at = Point::new(0.0, 0.0, 0.0);
        let nose_up = Attitude { pitch_rad: 0.1, ..Default::default() };
        assert!((global_from_vehicle(nose_up, at) * Point::new(1.0, 0.0, 0.0)).z() > 0.09);
        let right_down = Attitude { roll_rad: 0.1, ..Default::default() };
        assert!((global_from_vehicle(right_down, at) * Point::new(0.0, 1.0, 0.0)).z() < -0.09);
    }

    #[test]
    fn attitude_survives_the_round_trip() {
        let there = Attitude { roll_rad: 0.2, pitch_rad: -0.3, yaw_rad: 2.5 };
        let back = attitude_of(&global_from_vehicle(there, Point::new(1.0, 2.0, 3.0)));
        assert!((back.roll_rad - 0.2).abs() < 1e-12);
        assert!((back.pitch_rad + 0.3).abs() < 1e-12);
        assert!((back.yaw_rad - 2.5).abs() < 1e-12);
    }

    #[test]
    fn a_tilted_head_looks_up_and_a_panned_one_to_the_right() {
        let look =
            |pan_rad, tilt_rad| base_from_tilt(PanTiltAngles { pan_rad, tilt_rad }) * Point::<Tilt>::new(1.0, 0.0, 0.0);
        assert!(look(0.0, 0.5).z() < -0.4, "z is down, so up is negative");
        assert!(look(0.5, 0.0).y() > 0.4);
    }

    #[test]
    fn the_beam_at_90_degrees_points_ahead_and_at_0_to_the_right() {
        assert!((beam_direction(FRAC_PI_2).xyz.x - 1.0).abs() < 1e-12);
        assert!((beam_direction(0.0).xyz.y - 1.0).abs() < 1e-12);
        assert!((beam_direction(std::f64::consts::PI).xyz.y + 1.0).abs() < 1e-12);
    }
}
