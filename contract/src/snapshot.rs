//! Puts snapshots of the map together from the samples of topic `map`, for every reader of it.
//!
//! In: blocks and commits in the order they arrived, the samples themselves of any type `S` (borrowed shared memory
//! in a process, vectors in a test). Out: whether the newest commit is complete, and then its blocks in key order.
//! A new block replaces the old one at once, so a complete snapshot lasts until the next block is added: work on it
//! before taking more. It copies no voxel, knows no clock and opens no topic; the caller checks the length of the
//! bricks it reads.

use crate::map::{BlockKey, Brick, MapHeader, unpack_commit};
use std::collections::BTreeMap;
use tsense_geometry::Timestamp;

/// Shortest time between two requests for a keyframe, seconds: a keyframe is the whole map, 50 ms at 64 blocks.
pub const KEYFRAME_INTERVAL_S: f64 = 0.5;

/// What a commit made of the blocks held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommitOutcome {
    /// Every block of the table is held in its version: [`SnapshotAssembler::complete`] has the snapshot.
    Complete,
    /// Some blocks are not; a keyframe is needed.
    Incomplete {
        /// Blocks of the table that are not held at all.
        missing: usize,
        /// Blocks held in another version.
        stale: usize,
    },
}

/// What became of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockOutcome {
    /// Held from now on.
    Held,
    /// Not held: there are as many blocks as the reader may borrow. The next commit will be incomplete.
    Full,
}

/// A consistent view of the whole map.
#[derive(Debug)]
pub struct Snapshot<'a, S> {
    /// The header of its commit: epoch, number, stamp, vehicle pose, centre.
    pub header: MapHeader,
    blocks: &'a BTreeMap<BlockKey, Held<S>>,
}

impl<'a, S> Snapshot<'a, S> {
    /// The blocks in key order.
    pub fn blocks(&self) -> impl ExactSizeIterator<Item = (BlockKey, &'a S)> + use<'a, S> {
        self.blocks.iter().map(|(key, held)| (*key, &held.sample))
    }

    /// Key, version and sample of every block in key order; a reader that remembers versions sees what changed.
    pub fn versioned_blocks(&self) -> impl ExactSizeIterator<Item = (BlockKey, u32, &'a S)> + use<'a, S> {
        self.blocks.iter().map(|(key, held)| (*key, held.version, &held.sample))
    }
}

#[derive(Debug)]
struct Held<S> {
    version: u32,
    sample: S,
}

/// Keeps the newest sample of each block, and knows when they make a snapshot.
#[derive(Debug)]
pub struct SnapshotAssembler<S> {
    epoch: Option<u64>,
    blocks: BTreeMap<BlockKey, Held<S>>,
    blocks_max: usize,
    complete: Option<MapHeader>,
    keyframe_needed: bool,
}

impl<S> SnapshotAssembler<S> {
    /// An empty one that holds at most `blocks_max` samples: what the topic lets a reader borrow, less what it takes
    /// at a time. It starts by needing a keyframe, as whoever joins late does.
    pub fn new(blocks_max: usize) -> Self {
        Self { epoch: None, blocks: BTreeMap::new(), blocks_max, complete: None, keyframe_needed: true }
    }

    /// Takes a block in. The sample it replaces is dropped here, which gives its memory back.
    pub fn block(&mut self, header: &MapHeader, sample: S) -> BlockOutcome {
        self.enter_epoch(header.epoch);
        self.complete = None;
        if !self.blocks.contains_key(&header.key) && self.blocks.len() >= self.blocks_max {
            return BlockOutcome::Full;
        }
        self.blocks.insert(header.key, Held { version: header.version, sample });
        BlockOutcome::Held
    }

    /// Compares what is held with a commit's table, and drops the blocks that left the map.
    pub fn commit(&mut self, header: &MapHeader, items: &[Brick]) -> CommitOutcome {
        self.enter_epoch(header.epoch);
        let table: BTreeMap<BlockKey, u32> =
            unpack_commit(header, items).iter().map(|entry| (entry.key, entry.version)).collect();
        self.blocks.retain(|key, _| table.contains_key(key));
        let missing = table.len() - self.blocks.len();
        let stale = self.blocks.iter().filter(|(key, held)| table[*key] != held.version).count();
        self.keyframe_needed = missing + stale > 0;
        self.complete = (!self.keyframe_needed).then_some(*header);
        if self.keyframe_needed { CommitOutcome::Incomplete { missing, stale } } else { CommitOutcome::Complete }
    }

    /// The newest snapshot, while it is complete and no block of the next one has come in.
    pub fn complete(&self) -> Option<Snapshot<'_, S>> {
        self.complete.map(|header| Snapshot { header, blocks: &self.blocks })
    }

    /// True from the start, a new epoch or an incomplete commit until a commit is complete.
    pub fn keyframe_needed(&self) -> bool {
        self.keyframe_needed
    }

    /// Blocks held now.
    pub fn held(&self) -> usize {
        self.blocks.len()
    }

    /// Versions of two epochs do not compare: a restarted mapper starts anew, and so does its reader.
    fn enter_epoch(&mut self, epoch: u64) {
        if self.epoch != Some(epoch) {
            self.epoch = Some(epoch);
            self.blocks.clear();
            self.complete = None;
            self.keyframe_needed = true;
        }
    }
}

/// Spaces out a reader's requests for keyframes: many reasons within [`KEYFRAME_INTERVAL_S`] make one request.
#[derive(Clone, Copy, Debug, Default)]
pub struct KeyframeRequests {
    asked: Option<Timestamp>,
}

impl KeyframeRequests {
    /// True where the reader should notify the mapper now.
    pub fn due(&mut self, needed: bool, now: Timestamp) -> bool {
        let waited = self.asked.is_none_or(|asked| now.seconds_since(asked) >= KEYFRAME_INTERVAL_S);
        let due = needed && waited;
        if due {
            self.asked = Some(now);
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{CommitEntry, MapSampleKind, pack_commit};
    use bytemuck::Zeroable;
    use std::rc::Rc;

    fn block_header(epoch: u64, x: i32, version: u32) -> MapHeader {
        MapHeader { epoch, key: [x, 0, 0], version, kind: MapSampleKind::Block.to_wire(), ..MapHeader::zeroed() }
    }

    /// Offers a commit of blocks `(x, version)`.
    fn commit<S>(assembler: &mut SnapshotAssembler<S>, epoch: u64, table: &[(i32, u32)]) -> CommitOutcome {
        let entries: Vec<_> = table.iter().map(|&(x, version)| CommitEntry { key: [x, 0, 0], version }).collect();
        let header = MapHeader {
            epoch,
            version: entries.len() as u32,
            kind: MapSampleKind::Commit.to_wire(),
            ..MapHeader::zeroed()
        };
        assembler.commit(&header, &pack_commit(&entries))
    }

    fn with_two_blocks() -> SnapshotAssembler<&'static str> {
        let mut assembler = SnapshotAssembler::new(8);
        assembler.block(&block_header(1, 5, 10), "five");
        assembler.block(&block_header(1, 3, 20), "three");
        assembler
    }

    #[test]
    fn a_matching_commit_completes_a_snapshot_in_key_order() {
        let mut assembler = with_two_blocks();
        assert!(assembler.complete().is_none() && assembler.keyframe_needed());
        assert_eq!(commit(&mut assembler, 1, &[(5, 10), (3, 20)]), CommitOutcome::Complete);
        let snapshot = assembler.complete().unwrap();
        assert_eq!(snapshot.blocks().map(|(key, s)| (key[0], *s)).collect::<Vec<_>>(), [(3, "three"), (5, "five")]);
        assert!(!assembler.keyframe_needed());
    }

    #[test]
    fn a_missing_or_stale_block_asks_for_a_keyframe_and_the_keyframe_heals_it() {
        let mut assembler = with_two_blocks();
        let outcome = commit(&mut assembler, 1, &[(5, 11), (3, 20), (4, 1)]);
        assert_eq!(outcome, CommitOutcome::Incomplete { missing: 1, stale: 1 });
        assert!(assembler.complete().is_none() && assembler.keyframe_needed());
        assembler.block(&block_header(1, 5, 11), "five again");
        assembler.block(&block_header(1, 4, 1), "four");
        assert_eq!(commit(&mut assembler, 1, &[(5, 11), (3, 20), (4, 1)]), CommitOutcome::Complete);
    }

    #[test]
    fn the_next_block_ends_the_snapshot_and_a_commit_drops_what_left_the_map() {
        let mut assembler = with_two_blocks();
        commit(&mut assembler, 1, &[(5, 10), (3, 20)]);
        assembler.block(&block_header(1, 6, 1), "six");
        assert!(assembler.complete().is_none());
        assert_eq!(commit(&mut assembler, 1, &[(5, 10), (6, 1)]), CommitOutcome::Complete);
        assert_eq!(assembler.held(), 2);
    }

    #[test]
    fn a_new_epoch_forgets_every_block_and_needs_a_keyframe() {
        let mut assembler = with_two_blocks();
        commit(&mut assembler, 1, &[(5, 10), (3, 20)]);
        assert_eq!(
            commit(&mut assembler, 2, &[(5, 10), (3, 20)]),
            CommitOutcome::Incomplete { missing: 2, stale: 0 },
            "same versions, another epoch"
        );
        assembler.block(&block_header(3, 5, 1), "five of the third life");
        assert_eq!(assembler.held(), 1);
        assert!(assembler.keyframe_needed());
    }

    #[test]
    fn replaced_samples_are_given_back_and_no_more_than_the_bound_are_held() {
        let (sample, mut assembler) = (Rc::new(()), SnapshotAssembler::new(2));
        for version in 1..=3 {
            assert_eq!(assembler.block(&block_header(1, 1, version), Rc::clone(&sample)), BlockOutcome::Held);
        }
        assert_eq!(Rc::strong_count(&sample), 2);
        assembler.block(&block_header(1, 2, 1), Rc::clone(&sample));
        assert_eq!(assembler.block(&block_header(1, 3, 1), Rc::clone(&sample)), BlockOutcome::Full);
        assert_eq!(Rc::strong_count(&sample), 3);
    }

    #[test]
    fn an_empty_map_is_a_complete_snapshot_without_blocks() {
        let mut assembler = SnapshotAssembler::<()>::new(2);
        assert_eq!(commit(&mut assembler, 1, &[]), CommitOutcome::Complete);
        assert_eq!(assembler.complete().unwrap().blocks().len(), 0);
    }

    #[test]
    fn requests_for_keyframes_coalesce_to_two_a_second() {
        let mut requests = KeyframeRequests::default();
        let asked = (0..100).filter(|i| requests.due(true, Timestamp::from_ns(i * 20_000_000))).count();
        assert_eq!(asked, 4, "2 s of asking every 20 ms");
        assert!(!requests.due(false, Timestamp::from_seconds(100.0)));
        assert!(requests.due(true, Timestamp::from_seconds(100.0)));
    }
}
