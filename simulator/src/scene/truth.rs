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

/// A rock as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueRock {
    /// UTM easting of its middle, metres.
    pub easting_m: f64,
    /// UTM northing of its middle, metres.
    pub northing_m: f64,
    /// How far it reaches across at the ground, metres.
    pub reach_m: f64,
    /// Height of its top above the ground at its middle, metres.
    pub height_m: f64,
}

/// A straight wall as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueWall {
    /// UTM easting and northing of its two ends, metres.
    pub ends_m: [[f64; 2]; 2],
    /// Thickness, metres.
    pub width_m: f64,
    /// Height of its top above the ground at its middle, metres.
    pub height_m: f64,
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

    /// All rocks.
    pub fn true_rocks(&self) -> Vec<TrueRock> {
        let rock = |rock: &super::Rock| {
            let (center, radii_m) = (rock.body.center, rock.body.radii_m);
            let up_m = self.terrain.ground_m(center.x, center.y) - center.z;
            let share = (1.0 - (up_m / radii_m.z).powi(2)).max(0.0).sqrt();
            TrueRock {
                easting_m: center.x + ORIGIN_M[0],
                northing_m: center.y + ORIGIN_M[1],
                reach_m: 2.0 * share * radii_m.x.max(radii_m.y),
                height_m: radii_m.z - up_m,
            }
        };
        self.rocks.iter().map(rock).collect()
    }

    /// All walls.
    pub fn true_walls(&self) -> Vec<TrueWall> {
        let wall = |wall: &super::Wall| {
            let (center, half_m) = (wall.body.center, wall.body.half_m);
            let (sin, cos) = wall.body.along_rad.sin_cos();
            let end = |along: f64| [center.x + along * cos + ORIGIN_M[0], center.y + along * sin + ORIGIN_M[1]];
            TrueWall {
                ends_m: [end(-half_m.x), end(half_m.x)],
                width_m: 2.0 * half_m.y,
                height_m: center.z + half_m.z - self.terrain.ground_m(center.x, center.y),
            }
        };
        self.walls.iter().map(wall).collect()
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
    fn rocks_and_walls_stand_where_the_scene_is_covered() {
        let rocks = Scene::new(SceneName::Rocks, 1);
        let high: Vec<TrueRock> = rocks.true_rocks().into_iter().filter(|rock| rock.height_m > 0.1).collect();
        assert!(high.len() > 100, "{}", high.len());
        for rock in &high {
            // Another rock may stand higher in the same place.
            let there_m = rocks.rock_at_m(rock.easting_m, rock.northing_m);
            assert!(there_m >= rock.height_m - 1e-9 && rock.reach_m > 0.1, "{there_m} {rock:?}");
        }
        let scene = Scene::new(SceneName::Wall, 1);
        let wall = scene.true_walls()[0];
        let at = |share: f64| [0, 1].map(|i| wall.ends_m[0][i] + share * (wall.ends_m[1][i] - wall.ends_m[0][i]));
        assert!([0.01, 0.5, 0.99].iter().all(|share| scene.is_wall(at(*share)[0], at(*share)[1])));
        assert!(!scene.is_wall(at(1.01)[0], at(1.01)[1]) && (wall.height_m - 3.5).abs() < 0.1, "{wall:?}");
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
