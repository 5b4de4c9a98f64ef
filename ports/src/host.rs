//! The launcher's side of a graph: it owns the domain, creates every service and holds it, and cleans up after deaths.
//!
//! The recipe, each point measured with processes killed at random moments:
//! only the launcher creates services, before it starts anybody; children open them with back-off; every process uses
//! the graph's own middleware settings, in which nobody cleans up by himself; the launcher waits for a dead child,
//! then removes its node's leftovers, then starts it again; now and then a janitor removes what was left half made; a
//! thread removes shared memory that never got a size, for which the middleware would wait for ever.
#![allow(clippy::disallowed_methods, reason = "shell: the graph's own small files")]

use crate::clock::Clock;
use crate::domain::{Domain, Facts};
use crate::error::PortError;
use crate::event::EVENT_PLACES;
use crate::memory::Most;
use crate::process::{self, Process};
use crate::service::{self, Role, topic_name};
use crate::unborn::Watch;
use crate::{cleanup, memory, request, topic};
use iceoryx2::prelude::{Config, Node, ipc};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{FlockOperation, flock};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::any::Any;
use std::fs::File;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::Path;
use tsense_contract::{Service as Request, Topic};

/// A child process as written down for the next launcher.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Leftover {
    /// Its process id.
    pub pid: u32,
    /// When it started, in the kernel's ticks: tells it from a later process with the same id.
    pub start_ticks: u64,
    /// Its name in the graph.
    pub name: String,
}

/// The launcher's side of a graph.
pub struct Host {
    domain: Domain,
    clock: Clock,
    config: Config,
    node: Option<Node<ipc::Service>>,
    held: Vec<Box<dyn Any>>,
    needed_bytes: u64,
    watch: Option<Watch>,
    lock: Option<File>,
}

impl Host {
    /// Takes the domain: locks it, ends and removes what an earlier launcher left, and writes the graph's own files.
    pub fn open(domain: Domain, clock: Clock, state_dir: &Path) -> Result<Self, PortError> {
        // What is likelier to be refused comes before what would stay behind.
        std::fs::create_dir_all(state_dir)
            .map_err(|e| PortError::system(format!("creating the state folder {}", state_dir.display()), e))?;
        let lock = lock(&domain)?;
        end_leftovers(&domain);
        // Nobody of this graph lives now, and the lock says that nobody else starts one.
        renew(&domain)?;
        domain.write_middleware_config()?;
        let watch = Some(Watch::start(domain.clone())?);
        let config = domain.adopt_middleware_config()?;
        let node = process::node(&config, "launcher")?;
        let facts =
            Facts { name: domain.name().into(), launcher: std::process::id(), clock, state_dir: state_dir.into() };
        domain.write_facts(&facts)?;
        Ok(Self { domain, clock, config, node: Some(node), held: Vec::new(), needed_bytes: 0, watch, lock: Some(lock) })
    }

    /// The graph's domain.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The graph's clock.
    pub fn clock(&self) -> Clock {
        self.clock
    }

    /// Creates a topic, or one instance of it, and holds it.
    pub fn offer<T: Topic>(&mut self, instance: Option<&str>) -> Result<(), PortError> {
        self.offer_most::<T>(instance, Most::ALL)
    }

    /// The same, where the configuration says how much of the topic's bounds is ever used.
    pub fn offer_most<T: Topic>(&mut self, instance: Option<&str>, most: Most) -> Result<(), PortError> {
        let name = topic_name::<T>(instance);
        let factory = service::topic::<T>(self.node()?, &name, Role::Create)?;
        self.held.push(Box::new(factory));
        if T::QOS.event {
            let event = service::event(self.node()?, &name, topic::event_places::<T>(), Role::Create)?;
            self.held.push(Box::new(event));
        }
        self.needed_bytes += memory::topic_bytes::<T>(most);
        Ok(())
    }

    /// Creates an event and holds it.
    pub fn offer_event(&mut self, name: &str) -> Result<(), PortError> {
        let event = service::event(self.node()?, name, EVENT_PLACES, Role::Create)?;
        self.held.push(Box::new(event));
        Ok(())
    }

    /// Creates a request-response service and holds it.
    pub fn offer_requests<S: Request>(&mut self) -> Result<(), PortError> {
        let factory = service::request::<S>(self.node()?, Role::Create)?;
        let event = service::event(self.node()?, S::NAME, request::event_places::<S>(), Role::Create)?;
        self.held.push(Box::new(factory));
        self.held.push(Box::new(event));
        self.needed_bytes += memory::request_bytes::<S>();
        Ok(())
    }

    /// Fails where shared memory is too small for what was offered. Call it before the children start.
    pub fn check_memory(&self) -> Result<(), PortError> {
        memory::check(self.needed_bytes)
    }

    /// Cleans up after children that died and were waited for; returns how many nodes were removed.
    pub fn clean_dead(&self) -> usize {
        cleanup::clean_dead(&self.domain, &self.config)
    }

    /// The janitor: removes what was left half made, but nothing young. For now and then.
    pub fn sweep(&self) {
        cleanup::clean_dead(&self.domain, &self.config);
        cleanup::sweep(&self.domain);
    }

    /// Ports for the launcher's own process.
    pub fn observer(&self, name: &str) -> Result<Process, PortError> {
        Process::observe(&self.domain, name)
    }

    /// Writes down the children, for the launcher that comes after this one is killed.
    pub fn note_children(&self, children: &[Leftover]) -> Result<(), PortError> {
        let lines = children.iter().map(|c| format!("{} {} {}\n", c.pid, c.start_ticks, c.name));
        self.domain.write(&self.domain.children_file(), &lines.collect::<String>())
    }

    fn node(&self) -> Result<&Node<ipc::Service>, PortError> {
        self.node
            .as_ref()
            .ok_or(PortError::Middleware { doing: "offering a topic", seen: "the graph is closed".into() })
    }
}

impl Drop for Host {
    /// Leaves nothing behind: the children have ended, so everything of this graph can go.
    fn drop(&mut self) {
        self.held.clear();
        self.clean_dead();
        self.node = None;
        self.watch = None;
        self.domain.erase();
        self.lock = None;
    }
}

/// Locks the domain; the lock ends with this process, however it ends.
fn lock(domain: &Domain) -> Result<File, PortError> {
    // An ending launcher removes the file it holds: then the lock is on a file that is no longer there. Try again.
    for _ in 0..20 {
        make_root(domain)?;
        let path = domain.lock_file();
        let file = File::options().create(true).append(true).open(&path);
        let file = file.map_err(|e| PortError::system(format!("opening {}", path.display()), e))?;
        if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            let pid = domain.facts().map_or(0, |facts| facts.launcher);
            return Err(PortError::AlreadyRunning { name: domain.name().into(), pid });
        }
        if file.metadata().ok().map(|m| m.ino()) == inode(&path) {
            return Ok(file);
        }
    }
    Err(PortError::AlreadyRunning { name: domain.name().into(), pid: 0 })
}

fn inode(path: &Path) -> Option<u64> {
    std::fs::metadata(path).ok().map(|m| m.ino())
}

/// Creates the root, private to this user; refuses one that belongs to somebody else.
fn make_root(domain: &Domain) -> Result<(), PortError> {
    let root = domain.root();
    let doing = || format!("creating {}", root.display());
    match std::fs::DirBuilder::new().mode(0o700).create(root) {
        Ok(()) => return Ok(()),
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
        Err(e) => return Err(PortError::system(doing(), e)),
    }
    let meta = std::fs::symlink_metadata(root).map_err(|e| PortError::system(doing(), e))?;
    if meta.is_dir() && meta.uid() == rustix::process::getuid().as_raw() {
        return Ok(());
    }
    Err(PortError::system(doing(), std::io::Error::other("it is there and belongs to another user, or is no folder")))
}

/// Removes everything of an earlier launcher but the lock.
fn renew(domain: &Domain) -> Result<(), PortError> {
    for path in domain.leftovers().iter().filter(|p| *p != domain.root()) {
        let _ = std::fs::remove_file(path);
    }
    let failed = |e| PortError::system(format!("clearing {}", domain.root().display()), e);
    for entry in std::fs::read_dir(domain.root()).map_err(failed)?.flatten() {
        let path = entry.path();
        if path == domain.lock_file() {
            continue;
        }
        let removed = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        removed.map_err(failed)?;
    }
    Ok(())
}

/// Ends the children of a launcher that was killed. They got SIGTERM at its death; who hangs is killed.
fn end_leftovers(domain: &Domain) {
    let text = std::fs::read_to_string(domain.children_file()).unwrap_or_default();
    for child in text.lines().filter_map(parse_leftover) {
        if start_ticks(child.pid) == Some(child.start_ticks) {
            tracing::info!(process = child.name, pid = child.pid, "ending a child of a launcher that died");
            end(&child);
        }
    }
}

fn end(child: &Leftover) {
    let Some(pid) = i32::try_from(child.pid).ok().and_then(Pid::from_raw) else { return };
    let Ok(handle) = pidfd_open(pid, PidfdFlags::empty()) else { return };
    // The handle now means one process for good; make sure that it is the one written down.
    if start_ticks(child.pid) != Some(child.start_ticks) {
        return;
    }
    for (signal, patience_s) in [(Signal::TERM, 1.0), (Signal::KILL, 2.0)] {
        let _ = pidfd_send_signal(&handle, signal);
        let mut polled = [PollFd::new(&handle, PollFlags::IN)];
        if poll(&mut polled, Some(&process::timespec(patience_s))).is_ok_and(|ready| ready > 0) {
            return;
        }
    }
}

fn parse_leftover(line: &str) -> Option<Leftover> {
    let mut words = line.split(' ');
    let (pid, start_ticks, name) = (words.next()?, words.next()?, words.next()?);
    Some(Leftover { pid: pid.parse().ok()?, start_ticks: start_ticks.parse().ok()?, name: name.into() })
}

impl Leftover {
    /// A living child; none where it is gone already.
    pub fn of(pid: u32, name: &str) -> Option<Self> {
        Some(Self { pid, start_ticks: start_ticks(pid)?, name: name.into() })
    }
}

/// When a process started, in the kernel's ticks since boot: field 22 of its `stat`.
fn start_ticks(pid: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the name in parentheses and may hold anything.
    text.rsplit_once(')')?.1.split_whitespace().nth(19)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_child_is_known_by_its_start_and_not_by_its_number_alone() {
        let me = Leftover::of(std::process::id(), "mapper").unwrap();
        let line = format!("{} {} {}", me.pid, me.start_ticks, me.name);
        assert_eq!(parse_leftover(&line), Some(me));
        assert_eq!(parse_leftover("12 x mapper"), None);
        assert_eq!(parse_leftover("12"), None);
    }

    #[test]
    fn a_second_launcher_is_refused_and_a_third_starts_after_the_first_ended() {
        let domain = Domain::new(&format!("lock{}", std::process::id())).unwrap();
        let state = std::env::temp_dir();
        let first = Host::open(domain.clone(), Clock::start(1.0), &state).unwrap();
        let second = Host::open(domain.clone(), Clock::start(1.0), &state).map(drop);
        let error = second.unwrap_err();
        assert!(matches!(&error, PortError::AlreadyRunning { pid, .. } if *pid == std::process::id()), "{error}");
        drop(first);
        assert_eq!(domain.leftovers(), Vec::<std::path::PathBuf>::new());
        drop(Host::open(domain.clone(), Clock::start(1.0), &state).unwrap());
        assert_eq!(domain.leftovers(), Vec::<std::path::PathBuf>::new());
    }
}
