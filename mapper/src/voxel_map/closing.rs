//! The end of a window of evidence: its marks become occupancy and confidence.

use super::{Rule, VoxelMap};
use crate::ahead;
use crate::clip::Space;
use crate::marks::{TakenTile, take_lowest};
use crate::trace::{Walk, Work};
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK};

impl VoxelMap {
    /// Ends a window of evidence: voxels that beams only passed lose, all marks go.
    pub fn close_window(&mut self) {
        self.take_back_overruled();
        self.instruction_set.run(Closing(self));
        self.marks.leave();
        self.blocks.iter_mut().for_each(|block| block.marked = false);
        self.entered = Space::EMPTY;
    }

    /// The marks are taken as they lie in memory, for that is how they are fetched fastest, and the voxels of a tile are
    /// sent for while those of the one before lose. No closures: they would not be compiled for the instruction set.
    #[inline(always)]
    fn apply_marks(&mut self) {
        let (mut tile, mut next) = (TakenTile::none(), TakenTile::none());
        let mut is_one_more = self.marks.take_tile(0, &mut next);
        while is_one_more {
            std::mem::swap(&mut tile, &mut next);
            is_one_more = self.marks.take_tile(tile.next(), &mut next);
            self.apply_tile(&mut tile, &next);
        }
    }

    /// Sends for a brick of the next tile with each of this one, for the memory takes so many orders at once.
    #[inline(always)]
    fn apply_tile(&mut self, tile: &mut TakenTile, next: &TakenTile) {
        let (mut bricks, mut ahead) = (tile.bricks(), next.bricks());
        while let Some(brick) = take_lowest(&mut bricks) {
            if let Some(brick) = take_lowest(&mut ahead) {
                ahead::fetch(&self.bricks[self.brick_at(next, brick)]);
            }
            let (at, passed) = (self.brick_at(tile, brick), self.marks.take_brick(tile, brick));
            let state = &mut self.bricks[at].0;
            let changed = match &mut self.rule {
                Rule::Steps(steps) => steps.misses(state, &passed),
                Rule::Ratio(ratio, counters) => ratio.misses(&mut counters[at], state, &passed),
            };
            if changed {
                self.blocks[at / BRICKS_PER_BLOCK].dirty.insert(at % BRICKS_PER_BLOCK);
            }
        }
        while let Some(brick) = take_lowest(&mut ahead) {
            ahead::fetch(&self.bricks[self.brick_at(next, brick)]);
        }
    }

    /// Where the voxels of a tile's brick are.
    #[inline(always)]
    fn brick_at(&self, tile: &TakenTile, brick: usize) -> usize {
        self.position_in_window(tile.voxel(brick)) / BRICK_VOXELS
    }
}

/// The end of a window of evidence on one instruction set.
struct Closing<'a>(&'a mut VoxelMap);

impl Work for Closing<'_> {
    type Out = ();

    #[inline(always)]
    fn on<W: Walk>(self) {
        self.0.apply_marks();
    }
}
