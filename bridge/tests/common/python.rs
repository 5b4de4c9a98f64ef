//! A Python with the packages a test needs, or a loud reason why the test is skipped.
#![allow(clippy::print_stdout, reason = "tests tell what they skipped")]

use serde_json::Value;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// The variable that names the Python of a virtual environment with what others read and write.
const PYTHON: &str = "TSENSE_PYTHON";

/// A Python that can import `packages`, one or several between commas; without one it says so, and the caller returns.
pub fn python_with(packages: &str) -> Option<PathBuf> {
    let python = std::env::var_os(PYTHON).map_or_else(|| PathBuf::from("python3"), PathBuf::from);
    let found = Command::new(&python)
        .args(["-c", &format!("import {packages}")])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !found {
        println!("SKIPPED: {} cannot import {packages}; set {PYTHON} to one that can", python.display());
    }
    found.then_some(python)
}

/// Values as the peer writes them: a float by its bits, so that no reader of JSON rounds it.
pub fn exact(value: impl serde::Serialize) -> Value {
    fn bits(value: Value) -> Value {
        match value {
            Value::Number(n) if n.is_f64() => format!("f64:{:016x}", n.as_f64().unwrap().to_bits()).into(),
            Value::Array(items) => items.into_iter().map(bits).collect(),
            Value::Object(fields) => fields.into_iter().map(|(name, value)| (name, bits(value))).collect(),
            other => other,
        }
    }
    bits(serde_json::to_value(value).unwrap())
}

/// The foreign peer.
pub fn peer() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2/peer.py"))
}
