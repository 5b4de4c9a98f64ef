//! Puts snapshots of the map together from the samples of topic `map`, for every reader of it.
//!
//! In: the samples in the order they arrived, of any type `S` that lends its bricks (borrowed shared memory in a process,
//! vectors in a test). Out: whether the newest commit is complete, and then its blocks in key order.
//! A block that came whole is kept as the borrowed sample. With its first delta it becomes the reader's own copy, in
//! memory from a pool: as a rule nothing is allocated for a snapshot. A delta whose base is not the version held changes
//! nothing: the block is stale until it comes whole again, never wrong.
//! A sample changes what is held at once, so a complete snapshot lasts until the next sample is taken: work on it
//! before taking more. It knows no clock and opens no topic.

use crate::delta::{Changes, Delta, DeltaEntry, UNKNOWN_VERSION};
use crate::map::{
    BRICKS_PER_BLOCK, BlockKey, Brick, CommitEntry, MapHeader, MapSampleKind, is_block_on_earth, is_on_earth,
    unpack_commit,
};
use tsense_geometry::Timestamp;

/// Shortest time between two requests for a keyframe, seconds: a keyframe is the whole map. A program that joins late has
/// one of 800 blocks 0.6 s after it was started.
pub const KEYFRAME_INTERVAL_S: f64 = 0.5;

/// What became of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It is part of the next snapshot.
    Part,
    /// A commit of which every block is held in its version: [`SnapshotAssembler::complete`] has the snapshot.
    Complete,
    /// A commit of which some blocks are not; a keyframe is needed.
    Incomplete {
        /// Blocks of the table that are not held at all.
        missing: usize,
        /// Blocks held in another version.
        stale: usize,
    },
    /// It was not used, or not all of it. Where that matters the next commit is incomplete.
    Refused(Refusal),
}

/// Why a sample was not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Its items are not as many as its kind or its table says.
    Size,
    /// There are as many blocks as the reader may hold.
    Full,
    /// It is of a mapper that ended: one that started later was heard already.
    Ended,
    /// A block, or the map's centre, lies beyond any place on Earth.
    Place,
}

impl Refusal {
    /// The reason for counters.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Size => "block of another size",
            Self::Full => "block beyond the bound",
            Self::Ended => "sample of an ended mapper",
            Self::Place => "block beyond the Earth",
        }
    }
}

/// A consistent view of the whole map.
#[derive(Debug)]
pub struct Snapshot<'a, S> {
    /// The header of its commit: epoch, number, stamp, vehicle pose, centre.
    pub header: MapHeader,
    blocks: &'a [Held<S>],
}

impl<'a, S: AsRef<[Brick]>> Snapshot<'a, S> {
    /// The blocks in key order.
    pub fn blocks(&self) -> impl ExactSizeIterator<Item = (BlockKey, &'a [Brick])> + use<'a, S> {
        self.blocks.iter().map(|held| (held.key, held.bricks.as_slice()))
    }

    /// Key, version and bricks of every block in key order; a reader that remembers versions sees what changed.
    pub fn versioned_blocks(&self) -> impl ExactSizeIterator<Item = (BlockKey, u32, &'a [Brick])> + use<'a, S> {
        self.blocks.iter().map(|held| (held.key, held.version, held.bricks.as_slice()))
    }
}

/// The bricks of a block.
#[derive(Debug)]
enum Bricks<S> {
    /// As it came, in shared memory.
    Borrowed(S),
    /// Our own copy, changed by deltas since.
    Own(Box<[Brick]>),
}

impl<S: AsRef<[Brick]>> Bricks<S> {
    fn as_slice(&self) -> &[Brick] {
        match self {
            Self::Borrowed(sample) => sample.as_ref(),
            Self::Own(bricks) => bricks,
        }
    }
}

#[derive(Debug)]
struct Held<S> {
    key: BlockKey,
    version: u32,
    bricks: Bricks<S>,
}

/// Keeps the newest state of each block, and knows when they make a snapshot.
#[derive(Debug)]
pub struct SnapshotAssembler<S> {
    epoch: Option<u64>,
    /// In key order.
    blocks: Vec<Held<S>>,
    blocks_max: usize,
    /// Copies that no block needs now. With those in use they are never more than `blocks_max`.
    pool: Vec<Box<[Brick]>>,
    /// The table of the commit that is looked at, kept for its memory.
    table: Vec<CommitEntry>,
    complete: Option<MapHeader>,
    keyframe_needed: bool,
}

impl<S: AsRef<[Brick]>> SnapshotAssembler<S> {
    /// An empty one that holds at most `blocks_max` blocks: [`crate::BLOCKS_MAX`] for a reader of the topic. It starts by
    /// needing a keyframe, as whoever joins late does.
    pub fn new(blocks_max: usize) -> Self {
        Self {
            epoch: None,
            blocks: Vec::with_capacity(blocks_max),
            blocks_max,
            pool: Vec::new(),
            table: Vec::with_capacity(blocks_max),
            complete: None,
            keyframe_needed: true,
        }
    }

    /// Takes a sample in. One that is not kept is dropped here, which gives its memory back.
    pub fn take(&mut self, header: &MapHeader, sample: S) -> Taken {
        if self.epoch.is_some_and(|epoch| header.epoch < epoch) {
            return Taken::Refused(Refusal::Ended);
        }
        if !is_on_earth(header.center_voxel) {
            return Taken::Refused(Refusal::Place);
        }
        self.enter_epoch(header.epoch);
        self.complete = None;
        match header.kind() {
            MapSampleKind::Block => self.block(header, sample),
            MapSampleKind::Delta => self.delta(header, sample.as_ref()),
            MapSampleKind::Commit => self.commit(header, sample.as_ref()),
        }
    }

    fn block(&mut self, header: &MapHeader, sample: S) -> Taken {
        if sample.as_ref().len() != BRICKS_PER_BLOCK {
            return Taken::Refused(Refusal::Size);
        }
        self.hold(header.key, header.version, Bricks::Borrowed(sample))
    }

    fn delta(&mut self, header: &MapHeader, items: &[Brick]) -> Taken {
        let Some(delta) = Delta::read(header, items) else { return Taken::Refused(Refusal::Size) };
        let mut taken = Taken::Part;
        for (entry, changes) in delta.blocks() {
            match self.change(&entry, &changes) {
                Taken::Part => {}
                refused => taken = refused,
            }
        }
        taken
    }

    /// Takes in what changed of a block. Where its base is not what is held, nothing happens, and the commit shows it.
    fn change(&mut self, entry: &DeltaEntry, changes: &Changes<'_>) -> Taken {
        if entry.base == UNKNOWN_VERSION {
            let mut own = self.unknown();
            changes.apply(&mut own);
            return self.hold(entry.key, entry.version, Bricks::Own(own));
        }
        let place = self.place(entry.key);
        let Some(at) = place.ok().filter(|at| self.blocks[*at].version == entry.base) else { return Taken::Part };
        if matches!(self.blocks[at].bricks, Bricks::Borrowed(_)) {
            let mut own = self.unknown();
            let bricks = own.iter_mut().zip(self.blocks[at].bricks.as_slice());
            bricks.filter(|(_, brick)| **brick != Brick::UNKNOWN).for_each(|(own, brick)| *own = *brick);
            self.blocks[at].bricks = Bricks::Own(own);
        }
        let held = &mut self.blocks[at];
        if let Bricks::Own(own) = &mut held.bricks {
            changes.apply(own);
            held.version = entry.version;
        }
        Taken::Part
    }

    fn hold(&mut self, key: BlockKey, version: u32, bricks: Bricks<S>) -> Taken {
        let held = Held { key, version, bricks };
        if !is_block_on_earth(key) {
            recycle(&mut self.pool, held);
            return Taken::Refused(Refusal::Place);
        }
        match self.place(key) {
            Ok(at) => {
                let replaced = std::mem::replace(&mut self.blocks[at], held);
                recycle(&mut self.pool, replaced);
            }
            Err(_) if self.blocks.len() >= self.blocks_max => {
                recycle(&mut self.pool, held);
                return Taken::Refused(Refusal::Full);
            }
            Err(at) => self.blocks.insert(at, held),
        }
        Taken::Part
    }

    /// Compares what is held with a commit's table, and drops the blocks that left the map.
    fn commit(&mut self, header: &MapHeader, items: &[Brick]) -> Taken {
        self.table.clear();
        self.table.extend(unpack_commit(header, items));
        self.table.sort_unstable_by_key(|entry| entry.key);
        let table = &self.table;
        let find = |key: BlockKey| table.binary_search_by_key(&key, |entry| entry.key);
        for held in self.blocks.extract_if(.., |held| find(held.key).is_err()) {
            recycle(&mut self.pool, held);
        }
        let right = |held: &&Held<S>| find(held.key).is_ok_and(|at| table[at].version == held.version);
        let stale = self.blocks.len() - self.blocks.iter().filter(right).count();
        let missing = self.table.len() - self.blocks.len();
        self.keyframe_needed = missing + stale > 0;
        self.complete = (!self.keyframe_needed).then_some(*header);
        if self.keyframe_needed { Taken::Incomplete { missing, stale } } else { Taken::Complete }
    }

    /// The newest snapshot, while it is complete and nothing of the next one has come in.
    pub fn complete(&self) -> Option<Snapshot<'_, S>> {
        self.complete.map(|header| Snapshot { header, blocks: &self.blocks })
    }

    /// Blocks held that this sample, if it is a commit of the mapper they are of, lists no more: taking it drops them.
    pub fn leaving(&self, header: &MapHeader, items: &[Brick]) -> impl Iterator<Item = (BlockKey, u32, &[Brick])> {
        let is_commit = header.kind() == MapSampleKind::Commit && self.epoch == Some(header.epoch);
        let mut listed: Vec<BlockKey> = unpack_commit(header, items).filter(|_| is_commit).map(|e| e.key).collect();
        listed.sort_unstable();
        let leaves = move |held: &&Held<S>| is_commit && listed.binary_search(&held.key).is_err();
        self.blocks.iter().filter(leaves).map(|held| (held.key, held.version, held.bricks.as_slice()))
    }

    /// True from the start, a new epoch or an incomplete commit until a commit is complete.
    pub fn keyframe_needed(&self) -> bool {
        self.keyframe_needed
    }

    /// Blocks held now.
    pub fn held(&self) -> usize {
        self.blocks.len()
    }

    /// Copies of our own in memory, in use or not: at most as many as blocks may be held, and one that is refused.
    pub fn copies(&self) -> usize {
        self.pool.len() + self.blocks.iter().filter(|held| matches!(held.bricks, Bricks::Own(_))).count()
    }

    /// Where a block is held, or where it would be.
    fn place(&self, key: BlockKey) -> Result<usize, usize> {
        self.blocks.binary_search_by_key(&key, |held| held.key)
    }

    /// A block of which nothing is known. New memory comes zeroed and untouched: pages of bricks that stay unknown cost none.
    fn unknown(&mut self) -> Box<[Brick]> {
        let Some(mut bricks) = self.pool.pop() else { return bytemuck::zeroed_slice_box(BRICKS_PER_BLOCK) };
        bricks.fill(Brick::UNKNOWN);
        bricks
    }

    /// Versions of two epochs do not compare: a restarted mapper starts anew, and so does its reader.
    fn enter_epoch(&mut self, epoch: u64) {
        if self.epoch != Some(epoch) {
            self.epoch = Some(epoch);
            self.blocks.drain(..).for_each(|held| recycle(&mut self.pool, held));
            self.complete = None;
            self.keyframe_needed = true;
        }
    }
}

/// Keeps the memory of a block that is held no longer.
fn recycle<S>(pool: &mut Vec<Box<[Brick]>>, held: Held<S>) {
    if let Bricks::Own(bricks) = held.bricks {
        pool.push(bricks);
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
