//! Stored blocks, as the mapper's shell sees them: what leaves the window is written down, what enters is read back.
//!
//! In: the mapper after each turn of its loop. Out: blocks put back into its map, counts of what was lost and why. It
//! never waits: a thread does the reading and writing, the queue to it is bounded, and what does not fit is dropped and
//! counted. A block that enters starts unknown and takes what was stored when it has been read, usually within a few
//! milliseconds; beams that came before are continued, see [`crate::Continuation`].
#![allow(clippy::disallowed_methods, reason = "shell: a thread of its own for the disk")]

mod fault;
mod folder;
#[cfg(test)]
mod tests;
mod worker;

pub use fault::StoreFault;
pub use folder::Folder;
pub use worker::{Done, Job, Worker};

use crate::config::Config;
use crate::continuation::{Continuation, Moment};
use crate::mapper::Mapper;
use crate::tsmap::{MapFileHeader, StoredBlock};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, channel, sync_channel};
use std::thread::JoinHandle;
use tsense_contract::BlockKey;
use tsense_geometry::Timestamp;

/// Blocks put back into the map in one turn of the loop: each is a copy of at most 0.8 MB, and scans wait meanwhile.
const RESTORED_PER_TURN: usize = 2;

/// What became of blocks since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreCounts {
    /// Written down.
    pub saved: u64,
    /// Read and put back.
    pub restored: u64,
    /// Not written because too many waited: lost.
    pub queue_full: u64,
    /// Not written because the disk failed: lost.
    pub write_failed: u64,
    /// Not read: damaged and set aside, or the disk failed.
    pub read_failed: u64,
    /// Files removed because of the limit.
    pub removed: u64,
}

/// The shell's side of the store.
pub struct BlockStore {
    jobs: Option<SyncSender<Job>>,
    done: Receiver<Done>,
    thread: Option<JoinHandle<()>>,
    /// Blocks of the window whose stored part has not been put back yet, with the request under way.
    wanted: BTreeMap<BlockKey, Option<u64>>,
    next_request: u64,
    counts: StoreCounts,
    /// What the disk said last, while it fails.
    fault: Option<StoreFault>,
}

impl BlockStore {
    /// Starts the thread, and makes the map keep what leaves. `folder` is where blocks lie.
    pub fn start(folder: &Path, config: &Config, mapper: &mut Mapper) -> std::io::Result<Self> {
        mapper.map_mut().keep_leaving();
        // Every block of the window may leave at once, and as many enter.
        let (jobs, to_do) = sync_channel(2 * mapper.map().block_slots());
        // As short as the queue: each answer is that of a job, and every turn takes what is there.
        let (finished, done) = channel();
        let limit_bytes = (config.blocks.disk_max_mb * 1e6) as u64;
        let worker = Worker::new(folder.into(), limit_bytes, Continuation::new(config));
        let work = move || worker.run(&to_do, &finished);
        let thread = std::thread::Builder::new().name("block-store".into()).spawn(work)?;
        Ok(Self {
            jobs: Some(jobs),
            done,
            thread: Some(thread),
            wanted: BTreeMap::new(),
            next_request: 0,
            counts: StoreCounts::default(),
            fault: None,
        })
    }

    /// One turn: hands on what left, asks for what entered, puts back what was read.
    pub fn turn(&mut self, mapper: &mut Mapper) {
        let Some(moment) = moment(mapper) else { return };
        let header = header(mapper, &moment);
        for block in mapper.map_mut().take_leaving() {
            self.save(&header, stamped(block, &moment));
        }
        self.wanted.retain(|key, _| mapper.map().window_holds(*key));
        for key in mapper.map_mut().take_entered() {
            self.wanted.insert(key, None);
        }
        self.ask(&header);
        self.take_done(mapper, &moment);
    }

    /// What became of blocks since the start.
    pub fn counts(&self) -> StoreCounts {
        self.counts
    }

    /// What the disk said, while it fails.
    pub fn fault(&self) -> Option<&StoreFault> {
        self.fault.as_ref()
    }

    /// Blocks of the window whose stored part is still to be read.
    pub fn wanted(&self) -> usize {
        self.wanted.len()
    }

    /// Ends: what waits is written, and with `with_window` also the blocks around the vehicle. This waits for the disk.
    pub fn finish(mut self, mapper: &mut Mapper, with_window: bool) -> StoreCounts {
        self.turn(mapper);
        let jobs = self.jobs.take();
        if let (true, Some(moment), Some(jobs)) = (with_window, moment(mapper), &jobs) {
            let header = header(mapper, &moment);
            for block in mapper.map_mut().copy_all() {
                let joins = self.wanted.contains_key(&block.key);
                let _ = jobs.send(Job::Save { header, block: stamped(block, &moment), joins });
            }
        }
        drop(jobs);
        if self.thread.take().is_some_and(|thread| thread.join().is_err()) {
            tracing::error!("the thread that stores blocks died; the blocks that waited are lost");
        }
        while let Ok(done) = self.done.try_recv() {
            self.count(&done);
        }
        self.counts
    }

    fn save(&mut self, header: &MapFileHeader, block: StoredBlock) {
        let joins = self.wanted.remove(&block.key).is_some();
        if !self.send(Job::Save { header: *header, block, joins }) {
            self.counts.queue_full += 1;
        }
    }

    fn ask(&mut self, header: &MapFileHeader) {
        let unasked: Vec<_> = self.wanted.iter().filter(|(_, asked)| asked.is_none()).map(|(key, _)| *key).collect();
        for key in unasked {
            let request = self.next_request;
            if !self.send(Job::Load { header: *header, key, request }) {
                return;
            }
            self.next_request += 1;
            self.wanted.insert(key, Some(request));
        }
    }

    /// False where the queue is full, or the thread is gone.
    fn send(&mut self, job: Job) -> bool {
        let Some(jobs) = &self.jobs else { return false };
        match jobs.try_send(job) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => false,
            Err(TrySendError::Disconnected(_)) => {
                let seen = "the thread that stores blocks is gone".to_owned();
                self.fault = Some(StoreFault::Disk { path: "block-store".into(), seen });
                false
            }
        }
    }

    fn take_done(&mut self, mapper: &mut Mapper, moment: &Moment) {
        let mut restored = 0;
        while restored < RESTORED_PER_TURN
            && let Ok(done) = self.done.try_recv()
        {
            self.count(&done);
            if let Done::Loaded { key, request, found } = done
                && self.wanted.get(&key) == Some(&Some(request))
            {
                self.wanted.remove(&key);
                if let Ok(Some(block)) = found {
                    mapper.map_mut().restore(&block, moment);
                    self.counts.restored += 1;
                    restored += 1;
                }
            }
        }
    }

    fn count(&mut self, done: &Done) {
        let fault = match done {
            Done::Saved { removed } => {
                self.counts.saved += 1;
                self.counts.removed += *removed as u64;
                None
            }
            Done::NotSaved(fault) => {
                self.counts.write_failed += 1;
                Some(fault)
            }
            Done::Loaded { found: Ok(_), .. } => return,
            Done::Loaded { found: Err(fault), .. } => {
                self.counts.read_failed += 1;
                Some(fault)
            }
        };
        if let Some(fault) = fault.filter(|fault| self.fault.as_ref() != Some(fault)) {
            tracing::warn!("{fault}");
        }
        // A damaged file is dealt with; only a disk that fails is a state to be in.
        self.fault = fault.filter(|fault| !matches!(fault, StoreFault::Damaged { .. })).cloned();
    }
}

/// When it is for the map; nothing before the first pose.
fn moment(mapper: &Mapper) -> Option<Moment> {
    let pose = mapper.placer().motion().last_pose()?;
    let stamp = mapper.newest().unwrap_or(Timestamp::from_ns(pose.stamp_ns));
    Some(Moment { epoch: mapper.epoch(), faded: mapper.map().faded(), stamp })
}

/// What the files say of the map.
fn header(mapper: &Mapper, moment: &Moment) -> MapFileHeader {
    let (zone, south) = mapper.placer().motion().zone().unwrap_or((0, 0));
    MapFileHeader::in_zone(mapper.map().grid().size_m(), moment.stamp, zone, south == 1)
}

fn stamped(block: StoredBlock, moment: &Moment) -> StoredBlock {
    StoredBlock { stamp: moment.stamp, epoch: moment.epoch, ..block }
}
