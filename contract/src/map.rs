//! Topics `map` and `points`: the voxel map as changed blocks with a commit, and each scan placed in the world.
//!
//! A snapshot is a run of samples on one first-in-first-out topic: blocks of which much changed, whole; the changed
//! bricks of all other blocks, as deltas (see `delta`); then one commit that lists every block of the map with its
//! version. A reader accepts the snapshot only when all versions match (see `snapshot`); otherwise it asks for a
//! keyframe (topic event [`MAP_KEYFRAME`]).

use crate::message::{message, wire_enum};
use crate::motion::Pose;
use crate::topic::{Qos, Topic};
use crate::voxels::VoxelState;
use tsense_geometry::VoxelIndex;

/// Edge of a brick, voxels.
pub const BRICK_EDGE: usize = 4;
/// Voxels of a brick.
pub const BRICK_VOXELS: usize = BRICK_EDGE * BRICK_EDGE * BRICK_EDGE;
/// Voxels of a block along x, y, z: 15 x 15 x 6 m at 0.15 m.
pub const BLOCK_VOXELS: [usize; 3] = [100, 100, 40];
/// Bricks of a block along x, y, z.
pub const BLOCK_BRICKS: [usize; 3] =
    [BLOCK_VOXELS[0] / BRICK_EDGE, BLOCK_VOXELS[1] / BRICK_EDGE, BLOCK_VOXELS[2] / BRICK_EDGE];
/// Bricks of a block: 6250, 0.8 MB.
pub const BRICKS_PER_BLOCK: usize = BLOCK_BRICKS[0] * BLOCK_BRICKS[1] * BLOCK_BRICKS[2];
/// Most blocks of a map whose snapshots are published. The one number behind the bounds of topic `map`, of its readers
/// and of the configured working space: a reader may hold every block as a borrowed sample, so shared memory must have
/// room for twice as many, 2.1 GB where the map is that large and all of it seen. 21 x 21 x 3 blocks are a working space of
/// 300 x 300 x 12 m at 0.15 m; 8 x 8 x 3, 100 x 100 x 12 m, are as far as an LMS-151 measures.
pub const BLOCKS_MAX: usize = 1323;
/// Most samples of a snapshot: each block comes at most once, whole or in a delta, and the commit ends it.
pub const SNAPSHOT_SAMPLES_MAX: usize = BLOCKS_MAX + 1;
/// Name of the event by which a reader asks for a keyframe: every block anew, then a commit.
pub const MAP_KEYFRAME: &str = "map/keyframe";

message! {
    /// 4 x 4 x 4 voxels, two bytes each: x fastest, then y, then z.
    Brick = "tsense.brick.v1" {
        /// Evidence: positive occupied, negative free, 0 undecided.
        occupancy: [i8; 64],
        /// Updates behind that evidence, faded by age; 0 is unknown.
        confidence: [u8; 64],
    }
}

impl Brick {
    /// Nothing known.
    pub const UNKNOWN: Self = Self { occupancy: [0; 64], confidence: [0; 64] };

    /// The state of voxel `i`: unknown without confidence, occupied above zero, free otherwise.
    pub fn state(&self, i: usize) -> VoxelState {
        match (self.confidence[i], self.occupancy[i]) {
            (0, _) => VoxelState::Unknown,
            (_, o) if o > 0 => VoxelState::Occupied,
            _ => VoxelState::Free,
        }
    }
}

/// Which block: its indices counted from the UTM origin in blocks.
pub type BlockKey = [i32; 3];

/// The block that holds a voxel, the brick in it, and the voxel in that.
pub fn locate(voxel: VoxelIndex) -> (BlockKey, usize, usize) {
    let (mut key, mut brick, mut inner) = ([0; 3], [0; 3], [0; 3]);
    for axis in 0..3 {
        let edge = BLOCK_VOXELS[axis] as i32;
        key[axis] = voxel[axis].div_euclid(edge);
        let within = voxel[axis].rem_euclid(edge) as usize;
        (brick[axis], inner[axis]) = (within / BRICK_EDGE, within % BRICK_EDGE);
    }
    (key, brick_offset(brick), voxel_offset(inner))
}

/// Position of a brick in its block's array: x fastest, then y, then z.
pub const fn brick_offset(brick: [usize; 3]) -> usize {
    brick[0] + BLOCK_BRICKS[0] * (brick[1] + BLOCK_BRICKS[1] * brick[2])
}

/// Position of a voxel in its brick's arrays: x fastest, then y, then z.
pub const fn voxel_offset(voxel: [usize; 3]) -> usize {
    voxel[0] + BRICK_EDGE * (voxel[1] + BRICK_EDGE * voxel[2])
}

/// Farthest voxel from the UTM origin on any axis: the end of the Earth in voxels of 1 cm, and beyond it room to count on.
const VOXEL_MAX: u32 = 2_100_000_000;

/// Whether a voxel of any size may be somewhere; sums of indices near it do not overflow.
pub fn is_on_earth(voxel: VoxelIndex) -> bool {
    voxel.iter().all(|index| index.unsigned_abs() <= VOXEL_MAX)
}

/// Whether a block may be somewhere, and so has a [`first_voxel`].
pub fn is_block_on_earth(key: BlockKey) -> bool {
    (0..3).all(|axis| key[axis].unsigned_abs() <= VOXEL_MAX / BLOCK_VOXELS[axis] as u32)
}

/// The voxel with the smallest indices of a block that [`is_block_on_earth`].
#[inline]
pub fn first_voxel(key: BlockKey) -> VoxelIndex {
    std::array::from_fn(|axis| key[axis] * BLOCK_VOXELS[axis] as i32)
}

wire_enum! {
    /// What a sample of the map topic is.
    MapSampleKind, unknown = Commit {
        /// One block: its bricks are the items.
        Block = 0 "block",
        /// The end of a snapshot: [`CommitEntry`] records are packed into the items.
        Commit = 1 "commit",
        /// Changed bricks of several blocks: see [`crate::Delta`].
        Delta = 2 "delta",
    }
}

message! {
    /// Header of a block, a delta or a commit.
    MapHeader = "tsense.map.v2" {
        /// Grows when the mapper restarts: versions of two epochs do not compare, and the greater one is the living.
        epoch: u64,
        /// Number of the snapshot this sample belongs to.
        snapshot: u64,
        /// Instant of the newest beam in the snapshot, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// Instant of publication, nanoseconds since the epoch, graph clock.
        published_ns: i64,
        /// Edge of a voxel, metres.
        voxel_size_m: f64,
        /// The vehicle at `stamp_ns`; its zone is the map's.
        pose: Pose,
        /// Block: which one. Otherwise zero.
        key: [i32; 3],
        /// Block: its version. Commit or delta: number of table entries.
        version: u32,
        /// Centre of the working space in voxel indices: the block window follows the vehicle.
        center_voxel: [i32; 3],
        /// A [`MapSampleKind`].
        kind: u8,
        /// 1 where the snapshot is a keyframe.
        keyframe: u8,
        /// Zero.
        reserved: [u8; 2],
    }
}

impl MapHeader {
    /// The kind, parsed.
    pub fn kind(&self) -> MapSampleKind {
        MapSampleKind::from_wire(self.kind)
    }
}

message! {
    /// One line of a commit: a block of the map and the version it has in this snapshot.
    CommitEntry = "tsense.commit.v1" {
        /// Which block.
        key: [i32; 3],
        /// Its version.
        version: u32,
    }
}

/// Entries of a commit that fit into one brick of payload.
const ENTRIES_PER_BRICK: usize = size_of::<Brick>() / size_of::<CommitEntry>();

/// Items of a commit with a table of this many entries.
pub const fn commit_items(entries: usize) -> usize {
    entries.div_ceil(ENTRIES_PER_BRICK)
}

/// Writes a commit's table into its items, the item type of the topic; there are [`commit_items`] of them.
pub fn write_commit(items: &mut [Brick], entries: &[CommitEntry]) {
    let (bytes, room) = (bytemuck::cast_slice(entries), bytemuck::cast_slice_mut::<Brick, u8>(items));
    room[..bytes.len()].copy_from_slice(bytes);
    room[bytes.len()..].fill(0);
}

/// A commit's table as new items: for tests, and for who sends one commit.
pub fn pack_commit(entries: &[CommitEntry]) -> Vec<Brick> {
    let mut items = vec![Brick::UNKNOWN; commit_items(entries.len())];
    write_commit(&mut items, entries);
    items
}

/// Reads a commit's table; an entry count beyond the payload is cut to it.
pub fn unpack_commit<'a>(header: &MapHeader, items: &'a [Brick]) -> impl Iterator<Item = CommitEntry> + use<'a> {
    bytemuck::cast_slice::<Brick, u8>(items)
        .chunks_exact(size_of::<CommitEntry>())
        .take(header.version as usize)
        .map(bytemuck::pod_read_unaligned)
}

/// The topic `map`.
pub struct Map;

impl Topic for Map {
    type Header = MapHeader;
    type Item = Brick;
    const NAME: &'static str = "map";
    /// A whole keyframe waits in the buffer, and room for one sample more while it is written. A reader holds every block
    /// and the sample it takes. Memory is used as far as blocks are.
    const QOS: Qos = Qos {
        publishers: 1,
        // Classifier, page, ROS 2, Foxglove, fleet, and two who look.
        subscribers: 7,
        history: 0,
        buffer: SNAPSHOT_SAMPLES_MAX + 1,
        borrow: BLOCKS_MAX + 1,
        loans: 2,
        event: true,
    };
    const ITEMS_MAX: usize = BRICKS_PER_BLOCK;
}

message! {
    /// A scan placed in the world: every beam with the pose and pan-tilt angles of its own time.
    PointsHeader = "tsense.points.v1" {
        /// Instant of the first beam, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// UTM easting, northing, ellipsoidal height that the items are relative to, metres.
        origin_m: [f64; 3],
        /// The ladar's own position at the middle of the scan, relative to `origin_m`, metres.
        ladar_m: [f32; 3],
        /// UTM zone.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// Index of the ladar in the configuration.
        ladar: u8,
        /// Zero.
        reserved: u8,
    }
}

message! {
    /// The end of a beam.
    PlacedReturn = "tsense.placed_return.v1" {
        /// Relative to the header's origin: east, north, up, metres.
        xyz_m: [f32; 3],
        /// Echo strength, 0 where none was sent.
        remission: u16,
        /// A [`crate::ReturnKind`]; beams without an echo end at the usable range.
        kind: u8,
        /// Zero.
        reserved: u8,
    }
}

/// The topic `points`.
pub struct Points;

impl Topic for Points {
    type Header = PointsHeader;
    type Item = PlacedReturn;
    const NAME: &'static str = "points";
    /// The classifier takes them between two snapshots: 64 are what four ladars at 50 Hz send in 0.3 s.
    const QOS: Qos = Qos { publishers: 1, subscribers: 8, history: 0, buffer: 64, borrow: 4, loans: 2, event: false };
    const ITEMS_MAX: usize = 1081;
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_voxel_below_zero_lies_in_the_block_below() {
        assert_eq!(locate([0, 0, 0]), ([0, 0, 0], 0, 0));
        assert_eq!(locate([-1, 99, 40]), ([-1, 0, 1], brick_offset([24, 24, 0]), voxel_offset([3, 3, 0])));
        assert_eq!(locate(first_voxel([-3, 7, 2])), ([-3, 7, 2], 0, 0));
    }

    #[test]
    fn a_commit_survives_its_bricks_and_a_lying_count_reads_no_further() {
        let entries: Vec<_> = (0..19).map(|i| CommitEntry { key: [i, -i, 1], version: i as u32 }).collect();
        let bricks = pack_commit(&entries);
        let mut header = MapHeader::zeroed();
        header.version = 19;
        assert_eq!(unpack_commit(&header, &bricks).collect::<Vec<_>>(), entries);
        header.version = u32::MAX;
        assert_eq!(unpack_commit(&header, &bricks).count(), bricks.len() * ENTRIES_PER_BRICK);
    }

    #[test]
    fn unknown_free_and_occupied_are_three_states() {
        let mut brick = Brick::UNKNOWN;
        (brick.confidence[1], brick.confidence[2], brick.occupancy[2]) = (1, 1, 1);
        assert_eq!(brick.state(0), VoxelState::Unknown);
        assert_eq!(brick.state(1), VoxelState::Free);
        assert_eq!(brick.state(2), VoxelState::Occupied);
    }
}
