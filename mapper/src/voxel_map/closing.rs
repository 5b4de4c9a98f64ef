//! The end of a window of evidence: its marks become occupancy and confidence.

use super::{Rule, VoxelMap};
use crate::clip::Space;
use crate::evidence::NOTHING;
use crate::trace::{Walk, Work};
use tsense_contract::{BLOCK_BRICKS, BRICK_VOXELS, BRICKS_PER_BLOCK};

impl VoxelMap {
    /// Ends a window of evidence: voxels that beams only passed lose, all marks go.
    pub fn close_window(&mut self) {
        self.marks.protect_hits();
        self.entered = Space::EMPTY;
        self.instruction_set.run(Closing(self));
    }

    /// The marks are taken as they lie in memory, for that is how they are fetched fastest. No closures: they would not be
    /// compiled for the instruction set.
    #[inline(always)]
    fn apply_marks(&mut self) {
        let [edge_x, edge_y, edge_z] = BLOCK_BRICKS;
        let (marks, [bricks_x, bricks_y, _]) = self.marks.bricks();
        for (row, marks) in marks.chunks_exact_mut(bricks_x).enumerate() {
            let (y, z) = (row % bricks_y, row / bricks_y);
            let first_brick = (z % edge_z * edge_y + y % edge_y) * edge_x;
            let slots = self.window.slot_row(y / edge_y, z / edge_z);
            for (x, marks) in marks.chunks_exact_mut(edge_x).enumerate() {
                let slot = slots.at(x);
                let block = &mut self.blocks[slot];
                if !block.marked {
                    continue;
                }
                let first = slot * BRICKS_PER_BLOCK + first_brick;
                for (brick, marks) in marks.iter_mut().enumerate() {
                    if marks.are_empty() {
                        continue;
                    }
                    let state = &mut self.bricks[first + brick].0;
                    let changed = match &mut self.rule {
                        Rule::Steps(steps) => steps.misses(state, marks),
                        Rule::Ratio(ratio, counters) => ratio.misses(&mut counters[first + brick], state, marks),
                    };
                    if changed {
                        block.dirty.insert(first_brick + brick);
                    }
                    marks.0 = [NOTHING; BRICK_VOXELS];
                }
            }
        }
        self.blocks.iter_mut().for_each(|block| block.marked = false);
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
