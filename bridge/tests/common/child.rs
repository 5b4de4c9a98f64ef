//! A process under test: time passes for it, and its end.

use std::path::Path;
use std::process::{Child, Command};
use tsense_ports::Process;

/// Lets so much time pass. `Process::wait` alone ends at the first thing that comes, a heartbeat too.
#[allow(dead_code, reason = "of the tests' programs only some need it")]
pub fn rest(process: &mut Process, seconds: f64) {
    let end = process.clock().now().plus_seconds(seconds);
    while process.clock().now() < end {
        process.wait(end.seconds_since(process.clock().now()).max(0.0));
    }
}

/// Asks the child to stop, waits for it, and removes the folder of its graph. Fails where it did not end cleanly, unless
/// the test has failed already.
pub fn end(child: &mut Child, state_dir: &Path) {
    let stopped = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success();
    let ended = child.wait().unwrap();
    let _ = std::fs::remove_dir_all(state_dir);
    if !std::thread::panicking() {
        assert!(stopped && ended.success(), "the process ends cleanly on SIGTERM: {ended}");
    }
}

/// A program of others, killed when this is dropped.
#[allow(dead_code, reason = "of the tests' programs only some start one")]
pub struct Killed(pub Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
