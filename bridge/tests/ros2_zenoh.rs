//! The process `ros2` with Zenoh as its transport, heard by a foreign Zenoh: PyPI `eclipse-zenoh`, router and subscriber in one.
//! Keys, tokens and attachments are those of rmw_zenoh_cpp, the bytes those of DDS, and who joins late gets what is latched.
#![cfg(feature = "zenoh")]
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/child.rs"]
mod child;
#[path = "../examples/synthetic/forest.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod forest;
#[path = "common/python.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod python;
#[path = "ros2/rig.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod rig;

use child::Killed;
use forest::Forest;
use rig::{Graph, mounts};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;
use tsense_bridge::ros2::config::{Config, Transport};
use tsense_bridge::ros2::messages::{AnyMessage, OccupancyGrid, RosMessage};
use tsense_bridge::ros2::{grid, process};
use tsense_contract::*;

const CHILD: &str = "child_that_is_ros2_over_zenoh";

fn endpoint(domain: u16) -> String {
    format!("tcp/127.0.0.1:{}", 27_000 + domain)
}

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_is_ros2_over_zenoh() {
    let Some((process, domain_id)) = rig::child("ros2") else { return };
    let zenoh_endpoint = endpoint(domain_id);
    let config = Config { transport: Transport::Zenoh, zenoh_endpoint, domain_id, ..Config::default() };
    process::run(process, &config, mounts()).unwrap();
}

/// The foreign router and subscriber.
struct Peer {
    child: Killed,
    input: ChildStdin,
    lines: Receiver<Value>,
    heard: Vec<Value>,
}

impl Peer {
    fn start(python: &Path, domain: u16) -> Self {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/zenoh_peer.py");
        let mut command = Command::new(python);
        command.args([script, &endpoint(domain), &domain.to_string()]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = Killed(command.spawn().unwrap());
        let (tell, lines) = channel();
        let output = BufReader::new(child.0.stdout.take().unwrap());
        std::thread::spawn(move || {
            output.lines().map_while(Result::ok).try_for_each(|line| tell.send(serde_json::from_str(&line).unwrap()))
        });
        let input = child.0.stdin.take().unwrap();
        let mut peer = Self { child, input, lines, heard: Vec::new() };
        peer.wait_for(|line| line["ready"] == true);
        peer
    }

    /// The first line that is wanted, among all that came and will come.
    fn wait_for(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        if let Some(line) = self.heard.iter().find(|line| wanted(line)) {
            return line.clone();
        }
        loop {
            let line = self.lines.recv_timeout(Duration::from_secs(30)).expect("a line within 30 s");
            self.heard.push(line.clone());
            if wanted(&line) {
                return line;
            }
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn a_foreign_zenoh_finds_every_topic_gets_the_bytes_of_dds_and_what_it_missed() {
    let Some(python) = python::python_with("zenoh") else { return };
    let mut graph = Graph::start("roza", CHILD);
    let domain = graph.domain;
    let mut peer = Peer::start(&python, domain);
    graph.wait_for(ProcessState::Running, "Zenoh domain");
    let node = peer.wait_for(|line| line["token"].as_str().is_some_and(|token| token.contains("/NN/")));
    let session = node["token"].as_str().unwrap().split('/').nth(2).unwrap().to_owned();
    assert_eq!(node["token"], format!("@ros2_lv/{domain}/{session}/0/0/NN/%/%/tsense"));
    let (kind, hash) = ("nav_msgs::msg::dds_::OccupancyGrid_", OccupancyGrid::HASH);
    let token =
        format!("@ros2_lv/{domain}/{session}/0/1/MP/%/%/tsense/%tsense%traversability/{kind}/{hash}/:1:,1:,:,:,,");
    peer.wait_for(|line| line["token"] == token);
    for n in 2..=9 {
        let publisher = format!("@ros2_lv/{domain}/{session}/0/{n}/MP/%/%/tsense/");
        peer.wait_for(|line| line["token"].as_str().is_some_and(|token| token.starts_with(&publisher)));
    }

    let (forest, now) = (Forest::new(3), graph.process.clock().now());
    graph.send_all(&forest, now);
    let key = format!("{domain}/tsense/traversability/{kind}/{hash}");
    let sample = peer.wait_for(|line| line["key"] == key && line["late"] == false);
    let pose = forest::pose(now);
    let origin_m = [pose.easting_m, pose.northing_m, pose.altitude_m].map(f64::floor);
    let (header, cells) = forest.grid(now);
    let expected = AnyMessage::from(grid::occupancy_grid(&header, &cells, origin_m, "map")).to_cdr();
    assert_eq!(sample["payload"], hex(&expected));
    let attachment = sample["attachment"].as_str().unwrap();
    let gid = twox_hash::XxHash3_128::oneshot(token.as_bytes()).to_le_bytes();
    assert_eq!((attachment.len(), &attachment[..16]), (66, "0100000000000000"));
    assert_eq!(attachment[32..], format!("10{}", hex(&gid)));

    writeln!(peer.input, "{key}").unwrap();
    let late = peer.wait_for(|line| line["late"] == true);
    assert_eq!((&late["payload"], &late["attachment"]), (&sample["payload"], &sample["attachment"]));
}

#[test]
fn a_router_that_stops_costs_no_memory_and_no_heartbeat() {
    let Some(python) = python::python_with("zenoh") else { return };
    let mut graph = Graph::start("rozb", CHILD);
    let mut peer = Peer::start(&python, graph.domain);
    graph.wait_for(ProcessState::Running, "Zenoh domain");
    let forest = Forest::new(3);
    graph.feed(&forest, 4.0, 0.2);
    peer.wait_for(|line| line["key"].as_str().is_some_and(|key| key.contains("grid_map")));
    let before = graph.resident_bytes();
    assert!(Command::new("kill").args(["-STOP", &peer.child.0.id().to_string()]).status().unwrap().success());
    graph.feed(&forest, 8.0, 0.2);
    let grown = graph.resident_bytes().saturating_sub(before);
    println!("grown by {} kB while the router stood still", grown / 1024);
    assert!(grown < 8 << 20, "{grown} bytes");
    graph.wait_for(ProcessState::Running, "Zenoh domain");
}
