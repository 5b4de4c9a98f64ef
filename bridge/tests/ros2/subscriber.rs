//! A foreign DDS that subscribes to every topic: `peer.py` with PyPI `cyclonedds`.

use super::python;
use super::rig::mounts;
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
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
    child: Child,
    lines: Receiver<Value>,
    heard: Vec<Value>,
}

impl Subscriber {
    pub fn start(python: &Path, domain: u16) -> Self {
        let mut child = Command::new(python)
            .arg(python::peer())
            .args(["subscribe", &domain.to_string()])
            .env("CYCLONEDDS_URI", CYCLONE)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let translator: Translator = Translator::new(&config(domain), mounts());
        let mut input = child.stdin.take().unwrap();
        for topic in translator.topics() {
            let (reliable, latched) = (u8::from(topic.reliable), u8::from(topic.transient_local));
            writeln!(input, "{} {} {reliable} {latched}", topic.name, topic.type_name).unwrap();
        }
        drop(input);
        let (sender, lines) = channel();
        let output = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if sender.send(serde_json::from_str(&line).unwrap()).is_err() {
                    return;
                }
            }
        });
        let subscriber = Self { child, lines, heard: Vec::new() };
        subscriber.next();
        subscriber
    }

    fn next(&self) -> Value {
        let heard = || self.heard.iter().map(|line| line["topic"].to_string()).collect::<Vec<_>>().join(" ");
        self.lines.recv_timeout(Duration::from_secs(30)).unwrap_or_else(|e| panic!("{e}; heard {}", heard()))
    }

    /// The values of the first sample of a topic that is wanted, among all that came and will come.
    pub fn wait_for(&mut self, topic: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        loop {
            if let Some(values) = self.heard(topic, &wanted) {
                return values;
            }
            self.heard.push(self.next());
        }
    }

    /// The values of the first sample of a topic that is wanted, among all that came.
    pub fn heard(&mut self, topic: &str, wanted: impl Fn(&Value) -> bool) -> Option<Value> {
        self.heard.extend(self.lines.try_iter());
        let line = self.heard.iter().find(|line| line["topic"] == topic && wanted(&line["values"]))?;
        Some(line["values"].clone())
    }

    /// It stands still from now on, without closing anything.
    pub fn stop(&self) {
        assert!(Command::new("kill").args(["-STOP", &self.child.id().to_string()]).status().unwrap().success());
    }
}

impl Drop for Subscriber {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
