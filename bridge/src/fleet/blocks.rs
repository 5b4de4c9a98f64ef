//! Which blocks of the map are to be written down for a station, and which of them a station may ask for.
//!
//! In: the versions of the blocks of each snapshot, and what was written where. Out: which blocks are due, the log of
//! the newest version of each, and which are to be removed for the limit. A block that is in view changes several times a
//! second; it is written at most once in a period, and once more when it leaves the map. Knows no files (`process`).

use super::log::ChangeLog;
use std::collections::BTreeMap;
use tsense_contract::{BlockKey, BlockPlace, FleetBlock};
use tsense_geometry::Timestamp;

/// See the head of this file.
#[derive(Clone, Debug)]
pub struct Blocks {
    log: ChangeLog<BlockPlace, FleetBlock>,
    /// Of the blocks in the map: the mapper's epoch, the version that was written last, and when.
    written: BTreeMap<BlockKey, (u64, u32, Timestamp)>,
    total_bytes: u64,
}

impl Blocks {
    /// None yet.
    pub fn new(epoch: u64) -> Self {
        Self { log: ChangeLog::new(epoch), written: BTreeMap::new(), total_bytes: 0 }
    }

    /// The newest version of each block that a station may ask for.
    pub fn log(&self) -> &ChangeLog<BlockPlace, FleetBlock> {
        &self.log
    }

    /// Bytes of all files.
    pub fn total_bytes(&self) -> u64 {
        self.total_bytes
    }

    /// Whether this version of a block in view is to be written now.
    pub fn is_due(&self, key: BlockKey, epoch: u64, version: u32, now: Timestamp, period_s: f64) -> bool {
        let waited = |at: Timestamp| !(0.0..period_s).contains(&now.seconds_since(at));
        self.written.get(&key).is_none_or(|(e, v, at)| (*e, *v) != (epoch, version) && waited(*at))
    }

    /// Whether a block that leaves the map holds what was not written.
    pub fn is_due_leaving(&self, key: BlockKey, epoch: u64, version: u32) -> bool {
        self.written.get(&key).is_none_or(|(e, v, _)| (*e, *v) != (epoch, version))
    }

    /// A version of a block in the map was looked at: it is written, or holds nothing.
    pub fn note_version(&mut self, key: BlockKey, epoch: u64, version: u32, now: Timestamp) {
        self.written.insert(key, (epoch, version, now));
    }

    /// A block left the map.
    pub fn note_left(&mut self, key: BlockKey) {
        self.written.remove(&key);
    }

    /// The file of a block is there, whole.
    pub fn put(&mut self, block: FleetBlock) {
        let replaced = self.log.get(&block.place()).map_or(0, |old| old.bytes);
        self.total_bytes = self.total_bytes + u64::from(block.bytes) - u64::from(replaced);
        self.log.put(block.place(), block);
    }

    /// Files that must go so that all take no more than the limit, those written longest ago first. They are not
    /// offered any more; what a station has of them it keeps.
    pub fn make_room(&mut self, limit_bytes: u64) -> Vec<FleetBlock> {
        let mut removed = Vec::new();
        while self.total_bytes > limit_bytes {
            let Some(oldest) = self.log.after(0, 1).find_map(|(_, _, block)| block.copied()) else { break };
            self.log.forget(&oldest.place());
            self.total_bytes -= u64::from(oldest.bytes);
            removed.push(oldest);
        }
        removed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds)
    }

    #[test]
    fn a_block_in_view_is_written_once_a_period_and_when_it_leaves() {
        let mut blocks = Blocks::new(1);
        let key = [1, 2, 3];
        assert!(blocks.is_due(key, 1, 1, at(0.0), 30.0));
        blocks.note_version(key, 1, 1, at(0.0));
        assert!(!blocks.is_due(key, 1, 2, at(29.0), 30.0) && blocks.is_due(key, 1, 2, at(30.0), 30.0));
        assert!(!blocks.is_due(key, 1, 1, at(30.0), 30.0));
        // The clock was set back, and another mapper counts from the start.
        assert!(blocks.is_due(key, 1, 2, at(-1.0), 30.0) && blocks.is_due(key, 2, 1, at(30.0), 30.0));
        assert!(blocks.is_due_leaving(key, 1, 2) && !blocks.is_due_leaving(key, 1, 1));
    }

    #[test]
    fn beyond_the_limit_the_blocks_written_longest_ago_go() {
        let mut blocks = Blocks::new(1);
        let block = |x, bytes| FleetBlock { key: [x, 0, 0], bytes, zone: 17, ..FleetBlock::zeroed() };
        [block(1, 40), block(2, 40), block(1, 50), block(3, 30)].into_iter().for_each(|b| blocks.put(b));
        assert_eq!(blocks.total_bytes(), 120);
        let removed: Vec<i32> = blocks.make_room(85).iter().map(|b| b.key[0]).collect();
        assert_eq!((removed, blocks.total_bytes()), (vec![2], 80));
        let left: Vec<u64> = blocks.log().after(0, 9).map(|(number, ..)| number).collect();
        assert_eq!(left, [3, 4]);
    }
}
