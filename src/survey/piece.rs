//! What was found in one tile: the results of the chain, and which of their cells are the tile's own.
//!
//! The chain's rasters cover whole blocks of voxels, more than the tile with its margin; a [`Piece`] gives the cells of
//! the core, row by row from the south-west, in the index of those rasters.

use super::objects::walls;
use super::plan::Tile;
use super::shapes::{Cell, around};
use super::slope::slope_deg;
use std::collections::BTreeSet;
use tsense_classifier::Classification;
use tsense_contract::Detection;
use tsense_geometry::{Raster, RasterShape};

/// The results of a tile.
pub struct Piece {
    /// The tile's own cells.
    pub core: RasterShape,
    /// Its own cells and those of its margin.
    pub around: RasterShape,
    /// What the chain found, in the tile and around it.
    pub found: Classification,
    /// Steepness of the ground, degrees; NaN where the ground is unknown.
    pub slope_deg: Raster<f32>,
    /// Cells with a wall in them or beside them.
    walls: BTreeSet<Cell>,
}

impl Piece {
    /// The results for a tile.
    pub fn new(tile: &Tile, found: Classification) -> Self {
        let slope_deg = slope_deg(&found.ground.height_m);
        let piece = Self { core: tile.core, around: tile.around, found, slope_deg, walls: BTreeSet::new() };
        let walls = walls(&piece).flat_map(around).collect();
        Self { walls, ..piece }
    }

    /// Whether there is a wall in a cell of the core, by column and row, or beside it.
    pub fn is_wall(&self, (column, row): (usize, usize)) -> bool {
        let [west, south] = self.core.first_cell;
        !self.walls.is_empty() && self.walls.contains(&[south + row as i32, west + column as i32])
    }

    /// Height of the ground at a place above the ground's base, metres, between the centres of four known cells.
    pub fn ground_at(&self, easting_m: f64, northing_m: f64) -> Option<f64> {
        let heights = &self.found.ground.height_m;
        let shape = heights.shape();
        let along = |at: f64, axis: usize| at / shape.cell_m - f64::from(shape.first_cell[axis]) - 0.5;
        let (x, y) = (along(easting_m, 0), along(northing_m, 1));
        let (column, row) = (x.floor(), y.floor());
        if column < 0.0 || row < 0.0 {
            return None;
        }
        let at = |dx: usize, dy: usize| heights.get(column as usize + dx, row as usize + dy).map(|z| f64::from(*z));
        let (right, up) = (x - column, y - row);
        let south = at(0, 0)? * (1.0 - right) + at(1, 0)? * right;
        let north = at(0, 1)? * (1.0 - right) + at(1, 1)? * right;
        Some(south * (1.0 - up) + north * up).filter(|z| z.is_finite())
    }

    /// The index in the chain's rasters of a cell of the core; nothing where no beam came so far.
    pub fn cell(&self, i: usize) -> Option<usize> {
        self.cell_of((i % self.core.width, i / self.core.width))
    }

    /// The same by column and row.
    pub fn cell_of(&self, (column, row): (usize, usize)) -> Option<usize> {
        let [west, south] = self.core.first_cell;
        self.index_of([south + row as i32, west + column as i32])
    }

    /// The same by row and column as the coordinates count them, in the core and around it.
    pub fn index_of(&self, [row, column]: Cell) -> Option<usize> {
        let all = self.found.ground.height_m.shape();
        let (x, y) = (i64::from(column) - i64::from(all.first_cell[0]), i64::from(row) - i64::from(all.first_cell[1]));
        let inside = (0..all.width as i64).contains(&x) && (0..all.height as i64).contains(&y);
        inside.then(|| y as usize * all.width + x as usize)
    }

    /// Whether a place belongs to the core.
    pub fn holds(&self, easting_m: f64, northing_m: f64) -> bool {
        self.core.cell_at(easting_m, northing_m).is_some()
    }

    /// Trees of the core and those that stand no farther outside than `over_m`: neighbours may see them a little apart.
    pub fn trees(&self, over_m: f64) -> impl Iterator<Item = &Detection> {
        let [west, south] = self.core.first_cell.map(|cell| f64::from(cell) * self.core.cell_m - over_m);
        let [width, height] = [self.core.width, self.core.height].map(|n| n as f64 * self.core.cell_m + 2.0 * over_m);
        self.found.trees.iter().filter(move |tree| {
            (0.0..width).contains(&(tree.easting_m - west)) && (0.0..height).contains(&(tree.northing_m - south))
        })
    }

    /// Height of the highest thing of a column above its ground, metres: 0 where nothing stands, NaN where the ground is
    /// unknown.
    pub fn canopy_m(&self, i: usize) -> f32 {
        let height_m = self.found.columns.height_m.cells()[i];
        match (self.found.ground.height_m.cells()[i].is_nan(), height_m.is_nan()) {
            (true, _) => f32::NAN,
            (false, true) => 0.0,
            // The voxel of the ground's surface is the ground's own.
            (false, false) if f64::from(height_m) <= self.core.cell_m => 0.0,
            (false, false) => height_m,
        }
    }
}
