//! Scores what a planner must not drive over: ditches, rocks and walls found, and clear ground left free.
//!
//! In: reported cells. Out: shares. A hazard's cell counts as found when it or a cell beside it must not be driven; cells
//! of which nothing is known do not count, neither do those that stand for no decision: within a margin of a hazard, a
//! tree or brush. A drop is found for the right reason when its cell, or one beside it, is called a drop.

use crate::scene::{ORIGIN_M, Scene};
use crate::score::BRUSH_MIN_M;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Depth below the ground beside it from which a place in a ditch is a hazard, metres.
const DROP_MIN_M: f64 = 0.5;
/// Height above ground from which a place on a rock is a hazard, metres.
const ROCK_MIN_M: f64 = 0.3;
/// Within this distance of anything that stands or falls away, ground is not clear, metres.
const MARGIN_M: f64 = 0.6;
/// Clear ground rises less than this over a metre.
const CLEAR_SLOPE: f64 = 0.3;

/// A cell as the system reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HazardCell {
    /// Column and row, counted in cells from anywhere.
    pub cell: [i32; 2],
    /// Easting, northing of its centre, metres.
    pub at_m: [f64; 2],
    /// Whether anything is known of it.
    pub is_known: bool,
    /// Whether it must not be driven.
    pub is_lethal: bool,
    /// Whether it is called a drop.
    pub is_drop: bool,
}

/// A share of cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Cells that count.
    pub cells: usize,
    /// Share of them of which it is true; nothing where none counts.
    pub share: Option<f64>,
}

/// How well hazards were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HazardScore {
    /// Cells in ditches that must not be driven.
    pub drops: Share,
    /// Cells in ditches that are called a drop.
    pub drops_by_name: Share,
    /// Cells on rocks that must not be driven.
    pub rocks: Share,
    /// Cells on walls that must not be driven.
    pub walls: Share,
    /// Clear ground that must not be driven: false alarms.
    pub false_lethal: Share,
    /// Clear ground that is called a drop: false alarms.
    pub false_drops: Share,
}

#[derive(Default)]
struct Count {
    cells: usize,
    true_of: usize,
}

impl Count {
    fn add(&mut self, is_true: bool) {
        self.cells += 1;
        self.true_of += usize::from(is_true);
    }
    fn share(&self) -> Share {
        Share { cells: self.cells, share: (self.cells > 0).then(|| self.true_of as f64 / self.cells as f64) }
    }
}

/// Scores the cells against the scene.
pub fn score_hazards(scene: &Scene, cells: impl IntoIterator<Item = HazardCell>) -> HazardScore {
    let cells: BTreeMap<[i32; 2], HazardCell> = cells.into_iter().map(|cell| (cell.cell, cell)).collect();
    let beside = |[column, row]: [i32; 2], is: fn(&HazardCell) -> bool| {
        (-1..=1).any(|dy| (-1..=1).any(|dx| cells.get(&[column + dx, row + dy]).is_some_and(is)))
    };
    let [mut drops, mut named, mut rocks, mut walls, mut lethal, mut false_drops] =
        std::array::from_fn(|_| Count::default());
    for cell in cells.values().filter(|cell| cell.is_known) {
        let [easting, northing] = cell.at_m;
        let is_lethal = beside(cell.cell, |cell| cell.is_known && cell.is_lethal);
        if scene.drop_at_m(easting, northing) >= DROP_MIN_M {
            drops.add(is_lethal);
            named.add(beside(cell.cell, |cell| cell.is_drop));
        } else if scene.rock_at_m(easting, northing) >= ROCK_MIN_M {
            rocks.add(is_lethal);
        } else if scene.is_wall(easting, northing) {
            walls.add(is_lethal);
        } else if scene.is_clear(easting, northing) {
            lethal.add(cell.is_lethal);
            false_drops.add(cell.is_drop);
        }
    }
    HazardScore {
        drops: drops.share(),
        drops_by_name: named.share(),
        rocks: rocks.share(),
        walls: walls.share(),
        false_lethal: lethal.share(),
        false_drops: false_drops.share(),
    }
}

impl Scene {
    /// Height of a rock above the ground, metres; 0 where none.
    pub fn rock_at_m(&self, easting_m: f64, northing_m: f64) -> f64 {
        let (x, y) = (easting_m - ORIGIN_M[0], northing_m - ORIGIN_M[1]);
        let ground = self.terrain.ground_m(x, y);
        self.rocks.iter().filter_map(|rock| rock.body.top_m(x, y)).map(|top| top - ground).fold(0.0, f64::max)
    }

    /// Whether a wall stands there.
    pub fn is_wall(&self, easting_m: f64, northing_m: f64) -> bool {
        let (x, y) = (easting_m - ORIGIN_M[0], northing_m - ORIGIN_M[1]);
        self.walls.iter().any(|wall| wall.body.covers(x, y))
    }

    /// Whether gentle ground is all there is, a margin around included.
    fn is_clear(&self, easting_m: f64, northing_m: f64) -> bool {
        let (x, y) = (easting_m - ORIGIN_M[0], northing_m - ORIGIN_M[1]);
        let [rise_east, rise_north] = self.terrain.gradient(x, y);
        let by_tree =
            |tree: &crate::scene::Tree| (tree.breast_m[0] - x).hypot(tree.breast_m[1] - y) < MARGIN_M + tree.dbh_m;
        let around = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|k| k * MARGIN_M);
        let bare = |dx: f64, dy: f64| {
            let (e, n) = (easting_m + dx, northing_m + dy);
            self.drop_at_m(e, n) <= 0.0 && !self.is_covered(e, n) && self.brush_at_m(e, n) < BRUSH_MIN_M
        };
        rise_east.hypot(rise_north) < CLEAR_SLOPE
            && !self.trees.iter().any(by_tree)
            && around.iter().all(|dx| around.iter().all(|dy| bare(*dx, *dy)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SceneName;

    fn cells(scene: &Scene, lethal: impl Fn(f64, f64) -> bool) -> HazardScore {
        let cell = |i: i32| {
            let cell = [i % 120, i / 120];
            let at_m = [0, 1].map(|axis| ORIGIN_M[axis] - 4.0 + 0.15 * f64::from(cell[axis]));
            let is_lethal = lethal(at_m[0], at_m[1]);
            HazardCell { cell, at_m, is_known: i % 7 != 0, is_lethal, is_drop: is_lethal }
        };
        score_hazards(scene, (0..120 * 120).map(cell))
    }

    #[test]
    fn all_of_a_ditch_that_is_called_one_is_found_and_nothing_else_is_wrong() {
        let scene = Scene::new(SceneName::Ditch, 1);
        let score = cells(&scene, |e, n| scene.drop_at_m(e, n) > 0.4);
        assert_eq!(
            (score.drops.share, score.drops_by_name.share, score.false_lethal.share),
            (Some(1.0), Some(1.0), Some(0.0))
        );
        assert!(score.drops.cells > 300 && score.false_lethal.cells > 2000, "{score:?}");
        assert_eq!(score.rocks.share, None);
    }

    #[test]
    fn lethal_everywhere_finds_every_rock_and_spoils_all_clear_ground() {
        let score = cells(&Scene::new(SceneName::Rocks, 1), |_, _| true);
        assert_eq!((score.rocks.share, score.false_lethal.share), (Some(1.0), Some(1.0)));
        assert!(score.rocks.cells > 20, "{score:?}");
        let score = cells(&Scene::new(SceneName::Wall, 1), |_, _| false);
        assert_eq!((score.walls.share, score.false_lethal.share), (Some(0.0), Some(0.0)));
        assert!(score.walls.cells > 50, "{score:?}");
    }
}
