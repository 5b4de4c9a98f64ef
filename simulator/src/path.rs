//! Ways through a scene: an oval that can be driven for ever, and a gently winding line of 40 m.
//!
//! In: metres driven. Out: a place in the scene and the direction of travel. Scenes keep both ways clear.

use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Half axes of the oval along east and north, metres: the tightest bend has a radius of 3.6 m.
const OVAL_M: [f64; 2] = [10.0, 6.0];
/// Half the east-west extent of the line, metres.
const LINE_HALF_M: f64 = 20.0;
/// How far the line winds to either side, metres.
const LINE_SWAY_M: f64 = 1.5;
/// Samples of the length table; 2048 of them put a chord within 20 micrometres of its arc.
const SAMPLES: usize = 2048;

/// Which way the vehicle takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Way {
    /// A closed oval of 51 m around the scene's centre, driven counter-clockwise from its eastern end, facing north.
    #[default]
    Oval,
    /// A line of about 40 m from west to east through the scene's centre.
    Line,
}

/// A place on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// East of the scene's origin, metres.
    pub x_m: f64,
    /// North of the scene's origin, metres.
    pub y_m: f64,
    /// Direction of travel, radians clockwise from grid north.
    pub yaw_rad: f64,
}

/// A way with its lengths.
#[derive(Clone, Debug)]
pub struct Path {
    way: Way,
    /// Metres driven at parameter `i / SAMPLES`.
    length_m: Vec<f64>,
}

impl Way {
    /// The place at parameter `t` in [0, 1].
    fn at(self, t: f64) -> Place {
        let (x_m, y_m, east, north) = match self {
            Self::Oval => {
                let (sin, cos) = (TAU * t).sin_cos();
                (OVAL_M[0] * cos, OVAL_M[1] * sin, -OVAL_M[0] * sin, OVAL_M[1] * cos)
            }
            Self::Line => {
                let (sin, cos) = (TAU * t).sin_cos();
                let east = 2.0 * LINE_HALF_M;
                (east * (t - 0.5), LINE_SWAY_M * sin, east, LINE_SWAY_M * TAU * cos)
            }
        };
        Place { x_m, y_m, yaw_rad: east.atan2(north) }
    }
}

impl Path {
    /// The path of a way.
    pub fn new(way: Way) -> Self {
        let mut length_m = vec![0.0];
        let mut last = way.at(0.0);
        for i in 1..=SAMPLES {
            let next = way.at(i as f64 / SAMPLES as f64);
            length_m.push(length_m[i - 1] + (next.x_m - last.x_m).hypot(next.y_m - last.y_m));
            last = next;
        }
        Self { way, length_m }
    }

    /// Its whole length, metres.
    pub fn length_m(&self) -> f64 {
        self.length_m[SAMPLES]
    }

    /// The place after a distance: round and round on the oval, to the end and no farther on the line.
    pub fn at(&self, driven_m: f64) -> Place {
        let driven_m = match self.way {
            Way::Oval => driven_m.rem_euclid(self.length_m()),
            Way::Line => driven_m.clamp(0.0, self.length_m()),
        };
        let later = self.length_m.partition_point(|l| *l <= driven_m).clamp(1, SAMPLES);
        let (a, b) = (self.length_m[later - 1], self.length_m[later]);
        self.way.at((later as f64 - 1.0 + (driven_m - a) / (b - a)) / SAMPLES as f64)
    }

    /// Places along it, one every `step_m`.
    pub fn places(&self, step_m: f64) -> Vec<Place> {
        (0..=(self.length_m() / step_m) as usize).map(|i| self.at(i as f64 * step_m)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oval_starts_at_its_eastern_end_facing_north_and_comes_back() {
        let path = Path::new(Way::Oval);
        let start = path.at(0.0);
        assert!((start.x_m - 10.0).abs() < 1e-9 && start.y_m.abs() < 1e-9 && start.yaw_rad.abs() < 1e-9);
        let again = path.at(path.length_m());
        assert!((again.x_m - 10.0).abs() < 1e-6 && again.y_m.abs() < 1e-6);
        // Ramanujan's approximation of the circumference of an ellipse with half axes 10 and 6.
        assert!((path.length_m() - 51.054).abs() < 0.01, "{}", path.length_m());
    }

    #[test]
    fn a_metre_along_the_path_is_a_metre_on_the_ground_and_yaw_is_its_direction() {
        for way in [Way::Oval, Way::Line] {
            let path = Path::new(way);
            for i in 0..80 {
                let (a, b) = (path.at(0.5 * i as f64), path.at(0.5 * i as f64 + 0.01));
                let (east, north) = (b.x_m - a.x_m, b.y_m - a.y_m);
                if east.hypot(north) > 0.0 {
                    assert!((east.hypot(north) - 0.01).abs() < 1e-4, "{way:?} {i}");
                    assert!((east.atan2(north) - a.yaw_rad).sin().abs() < 0.01, "{way:?} {i}");
                }
            }
        }
    }
}
