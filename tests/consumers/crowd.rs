//! A consumer of everything that the bridge serves, as processes that can be stopped like any other.
//!
//! The page, JAUS and Foxglove are read by this test binary started again; ROS 2 by PyPI `cyclonedds`, where Python has it;
//! a vehicle's objects and blocks by a station.

use crate::harness::{self, Folder, TestGraph, outside};
use crate::http::{ask, read_message, send_text, upgrade};
use crate::python::python_with;
use rustix::process::Signal;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Where the consumers find what they read: addresses of page, JAUS and Foxglove, with spaces between.
const ADDRESSES: &str = "TSENSE_CROWD_ADDRESSES";
/// Of a second, how long slow consumers run.
const AWAKE: Duration = Duration::from_millis(100);
/// Types and topics that a Nav2 or RViz reads; reliable or not, latched or not.
const ROS_TOPICS: &str = "/tsense/traversability nav_msgs/msg/OccupancyGrid 1 1\n\
    /tsense/grid_map grid_map_msgs/msg/GridMap 1 1\n/tsense/scan/ladar sensor_msgs/msg/LaserScan 0 0\n\
    /tsense/voxels sensor_msgs/msg/PointCloud2 0 0\n/tsense/objects vision_msgs/msg/Detection3DArray 1 1\n\
    /tf tf2_msgs/msg/TFMessage 1 0\n/tf_static tf2_msgs/msg/TFMessage 1 1\n/tsense/odom nav_msgs/msg/Odometry 1 0\n\
    /diagnostics diagnostic_msgs/msg/DiagnosticArray 1 0\n";
/// Finds participants on loopback by unicast.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>\
    <AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>\
    <Peers><Peer Address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

/// How consumers behave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pace {
    /// There are none.
    Absent,
    /// They stand still, with everything open.
    Stopped,
    /// They run a tenth of the time.
    Slow,
    /// They read all that comes.
    Running,
}

impl Pace {
    /// What is compared.
    pub const ALL: [Pace; 3] = [Pace::Absent, Pace::Stopped, Pace::Slow];
}

/// Processes of the bridge that this binary has.
pub fn served() -> Vec<&'static str> {
    let fleet = cfg!(feature = "fleet").then_some("fleet");
    outside::names().into_iter().chain(fleet).collect()
}

/// What switches them on, behind `[bridge]`.
pub fn sections() -> String {
    let mut sections = outside::sections();
    if cfg!(feature = "fleet") {
        sections += &format!("[bridge.fleet]\nenabled = true\nconnect = [\"{}\"]\n", station_address());
    }
    sections
}

/// Where this run's stations listen, one after the other.
fn station_address() -> SocketAddr {
    static ADDRESS: OnceLock<SocketAddr> = OnceLock::new();
    *ADDRESS.get_or_init(|| TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap())
}

/// Consumers of everything.
pub struct Crowd {
    pace: Pace,
    members: Vec<Child>,
    /// What the station writes.
    _folder: Folder,
    start: Instant,
    awake: bool,
}

impl Crowd {
    /// Starts them; they have been served once when this returns.
    pub fn gather(graph: &TestGraph, pace: Pace) -> Self {
        let folder = Folder::new("station");
        let mut members = vec![reader(graph)];
        members.extend(cfg!(feature = "fleet").then(|| station(&folder.0)));
        let ros2 = ros2();
        let has_ros2 = ros2.is_some();
        members.extend(ros2);
        let crowd = Self { pace, members, _folder: folder, start: Instant::now(), awake: true };
        let served_one =
            [("bridge", " 1 viewer"), ("jaus", " 1 event"), ("foxglove", " 1 client"), ("fleet", " 1 of 1 stations")];
        for (name, word) in served_one {
            if served().contains(&name) {
                graph.wait_until(&format!("{name} has its consumer"), |status| reason(status, name).contains(word));
            }
        }
        if has_ros2 {
            graph.wait_until("ROS has its subscriptions", |status| reason(status, "ros2").contains(" 9 subscriptions"));
        }
        std::thread::sleep(Duration::from_secs(1));
        crowd
    }

    /// Lets them run or stand, as their pace says.
    pub fn tick(&mut self) {
        let second = Duration::from_millis(self.start.elapsed().as_millis() as u64 % 1000);
        let awake = match self.pace {
            Pace::Absent | Pace::Running => true,
            Pace::Stopped => false,
            Pace::Slow => second < AWAKE,
        };
        if awake != self.awake {
            self.awake = awake;
            let which = if awake { Signal::CONT } else { Signal::STOP };
            self.members.iter().for_each(|member| harness::signal(member.id(), which));
        }
    }
}

impl Drop for Crowd {
    fn drop(&mut self) {
        for member in &mut self.members {
            let _ = member.kill();
            let _ = member.wait();
        }
    }
}

fn reason(status: &serde_json::Value, name: &str) -> String {
    harness::row(status, name)["reason"].as_str().unwrap().to_owned()
}

/// The address that a process says it is to be found at.
fn address(graph: &TestGraph, name: &str) -> String {
    let said = reason(&graph.status().expect("the graph answers"), name);
    let at = said.find("127.0.0.1:").unwrap_or_else(|| panic!("{name} serves nowhere: {said}"));
    said[at..].split([' ', ',', '/']).next().unwrap().to_owned()
}

/// This test binary again, as the reader of page, JAUS and Foxglove.
fn reader(graph: &TestGraph) -> Child {
    let read = ["bridge", "jaus", "foxglove"].into_iter().filter(|name| served().contains(name));
    let addresses: Vec<_> = read.map(|name| address(graph, name)).collect();
    elsewhere(&std::env::current_exe().unwrap())
        .args(["--exact", "crowd::child_that_reads", "--nocapture"])
        .env(ADDRESSES, addresses.join(" "))
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}

/// A program with a lower priority: real consumers run on other machines and take no processor time from the graph.
fn elsewhere(program: &Path) -> Command {
    let mut command = Command::new("nice");
    command.args(["-n", "5"]).arg(program);
    command
}

/// A station that keeps objects and blocks.
fn station(folder: &Path) -> Child {
    elsewhere(Path::new(env!("CARGO_BIN_EXE_tsense")))
        .args(["station", "--listen", &station_address().to_string(), "--store"])
        .arg(folder.join("fleet.gpkg"))
        .arg("--blocks")
        .arg(folder.join("blocks"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn ros2() -> Option<Child> {
    let python = python_with("cyclonedds")?;
    let mut child = elsewhere(&python)
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/bridge/tests/ros2/peer.py"))
        .args(["subscribe", &outside::domain().to_string()])
        .env("CYCLONEDDS_URI", CYCLONE)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(ROS_TOPICS.as_bytes()).unwrap();
    Some(child)
}

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_reads() {
    let Ok(addresses) = std::env::var(ADDRESSES) else { return };
    let addresses: Vec<SocketAddr> = addresses.split(' ').map(|address| address.parse().unwrap()).collect();
    let mut streams = vec![page(addresses[0])];
    streams.extend(addresses.get(2).map(|address| foxglove(*address)));
    for mut stream in streams {
        std::thread::spawn(move || {
            let mut buffer = vec![0; 1 << 16];
            while stream.read(&mut buffer).is_ok_and(|count| count > 0) {}
            std::process::exit(1);
        });
    }
    jaus(addresses[1]);
}

fn page(address: SocketAddr) -> TcpStream {
    let (stream, head) =
        ask(address, "/ws", &upgrade(&format!("Host: {address}"), &format!("Origin: http://{address}")));
    assert!(head.starts_with("HTTP/1.1 101"), "{head}");
    stream
}

/// Subscribes to every channel of a graph with one ladar.
fn foxglove(address: SocketAddr) -> TcpStream {
    let host = format!("Host: {address}");
    let mut headers = upgrade(&host, "X-Nothing: 1").to_vec();
    headers.push("Sec-WebSocket-Protocol: foxglove.sdk.v1");
    let (mut stream, head) = ask(address, "/", &headers);
    assert!(head.starts_with("HTTP/1.1 101"), "{head}");
    let mut channels = Vec::new();
    while channels.len() < 6 {
        let told: serde_json::Value = serde_json::from_slice(&read_message(&mut stream)).unwrap();
        channels.extend(told["channels"].as_array().into_iter().flatten().map(|channel| channel["id"].clone()));
    }
    for id in channels {
        send_text(&mut stream, &format!(r#"{{"op":"subscribe","subscriptions":[{{"id":{id},"channelId":{id}}}]}}"#));
    }
    stream
}

/// Asks for the cost map on every change, again every twenty seconds, and reads what comes.
fn jaus(sensor: SocketAddr) {
    const CREATE_EVENT: [u8; 13] = [0xF0, 0x01, 1, 1, 0, 0, 3, 0, 0, 0, 0x38, 0xD7, 0];
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
    let (mut asked, mut buffer, mut sequence) = (None::<Instant>, vec![0; 1 << 16], 0_u16);
    loop {
        if asked.is_none_or(|asked| asked.elapsed() > Duration::from_secs(20)) {
            (asked, sequence) = (Some(Instant::now()), sequence + 1);
            let size = (CREATE_EVENT.len() + 14) as u16;
            // Version 2; one message, to 1.1.20, from 126.1.20.
            let head = [2, 0, size as u8, (size >> 8) as u8, 1, 20, 1, 1, 0, 20, 1, 126, 0];
            let whole = [&head[..], &CREATE_EVENT[..], &sequence.to_le_bytes()[..]].concat();
            socket.send_to(&whole, sensor).unwrap();
        }
        let _ = socket.recv(&mut buffer);
    }
}
