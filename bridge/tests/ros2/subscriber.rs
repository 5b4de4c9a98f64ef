//! A foreign DDS that subscribes to every topic: `peer.py` with PyPI `cyclonedds`, or `fastdds_peer.cpp`.

use super::child::Killed;
use super::python;
use super::rig::mounts;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;
use tsense_bridge::ros2::Config;
use tsense_bridge::ros2::translator::Translator;

/// Finds a foreign DDS on loopback, by unicast: what `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST` makes of it.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>\
    <AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>\
    <Peers><Peer Address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

/// ROS 2 switched on in a domain, all else by default.
pub fn config(domain: u16) -> Config {
    Config { enabled: true, domain_id: domain, ..Config::default() }
}

/// A foreign subscriber to every topic.
pub struct Subscriber {
    programs: Vec<Killed>,
    lines: Receiver<Value>,
    heard: Vec<Value>,
}

impl Subscriber {
    /// Eclipse Cyclone DDS.
    pub fn cyclone(python: &Path, domain: u16) -> Self {
        let mut peer = Command::new(python);
        peer.arg(python::peer()).args(["subscribe", &domain.to_string()]).env("CYCLONEDDS_URI", CYCLONE);
        Self::hearing(vec![started(&mut peer, Stdio::piped())], domain)
    }

    /// eProsima Fast DDS, whose bytes `rosbags` reads.
    pub fn fast_dds(peer: &Path, python: &Path, domain: u16) -> Self {
        let mut peer = started(Command::new(peer).arg(domain.to_string()), Stdio::piped());
        let hex = peer.0.stdout.take().unwrap();
        let decoder = started(Command::new(python).arg(python::peer()).arg("decode"), hex.into());
        Self::hearing(vec![peer, decoder], domain)
    }

    /// The first program is told the topics, the last one prints what was heard.
    fn hearing(mut programs: Vec<Killed>, domain: u16) -> Self {
        let mut input = programs[0].0.stdin.take().unwrap();
        let translator: Translator = Translator::new(&config(domain), mounts());
        for topic in translator.topics() {
            let (reliable, latched) = (u8::from(topic.reliable), u8::from(topic.transient_local));
            writeln!(input, "{} {} {reliable} {latched}", topic.name, topic.type_name).unwrap();
        }
        drop(input);
        let (sender, lines) = channel();
        let output = BufReader::new(programs.last_mut().unwrap().0.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if sender.send(serde_json::from_str(&line).unwrap()).is_err() {
                    return;
                }
            }
        });
        let subscriber = Self { programs, lines, heard: Vec::new() };
        subscriber.next();
        subscriber
    }

    fn next(&self) -> Value {
        let heard = || self.heard.iter().map(|line| line["topic"].to_string()).collect::<Vec<_>>().join(" ");
        self.lines.recv_timeout(Duration::from_secs(30)).unwrap_or_else(|e| panic!("{e}; heard {}", heard()))
    }

    /// The values of the first sample of a topic, which may be still to come.
    pub fn wait_for(&mut self, topic: &str) -> Value {
        loop {
            if let Some(values) = self.heard(topic).next() {
                return values.clone();
            }
            let line = self.next();
            self.heard.push(line);
        }
    }

    /// The values of each sample of a topic that came so far.
    pub fn heard(&mut self, topic: &str) -> impl Iterator<Item = &Value> {
        self.heard.extend(self.lines.try_iter());
        self.heard.iter().filter(move |line| line["topic"] == topic).map(|line| &line["values"])
    }

    /// It stands still from now on, without closing anything.
    pub fn stop(&self) {
        let id = self.programs[0].0.id().to_string();
        assert!(Command::new("kill").args(["-STOP", &id]).status().unwrap().success());
    }
}

fn started(program: &mut Command, input: Stdio) -> Killed {
    Killed(program.stdin(input).stdout(Stdio::piped()).spawn().unwrap())
}

/// `fastdds_peer.cpp` as a program; where it cannot be built the reason is said, and the caller returns.
pub fn fast_dds_peer() -> Option<PathBuf> {
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/fastdds_peer.cpp");
    let peer = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fastdds_peer");
    if !Path::new("/usr/include/fastdds").exists() {
        println!("SKIPPED: no Fast DDS; Debian's packages g++ and libfastrtps-dev have it");
        return None;
    }
    let built =
        Command::new("g++").args(["-std=c++17", "-O1", source, "-lfastrtps", "-lfastcdr", "-o"]).arg(&peer).status();
    assert!(built.unwrap().success(), "{source} is not built");
    Some(peer)
}
