//! A graph whose only process is the `kstore`, and the ends of its topics.
#![allow(dead_code, clippy::disallowed_methods, reason = "shared by several test files; tests start processes")]

use super::Folder;
use std::process::{Child, Command, Stdio};
use tsense_contract::*;
use tsense_kstore::Config;
use tsense_ports::{Clock, Domain, Host, Inbox, Outbox, Process};

const GRAPH: &str = "TSENSE_KSTORE_CHILD_GRAPH";

/// The child's part; does nothing when run as a test.
pub fn be_the_kstore(config: &Config) {
    let Some(graph) = std::env::var_os(GRAPH) else { return };
    let domain = Domain::new(graph.to_str().unwrap()).unwrap();
    let process = Process::join(&domain, "kstore").unwrap();
    tsense_kstore::run(process, config).unwrap();
}

/// A graph with one process, and the ends of its topics.
pub struct Graph {
    pub host: Host,
    pub process: Process,
    detections: Outbox<Detections>,
    objects: Inbox<Objects>,
    heartbeats: Inbox<Heartbeats>,
    snapshot: u64,
    pub folder: Folder,
}

impl Graph {
    pub fn new(name: &str) -> Self {
        Self::at_speed(name, 1.0)
    }

    /// A graph whose time runs faster than the machine's.
    pub fn at_speed(name: &str, speed: f64) -> Self {
        let domain = Domain::new(&format!("{name}{}", std::process::id() % 1_000_000)).unwrap();
        let folder = Folder::new();
        let mut host = Host::open(domain, Clock::start(speed), &folder.0).unwrap();
        host.offer::<Detections>(None).unwrap();
        host.offer::<Grid>(None).unwrap();
        host.offer::<Objects>(None).unwrap();
        host.offer::<Heartbeats>(None).unwrap();
        host.offer_requests::<Store>().unwrap();
        let mut process = host.observer("test").unwrap();
        let (detections, objects) = (process.outbox(None).unwrap(), process.inbox(None).unwrap());
        let heartbeats = process.inbox(None).unwrap();
        Self { host, process, detections, objects, heartbeats, snapshot: 0, folder }
    }

    /// Starts this test binary again, as the `kstore` of this graph: the part of it that is called `part`.
    pub fn start(&self, part: &str) -> Child {
        Command::new(std::env::current_exe().unwrap())
            .args(["--exact", part, "--nocapture"])
            .env(GRAPH, self.host.domain().name())
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    }

    pub fn see(&mut self, trees: &[Detection]) {
        self.snapshot += 1;
        let now = self.process.clock().now();
        let header = DetectionsHeader {
            stamp_ns: now.ns,
            classified_ns: now.ns,
            epoch: 1,
            snapshot: self.snapshot,
            vehicle_m: [500_000.0, 4_000_000.0],
            zone: 17,
            south: 0,
            reserved: [0; 6],
        };
        self.detections.send(&header, trees).unwrap();
    }

    /// Lets time pass; returns the objects that were told meanwhile.
    pub fn listen(&mut self, seconds: f64) -> Vec<Object> {
        let end = self.process.clock().now().plus_seconds(seconds);
        let mut told = Vec::new();
        while self.process.clock().now() < end {
            self.process.wait(0.01);
            while let Some(sample) = self.objects.take().unwrap() {
                told.extend_from_slice(sample.items());
            }
        }
        told
    }

    pub fn state(&mut self) -> (ProcessState, String) {
        let (beat, _) = self.heartbeats.take_newest().unwrap();
        let beat = beat.expect("the process beats five times a second");
        (ProcessState::from_wire(beat.header().state), beat.header().reason.to_text().into_owned())
    }
}

/// Ends a process the polite way.
pub fn stop(mut child: Child) {
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    assert!(child.wait().unwrap().success());
}
