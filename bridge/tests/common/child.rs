//! The end of a process under test.

use std::path::Path;
use std::process::{Child, Command};

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
