//! The end of a window of evidence: its marks become occupancy and confidence.

use super::{Rule, VoxelMap};
use crate::ahead;
use crate::clip::Space;
use crate::evidence::NOTHING;
use crate::marks::MarkedTile;
use crate::trace::{Walk, Work};
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK};

impl VoxelMap {
    /// Ends a window of evidence: voxels that beams only passed lose, all marks go.
    pub fn close_window(&mut self) {
        self.take_back_overruled();
        self.marks.protect_hits();
        self.instruction_set.run(Closing(self));
        self.marks.leave();
        self.blocks.iter_mut().for_each(|block| block.marked = false);
        self.entered = Space::EMPTY;
    }

    /// The marks are taken as they lie in memory, for that is how they are fetched fastest, and the voxels of a tile are
    /// sent for while those of the one before lose. No closures: they would not be compiled for the instruction set.
    #[inline(always)]
    fn apply_marks(&mut self) {
        let mut next = self.marks.marked_tile(0);
        while let Some(tile) = next {
            next = self.marks.marked_tile(tile.next());
            if let Some(next) = next {
                self.fetch(next);
            }
            self.apply_tile(tile);
        }
    }

    #[inline(always)]
    fn fetch(&self, mut tile: MarkedTile) {
        while let Some(brick) = tile.take_brick() {
            ahead::fetch(&self.bricks[self.brick_at(&tile, brick)]);
        }
    }

    #[inline(always)]
    fn apply_tile(&mut self, mut tile: MarkedTile) {
        while let Some(brick) = tile.take_brick() {
            let at = self.brick_at(&tile, brick);
            let (state, marks) = (&mut self.bricks[at].0, self.marks.brick(&tile, brick));
            let changed = match &mut self.rule {
                Rule::Steps(steps) => steps.misses(state, marks),
                Rule::Ratio(ratio, counters) => ratio.misses(&mut counters[at], state, marks),
            };
            if changed {
                self.blocks[at / BRICKS_PER_BLOCK].dirty.insert(at % BRICKS_PER_BLOCK);
            }
            marks.0 = [NOTHING; BRICK_VOXELS];
        }
    }

    /// Where the voxels of a tile's brick are.
    #[inline(always)]
    fn brick_at(&self, tile: &MarkedTile, brick: usize) -> usize {
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
