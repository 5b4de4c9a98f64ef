//! The process `jaus` in a graph of its own, spoken to by a small foreign client that shares no code with ours: it
//! discovers, takes control, subscribes to the cost map, and gets a grid whose cells are those of the topic.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/child.rs"]
mod child;

use bytemuck::Zeroable;
use std::net::{SocketAddr, UdpSocket};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tsense_bridge::jaus::{Config, Head, Rig, process};
use tsense_bridge::ros2::Mount;
use tsense_contract::*;
use tsense_geometry::Mounting;
use tsense_ports::{Clock, Domain, Host, Inbox, Outbox, Process};

const GRAPH: &str = "TSENSE_JAUS_CHILD_GRAPH";
/// `control` or `multicast`; else everything is as by default, but on any port.
const WITH: &str = "TSENSE_JAUS_CHILD_WITH";

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_speaks_jaus() {
    let Some(graph) = std::env::var_os(GRAPH) else { return };
    let domain = Domain::new(graph.to_str().unwrap()).unwrap();
    let with = std::env::var(WITH).unwrap();
    let (allow_control, multicast) = (with == "control", with == "multicast");
    let config = Config { listen: "127.0.0.1:0".into(), allow_control, multicast, ..Config::default() };
    process::run(Process::join(&domain, "jaus").unwrap(), &config, &rig()).unwrap();
}

/// A ladar 0.1 m above the axes of a head, 1 m ahead and 2 m up on the vehicle.
fn rig() -> Rig {
    let tilt_from_ladar = Mounting { z_m: -0.1, ..Mounting::default() };
    let ladar = Mount { name: "ladar".into(), range_min_m: 0.5, range_max_m: 50.0, tilt_from_ladar };
    let mount = Mounting { x_m: 1.0, z_m: -2.0, ..Mounting::default() };
    Rig { head: Some(Head { mount, ..Head::default() }), ladars: vec![ladar] }
}

struct Graph {
    process: Process,
    grids: Outbox<Grid>,
    scans: Outbox<Scan>,
    joints: Outbox<Joints>,
    heartbeats: Inbox<Heartbeats>,
    newest: Option<Heartbeat>,
    child: Child,
    state_dir: std::path::PathBuf,
    _host: Host,
}

impl Graph {
    fn start(name: &str, with: &str) -> Self {
        let name = format!("{name}{}", std::process::id() % 1_000_000);
        let state_dir = std::env::temp_dir().join(format!("tsense-jaus-{name}"));
        std::fs::create_dir_all(&state_dir).unwrap();
        let mut host = Host::open(Domain::new(&name).unwrap(), Clock::start(1.0), &state_dir).unwrap();
        host.offer::<Heartbeats>(None).unwrap();
        host.offer::<Grid>(None).unwrap();
        host.offer::<Objects>(None).unwrap();
        host.offer::<Scan>(Some("ladar")).unwrap();
        host.offer::<Joints>(None).unwrap();
        let mut process = host.observer("test").unwrap();
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "child_that_speaks_jaus", "--nocapture"]).env(GRAPH, &name).env(WITH, with);
        command.stdout(Stdio::null());
        Self {
            grids: process.outbox(None).unwrap(),
            scans: process.outbox(Some("ladar")).unwrap(),
            joints: process.outbox(None).unwrap(),
            heartbeats: process.inbox(None).unwrap(),
            newest: None,
            process,
            child: command.spawn().unwrap(),
            state_dir,
            _host: host,
        }
    }

    /// Lets time pass until the process says a word.
    fn wait_for(&mut self, word: &str) -> String {
        let end = Instant::now() + Duration::from_secs(20);
        let mut last = String::from("nothing");
        while Instant::now() < end {
            self.process.wait(0.05);
            let Some(beat) = self.heartbeats.take_newest().unwrap().0 else { continue };
            self.newest = Some(*beat.header());
            last = beat.header().reason.to_text().into_owned();
            if last.contains(word) {
                return last;
            }
        }
        panic!("never {word:?}; last {last}");
    }

    fn dropped(&self, cause: &str) -> u64 {
        let beat = self.newest.as_ref().unwrap();
        beat.drops.iter().find(|d| d.cause.to_text() == cause).map_or(0, |d| d.count)
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        child::end(&mut self.child, &self.state_dir);
    }
}

/// A client in plain code, after the published layout of AS5669A.
struct Foreign {
    socket: UdpSocket,
    sensor: SocketAddr,
    sequence: u16,
    parts: Vec<u8>,
    acks: Vec<u16>,
}

const OUR_ID: [u8; 4] = [20, 1, 126, 0];
const SENSOR_ID: [u8; 4] = [20, 1, 1, 0];
const EVERYBODY: [u8; 4] = [255; 4];

impl Foreign {
    fn new(sensor: SocketAddr) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        Self { socket, sensor, sequence: 500, parts: Vec::new(), acks: Vec::new() }
    }

    fn say(&mut self, to: [u8; 4], ack: bool, body: &[u8]) -> u16 {
        self.sequence += 1;
        let mut bytes = vec![2, 0];
        bytes.extend(((body.len() + 14) as u16).to_le_bytes());
        bytes.push(if ack { 0x11 } else { 0x01 });
        bytes.extend(to);
        bytes.extend(OUR_ID);
        bytes.extend(body);
        bytes.extend(self.sequence.to_le_bytes());
        self.socket.send_to(&bytes, self.sensor).unwrap();
        self.sequence
    }

    /// The next whole message with this code; others are let pass.
    fn hear(&mut self, code: [u8; 2]) -> Vec<u8> {
        let mut buffer = vec![0; 65_536];
        loop {
            let count = self.socket.recv_from(&mut buffer).expect("an answer within ten seconds").0;
            assert_eq!(buffer[0], 2);
            let mut at = 1;
            while at < count {
                let size = usize::from(u16::from_le_bytes([buffer[at + 1], buffer[at + 2]]));
                let message = &buffer[at..at + size];
                at += size;
                assert_eq!(message[4..8], OUR_ID);
                if message[3] >> 4 & 3 == 3 {
                    self.acks.push(u16::from_le_bytes([message[size - 2], message[size - 1]]));
                    continue;
                }
                match message[3] >> 6 {
                    0 | 1 => self.parts = message[12..size - 2].to_vec(),
                    _ => self.parts.extend(&message[12..size - 2]),
                }
                let whole = matches!(message[3] >> 6, 0 | 3);
                if whole && self.parts[..2] == code {
                    return std::mem::take(&mut self.parts);
                }
            }
        }
    }
}

fn client(graph: &mut Graph) -> Foreign {
    let said = graph.wait_for(" as 1.1.20");
    Foreign::new(said.split(' ').next().unwrap().parse().unwrap())
}

fn scaled(bytes: &[u8], low: f64, high: f64) -> f64 {
    let integer = bytes.iter().rev().fold(0_u64, |sum, byte| sum << 8 | u64::from(*byte));
    low + integer as f64 * (high - low) / ((1_u64 << (8 * bytes.len())) - 1) as f64
}

#[test]
fn a_foreign_client_discovers_controls_subscribes_and_gets_the_topics_cells() {
    let mut graph = Graph::start("jsa", "control");
    let mut client = client(&mut graph);
    // Who is there? A vehicle.
    client.say(EVERYBODY, false, &[0x00, 0x2B, 2]);
    let who = client.hear([0x00, 0x4B]);
    assert_eq!((who[2], u16::from_le_bytes([who[3], who[4]]), &who[6..]), (2, 10_001, &b"terrain smart sensor"[..]));
    client.say(EVERYBODY, false, &[0x03, 0x2B, 1, 255, 1, 255]);
    let services = client.hear([0x03, 0x4B]);
    // One node, number 1, two components, the first is 20.
    assert_eq!(services[2..7], [1, 1, 2, 20, 0]);
    assert!(services.windows(26).any(|w| w == b"urn:jaus:jss:iop:CostMap2D"));
    // Control, asked with acknowledgement.
    let asked = client.say(SENSOR_ID, true, &[0x0D, 0, 200]);
    assert_eq!(client.hear([0x0F, 0]), [0x0F, 0, 0]);
    client.say(SENSOR_ID, false, &[0x03, 0]);
    client.say(SENSOR_ID, false, &[0x02, 0x20]);
    assert_eq!(client.hear([0x02, 0x40])[2], 2, "standby");
    client.say(SENSOR_ID, false, &[0x04, 0]);
    assert!(client.acks.contains(&asked));
    graph.wait_for("controlled by 126.1.20");
    // Every change of the cost map.
    client.say(SENSOR_ID, false, &[0xF0, 0x01, 9, 1, 0, 0, 3, 0, 0, 0, 0x38, 0xD7, 0]);
    assert_eq!(client.hear([0xF3, 0x01])[2..4], [9, 1]);
    let (header, cells) = topic_grid();
    graph.grids.send(&header, &cells).unwrap();
    let event = client.hear([0xF1, 0x41]);
    assert_eq!(event[2..4], [1, 0]);
    check_map(&event[8..], &header, &cells);
    // Garbage, and our id from elsewhere, change nothing but counters.
    client.socket.send_to(&[2, 0, 9, 9], client.sensor).unwrap();
    let thief = UdpSocket::bind("127.0.0.1:0").unwrap();
    thief.send_to(&[2, 0, 16, 0, 1, 20, 1, 1, 0, 20, 1, 126, 0, 0x0E, 0, 1, 0], client.sensor).unwrap();
    graph.grids.send(&header, &cells).unwrap();
    assert_eq!(client.hear([0xF1, 0x41])[2..4], [1, 1]);
    while graph.dropped("id of another address") == 0 || graph.dropped("datagram cut short") == 0 {
        graph.wait_for("controlled by 126.1.20");
    }
}

/// 200 x 200 cells of which each has its own mixture, near the origin of the thesis: 17N, Gainesville.
fn topic_grid() -> (GridHeader, Vec<GridCell>) {
    let header = GridHeader {
        cell_m: 0.15,
        first_cell: [2_460_000, 21_955_000],
        width: 200,
        height: 200,
        zone: 17,
        ..GridHeader::zeroed()
    };
    let cell = |i: u32| GridCell { cost: (i.wrapping_mul(2_654_435_761) >> 24) as u8, ..GridCell::zeroed() };
    (header, (0..40_000).map(cell).collect())
}

fn check_map(map: &[u8], header: &GridHeader, cells: &[GridCell]) {
    assert_eq!(map[..6], [0x42, 0xD7, 200, 0, 200, 0]);
    assert!((scaled(&map[6..8], 0.0, 1e4) - 30.0).abs() < 0.08);
    assert_eq!(map[10], 0, "a place on the globe");
    let (latitude, longitude) = (scaled(&map[11..15], -90.0, 90.0), scaled(&map[15..19], -180.0, 180.0));
    // 369015 E, 3293265 N in 17N, by PROJ 9.
    assert!(
        (latitude - 29.762_745_9).abs() < 1e-7 && (longitude + 82.354_818_0).abs() < 2e-7,
        "{latitude} {longitude}"
    );
    let rotation = scaled(&map[19..21], -std::f64::consts::PI, std::f64::consts::PI).to_degrees();
    assert!((rotation + 0.672_6).abs() < 0.003, "{rotation}");
    assert_eq!((map[21], u16::from_le_bytes([map[22], map[23]])), (0, 40_000));
    let width = header.width as usize;
    for (i, cost) in map[24..].iter().enumerate() {
        let (row_from_north, column) = (i / width, i % width);
        assert_eq!(*cost, cells[(width - 1 - row_from_north) * width + column].cost, "cell {i}");
    }
    assert_eq!(map.len(), 24 + cells.len());
}

#[test]
fn read_only_refuses_control_and_serves_scans() {
    let mut graph = Graph::start("jsb", "");
    let mut client = client(&mut graph);
    client.say(SENSOR_ID, false, &[0x0D, 0, 255]);
    assert_eq!(client.hear([0x0F, 0]), [0x0F, 0, 1]);
    client.say(SENSOR_ID, false, &[0x02, 0]);
    client.say(SENSOR_ID, false, &[0x02, 0x20]);
    assert_eq!(client.hear([0x02, 0x40])[2], 1, "ready");
    let header = ScanHeader { start_rad: -0.785, step_rad: 0.0087, ..ScanHeader::zeroed() };
    let returns: Vec<Return> = (0..541).map(|i| Return { distance_mm: 1000 + i, ..Return::zeroed() }).collect();
    // The head looks 0.1 rad up, then 0.3: at the scan, in the middle, 0.2.
    let at = |stamp_ns, tilt_rad| Joint { stamp_ns, tilt_rad, ..Joint::zeroed() };
    graph.joints.send(&at(-10_000_000, 0.1), &[]).unwrap();
    graph.joints.send(&at(10_000_000, 0.3), &[]).unwrap();
    graph.scans.send(&header, &returns).unwrap();
    child::rest(&mut graph.process, 1.0);
    // Sensor 1 in its own frame, with no optional field.
    client.say(SENSOR_ID, false, &[0x03, 0x28, 1, 0, 1, 0, 0, 0, 0]);
    let report = client.hear([0x03, 0x48]);
    assert_eq!((report[4], u16::from_le_bytes([report[12], report[13]])), (1, 541));
    let points: Vec<f64> = report[14..].chunks(14).map(|point| scaled(&point[2..6], 0.0, 1e6)).collect();
    assert!(points.iter().enumerate().all(|(i, range)| (range - (1.0 + i as f64 / 1e3)).abs() < 2e-4));
    assert_eq!(points.len(), 541);
    // The same in the vehicle's frame: the beam nearest to straight ahead, 1.271 m long, from 0.1 m above the axes.
    client.say(SENSOR_ID, false, &[0x03, 0x28, 1, 0, 1, 0, 1, 0, 0]);
    let report = client.hear([0x03, 0x48]);
    let ahead = &report[14..].chunks(14).nth(271).unwrap();
    let pi = std::f64::consts::PI;
    let (range, inclination) = (scaled(&ahead[2..6], 0.0, 1e6), scaled(&ahead[10..14], -pi, pi));
    let (sin, cos) = 0.2_f64.sin_cos();
    let (x, up) = (1.0 + 1.271 * cos - 0.1 * sin, 2.0 + 1.271 * sin + 0.1 * cos);
    assert!((range - x.hypot(up)).abs() < 1e-3 && (inclination - up.atan2(x)).abs() < 1e-3, "{range} {inclination}");
    // Where it sits: on joint 2 of the pan-tilt unit that this component reports, 0.1 m of 30 m up.
    client.say(SENSOR_ID, false, &[0x05, 0x28, 0, 0]);
    let seat = client.hear([0x05, 0x48]);
    assert_eq!(seat[2..12], [1, 0, 1, 0, 2, 1, 0, 1, 20, 2]);
    assert!((scaled(&seat[20..24], -30.0, 30.0) + 0.1).abs() < 1e-6 && scaled(&seat[24..28], -1.0, 1.0) > 0.999);
    graph.wait_for("read-only");
    while graph.dropped("commands are not allowed") == 0 {
        graph.wait_for("read-only");
    }
}

/// Resident memory of its own, without what it shares with others, bytes.
fn resident(child: &Child) -> i64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    let line = status.lines().find(|line| line.starts_with("RssAnon:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<i64>().unwrap() * 1024
}

#[test]
fn a_consumer_that_stops_reading_costs_no_more_than_eight_megabytes_and_delays_nobody() {
    let mut graph = Graph::start("jsc", "");
    let mut client = client(&mut graph);
    client.say(SENSOR_ID, false, &[0xF0, 0x01, 9, 1, 0, 0, 3, 0, 0, 0, 0x38, 0xD7, 0]);
    client.hear([0xF3, 0x01]);
    let (mut header, _) = topic_grid();
    (header.width, header.height) = (400, 400);
    let cells = vec![GridCell::zeroed(); 160_000];
    graph.grids.send(&header, &cells).unwrap();
    client.hear([0xF1, 0x41]);
    let before = resident(&graph.child);
    for _ in 0..100 {
        graph.grids.send(&header, &cells).unwrap();
        graph.process.wait(0.01);
    }
    let grown = resident(&graph.child) - before;
    println!("a hundred grids of 160000 cells to a stopped consumer: {} KB more", grown / 1024);
    assert!(grown < 8 << 20, "{grown} bytes");
    // Somebody else is answered at once: QueryStatus from 126.1.2.
    let other = UdpSocket::bind("127.0.0.1:0").unwrap();
    other.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    other.send_to(&[2, 0, 16, 0, 1, 20, 1, 1, 0, 2, 1, 126, 0, 0x02, 0x20, 0, 0], client.sensor).unwrap();
    let mut answer = [0; 64];
    assert_eq!(other.recv_from(&mut answer).unwrap().0, 22);
    assert_eq!(answer[13..16], [0x02, 0x40, 1]);
    graph.wait_for("read-only, 2 peers, 1 event");
}

#[test]
fn a_question_to_the_multicast_group_is_answered() {
    let mut graph = Graph::start("jsd", "multicast");
    let said = graph.wait_for("127.0.0.1:");
    if said.contains("cannot listen") {
        return println!("SKIPPED: no multicast here: {said}");
    }
    let mut client = Foreign::new("239.255.0.1:3794".parse().unwrap());
    client.say(EVERYBODY, false, &[0x00, 0x2B, 4]);
    let who = client.hear([0x00, 0x4B]);
    assert_eq!((who[2], u16::from_le_bytes([who[3], who[4]])), (4, 60_001));
}

/// The example of the documentation is a planner, too.
#[test]
fn the_python_planner_of_the_documentation_prints_the_map() {
    let mut graph = Graph::start("jse", "");
    let said = graph.wait_for(" as 1.1.20");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/jaus_cost_map.py");
    let planner =
        Command::new("python3").args(["-u", script, said.split(' ').next().unwrap()]).stdout(Stdio::piped()).spawn();
    let Ok(mut planner) = planner else { return println!("SKIPPED: python3 not found") };
    graph.wait_for("1 peer, 1 event");
    let (header, cells) = topic_grid();
    graph.grids.send(&header, &cells).unwrap();
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(planner.stdout.take().unwrap()));
    assert_eq!(lines.next().unwrap().unwrap(), "found 'terrain smart sensor'");
    let map = lines.next().unwrap().unwrap();
    planner.kill().unwrap();
    planner.wait().unwrap();
    let lethal = cells.iter().filter(|cell| cell.cost == COST_LETHAL).count();
    assert!(map.starts_with("200 x 200 cells, 30.06 x 30.06 m around 29.76274"), "{map}");
    assert!(map.contains("turned -0.67") && map.contains(&format!(" {lethal} impassable, ")), "{map}");
}
