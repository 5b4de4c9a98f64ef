//! The bytes of our ROS messages against those that PyPI `rosbags` writes: a committed copy of its own output, and
//! `rosbags` itself where Python has it.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests are their own shell")]

#[path = "common/python.rs"]
mod python;
#[path = "ros2/samples.rs"]
mod samples;

use serde_json::Value;
use std::io::Write;
use std::process::{Command, Stdio};
use tsense_bridge::ros2::messages::RosMessage;

/// What `rosbags` 0.11 wrote: a line a message, type and hex.
const GOLDEN: &str = include_str!("ros2/golden.txt");

/// Type, hash, bytes and values of every sample.
fn all() -> Vec<(&'static str, &'static str, Vec<u8>, Value)> {
    fn one<M: RosMessage + serde::Serialize>(message: M) -> (&'static str, &'static str, Vec<u8>, Value) {
        (M::TYPE, M::HASH, message.to_cdr(), python::exact(&message))
    }
    vec![
        one(samples::occupancy_grid()),
        one(samples::grid_map()),
        one(samples::laser_scan()),
        one(samples::point_cloud()),
        one(samples::detections()),
        one(samples::transforms()),
        one(samples::odometry()),
        one(samples::diagnostics()),
    ]
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn every_message_has_the_bytes_that_rosbags_wrote() {
    let golden: Vec<_> = GOLDEN.lines().filter_map(|line| line.split_once(' ')).collect();
    let ours: Vec<_> = all().into_iter().map(|(name, _, bytes, _)| (name, hex(&bytes))).collect();
    assert_eq!(golden.len(), ours.len());
    for ((name, expected), (our_name, bytes)) in golden.iter().zip(&ours) {
        assert_eq!((*name, *expected), (*our_name, bytes.as_str()));
    }
}

/// With `TSENSE_BLESS=1` the golden file is written anew from what rosbags writes.
#[test]
fn rosbags_reads_every_field_and_writes_the_same_bytes() {
    let Some(python) = python::python_with("rosbags") else { return };
    let mut child = Command::new(python)
        .arg(python::peer())
        .arg("rosbags")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let samples = all();
    let mut input = child.stdin.take().unwrap();
    for (name, _, bytes, _) in &samples {
        writeln!(input, "{name} {}", hex(bytes)).unwrap();
    }
    drop(input);
    let output = child.wait_with_output().unwrap();
    let answers: Vec<Value> =
        String::from_utf8(output.stdout).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(answers.len(), samples.len());
    let mut golden = String::new();
    for ((name, hash, bytes, values), answer) in samples.iter().zip(&answers) {
        assert_eq!(&answer["values"], values, "{name}");
        assert_eq!(answer["hex"], hex(bytes).as_str(), "{name}");
        assert_eq!(answer["hash"], *hash, "{name}");
        golden += &format!("{name} {}\n", answer["hex"].as_str().unwrap());
    }
    if std::env::var_os("TSENSE_BLESS").is_some() {
        std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/golden.txt"), golden).unwrap();
    }
}
