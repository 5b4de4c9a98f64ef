//! The plane that the vehicle stands on: ground where no beam reaches. Thesis (2-11) to (2-15).
//!
//! In: the vehicle's pose and the height of its origin above the ground. Out: the ground's height at any place near
//! it, metres above the ellipsoid. It does not know where the wheels are, nor how uneven the ground between them is.

use nalgebra::Vector3;
use tsense_geometry::{Global, Point, Transform, Vector, Vehicle};

/// A plane r . S + D0 = 0 in the global frame, thesis (2-11).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehiclePlane {
    s: Vector3<f64>,
    d0: f64,
    /// The point on the ground below the vehicle's origin.
    pub below: Point<Global>,
}

impl VehiclePlane {
    /// The plane below a vehicle whose origin is `origin_height_m` above the ground, or nothing where the vehicle
    /// lies on its side and the plane has no height.
    pub fn below(vehicle: &Transform<Global, Vehicle>, origin_height_m: f64) -> Option<Self> {
        // Thesis (2-12), (2-13)
        let s = (*vehicle * Vector::<Vehicle>::new(0.0, 0.0, -1.0)).xyz;
        let below = *vehicle * Point::<Vehicle>::new(0.0, 0.0, origin_height_m);
        // Thesis (2-14)
        let d0 = -below.xyz.coords.dot(&s);
        // A vehicle tilted by 60 degrees is no longer driving.
        (s.z >= 0.5).then_some(Self { s, d0, below })
    }

    /// Thesis (2-15): the ground's height at an easting and northing.
    pub fn height_m(&self, easting_m: f64, northing_m: f64) -> f64 {
        -(self.d0 + self.s.x * easting_m + self.s.y * northing_m) / self.s.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::{Attitude, global_from_vehicle};

    #[test]
    fn a_level_vehicle_stands_on_a_level_plane_below_its_origin() {
        let pose = global_from_vehicle(Attitude::default(), Point::new(369_000.0, 3_279_000.0, 41.0));
        let plane = VehiclePlane::below(&pose, 0.8).unwrap();
        assert!((plane.height_m(369_003.0, 3_278_998.0) - 40.2).abs() < 1e-6);
    }

    #[test]
    fn nose_up_to_the_east_means_ground_that_rises_to_the_east() {
        let attitude = Attitude { yaw_rad: 90f64.to_radians(), pitch_rad: 0.1, roll_rad: 0.0 };
        let plane = VehiclePlane::below(&global_from_vehicle(attitude, Point::new(100.0, 200.0, 10.0)), 0.0).unwrap();
        assert!((plane.height_m(101.0, 200.0) - (10.0 + 0.1f64.tan())).abs() < 1e-9);
        assert!((plane.height_m(100.0, 205.0) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn a_vehicle_on_its_side_has_no_plane() {
        let attitude = Attitude { roll_rad: 1.5, ..Attitude::default() };
        assert!(VehiclePlane::below(&global_from_vehicle(attitude, Point::new(0.0, 0.0, 0.0)), 0.0).is_none());
    }
}
