//! Columns of a metre: what a ray may meet over each square metre, so that it asks only the things near it.
//!
//! Each column lists its things and how high they and the ground reach. Lists lie back to back in one array.

use super::Scene;
use super::shapes::Ellipsoid;
use super::terrain::{HALF_EXTENT_M, NODE_M, Terrain};
use nalgebra::Vector3;

/// Edge of a column, metres.
pub(crate) const COLUMN_M: f64 = 1.0;
/// Columns along an edge of the scene.
pub(crate) const COLUMNS: usize = (2.0 * HALF_EXTENT_M / COLUMN_M) as usize;
/// Ground cells along an edge of a column.
pub(crate) const CELLS_PER_COLUMN: usize = (COLUMN_M / NODE_M) as usize;

/// Something in a column, by its index in the scene's list of its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Item {
    Trunk(u32),
    Crown(u32),
    Bush(u32),
    Rock(u32),
    Wall(u32),
}

/// How high things reach in a column, metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column {
    pub first: u32,
    pub last: u32,
    /// Highest ground or grass.
    pub ground_top_m: f32,
    /// Lowest and highest of the things.
    pub low_m: f32,
    pub high_m: f32,
}

/// All columns of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Columns {
    columns: Vec<Column>,
    items: Vec<Item>,
    /// Nothing in the scene is higher, metres.
    pub top_m: f64,
}

type Bounds = [Vector3<f64>; 2];

impl Columns {
    /// The columns of a scene.
    pub fn new(scene: &Scene) -> Self {
        let mut lists: Vec<Vec<(Item, Bounds)>> = vec![Vec::new(); COLUMNS * COLUMNS];
        for (item, bounds) in items_of(scene) {
            spread(&mut lists, item, bounds);
        }
        let mut out = Self { top_m: f64::NEG_INFINITY, ..Self::default() };
        for (i, list) in lists.into_iter().enumerate() {
            let first = out.items.len() as u32;
            let ground_top_m = ground_top(&scene.terrain, i % COLUMNS, i / COLUMNS);
            let (mut low_m, mut high_m) = (f64::INFINITY, f64::NEG_INFINITY);
            for (item, [low, high]) in list {
                (low_m, high_m) = (low_m.min(low.z), high_m.max(high.z));
                out.items.push(item);
            }
            out.top_m = out.top_m.max(ground_top_m).max(high_m);
            // Rounded outwards: a single precision float must not cut a thing's top off.
            let (low_m, high_m) = ((low_m - 0.01) as f32, (high_m + 0.01) as f32);
            let ground_top_m = (ground_top_m + 0.01) as f32;
            out.columns.push(Column { first, last: out.items.len() as u32, ground_top_m, low_m, high_m });
        }
        out
    }

    /// A column; both indices below [`COLUMNS`].
    #[inline]
    pub fn column(&self, i: usize, j: usize) -> &Column {
        &self.columns[j * COLUMNS + i]
    }

    /// The things of a column.
    #[inline]
    pub fn items(&self, column: &Column) -> &[Item] {
        &self.items[column.first as usize..column.last as usize]
    }
}

fn items_of(scene: &Scene) -> Vec<(Item, Bounds)> {
    let round = |body: &Ellipsoid| body.bounds();
    let mut items = Vec::new();
    for (i, tree) in scene.trees.iter().enumerate() {
        items.push((Item::Trunk(i as u32), tree.trunk.bounds()));
        items.push((Item::Crown(i as u32), round(&tree.crown.body)));
    }
    items.extend(scene.bushes.iter().enumerate().map(|(i, b)| (Item::Bush(i as u32), round(&b.body))));
    items.extend(scene.rocks.iter().enumerate().map(|(i, r)| (Item::Rock(i as u32), round(&r.body))));
    items.extend(scene.walls.iter().enumerate().map(|(i, w)| (Item::Wall(i as u32), w.body.bounds())));
    items
}

fn spread(lists: &mut [Vec<(Item, Bounds)>], item: Item, bounds: Bounds) {
    let index = |c: f64| ((c + HALF_EXTENT_M) / COLUMN_M).clamp(0.0, (COLUMNS - 1) as f64) as usize;
    let [low, high] = bounds;
    for j in index(low.y)..=index(high.y) {
        for i in index(low.x)..=index(high.x) {
            lists[j * COLUMNS + i].push((item, bounds));
        }
    }
}

fn ground_top(terrain: &Terrain, i: usize, j: usize) -> f64 {
    let mut top_m = f64::NEG_INFINITY;
    for row in 0..CELLS_PER_COLUMN {
        for column in 0..CELLS_PER_COLUMN {
            top_m = top_m.max(terrain.patch(i * CELLS_PER_COLUMN + column, j * CELLS_PER_COLUMN + row).top_m);
        }
    }
    top_m
}
