//! Shell: the thread that writes the store down, so that a slow disk never holds up the store.
//!
//! In: changes, one job at a time. Out: the same changes with what became of them. Where the file could not be opened
//! it is tried again with every job; what is found then is handed over first, and the job comes back unwritten.
#![allow(clippy::disallowed_methods, reason = "shell: a thread of its own for the disk")]

use crate::config::Config;
use crate::persist::{FileFault, Loaded, Room, Vault};
use crate::records::Changes;
use crate::zone::Zone;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;

/// What to write.
struct Job {
    zone: Zone,
    changes: Changes,
}

/// What became of a job.
pub struct Done {
    /// The zone and the changes as they were given.
    pub zone: Zone,
    /// What was to be written.
    pub changes: Changes,
    /// Whether they are on disk now.
    pub outcome: Result<Outcome, FileFault>,
}

/// What the thread did.
pub enum Outcome {
    /// The changes are on disk; how much room is left there.
    Written(Room),
    /// The file could be opened only now; nothing was written yet. This is what was in it.
    Found(Loaded),
}

/// The writing thread as its owner sees it.
pub struct Writer {
    jobs: SyncSender<Job>,
    done: Receiver<Done>,
    thread: JoinHandle<Result<(), FileFault>>,
    busy: bool,
}

impl Writer {
    /// Starts the thread; `vault` is the open file, if it could be opened.
    pub fn start(path: PathBuf, config: Config, vault: Option<Vault>) -> std::io::Result<Self> {
        // One job at a time: changes that come meanwhile are gathered in the store, which is bounded.
        let (jobs, to_do) = sync_channel(1);
        let (finished, done) = sync_channel(1);
        let work = move || work(&path, &config, vault, &to_do, &finished);
        let thread = std::thread::Builder::new().name("kstore-writer".into()).spawn(work)?;
        Ok(Self { jobs, done, thread, busy: false })
    }

    /// True where a job is under way.
    pub fn is_busy(&self) -> bool {
        self.busy
    }

    /// Hands over a job; gives it back where one is under way or the thread is gone.
    pub fn write(&mut self, zone: Zone, changes: Changes) -> Result<(), Changes> {
        if self.busy {
            return Err(changes);
        }
        self.jobs.try_send(Job { zone, changes }).map_err(|e| match e {
            std::sync::mpsc::TrySendError::Full(job) | std::sync::mpsc::TrySendError::Disconnected(job) => job.changes,
        })?;
        self.busy = true;
        Ok(())
    }

    /// The finished job, if there is one; an error where the thread died.
    pub fn done(&mut self) -> Result<Option<Done>, WriterDied> {
        match self.done.try_recv() {
            Ok(done) => {
                self.busy = false;
                Ok(Some(done))
            }
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(WriterDied),
        }
    }

    /// Waits for the job under way, if there is one.
    pub fn wait(&mut self) -> Result<Option<Done>, WriterDied> {
        if !self.busy {
            return Ok(None);
        }
        let done = self.done.recv().map_err(|_| WriterDied)?;
        self.busy = false;
        Ok(Some(done))
    }

    /// Waits for the job under way, then closes the file.
    pub fn close(mut self) -> Result<Option<Done>, WriterDied> {
        let last = self.wait()?;
        drop(self.jobs);
        match self.thread.join() {
            Ok(Ok(())) => Ok(last),
            Ok(Err(fault)) => {
                tracing::warn!(%fault, "the store's file was left with its log; the next start reads both");
                Ok(last)
            }
            Err(_) => Err(WriterDied),
        }
    }
}

/// The writing thread ended by a fault of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the thread that writes the store died; the store is restarted from its file")]
pub struct WriterDied;

fn work(
    path: &std::path::Path,
    config: &Config,
    mut vault: Option<Vault>,
    to_do: &Receiver<Job>,
    finished: &SyncSender<Done>,
) -> Result<(), FileFault> {
    for Job { zone, changes } in to_do {
        let outcome = match &mut vault {
            Some(vault) => vault.commit(zone, &changes).map(Outcome::Written),
            None => Vault::open(path, config).map(|(opened, loaded)| {
                vault = Some(opened);
                Outcome::Found(loaded)
            }),
        };
        if finished.send(Done { zone, changes, outcome }).is_err() {
            break;
        }
    }
    vault.map_or(Ok(()), Vault::close)
}
