//! A tile's misses, taken out of the rows, brick by brick.

use super::layout::TILE_BRICKS;
use crate::evidence::LEVELS;
use tsense_contract::BRICK_EDGE;
use tsense_geometry::VoxelIndex;

/// The misses of a tile.
pub struct TakenTile {
    /// Which one.
    pub(super) tile: usize,
    /// Its first voxel, counted from the window's first.
    pub(super) first: VoxelIndex,
    /// A bit for each brick that has misses.
    pub(super) bricks: u64,
    /// For each weight, a word for each brick; of the others none.
    pub(super) words: [[u64; TILE_BRICKS]; LEVELS],
}

impl TakenTile {
    /// No tile.
    pub fn none() -> Self {
        Self { tile: 0, first: [0; 3], bricks: 0, words: [[0; TILE_BRICKS]; LEVELS] }
    }

    /// Bricks that have misses, a bit each.
    #[inline(always)]
    pub fn bricks(&self) -> u64 {
        self.bricks
    }

    /// The tile behind it.
    #[inline(always)]
    pub fn next(&self) -> usize {
        self.tile + 1
    }

    /// The first voxel of a brick.
    #[inline(always)]
    pub fn voxel(&self, brick: usize) -> VoxelIndex {
        let [x, y, z] = self.first;
        let part = |bits: u32| (brick >> bits) as i32 % BRICK_EDGE as i32 * BRICK_EDGE as i32;
        [x + part(0), y + part(2), z + part(4)]
    }
}

/// Takes the lowest bit out of a word: which one it is.
#[inline(always)]
pub fn take_lowest(word: &mut u64) -> Option<usize> {
    let lowest = word.trailing_zeros() as usize;
    *word &= word.wrapping_sub(1);
    (lowest < u64::BITS as usize).then_some(lowest)
}
