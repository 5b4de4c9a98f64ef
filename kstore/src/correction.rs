//! What is added to the vehicle's pose so that it stands where the stored trees say: a small rigid move in the plane.
//!
//! In and out: easting and northing, metres; turns in radians, counter-clockwise seen from above, about the vehicle.

/// A turn about the vehicle, then an offset.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Correction {
    /// Easting, northing, metres.
    pub offset_m: [f64; 2],
    /// Counter-clockwise seen from above, radians.
    pub turn_rad: f64,
}

impl Correction {
    /// Where a place that was seen from `vehicle_m` belongs.
    pub fn apply(&self, vehicle_m: [f64; 2], place_m: [f64; 2]) -> [f64; 2] {
        let from_vehicle = turned(minus(place_m, vehicle_m), self.turn_rad);
        plus(self.vehicle(vehicle_m), from_vehicle)
    }

    /// Where the uncorrected pose at `vehicle_m` would have it.
    pub fn undo(&self, vehicle_m: [f64; 2], place_m: [f64; 2]) -> [f64; 2] {
        plus(vehicle_m, turned(minus(place_m, self.vehicle(vehicle_m)), -self.turn_rad))
    }

    /// Where the vehicle is.
    pub fn vehicle(&self, vehicle_m: [f64; 2]) -> [f64; 2] {
        plus(vehicle_m, self.offset_m)
    }

    /// This correction and, of what it gives, a further one.
    pub fn then(&self, next: &Self) -> Self {
        Self { offset_m: plus(self.offset_m, next.offset_m), turn_rad: self.turn_rad + next.turn_rad }
    }

    /// A share of it.
    pub fn share(&self, share: f64) -> Self {
        Self { offset_m: self.offset_m.map(|x| x * share), turn_rad: self.turn_rad * share }
    }

    /// Length of the offset, metres.
    pub fn length_m(&self) -> f64 {
        self.offset_m[0].hypot(self.offset_m[1])
    }
}

/// Horizontal distance, metres.
pub fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Difference of two places.
pub fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// A place moved.
pub fn plus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

/// A vector turned counter-clockwise.
pub fn turned([east, north]: [f64; 2], by_rad: f64) -> [f64; 2] {
    let (sin, cos) = by_rad.sin_cos();
    [east * cos - north * sin, east * sin + north * cos]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_the_vehicle_and_an_offset() {
        let quarter = Correction { offset_m: [1.0, 0.0], turn_rad: std::f64::consts::FRAC_PI_2 };
        let [east, north] = quarter.apply([10.0, 10.0], [12.0, 10.0]);
        assert!((east - 11.0).abs() < 1e-12 && (north - 12.0).abs() < 1e-12);
        let back = quarter.undo([10.0, 10.0], [east, north]);
        assert!((back[0] - 12.0).abs() < 1e-12 && (back[1] - 10.0).abs() < 1e-12);
    }

    /// Two corrections one after the other, the second about the corrected vehicle.
    #[test]
    fn corrections_add_up() {
        let (a, b) =
            (Correction { offset_m: [1.0, 2.0], turn_rad: 0.1 }, Correction { offset_m: [-0.5, 0.3], turn_rad: -0.04 });
        let (vehicle, place) = ([5.0, 6.0], [9.0, -2.0]);
        let twice = b.apply(a.vehicle(vehicle), a.apply(vehicle, place));
        let once = a.then(&b).apply(vehicle, place);
        assert!((twice[0] - once[0]).abs() < 1e-12 && (twice[1] - once[1]).abs() < 1e-12);
    }
}
