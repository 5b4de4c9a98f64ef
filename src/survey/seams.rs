//! Things that lie across the borders of tiles: their parts wait until all neighbours are there, then they are one.
//!
//! In: the [`Part`]s of one tile after the other. Out: [`Thing`]s, each once. What waits is bounded by [`SIZE_MAX`]: where
//! a thing would be larger than that, it ends at a border of tiles.

use super::objects::Part;
use super::plan::{Plan, Tile};
use super::shapes::{Cell, Run, around};
use super::thing::Thing;
use std::collections::{BTreeMap, BTreeSet};
use tsense_contract::CellClass;
use tsense_geometry::RasterShape;

/// Most runs of cells that wait, 3 MB; to outline all of them takes some 60 MB.
const SIZE_MAX: usize = 250_000;

/// The parts that wait.
#[derive(Default)]
pub struct Seams {
    waiting: BTreeMap<u64, Waiting>,
    /// Cells that touch tiles to come, and whose they are.
    open: BTreeMap<Cell, (CellClass, u64)>,
    next: u64,
}

/// A part, and its cells that touch tiles to come.
struct Waiting {
    part: Part,
    open: Vec<Cell>,
}

impl Seams {
    /// Adds the parts of a tile and gives what is whole now; nothing for groups that are too small to be a thing.
    pub fn add(&mut self, parts: impl Iterator<Item = Part>, plan: &Plan, tile: &Tile) -> Vec<Option<Thing>> {
        let is_open = |cell: &Cell| around(*cell).any(|cell| plan.is_after(cell, tile.index));
        parts.for_each(|part| self.join(part, tile, is_open));
        self.open.retain(|cell, _| is_open(cell));
        self.waiting.values_mut().for_each(|waiting| waiting.open.retain(is_open));
        let closed = self.waiting.extract_if(.., |_, waiting| waiting.open.is_empty()).map(|(_, waiting)| waiting.part);
        let mut whole: Vec<Part> = closed.collect();
        whole.extend(self.too_large(SIZE_MAX));
        whole.iter().map(|part| part.thing(plan.shape.cell_m)).collect()
    }

    /// Adds a part, joined with all of its class that it touches in other tiles.
    fn join(&mut self, mut part: Part, tile: &Tile, is_open: impl Fn(&Cell) -> bool) {
        let edge = edge_cells(&part.runs, tile.core);
        let near = edge.iter().flat_map(|cell| around(*cell)).filter_map(|cell| self.open.get(&cell));
        let touched: BTreeSet<u64> = near.filter(|(class, _)| *class == part.class).map(|(_, id)| *id).collect();
        let mut open: Vec<Cell> = edge.into_iter().filter(is_open).collect();
        for other in touched.iter().filter_map(|id| self.waiting.remove(id)) {
            part.join(other.part);
            open.extend(other.open);
        }
        self.next += 1;
        self.open.extend(open.iter().map(|cell| (*cell, (part.class, self.next))));
        self.waiting.insert(self.next, Waiting { part, open });
    }

    /// Takes the largest parts out until the others are small enough together.
    fn too_large(&mut self, size_max: usize) -> Vec<Part> {
        let mut size: usize = self.waiting.values().map(|waiting| waiting.part.size()).sum();
        let mut taken = Vec::new();
        while size > size_max
            && let Some((&id, _)) = self.waiting.iter().max_by_key(|(_, waiting)| waiting.part.size())
            && let Some(Waiting { part, .. }) = self.waiting.remove(&id)
        {
            size -= part.size();
            self.open.retain(|_, (_, whose)| *whose != id);
            taken.push(part);
        }
        taken
    }
}

/// The cells of a group on the edge of a tile.
fn edge_cells(runs: &[Run], core: RasterShape) -> Vec<Cell> {
    let [west, south] = core.first_cell;
    let (east, north) = (west + core.width as i32 - 1, south + core.height as i32 - 1);
    let is_edge = |[row, column]: &Cell| *row == south || *row == north || *column == west || *column == east;
    let on_edge = runs.iter().filter(|run| run.row == south || run.row == north || run.from == west || run.to > east);
    on_edge.flat_map(|run| run.cells()).filter(is_edge).collect()
}

#[cfg(test)]
mod tests {
    use super::super::Extent;
    use super::super::input::Ray;
    use super::super::objects::Heights;
    use super::super::shapes::groups;
    use super::super::thing::Kind;
    use super::*;
    use tsense_geometry::{Point, Timestamp};

    /// A plot of cells of 1 m in tiles of 256.
    fn plan(width: f64, height: f64) -> Plan {
        let mut extent = Extent::default();
        for (x, y) in [(-299.5, 100.5), (width - 300.5, height + 99.5)] {
            let end = Point::new(x, y, 0.0);
            extent.add(&Ray { origin: end, end, is_return: true, stamp: Timestamp::from_ns(0) });
        }
        Plan::new(extent.space(1e4).unwrap(), 1.0, 256.0).unwrap()
    }

    type Drawing<'a> = &'a dyn Fn(Cell) -> CellClass;

    fn parts(cells: RasterShape, all: RasterShape, class_of: Drawing<'_>) -> Vec<Part> {
        let heights = |[row, column]: Cell| {
            let [x, y] = [column, row].map(f64::from);
            Some(Heights {
                class: class_of([row, column]),
                ground_m: 0.01 * x - 0.02 * y,
                ground_std_m: 0.5,
                low_m: 1.0 + 0.001 * y,
                high_m: 3.0 + 0.01 * x,
            })
        };
        let of = |class| {
            groups(cells, |cell| class_of(cell) == class)
                .into_iter()
                .map(move |runs| Part::of(class, runs, all, heights))
        };
        [CellClass::Drop, CellClass::Obstacle, CellClass::Brush].into_iter().flat_map(of).collect()
    }

    fn tiled(plan: &Plan, class_of: Drawing<'_>, seams: &mut Seams) -> Vec<Option<Thing>> {
        plan.tiles()
            .flat_map(|tile| seams.add(parts(tile.core, plan.shape, class_of).into_iter(), plan, &tile))
            .collect()
    }

    /// Squares and lines of several classes, many of them over borders, rings around corners of tiles, and noise.
    fn drawing([row, column]: Cell) -> CellClass {
        let (x, y) = (column + 300, row - 100);
        let noise = (x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663)).wrapping_mul(83_492_791) >> 27 & 31;
        match (x % 64, y % 64) {
            _ if ((x - 256).pow(2) + (y - 344).pow(2) - 90_i32.pow(2)).abs() < 500 => CellClass::Drop,
            (0..20, 0..9) if (x / 64 + y / 64) % 3 != 0 => CellClass::Brush,
            (40, _) => CellClass::Obstacle,
            (44..52, 50..58) => CellClass::Drop,
            _ if noise < 4 => CellClass::Brush,
            _ if noise == 5 => CellClass::Obstacle,
            _ => CellClass::Ground,
        }
    }

    #[test]
    fn things_over_the_borders_of_tiles_are_those_of_one_tile() {
        let plan = plan(700.0, 600.0);
        assert_eq!(plan.tile_counts(), [3, 3]);
        let mut seams = Seams::default();
        let whole: Vec<Option<Thing>> =
            parts(plan.shape, plan.shape, &drawing).iter().map(|part| part.thing(1.0)).collect();
        let tiled = tiled(&plan, &drawing, &mut seams);
        assert!(seams.waiting.is_empty() && seams.open.is_empty());
        // Tiles end their things in another order.
        let by_outline = |things: &[Option<Thing>]| {
            let mut things: Vec<Thing> = things.iter().flatten().cloned().collect();
            things.sort_by(|a, b| a.outline.partial_cmp(&b.outline).unwrap());
            things
        };
        let (mut compared, mut crossing) = (0, 0);
        assert_eq!(tiled.len(), whole.len(), "groups that are too small count, too");
        for (a, b) in by_outline(&whole).into_iter().zip(by_outline(&tiled)) {
            assert_eq!((a.kind, &a.outline, a.area_m2), (b.kind, &b.outline, b.area_m2));
            let figures = |thing: &Thing| [thing.length_width_m, thing.height_m, thing.ground_m].concat();
            for (a, b) in figures(&a).into_iter().zip(figures(&b)) {
                assert!((a - b).abs() < 1e-9, "{a} {b}");
            }
            compared += 1;
            crossing += usize::from(tile_count(&plan, &a) > 1);
        }
        assert!(compared > 200 && crossing > 30, "{compared}, {crossing} of them over borders");
        assert!(by_outline(&whole).iter().any(|thing| thing.kind == Kind::Drop && tile_count(&plan, thing) == 4));
    }

    fn tile_count(plan: &Plan, thing: &Thing) -> usize {
        let corners = || thing.outline.iter().flatten().flatten();
        let holds = |tile: &Tile| corners().any(|[x, y]| tile.core.cell_at(*x, *y).is_some());
        plan.tiles().filter(holds).count()
    }

    #[test]
    fn what_waits_is_bounded_and_a_thing_that_is_too_large_ends_at_a_border() {
        let plan = plan(700.0, 600.0);
        let comb = |[_, column]: Cell| if column % 2 == 0 { CellClass::Brush } else { CellClass::Ground };
        let parts = parts(plan.tile([0, 0]).core, plan.shape, &comb);
        let mut seams = Seams::default();
        assert!(seams.add(parts.into_iter(), &plan, &plan.tile([0, 0])).is_empty(), "all of it goes on in the south");
        let size = |seams: &Seams| seams.waiting.values().map(|waiting| waiting.part.size()).sum::<usize>();
        assert_eq!(size(&seams), 128 * 256);
        let taken = seams.too_large(100 * 256);
        assert_eq!((taken.len(), size(&seams), seams.open.len()), (28, 100 * 256, 100));
    }
}
