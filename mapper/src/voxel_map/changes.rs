//! What changed in the map since it was last asked, as the lists of a snapshot, or brick by brick.
//!
//! In: the bricks that beams, fading and windows' ends noted as changed. Out: each such block with a new version, and which of
//! its bricks are to be sent.

use super::VoxelMap;
use crate::block::BlockState;
use crate::snapshot::{DELTA_BRICKS_MAX, Snapshot};
use tsense_contract::{BlockKey, Brick, CommitEntry, DeltaEntry, UNKNOWN_VERSION};

impl VoxelMap {
    /// Takes down what changed since the last snapshot, or everything for a keyframe. Its bricks are read when it is
    /// published: before the next beam.
    ///
    /// A block that was never published is told as a change of an unknown one: every brick of it that is known must be
    /// among its dirty ones.
    pub fn snapshot(&mut self, keyframe: bool, snapshot: &mut Snapshot) {
        snapshot.start(self.snapshots, keyframe);
        for (key, slot) in self.window.blocks() {
            let block = &mut self.blocks[slot];
            if block.key == Some(key) {
                note_block(block, key, &mut self.next_version, snapshot);
            }
        }
        self.snapshots += 1;
    }

    /// Hands out the bricks that changed since this was asked last, with their position in the block. It is not for a
    /// map of which snapshots are taken: they ask for the same.
    pub fn take_changes(&mut self, mut take: impl FnMut(BlockKey, usize, &Brick)) {
        for slot in 0..self.blocks.len() {
            let Some(key) = self.blocks[slot].key else { continue };
            let changed = std::mem::take(&mut self.blocks[slot].dirty);
            changed.iter().for_each(|brick| take(key, brick, &self.bricks_in(slot)[brick]));
        }
    }
}

/// Puts a block into the lists of a snapshot; with its changes it gets a new version. In a keyframe it is told as a
/// change of an unknown one, by all bricks that ever were told.
fn note_block(block: &mut BlockState, key: BlockKey, next_version: &mut u32, snapshot: &mut Snapshot) {
    let (before, changed) = (block.version, block.dirty.len());
    if changed > 0 {
        block.version = *next_version;
        *next_version += 1;
        block.told.extend(&block.dirty);
    }
    if block.version == UNKNOWN_VERSION {
        return;
    }
    let entry = CommitEntry { key, version: block.version };
    snapshot.table.push(entry);
    snapshot.dirty_bricks += changed;
    let (base, bricks) = if snapshot.keyframe { (UNKNOWN_VERSION, &block.told) } else { (before, &block.dirty) };
    let count = bricks.len();
    if count > DELTA_BRICKS_MAX {
        snapshot.whole.push(entry);
    } else if count > 0 {
        snapshot.changes.push(DeltaEntry { key, base, version: block.version, bricks: count as u32 });
        snapshot.numbers.extend(bricks.iter().map(|brick| brick as u16));
    }
    block.dirty.clear();
}
