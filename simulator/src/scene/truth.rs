//! What is really there, in UTM: ground, trees, brush, drops. Scoring compares reports with it.
//!
//! The ground is the soil: under a rock or a wall it goes on as if nothing stood there, so scores leave those
//! places out ([`Scene::is_covered`]). Brush is grass and bushes; crowns are not brush.

use super::{HALF_EXTENT_M, ORIGIN_M, Scene};
use serde::{Deserialize, Serialize};

/// A tree as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueTree {
    /// UTM easting of the axis at 1.3 m above ground, metres.
    pub easting_m: f64,
    /// UTM northing of the axis at 1.3 m above ground, metres.
    pub northing_m: f64,
    /// Ground height at its base, metres above the ellipsoid.
    pub ground_m: f64,
    /// Diameter at 1.3 m above ground, metres.
    pub dbh_m: f64,
    /// Height above ground, metres.
    pub height_m: f64,
    /// Lean of the axis from vertical towards east and north, radians.
    pub lean_rad: [f64; 2],
}

/// A ditch as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueDrop {
    /// UTM easting and northing of its two ends on the centre line, metres.
    pub ends_m: [[f64; 2]; 2],
    /// Width at the top, metres.
    pub width_m: f64,
    /// Depth, metres.
    pub depth_m: f64,
}

impl Scene {
    /// Height of the ground, metres above the ellipsoid; nothing outside of the scene.
    pub fn ground_at_m(&self, easting_m: f64, northing_m: f64) -> Option<f64> {
        let (x, y) = (easting_m - ORIGIN_M[0], northing_m - ORIGIN_M[1]);
        let inside = x.abs() < HALF_EXTENT_M && y.abs() < HALF_EXTENT_M;
        inside.then(|| self.terrain.ground_m(x, y) + ORIGIN_M[2])
    }

    /// True where a rock or a wall stands on the ground.
    pub fn is_covered(&self, easting_m: f64, northing_m: f64) -> bool {
        let (x, y) = (easting_m - ORIGIN_M[0], northing_m - ORIGIN_M[1]);
        let ground = self.terrain.ground_m(x, y);
        self.rocks.iter().any(|r| r.body.top_m(x, y).is_some_and(|top| top > ground))
            || self.walls.iter().any(|w| w.body.covers(x, y))
    }

    /// Height of grass or bushes above the ground, metres; 0 where none.
    pub fn brush_at_m(&self, easting_m: f64, northing_m: f64) -> f64 {
        let (x, y) = (easting_m - ORIGIN_M[0], northing_m - ORIGIN_M[1]);
        let ground = self.terrain.ground_m(x, y);
        let bushes = self.bushes.iter().filter_map(|b| b.body.top_m(x, y)).map(|top| top - ground);
        bushes.fold(self.terrain.grass_m(x, y), f64::max)
    }

    /// Depth of the ditch below the ground beside it, metres; 0 outside.
    pub fn drop_at_m(&self, easting_m: f64, northing_m: f64) -> f64 {
        self.ditch.map_or(0.0, |d| d.depth_at_m(easting_m - ORIGIN_M[0], northing_m - ORIGIN_M[1]))
    }

    /// All trees.
    pub fn true_trees(&self) -> Vec<TrueTree> {
        let tree = |t: &super::Tree| TrueTree {
            easting_m: t.breast_m[0] + ORIGIN_M[0],
            northing_m: t.breast_m[1] + ORIGIN_M[1],
            ground_m: t.ground_m + ORIGIN_M[2],
            dbh_m: t.dbh_m,
            height_m: t.height_m,
            lean_rad: [(t.trunk.axis.x / t.trunk.axis.z).atan(), (t.trunk.axis.y / t.trunk.axis.z).atan()],
        };
        self.trees.iter().map(tree).collect()
    }

    /// All ditches.
    pub fn true_drops(&self) -> Vec<TrueDrop> {
        let drop = |d: super::Ditch| {
            let (sin, cos) = d.along_rad.sin_cos();
            let end = |along: f64| [d.at_m[0] + along * cos + ORIGIN_M[0], d.at_m[1] + along * sin + ORIGIN_M[1]];
            let ends_m = [end(-d.half_length_m), end(d.half_length_m)];
            TrueDrop { ends_m, width_m: d.width_m, depth_m: d.depth_m }
        };
        self.ditch.map(drop).into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Scene, SceneName};
    use super::*;

    #[test]
    fn truth_is_in_utm_and_ends_with_the_scene() {
        let scene = Scene::new(SceneName::Flat, 1);
        let ground = scene.ground_at_m(ORIGIN_M[0] + 3.0, ORIGIN_M[1] - 4.0).unwrap();
        assert!((ground - ORIGIN_M[2]).abs() < 0.05);
        assert_eq!(scene.ground_at_m(ORIGIN_M[0] + HALF_EXTENT_M + 1.0, ORIGIN_M[1]), None);
        assert!(scene.true_trees().iter().all(|t| (t.easting_m - ORIGIN_M[0]).abs() < 63.0));
    }

    #[test]
    fn the_same_seed_grows_the_same_scene_and_another_seed_another() {
        let trees = |seed| Scene::new(SceneName::Forest, seed).true_trees();
        assert_eq!(trees(7), trees(7));
        assert_ne!(trees(7), trees(8));
    }

    #[test]
    fn brush_is_as_high_as_the_highest_bush_or_grass() {
        let scene = Scene::new(SceneName::Forest, 3);
        let bush = scene.bushes.iter().max_by(|a, b| a.body.radii_m.z.total_cmp(&b.body.radii_m.z)).unwrap();
        let [x, y] = [bush.body.center.x, bush.body.center.y];
        let height = scene.brush_at_m(x + ORIGIN_M[0], y + ORIGIN_M[1]);
        let own = bush.body.center.z + bush.body.radii_m.z - scene.terrain.ground_m(x, y);
        assert!(height >= own - 1e-9 && height < own + 1.0, "{height} {own}");
    }

    #[test]
    fn the_ditch_is_a_drop_where_the_ground_says_so() {
        let scene = Scene::new(SceneName::Ditch, 1);
        let drop = scene.true_drops()[0];
        let middle = [0, 1].map(|i| (drop.ends_m[0][i] + drop.ends_m[1][i]) / 2.0);
        assert!((scene.drop_at_m(middle[0], middle[1]) - drop.depth_m).abs() < 1e-9);
        assert!(scene.ground_at_m(middle[0], middle[1]).unwrap() < ORIGIN_M[2] - 0.8);
    }
}
