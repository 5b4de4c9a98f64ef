//! Where marks lie. Hits: a byte a voxel; a brick is a cache line, and a tile of 4 x 4 x 4 bricks a page of memory.
//! Misses: a bit a voxel, in rows of a tile's sixteen voxels along a beam's main axis; the sixteen rows of four
//! bricks in a line are a cache line. So a beam needs few of both, wherever it goes.
//!
//! The position of a mark or of a row is a sum of three parts, one for each axis: a few instructions, or a look into
//! a table.

use super::rows::LINE_ROWS;
use tsense_contract::{BRICK_EDGE, BRICK_VOXELS};

/// Voxels along the edge of a tile, and the bits of an index that count within it.
pub const TILE_EDGE: usize = 1 << TILE_BITS;
pub const TILE_BITS: u32 = 4;
pub const IN_TILE: i32 = TILE_EDGE as i32 - 1;

const IN_BRICK: i32 = BRICK_EDGE as i32 - 1;
/// Bricks of a tile: a bit of a word each.
pub const TILE_BRICKS: usize = (TILE_EDGE / BRICK_EDGE).pow(3);
/// Marks of a tile.
pub const TILE_VOXELS: usize = TILE_BRICKS * BRICK_VOXELS;
/// Rows of a tile along one axis, and the cache lines that hold them.
pub const TILE_ROWS: usize = TILE_EDGE * TILE_EDGE;
pub const TILE_LINES: usize = TILE_ROWS / LINE_ROWS;

/// Bits of the other axes that lie between an index' bits within a brick and those of its brick within the tile.
const HITS_GAP: u32 = 4;
const ROWS_GAP: u32 = 2;

/// How an index on one axis moves a position: from a tile to the next, and from a voxel of a brick to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stride<const GAP: u32> {
    tile: i32,
    voxel: i32,
}

/// Strides of the marks of hits, and of the rows of misses.
pub type HitStride = Stride<HITS_GAP>;
pub type RowStride = Stride<ROWS_GAP>;

impl<const GAP: u32> Stride<GAP> {
    /// The part of index `i`.
    #[inline(always)]
    pub fn at(self, i: i32) -> i32 {
        let within = i & IN_BRICK | (i & (IN_TILE - IN_BRICK)) << GAP;
        (i >> TILE_BITS).wrapping_mul(self.tile).wrapping_add(within.wrapping_mul(self.voxel))
    }

    /// The way from a tile to the next.
    #[inline(always)]
    pub fn tile(self) -> i32 {
        self.tile
    }

    /// The stride for indices `-1 - i` where the mask is all bits, and the part of index 0 then.
    #[inline(always)]
    pub fn turned(self, turn: i32) -> (Self, i32) {
        let sign = turn | 1;
        (Self { tile: self.tile * sign, voxel: self.voxel * sign }, self.at(-1) & turn)
    }
}

/// The tiles of a window, x fastest.
#[derive(Clone, Copy)]
pub struct Tiles(pub [usize; 3]);

impl Tiles {
    /// All of them.
    pub fn count(self) -> usize {
        self.0.iter().product()
    }

    /// From a tile to the next along each axis.
    pub fn steps(self) -> [usize; 3] {
        let [x, y, _] = self.0;
        [1, x, x * y]
    }

    /// The strides of marks of hits along x, y, z.
    pub fn hit_strides(self) -> [HitStride; 3] {
        let voxel = |axis: u32| BRICK_EDGE.pow(axis) as i32;
        let steps = self.steps();
        [0, 1, 2].map(|axis| Stride { tile: (steps[axis] * TILE_VOXELS) as i32, voxel: voxel(axis as u32) })
    }

    /// The strides of rows along `main`. On this axis only the tile counts; of the others, the first is the faster one.
    pub fn row_strides(self, main: usize) -> [RowStride; 3] {
        let steps = self.steps();
        let first_of_others = usize::from(main == 0);
        [0, 1, 2].map(|axis| {
            let voxel = match axis {
                axis if axis == main => 0,
                axis if axis == first_of_others => 1,
                _ => BRICK_EDGE as i32,
            };
            Stride { tile: (steps[axis] * TILE_ROWS) as i32, voxel }
        })
    }
}

/// Indices of a [`Steps`] table.
pub const STEPS: usize = 32;

/// What the indices from a tile's first on add to positions: a table, for processors that look up many at once.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Steps {
    /// The parts of the first indices.
    pub parts: [i32; STEPS],
    /// The way from a tile to the next.
    pub tile: i32,
    /// The part of index 0, which is `-1` on an axis that is turned round.
    pub zero: i32,
}

impl Steps {
    /// The tables of a stride, straight and turned round.
    pub fn both(stride: RowStride) -> [Self; 2] {
        [0, -1].map(|turn| {
            let (stride, zero) = stride.turned(turn);
            Self { parts: std::array::from_fn(|i| stride.at(i as i32)), tile: stride.tile, zero }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::{ARENA_BLOCKS_MAX, AXIS_VOXELS_MAX};
    use std::collections::HashSet;
    use tsense_contract::BLOCK_VOXELS;

    const TILES: Tiles = Tiles([2, 3, 2]);

    fn voxels() -> impl Iterator<Item = [i32; 3]> {
        (0..32).flat_map(|k| (0..48).flat_map(move |j| (0..32).map(move |i| [i, j, k])))
    }

    #[test]
    fn every_voxel_has_a_hit_mark_of_its_own_in_the_line_of_its_brick_and_the_page_of_its_tile() {
        let [x, y, z] = TILES.hit_strides();
        let (mut positions, mut bricks, mut tiles) = (HashSet::new(), HashSet::new(), HashSet::new());
        for [i, j, k] in voxels() {
            let position = x.at(i) + y.at(j) + z.at(k);
            positions.insert(position);
            bricks.insert((position / BRICK_VOXELS as i32, [i / 4, j / 4, k / 4]));
            tiles.insert((position / TILE_VOXELS as i32, [i / 16, j / 16, k / 16]));
        }
        assert_eq!((positions.len(), positions.iter().max()), (12 * TILE_VOXELS, Some(&(12 * TILE_VOXELS as i32 - 1))));
        assert_eq!((bricks.len(), tiles.len()), (12 * TILE_BRICKS, 12));
    }

    #[test]
    fn every_voxel_has_a_bit_of_its_own_in_the_rows_of_each_axis_and_a_line_of_its_four_bricks() {
        for main in 0..3 {
            let [x, y, z] = TILES.row_strides(main);
            let (mut bits, mut lines, mut tiles) = (HashSet::new(), HashSet::new(), HashSet::new());
            for voxel @ [i, j, k] in voxels() {
                let position = x.at(i) + y.at(j) + z.at(k);
                bits.insert((position, voxel[main] & IN_TILE));
                let mut four_bricks = voxel.map(|i| i / 4);
                four_bricks[main] /= 4;
                lines.insert((position / LINE_ROWS as i32, four_bricks));
                tiles.insert((position / TILE_ROWS as i32, voxel.map(|i| i / 16)));
            }
            assert_eq!((bits.len(), lines.len(), tiles.len()), (12 * TILE_VOXELS, 12 * TILE_LINES, 12));
        }
    }

    #[test]
    fn positions_of_every_window_that_may_be_configured_are_below_2_to_the_31() {
        let tiles = |blocks: usize, axis: usize| (blocks * BLOCK_VOXELS[axis]).div_ceil(TILE_EDGE);
        let [x_max, y_max, z_max] = BLOCK_VOXELS.map(|voxels| AXIS_VOXELS_MAX / voxels);
        let windows =
            (1..=x_max).flat_map(|x| (1..=y_max).map(move |y| [x, y, (ARENA_BLOCKS_MAX / (x * y)).min(z_max)]));
        let most = windows.map(|[x, y, z]| tiles(x, 0) * tiles(y, 1) * tiles(z, 2)).max().unwrap();
        assert!(most * TILE_VOXELS.max(3 * TILE_ROWS) < 1 << 31, "{most} tiles");
    }

    #[test]
    fn steps_lead_from_index_to_index_on_axes_that_are_turned_too() {
        for stride in Tiles([5, 3, 2]).row_strides(1) {
            let (turned, zero) = stride.turned(-1);
            for i in 0..64 {
                assert_eq!(zero + turned.at(-1 - i), stride.at(i), "{i}");
            }
            let tables = Steps::both(stride);
            for i in 0..STEPS as i32 {
                assert_eq!([stride, turned].map(|stride| stride.at(i)), tables.map(|table| table.parts[i as usize]));
            }
            assert_eq!((tables[0].zero, tables[1].zero), (0, zero));
        }
    }
}
