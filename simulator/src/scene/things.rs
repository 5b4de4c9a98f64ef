//! The things of a scene: trees, bushes, rocks, walls and a person, with the truth about each.
//!
//! Metres in the scene's own frame: x east, y north, z up from the scene origin.

use super::shapes::{Cone, Ellipsoid, Meeting, Ray, Slab};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Breast height: where the diameter of a trunk is measured, metres above the ground at its base.
pub const BREAST_HEIGHT_M: f64 = 1.3;

/// A body of leaves and twigs: a beam that runs a metre inside passes with probability `exp(-density)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Porous {
    /// Its outline.
    pub body: Ellipsoid,
    /// Expected meetings per metre inside.
    pub density_per_m: f64,
    /// Share of the light that comes back from what is met, 0 to 1.
    pub reflectance: f64,
}

/// A tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tree {
    /// The trunk: starts below ground, tapers, may lean.
    pub trunk: Cone,
    /// The crown.
    pub crown: Porous,
    /// East, north of the axis at breast height, metres.
    pub breast_m: [f64; 2],
    /// Ground height at the base, metres above the scene origin.
    pub ground_m: f64,
    /// Diameter at breast height, metres.
    pub dbh_m: f64,
    /// Height above ground, metres.
    pub height_m: f64,
    /// Share of the light that comes back from the bark, 0 to 1.
    pub reflectance: f64,
}

/// How a tree is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeSpec {
    /// East, north of the base, metres.
    pub base_m: [f64; 2],
    /// Ground height there, metres.
    pub ground_m: f64,
    /// Diameter at breast height, metres.
    pub dbh_m: f64,
    /// Height, metres.
    pub height_m: f64,
    /// Lean from the vertical towards east and north, metres per metre.
    pub lean: [f64; 2],
    /// Where the crown begins, metres above ground.
    pub crown_base_m: f64,
    /// Half width of the crown, metres.
    pub crown_radius_m: f64,
    /// Share of the light that comes back from the bark, 0 to 1.
    pub reflectance: f64,
}

/// How deep a trunk reaches into the ground, metres: its foot must not hang in the air on a slope.
const ROOT_M: f64 = 0.4;
/// Radius at the top of a trunk as a share of its radius at breast height.
const TOP_RADIUS_SHARE: f64 = 0.25;

impl Tree {
    /// A tree from its measures.
    pub fn new(spec: &TreeSpec) -> Self {
        let axis = Vector3::new(spec.lean[0], spec.lean[1], 1.0).normalize();
        let foot = Vector3::new(spec.base_m[0], spec.base_m[1], spec.ground_m);
        let radius_m = spec.dbh_m / 2.0;
        let taper = -radius_m * (1.0 - TOP_RADIUS_SHARE) / (spec.height_m - BREAST_HEIGHT_M);
        // Along the axis the breast lies where its height above the foot is 1.3 m.
        let breast_along_m = BREAST_HEIGHT_M / axis.z;
        let breast = foot + axis * breast_along_m;
        let trunk = Cone {
            base: foot - axis * ROOT_M,
            axis,
            length_m: spec.height_m / axis.z * 0.95 + ROOT_M,
            radius_m: radius_m - taper * (breast_along_m + ROOT_M),
            taper,
        };
        let crown_half_m = (spec.height_m - spec.crown_base_m) / 2.0;
        let center = foot + axis * ((spec.height_m - crown_half_m) / axis.z);
        let radii_m = Vector3::new(spec.crown_radius_m, spec.crown_radius_m, crown_half_m);
        Self {
            trunk,
            crown: Porous { body: Ellipsoid { center, radii_m }, density_per_m: 0.45, reflectance: 0.45 },
            breast_m: [breast.x, breast.y],
            ground_m: spec.ground_m,
            dbh_m: spec.dbh_m,
            height_m: spec.height_m,
            reflectance: spec.reflectance,
        }
    }

    /// The axis at a height above the ground at the base, metres.
    pub fn axis_at(&self, height_m: f64) -> Vector3<f64> {
        self.trunk.base + self.trunk.axis * (ROOT_M + height_m / self.trunk.axis.z)
    }

    /// The trunk's radius at a height above the ground at the base, metres.
    pub fn radius_at_m(&self, height_m: f64) -> f64 {
        self.trunk.radius_m + self.trunk.taper * (ROOT_M + height_m / self.trunk.axis.z)
    }
}

/// A rock: an ellipsoid sunk into the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rock {
    /// Its outline.
    pub body: Ellipsoid,
    /// Share of the light that comes back, 0 to 1.
    pub reflectance: f64,
}

/// A wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Its outline.
    pub body: Slab,
    /// Share of the light that comes back, 0 to 1.
    pub reflectance: f64,
}

/// A person who walks to and fro between two places, or stands at the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Person {
    /// One end of the walk: east, north of the scene's origin, metres.
    pub from_m: [f64; 2],
    /// The other end, metres.
    pub to_m: [f64; 2],
    /// Speed of walking, metres per second; 0 stands at `from_m`.
    pub speed_m_s: f64,
    /// How long the person stands at each end before it walks on, seconds.
    #[serde(default)]
    pub stands_s: f64,
    /// Seconds of world time after the start at which the person is gone; nothing for never.
    pub leaves_at_s: Option<f64>,
}

/// Height of a person, metres.
pub const PERSON_HEIGHT_M: f64 = 1.75;
/// Half the width of a person, metres.
pub const PERSON_RADIUS_M: f64 = 0.24;

impl Person {
    /// To and fro, seven metres in front of where the vehicle starts.
    pub const WALKER: Self =
        Self { from_m: [6.0, 7.0], to_m: [14.0, 7.0], speed_m_s: 1.2, stands_s: 0.0, leaves_at_s: None };
    /// Standing six metres in front of where the vehicle starts.
    pub const STANDING: Self =
        Self { from_m: [10.0, 6.0], to_m: [10.0, 6.0], speed_m_s: 0.0, stands_s: 0.0, leaves_at_s: None };

    /// Where the person is, east and north, metres; nothing once gone.
    pub fn at_m(&self, world_s: f64) -> Option<[f64; 2]> {
        if self.leaves_at_s.is_some_and(|leaves| world_s >= leaves) {
            return None;
        }
        let [dx, dy] = [self.to_m[0] - self.from_m[0], self.to_m[1] - self.from_m[1]];
        let length_m = dx.hypot(dy);
        if self.speed_m_s <= 0.0 || length_m <= 0.0 {
            return Some(self.from_m);
        }
        // Stands, walks over, stands, walks back.
        let (walk_s, stands_s) = (length_m / self.speed_m_s, self.stands_s.max(0.0));
        let phase_s = world_s.max(0.0) % (2.0 * (walk_s + stands_s));
        let over = ((phase_s - stands_s) / walk_s).clamp(0.0, 1.0);
        let back = ((phase_s - 2.0 * stands_s - walk_s) / walk_s).clamp(0.0, 1.0);
        let share = over - back;
        Some([self.from_m[0] + dx * share, self.from_m[1] + dy * share])
    }
}

/// A person at an instant: legs and a body, each an upright cylinder, a head on top.
#[derive(Clone, Copy, Debug)]
pub struct Figure {
    legs: Cone,
    body: Cone,
    head: Ellipsoid,
}

impl Figure {
    /// The figure of a person whose feet are here.
    pub fn new(feet: Vector3<f64>) -> Self {
        let upright = |from_m: f64, to_m: f64, radius_m: f64| Cone {
            base: feet + Vector3::z() * from_m,
            axis: Vector3::z(),
            length_m: to_m - from_m,
            radius_m,
            taper: 0.0,
        };
        let head = Ellipsoid { center: feet + Vector3::z() * 1.62, radii_m: Vector3::new(0.11, 0.11, 0.13) };
        Self { legs: upright(0.0, 0.85, 0.15), body: upright(0.85, 1.5, PERSON_RADIUS_M), head }
    }

    /// False where a beam of this divergence cannot meet the figure: most beams, at the price of one product.
    pub fn near(&self, beam: &Ray, divergence_rad: f64) -> bool {
        let middle = self.legs.base + Vector3::z() * (PERSON_HEIGHT_M / 2.0) - beam.origin;
        let along = middle.dot(&beam.direction);
        let reach = PERSON_HEIGHT_M / 2.0 + PERSON_RADIUS_M + along * divergence_rad;
        along > -reach && middle.norm_squared() - along * along < reach * reach
    }

    /// Where a ray first meets the figure.
    pub fn meet(&self, ray: &Ray) -> Option<Meeting> {
        [self.legs.meet(ray), self.body.meet(ray), self.head.meet(ray)]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.range_m.total_cmp(&b.range_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaning() -> Tree {
        Tree::new(&TreeSpec {
            base_m: [3.0, 4.0],
            ground_m: 0.5,
            dbh_m: 0.3,
            height_m: 15.0,
            lean: [0.1, 0.0],
            crown_base_m: 7.0,
            crown_radius_m: 2.0,
            reflectance: 0.3,
        })
    }

    #[test]
    fn the_axis_at_breast_height_is_where_the_lean_carries_it() {
        let tree = leaning();
        assert!((tree.breast_m[0] - 3.13).abs() < 1e-9 && (tree.breast_m[1] - 4.0).abs() < 1e-9);
        assert!((tree.radius_at_m(BREAST_HEIGHT_M) - 0.15).abs() < 1e-9);
        assert!((tree.axis_at(BREAST_HEIGHT_M).z - 1.8).abs() < 1e-9);
        assert!(tree.radius_at_m(0.0) > 0.15 && tree.radius_at_m(10.0) < 0.15);
    }

    #[test]
    fn a_person_walks_to_and_fro_and_goes() {
        let (from_m, to_m) = ([0.0, 5.0], [4.0, 5.0]);
        let person = Person { from_m, to_m, speed_m_s: 1.0, stands_s: 0.0, leaves_at_s: Some(10.0) };
        assert_eq!(person.at_m(1.0), Some([1.0, 5.0]));
        assert_eq!(person.at_m(5.0), Some([3.0, 5.0]));
        assert_eq!(person.at_m(10.0), None);
        let rests = Person { stands_s: 2.0, leaves_at_s: None, ..person };
        let at = [1.0, 4.0, 7.0, 9.0, 12.5].map(|world_s| rests.at_m(world_s).unwrap()[0]);
        assert_eq!(at, [0.0, 2.0, 4.0, 3.0, 0.0], "stands, walks, stands, walks back, stands");
    }

    #[test]
    fn a_figure_is_met_at_the_body_before_the_legs() {
        let figure = Figure::new(Vector3::new(5.0, 0.0, 0.0));
        let meet = |z: f64| {
            figure.meet(&Ray { origin: Vector3::new(0.0, 0.0, z), direction: Vector3::x() }).map(|m| m.range_m)
        };
        assert!((meet(1.0).unwrap() - 4.76).abs() < 1e-9);
        assert!((meet(0.4).unwrap() - 4.85).abs() < 1e-9);
        assert_eq!(meet(1.8), None);
    }
}
