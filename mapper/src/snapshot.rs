//! A snapshot of the map as messages: which blocks to send, and the headers of blocks and commit.
//!
//! In: what changed, and when. Out: `map` headers. The bricks themselves are copied once, by the shell, from the
//! blocks into shared memory.

use bytemuck::Zeroable;
use tsense_contract::{CommitEntry, MapHeader, MapSampleKind, Pose};
use tsense_geometry::{Timestamp, VoxelIndex};

/// What a snapshot consists of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Counts snapshots from 0.
    pub number: u64,
    /// Every block is sent.
    pub keyframe: bool,
    /// Blocks to send, with their versions.
    pub send: Vec<CommitEntry>,
    /// Every block of the map, with its version: the commit's table.
    pub table: Vec<CommitEntry>,
    /// Bricks that changed since the last snapshot.
    pub dirty_bricks: usize,
}

/// What all headers of a snapshot share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnapshotContext {
    /// Changes when the mapper restarts.
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
    /// Header of one of the blocks in `send`.
    pub fn block_header(&self, context: &SnapshotContext, entry: &CommitEntry) -> MapHeader {
        MapHeader { key: entry.key, version: entry.version, ..self.header(context, MapSampleKind::Block) }
    }

    /// Header of the commit.
    pub fn commit_header(&self, context: &SnapshotContext) -> MapHeader {
        MapHeader { version: self.table.len() as u32, ..self.header(context, MapSampleKind::Commit) }
    }

    fn header(&self, context: &SnapshotContext, kind: MapSampleKind) -> MapHeader {
        MapHeader {
            epoch: context.epoch,
            snapshot: self.number,
            stamp_ns: context.stamp.ns,
            published_ns: context.published.ns,
            voxel_size_m: context.voxel_size_m,
            pose: context.pose,
            center_voxel: context.center,
            kind: kind.to_wire(),
            keyframe: self.keyframe.into(),
            ..MapHeader::zeroed()
        }
    }
}
