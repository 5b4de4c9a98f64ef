//! Negative obstacles: ground that falls away, seen from above or known by its absence.
//!
//! In: the view, its ground, what stands on it, and where the ladar is. Out: the cells that are a drop. Three kinds of
//! evidence: the ground was met deep below the ground around it; beams went below the surface that the ground raster
//! expects; and, behind an edge as seen from the ladar, no ground was met over a stretch that beams were aimed at and
//! passed over and that their spacing does not explain. Beyond an edge at range r, seen from height h, a stretch of L without ground means a
//! depth of at least h L / (r + L).
//! It judges only what is within the view; what is hidden behind brush or a trunk is unknown and no drop.

use crate::aimed::Aimed;
use crate::columns::View;
use crate::config::TraversabilityConfig;
use crate::density::Columns;
use crate::ground::Ground;
use crate::pits::pit_depths;
use crate::returns::Returns;
use tsense_contract::GroundEvidence;
use tsense_geometry::Raster;

/// Directions that are followed from the ladar: neighbouring ones are 0.13 m apart at 15 m.
const DIRECTIONS: usize = 720;
/// Levels above the expected ground between which something hides the ground behind it: brush, trunks, no crowns.
const HIDING_LEVELS: [usize; 2] = [2, 10];
/// Deviations of the ground's height by which a pit must be deeper than stated.
const PIT_SIGMAS: f32 = 1.0;
/// Levels above the expected ground in which free space shows that beams passed there: beams level with the ladar would
/// not have met it in any case.
const PASSING_LEVELS: usize = 5;

/// Places of a stretch that beams must have been aimed at.
const PLACES: usize = 3;

/// Where beams come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// Easting, northing, metres.
    pub at_m: [f64; 2],
    /// Height above the ground below it, metres.
    pub height_m: f64,
}

/// Cells that are a drop.
pub fn drops(
    view: &View,
    ground: &Ground,
    columns: &Columns,
    met_m: &Raster<f32>,
    (eye, returns): (Option<Eye>, Option<&Returns>),
    config: &TraversabilityConfig,
) -> Raster<bool> {
    let mut drops = seen_below(view, ground, config);
    add_pits(&mut drops, ground, config);
    if let Some((eye, cell)) = eye.and_then(|eye| Some((eye, view.shape.cell_at(eye.at_m[0], eye.at_m[1])?))) {
        let corner = view.shape.first_cell.map(|first| f64::from(first) * view.shape.cell_m);
        let corner_m = [corner[0], corner[1], view.base_m()];
        let mut aimed = returns.map(|returns| Aimed::new(returns, corner_m));
        for i in 0..DIRECTIONS {
            let angle = i as f64 / DIRECTIONS as f64 * std::f64::consts::TAU;
            let walk = Walk { view, ground, columns, met_m, eye_height_m: eye.height_m, config };
            walk.along(cell, [angle.cos(), angle.sin()], &mut drops, aimed.as_mut());
        }
    }
    drops
}

/// Cells in whose column beams went on below the expected ground.
fn seen_below(view: &View, ground: &Ground, config: &TraversabilityConfig) -> Raster<bool> {
    let mut drops = Raster::filled(view.shape, false);
    let cell_m = view.shape.cell_m;
    for (i, drop) in drops.cells_mut().iter_mut().enumerate() {
        let deep_m = f64::from(ground.height_m.cells()[i]) - config.drop_depth_m;
        // NaN is not above zero.
        if deep_m > 0.0 && ground.evidence.cells()[i] != GroundEvidence::Measured {
            *drop = view.free.count(i, 0, (deep_m / cell_m) as usize) >= 2;
        }
    }
    drops
}

/// Adds cells whose ground was met, or lies between where it was met, deep below what is around.
fn add_pits(drops: &mut Raster<bool>, ground: &Ground, config: &TraversabilityConfig) {
    let depths = pit_depths(&ground.height_m, config.drop_width_max_m);
    for (i, drop) in drops.cells_mut().iter_mut().enumerate() {
        let is_met = matches!(ground.evidence.cells()[i], GroundEvidence::Measured | GroundEvidence::Interpolated);
        let depth_m = depths.cells()[i] - PIT_SIGMAS * ground.std_m.cells()[i];
        *drop |= is_met && f64::from(depth_m) >= config.drop_depth_m;
    }
}

struct Walk<'a> {
    view: &'a View,
    ground: &'a Ground,
    columns: &'a Columns,
    met_m: &'a Raster<f32>,
    eye_height_m: f64,
    config: &'a TraversabilityConfig,
}

/// A stretch without ground behind an edge.
struct Stretch {
    edge_m: f64,
    cells: Vec<usize>,
    passed: usize,
}

impl Walk<'_> {
    /// Follows one direction outwards and marks the stretches that are drops.
    fn along(
        &self,
        from: (usize, usize),
        direction: [f64; 2],
        drops: &mut Raster<bool>,
        mut aimed: Option<&mut Aimed>,
    ) {
        let shape = self.view.shape;
        let mut stretch: Option<Stretch> = None;
        for step in 1..shape.width.max(shape.height) {
            let at = [from.0 as f64 + step as f64 * direction[0], from.1 as f64 + step as f64 * direction[1]];
            let (column, row) = (at[0].round(), at[1].round());
            if column < 0.0 || row < 0.0 || column >= shape.width as f64 || row >= shape.height as f64 {
                return;
            }
            let i = row as usize * shape.width + column as usize;
            let range_m = step as f64 * shape.cell_m;
            if self.met_m.cells()[i].is_finite() {
                if let Some(stretch) = stretch.filter(|stretch| self.is_drop(stretch, range_m, aimed.as_deref_mut())) {
                    stretch.cells.iter().for_each(|&i| drops.cells_mut()[i] = true);
                }
                stretch = Some(Stretch { edge_m: range_m, cells: Vec::new(), passed: 0 });
            } else if self.is_hiding(i) {
                stretch = None;
            } else if let Some(stretch) = &mut stretch {
                stretch.cells.push(i);
                stretch.passed += usize::from(self.beams_passed(i));
            }
        }
    }

    /// Whether something stands in a column that beams do not pass.
    fn is_hiding(&self, i: usize) -> bool {
        let [from, to] = HIDING_LEVELS.map(|level| self.columns.ground_level[i].max(0) as usize + level);
        self.view.occupied.count(i, from, to) > 0
    }

    /// Whether beams went through the space just above the ground expected in a column.
    fn beams_passed(&self, i: usize) -> bool {
        let level = self.columns.ground_level[i];
        level >= 0 && self.view.free.count(i, level as usize, level as usize + PASSING_LEVELS) > 0
    }

    fn is_drop(&self, stretch: &Stretch, end_m: f64, aimed: Option<&mut Aimed>) -> bool {
        let (config, length_m) = (self.config, end_m - stretch.edge_m);
        let spacing_m = stretch.edge_m * stretch.edge_m * config.beam_step_rad / self.eye_height_m;
        let depth_m = self.eye_height_m * length_m / end_m;
        length_m >= config.drop_gap_min_m.max(2.0 * spacing_m)
            && depth_m >= config.drop_depth_m
            && stretch.passed * 2 > stretch.cells.len()
            && aimed.is_none_or(|aimed| self.was_aimed_at(aimed, stretch))
    }

    /// Whether beams were aimed at the ground expected at most of a few places of a stretch, and went on behind: a stretch
    /// that the nod left out is no drop.
    fn was_aimed_at(&self, aimed: &mut Aimed, stretch: &Stretch) -> bool {
        let shape = self.view.shape;
        let count = stretch.cells.len();
        let mut went_on = |k: &usize| {
            let i = stretch.cells[(2 * k + 1) * count / (2 * PLACES)];
            let along = |c: usize| (c as f64 + 0.5) * shape.cell_m;
            let ground_m = f64::from(self.ground.height_m.cells()[i]);
            aimed.went_on_behind(i, [along(i % shape.width), along(i / shape.width), ground_m])
        };
        count > 0 && 2 * (0..PLACES).filter(&mut went_on).count() > PLACES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use crate::config::DensityConfig;
    use crate::density::columns_above_ground;
    use tsense_geometry::VoxelGrid;

    /// Flat ground at 1.5 m, seen everywhere.
    fn flat() -> Ground {
        let shape = View::unknown(Window { first: [0; 3], size: [100, 100, 40] }, VoxelGrid::new(0.15).unwrap()).shape;
        let height_m = Raster::filled(shape, 1.5f32);
        let evidence = height_m.map(|_| GroundEvidence::Measured);
        Ground { base_m: 0.0, std_m: height_m.map(|_| 0.02), height_m, evidence, measured_at_cells: vec![] }
    }

    fn met(ground: &Ground) -> Raster<f32> {
        let mut met_m = ground.height_m.clone();
        for (z, evidence) in met_m.cells_mut().iter_mut().zip(ground.evidence.cells()) {
            *z = if *evidence == GroundEvidence::Measured { *z } else { f32::NAN };
        }
        met_m
    }

    /// Flat ground at 1.5 m seen everywhere but in columns 50 to 64, over which beams pass; the ladar at column 30.
    fn ditch(change: impl Fn(&mut View, usize)) -> Raster<bool> {
        let mut view = View::unknown(Window { first: [0; 3], size: [100, 100, 40] }, VoxelGrid::new(0.15).unwrap());
        let mut ground = flat();
        for i in 0..10_000 {
            if (50..65).contains(&(i % 100)) {
                ground.evidence.cells_mut()[i] = GroundEvidence::Interpolated;
                view.free.insert(i, 14);
            }
            change(&mut view, i);
        }
        let columns = columns_above_ground(&view, &ground, &DensityConfig::default());
        drops(
            &view,
            &ground,
            &columns,
            &met(&ground),
            (Some(Eye { at_m: [4.575, 7.5], height_m: 1.6 }), None),
            &TraversabilityConfig::default(),
        )
    }

    #[test]
    fn a_ditch_that_beams_pass_over_without_meeting_ground_is_a_drop() {
        let drops = ditch(|_, _| {});
        assert!(drops[(57, 50)] && drops[(50, 50)] && drops[(64, 45)]);
        assert!(!drops[(45, 50)] && !drops[(70, 50)]);
    }

    #[test]
    fn a_trench_that_was_seen_to_its_bottom_is_a_drop_and_a_furrow_is_none() {
        let mut ground = flat();
        for i in (0..10_000).filter(|i| (50..58).contains(&(i % 100))) {
            ground.height_m.cells_mut()[i] = 0.9;
        }
        for i in (0..10_000).filter(|i| (80..88).contains(&(i % 100))) {
            ground.height_m.cells_mut()[i] = 1.2;
        }
        let mut drops = ground.height_m.map(|_| false);
        add_pits(&mut drops, &ground, &TraversabilityConfig::default());
        assert!(drops[(54, 50)] && !drops[(45, 50)] && !drops[(84, 50)]);
    }

    #[test]
    fn a_gap_behind_brush_is_unknown_and_no_drop() {
        let drops = ditch(|view, i| {
            if i % 100 == 50 {
                (10..16).for_each(|level| view.occupied.insert(i, level));
            }
        });
        assert!(!drops.cells().iter().any(|drop| *drop));
    }

    #[test]
    fn beams_below_the_expected_ground_make_a_drop_wherever_the_ladar_is() {
        let drops = ditch(|view, i| {
            if i == 57 + 100 * 2 {
                view.free.insert(i, 3);
                view.free.insert(i, 4);
            }
        });
        assert!(drops[(57, 2)]);
    }
}
