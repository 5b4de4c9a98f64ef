//! Things as shapes: drops, rocks, walls and brush patches from the cells of a tile, each with its measures.
//!
//! In: a [`Piece`]. Out: [`Part`]s, groups of cells with sums over them, that become [`Thing`]s, metres; parts of one group
//! that lie in several tiles are joined first (`seams`). Trees are no shapes; the chain finds them as they are.

use super::piece::Piece;
use super::shapes::{Cell, Run, groups, holds, length_and_width_m, outline, union};
use super::thing::{Kind, Thing};
use std::collections::BTreeMap;
use tsense_classifier::{ROCK_IN_BRUSH_MAX, is_rock_size};
use tsense_contract::CellClass;
use tsense_geometry::RasterShape;

/// A wall is at least this long and this high, metres.
const WALL_MIN_M: [f64; 2] = [3.0, 1.0];
/// Brush lower than this is not drawn, metres.
const BRUSH_MIN_M: f32 = 0.2;
/// How far around a drop its rim is looked for, and what is beside something solid, cells.
const RIM_CELLS: i32 = 3;
const BESIDE_CELLS: i32 = 1;

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
    /// What is around a drop or something solid: class and height of the ground; cells of other parts of it may be among them.
    rim: BTreeMap<Cell, (CellClass, f64)>,
}

/// What is known of a cell: its class, and metres; NaN where they are not known.
pub struct Heights {
    /// What it is.
    pub class: CellClass,
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
        class: piece.found.costs.cells()[i].class,
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
    /// A group of cells; what is around it is looked for in a raster.
    pub fn of(class: CellClass, runs: Vec<Run>, around: RasterShape, at: impl Fn(Cell) -> Option<Heights>) -> Self {
        let cells = || runs.iter().flat_map(|run| run.cells()).filter_map(&at);
        let reach = match class {
            CellClass::Drop => Some(RIM_CELLS),
            CellClass::Obstacle => Some(BESIDE_CELLS),
            _ => None,
        };
        let rim = reach.map(|reach| rim(around, &runs, reach)).into_iter().flatten();
        Self {
            class,
            ground_m: Known::of(cells().map(|at| at.ground_m)),
            ground_std_m: Known::of(cells().map(|at| at.ground_std_m)),
            low_m: Known::of(cells().map(|at| at.low_m)),
            high_m: Known::of(cells().map(|at| at.high_m)),
            rim: rim.filter_map(|cell| at(cell).map(|at| (cell, (at.class, at.ground_m)))).collect(),
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
        self.rim.extend(other.rim);
    }

    /// What bounds its memory: runs and cells of the rim.
    pub fn size(&self) -> usize {
        self.runs.len() + self.rim.len()
    }

    fn is_wall(&self, cell_m: f64) -> bool {
        self.class == CellClass::Obstacle
            && self.low_m.mean() >= WALL_MIN_M[1]
            && length_and_width_m(cell_m, &self.runs)[0] >= WALL_MIN_M[0]
    }

    /// Whether something solid is as large as a rock, and stands free: by nothing that falls away, and not amid brush.
    fn is_rock(&self, cell_m: f64) -> bool {
        let (height_m, [reach_m, _]) = (self.low_m.most, length_and_width_m(cell_m, &self.runs));
        let beside: Vec<CellClass> = self.beside().map(|(class, _)| class).collect();
        let count = |class: CellClass| beside.iter().filter(|beside| **beside == class).count();
        is_rock_size(height_m, reach_m)
            && count(CellClass::Drop) == 0
            && count(CellClass::Brush) as f64 <= ROCK_IN_BRUSH_MAX * beside.len() as f64
    }

    /// What is around all of its parts.
    fn beside(&self) -> impl Iterator<Item = (CellClass, f64)> {
        self.rim.iter().filter(|(cell, _)| !holds(&self.runs, **cell)).map(|(_, beside)| *beside)
    }

    /// What it is, where it is large enough, and no bank, log or stem.
    pub fn thing(&self, cell_m: f64) -> Option<Thing> {
        let over = |known: &Known| [known.most, known.mean()];
        let (kind, height_m) = match self.class {
            CellClass::Drop => {
                let rim_m = Known::of(self.beside().map(|(_, ground_m)| ground_m));
                (Kind::Drop, [rim_m.mean() - self.ground_m.least, rim_m.mean() - self.ground_m.mean()])
            }
            CellClass::Brush => (Kind::Brush, over(&self.low_m)),
            // A wall is as high as all of it.
            _ if self.is_wall(cell_m) => (Kind::Wall, over(&self.high_m)),
            _ if !self.is_rock(cell_m) => return None,
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
fn rim(shape: RasterShape, runs: &[Run], reach: i32) -> impl Iterator<Item = Cell> {
    let [west, south] = shape.first_cell;
    let (east, north) = (west + shape.width as i32, south + shape.height as i32);
    let near = runs.iter().flat_map(move |run| {
        let (from, to) = ((run.from - reach).max(west), (run.to + reach).min(east));
        let rows = (run.row - reach).max(south)..(run.row + reach + 1).min(north);
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

#[cfg(test)]
mod tests {
    use super::*;
    use CellClass::{Brush, Drop, Ground};

    /// What solid cells of 0.15 m are, so many east and north, so high, with this beside them in the west.
    fn kind_of([east, north]: [i32; 2], height_m: f64, beside: CellClass) -> Option<Kind> {
        let around = RasterShape { first_cell: [0; 2], width: 60, height: 60, cell_m: 0.15 };
        let is_solid = |[row, column]: Cell| (20..20 + north).contains(&row) && (20..20 + east).contains(&column);
        let at = |cell: Cell| {
            let class = match cell {
                _ if is_solid(cell) => CellClass::Obstacle,
                [_, column] if column < 20 => beside,
                _ => Ground,
            };
            Some(Heights { class, ground_m: 0.0, ground_std_m: 0.02, low_m: height_m, high_m: height_m })
        };
        let runs = groups(around, is_solid).remove(0);
        Part::of(CellClass::Obstacle, runs, around, at).thing(0.15).map(|thing| thing.kind)
    }

    #[test]
    fn a_rock_is_as_large_as_one_and_stands_free() {
        assert_eq!(kind_of([5, 5], 0.4, Ground), Some(Kind::Rock));
        assert_eq!(kind_of([5, 5], 0.4, Drop), None, "the bank of a ditch");
        assert_eq!(kind_of([3, 8], 0.4, Brush), None, "a third of what is around is brush");
        assert_eq!([0.2, 1.5].map(|height_m| kind_of([5, 5], height_m, Ground)), [None, None]);
        assert_eq!(kind_of([14, 3], 0.3, Ground), None, "seven times as long as high");
        assert_eq!(kind_of([30, 3], 2.0, Ground), Some(Kind::Wall));
    }
}
