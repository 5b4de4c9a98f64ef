//! Where the marks of voxels lie: a brick is a cache line, and a tile of 4 x 4 x 4 bricks a page of memory, so that a beam
//! needs few of both, wherever it goes.
//!
//! The position of a mark is a sum of three parts, one for each axis: a few instructions, or a look into a table.

use crate::evidence::Marks;
use crate::slab::{mask, select};
use tsense_contract::{BRICK_EDGE, BRICK_VOXELS};

/// Voxels along the edge of a tile, and the bits of an index that count within it.
pub const TILE_EDGE: usize = 1 << TILE_BITS;
pub const TILE_BITS: u32 = 4;
pub const IN_TILE: i32 = TILE_EDGE as i32 - 1;

const IN_BRICK: i32 = BRICK_EDGE as i32 - 1;
/// Bricks of a tile: a bit of a word each.
const TILE_BRICKS: usize = (TILE_EDGE / BRICK_EDGE).pow(3);
/// Marks of a tile.
pub const TILE_VOXELS: usize = TILE_BRICKS * BRICK_VOXELS;

/// Marks of a tile's bricks, x fastest.
#[repr(C, align(4096))]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Tile(pub [Marks; TILE_BRICKS]);

impl Tile {
    /// A bit for each brick that has marks.
    #[inline(always)]
    pub fn marked_bricks(&self) -> u64 {
        let mut bricks = 0;
        for (brick, marks) in self.0.iter().enumerate() {
            bricks |= u64::from(!marks.are_empty()) << brick;
        }
        bricks
    }
}

/// How a voxel's index on one axis moves its mark: from a tile to the next, and from a voxel of a brick to the next. From a
/// brick of a tile to the next it is a brick's marks as many times as that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    tile: i32,
    voxel: i32,
}

impl Stride {
    /// The strides of x, y, z for so many tiles along each, x fastest.
    pub fn of([x, y, _]: [usize; 3]) -> [Self; 3] {
        let tiles = [1, x, x * y];
        std::array::from_fn(|axis| Self {
            tile: (tiles[axis] * TILE_VOXELS) as i32,
            voxel: BRICK_EDGE.pow(axis as u32) as i32,
        })
    }

    /// The part of index `i`.
    #[inline(always)]
    pub fn at(self, i: i32) -> i32 {
        // A brick has 4 voxels on an axis and 64 in all: its bits move up by the four that lie between.
        let within = i & IN_BRICK | (i & (IN_TILE - IN_BRICK)) << 4;
        (i >> TILE_BITS).wrapping_mul(self.tile).wrapping_add(within.wrapping_mul(self.voxel))
    }

    /// The way from index `i` to the next.
    #[inline(always)]
    pub fn next(self, i: i32) -> i32 {
        let [ends_brick, ends_tile] = [IN_BRICK, IN_TILE].map(|bits| mask(i & bits == bits));
        let from = |last: i32| self.at(last + 1).wrapping_sub(self.at(last));
        select(ends_brick, select(ends_tile, from(IN_TILE), from(IN_BRICK)), self.voxel)
    }

    /// The stride for indices `-1 - i` where the mask is all bits, and the part of index 0 then.
    #[inline(always)]
    pub fn turned(self, turn: i32) -> (Self, i32) {
        let sign = turn | 1;
        (Self { tile: self.tile * sign, voxel: self.voxel * sign }, self.at(-1) & turn)
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
    /// The table of a stride.
    pub fn new(stride: Stride, is_turned: bool) -> Self {
        let (stride, zero) = stride.turned(mask(is_turned));
        Self { parts: std::array::from_fn(|i| stride.at(i as i32)), tile: stride.tile, zero }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::{ARENA_BLOCKS_MAX, AXIS_VOXELS_MAX};
    use std::collections::HashSet;
    use tsense_contract::BLOCK_VOXELS;

    #[test]
    fn every_voxel_has_a_mark_of_its_own_in_the_line_of_its_brick_and_the_page_of_its_tile() {
        let [x, y, z] = Stride::of([2, 3, 2]);
        let (mut positions, mut bricks, mut tiles) = (HashSet::new(), HashSet::new(), HashSet::new());
        for k in 0..32 {
            for j in 0..48 {
                for i in 0..32 {
                    let position = x.at(i) + y.at(j) + z.at(k);
                    positions.insert(position);
                    bricks.insert((position / BRICK_VOXELS as i32, [i / 4, j / 4, k / 4]));
                    tiles.insert((position / TILE_VOXELS as i32, [i / 16, j / 16, k / 16]));
                }
            }
        }
        assert_eq!((positions.len(), positions.iter().max()), (12 * TILE_VOXELS, Some(&(12 * TILE_VOXELS as i32 - 1))));
        assert_eq!((bricks.len(), tiles.len()), (12 * TILE_BRICKS, 12));
    }

    #[test]
    fn positions_of_every_window_that_may_be_configured_are_below_2_to_the_31() {
        let tiles = |blocks: usize, axis: usize| (blocks * BLOCK_VOXELS[axis]).div_ceil(TILE_EDGE);
        let [x_max, y_max, z_max] = BLOCK_VOXELS.map(|voxels| AXIS_VOXELS_MAX / voxels);
        let windows =
            (1..=x_max).flat_map(|x| (1..=y_max).map(move |y| [x, y, (ARENA_BLOCKS_MAX / (x * y)).min(z_max)]));
        let most = windows.map(|[x, y, z]| tiles(x, 0) * tiles(y, 1) * tiles(z, 2)).max().unwrap();
        assert!(most * TILE_VOXELS < 1 << 31, "{most} tiles");
    }

    #[test]
    fn steps_lead_from_index_to_index_on_axes_that_are_turned_too() {
        for stride in Stride::of([5, 3, 2]) {
            let (turned, zero) = stride.turned(-1);
            let tables = [false, true].map(|is_turned| Steps::new(stride, is_turned));
            for i in 0..64 {
                assert_eq!(stride.at(i) + stride.next(i), stride.at(i + 1), "{i}");
                assert_eq!(zero + turned.at(-1 - i), stride.at(i), "{i}");
            }
            for i in 0..STEPS as i32 {
                assert_eq!([stride, turned].map(|stride| stride.at(i)), tables.map(|table| table.parts[i as usize]));
            }
        }
    }
}
