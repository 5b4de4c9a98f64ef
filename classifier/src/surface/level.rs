//! One level of the surface: a grid of nodes, each in the middle of a square tile of columns.
//!
//! In: where the columns lie. Out: levels from coarse to fine, and the height between the nodes of one: bilinear
//! inside, continued outside. Metres from the raster's south-west corner and above the view's base.

use super::SurfaceConfig;
use super::thin_plate::Nodes;
use tsense_geometry::RasterShape;

/// A grid of nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// How many.
    pub nodes: Nodes,
    /// Distance between them, metres.
    pub node_m: f32,
}

impl Level {
    /// The levels of a raster: the finest is a whole number of columns wide, each coarser one twice the next.
    pub fn coarse_to_fine(shape: RasterShape, config: &SurfaceConfig) -> Vec<Self> {
        let mut cells = ((config.node_m / shape.cell_m).round() as usize).max(1);
        let mut levels = Vec::new();
        // A fifth more, so that a voxel size that does not divide the coarsest distance keeps that level.
        while levels.is_empty() || cells as f64 * shape.cell_m <= 1.2 * config.coarsest_m {
            let nodes = Nodes { width: shape.width.div_ceil(cells), height: shape.height.div_ceil(cells) };
            levels.push(Self { nodes, node_m: (cells as f64 * shape.cell_m) as f32 });
            cells *= 2;
        }
        levels.reverse();
        levels
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.width * self.nodes.height
    }

    /// The node whose tile holds a place.
    pub fn node_at(&self, x_m: f32, y_m: f32) -> usize {
        let along = |c: f32, count: usize| ((c / self.node_m) as usize).min(count - 1);
        along(y_m, self.nodes.height) * self.nodes.width + along(x_m, self.nodes.width)
    }

    /// The column of nodes before a place, and how far beyond it the place is, in distances of nodes.
    pub fn east_of(&self, x_m: f32) -> (usize, f32) {
        cell(x_m / self.node_m - 0.5, self.nodes.width)
    }

    /// The row of nodes before a place, and how far beyond it the place is.
    pub fn north_of(&self, y_m: f32) -> (usize, f32) {
        cell(y_m / self.node_m - 0.5, self.nodes.height)
    }

    /// Where a node is.
    pub fn place_of(&self, node: usize) -> [f32; 2] {
        [node % self.nodes.width, node / self.nodes.width].map(|i| (i as f32 + 0.5) * self.node_m)
    }
}

/// Heights of a level's nodes.
#[derive(Clone, Debug)]
pub struct Heights {
    /// Where the nodes are.
    pub level: Level,
    /// Heights, node by node, metres.
    pub height_m: Vec<f32>,
}

impl Heights {
    /// The height at a place.
    pub fn at(&self, x_m: f32, y_m: f32) -> f32 {
        self.between(self.level.east_of(x_m), self.level.north_of(y_m))
    }

    /// The height at a place between nodes.
    pub fn between(&self, (i, a): (usize, f32), (j, b): (usize, f32)) -> f32 {
        let Nodes { width, height } = self.level.nodes;
        let (east, north) = (usize::from(width > 1), if height > 1 { width } else { 0 });
        let z = &self.height_m[j * width + i..];
        let south_m = z[0] + (z[east] - z[0]) * a;
        let north_m = z[north] + (z[north + east] - z[north]) * a;
        south_m + (north_m - south_m) * b
    }

    /// The same surface on the nodes of another level.
    pub fn on(&self, level: Level) -> Self {
        let height_m = (0..level.len()).map(|node| level.place_of(node)).map(|[x, y]| self.at(x, y)).collect();
        Self { level, height_m }
    }
}

/// The first of the two nodes around a place in units of nodes, and how far beyond it the place is.
fn cell(at: f32, count: usize) -> (usize, f32) {
    // Casting cuts off towards zero, and gives zero for anything below.
    let first = (at as usize).min(count.saturating_sub(2));
    (first, if count > 1 { at - first as f32 } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_halve_from_the_coarsest_to_the_finest() {
        let shape = RasterShape { first_cell: [0, 0], width: 200, height: 100, cell_m: 0.15 };
        let levels = Level::coarse_to_fine(shape, &SurfaceConfig::default());
        let edges: Vec<_> = levels.iter().map(|level| (level.node_m * 10.0).round() as i32).collect();
        assert_eq!(edges, [48, 24, 12, 6, 3]);
        assert_eq!((levels[0].nodes.width, levels[0].nodes.height, levels[4].len()), (7, 4, 5000));
        assert_eq!(levels[4].node_at(29.99, 0.31), 100 + 99);
    }

    #[test]
    fn a_tilted_plane_is_the_same_between_beyond_and_on_finer_nodes() {
        let nodes = Nodes { width: 3, height: 2 };
        let level = Level { nodes, node_m: 2.0 };
        let plane = |[x, y]: [f32; 2]| 1.0 + 0.5 * x - 0.25 * y;
        let heights = Heights { level, height_m: (0..6).map(|node| plane(level.place_of(node))).collect() };
        for at in [[1.0, 1.0], [2.5, 1.7], [0.0, 0.0], [6.0, 4.0]] {
            assert!((heights.at(at[0], at[1]) - plane(at)).abs() < 1e-5, "{at:?}");
        }
        let fine = Level { nodes: Nodes { width: 12, height: 8 }, node_m: 0.5 };
        let heights = heights.on(fine);
        assert!((0..fine.len()).all(|node| (heights.height_m[node] - plane(fine.place_of(node))).abs() < 1e-5));
        let lone = Heights { level: Level { nodes: Nodes { width: 1, height: 1 }, node_m: 2.0 }, height_m: vec![3.0] };
        assert_eq!(lone.at(5.0, -1.0), 3.0);
    }
}
