//! Things that are no trees, as detections: rocks, walls, drops and patches of brush.
//!
//! In: what every cell is called, how high it stands, the ground. Out: one [`Detection`] a thing, places in UTM, metres;
//! bounded for each class, and how many were left out. A rock is one thing. What is long or wide comes in pieces of a
//! lattice that is fixed in the world, one a square, so that a piece stays what it is while more is seen: walls and drops by
//! the metre, brush by two metres. What is tall and solid but no wall stays a cell of the grid: no single snapshot tells
//! whether it is a trunk not yet proven, a person or a post.

use crate::cluster::{Cell, clusters};
use crate::ground::Ground;
use crate::memory::Memory;
use crate::rock::{ROCK_IN_BRUSH_MAX, is_rock_size};
use crate::traversability::Cost;
use std::collections::{BTreeMap, BTreeSet};
use tsense_contract::{COST_LETHAL, CellClass, Class, CostReason, Detection, GroundEvidence};
use tsense_geometry::{Raster, RasterShape};

/// Most detections of each class in a snapshot, the surest first and of these the nearest: a rock, a metre of wall or of an edge
/// for every seven square metres of 30 x 30 m. With the trees they fit into a message.
const EACH_MAX: usize = 128;
/// The same of brush: all of 30 x 30 m may be a meadow.
const BRUSH_MAX: usize = 256;
/// Edge of the lattice of walls and drops, and of that of brush, metres.
const PIECE_M: f64 = 1.0;
const PATCH_M: f64 = 2.0;
/// Fewest cells of a rock.
const ROCK_CELLS: usize = 3;
/// Least height of a wall, metres: dense brush is not as tall.
const WALL_MIN_M: f32 = 1.8;
/// Cells within this distance of a lattice square's middle say whether a wall stands there, metres.
const WALL_AROUND_M: f64 = 1.1;
/// A wall is this long there, and no thicker than this: one sigma of its cells along and across, metres.
const WALL_ALONG_M: f64 = 0.4;
const WALL_ACROSS_M: f64 = 0.17;
/// Fewest cells of a piece of a wall and of a drop, and of a patch of brush.
const WALL_CELLS: usize = 3;
const DROP_CELLS: usize = 6;
const BRUSH_CELLS: usize = 12;
/// Beams that tell of a drop end this far beside it, cells.
const DROP_MARGIN: usize = 4;
/// Fewest cells of measured ground that far beside a drop.
const DROP_BESIDE_MIN: usize = 12;
/// Cells this far around the middle of a piece of a drop say whether it goes on there, and the least share of them that fall
/// away: an edge or a pit does go on, the shadow of a bush is a lone patch amid brush.
const DROP_AROUND: usize = 8;
const DROP_AROUND_MIN: f64 = 0.2;
/// Nothing but a stem is quite sure from one snapshot.
const CONFIDENCE_MAX: f32 = 0.8;
/// Brush lower than this is no thing; what is taller may hang down from a crown, metres.
const BRUSH_M: std::ops::Range<f32> = 0.3..2.2;
/// Least share of cells around a rock in which ground was met or lies between where it was: what stands on ground that nobody
/// saw may be brush on brush.
const ROCK_BESIDE_MIN: f64 = 0.5;

/// What things are found in.
pub struct Stage<'a> {
    /// Cost and class of every cell.
    pub costs: &'a Raster<Cost>,
    /// Height of what stands on each cell, up to the tallest brush.
    pub brush_m: &'a Raster<f32>,
    /// The ground.
    pub ground: &'a Ground,
    /// Cells of drops that a pit or an edge shows.
    pub drops_shown: &'a Raster<bool>,
}

/// The things of a snapshot, and how many were left out by the bounds.
pub fn things(stage: &Stage, memory: &Memory) -> (Vec<Detection>, usize) {
    let walls = stage.walls();
    let mut is_wall = Raster::filled(stage.shape(), false);
    walls.iter().flatten().for_each(|cell| is_wall[*cell] = true);
    let thing = |class, cells: &Vec<Cell>| {
        let margin = if class == Class::Drop { DROP_MARGIN } else { 0 };
        Detection { stamp_ns: memory.met_ns(cells, margin), ..stage.thing(class, cells) }
    };
    let each = |class, pieces: Vec<Vec<Cell>>| pieces.iter().map(|cells| thing(class, cells)).collect::<Vec<_>>();
    let all = [
        (EACH_MAX, each(Class::Wall, walls)),
        (EACH_MAX, each(Class::Rock, stage.rocks(&is_wall))),
        (EACH_MAX, each(Class::Drop, stage.drops())),
        (BRUSH_MAX, each(Class::Brush, stage.pieces(PATCH_M, BRUSH_CELLS, |at| stage.is_brush(at)))),
    ];
    let (mut kept, mut left_out) = (Vec::new(), 0);
    for (most, mut found) in all {
        found.sort_by(|a, b| b.confidence.total_cmp(&a.confidence).then(stage.off_m(a).total_cmp(&stage.off_m(b))));
        left_out += found.len().saturating_sub(most);
        kept.extend(found.into_iter().take(most));
    }
    (kept, left_out)
}

impl Stage<'_> {
    fn shape(&self) -> RasterShape {
        self.costs.shape()
    }

    /// How far a thing is from the middle of the window, metres.
    fn off_m(&self, thing: &Detection) -> f64 {
        let shape = self.shape();
        distance_m(shape.center_of(shape.width / 2, shape.height / 2), [thing.easting_m, thing.northing_m])
    }

    fn is_brush(&self, at: Cell) -> bool {
        self.costs[at].class == CellClass::Brush && BRUSH_M.contains(&self.brush_m[at])
    }

    /// The cells of each square of a lattice of the world that pass a test, where there are enough of them.
    fn pieces(&self, edge_m: f64, cells_min: usize, test: impl Fn(Cell) -> bool) -> Vec<Vec<Cell>> {
        let (shape, mut squares) = (self.shape(), BTreeMap::<[i64; 2], Vec<Cell>>::new());
        let cells = (0..shape.height).flat_map(|row| (0..shape.width).map(move |column| (column, row)));
        for cell in cells.filter(|cell| test(*cell)) {
            let square = shape.center_of(cell.0, cell.1).map(|c| (c / edge_m).floor() as i64);
            squares.entry(square).or_default().push(cell);
        }
        squares.into_values().filter(|cells| cells.len() >= cells_min).collect()
    }

    /// Pieces of drops that go on, shown by more than beams that may have been lost, beside ground that was seen for certain:
    /// elsewhere nobody knows what they fall away from.
    fn drops(&self) -> Vec<Vec<Cell>> {
        let mut pieces = self.pieces(PIECE_M, DROP_CELLS, |at| self.costs[at].class == CellClass::Drop);
        pieces.retain(|cells| cells.iter().filter(|at| self.drops_shown[**at]).count() >= DROP_CELLS);
        pieces.retain(|cells| {
            let near: BTreeSet<Cell> = cells.iter().flat_map(|cell| self.shape().around(*cell, DROP_MARGIN)).collect();
            near.iter().filter(|at| self.ground.evidence[**at] == GroundEvidence::Measured).count() >= DROP_BESIDE_MIN
                && self.goes_on(cells)
        });
        pieces
    }

    /// Whether more falls away around the middle of a piece of a drop than stands there as brush, and enough of it.
    fn goes_on(&self, cells: &[Cell]) -> bool {
        let [easting_m, northing_m] = self.middle_m(cells);
        let Some(middle) = self.shape().cell_at(easting_m, northing_m) else { return false };
        let around: Vec<Cell> = self.shape().around(middle, DROP_AROUND).collect();
        let count = |class: CellClass| around.iter().filter(|at| self.costs[**at].class == class).count();
        let drop = count(CellClass::Drop);
        drop > count(CellClass::Brush) && drop as f64 >= DROP_AROUND_MIN * around.len() as f64
    }

    /// Pieces of walls: tall, solid, and in a line with what is around.
    fn walls(&self) -> Vec<Vec<Cell>> {
        let is_tall = |at: Cell| self.costs[at].class == CellClass::Obstacle && self.brush_m[at] >= WALL_MIN_M;
        let mut pieces = self.pieces(PIECE_M, WALL_CELLS, is_tall);
        let places: Vec<[f64; 2]> = pieces.iter().map(|cells| self.middle_m(cells)).collect();
        let all: Vec<Cell> = pieces.iter().flatten().copied().collect();
        let is_straight = |middle_m: &[f64; 2]| {
            let near = |cell: &&Cell| distance_m(self.shape().center_of(cell.0, cell.1), *middle_m) <= WALL_AROUND_M;
            let [along_m, across_m] = self.spread_m(&all.iter().filter(near).copied().collect::<Vec<_>>());
            along_m >= WALL_ALONG_M && across_m <= WALL_ACROSS_M
        };
        let mut straight = places.iter().map(is_straight);
        pieces.retain(|_| straight.next() == Some(true));
        pieces
    }

    /// Clusters of solid cells, low and small, that belong to no wall.
    fn rocks(&self, is_wall: &Raster<bool>) -> Vec<Vec<Cell>> {
        let mut found =
            clusters(self.costs, |cost| cost.class == CellClass::Obstacle && cost.reason != CostReason::Moving);
        found.retain(|cells| {
            cells.len() >= ROCK_CELLS
                && cells.iter().any(|at| self.costs[*at].cost == COST_LETHAL)
                && !cells.iter().any(|at| is_wall[*at])
                && is_rock_size(self.height_m(cells), self.reach_m(cells))
                && self.stands_free(cells)
        });
        found
    }

    /// Whether what is around some cells is bare ground, met often enough, and nothing there falls away.
    fn stands_free(&self, cells: &[Cell]) -> bool {
        let ring: BTreeSet<Cell> =
            cells.iter().flat_map(|cell| self.shape().around(*cell, 1)).filter(|at| !cells.contains(at)).collect();
        let share =
            |is: &dyn Fn(&Cell) -> bool| ring.iter().filter(|at| is(at)).count() as f64 / ring.len().max(1) as f64;
        let of = |class: CellClass| share(&|at| self.costs[*at].class == class);
        let is_known =
            |at: &Cell| matches!(self.ground.evidence[*at], GroundEvidence::Measured | GroundEvidence::Interpolated);
        share(&is_known) >= ROCK_BESIDE_MIN && of(CellClass::Brush) <= ROCK_IN_BRUSH_MAX && of(CellClass::Drop) == 0.0
    }

    fn thing(&self, class: Class, cells: &[Cell]) -> Detection {
        let [easting_m, northing_m] = self.middle_m(cells);
        let grounds = cells.iter().map(|at| f64::from(self.ground.height_m[*at])).filter(|z| z.is_finite());
        let (sum_m, count) = grounds.fold((0.0, 0usize), |(sum, count), z| (sum + z, count + 1));
        let (full_cells, position_std_m) = match class {
            Class::Rock => (6.0, 0.1),
            Class::Brush => (40.0, 0.3),
            _ => (7.0, 0.2),
        };
        let height_m = if class == Class::Drop { f64::NAN } else { self.height_m(cells) };
        Detection {
            easting_m,
            northing_m,
            ground_m: self.ground.base_m + sum_m / count.max(1) as f64,
            position_std_m,
            dbh_m: self.reach_m(cells) as f32,
            dbh_std_m: self.shape().cell_m as f32,
            height_m: height_m as f32,
            confidence: (cells.len() as f32 / full_cells).min(1.0) * CONFIDENCE_MAX,
            arc_coverage: 0.0,
            lean_rad: [0.0; 2],
            class: class.to_wire(),
            stamp_ns: 0,
            reserved: [0; 7],
        }
    }

    fn middle_m(&self, cells: &[Cell]) -> [f64; 2] {
        let shape = self.shape();
        let places = cells.iter().map(|cell| shape.center_of(cell.0, cell.1));
        let [x, y] = places.fold([0.0; 2], |sum, at| [sum[0] + at[0], sum[1] + at[1]]);
        [x, y].map(|c| c / cells.len().max(1) as f64)
    }

    fn height_m(&self, cells: &[Cell]) -> f64 {
        f64::from(cells.iter().map(|at| self.brush_m[*at]).fold(0.0, f32::max))
    }

    /// The longer side of the box around some cells.
    fn reach_m(&self, cells: &[Cell]) -> f64 {
        let side = |along: fn(&Cell) -> usize| {
            let (low, high) = (cells.iter().map(along).min(), cells.iter().map(along).max());
            high.zip(low).map_or(0, |(high, low)| high - low + 1)
        };
        side(|cell| cell.0).max(side(|cell| cell.1)) as f64 * self.shape().cell_m
    }

    /// One sigma of some cells along and across the line that fits them best.
    fn spread_m(&self, cells: &[Cell]) -> [f64; 2] {
        let count = cells.len().max(1) as f64;
        let mean = [0, 1].map(|axis| cells.iter().map(|cell| [cell.0, cell.1][axis] as f64).sum::<f64>() / count);
        let moment = |a: usize, b: usize| {
            let off = |cell: &Cell, axis: usize| [cell.0, cell.1][axis] as f64 - mean[axis];
            cells.iter().map(|cell| off(cell, a) * off(cell, b)).sum::<f64>() / count
        };
        let (xx, xy, yy) = (moment(0, 0), moment(0, 1), moment(1, 1));
        let (half, root) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        [half + root, half - root].map(|squared| squared.max(0.0).sqrt() * self.shape().cell_m)
    }
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 60 x 60 cells of 0.15 m: class and height of each from its place in metres.
    fn found(draw: impl Fn(f64, f64) -> Option<(CellClass, f32)>) -> Vec<Detection> {
        found_on(GroundEvidence::Measured, draw)
    }

    fn found_on(evidence: GroundEvidence, draw: impl Fn(f64, f64) -> Option<(CellClass, f32)>) -> Vec<Detection> {
        let (things, left_out) = found_in(60, evidence, draw);
        assert_eq!(left_out, 0);
        things
    }

    /// The same of so many cells along each side.
    fn found_in(
        side: usize,
        evidence: GroundEvidence,
        draw: impl Fn(f64, f64) -> Option<(CellClass, f32)>,
    ) -> (Vec<Detection>, usize) {
        let shape = RasterShape { first_cell: [600, 1200], width: side, height: side, cell_m: 0.15 };
        let at =
            |i: usize| draw((i % side) as f64 * 0.15, (i / side) as f64 * 0.15).unwrap_or((CellClass::Ground, 0.0));
        let cells = 0..side * side;
        let cost = |i: usize| Cost { cost: COST_LETHAL, reason: CostReason::Obstacle, class: at(i).0 };
        let costs = Raster::from_cells(shape, cells.clone().map(cost).collect()).unwrap();
        let brush_m = Raster::from_cells(shape, cells.map(|i| at(i).1).collect()).unwrap();
        let height_m = Raster::filled(shape, 1.5f32);
        let std_m = Raster::filled(shape, 0.02);
        let evidence = Raster::filled(shape, evidence);
        let ground = Ground { base_m: 100.0, height_m, std_m, evidence, measured_at_cells: vec![] };
        let drops_shown = costs.map(|cost| cost.class == CellClass::Drop);
        things(&Stage { costs: &costs, brush_m: &brush_m, ground: &ground, drops_shown: &drops_shown }, &Memory::new(0))
    }

    fn classes(things: &[Detection]) -> Vec<Class> {
        things.iter().map(|thing| Class::from_wire(thing.class)).collect()
    }

    #[test]
    fn a_rock_is_one_thing_with_its_place_height_and_reach() {
        let rock = |x: f64, y: f64| (x - 4.05).hypot(y - 3.0) < 0.5;
        let things = found(|x, y| rock(x, y).then_some((CellClass::Obstacle, 0.6)));
        assert_eq!(classes(&things), [Class::Rock]);
        let rock = &things[0];
        // Cell (0, 0) has its centre at 90.075, 180.075.
        assert!((rock.easting_m - 94.125).abs() < 0.02 && (rock.northing_m - 183.075).abs() < 0.02, "{rock:?}");
        assert!((rock.dbh_m - 1.05).abs() < 0.01 && (rock.height_m - 0.6).abs() < 1e-6 && rock.ground_m == 101.5);
    }

    #[test]
    fn a_wall_comes_in_pieces_of_a_metre_that_stay_while_more_of_it_is_seen() {
        let wall =
            |to_m: f64| found(move |x, y| (x < to_m && (y - 4.2).abs() < 0.1).then_some((CellClass::Obstacle, 2.5)));
        let (short, long) = (wall(4.4), wall(8.0));
        assert!(classes(&long).iter().all(|class| *class == Class::Wall));
        assert!((7..=9).contains(&long.len()), "{}", long.len());
        let is_there = |piece: &&Detection| long.iter().any(|other| (piece.easting_m - other.easting_m).abs() < 0.01);
        assert!(short.iter().filter(is_there).count() >= 4 && short.len() <= 5);
    }

    #[test]
    fn a_person_a_post_and_a_cottage_of_brush_are_neither_walls_nor_rocks() {
        assert!(found(|x, y| ((x - 4.0).hypot(y - 3.0) < 0.25).then_some((CellClass::Obstacle, 1.8))).is_empty());
        assert!(found(|x, y| ((x - 4.0).hypot(y - 3.0) < 0.9).then_some((CellClass::Obstacle, 2.0))).is_empty());
    }

    #[test]
    fn a_smooth_piece_of_a_bush_is_no_rock() {
        let on_grass = |x: f64, y: f64| ((x - 4.05).hypot(y - 3.0) < 0.5).then_some((CellClass::Obstacle, 0.6));
        assert!(found_on(GroundEvidence::Extrapolated, on_grass).is_empty(), "no ground was met beside it");
        assert_eq!(classes(&found_on(GroundEvidence::Interpolated, on_grass)), [Class::Rock]);
        let bush = found(|x, y| match (x - 4.0).hypot(y - 3.0) {
            near if near < 0.4 => Some((CellClass::Obstacle, 0.6)),
            near if near < 0.9 => Some((CellClass::Brush, 0.6)),
            _ => None,
        });
        assert!(classes(&bush).iter().all(|class| *class == Class::Brush), "{bush:?}");
    }

    #[test]
    fn a_patch_without_ground_amid_brush_is_its_shadow_and_an_edge_beside_brush_is_a_drop() {
        let hole = |x: f64, y: f64| (x - 4.0).abs() < 0.75 && (y - 4.0).abs() < 0.6;
        let amid = |around: CellClass| {
            let things = found(move |x, y| match (hole(x, y), (x - 4.0).hypot(y - 4.0) < 2.0) {
                (true, _) => Some((CellClass::Drop, 0.0)),
                (false, true) => Some((around, 0.5)),
                _ => None,
            });
            classes(&things).contains(&Class::Drop)
        };
        assert!(amid(CellClass::Ground) && !amid(CellClass::Brush));
        let edge = found(|x, _| match x {
            x if (3.0..4.5).contains(&x) => Some((CellClass::Drop, 0.0)),
            x if x < 3.0 => Some((CellClass::Brush, 0.5)),
            _ => None,
        });
        assert!(classes(&edge).contains(&Class::Drop));
    }

    #[test]
    fn drops_and_brush_come_in_pieces_of_their_lattice_and_specks_do_not_count() {
        let ditch = found(|x, _| (3.0..4.5).contains(&x).then_some((CellClass::Drop, 0.0)));
        assert!(classes(&ditch).iter().all(|class| *class == Class::Drop) && (14..=30).contains(&ditch.len()));
        assert!(ditch.iter().all(|drop| drop.height_m.is_nan()));
        let nowhere =
            found_on(GroundEvidence::Extrapolated, |x, _| (3.0..4.5).contains(&x).then_some((CellClass::Drop, 0.0)));
        assert!(nowhere.is_empty(), "no ground was seen that it falls away from");
        let brush = found(|x, y| (x < 4.0 && y < 4.0).then_some((CellClass::Brush, 0.8)));
        assert!(classes(&brush).iter().all(|class| *class == Class::Brush) && (3..=5).contains(&brush.len()));
        assert!(found(|x, y| (x < 0.4 && y < 0.4).then_some((CellClass::Brush, 0.8))).is_empty());
    }

    #[test]
    fn a_meadow_of_the_usual_window_is_told_whole_and_of_a_larger_one_what_is_near() {
        let meadow = |side: usize| found_in(side, GroundEvidence::Measured, |_, _| Some((CellClass::Brush, 0.8)));
        let (usual, left_out) = meadow(200);
        assert_eq!((usual.len(), left_out), (225, 0));
        let (near, left_out) = meadow(400);
        assert_eq!((near.len(), left_out), (BRUSH_MAX, 900 - BRUSH_MAX));
        // 256 patches of 4 square metres are a disc of 18 m around the middle, at 120, 210.
        let off_m = |thing: &Detection| (thing.easting_m - 120.0).hypot(thing.northing_m - 210.0);
        assert!(near.iter().all(|thing| off_m(thing) < 19.0), "{near:?}");
    }
}
