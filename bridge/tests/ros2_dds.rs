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
mod rig;

use bytemuck::Zeroable;
use forest::Forest;
use python::exact;
use rig::{Graph, Subscriber, mounts};
use serde_json::Value;
use std::collections::BTreeMap;
use tsense_bridge::ros2::cloud::{ClassGrid, occupied, point_cloud};
use tsense_bridge::ros2::motion::Motion;
use tsense_bridge::ros2::scan::{ScanLimits, laser_scan};
use tsense_bridge::ros2::{Config, diagnostics, grid, objects};
use tsense_contract::*;
use tsense_geometry::Timestamp;

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_is_ros2() {
    rig::child();
}

fn scan(now: Timestamp) -> (ScanHeader, Vec<Return>) {
    let mut header = ScanHeader::zeroed();
    (header.stamp_ns, header.beam_interval_ns, header.has_remission) = (now.ns, 27_937.0, 1);
    (header.start_rad, header.step_rad) = ((-45.0_f64).to_radians(), 0.5_f64.to_radians());
    let beam = |i: u32| Return { distance_mm: 1000 + 7 * i, remission: i as u16, kind: (i % 5) as u8, code: 0 };
    (header, (0..541).map(beam).collect())
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

fn send_all(graph: &mut Graph, forest: &Forest, now: Timestamp) {
    graph.poses.send(&forest::pose(now), &[]).unwrap();
    let (header, cells) = forest.grid(now);
    graph.grid.send(&header, &cells).unwrap();
    let (header, list) = forest.objects(now);
    graph.objects.send(&header, &list).unwrap();
    let (header, list) = forest::processes(now);
    graph.processes.send(&header, &list).unwrap();
    let (header, returns) = scan(now);
    graph.scan.send(&header, &returns).unwrap();
    for (header, bricks) in rig::map_samples(forest, now) {
        graph.map.send(&header, &bricks).unwrap();
    }
}

#[test]
fn a_foreign_dds_gets_every_field_and_who_joins_late_gets_what_is_latched() {
    let Some(python) = python::python_with("cyclonedds") else { return };
    let mut graph = Graph::start("rosa");
    graph.wait_for(ProcessState::Running, "DDS domain");
    let forest = Forest::new(3);
    let now = graph.process.clock().now();
    send_all(&mut graph, &forest, now);
    graph.process.wait(1.0);

    let mut subscriber = Subscriber::start(&python, graph.domain);
    let mut expected = expected(&forest, now);
    let list = expected.get_mut("/tf_static").unwrap();
    list.as_array_mut().unwrap().iter_mut().for_each(|transform| transform["header"]["stamp"] = Value::Null);
    // Latched topics were sent once, before the subscriber was there.
    for topic in ["/tsense/traversability", "/tsense/grid_map", "/tsense/objects", "/tf_static"] {
        let values = subscriber.wait_for(topic, |_| true);
        assert_eq!(comparable(topic, values), expected[topic], "{topic}");
    }
    // The others are for who is there: the same once more, at a later instant.
    let now = graph.process.clock().now();
    send_all(&mut graph, &forest, now);
    let expected = self::expected(&forest, now);
    for topic in ["/tsense/scan/front_ladar", "/tsense/voxels", "/tf", "/tsense/odom", "/diagnostics"] {
        let stamp = expected[topic].pointer("/header/stamp").or(expected[topic].pointer("/transforms/0/header/stamp"));
        let values = subscriber.wait_for(topic, |values| {
            values.pointer("/header/stamp").or(values.pointer("/transforms/0/header/stamp")) == stamp
        });
        assert_eq!(values, expected[topic], "{topic}");
    }
    graph.wait_for(ProcessState::Running, "9 subscriptions");
}

#[test]
fn with_loopback_addresses_every_socket_is_bound_to_the_loopback_device() {
    let mut graph = Graph::start("rosb");
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
    let mut graph = Graph::start("rosc");
    let forest = Forest::new(3);
    let mut subscriber = Subscriber::start(&python, graph.domain);
    let feed = |graph: &mut Graph, seconds: f64| {
        let end = graph.process.clock().now().plus_seconds(seconds);
        while graph.process.clock().now() < end {
            let now = graph.process.clock().now();
            send_all(graph, &forest, now);
            graph.process.wait(0.2);
        }
    };
    feed(&mut graph, 4.0);
    subscriber.wait_for("/tsense/grid_map", |_| true);
    let before = graph.resident_bytes();
    subscriber.stop();
    feed(&mut graph, 8.0);
    let grown = graph.resident_bytes().saturating_sub(before);
    println!("grown by {} kB while the subscriber stood still", grown / 1024);
    assert!(grown < 8 << 20, "{grown} bytes");
    graph.wait_for(ProcessState::Running, "DDS domain");
}
