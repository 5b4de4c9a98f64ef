//! The demo's eyes: reads the graph's topics as any consumer would, shows progress, and scores at the end.

use super::DemoArgs;
use super::ages::AgeReader;
use super::scorecard::{Flow, GridLog, Scorecard};
use crate::commands::{Failure, tell};
use crate::graph::{Graph, Status};
use std::io::{IsTerminal, Write};
use tsense_contract::{Grid, Object, Objects, Scan, Store, StoreQuery};
use tsense_geometry::Timestamp;
use tsense_ports::{Client, Inbox, Process};
use tsense_simulator::{Rig, Sight, World};

/// Between two lines of progress, seconds of the world.
const PROGRESS_S: f64 = 1.0;
/// Between two grids that are kept for the score, seconds of the world.
const GRID_S: f64 = 1.0;
/// How long the store may take to answer at the end, seconds.
const ANSWER_S: f64 = 2.0;

/// Reads and remembers what the score needs.
pub struct Watch {
    scans: Vec<Inbox<Scan>>,
    grid: Inbox<Grid>,
    objects: Inbox<Objects>,
    store: Client<Store>,
    process: Process,
    started: Timestamp,
    duration_s: Option<f64>,
    is_quiet: bool,
    is_terminal: bool,
    said_address: bool,
    up_after_s: Option<f64>,
    next_progress: Timestamp,
    next_grid: Timestamp,
    beams: u64,
    first_scan: Option<Timestamp>,
    reported: usize,
    ages: AgeReader,
    cells: GridLog,
}

impl Watch {
    /// Opens the topics; `ladars` are those whose beams are counted.
    pub fn new(graph: &Graph, args: &DemoArgs, ladars: &[String]) -> Result<Self, Failure> {
        let mut process = graph.observer("demo")?;
        let started = graph.clock().now();
        Ok(Self {
            scans: ladars.iter().map(|name| process.inbox(Some(name))).collect::<Result<_, _>>()?,
            grid: process.inbox(None)?,
            objects: process.inbox(None)?,
            store: process.client()?,
            process,
            started,
            duration_s: args.duration_s,
            is_quiet: args.quiet,
            is_terminal: std::io::stderr().is_terminal(),
            said_address: false,
            up_after_s: None,
            next_progress: started,
            next_grid: started,
            beams: 0,
            first_scan: None,
            reported: 0,
            ages: AgeReader::start(graph.domain().clone()).map_err(|e| Failure::new(1, e))?,
            cells: GridLog::default(),
        })
    }

    /// Takes what has come. True when the demo's time is over.
    pub fn look(&mut self, graph: &Graph, world: &World) -> bool {
        let now = graph.clock().now();
        self.process.wait(0.0);
        self.take_scans(now);
        self.take_grids(now);
        self.take_objects();
        let elapsed_s = now.seconds_since(self.started);
        let status = graph.status();
        if self.up_after_s.is_none() && status.is_up() {
            self.up_after_s = Some(elapsed_s / world.clock().speed());
        }
        if now >= self.next_progress {
            self.next_progress = now.plus_seconds(PROGRESS_S);
            self.say(&status, elapsed_s);
        }
        self.duration_s.is_some_and(|duration_s| elapsed_s >= duration_s)
    }

    fn take_scans(&mut self, now: Timestamp) {
        for inbox in &mut self.scans {
            while let Ok(Some(scan)) = inbox.take() {
                self.first_scan.get_or_insert(now);
                self.beams += scan.items().len() as u64;
            }
        }
    }

    fn take_grids(&mut self, now: Timestamp) {
        while let Ok(Some(sample)) = self.grid.take() {
            if now >= self.next_grid {
                self.next_grid = now.plus_seconds(GRID_S);
                self.cells.add(sample.header(), sample.items());
            }
        }
    }

    fn take_objects(&mut self) {
        while let Ok(Some(sample)) = self.objects.take() {
            self.reported = sample.items().iter().filter(|object| object.reported != 0).count();
        }
    }

    fn say(&mut self, status: &Status, elapsed_s: f64) {
        if self.is_quiet {
            return;
        }
        let mut err = std::io::stderr().lock();
        let bridge = status.process("bridge").map(|row| row.reason.as_str()).unwrap_or_default();
        // A terminal that went away is no reason to stop.
        if let (false, Some(at)) = (self.said_address, bridge.find("http://")) {
            let address = bridge[at..].split([' ', ',']).next().unwrap_or_default();
            let _ = writeln!(err, "page: {address}");
            self.said_address = true;
        }
        let up = status.processes.iter().filter(|row| row.state.as_str() == "running").count();
        let line = format!(
            "{elapsed_s:5.0} s  {up}/{} processes running  {} beams  {} trees reported",
            status.processes.len(),
            self.beams,
            self.reported,
        );
        let _ = if self.is_terminal { write!(err, "\r{line}  ") } else { writeln!(err, "{line}") };
        let _ = err.flush();
    }

    /// The score so far.
    pub fn scorecard(&mut self, graph: &Graph, world: &World, rig: &Rig) -> Scorecard {
        if self.is_terminal && !self.is_quiet {
            tell("");
        }
        let now = graph.clock().now();
        let measured_s = self.first_scan.map_or(f64::NAN, |first| now.seconds_since(first));
        let flow = Flow {
            beams_per_s: self.beams as f64 / measured_s,
            ages: self.ages.finish(),
            duration_s: now.seconds_since(self.started),
            up_after_s: self.up_after_s,
        };
        let until_s = world.clock().now().seconds_since(world.clock().start());
        let counted = Sight::default().counted(world.vehicle(), rig, 0.0, until_s);
        Scorecard::new(&graph.status(), world, &counted, &self.reported_objects(), &self.cells, flow)
    }

    /// Everything the store reports, wherever it stands.
    fn reported_objects(&mut self) -> Vec<Object> {
        match self.store.ask(&StoreQuery::everything(), ANSWER_S) {
            Ok((_, objects)) => objects,
            Err(error) => {
                tell(format_args!("tsense: the store did not answer: {error}"));
                Vec::new()
            }
        }
    }
}
