//! The thread that reads and writes stored blocks, so that a slow disk never holds up the tracing of beams.
//!
//! In: jobs, in order, from a bounded queue. Out: what was read, and how each job went. The jobs themselves are plain
//! calls, so that a test runs them without a thread.

use super::fault::StoreFault;
use super::folder::Folder;
use crate::continuation::Continuation;
use crate::tsmap::{MapFileHeader, StoredBlock};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender};
use tsense_contract::BlockKey;

/// One thing to do.
#[derive(Debug)]
pub enum Job {
    /// Write a block down.
    Save {
        /// Of which map.
        header: MapFileHeader,
        /// The block.
        block: StoredBlock,
        /// It left before what is stored of it had been read: that is to be continued, not replaced.
        joins: bool,
    },
    /// Read a block.
    Load {
        /// Of which map.
        header: MapFileHeader,
        /// Which block.
        key: BlockKey,
        /// The number of the request.
        request: u64,
    },
}

/// How a job went.
#[derive(Debug)]
pub enum Done {
    /// A block was written; so many older files went for it.
    Saved {
        /// Files removed.
        removed: usize,
    },
    /// A block was not written, and is lost.
    NotSaved(StoreFault),
    /// A block was looked for.
    Loaded {
        /// Which block.
        key: BlockKey,
        /// The number of the request.
        request: u64,
        /// What was found.
        found: Result<Option<StoredBlock>, StoreFault>,
    },
}

/// What the thread works on.
#[derive(Debug)]
pub struct Worker {
    root: PathBuf,
    limit_bytes: u64,
    continuation: Continuation,
    /// Open from the first job that finds it possible.
    folder: Option<Folder>,
}

impl Worker {
    /// Nothing is opened yet.
    pub fn new(root: PathBuf, limit_bytes: u64, continuation: Continuation) -> Self {
        Self { root, limit_bytes, continuation, folder: None }
    }

    /// Does jobs until nobody can send any more.
    pub fn run(mut self, jobs: &Receiver<Job>, done: &Sender<Done>) {
        for job in jobs {
            // Whoever asked may have gone; what is still to be written is written all the same.
            let _ = done.send(self.work(job));
        }
    }

    /// Does one job.
    pub fn work(&mut self, job: Job) -> Done {
        match job {
            Job::Save { header, block, joins } => match self.save(&header, block, joins) {
                Ok(removed) => Done::Saved { removed },
                Err(fault) => Done::NotSaved(fault),
            },
            Job::Load { header, key, request } => {
                let found = self.folder().and_then(|folder| folder.load(&header, key));
                Done::Loaded { key, request, found }
            }
        }
    }

    fn save(&mut self, header: &MapFileHeader, mut block: StoredBlock, joins: bool) -> Result<usize, StoreFault> {
        if joins && let Ok(Some(older)) = self.folder()?.load(header, block.key) {
            block = self.continuation.joined(&older, &block);
        }
        self.folder()?.save(header, &block)
    }

    fn folder(&mut self) -> Result<&mut Folder, StoreFault> {
        let folder = match self.folder.take() {
            Some(folder) => folder,
            None => Folder::open(&self.root, self.limit_bytes)?,
        };
        Ok(self.folder.insert(folder))
    }
}
