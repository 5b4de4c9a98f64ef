//! Negative obstacles: ground that falls away, seen from above or known by its absence.
//!
//! In: the view, its ground, what stands on it, and where the ladar is. Out: the cells that are a drop, and those that more
//! shows than beams which may have been lost. Three kinds of evidence: the ground was met deep below the ground around it;
//! behind an edge as seen from the ladar, no ground was met over a stretch that beams were aimed at and passed over and that
//! their spacing does not explain; and, where next to no ground was met around, beams went below the surface that the ground
//! raster expects. Beyond an edge at range r, seen from height h, a stretch of L without ground means a depth of at least
//! h L / (r + L).
//! It judges only what is within the view; what is hidden behind brush or a trunk is unknown and no drop.

use crate::aimed::Aimed;
use crate::cluster::Cell;
use crate::columns::View;
use crate::config::TraversabilityConfig;
use crate::density::Columns;
use crate::ground::Ground;
use crate::pits::pit_depths;
use crate::plane_fit::PlaneSums;
use crate::returns::Returns;
use std::ops::Range;
use tsense_contract::GroundEvidence;
use tsense_geometry::Raster;

/// Directions that are followed from the ladar: neighbouring ones are 0.13 m apart at 15 m.
const DIRECTIONS: usize = 720;
/// How far they are followed, metres: beams farther away graze.
const REACH_M: f64 = 24.0;
/// Levels above the expected ground between which something hides the ground behind it: brush, trunks, no crowns.
const HIDING_LEVELS: [usize; 2] = [2, 10];
/// What is occupied at this many of so many levels ends the sight of the ladar.
const WALL_OCCUPIED: usize = 6;
const WALL_LEVELS: usize = 9;
/// Deviations of the ground's height by which a pit must be deeper than stated.
const PIT_SIGMAS: f32 = 1.0;
/// Levels above the expected ground in which free space shows that beams passed there: beams level with the ladar would
/// not have met it in any case.
const PASSING_LEVELS: usize = 5;
/// The near edge's plane rests on the ground met within this square before the edge: half its width, cells.
const EDGE_CELLS: usize = 5;
/// Fewest cells that carry it.
const EDGE_CELLS_MIN: usize = 10;
/// Share of the depth of a drop that a stretch must show: it shows only how deep the ground lies at least.
const SHOWN_DEPTH_SHARE: f64 = 0.75;
/// Places of a stretch that beams must have been aimed at.
const PLACES: usize = 3;
/// How far around a cell that beams went below it is asked whether ground was met, cells.
const BELOW_REACH: usize = 3;
/// Ground met in more cells of that square than these shows that beams end there: what went below was a beam that never came
/// back, which clears the map on its way through the ground.
const BELOW_MET_MAX: usize = 3;

/// Where beams come from.
#[derive(Clone, Debug, PartialEq)]
pub struct Eye {
    /// Easting, northing, metres.
    pub at_m: [f64; 2],
    /// Height above the ground below it, metres.
    pub height_m: f64,
    /// Stations of the store, counted from the oldest, whose beams were aimed from there.
    pub stations: Range<usize>,
}

/// Who looked.
#[derive(Clone, Copy, Debug)]
pub struct Looks<'a> {
    /// From where.
    pub eyes: &'a [Eye],
    /// The beams, where they were kept.
    pub returns: Option<&'a Returns>,
    /// From how many of them a stretch without ground must be a drop.
    pub least: u16,
    /// Whether space that is free below the expected ground shows a drop: not where beams that never came back clear more
    /// than is near the ladar, for they may have been lost on the ground.
    pub is_near: bool,
}

/// Cells that are a drop.
#[derive(Clone, Debug)]
pub struct Drops {
    /// All of them.
    pub cells: Raster<bool>,
    /// Those that a pit or an edge shows: of the others it is known only that some beam went on below them.
    pub shown: Raster<bool>,
}

/// Cells that are a drop.
pub fn drops(
    view: &View,
    ground: &Ground,
    columns: &Columns,
    (met_m, met): (&Raster<f32>, &PlaneSums),
    looks: &Looks,
    config: &TraversabilityConfig,
) -> Drops {
    let corner = view.shape.first_cell.map(|first| f64::from(first) * view.shape.cell_m);
    let corner_m = [corner[0], corner[1], view.base_m()];
    // From how many places each cell looks like a drop.
    let mut looked = Raster::filled(view.shape, 0u16);
    for eye in looks.eyes {
        let Some(cell) = view.shape.cell_at(eye.at_m[0], eye.at_m[1]) else { continue };
        let mut shown = Raster::filled(view.shape, false);
        let aimed = |returns| Aimed::new(returns, corner_m, view.shape.len(), eye.stations.clone());
        let mut aimed = looks.returns.map(aimed);
        let below_m = Some(f64::from(ground.height_m[cell])).filter(|z| z.is_finite());
        let eye_m = below_m.map(|z| z + eye.height_m);
        let walk = Walk { view, ground, columns, met_m, met, eye_height_m: eye.height_m, eye_m, config };
        for i in 0..DIRECTIONS {
            let angle = i as f64 / DIRECTIONS as f64 * std::f64::consts::TAU;
            walk.along(cell, [angle.cos(), angle.sin()], &mut shown, aimed.as_mut());
        }
        looked.cells_mut().iter_mut().zip(shown.cells()).for_each(|(count, shown)| {
            *count = count.saturating_add(u16::from(*shown));
        });
    }
    let mut shown = looked.map(|count| *count >= looks.least);
    add_pits(&mut shown, ground, config);
    let mut cells = match looks.is_near {
        true => seen_below(view, ground, config),
        false => Raster::filled(view.shape, false),
    };
    cells.cells_mut().iter_mut().zip(shown.cells()).for_each(|(cell, shown)| *cell |= shown);
    Drops { cells, shown }
}

/// Cells in whose column beams went on below the expected ground.
fn seen_below(view: &View, ground: &Ground, config: &TraversabilityConfig) -> Raster<bool> {
    let mut drops = Raster::filled(view.shape, false);
    let cell_m = view.shape.cell_m;
    for (i, drop) in drops.cells_mut().iter_mut().enumerate() {
        let deep_m = f64::from(ground.height_m.cells()[i]) - config.drop_depth_m;
        // NaN is not above zero.
        if deep_m > 0.0 && ground.evidence.cells()[i] != GroundEvidence::Measured {
            *drop = view.free.count(i, 0, (deep_m / cell_m) as usize) >= 2
                && met_around(ground, (i % view.shape.width, i / view.shape.width)) <= BELOW_MET_MAX;
        }
    }
    drops
}

/// Cells of a square around one in which ground was met.
fn met_around(ground: &Ground, cell: Cell) -> usize {
    let square = ground.evidence.shape().around(cell, BELOW_REACH);
    square.filter(|at| ground.evidence[*at] == GroundEvidence::Measured).count()
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
    /// Planes through the ground that was met.
    met: &'a PlaneSums,
    eye_height_m: f64,
    /// The same above the view's base, where the ground below it is known.
    eye_m: Option<f64>,
    config: &'a TraversabilityConfig,
}

/// The ground that the near edge of a stretch lets expect, along one direction: the surface itself is drawn down to what was
/// met in a ditch. It goes on downhill, never uphill: behind a crest ground is hidden without falling away.
struct Expected {
    edge_m: f64,
    slope: f64,
}

/// A stretch without ground behind an edge.
struct Stretch {
    edge_m: f64,
    cells: Vec<usize>,
    expected: Option<Expected>,
}

impl Walk<'_> {
    /// Follows one direction outwards, as far as the ladar sees, and marks the stretches that are drops.
    fn along(
        &self,
        from: (usize, usize),
        direction: [f64; 2],
        drops: &mut Raster<bool>,
        mut aimed: Option<&mut Aimed>,
    ) {
        let shape = self.view.shape;
        let mut stretch: Option<Stretch> = None;
        let reach = (REACH_M / shape.cell_m) as usize;
        for step in 1..shape.width.max(shape.height).min(reach) {
            let at = [from.0 as f64 + step as f64 * direction[0], from.1 as f64 + step as f64 * direction[1]];
            let (column, row) = (at[0].round(), at[1].round());
            if column < 0.0 || row < 0.0 || column >= shape.width as f64 || row >= shape.height as f64 {
                return;
            }
            let i = row as usize * shape.width + column as usize;
            let range_m = step as f64 * shape.cell_m;
            if self.ends_sight(i) {
                return;
            }
            if self.is_met(i, range_m, stretch.as_ref()) {
                if let Some(stretch) = stretch.filter(|stretch| self.is_drop(stretch, range_m, aimed.as_deref_mut())) {
                    stretch.cells.iter().for_each(|&i| drops.cells_mut()[i] = true);
                }
                let edge = Stretch { edge_m: range_m, cells: Vec::new(), expected: None };
                stretch = (!self.stands_on(i, self.columns.ground_level[i].max(0) as usize)).then_some(edge);
            } else if let Some(open) = &mut stretch {
                if open.cells.is_empty() {
                    open.expected = self.expected(at, direction);
                }
                open.cells.push(i);
                if self.is_hiding(i, range_m, open) {
                    stretch = None;
                }
            }
        }
    }

    /// The plane of the ground that was met before an edge.
    fn expected(&self, edge: [f64; 2], direction: [f64; 2]) -> Option<Expected> {
        let back = (EDGE_CELLS + 1) as f64;
        let at = [0, 1].map(|axis| (edge[axis] - back * direction[axis]).round());
        let inside = at[0] >= 0.0 && at[1] >= 0.0;
        let plane = inside.then(|| self.met.fit(at[0] as usize, at[1] as usize, EDGE_CELLS, EDGE_CELLS_MIN))??;
        let slope = plane.slope[0] * direction[0] + plane.slope[1] * direction[1];
        Some(Expected { edge_m: plane.height_m + slope * back * self.view.shape.cell_m, slope: slope.min(0.0) })
    }

    /// Height of the ground expected in a column of a stretch; where no edge says, that of the ground raster.
    fn expected_m(&self, i: usize, range_m: f64, stretch: &Stretch) -> f64 {
        match &stretch.expected {
            Some(expected) => expected.edge_m + expected.slope * (range_m - stretch.edge_m),
            None => f64::from(self.ground.height_m.cells()[i]),
        }
    }

    /// Level of the view that holds the ground expected in a column, where there is one.
    fn expected_level(&self, i: usize, range_m: f64, stretch: &Stretch) -> Option<usize> {
        let level = self.expected_m(i, range_m, stretch) / self.view.shape.cell_m;
        (level >= 0.0).then_some(level as usize)
    }

    /// Whether ground was met in a column, on the ground's surface or where the near edge lets expect it.
    fn is_met(&self, i: usize, range_m: f64, stretch: Option<&Stretch>) -> bool {
        let told = stretch.filter(|stretch| stretch.expected.is_some());
        let level = told.and_then(|stretch| self.expected_level(i, range_m, stretch));
        self.met_m.cells()[i].is_finite()
            || level.is_some_and(|level| self.view.occupied.count(i, level.saturating_sub(1), level + 2) > 0)
    }

    /// Whether something stands in a column that beams do not pass: above the ground, and above that expected.
    fn is_hiding(&self, i: usize, range_m: f64, stretch: &Stretch) -> bool {
        self.stands_on(i, self.columns.ground_level[i].max(0) as usize)
            && self.expected_level(i, range_m, stretch).is_none_or(|level| self.stands_on(i, level))
    }

    /// Whether a wall or a trunk stands in a column: what is known behind it was seen from elsewhere, at other angles.
    fn ends_sight(&self, i: usize) -> bool {
        let from = self.columns.ground_level[i].max(0) as usize + HIDING_LEVELS[0];
        self.view.occupied.count(i, from, from + WALL_LEVELS) >= WALL_OCCUPIED
    }

    /// Whether something stands on a level of a column that hides what is behind.
    fn stands_on(&self, i: usize, level: usize) -> bool {
        let [from, to] = HIDING_LEVELS.map(|above| level + above);
        self.view.occupied.count(i, from, to) > 0
    }

    /// Whether beams went through the space just above the ground expected in a column.
    fn beams_passed(&self, i: usize, range_m: f64, stretch: &Stretch) -> bool {
        let level = self.expected_level(i, range_m, stretch);
        level.is_some_and(|level| self.view.free.count(i, level, level + PASSING_LEVELS) > 0)
    }

    fn is_drop(&self, stretch: &Stretch, end_m: f64, aimed: Option<&mut Aimed>) -> bool {
        let (config, length_m) = (self.config, end_m - stretch.edge_m);
        let spacing_m = stretch.edge_m * stretch.edge_m * config.beam_step_rad / self.eye_height_m;
        length_m >= config.drop_gap_min_m.max(2.0 * spacing_m)
            && self.depth_m(stretch, end_m) >= SHOWN_DEPTH_SHARE * config.drop_depth_m
            && self.share_passed(stretch) > 0.5
            && aimed.is_none_or(|aimed| self.was_aimed_at(aimed, stretch))
    }

    /// How deep the ground must lie at least below that expected at the end of a stretch, so that no beam over the edge met it.
    fn depth_m(&self, stretch: &Stretch, end_m: f64) -> f64 {
        let length_m = end_m - stretch.edge_m;
        match (self.eye_m, &stretch.expected) {
            (Some(eye_m), Some(edge)) => ((eye_m - edge.edge_m) / end_m + edge.slope) * length_m,
            _ => self.eye_height_m * length_m / end_m,
        }
    }

    /// Share of a stretch's cells that beams passed over.
    fn share_passed(&self, stretch: &Stretch) -> f64 {
        let passed = |(k, i): &(usize, &usize)| self.beams_passed(**i, stretch.range_m(*k, self.view), stretch);
        stretch.cells.iter().enumerate().filter(passed).count() as f64 / stretch.cells.len().max(1) as f64
    }

    /// Whether beams were aimed at the ground expected at most of a few places of a stretch, and went on behind: a stretch
    /// that the nod left out is no drop.
    fn was_aimed_at(&self, aimed: &mut Aimed, stretch: &Stretch) -> bool {
        let shape = self.view.shape;
        let count = stretch.cells.len();
        let mut went_on = |place: &usize| {
            let k = (2 * place + 1) * count / (2 * PLACES);
            let (i, along) = (stretch.cells[k], |c: usize| (c as f64 + 0.5) * shape.cell_m);
            let expected_m = self.expected_m(i, stretch.range_m(k, self.view), stretch);
            aimed.went_on_behind(i, [along(i % shape.width), along(i / shape.width), expected_m])
        };
        count > 0 && 2 * (0..PLACES).filter(&mut went_on).count() > PLACES
    }
}

impl Stretch {
    /// Distance of cell number `k` from where the walk began, metres.
    fn range_m(&self, k: usize, view: &View) -> f64 {
        self.edge_m + (k + 1) as f64 * view.shape.cell_m
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
    fn ditch(change: impl Fn(&mut View, usize)) -> Drops {
        let eyes = [Eye { at_m: [4.575, 7.5], height_m: 1.6, stations: 0..0 }];
        ditch_from(&Looks { eyes: &eyes, returns: None, least: 1, is_near: true }, change)
    }

    fn ditch_from(looks: &Looks, change: impl Fn(&mut View, usize)) -> Drops {
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
            (&met(&ground), &PlaneSums::of(&met(&ground))),
            looks,
            &TraversabilityConfig::default(),
        )
    }

    #[test]
    fn a_ditch_that_beams_pass_over_without_meeting_ground_is_a_drop() {
        let drops = ditch(|_, _| {}).shown;
        assert!(drops[(57, 50)] && drops[(50, 50)] && drops[(64, 45)]);
        assert!(!drops[(45, 50)] && !drops[(70, 50)]);
    }

    #[test]
    fn a_survey_tells_what_looks_like_a_drop_from_two_places_and_no_beams_that_were_lost() {
        let eye = |x: f64| Eye { at_m: [x, 7.5], height_m: 1.6, stations: 0..0 };
        let below = |view: &mut View, i: usize| {
            if i == 57 + 100 * 2 {
                (3..5).for_each(|level| view.free.insert(i, level));
            }
        };
        let shown = |eyes: &[Eye]| ditch_from(&Looks { eyes, returns: None, least: 2, is_near: false }, below).cells;
        let count = |drops: Raster<bool>| drops.cells().iter().filter(|drop| **drop).count();
        assert_eq!(count(shown(&[eye(4.575)])), 0);
        let two = shown(&[eye(4.575), eye(5.6)]);
        assert!(two[(57, 50)] && count(two) > 100);
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
        assert!(!drops.cells.cells().iter().any(|drop| *drop));
    }

    #[test]
    fn what_is_known_behind_a_wall_was_seen_from_elsewhere_and_is_no_drop() {
        let drops = ditch(|view, i| {
            if i % 100 == 40 {
                (10..30).for_each(|level| view.occupied.insert(i, level));
            }
        });
        assert!(!drops.cells.cells().iter().any(|drop| *drop));
    }

    #[test]
    fn beams_below_the_expected_ground_make_a_drop_wherever_the_ladar_is_but_show_none() {
        let drops = ditch(|view, i| {
            if i == 57 + 100 * 2 {
                view.free.insert(i, 3);
                view.free.insert(i, 4);
            }
        });
        assert!(drops.cells[(57, 2)] && !drops.shown[(57, 2)]);
    }

    #[test]
    fn a_beam_lost_amid_ground_that_was_met_makes_no_drop() {
        let mut view = View::unknown(Window { first: [0; 3], size: [100, 100, 40] }, VoxelGrid::new(0.15).unwrap());
        let mut ground = flat();
        for (column, met) in [(20, 48), (40, 4), (60, 3), (80, 0)] {
            let square = (0..49).map(|k| (column + k % 7 - 3, 50 + k / 7 - 3));
            let unmet = square.filter(|at| *at != (column, 50)).take(48 - met);
            unmet.chain([(column, 50)]).for_each(|at| ground.evidence[at] = GroundEvidence::Interpolated);
            (3..5).for_each(|level| view.free.insert(column + 100 * 50, level));
        }
        let drops = seen_below(&view, &ground, &TraversabilityConfig::default());
        assert_eq!([20, 40, 60, 80].map(|column| drops[(column, 50)]), [false, false, true, true]);
    }
}
