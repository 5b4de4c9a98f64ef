//! Things as shapes: drops, rocks, walls and brush patches from the cells of a tile, each with its measures.
//!
//! In: a [`Piece`]. Out: [`Thing`]s, metres. A shape ends where its tile ends: one that reaches over the border is one
//! shape in each tile. Trees are no shapes; the chain finds them as they are.

use super::piece::Piece;
use super::shapes::{groups, length_and_width_m, outline};
use super::thing::{Kind, Thing};
use tsense_contract::CellClass;
use tsense_geometry::RasterShape;

/// A wall is at least this long and this high, metres; what is less is a rock or a log.
const WALL_MIN_M: [f64; 2] = [3.0, 1.0];
/// Brush lower than this is not drawn, metres.
const BRUSH_MIN_M: f32 = 0.2;
/// How far around a drop its rim is looked for, cells.
const RIM_CELLS: usize = 3;

/// The things of a tile, and how many groups were too small to be one.
pub fn things(piece: &Piece) -> (Vec<Thing>, u64) {
    let (mut found, mut too_small) = (Vec::new(), 0);
    for class in [CellClass::Drop, CellClass::Obstacle, CellClass::Brush] {
        for group in groups(piece.core, |i| piece.cell(i).is_some_and(|i| belongs(piece, i, class))) {
            let thing = thing(piece, class, &group);
            if group.len() < cells_min(thing.kind) {
                too_small += 1;
            } else {
                found.push(thing);
            }
        }
    }
    (found, too_small)
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

fn belongs(piece: &Piece, i: usize, class: CellClass) -> bool {
    let is_high = class != CellClass::Brush || piece.found.brush_m.cells()[i] >= BRUSH_MIN_M;
    piece.found.costs.cells()[i].class == class && is_high
}

fn thing(piece: &Piece, class: CellClass, group: &[usize]) -> Thing {
    let cells: Vec<usize> = group.iter().filter_map(|i| piece.cell(*i)).collect();
    let ground = &piece.found.ground;
    let over = |value: &dyn Fn(usize) -> f32| Known::of(cells.iter().map(|i| value(*i)));
    let ground_m = over(&|i| ground.height_m.cells()[i]);
    let length_width_m = length_and_width_m(piece.core, group);
    let (kind, height_m) = match class {
        CellClass::Drop => {
            let rim_m =
                Known::of(rim(piece.core, group).filter_map(|i| piece.cell(i)).map(|i| ground.height_m.cells()[i]));
            (Kind::Drop, [rim_m.mean() - ground_m.least, rim_m.mean() - ground_m.mean()])
        }
        CellClass::Brush => {
            let height_m = over(&|i| piece.found.brush_m.cells()[i]);
            (Kind::Brush, [height_m.most, height_m.mean()])
        }
        _ => {
            // What stands from the ground up is told from crowns above it; a wall is as high as all of it.
            let low_m = over(&|i| piece.found.brush_m.cells()[i]);
            let high_m = over(&|i| piece.canopy_m(i));
            let is_wall = length_width_m[0] >= WALL_MIN_M[0] && low_m.mean() >= WALL_MIN_M[1];
            let height_m = if is_wall { high_m } else { low_m };
            (if is_wall { Kind::Wall } else { Kind::Rock }, [height_m.most, height_m.mean()])
        }
    };
    Thing {
        kind,
        outline: outline(piece.core, group),
        cells: group.to_vec(),
        area_m2: group.len() as f64 * piece.core.cell_m.powi(2),
        length_width_m,
        height_m,
        ground_m: [ground.base_m + ground_m.mean(), over(&|i| ground.std_m.cells()[i]).mean()],
    }
}

/// The cells around a group.
fn rim(shape: RasterShape, group: &[usize]) -> impl Iterator<Item = usize> {
    let own: std::collections::BTreeSet<usize> = group.iter().copied().collect();
    let around = group.iter().flat_map(|i| shape.around((i % shape.width, i / shape.width), RIM_CELLS));
    let around = around.map(|(column, row)| row * shape.width + column);
    around.filter(|i| !own.contains(i)).collect::<std::collections::BTreeSet<_>>().into_iter()
}

/// The finite ones of some values.
struct Known {
    count: usize,
    sum: f64,
    least: f64,
    most: f64,
}

impl Known {
    fn of(values: impl Iterator<Item = f32>) -> Self {
        let mut known = Self { count: 0, sum: 0.0, least: f64::NAN, most: f64::NAN };
        for value in values.map(f64::from).filter(|value| value.is_finite()) {
            (known.count, known.sum) = (known.count + 1, known.sum + value);
            (known.least, known.most) = (known.least.min(value), known.most.max(value));
        }
        known
    }

    /// NaN where there is none.
    fn mean(&self) -> f64 {
        self.sum / self.count as f64
    }
}
