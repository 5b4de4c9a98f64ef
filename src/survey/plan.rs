//! The plan of a survey: the raster over the whole plot, and the tiles that are surveyed one after the other.
//!
//! In: where the rays are, how far the map reaches, how large a tile may be. Out: one raster shape, aligned with the
//! voxels, and [`Tile`]s: cores that cover it without overlap, each with a margin around it that its neighbours know,
//! too. A tile's results are taken from its core only. What one tile needs bounds the memory of a survey.

use super::extent::Corners;
use super::shapes::Cell;
use tsense_geometry::{Global, Point, RasterShape};

/// Edge of the square blocks of the raster files, cells; tiles are made of whole ones.
pub const BLOCK_CELLS: usize = 256;
/// Width of the margin around a tile's core, metres: what stands farther away than this changes no result in the core by
/// more than the tolerance stated in `docs/survey.md`.
pub const MARGIN_M: f64 = 12.0;
/// A plot that is not longer than this many tiles along either axis is not cut.
const UNCUT_TILES: f64 = 1.5;
/// Most cells along an axis: 30 km at 0.15 m. More than that comes from a stray ray.
pub const CELLS_MAX: usize = 200_000;

/// A part of the plot that is surveyed on its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tile {
    /// Its place in the raster, counted from west and from north.
    pub index: [usize; 2],
    /// The cells that its results are for.
    pub core: RasterShape,
    /// The core and the cells of the plot in its margin.
    pub around: RasterShape,
    /// Corners of the core with its margin, metres: low easting, low northing, high easting, high northing.
    pub around_m: [f64; 4],
}

/// How a plot is cut.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// All cells.
    pub shape: RasterShape,
    /// The lowest corner of the plot, metres.
    pub low_m: [f64; 3],
    /// Edge of a tile, cells: whole blocks.
    pub tile_cells: usize,
}

/// The plot is longer than a raster may be, metres along east and north.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TooLong(pub [f64; 2]);

impl Plan {
    /// The plan of a plot between two corners, in tiles of about `tile_m`.
    pub fn new((low, high): Corners, cell_m: f64, tile_m: f64) -> Result<Self, TooLong> {
        let ([west, south, _], [east, north, _]) = (low.to_array(), high.to_array());
        let span_m = [east - west, north - south].map(|m| m.max(0.0));
        if span_m.iter().any(|m| m / cell_m >= CELLS_MAX as f64) {
            return Err(TooLong(span_m));
        }
        let first_cell = [west, south].map(|c| (c / cell_m).floor() as i32);
        let cells = |to: f64, first: i32| ((to / cell_m).floor() as i32 - first + 1).max(1) as usize;
        let (width, height) = (cells(east, first_cell[0]), cells(north, first_cell[1]));
        let shape = RasterShape { first_cell, width, height, cell_m };
        let tile_cells = ((tile_m / cell_m / BLOCK_CELLS as f64).round() as usize).max(1) * BLOCK_CELLS;
        let is_one = width.max(height) as f64 <= UNCUT_TILES * tile_cells as f64;
        let whole = width.max(height).div_ceil(BLOCK_CELLS) * BLOCK_CELLS;
        Ok(Self { shape, low_m: low.to_array(), tile_cells: if is_one { whole } else { tile_cells } })
    }

    /// Tiles from west to east and from north to south.
    pub fn tile_counts(&self) -> [usize; 2] {
        [self.shape.width, self.shape.height].map(|cells| cells.div_ceil(self.tile_cells))
    }

    /// Number of tiles.
    pub fn tile_count(&self) -> usize {
        self.tile_counts().iter().product()
    }

    /// The tile at a place, counted from west and from north.
    pub fn tile(&self, index: [usize; 2]) -> Tile {
        let RasterShape { first_cell, width, height, cell_m } = self.shape;
        let from = index.map(|i| i * self.tile_cells);
        let (columns, rows) = (self.tile_cells.min(width - from[0]), self.tile_cells.min(height - from[1]));
        // Blocks of images are counted from the north, rows of rasters from the south.
        let south = height - from[1] - rows;
        let first_cell = [first_cell[0] + from[0] as i32, first_cell[1] + south as i32];
        let core = RasterShape { first_cell, width: columns, height: rows, cell_m };
        let low = first_cell.map(|cell| f64::from(cell) * cell_m - MARGIN_M);
        let size = [columns, rows].map(|cells| cells as f64 * cell_m + 2.0 * MARGIN_M);
        let around = within(core, (MARGIN_M / cell_m) as i32, self.shape);
        Tile { index, core, around, around_m: [low[0], low[1], low[0] + size[0], low[1] + size[1]] }
    }

    /// Whether a cell of the plot belongs to a tile that comes after another one.
    pub fn is_after(&self, [row, column]: Cell, [i, j]: [usize; 2]) -> bool {
        let [east, north] =
            [(column, 0), (row, 1)].map(|(at, axis)| i64::from(at) - i64::from(self.shape.first_cell[axis]));
        let (width, height) = (self.shape.width as i64, self.shape.height as i64);
        let inside = (0..width).contains(&east) && (0..height).contains(&north);
        let tile = |cells: i64| cells / self.tile_cells as i64;
        inside && (tile(height - 1 - north), tile(east)) > (j as i64, i as i64)
    }

    /// All tiles, row by row from the north-west.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + '_ {
        let [across, down] = self.tile_counts();
        (0..down).flat_map(move |j| (0..across).map(move |i| self.tile([i, j])))
    }

    /// The tiles that a way from one point to another touches, their margins included.
    pub fn tiles_along(&self, from: Point<Global>, to: Point<Global>) -> impl Iterator<Item = [usize; 2]> + '_ {
        let (from, to) = (from.to_array(), to.to_array());
        let RasterShape { first_cell, height, cell_m, .. } = self.shape;
        let tile_m = self.tile_cells as f64 * cell_m;
        let west = f64::from(first_cell[0]) * cell_m;
        let north = (f64::from(first_cell[1]) + height as f64) * cell_m;
        let counts = self.tile_counts();
        let range = |a: f64, b: f64, count: usize| {
            let (low, high) = (a.min(b) - MARGIN_M, a.max(b) + MARGIN_M);
            // Casts saturate: what lies outside ends at the border.
            (low / tile_m).floor().max(0.0) as usize..((high / tile_m).floor() + 1.0).clamp(0.0, count as f64) as usize
        };
        let columns = range(from[0] - west, to[0] - west, counts[0]);
        let rows = range(north - from[1], north - to[1], counts[1]);
        rows.flat_map(move |j| columns.clone().map(move |i| [i, j]))
            .filter(move |index| crosses([from[0], from[1]], [to[0], to[1]], self.tile(*index).around_m))
    }
}

/// A raster with so many more cells on all sides, as far as another one reaches.
fn within(core: RasterShape, more: i32, all: RasterShape) -> RasterShape {
    let low = [0, 1].map(|axis| (core.first_cell[axis] - more).max(all.first_cell[axis]));
    let end = |shape: RasterShape, axis: usize| shape.first_cell[axis] + [shape.width, shape.height][axis] as i32;
    let [width, height] = [0, 1].map(|axis| ((end(core, axis) + more).min(end(all, axis)) - low[axis]) as usize);
    RasterShape { first_cell: low, width, height, ..core }
}

/// Whether a line between two places crosses a box.
fn crosses(from: [f64; 2], to: [f64; 2], [west, south, east, north]: [f64; 4]) -> bool {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for (a, b, low, high) in [(from[0], to[0], west, east), (from[1], to[1], south, north)] {
        if a == b {
            if a < low || a > high {
                return false;
            }
            continue;
        }
        let ends = [(low - a) / (b - a), (high - a) / (b - a)];
        enter = enter.max(ends[0].min(ends[1]));
        leave = leave.min(ends[0].max(ends[1]));
    }
    enter <= leave
}

#[cfg(test)]
mod tests {
    use super::super::Extent;
    use super::super::input::Ray;
    use super::*;
    use tsense_geometry::Timestamp;

    fn plan(size_m: [f64; 2], tile_m: f64) -> Plan {
        let mut extent = Extent::default();
        for (x, y) in [(1000.01, 2000.01), (1000.0 + size_m[0] - 0.01, 2000.0 + size_m[1] - 0.01)] {
            let end = Point::new(x, y, 0.0);
            extent.add(&Ray { origin: end, end, is_return: true, stamp: Timestamp::from_ns(0) });
        }
        Plan::new(extent.space(30.0).unwrap(), 0.1, tile_m).unwrap()
    }

    #[test]
    fn tiles_cover_every_cell_once_and_a_small_plot_is_one() {
        assert_eq!(plan([70.0, 20.0], 51.2).tile_count(), 1);
        let plan = plan([180.0, 60.0], 51.2);
        assert_eq!((plan.shape.width, plan.shape.height, plan.tile_counts()), (1800, 600, [4, 2]));
        let mut seen = vec![0; plan.shape.len()];
        for tile in plan.tiles() {
            for row in 0..tile.core.height {
                for column in 0..tile.core.width {
                    let [x, y] = tile.core.center_of(column, row);
                    let (column, row) = plan.shape.cell_at(x, y).unwrap();
                    seen[row * plan.shape.width + column] += 1;
                }
            }
        }
        assert!(seen.iter().all(|times| *times == 1));
        assert_eq!(plan.tile([0, 0]).core.first_cell[1], 20_000 + 600 - 512, "the first tile is the north-western one");
    }

    /// The plain version asks every tile.
    #[test]
    fn a_ray_finds_the_tiles_whose_margins_it_crosses() {
        let plan = plan([400.0, 300.0], 51.2);
        let mut compared = 0;
        for i in 0..200 {
            let at = |k: usize| (i * 37 + k * 101) as f64 * 7.7;
            let (from, to) = (
                Point::new(1000.0 + at(1) % 400.0, 2000.0 + at(2) % 300.0, 0.0),
                Point::new(900.0 + at(3) % 600.0, 1900.0 + at(4) % 500.0, 0.0),
            );
            let (a, b) = ([from.x(), from.y()], [to.x(), to.y()]);
            let expected: Vec<_> = plan.tiles().filter(|t| crosses(a, b, t.around_m)).map(|t| t.index).collect();
            assert_eq!(plan.tiles_along(from, to).collect::<Vec<_>>(), expected);
            compared += expected.len();
        }
        assert!(compared > 500, "{compared}");
    }
}
