//! A graph of one process that translates for others, and the ends of its topics.

use super::forest::{self, Forest};
use bytemuck::Zeroable;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use tsense_bridge::ros2::motion::{Mount, Mounts};
use tsense_contract::*;
use tsense_geometry::{Mounting, Timestamp};
use tsense_ports::{Clock, Domain, Host, Inbox, Outbox, Process};

const GRAPH: &str = "TSENSE_ROS2_CHILD_GRAPH";
const DOMAIN: &str = "TSENSE_ROS2_CHILD_DOMAIN";

/// What is bolted on: a head with one ladar.
pub fn mounts() -> Mounts {
    let head = Mounting { x_m: 1.2, z_m: -1.9, yaw_deg: 3.0, ..Mounting::default() };
    let ladar = Mount {
        name: "front-ladar".into(),
        range_min_m: 0.5,
        range_max_m: 50.0,
        tilt_from_ladar: Mounting { z_m: -0.08, roll_deg: 1.0, ..Mounting::default() },
    };
    Mounts { pan_tilt: Some(head), ladars: vec![ladar] }
}

/// Joined to the graph where this is the child, with the DDS domain; nothing when run as a test.
pub fn child(name: &str) -> Option<(Process, u16)> {
    let graph = std::env::var_os(GRAPH)?;
    let domain = Domain::new(graph.to_str().unwrap()).unwrap();
    Some((Process::join(&domain, name).unwrap(), std::env::var(DOMAIN).unwrap().parse().unwrap()))
}

/// The map of the forest as one snapshot.
pub fn map_samples(forest: &Forest, now: Timestamp) -> Vec<(MapHeader, Vec<Brick>)> {
    let blocks = forest.blocks();
    let entries: Vec<_> = blocks.keys().map(|key| CommitEntry { key: *key, version: 1 }).collect();
    let block = |(key, bricks)| (forest::map_header(MapSampleKind::Block, key, 1, 1, now), bricks);
    let mut samples: Vec<_> = blocks.into_iter().map(block).collect();
    let commit = forest::map_header(MapSampleKind::Commit, [0; 3], entries.len() as u32, 1, now);
    samples.push((commit, pack_commit(&entries)));
    samples
}

/// A mirror turn in which every beam has another range.
pub fn scan(now: Timestamp) -> (ScanHeader, Vec<Return>) {
    let mut header = ScanHeader::zeroed();
    (header.stamp_ns, header.beam_interval_ns, header.has_remission) = (now.ns, 27_937.0, 1);
    (header.start_rad, header.step_rad) = ((-45.0_f64).to_radians(), 0.5_f64.to_radians());
    let beam = |i: u32| Return { distance_mm: 1000 + 7 * i, remission: i as u16, kind: (i % 5) as u8, code: 0 };
    (header, (0..541).map(beam).collect())
}

/// A graph with one process, the ends of its topics, and the child.
pub struct Graph {
    pub process: Process,
    pub poses: Outbox<Poses>,
    pub scan: Outbox<Scan>,
    pub map: Outbox<Map>,
    pub grid: Outbox<Grid>,
    pub objects: Outbox<Objects>,
    pub processes: Outbox<Processes>,
    pub domain: u16,
    heartbeats: Inbox<Heartbeats>,
    child: Child,
    state_dir: PathBuf,
    _host: Host,
}

impl Graph {
    /// A graph with this name, whose process is the test binary's part called `part`.
    pub fn start(name: &str, part: &str) -> Self {
        // A DDS domain of its own for each test of each run, so that they do not hear each other.
        let domain = (std::process::id() % 36) as u16 * 6 + u16::from(name.as_bytes()[3] - b'a') + 12;
        let name = format!("{name}{}", std::process::id() % 1_000_000);
        let state_dir = std::env::temp_dir().join(format!("tsense-ros2-{name}"));
        std::fs::create_dir_all(&state_dir).unwrap();
        let mut host = Host::open(Domain::new(&name).unwrap(), Clock::start(1.0), &state_dir).unwrap();
        offer_all(&mut host);
        let mut process = host.observer("test").unwrap();
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", part, "--nocapture"])
            .env(GRAPH, &name)
            .env(DOMAIN, domain.to_string())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        Self {
            poses: process.outbox(None).unwrap(),
            scan: process.outbox(Some("front-ladar")).unwrap(),
            map: process.outbox(None).unwrap(),
            grid: process.outbox(None).unwrap(),
            objects: process.outbox(None).unwrap(),
            processes: process.outbox(None).unwrap(),
            heartbeats: process.inbox(None).unwrap(),
            process,
            domain,
            child,
            state_dir,
            _host: host,
        }
    }

    /// Sends a sample of every topic: the forest as it is sensed at `now`.
    pub fn send_all(&mut self, forest: &Forest, now: Timestamp) {
        self.poses.send(&forest::pose(now), &[]).unwrap();
        let (header, cells) = forest.grid(now);
        self.grid.send(&header, &cells).unwrap();
        let (header, list) = forest.objects(now);
        self.objects.send(&header, &list).unwrap();
        let (header, list) = forest::processes(now);
        self.processes.send(&header, &list).unwrap();
        let (header, returns) = scan(now);
        self.scan.send(&header, &returns).unwrap();
        for (header, bricks) in map_samples(forest, now) {
            self.map.send(&header, &bricks).unwrap();
        }
    }

    /// Sends a sample of every topic each `period_s`, for so many seconds.
    pub fn feed(&mut self, forest: &Forest, seconds: f64, period_s: f64) {
        let end = self.process.clock().now().plus_seconds(seconds);
        while self.process.clock().now() < end {
            self.send_all(forest, self.process.clock().now());
            crate::child::rest(&mut self.process, period_s);
        }
    }

    /// Sends a pose and a scan fifty times a second, for so many seconds; returns how many.
    pub fn move_about(&mut self, seconds: f64) -> usize {
        let steps = (50.0 * seconds) as usize;
        for _ in 0..steps {
            let now = self.process.clock().now();
            self.poses.send(&forest::pose(now), &[]).unwrap();
            let (header, returns) = scan(now);
            self.scan.send(&header, &returns).unwrap();
            crate::child::rest(&mut self.process, 0.02);
        }
        steps
    }

    /// Lets time pass until the process says a state with this word in its reason; returns the reason.
    pub fn wait_for(&mut self, state: ProcessState, word: &str) -> String {
        let end = self.process.clock().now().plus_seconds(30.0);
        let mut last = String::from("nothing");
        while self.process.clock().now() < end {
            self.process.wait(0.05);
            let Some(beat) = self.heartbeats.take_newest().unwrap().0 else { continue };
            let now = ProcessState::from_wire(beat.header().state);
            last = format!("{now}: {}", beat.header().reason.to_text());
            if now == state && last.contains(word) {
                return beat.header().reason.to_text().into_owned();
            }
        }
        panic!("never {state} with {word:?}; last {last}");
    }

    /// The child's newest heartbeat.
    pub fn heartbeat(&mut self) -> Heartbeat {
        for _ in 0..200 {
            self.process.wait(0.05);
            if let Some(beat) = self.heartbeats.take_newest().unwrap().0 {
                return *beat.header();
            }
        }
        panic!("no heartbeat")
    }

    /// Resident memory of the child that is its own: what lies in shared memory is the graph's.
    pub fn resident_bytes(&self) -> usize {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find(|line| line.starts_with("RssAnon:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap() * 1024
    }

    /// The child's IP sockets as `ss` shows them.
    pub fn sockets(&self) -> Option<Vec<String>> {
        let Ok(output) = Command::new("ss").args(["-aH", "-t", "-u", "-n", "-p"]).output() else {
            println!("SKIPPED: ss not found");
            return None;
        };
        let (text, pid) = (String::from_utf8(output.stdout).unwrap(), format!("pid={},", self.child.id()));
        // The first column is the protocol where both are asked for; drop it.
        let lines = text.lines().filter(|line| line.contains(&pid));
        Some(lines.map(|line| line.split_once(char::is_whitespace).unwrap().1.trim().into()).collect())
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        crate::child::end(&mut self.child, &self.state_dir);
    }
}

fn offer_all(host: &mut Host) {
    host.offer::<Heartbeats>(None).unwrap();
    host.offer::<Processes>(None).unwrap();
    host.offer::<Scan>(Some("front-ladar")).unwrap();
    host.offer::<Poses>(None).unwrap();
    host.offer::<Joints>(None).unwrap();
    host.offer::<Map>(None).unwrap();
    host.offer_event(MAP_KEYFRAME).unwrap();
    host.offer::<Grid>(None).unwrap();
    host.offer::<Objects>(None).unwrap();
}
