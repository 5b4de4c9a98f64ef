//! The processes `pan-tilt` and `gpos` in a graph of their own: a scripted unit on a pseudo terminal, a receiver on a
//! socket, both processes killed and restarted, the head halted when poses stop and when the graph ends.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "../src/pan_tilt/fake_unit.rs"]
mod fake_unit;

use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tsense_contract::{Heartbeats, JOINT_HALTED, Joint, Joints, Pose, Poses};
use tsense_drivers::{gpos, pan_tilt};
use tsense_ports::{Clock, Domain, Host, Inbox, Process};

const GRAPH: &str = "TSENSE_MOTION_CHILD_GRAPH";
const ADDRESS: &str = "TSENSE_MOTION_CHILD_ADDRESS";
/// A busy machine needs long; a test that works is done in seconds.
const PATIENCE_S: f64 = 30.0;

/// Where a child finds its graph and its device; none when run as a test.
fn child_of(name: &str) -> Option<(Process, String)> {
    let graph = std::env::var(GRAPH).ok()?;
    let process = Process::join(&Domain::new(&graph).unwrap(), name).unwrap();
    Some((process, std::env::var(ADDRESS).unwrap()))
}

#[test]
fn child_that_is_the_pan_tilt_driver() {
    let Some((process, address)) = child_of("pan-tilt") else { return };
    // A busy test machine pauses longer than a line does.
    let config = pan_tilt::Config {
        address,
        reply_margin_ms: 1000.0,
        stamp_std_max_ms: 1000.0,
        pose_timeout_s: 1.5,
        ..pan_tilt::Config::default()
    };
    pan_tilt::process::run(process, &config).unwrap();
}

#[test]
fn child_that_is_the_gpos_driver() {
    let Some((process, address)) = child_of("gpos") else { return };
    gpos::process::run(process, &gpos::Config { address, ..gpos::Config::default() }).unwrap();
}

fn spawn(graph: &str, test: &str, address: &str) -> Child {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", test, "--nocapture"]).env(GRAPH, graph).env(ADDRESS, address);
    command.stdout(Stdio::null()).spawn().unwrap()
}

/// The receiver: ten epochs a second to one client after the other, on either side of a zone's border.
#[derive(Default)]
struct Source {
    beyond: AtomicBool,
    silent: AtomicBool,
    over: AtomicBool,
}

impl Source {
    fn serve(&self, listener: &TcpListener) {
        listener.set_nonblocking(true).unwrap();
        let mut tenths = 432_000_u32;
        let mut client = None;
        while !self.over.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(100));
            tenths += 1;
            client = listener.accept().ok().map(|(socket, _)| socket).or(client);
            if self.silent.load(Ordering::Relaxed) {
                continue;
            }
            let gone = client.as_mut().is_some_and(|socket| socket.write_all(self.epoch(tenths).as_bytes()).is_err());
            if gone {
                client = None;
            }
        }
    }

    fn epoch(&self, tenths: u32) -> String {
        let second = tenths / 10;
        let time = format!("{:02}{:02}{:02}.{}", second / 3600, second / 60 % 60, second % 60, tenths % 10);
        // The border between zones 17 and 18 is 78 degrees west.
        let longitude = if self.beyond.load(Ordering::Relaxed) { "07754.0000" } else { "07806.0000" };
        let sentence = |body: String| format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, byte| sum ^ byte));
        sentence(format!("GPGGA,{time},3000.0000,N,{longitude},W,4,17,0.7,42.0,M,-28.5,M,1.0,0001"))
            + &sentence(format!("PASHR,{time},90.00,T,1.0,-2.0,0.0,0.01,0.01,0.05,2,1"))
    }
}

/// The graph as its launcher sees it.
struct Graph {
    name: String,
    host: Host,
    process: Process,
    poses: Inbox<Poses>,
    joints: Inbox<Joints>,
    state_dir: std::path::PathBuf,
    terminal: String,
    receiver: SocketAddr,
    children: Vec<Child>,
}

impl Graph {
    fn start(terminal: &str, receiver: SocketAddr) -> Self {
        let name = format!("motion{}", std::process::id() % 1_000_000);
        let state_dir = std::env::temp_dir().join(format!("tsense-{name}"));
        std::fs::create_dir_all(&state_dir).unwrap();
        let mut host = Host::open(Domain::new(&name).unwrap(), Clock::start(1.0), &state_dir).unwrap();
        host.offer::<Heartbeats>(None).unwrap();
        host.offer::<Poses>(None).unwrap();
        host.offer::<Joints>(None).unwrap();
        let mut process = host.observer("test").unwrap();
        let (poses, joints) = (process.inbox(None).unwrap(), process.inbox(None).unwrap());
        let terminal = terminal.to_string();
        let mut graph = Self { name, host, process, poses, joints, state_dir, terminal, receiver, children: vec![] };
        graph.start_children();
        graph
    }

    fn start_children(&mut self) {
        let gpos = format!("tcp:{}", self.receiver);
        self.children = vec![
            spawn(&self.name, "child_that_is_the_pan_tilt_driver", &self.terminal),
            spawn(&self.name, "child_that_is_the_gpos_driver", &gpos),
        ];
    }

    /// Kills both without warning, cleans up as the launcher does, and starts them again.
    fn kill_and_restart(&mut self) {
        for mut child in std::mem::take(&mut self.children) {
            child.kill().unwrap();
            child.wait().unwrap();
        }
        self.host.clean_dead();
        while self.poses.take().unwrap().is_some() || self.joints.take().unwrap().is_some() {}
        self.start_children();
    }

    /// Waits for a pose that is as wanted.
    fn wait_for_pose(&mut self, wanted: impl Fn(&Pose) -> bool) {
        let end = self.process.clock().now().plus_seconds(PATIENCE_S);
        while !std::iter::from_fn(|| self.poses.take().unwrap()).any(|sample| wanted(sample.header())) {
            assert!(self.process.clock().now() < end, "no pose as wanted");
            self.process.wait(0.05);
        }
    }

    /// Waits for a joint that is as wanted.
    fn wait_for_joint(&mut self, wanted: impl Fn(&Joint) -> bool) {
        let end = self.process.clock().now().plus_seconds(PATIENCE_S);
        while !std::iter::from_fn(|| self.joints.take().unwrap()).any(|sample| wanted(sample.header())) {
            assert!(self.process.clock().now() < end, "no joint as wanted");
            self.process.wait(0.05);
        }
    }

    fn end(mut self) {
        for child in &mut self.children {
            let stopped = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
            let ended = child.wait().unwrap();
            assert!(stopped.success() && ended.success(), "ends cleanly on SIGTERM: {ended}");
        }
        std::fs::remove_dir_all(&self.state_dir).unwrap();
    }
}

#[test]
fn the_motion_drivers_survive_kill_9_keep_their_zone_and_leave_the_head_standing() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let receiver = listener.local_addr().unwrap();
    let source = Arc::new(Source::default());
    let serving = source.clone();
    let server = std::thread::spawn(move || serving.serve(&listener));
    let unit = fake_unit::bench(|terminal| {
        let mut graph = Graph::start(terminal, receiver);
        graph.wait_for_pose(|pose| pose.zone == 17);
        graph.wait_for_joint(|joint| joint.tilt_rate_rad_s < -0.2);
        graph.wait_for_pose(|pose| pose.flags == 0 && (pose.altitude_m - 13.5).abs() < 1e-6);

        source.beyond.store(true, Ordering::Relaxed);
        graph.kill_and_restart();
        // Beyond the border by now, and still in the zone of the map.
        graph.wait_for_pose(|pose| pose.zone == 17 && pose.easting_m > 789_000.0);
        graph.wait_for_joint(|joint| joint.tilt_rate_rad_s.abs() > 0.2);

        source.silent.store(true, Ordering::Relaxed);
        graph.wait_for_joint(|joint| joint.flags == JOINT_HALTED);
        source.silent.store(false, Ordering::Relaxed);
        graph.wait_for_joint(|joint| joint.flags == 0 && joint.tilt_rate_rad_s.abs() > 0.2);
        graph.end();
    });
    source.over.store(true, Ordering::Relaxed);
    server.join().unwrap();
    assert_eq!(unit.log.last().map(String::as_str), Some("H"), "the head was left standing");
}
