//! The process `bridge` in a graph of its own: what is sent through shared memory arrives at a viewer, a keyframe is asked
//! for, and an address that is taken stops nothing.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/child.rs"]
mod child;
#[path = "../examples/synthetic/forest.rs"]
#[allow(dead_code, reason = "this test needs the blocks and the pose alone")]
mod forest;
#[path = "common/http.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod http;

use forest::Forest;
use std::net::{SocketAddr, TcpListener};
use std::process::{Child, Command, Stdio};
use tsense_bridge::Config;
use tsense_bridge::web::frames::{Kind, parse};
use tsense_contract::*;
use tsense_ports::{Clock, Domain, EventReceiver, Host, Inbox, Outbox, Process};

const GRAPH: &str = "TSENSE_BRIDGE_CHILD_GRAPH";
const LISTEN: &str = "TSENSE_BRIDGE_CHILD_LISTEN";

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_is_the_bridge() {
    let Some(graph) = std::env::var_os(GRAPH) else { return };
    let domain = Domain::new(graph.to_str().unwrap()).unwrap();
    let process = Process::join(&domain, "bridge").unwrap();
    let config = Config { listen: std::env::var(LISTEN).unwrap(), ..Config::default() };
    tsense_bridge::run(process, &config).unwrap();
}

/// A graph with one process, the ends of its topics, and the child.
struct Graph {
    process: Process,
    poses: Outbox<Poses>,
    map: Outbox<Map>,
    keyframe: EventReceiver,
    heartbeats: Inbox<Heartbeats>,
    child: Child,
    state_dir: std::path::PathBuf,
    _host: Host,
}

impl Graph {
    fn start(name: &str, listen: &str) -> Self {
        let name = format!("{name}{}", std::process::id() % 1_000_000);
        let state_dir = std::env::temp_dir().join(format!("tsense-bridge-{name}"));
        std::fs::create_dir_all(&state_dir).unwrap();
        let mut host = Host::open(Domain::new(&name).unwrap(), Clock::start(1.0), &state_dir).unwrap();
        offer_all(&mut host);
        let mut process = host.observer("test").unwrap();
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child_that_is_the_bridge", "--nocapture"])
            .env(GRAPH, &name)
            .env(LISTEN, listen)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        Self {
            poses: process.outbox(None).unwrap(),
            map: process.outbox(None).unwrap(),
            keyframe: process.event_receiver(MAP_KEYFRAME).unwrap(),
            heartbeats: process.inbox(None).unwrap(),
            process,
            child,
            state_dir,
            _host: host,
        }
    }

    /// Lets time pass until the bridge says a state with this word in its reason.
    fn wait_for(&mut self, state: ProcessState, word: &str) -> String {
        let end = self.process.clock().now().plus_seconds(20.0);
        let mut last = String::from("nothing");
        while self.process.clock().now() < end {
            self.process.wait(0.05);
            let Some(beat) = self.heartbeats.take_newest().unwrap().0 else { continue };
            let now = ProcessState::from_wire(beat.header().state);
            last = format!("{now}: {}", beat.header().reason.to_text());
            if now == state && last.contains(word) {
                return last;
            }
        }
        panic!("never {state} with {word:?}; last {last}");
    }

    fn send_map(&mut self, forest: &Forest) {
        let now = self.process.clock().now();
        let blocks = forest.blocks();
        for (key, bricks) in &blocks {
            self.map.send(&forest::map_header(MapSampleKind::Block, *key, 1, 1, now), bricks).unwrap();
        }
        let entries: Vec<_> = blocks.keys().map(|key| CommitEntry { key: *key, version: 1 }).collect();
        let commit = forest::map_header(MapSampleKind::Commit, [0; 3], entries.len() as u32, 1, now);
        self.map.send(&commit, &pack_commit(&entries)).unwrap();
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        child::end(&mut self.child, &self.state_dir);
    }
}

fn offer_all(host: &mut Host) {
    host.offer::<Heartbeats>(None).unwrap();
    host.offer::<Processes>(None).unwrap();
    host.offer::<Poses>(None).unwrap();
    host.offer::<Joints>(None).unwrap();
    host.offer::<Map>(None).unwrap();
    host.offer_event(MAP_KEYFRAME).unwrap();
    host.offer::<Points>(None).unwrap();
    host.offer::<Detections>(None).unwrap();
    host.offer::<Grid>(None).unwrap();
    host.offer::<Objects>(None).unwrap();
}

#[test]
fn what_is_sent_through_shared_memory_arrives_at_a_viewer() {
    let mut graph = Graph::start("bra", "127.0.0.1:0");
    let said = graph.wait_for(ProcessState::Running, "page at http://127.0.0.1:");
    let address = said.split("http://").nth(1).unwrap().split('/').next().unwrap();
    let address: SocketAddr = address.parse().unwrap();
    while !graph.keyframe.drain() {
        // Who joins late asks for a keyframe; without one this test would not end.
        graph.process.wait(0.1);
    }

    let now = graph.process.clock().now();
    graph.poses.send(&forest::pose(now), &[]).unwrap();
    child::rest(&mut graph.process, 1.0);
    let forest = Forest::new(3);
    graph.send_map(&forest);
    let (host, origin) = (format!("Host: {address}"), format!("Origin: http://{address}"));
    let (mut socket, head) = http::ask(address, "/ws", &http::upgrade(&host, &origin));
    assert!(head.starts_with("HTTP/1.1 101"), "{head}");
    let mut kinds = Vec::new();
    while kinds.last() != Some(&Kind::Commit) {
        kinds.push(parse(&http::read_message(&mut socket)).unwrap().0.kind);
    }
    assert_eq!(kinds[0], Kind::Hello);
    assert!(kinds.contains(&Kind::Vehicle));
    assert_eq!(kinds.iter().filter(|kind| **kind == Kind::Block).count(), forest.blocks().len());
    graph.wait_for(ProcessState::Running, "1 viewer");
}

#[test]
fn a_taken_address_degrades_the_bridge_until_it_is_free() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let mut graph = Graph::start("brb", &address);
    graph.wait_for(ProcessState::Degraded, &format!("cannot listen on {address}"));
    drop(taken);
    graph.wait_for(ProcessState::Running, &format!("page at http://{address}/"));
}
