//! The process `ros2` in a graph of its own, where its transport cannot be opened: it says why, and counts no message as overtaken
//! or dropped, since none is made.
#![cfg(not(feature = "zenoh"))]
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/child.rs"]
mod child;
#[path = "../examples/synthetic/forest.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod forest;
#[path = "ros2/rig.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod rig;

use rig::{Graph, mounts};
use tsense_bridge::ros2::config::{Config, Transport};
use tsense_contract::ProcessState;

const CHILD: &str = "child_without_a_transport";

/// The child's part; does nothing when run as a test.
#[test]
fn child_without_a_transport() {
    let Some((process, domain_id)) = rig::child("ros2") else { return };
    let config = Config { transport: Transport::Zenoh, domain_id, ..Config::default() };
    tsense_bridge::ros2::process::run(process, &config, mounts()).unwrap();
}

#[test]
fn without_a_transport_nothing_is_made_or_counted() {
    let mut graph = Graph::start("rona", CHILD);
    graph.wait_for(ProcessState::Degraded, "zenoh");
    graph.feed(&forest::Forest::new(3), 3.0, 0.1);
    let beat = graph.heartbeat();
    let drops: Vec<_> = beat.drops.iter().filter(|d| d.count > 0).map(|d| d.cause.to_text().into_owned()).collect();
    assert!(beat.taken > 0 && beat.sent == 0 && drops.is_empty(), "{} in, {} out, {drops:?}", beat.taken, beat.sent);
}
