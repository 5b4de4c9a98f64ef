//! The process `foxglove` in a graph of its own, seen by a client that speaks the open WebSocket protocol as bytes: who is
//! refused, that every channel carries what was published, what a client that does not read costs.
#![cfg(feature = "foxglove")]
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/child.rs"]
mod child;
#[path = "../examples/synthetic/forest.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod forest;
#[path = "common/http.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod http;
#[path = "ros2/rig.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod rig;

use forest::{Forest, VOXEL_M};
use foxglove::Decode;
use foxglove::messages::{FrameTransforms, Grid, LaserScan, PointCloud, SceneUpdate, Vector3};
use http::{ask, read_message, send_text, upgrade};
use rig::{Graph, mounts};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tsense_bridge::foxglove::{Config, process};
use tsense_bridge::ros2;
use tsense_contract::*;
use tsense_geometry::VoxelIndex;

const CHILD: &str = "child_that_serves_foxglove";
const PROTOCOL: &str = "Sec-WebSocket-Protocol: foxglove.sdk.v1";
/// Channels and their messages.
const CHANNELS: [(&str, &str); 7] = [
    ("/tf", "foxglove.FrameTransforms"),
    ("/tf_static", "foxglove.FrameTransforms"),
    ("/tsense/grid_map", "foxglove.Grid"),
    ("/tsense/objects", "foxglove.SceneUpdate"),
    ("/tsense/scan/front_ladar", "foxglove.LaserScan"),
    ("/tsense/traversability", "foxglove.Grid"),
    ("/tsense/voxels", "foxglove.PointCloud"),
];
const CLIENTS_MAX: usize = 2;

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_serves_foxglove() {
    let Some((process, _)) = rig::child("foxglove") else { return };
    let listen = "127.0.0.1:0".into();
    // Faster than anybody looks, so that what waits for a slow client is as much as can be.
    let fast = Config { listen, max_clients: CLIENTS_MAX, update_hz: 10.0, motion_hz: 50.0, ..Config::default() };
    process::run(process, &fast, &ros2::Config::default(), mounts()).unwrap();
}

fn serve(name: &str) -> (Graph, SocketAddr) {
    let mut graph = Graph::start(name, CHILD);
    let said = graph.wait_for(ProcessState::Running, "ws://");
    let address = said.strip_prefix("ws://").unwrap().split(',').next().unwrap().parse().unwrap();
    (graph, address)
}

/// A client of the protocol.
struct Client {
    socket: TcpStream,
    channels: BTreeMap<u64, String>,
}

impl Client {
    /// Connects, as a program does: without an Origin. Reads what is offered and subscribes to all of it, each channel under
    /// its own number.
    fn subscribed(address: SocketAddr) -> Self {
        let (mut socket, head) = open(address, "X-Nothing: 1");
        assert!(head.starts_with("HTTP/1.1 101") && head.contains("foxglove.sdk.v1"), "{head}");
        let told = |socket: &mut TcpStream| serde_json::from_slice::<Value>(&read_message(socket)).unwrap();
        let info = told(&mut socket);
        assert_eq!((&info["op"], &info["capabilities"]), (&"serverInfo".into(), &Value::Array(vec![])));
        let (mut channels, mut schemas) = (BTreeMap::new(), BTreeMap::new());
        while channels.len() < CHANNELS.len() {
            for channel in told(&mut socket)["channels"].as_array().expect("an offer of channels") {
                let word = |key: &str| channel[key].as_str().unwrap().to_owned();
                assert_eq!(word("encoding"), "protobuf");
                schemas.insert(word("topic"), word("schemaName"));
                channels.insert(channel["id"].as_u64().unwrap(), word("topic"));
            }
        }
        assert_eq!(schemas, CHANNELS.map(|(topic, schema)| (topic.into(), schema.into())).into());
        for id in channels.keys() {
            let one = format!(r#"{{"op":"subscribe","subscriptions":[{{"id":{id},"channelId":{id}}}]}}"#);
            send_text(&mut socket, &one);
        }
        Self { socket, channels }
    }

    /// The next message and its channel.
    fn next(&mut self) -> (String, Vec<u8>) {
        let data = loop {
            let data = read_message(&mut self.socket);
            if data.first() == Some(&1) {
                break data;
            }
        };
        let subscription = u32::from_le_bytes(data[1..5].try_into().unwrap());
        (self.channels[&u64::from(subscription)].clone(), data[13..].to_vec())
    }
}

fn open(address: SocketAddr, origin: &str) -> (TcpStream, String) {
    let host = format!("Host: {address}");
    let mut headers = upgrade(&host, origin).to_vec();
    headers.push(PROTOCOL);
    ask(address, "/", &headers)
}

#[test]
fn foreign_pages_are_refused_and_so_is_one_client_too_many() {
    let (_graph, address) = serve("foxa");
    for origin in ["Origin: http://evil.example", "Origin: null", "Origin: http://localhost:3000"] {
        let (_, head) = open(address, origin);
        assert!(head.starts_with("HTTP/1.1 403"), "{origin}: {head}");
    }
    let (_, head) = ask(address, "/", &["Host: rebound.example", "Upgrade: websocket"]);
    assert!(head.starts_with("HTTP/1.1 403"), "{head}");
    let _clients: [Client; CLIENTS_MAX] = std::array::from_fn(|_| Client::subscribed(address));
    let (_, head) = open(address, "X-Nothing: 1");
    assert!(head.starts_with("HTTP/1.1 503"), "{head}");
}

#[test]
fn every_channel_carries_what_was_published() {
    let (mut graph, address) = serve("foxb");
    let mut client = Client::subscribed(address);
    child::rest(&mut graph.process, 1.0);
    let (forest, now) = (Forest::new(3), graph.process.clock().now());
    graph.send_all(&forest, now);
    let mut heard = BTreeMap::new();
    while heard.len() < CHANNELS.len() {
        let (topic, message) = client.next();
        heard.insert(topic, message);
    }
    let heard = |topic: &str| &heard[topic][..];
    let pose = forest::pose(now);
    let origin_m = [pose.easting_m, pose.northing_m, pose.altitude_m].map(f64::floor);
    let moving = FrameTransforms::decode(heard("/tf")).unwrap();
    check_frame(&moving, "odom", "base_link", [pose.easting_m, pose.northing_m, pose.altitude_m], origin_m);
    check_frame(&FrameTransforms::decode(heard("/tf_static")).unwrap(), "utm", "map", origin_m, [0.0; 3]);
    check_cloud(&PointCloud::decode(heard("/tsense/voxels")).unwrap(), &forest.voxels, origin_m);
    check_grid(&Grid::decode(heard("/tsense/traversability")).unwrap(), &forest.grid(now), origin_m);
    check_brush(&Grid::decode(heard("/tsense/grid_map")).unwrap(), &forest.grid(now), origin_m);
    check_scene(&SceneUpdate::decode(heard("/tsense/objects")).unwrap(), &forest.objects(now).1, origin_m);
    check_scan(&LaserScan::decode(heard("/tsense/scan/front_ladar")).unwrap(), &rig::scan(now).1);
}

/// More voxels come than a cloud may have points; it is a client that has them thinned, and counted.
#[test]
fn without_a_client_nothing_is_made_or_counted() {
    let (mut graph, address) = serve("foxd");
    let forest = Forest::new(3);
    assert!(forest.voxels.len() > Config::default().cloud_points_max);
    let counts =
        |beat: Heartbeat| (beat.sent, beat.drops.iter().find(|d| d.count > 0).map(|d| d.cause.to_text().into_owned()));
    graph.feed(&forest, 2.0, 0.1);
    assert_eq!(counts(graph.heartbeat()), (0, None));
    let _client = Client::subscribed(address);
    graph.feed(&forest, 2.0, 0.1);
    let (sent, dropped) = counts(graph.heartbeat());
    assert!(sent > 0 && dropped.as_deref() == Some("thinned to cloud_points_max"), "{sent} {dropped:?}");
}

fn near(v: &Option<Vector3>, expected: [f64; 3]) {
    let v = v.as_ref().unwrap();
    let apart = [v.x, v.y, v.z].iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < 1e-6, "{v:?} is not {expected:?}");
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn check_frame(message: &FrameTransforms, parent: &str, child: &str, at_m: [f64; 3], origin_m: [f64; 3]) {
    let found = message.transforms.iter().find(|t| (&t.parent_frame_id[..], &t.child_frame_id[..]) == (parent, child));
    near(&found.unwrap_or_else(|| panic!("no {parent} -> {child}: {message:?}")).translation, minus(at_m, origin_m));
}

/// Each point lies in an occupied voxel of its own and has the colour of its class; as many are there as may be.
fn check_cloud(cloud: &PointCloud, voxels: &BTreeSet<VoxelIndex>, origin_m: [f64; 3]) {
    assert_eq!((cloud.frame_id.as_str(), cloud.point_stride), ("map", 18));
    let offset = |name: &str| cloud.fields.iter().find(|field| field.name == name).unwrap().offset as usize;
    let at = ["x", "y", "z"].map(offset);
    let mut seen = BTreeSet::new();
    for point in cloud.data.chunks_exact(18) {
        let meters = at.map(|at| f64::from(f32::from_le_bytes(point[at..at + 4].try_into().unwrap())));
        let index = [0, 1, 2].map(|axis| ((meters[axis] + origin_m[axis]) / VOXEL_M).floor() as i32);
        assert!(voxels.contains(&index) && seen.insert(index), "{meters:?} is no voxel, or twice");
        if point[offset("class")] == 3 {
            assert_eq!(["red", "green", "blue", "alpha"].map(|name| point[offset(name)]), [0x7a, 0x3f, 0xb0, 255]);
        }
    }
    assert_eq!(seen.len(), voxels.len().min(Config::default().cloud_points_max));
}

/// A grid has its corner, its edges and its number of cells; where in a cell a field of this name lies.
fn check_shape(
    grid: &Grid,
    (header, cells): &(GridHeader, Vec<GridCell>),
    origin_m: [f64; 3],
    stride: u32,
) -> impl Fn(&str) -> usize {
    let corner_m: [f64; 2] = std::array::from_fn(|i| f64::from(header.first_cell[i]) * header.cell_m - origin_m[i]);
    near(&grid.pose.as_ref().unwrap().position, [corner_m[0], corner_m[1], 0.0]);
    assert_eq!((grid.column_count, grid.row_stride, grid.cell_stride), (header.width, header.width * stride, stride));
    assert!((grid.cell_size.as_ref().unwrap().x - header.cell_m).abs() < 1e-6);
    assert_eq!(grid.data.len(), cells.len() * stride as usize);
    |name| grid.fields.iter().find(|field| field.name == name).unwrap().offset as usize
}

fn check_brush(grid: &Grid, topic: &(GridHeader, Vec<GridCell>), origin_m: [f64; 3]) {
    let offset = check_shape(grid, topic, origin_m, 6);
    let mut brushy = 0;
    for (cell, drawn) in topic.1.iter().zip(grid.data.chunks_exact(6)) {
        assert_eq!(drawn[offset("brush_density_pct")], cell.density_pct);
        assert_eq!(drawn[offset("brush_height_dm")], (cell.vegetation_m * 10.0).round() as u8);
        assert_eq!(drawn[offset("alpha")] > 0, cell.vegetation_m > 0.0);
        brushy += usize::from(cell.vegetation_m > 0.0);
    }
    assert!(brushy > 100, "{brushy} cells of brush");
}

fn check_grid(grid: &Grid, topic: &(GridHeader, Vec<GridCell>), origin_m: [f64; 3]) {
    let offset = check_shape(grid, topic, origin_m, 5);
    let cells = &topic.1;
    for (cell, drawn) in cells.iter().zip(grid.data.chunks_exact(5)) {
        let (alpha, cost) = (drawn[offset("alpha")], drawn[offset("cost")]);
        match cell.cost {
            COST_UNKNOWN => assert_eq!((alpha, cost), (0, 255)),
            COST_LETHAL => assert_eq!((alpha, cost), (200, 100)),
            free => {
                assert!(alpha > 0 && (f64::from(cost) - f64::from(free) * 99.0 / 253.0).abs() <= 0.5, "{free} {cost}")
            }
        }
    }
}

fn check_scene(scene: &SceneUpdate, objects: &[Object], origin_m: [f64; 3]) {
    let [entity] = &scene.entities[..] else { panic!("one entity: {scene:?}") };
    assert_eq!((entity.frame_id.as_str(), entity.cylinders.len()), ("map", objects.len()));
    for ((object, trunk), text) in objects.iter().zip(&entity.cylinders).zip(&entity.texts) {
        let middle_m = object.ground_m + f64::from(object.height_m) / 2.0;
        let at_m = [object.easting_m, object.northing_m, middle_m];
        near(&trunk.pose.as_ref().unwrap().position, minus(at_m, origin_m));
        near(&trunk.size, [object.dbh_m, object.dbh_m, object.height_m].map(f64::from));
        assert!(text.text.starts_with(&format!("tree {} ", object.id)), "{}", text.text);
    }
}

fn check_scan(scan: &LaserScan, returns: &[Return]) {
    assert_eq!((scan.frame_id.as_str(), scan.ranges.len()), ("front_ladar", returns.len()));
    for (range, measured) in scan.ranges.iter().zip(returns) {
        let is_echo = ReturnKind::from_wire(measured.kind) == ReturnKind::Echo;
        assert!(!is_echo || (range - f64::from(measured.distance_mm) / 1e3).abs() < 1e-5, "{range} {measured:?}");
    }
}

#[test]
fn a_client_that_does_not_read_costs_less_than_8_mb_and_holds_up_nobody() {
    let (mut graph, address) = serve("foxc");
    let forest = Forest::new(3);
    let mut reader = Client::subscribed(address);
    let heard = Arc::new(AtomicU64::new(0));
    let counted = Arc::clone(&heard);
    // Ends with the process: the connection breaks.
    std::thread::spawn(move || {
        while reader.socket.peek(&mut [0]).is_ok_and(|count| count > 0) {
            reader.next();
            counted.fetch_add(1, Ordering::Relaxed);
        }
    });
    let feed = |graph: &mut Graph, seconds: f64| {
        graph.feed(&forest, seconds, 0.1);
        heard.swap(0, Ordering::Relaxed) as f64 / seconds
    };
    feed(&mut graph, 1.0);
    let alone_hz = feed(&mut graph, 4.0);
    let before = graph.resident_bytes();
    let _sleeper = Client::subscribed(address);
    let beside_hz = feed(&mut graph, 10.0);
    let grown = graph.resident_bytes().saturating_sub(before);
    println!(
        "a sleeping client: {} kB more; the other got {alone_hz:.1} messages a second, then {beside_hz:.1}",
        grown / 1024
    );
    assert!(grown < 8 << 20, "{grown} bytes");
    assert!(beside_hz > 0.5 * alone_hz, "{beside_hz} messages a second instead of {alone_hz}");
}
