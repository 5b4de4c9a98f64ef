//! A graph of one process `ros2`, the ends of its topics, and a foreign subscriber.

use super::forest::{self, Forest};
use super::python;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tsense_bridge::ros2::motion::{Mount, Mounts};
use tsense_bridge::ros2::translator::Translator;
use tsense_bridge::ros2::{self, Config};
use tsense_contract::*;
use tsense_geometry::{Mounting, Timestamp};
use tsense_ports::{Clock, Domain, Host, Inbox, Outbox, Process};

const GRAPH: &str = "TSENSE_ROS2_CHILD_GRAPH";
const DOMAIN: &str = "TSENSE_ROS2_CHILD_DOMAIN";

/// Finds a foreign DDS on loopback, by unicast: what `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST` makes of it.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>\
    <AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>\
    <Peers><Peer Address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

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

fn config(domain: u16) -> Config {
    Config { enabled: true, domain_id: domain, ..Config::default() }
}

/// What the child does when it is one.
pub fn child() {
    let Some(graph) = std::env::var_os(GRAPH) else { return };
    let domain = Domain::new(graph.to_str().unwrap()).unwrap();
    let process = Process::join(&domain, "ros2").unwrap();
    let config = config(std::env::var(DOMAIN).unwrap().parse().unwrap());
    ros2::process::run(process, &config, mounts()).unwrap();
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
    pub fn start(name: &str) -> Self {
        // A DDS domain of its own for each test of each run, so that they do not hear each other.
        let domain = (std::process::id() % 60) as u16 * 3 + u16::from(name.as_bytes()[3] - b'a') + 20;
        let name = format!("{name}{}", std::process::id() % 1_000_000);
        let state_dir = std::env::temp_dir().join(format!("tsense-ros2-{name}"));
        std::fs::create_dir_all(&state_dir).unwrap();
        let mut host = Host::open(Domain::new(&name).unwrap(), Clock::start(1.0), &state_dir).unwrap();
        offer_all(&mut host);
        let mut process = host.observer("test").unwrap();
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child_that_is_ros2", "--nocapture"])
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

    /// Lets time pass until the process says a state with this word in its reason.
    pub fn wait_for(&mut self, state: ProcessState, word: &str) {
        let end = self.process.clock().now().plus_seconds(30.0);
        let mut last = String::from("nothing");
        while self.process.clock().now() < end {
            self.process.wait(0.05);
            let Some(beat) = self.heartbeats.take_newest().unwrap().0 else { continue };
            let now = ProcessState::from_wire(beat.header().state);
            last = format!("{now}: {}", beat.header().reason.to_text());
            if now == state && last.contains(word) {
                return;
            }
        }
        panic!("never {state} with {word:?}; last {last}");
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

/// A foreign subscriber to every topic.
pub struct Subscriber {
    child: Child,
    lines: Receiver<Value>,
    heard: Vec<Value>,
}

impl Subscriber {
    pub fn start(python: &Path, domain: u16) -> Self {
        let mut child = Command::new(python)
            .arg(python::peer())
            .args(["subscribe", &domain.to_string()])
            .env("CYCLONEDDS_URI", CYCLONE)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let translator: Translator = Translator::new(&config(domain), mounts());
        let mut input = child.stdin.take().unwrap();
        for topic in translator.topics() {
            let (reliable, latched) = (u8::from(topic.reliable), u8::from(topic.transient_local));
            writeln!(input, "{} {} {reliable} {latched}", topic.name, topic.type_name).unwrap();
        }
        drop(input);
        let (sender, lines) = channel();
        let output = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if sender.send(serde_json::from_str(&line).unwrap()).is_err() {
                    return;
                }
            }
        });
        let subscriber = Self { child, lines, heard: Vec::new() };
        subscriber.next();
        subscriber
    }

    fn next(&self) -> Value {
        let heard = || self.heard.iter().map(|line| line["topic"].to_string()).collect::<Vec<_>>().join(" ");
        self.lines.recv_timeout(Duration::from_secs(30)).unwrap_or_else(|e| panic!("{e}; heard {}", heard()))
    }

    /// The values of the first sample of a topic that is wanted, among all that came and will come.
    pub fn wait_for(&mut self, topic: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let is_wanted = |line: &Value| line["topic"] == topic && wanted(&line["values"]);
        let mut found = self.heard.iter().find(|line| is_wanted(line)).cloned();
        let start = Instant::now();
        while found.is_none() && start.elapsed() < Duration::from_secs(30) {
            let line = self.next();
            found = is_wanted(&line).then(|| line.clone());
            self.heard.push(line);
        }
        found.unwrap_or_else(|| panic!("nothing on {topic}"))["values"].take()
    }

    /// It stands still from now on, without closing anything.
    pub fn stop(&self) {
        assert!(Command::new("kill").args(["-STOP", &self.child.id().to_string()]).status().unwrap().success());
    }
}

impl Drop for Subscriber {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
