//! The process `ros2` in a graph of its own, heard by a foreign DDS: PyPI `cyclonedds`. Every field of every message arrives
//! as it was meant, who joins late gets what is latched, a subscriber that stops costs nothing, no socket leaves the machine.
#![cfg(feature = "ros2")]
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/child.rs"]
mod child;
#[path = "../examples/synthetic/forest.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod forest;
#[path = "common/python.rs"]
mod python;
#[path = "ros2/rig.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod rig;
#[path = "ros2/subscriber.rs"]
mod subscriber;

use forest::Forest;
use python::exact;
use rig::{Graph, mounts, scan};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use subscriber::Subscriber;
use tsense_bridge::ros2::cloud::{ClassGrid, occupied, point_cloud};
use tsense_bridge::ros2::motion::Motion;
use tsense_bridge::ros2::scan::{ScanLimits, laser_scan};
use tsense_bridge::ros2::{Config, diagnostics, grid, objects};
use tsense_contract::*;
use tsense_geometry::Timestamp;

const CHILD: &str = "child_that_is_ros2";

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_is_ros2() {
    let Some((process, domain)) = rig::child("ros2") else { return };
    tsense_bridge::ros2::process::run(process, &subscriber::config(domain), mounts()).unwrap();
}

/// What the samples of one instant must be as JSON, by topic. Written with the pure parts, whose meaning their own tests hold.
fn expected(forest: &Forest, now: Timestamp) -> BTreeMap<&'static str, Value> {
    let pose = forest::pose(now);
    let origin_m = [pose.easting_m, pose.northing_m, pose.altitude_m].map(f64::floor);
    let config = Config::default();
    let mut motion = Motion::new(config.frames.clone(), origin_m);
    motion.take(&pose);
    let (header, cells) = forest.grid(now);
    let (objects_header, list) = forest.objects(now);
    let (processes_header, processes) = forest::processes(now);
    let (scan_header, returns) = scan(now);
    let limits = ScanLimits { range_min_m: 0.5, range_max_m: 50.0 };
    let mut assembler = SnapshotAssembler::new(BLOCKS_MAX);
    for (header, bricks) in rig::map_samples(forest, now) {
        assembler.take(&header, bricks);
    }
    let snapshot = assembler.complete().unwrap();
    let classes = ClassGrid { header: &header, cells: &cells };
    let (points, _) = occupied(&snapshot, Some(classes), origin_m, config.cloud_points_max);
    BTreeMap::from([
        ("/tsense/traversability", exact(grid::occupancy_grid(&header, &cells, origin_m, "map"))),
        ("/tsense/grid_map", exact(grid::grid_map(&header, &cells, origin_m, "map"))),
        ("/tsense/scan/front_ladar", exact(laser_scan(&scan_header, &returns, limits, "front_ladar"))),
        ("/tsense/voxels", exact(point_cloud(&snapshot.header, &points, "map"))),
        ("/tsense/objects", exact(objects::detections(&objects_header, &list, origin_m, "map"))),
        ("/tf", exact(motion.transforms())),
        ("/tf_static", exact(motion.static_transforms(&mounts(), now))["transforms"].clone()),
        ("/tsense/odom", exact(motion.odometry(None))),
        ("/diagnostics", exact(diagnostics::diagnostics(&processes_header, &processes))),
    ])
}

/// What was received, with the one stamp that is the process's own (of constant transforms) taken out.
fn comparable(topic: &str, mut values: Value) -> Value {
    if topic != "/tf_static" {
        return values;
    }
    let transforms = values["transforms"].as_array_mut().unwrap();
    transforms.iter_mut().for_each(|transform| transform["header"]["stamp"] = Value::Null);
    values["transforms"].clone()
}

/// When a message's values were so.
fn stamp(values: &Value) -> Option<&Value> {
    values.pointer("/header/stamp").or(values.pointer("/transforms/0/header/stamp"))
}

/// Whether the message of that instant came; fails where it came changed.
fn was_heard(subscriber: &mut Subscriber, topic: &str, expected: &Value) -> bool {
    let values = subscriber.heard(topic).find(|values| stamp(values) == stamp(expected));
    values.iter().for_each(|values| assert_eq!(*values, expected, "{topic}"));
    values.is_some()
}

#[test]
fn cyclone_dds_gets_every_field_and_who_joins_late_gets_what_is_latched() {
    let Some(python) = python::python_with("cyclonedds") else { return };
    every_field_arrives("rosa", |domain| Subscriber::cyclone(&python, domain));
}

/// The middleware of a stock ROS 2.
#[test]
fn fast_dds_gets_every_field_and_who_joins_late_gets_what_is_latched() {
    let Some(python) = python::python_with("rosbags") else { return };
    let Some(peer) = subscriber::fast_dds_peer() else { return };
    every_field_arrives("rose", |domain| Subscriber::fast_dds(&peer, &python, domain));
}

fn every_field_arrives(graph: &str, subscriber: impl FnOnce(u16) -> Subscriber) {
    let mut graph = Graph::start(graph, CHILD);
    graph.wait_for(ProcessState::Running, "DDS domain");
    let forest = Forest::new(3);
    let now = graph.process.clock().now();
    graph.send_all(&forest, now);
    child::rest(&mut graph.process, 1.0);

    let mut subscriber = subscriber(graph.domain);
    let mut expected = expected(&forest, now);
    let list = expected.get_mut("/tf_static").unwrap();
    list.as_array_mut().unwrap().iter_mut().for_each(|transform| transform["header"]["stamp"] = Value::Null);
    // Latched topics were sent once, before the subscriber was there.
    for topic in ["/tsense/traversability", "/tsense/grid_map", "/tsense/objects", "/tf_static"] {
        let values = subscriber.wait_for(topic);
        assert_eq!(comparable(topic, values), expected[topic], "{topic}");
    }
    // The others are for who is there, and some of them may be lost or late: sent anew until one of each was heard.
    let mut unheard = vec!["/tsense/scan/front_ladar", "/tsense/voxels", "/tf", "/tsense/odom", "/diagnostics"];
    let mut sent = Vec::new();
    while !unheard.is_empty() {
        assert!(sent.len() < 30, "never heard: {unheard:?}");
        let now = graph.process.clock().now();
        graph.send_all(&forest, now);
        sent.push(self::expected(&forest, now));
        // The slowest topics go out once a second.
        child::rest(&mut graph.process, 1.1);
        unheard.retain(|topic| !sent.iter().any(|expected| was_heard(&mut subscriber, topic, &expected[topic])));
        // Large messages that were heard, or are latched, are not kept.
        sent.iter_mut().for_each(|expected| expected.retain(|topic, _| unheard.contains(topic)));
    }
    graph.wait_for(ProcessState::Running, "9 subscriptions");
}

#[test]
fn with_loopback_addresses_every_socket_is_bound_to_the_loopback_device() {
    let mut graph = Graph::start("rosb", CHILD);
    graph.wait_for(ProcessState::Running, "on 127.0.0.1");
    let Some(lines) = graph.sockets() else { return };
    assert!(!lines.is_empty(), "no socket at all");
    for line in &lines {
        let local = line.split_whitespace().nth(3).unwrap();
        assert!(local.contains("%lo:") || local.starts_with("127."), "{line}");
    }
}

#[test]
fn a_subscriber_that_stops_costs_no_memory_and_no_heartbeat() {
    let Some(python) = python::python_with("cyclonedds") else { return };
    let mut graph = Graph::start("rosc", CHILD);
    let forest = Forest::new(3);
    let mut subscriber = Subscriber::cyclone(&python, graph.domain);
    graph.feed(&forest, 4.0, 0.2);
    subscriber.wait_for("/tsense/grid_map");
    let before = graph.resident_bytes();
    subscriber.stop();
    graph.feed(&forest, 8.0, 0.2);
    let grown = graph.resident_bytes().saturating_sub(before);
    println!("grown by {} kB while the subscriber stood still", grown / 1024);
    assert!(grown < 8 << 20, "{grown} bytes");
    graph.wait_for(ProcessState::Running, "DDS domain");
}

#[test]
fn a_subscriber_that_stops_starves_no_other() {
    let Some(python) = python::python_with("cyclonedds") else { return };
    let mut graph = Graph::start("rosf", CHILD);
    graph.wait_for(ProcessState::Running, "DDS domain");
    let [stopped, mut other] = [0; 2].map(|_| Subscriber::cyclone(&python, graph.domain));
    graph.move_about(2.0);
    stopped.stop();
    // Until as much waits for it as may: a hundred transforms.
    graph.move_about(3.0);
    let before = other.heard("/tsense/scan/front_ladar").count();
    let sent = graph.move_about(3.0);
    let heard = other.heard("/tsense/scan/front_ladar").count() - before;
    println!("{heard} of {sent} scans heard beside a subscriber that stands still");
    assert!(2 * heard > sent, "{heard} of {sent}");
    // Of a reliable topic the others hear nothing either, but only until the transport gives the silent one up.
    let before = other.heard("/tsense/odom").count();
    let seconds = (1..=40).find(|_| {
        graph.move_about(1.0);
        other.heard("/tsense/odom").count() > before + 25
    });
    println!("odometry goes on after {} s", seconds.expect("odometry within 40 s"));
}

/// The example of the documentation is a subscriber, too.
#[test]
fn the_python_example_of_the_documentation_prints_the_grid() {
    let Some(python) = python::python_with("cyclonedds") else { return };
    let mut graph = Graph::start("rosd", CHILD);
    graph.wait_for(ProcessState::Running, "DDS domain");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/ros2_grid.py");
    let mut example = Command::new(python);
    let mut example =
        child::Killed(example.args([script, &graph.domain.to_string()]).stdout(Stdio::piped()).spawn().unwrap());
    let mut lines = BufReader::new(example.0.stdout.take().unwrap()).lines();
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || tell.send(lines.next()));
    let (forest, now) = (Forest::new(3), graph.process.clock().now());
    let line = (0..150).find_map(|_| {
        graph.send_all(&forest, graph.process.clock().now());
        child::rest(&mut graph.process, 0.2);
        told.try_recv().ok()
    });
    let line = line.expect("a grid within 30 s").unwrap().unwrap();
    let cells = forest.grid(now).1;
    let count = |cost: u8| cells.iter().filter(|cell| cell.cost == cost).count();
    let (lethal, unknown) = (count(COST_LETHAL), count(COST_UNKNOWN));
    assert!(line.starts_with("200 x 200 cells of 0.15 m from "), "{line}");
    assert!(line.ends_with(&format!(" {lethal} impassable, {unknown} unknown")), "{line}");
}
