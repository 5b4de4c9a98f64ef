//! A process of a graph: its ports, its clock, and the loop that waits, beats and stops.
//!
//! In: events of its inboxes, SIGTERM and SIGINT. Out: a heartbeat five times a second. It knows nothing of what the
//! process does; a stage's `run` calls [`Process::wait`] in a loop and acts on the [`Wake`] it returns.
#![allow(unsafe_code, reason = "listeners lend their descriptors as numbers")]

use crate::clock::{Clock, machine_seconds};
use crate::domain::Domain;
use crate::error::PortError;
use crate::event::{Bell, EVENT_PLACES, EventReceiver, EventSender};
use crate::health::Health;
use crate::request::{Client, Server};
use crate::topic::{Inbox, Outbox, Tick, Wakes};
use crate::{parent, signals};
use iceoryx2::prelude::*;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};
use std::rc::{Rc, Weak};
use tsense_contract::{Heartbeats, Service as Request, Topic};

/// Time between two heartbeats, seconds of the machine.
pub const HEARTBEAT_S: f64 = 0.2;

/// Why [`Process::wait`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wake {
    /// Something may wait in an inbox, an event receiver or a server: take until there is none.
    Data,
    /// The time is up.
    Timeout,
    /// The process is asked to end: return from `run`.
    Stop,
}

/// This process's place in its graph. It stays on the thread that made it.
pub struct Process {
    name: String,
    node: Node<ipc::Service>,
    clock: Clock,
    state_dir: PathBuf,
    health: Health,
    beats: Option<Outbox<Heartbeats>>,
    next_tick_s: f64,
    bells: Vec<Weak<Bell>>,
    ports: Vec<Weak<dyn Tick>>,
}

impl Process {
    /// Joins the graph as one of the launcher's children: bound to it, watched by it, named in `ps`.
    pub fn join(domain: &Domain, name: &str) -> Result<Self, PortError> {
        let facts = domain.facts()?;
        parent::bind(name, domain, &facts)?;
        signals::install()?;
        parent::watch()?;
        parent::set_title(name);
        let mut process = Self::observe(domain, name)?;
        process.beats = Some(Outbox::open(&process.node, None)?);
        process.tick();
        Ok(process)
    }

    /// Looks into a running graph without being part of it: no heartbeats, no restarts. For recorders, tools and tests.
    pub fn observe(domain: &Domain, name: &str) -> Result<Self, PortError> {
        let facts = domain.facts()?;
        let config = domain.adopt_middleware_config()?;
        Ok(Self {
            name: name.into(),
            node: node(&config, name)?,
            clock: facts.clock,
            state_dir: facts.state_dir,
            health: Health::new(),
            beats: None,
            next_tick_s: 0.0,
            bells: Vec::new(),
            ports: Vec::new(),
        })
    }

    /// The name of this process in its graph.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The graph's clock.
    pub fn clock(&self) -> Clock {
        self.clock
    }

    /// Where this graph may keep files.
    pub fn state_dir(&self) -> &Path {
        &self.state_dir
    }

    /// The state and the counters that go out with the heartbeat.
    pub fn health(&mut self) -> &mut Health {
        &mut self.health
    }

    /// Opens the writing end of a topic, or of one instance of it.
    pub fn outbox<T: Topic>(&mut self, instance: Option<&str>) -> Result<Outbox<T>, PortError> {
        let outbox = Outbox::open(&self.node, instance)?;
        self.ports.push(outbox.ticker());
        Ok(outbox)
    }

    /// Opens the reading end of a topic, or of one instance of it.
    pub fn inbox<T: Topic>(&mut self, instance: Option<&str>) -> Result<Inbox<T>, PortError> {
        let inbox = Inbox::open(&self.node, instance, Wakes::Yes)?;
        self.ports.push(inbox.ticker());
        self.bells.extend(inbox.bell().map(Rc::downgrade));
        Ok(inbox)
    }

    /// As [`Process::inbox`], but its samples wake nobody: for a process that looks at times of its own.
    pub fn quiet_inbox<T: Topic>(&mut self, instance: Option<&str>) -> Result<Inbox<T>, PortError> {
        Inbox::open(&self.node, instance, Wakes::No)
    }

    /// Opens the sending end of an event.
    pub fn event_sender(&mut self, name: &str) -> Result<EventSender, PortError> {
        EventSender::open(&self.node, name, EVENT_PLACES)
    }

    /// Opens the receiving end of an event.
    pub fn event_receiver(&mut self, name: &str) -> Result<EventReceiver, PortError> {
        let receiver = EventReceiver::open(&self.node, name, EVENT_PLACES)?;
        self.bells.push(Rc::downgrade(receiver.bell()));
        Ok(receiver)
    }

    /// Opens the asking end of a service.
    pub fn client<S: Request>(&mut self) -> Result<Client<S>, PortError> {
        Client::open(&self.node)
    }

    /// Opens the answering end of a service.
    pub fn server<S: Request>(&mut self) -> Result<Server<S>, PortError> {
        let server = Server::open(&self.node)?;
        self.bells.push(Rc::downgrade(server.bell()));
        Ok(server)
    }

    /// Waits for data up to `timeout_s` graph seconds, sending heartbeats meanwhile. Without waiting (`0.0`) it is
    /// the tick of a loop that blocks elsewhere: call it at least every 0.2 s.
    ///
    /// Five times a second it also wakes for samples that came without an event: from a writer killed between the
    /// two, from a topic's history, or of a topic that has none.
    pub fn wait(&mut self, timeout_s: f64) -> Wake {
        let until_s = machine_seconds() + self.clock.real(timeout_s).as_secs_f64();
        loop {
            let waiting = self.tick();
            if signals::requested().is_some() {
                return Wake::Stop;
            }
            if self.drain() || waiting {
                return Wake::Data;
            }
            let now_s = machine_seconds();
            if now_s >= until_s {
                return Wake::Timeout;
            }
            self.sleep(until_s.min(self.next_tick_s) - now_s);
        }
    }

    /// At most five times a second, or when the state changed: beats, connects, and tells whether samples wait.
    fn tick(&mut self) -> bool {
        let now_s = machine_seconds();
        let changed = self.health.take_change();
        if now_s < self.next_tick_s && !changed {
            return false;
        }
        self.next_tick_s = now_s + HEARTBEAT_S;
        self.beat();
        self.ports.retain(|port| port.strong_count() > 0);
        let waiting = self.ports.iter().filter_map(Weak::upgrade).map(|port| port.tick());
        waiting.fold(false, |any, this| any | this)
    }

    fn beat(&mut self) {
        let beat = self.health.heartbeat(&self.name, self.clock.now());
        let Some(beats) = &mut self.beats else { return };
        if let Err(e) = beats.send(&beat, &[]) {
            tracing::warn!(error = %e, "a heartbeat was not sent; the launcher may call this process stale");
        }
    }

    fn drain(&mut self) -> bool {
        self.bells.retain(|bell| bell.strong_count() > 0);
        let rung = self.bells.iter().filter_map(Weak::upgrade).map(|bell| bell.drain());
        rung.fold(false, |any, this| any | this)
    }

    /// Sleeps until an event, a signal, or the time is up.
    fn sleep(&self, seconds: f64) {
        let bells: Vec<Rc<Bell>> = self.bells.iter().filter_map(Weak::upgrade).collect();
        let listeners = bells.iter().map(|bell| {
            // SAFETY: `bells` keeps the listeners, and so their descriptors, open for as long as they are polled.
            unsafe { BorrowedFd::borrow_raw(bell.listener.file_descriptor().native_handle()) }
        });
        let descriptors: Vec<BorrowedFd<'_>> = listeners.chain(signals::descriptor()).collect();
        let mut polled: Vec<PollFd<'_>> = descriptors.iter().map(|d| PollFd::new(d, PollFlags::IN)).collect();
        // Errors are signals, which the caller looks for anyway.
        let _ = poll(&mut polled, Some(&timespec(seconds)));
    }
}

/// A node that handles no signals and cleans up nobody.
pub(crate) fn node(config: &Config, name: &str) -> Result<Node<ipc::Service>, PortError> {
    let failed = |seen: String| PortError::Middleware { doing: "joining the graph's shared memory", seen };
    let name = NodeName::new(name).map_err(|e| failed(format!("{e:?}")))?;
    NodeBuilder::new()
        .name(&name)
        .config(config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|e| failed(e.to_string()))
}

/// Seconds for the operating system; negative is nothing.
pub(crate) fn timespec(seconds: f64) -> Timespec {
    let span = std::time::Duration::try_from_secs_f64(seconds).unwrap_or_default();
    Timespec { tv_sec: span.as_secs() as i64, tv_nsec: i64::from(span.subsec_nanos()) }
}
