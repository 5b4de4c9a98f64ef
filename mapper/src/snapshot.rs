//! A snapshot of the map as messages: blocks of which much changed, whole; the changed bricks of all others, in as few
//! samples as hold them; then the commit.
//!
//! In: what changed, and when. Out: samples of topic `map`, written by the sender's own function straight into its
//! memory, so that every brick is copied once. Its lists are used again for the next snapshot: nothing is allocated.

use crate::voxel_map::VoxelMap;
use bytemuck::Zeroable;
use tsense_contract::{
    BRICKS_PER_BLOCK, BlockKey, Brick, CommitEntry, DeltaEntry, Map, MapHeader, MapSampleKind, Pose, Topic,
    commit_items, delta_items, write_commit, write_delta,
};
use tsense_geometry::{Timestamp, VoxelIndex};

/// A block with more changed bricks than this is sent whole: one copy of all is then quicker than many of some. For the
/// writer that begins at some 60 % of the bricks; a reader must copy a whole block with its next delta, so it is more.
pub const DELTA_BRICKS_MAX: usize = BRICKS_PER_BLOCK / 4 * 3;

/// What a snapshot consists of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Counts snapshots from 0.
    pub number: u64,
    /// Every block is sent: whole, or all that is known of it.
    pub keyframe: bool,
    /// Blocks that are sent whole.
    pub whole: Vec<CommitEntry>,
    /// Blocks of which the changed bricks are sent.
    pub changes: Vec<DeltaEntry>,
    /// The numbers of those bricks in their blocks, entry after entry.
    pub numbers: Vec<u16>,
    /// Every block of the map, with its version: the commit's table.
    pub table: Vec<CommitEntry>,
    /// Bricks that changed since the last snapshot.
    pub dirty_bricks: usize,
}

/// What all headers of a snapshot share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnapshotContext {
    /// Grows when the mapper restarts.
    pub epoch: u64,
    /// Instant of the newest beam.
    pub stamp: Timestamp,
    /// Instant of publication.
    pub published: Timestamp,
    /// Edge of a voxel, metres.
    pub voxel_size_m: f64,
    /// The vehicle at `stamp`.
    pub pose: Pose,
    /// Centre of the working space.
    pub center: VoxelIndex,
}

impl Snapshot {
    /// Empties the lists, keeping their memory.
    pub(crate) fn start(&mut self, number: u64, keyframe: bool) {
        (self.number, self.keyframe, self.dirty_bricks) = (number, keyframe, 0);
        self.whole.clear();
        self.changes.clear();
        self.numbers.clear();
        self.table.clear();
    }

    /// Hands out every sample in order, the commit last: header, number of items, and what writes all of them. `map` is
    /// the one this snapshot was taken of, not changed since. The number of samples, or the sender's first error.
    pub fn publish<E>(
        &self,
        context: &SnapshotContext,
        map: &VoxelMap,
        mut send: impl FnMut(&MapHeader, usize, &mut dyn FnMut(&mut [Brick])) -> Result<(), E>,
    ) -> Result<u64, E> {
        let bricks = |key: BlockKey| map.block(key).unwrap_or(&[]);
        for entry in &self.whole {
            let header = MapHeader { key: entry.key, ..self.header(context, MapSampleKind::Block, entry.version) };
            send(&header, BRICKS_PER_BLOCK, &mut |items| items.copy_from_slice(bricks(entry.key)))?;
        }
        let mut samples = self.whole.len() as u64 + 1;
        for (entries, numbers) in self.deltas() {
            let header = self.header(context, MapSampleKind::Delta, entries.len() as u32);
            let len = delta_items(entries.len(), numbers.len());
            send(&header, len, &mut |items| write_delta(items, entries, numbers, bricks))?;
            samples += 1;
        }
        let header = self.header(context, MapSampleKind::Commit, self.table.len() as u32);
        send(&header, commit_items(self.table.len()), &mut |items| write_commit(items, &self.table))?;
        Ok(samples)
    }

    /// The changes by samples: as many blocks in each as fit, one at least.
    fn deltas(&self) -> impl Iterator<Item = (&[DeltaEntry], &[u16])> {
        let (mut entries, mut numbers) = (self.changes.as_slice(), self.numbers.as_slice());
        std::iter::from_fn(move || {
            let (mut blocks, mut bricks) = (0, 0);
            for entry in entries {
                let more = bricks + entry.bricks as usize;
                if delta_items(blocks + 1, more) > Map::ITEMS_MAX {
                    break;
                }
                (blocks, bricks) = (blocks + 1, more);
            }
            let (these, these_numbers);
            (these, entries) = entries.split_at(blocks);
            (these_numbers, numbers) = numbers.split_at(bricks);
            (blocks > 0).then_some((these, these_numbers))
        })
    }

    fn header(&self, context: &SnapshotContext, kind: MapSampleKind, version: u32) -> MapHeader {
        MapHeader {
            epoch: context.epoch,
            snapshot: self.number,
            stamp_ns: context.stamp.ns,
            published_ns: context.published.ns,
            voxel_size_m: context.voxel_size_m,
            pose: context.pose,
            version,
            center_voxel: context.center,
            kind: kind.to_wire(),
            keyframe: self.keyframe.into(),
            ..MapHeader::zeroed()
        }
    }
}
