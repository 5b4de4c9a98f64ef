//! The process graph: starts one process a stage, watches them, starts them again, ends them; used by `run` and `demo`.
//!
//! In: a [`Config`]. Out: running children (`tsense process NAME`), their table ([`Graph::status`], topic `processes`,
//! `tsense status`), and the reason to end. The launcher alone creates the topics and cleans up after deaths; the
//! recipe stands at [`tsense_ports::Host`]. It never touches data: it could crash and the data would not change.
#![allow(clippy::disallowed_methods, reason = "shell: the launcher's own files and processes")]

mod child;
mod control;
mod end;
mod offer;
mod table;
mod usage;

pub use control::{Asked as Request, ask};
pub use end::{Asked, GraphError};
#[allow(unused_imports, reason = "`demo` uses what `run` does not")]
pub use table::{ProcessRow, Status};

use crate::config::Config;
use child::Child;
use rustix::event::{PollFd, PollFlags, poll};
use std::path::PathBuf;
use table::Table;
use tsense_contract::{Heartbeats, Processes};
use tsense_ports::{Clock, Domain, Host, Inbox, Leftover, Outbox, PortError, Process, machine_seconds, signals};

/// Longest sleep of the launcher, seconds: heartbeats wake nobody, they are looked for.
const TICK_S: f64 = 0.1;
/// Time between two tables on the topic `processes`, seconds.
const TABLE_S: f64 = 0.5;
/// Time between two rounds of the janitor, seconds.
const JANITOR_S: f64 = 10.0;

/// How a graph is started.
#[derive(Clone, Debug)]
pub struct GraphOptions {
    /// What is started; must be valid.
    pub config: Config,
    /// Graph seconds in a second of the machine: 1 in production.
    pub speed: f64,
    /// Where the children's log goes instead of this process's standard error.
    pub log_file: Option<PathBuf>,
}

impl GraphOptions {
    /// At the speed of the machine, logging to standard error.
    pub fn new(config: Config) -> Self {
        Self { config, speed: 1.0, log_file: None }
    }
}

/// A running graph. Use it from one thread: the children die with the thread that started them.
pub struct Graph {
    options: GraphOptions,
    children: Vec<Child>,
    table: Table,
    control: control::Server,
    asked: Option<Asked>,
    next_table_s: f64,
    next_sweep_s: f64,
    // Ports before the process they belong to, and the host last: it removes everything.
    beats: Inbox<Heartbeats>,
    processes: Outbox<Processes>,
    process: Process,
    host: Host,
}

#[allow(dead_code, reason = "`demo` uses what `run` does not")]
impl Graph {
    /// Takes the graph's domain, creates every topic, and starts every process.
    pub fn start(options: GraphOptions) -> Result<Self, GraphError> {
        let faults = options.config.validate();
        if !faults.is_empty() {
            let lines = faults.iter().map(|(section, fault)| format!("[{section}] {fault}"));
            return Err(GraphError::Config(lines.collect::<Vec<_>>().join("\n")));
        }
        signals::install()?;
        let graph = &options.config.graph;
        let domain = Domain::new(&graph.name)?;
        let mut host = Host::open(domain.clone(), Clock::start(options.speed), &graph.state_dir())?;
        offer::everything(&mut host, &options.config)?;
        host.check_memory()?;
        domain.write(&domain.config_file(), &options.config.to_toml())?;
        let mut process = host.observer("launcher-ports")?;
        let names = options.config.process_names();
        let mut graph = Self {
            children: names.iter().map(|name| Child::new(name)).collect(),
            table: Table::new(&names),
            control: control::Server::bind(&domain.socket())?,
            asked: None,
            next_table_s: 0.0,
            next_sweep_s: machine_seconds() + JANITOR_S,
            beats: process.inbox(None)?,
            processes: process.outbox(None)?,
            process,
            host,
            options,
        };
        graph.start_due()?;
        tracing::info!(graph = domain.name(), processes = names.len(), "started");
        Ok(graph)
    }

    /// Does what there is to do, waiting up to `timeout_s` seconds of the machine for something to happen. Call it all
    /// the time. Says who asked the graph to end, once somebody did; it goes on working until [`Graph::stop`].
    pub fn poll(&mut self, timeout_s: f64) -> Result<Option<Asked>, GraphError> {
        self.sleep(timeout_s.min(TICK_S));
        self.reap()?;
        self.start_due()?;
        self.take_heartbeats()?;
        self.publish()?;
        self.answer();
        self.sweep();
        let signal = signals::requested().map(Asked::from);
        self.asked = self.asked.or(signal);
        Ok(self.asked)
    }

    /// Polls until `done` says so (`None`), or somebody asks the graph to end.
    pub fn run_until(&mut self, mut done: impl FnMut(&mut Self) -> bool) -> Result<Option<Asked>, GraphError> {
        loop {
            if let Some(asked) = self.poll(TICK_S)? {
                return Ok(Some(asked));
            }
            if done(self) {
                return Ok(None);
            }
        }
    }

    /// The table of processes, as of the last poll.
    pub fn status(&self) -> Status {
        self.table.status(self.host.domain().name(), self.host.clock().now())
    }

    /// Ports for this process, to read the graph's topics; drop them before the graph ends.
    pub fn observer(&self, name: &str) -> Result<Process, PortError> {
        self.host.observer(name)
    }

    /// The graph's clock.
    pub fn clock(&self) -> Clock {
        self.host.clock()
    }

    /// Where the graph lives.
    pub fn domain(&self) -> &Domain {
        self.host.domain()
    }

    /// Ends every process, in the reverse order of their start, and removes everything of the graph.
    pub fn stop(mut self) {
        self.end_children();
    }

    fn sleep(&self, seconds: f64) {
        let fixed = [Some(self.control.descriptor()), signals::descriptor()];
        let children = self.children.iter().filter_map(Child::descriptor);
        let descriptors: Vec<_> = fixed.into_iter().flatten().chain(children).collect();
        let mut polled: Vec<_> = descriptors.iter().map(|d| PollFd::new(d, PollFlags::IN)).collect();
        let span = std::time::Duration::try_from_secs_f64(seconds).unwrap_or_default();
        let timeout = span.try_into().ok();
        // Errors are signals, which poll looks for anyway.
        let _ = poll(&mut polled, timeout.as_ref());
    }

    /// Notes who died, then cleans up after all of them, one at a time, before anybody is started again.
    fn reap(&mut self) -> Result<(), GraphError> {
        let mut died = false;
        let (max, window_s) = (self.options.config.graph.restarts_max, self.options.config.graph.restart_window_s);
        let mut fatal = Ok(());
        for child in &mut self.children {
            let Some(death) = child.reap()? else { continue };
            died = true;
            self.table.died(child.name(), &death.words);
            fatal = fatal.and(child.plan_restart(&death, max, window_s));
        }
        if died {
            self.host.clean_dead();
        }
        fatal
    }

    fn start_due(&mut self) -> Result<(), GraphError> {
        let now_s = machine_seconds();
        let config = self.host.domain().config_file();
        let mut started = false;
        for child in self.children.iter_mut().filter(|child| child.is_due(now_s)) {
            let pid = child.start(&config, self.options.log_file.as_deref())?;
            self.table.started(child.name(), pid, child.restarts());
            started = true;
        }
        if started {
            let alive = self.children.iter().filter_map(|child| Leftover::of(child.pid()?, child.name()));
            self.host.note_children(&alive.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    fn take_heartbeats(&mut self) -> Result<(), GraphError> {
        while let Some(beat) = self.beats.take()? {
            let name = beat.header().name.to_text().into_owned();
            if let Some(child) =
                self.children.iter_mut().find(|c| c.name() == name && c.pid() == Some(beat.header().pid))
            {
                child.beats();
                self.table.beat(&name, beat.header());
            }
        }
        Ok(())
    }

    fn publish(&mut self) -> Result<(), GraphError> {
        // Readers that came since are connected here; nothing is waited for.
        self.process.wait(0.0);
        let now_s = machine_seconds();
        if now_s < self.next_table_s {
            return Ok(());
        }
        self.next_table_s = now_s + TABLE_S;
        self.table.measure(now_s);
        let (header, rows) = self.status().message(self.host.clock().now());
        Ok(self.processes.send(&header, &rows)?)
    }

    fn answer(&mut self) {
        let status = self.status();
        if self.control.answer(&status) {
            self.asked = self.asked.or(Some(Asked::Stop));
        }
    }

    fn sweep(&mut self) {
        let now_s = machine_seconds();
        if now_s >= self.next_sweep_s {
            self.next_sweep_s = now_s + JANITOR_S;
            self.host.sweep();
        }
    }

    fn end_children(&mut self) {
        for child in self.children.iter().rev() {
            child.ask_to_end();
        }
        let until_s = machine_seconds() + tsense_ports::STOP_TIMEOUT_S;
        while self.children.iter().any(Child::is_running) && machine_seconds() < until_s {
            self.sleep(until_s - machine_seconds());
            self.children.iter_mut().for_each(Child::note_end);
        }
        self.children.iter_mut().for_each(Child::kill);
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        self.end_children();
    }
}
