//! A graph under test: the real program in a private graph, spoken to as a user would, cleaned up whatever happens.
//!
//! Each [`TestGraph`] has its own name (and with it its own root and prefix in shared memory) and its own folder for
//! configuration, log and state. Nothing here reaches into the program but its exit codes, its socket and its topics.
#![allow(dead_code, reason = "each test binary uses a part")]
#![allow(clippy::disallowed_methods, reason = "tests start processes and read their files")]

pub mod outside;
pub mod world;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use tsense_ports::{Domain, Process};

/// Every stage, with devices that are not there and a page on any free port.
pub const ALL_STAGES: &str = "[[ladar]]\naddress = \"127.0.0.1:1\"\n[pan_tilt]\naddress = \"tcp:127.0.0.1:1\"\n[gpos]\n\
    [mapper]\n[classifier]\n[kstore]\n[bridge]\nlisten = \"127.0.0.1:0\"\n";
/// Names of the processes of [`ALL_STAGES`].
pub const ALL_PROCESSES: [&str; 7] = ["ladar", "pan-tilt", "gpos", "mapper", "classifier", "kstore", "bridge"];
/// Longest any graph may take to come up or to end: a debug build on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// The program.
pub fn tsense(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tsense"));
    command.args(arguments);
    command
}

/// Runs the program to its end.
pub fn output(arguments: &[&str]) -> Output {
    tsense(arguments).output().expect("the program starts")
}

/// What a program said on standard error.
pub fn complaint(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder of a test's own; it goes with this.
pub struct Folder(pub PathBuf);

impl Folder {
    /// A folder whose name says what it is for.
    pub fn new(what: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!("tsense-{what}-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        remove(&self.0);
    }
}

/// A private graph.
pub struct TestGraph {
    domain: Domain,
    folder: PathBuf,
    launcher: Option<Child>,
}

impl TestGraph {
    /// A private graph that is not running yet. `graph` are further lines of its section `[graph]`.
    pub fn prepare(graph: &str, sections: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!("t{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let folder = std::env::temp_dir().join(format!("tsense-{name}"));
        std::fs::create_dir_all(&folder).unwrap();
        let state = folder.join("state");
        let text = format!("[graph]\nname = \"{name}\"\nstate_dir = {state:?}\n{graph}\n{sections}");
        std::fs::write(folder.join("config.toml"), text).unwrap();
        Self { domain: Domain::new(&name).unwrap(), folder, launcher: None }
    }

    /// A private graph whose processes have all sent a heartbeat.
    pub fn start(graph: &str, sections: &str) -> Self {
        let mut this = Self::prepare(graph, sections);
        this.launch();
        this.wait_until("every process is alive", all_alive);
        this
    }

    /// Starts the launcher; its log goes into a file.
    pub fn launch(&mut self) {
        let log = std::fs::File::options().create(true).append(true).open(self.log_file()).unwrap();
        let mut command = tsense(&["run"]);
        command.arg(self.config_file()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        self.launcher = Some(command.spawn().expect("the program starts"));
    }

    /// Where the graph lives.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// The graph's configuration.
    pub fn config_file(&self) -> PathBuf {
        self.folder.join("config.toml")
    }

    /// Where the graph keeps files.
    pub fn state_dir(&self) -> PathBuf {
        self.folder.join("state")
    }

    fn log_file(&self) -> PathBuf {
        self.folder.join("log")
    }

    /// Everything the graph logged so far.
    pub fn log(&self) -> String {
        std::fs::read_to_string(self.log_file()).unwrap_or_default()
    }

    /// Ports into the graph, from this test.
    pub fn observer(&self) -> Process {
        Process::observe(&self.domain, "test").expect("the graph runs")
    }

    /// The graph's table, or none where nobody answers.
    pub fn status(&self) -> Option<Value> {
        let mut stream = UnixStream::connect(self.domain.socket()).ok()?;
        stream.set_read_timeout(Some(PATIENCE)).ok()?;
        stream.write_all(b"status\n").ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        serde_json::from_str(&answer).ok()
    }

    /// One row of the table.
    pub fn process(&self, name: &str) -> Value {
        row(&self.status().expect("the graph answers"), name).clone()
    }

    /// Process id of a process, 0 where it is not running.
    pub fn pid(&self, name: &str) -> u32 {
        pid(&self.process(name))
    }

    /// Waits for a state of the table; how long it took.
    pub fn wait_until(&self, what: &str, mut reached: impl FnMut(&Value) -> bool) -> Duration {
        let start = Instant::now();
        let mut last = None;
        while start.elapsed() < PATIENCE {
            last = self.status().or(last);
            if last.as_ref().is_some_and(&mut reached) {
                return start.elapsed();
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        panic!("never: {what}\n{last:#?}\nlog:\n{}", self.log());
    }

    /// Process id of the launcher.
    pub fn launcher_pid(&self) -> u32 {
        self.launcher.as_ref().expect("launched").id()
    }

    /// Kills a process at once; waits until another one of its name is alive, and says how long that took.
    pub fn kill_and_wait(&self, name: &str) -> Duration {
        let old = self.kill(name);
        self.wait_until(&format!("{name} is alive again"), |status| {
            let row = row(status, name);
            pid(row) != old && alive(row)
        })
    }

    /// Kills a process at once; its id.
    pub fn kill(&self, name: &str) -> u32 {
        let pid = self.pid(name);
        signal(pid, Signal::KILL);
        pid
    }

    /// Sends the launcher a signal, and waits for its end.
    pub fn signal_launcher(&mut self, which: Signal) -> ExitStatus {
        signal(self.launcher_pid(), which);
        self.wait_for_launcher()
    }

    /// Waits for the launcher's end.
    pub fn wait_for_launcher(&mut self) -> ExitStatus {
        let start = Instant::now();
        let launcher = self.launcher.as_mut().expect("launched");
        while start.elapsed() < PATIENCE {
            if let Some(status) = launcher.try_wait().unwrap() {
                self.launcher = None;
                return status;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("the launcher did not end\n{}", self.log());
    }

    /// `tsense stop`, then the launcher's exit code.
    pub fn stop(&mut self) -> Option<i32> {
        let stopped = output(&["stop", "--graph", self.domain.name()]);
        assert!(stopped.status.success(), "{}", complaint(&stopped));
        self.wait_for_launcher().code()
    }

    /// Nothing of the graph is in shared memory any more.
    pub fn assert_nothing_left(&self) {
        assert_eq!(self.domain.leftovers(), Vec::<PathBuf>::new(), "log:\n{}", self.log());
    }

    /// Ends the graph properly; nothing may be left.
    pub fn finish(mut self) {
        assert_eq!(self.stop(), Some(0), "{}", self.log());
        self.assert_nothing_left();
    }
}

impl Drop for TestGraph {
    /// Whatever the test did: no process, no shared memory and no folder stays.
    fn drop(&mut self) {
        if let Some(mut launcher) = self.launcher.take() {
            let _ = launcher.kill();
            let _ = launcher.wait();
            std::thread::sleep(Duration::from_millis(300));
        }
        for path in self.domain.leftovers() {
            remove(&path);
        }
        remove(&self.folder);
    }
}

fn remove(path: &Path) {
    let _ = std::fs::remove_dir_all(path).or_else(|_| std::fs::remove_file(path));
}

/// Sends a signal to a process by its id.
pub fn signal(pid: u32, signal: Signal) {
    let pid = Pid::from_raw(pid as i32).expect("a running process");
    kill_process(pid, signal).expect("a process of ours");
}

/// Whether a process exists.
pub fn exists(pid: u32) -> bool {
    let state = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    state.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
}

/// The row of a process.
pub fn row<'s>(status: &'s Value, name: &str) -> &'s Value {
    let rows = status["processes"].as_array().expect("rows");
    rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("no process {name} in {status:#}"))
}

/// A row's process id, 0 where it is not running.
pub fn pid(row: &Value) -> u32 {
    row["pid"].as_u64().expect("a number") as u32
}

/// Whether a process runs and has sent heartbeats lately.
pub fn alive(row: &Value) -> bool {
    pid(row) != 0 && !row["reason"].as_str().expect("words").starts_with("no heartbeat")
}

/// Whether every process is alive.
pub fn all_alive(status: &Value) -> bool {
    status["processes"].as_array().expect("rows").iter().all(alive)
}
