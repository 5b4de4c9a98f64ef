//! What a voxel map hands out and takes back as its window rolls: blocks that leave, blocks that enter.
//!
//! In: stored blocks. Out: stored blocks, with the open window's marks applied and all fading taken; which blocks came
//! into the window. Nothing here runs for a beam: only when blocks leave or enter, and only where the map was told to
//! keep what leaves. It knows no file.

use super::Rule;
use super::{VoxelMap, bricks_of};
use crate::block::BlockState;
use crate::config::Config;
use crate::continuation::{Continuation, Moment};
use crate::evidence::AlignedBrick;
use crate::tsmap::StoredBlock;
use tsense_contract::{BRICKS_PER_BLOCK, BlockKey};

/// Blocks on their way.
pub struct Exchange {
    is_kept: bool,
    /// At most one a slot: beams come only between two moves of the window that somebody has seen.
    leaving: Vec<StoredBlock>,
    entered: Vec<BlockKey>,
    /// Which block each slot stood for when blocks that entered were last noted.
    expected: Vec<Option<BlockKey>>,
    continuation: Continuation,
}

impl Exchange {
    pub fn new(config: &Config) -> Self {
        let continuation = Continuation::new(config);
        Self { is_kept: false, leaving: Vec::new(), entered: Vec::new(), expected: Vec::new(), continuation }
    }
}

impl VoxelMap {
    /// Keeps blocks that leave, and notes those that enter, for [`VoxelMap::take_leaving`] and
    /// [`VoxelMap::take_entered`]; call these after each move. Otherwise what leaves is forgotten.
    pub fn keep_leaving(&mut self) {
        self.exchange.is_kept = true;
        self.exchange.expected = vec![None; self.blocks.len()];
        self.note_entered();
    }

    /// Blocks that have left the window since the last time, with all that was known of them.
    pub fn take_leaving(&mut self) -> Vec<StoredBlock> {
        std::mem::take(&mut self.exchange.leaving)
    }

    /// Blocks that have entered the window since the last time and are in it still.
    pub fn take_entered(&mut self) -> Vec<BlockKey> {
        let mut entered = std::mem::take(&mut self.exchange.entered);
        entered.retain(|key| self.window.slot_of(*key).is_some());
        entered
    }

    /// Whether the window holds a block, known or not.
    pub fn window_holds(&self, key: BlockKey) -> bool {
        self.window.slot_of(key).is_some()
    }

    /// Units of fading that every block had to lose since the start.
    pub fn faded(&self) -> u32 {
        self.fade_due as u32
    }

    /// Every block of the window as it would leave, the open window of evidence ended. The map keeps them.
    pub fn copy_all(&mut self) -> Vec<StoredBlock> {
        self.close_window();
        let slots: Vec<usize> = self.held().map(|(_, slot)| slot).collect();
        slots.into_iter().filter_map(|slot| self.copy_of(slot)).collect()
    }

    /// Takes a stored block back, aged to `now`, and continues it with what beams have found there since. False where
    /// the window does not hold it.
    pub fn restore(&mut self, block: &StoredBlock, now: &Moment) -> bool {
        let Some(slot) = self.window.slot_of(block.key) else {
            return false;
        };
        if self.blocks[slot].key == Some(block.key) {
            self.fade_block(slot);
        } else {
            self.blocks[slot] =
                BlockState { key: Some(block.key), faded: self.fade_due as u32, ..BlockState::default() };
        }
        let aged = self.exchange.continuation.aged(block, now);
        for (i, (place, then)) in aged.known_bricks().enumerate() {
            let brick = slot * BRICKS_PER_BLOCK + place;
            let AlignedBrick(live) = &mut self.bricks[brick];
            match &mut self.rule {
                Rule::Steps(_) => self.exchange.continuation.brick(then, live),
                Rule::Ratio(_, counters) => {
                    self.exchange.continuation.counted((then, aged.counters.get(i)), (live, &mut counters[brick]));
                }
            }
            self.blocks[slot].dirty.insert(place);
        }
        true
    }

    /// A block leaves its slot: for whoever wants it. Its marks have counted; the slot is cleared by the caller.
    pub(super) fn hand_out(&mut self, slot: usize) {
        if self.exchange.is_kept {
            let leaving = self.copy_of(slot);
            self.exchange.leaving.extend(leaving);
        }
    }

    /// The block in a slot, all fading taken; nothing where nothing is known of it.
    fn copy_of(&mut self, slot: usize) -> Option<StoredBlock> {
        let key = self.blocks[slot].key?;
        self.fade_block(slot);
        let counters = match &self.rule {
            Rule::Ratio(_, counters) => &counters[bricks_of(slot)],
            Rule::Steps(_) => &[],
        };
        let block = StoredBlock::of(key, self.bricks_in(slot), counters);
        (!block.is_empty()).then_some(StoredBlock { faded: self.fade_due as u32, ..block })
    }

    /// Notes which blocks the window holds that it did not hold before.
    pub(super) fn note_entered(&mut self) {
        let exchange = &mut self.exchange;
        if exchange.is_kept {
            for (key, slot) in self.window.blocks() {
                if exchange.expected[slot].replace(key) != Some(key) {
                    exchange.entered.push(key);
                }
            }
            // Nobody has to ask: what has left again is no longer wanted, so that this stays as short as the window.
            let window = &self.window;
            exchange.entered.retain(|key| window.slot_of(*key).is_some());
        }
    }
}
