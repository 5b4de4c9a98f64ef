//! Things as shapes: drops, rocks, walls and brush patches from the cells of a tile, each with its measures.
//!
//! In: a [`Piece`]. Out: [`Part`]s, groups of cells with sums over them, that become [`Thing`]s, metres; parts of one group
//! that lie in several tiles are joined first (`seams`). Trees are no shapes; the chain finds them as they are.

use super::piece::Piece;
use super::shapes::{Cell, Run, groups, holds, length_and_width_m, outline, union};
use super::thing::{Kind, Thing};
use std::collections::BTreeMap;
use tsense_contract::CellClass;
use tsense_geometry::RasterShape;

/// A wall is at least this long and this high, metres; what is less is a rock or a log.
const WALL_MIN_M: [f64; 2] = [3.0, 1.0];
/// Brush lower than this is not drawn, metres.
const BRUSH_MIN_M: f32 = 0.2;
/// How far around a drop its rim is looked for, cells.
const RIM_CELLS: i32 = 3;

/// Cells of one class that touch each other, and what is summed over them.
#[derive(Clone)]
pub struct Part {
    /// What they are.
    pub class: CellClass,
    /// The cells.
    pub runs: Vec<Run>,
    ground_m: Known,
    ground_std_m: Known,
    low_m: Known,
    high_m: Known,
    /// Height of the ground around a drop; cells of other parts of it may be among them.
    rim_m: BTreeMap<Cell, f64>,
}

/// What is known of a cell, metres; NaN where it is not.
pub struct Heights {
    /// The ground.
    pub ground_m: f64,
    /// One sigma of it.
    pub ground_std_m: f64,
    /// What stands from the ground up, above it; told from crowns.
    pub low_m: f64,
    /// The highest thing, above the ground.
    pub high_m: f64,
}

/// The parts of things in a tile's core.
pub fn parts(piece: &Piece) -> Vec<Part> {
    let classes = [CellClass::Drop, CellClass::Obstacle, CellClass::Brush];
    classes.into_iter().flat_map(|class| parts_of(piece, piece.core, class)).collect()
}

fn parts_of(piece: &Piece, cells: RasterShape, class: CellClass) -> impl Iterator<Item = Part> {
    let belongs = |cell| piece.index_of(cell).is_some_and(|i| belongs(piece, i, class));
    let heights = |cell| piece.index_of(cell).map(|i| heights(piece, i));
    groups(cells, belongs).into_iter().map(move |runs| Part::of(class, runs, piece.around, heights))
}

/// The cells of walls in a tile and its margin: what is cut at the border of the core may be too short for one.
pub fn walls(piece: &Piece) -> impl Iterator<Item = Cell> {
    let parts = parts_of(piece, piece.around, CellClass::Obstacle);
    parts.filter(|part| part.is_wall(piece.core.cell_m)).flat_map(|part| part.runs).flat_map(Run::cells)
}

fn belongs(piece: &Piece, i: usize, class: CellClass) -> bool {
    let is_high = class != CellClass::Brush || piece.found.brush_m.cells()[i] >= BRUSH_MIN_M;
    piece.found.costs.cells()[i].class == class && is_high
}

fn heights(piece: &Piece, i: usize) -> Heights {
    let ground = &piece.found.ground;
    Heights {
        ground_m: ground.base_m + f64::from(ground.height_m.cells()[i]),
        ground_std_m: ground.std_m.cells()[i].into(),
        low_m: piece.found.brush_m.cells()[i].into(),
        high_m: piece.canopy_m(i).into(),
    }
}

/// Fewest cells of a shape; smaller ones are noise.
fn cells_min(kind: Kind) -> usize {
    match kind {
        Kind::Drop => 4,
        // A rock of 0.4 m across; smaller groups are mostly stems of brush.
        Kind::Rock | Kind::Wall => 6,
        Kind::Brush => 8,
    }
}

impl Part {
    /// A group of cells; a drop's rim is looked for in a raster around it.
    pub fn of(class: CellClass, runs: Vec<Run>, around: RasterShape, at: impl Fn(Cell) -> Option<Heights>) -> Self {
        let cells = || runs.iter().flat_map(|run| run.cells()).filter_map(&at);
        let rim = (class == CellClass::Drop).then(|| rim(around, &runs)).into_iter().flatten();
        Self {
            class,
            ground_m: Known::of(cells().map(|at| at.ground_m)),
            ground_std_m: Known::of(cells().map(|at| at.ground_std_m)),
            low_m: Known::of(cells().map(|at| at.low_m)),
            high_m: Known::of(cells().map(|at| at.high_m)),
            rim_m: rim.filter_map(|cell| Some((cell, at(cell)?.ground_m))).collect(),
            runs,
        }
    }

    /// Takes another part in.
    pub fn join(&mut self, other: Self) {
        self.runs = union([std::mem::take(&mut self.runs), other.runs].concat());
        self.ground_m.add(&other.ground_m);
        self.ground_std_m.add(&other.ground_std_m);
        self.low_m.add(&other.low_m);
        self.high_m.add(&other.high_m);
        self.rim_m.extend(other.rim_m);
    }

    /// What bounds its memory: runs and cells of the rim.
    pub fn size(&self) -> usize {
        self.runs.len() + self.rim_m.len()
    }

    fn is_wall(&self, cell_m: f64) -> bool {
        self.class == CellClass::Obstacle
            && self.low_m.mean() >= WALL_MIN_M[1]
            && length_and_width_m(cell_m, &self.runs)[0] >= WALL_MIN_M[0]
    }

    /// What it is, where it is large enough.
    pub fn thing(&self, cell_m: f64) -> Option<Thing> {
        let over = |known: &Known| [known.most, known.mean()];
        let (kind, height_m) = match self.class {
            CellClass::Drop => {
                let rim_m =
                    Known::of(self.rim_m.iter().filter(|(cell, _)| !holds(&self.runs, **cell)).map(|(_, m)| *m));
                (Kind::Drop, [rim_m.mean() - self.ground_m.least, rim_m.mean() - self.ground_m.mean()])
            }
            CellClass::Brush => (Kind::Brush, over(&self.low_m)),
            // A wall is as high as all of it.
            _ if self.is_wall(cell_m) => (Kind::Wall, over(&self.high_m)),
            _ => (Kind::Rock, over(&self.low_m)),
        };
        let cells = self.runs.iter().flat_map(|run| run.cells()).count();
        (cells >= cells_min(kind)).then(|| Thing {
            kind,
            outline: outline(cell_m, &self.runs),
            area_m2: cells as f64 * cell_m.powi(2),
            length_width_m: length_and_width_m(cell_m, &self.runs),
            height_m,
            ground_m: [self.ground_m.mean(), self.ground_std_m.mean()],
        })
    }
}

/// The cells of a raster around those of a group; some are there twice.
fn rim(shape: RasterShape, runs: &[Run]) -> impl Iterator<Item = Cell> {
    let [west, south] = shape.first_cell;
    let (east, north) = (west + shape.width as i32, south + shape.height as i32);
    let near = runs.iter().flat_map(move |run| {
        let (from, to) = ((run.from - RIM_CELLS).max(west), (run.to + RIM_CELLS).min(east));
        let rows = (run.row - RIM_CELLS).max(south)..(run.row + RIM_CELLS + 1).min(north);
        rows.flat_map(move |row| Run { row, from, to }.cells())
    });
    near.filter(|cell| !holds(runs, *cell))
}

/// The finite ones of some values.
#[derive(Clone, Copy)]
struct Known {
    count: usize,
    sum: f64,
    least: f64,
    most: f64,
}

impl Known {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut known = Self { count: 0, sum: 0.0, least: f64::NAN, most: f64::NAN };
        for value in values.filter(|value| value.is_finite()) {
            known.add(&Self { count: 1, sum: value, least: value, most: value });
        }
        known
    }

    fn add(&mut self, other: &Self) {
        (self.count, self.sum) = (self.count + other.count, self.sum + other.sum);
        (self.least, self.most) = (self.least.min(other.least), self.most.max(other.most));
    }

    /// NaN where there is none.
    fn mean(&self) -> f64 {
        self.sum / self.count as f64
    }
}
