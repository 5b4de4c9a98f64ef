//! One child process: started by re-executing this program, watched by its pidfd, started again within limits.
//!
//! A process that dies after it was up is started again at once. One that dies before its first heartbeat waits a
//! little longer each time. One that was started again too often within the window opens the circuit breaker.
#![allow(clippy::disallowed_methods, reason = "shell: the children's log file")]

use super::GraphError;
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::collections::VecDeque;
use std::fs::File;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use tsense_ports::machine_seconds;

/// First wait before a process is started again that never was up, seconds; doubled each time.
const BACK_OFF_S: f64 = 0.1;
/// Longest such wait, seconds.
const BACK_OFF_MAX_S: f64 = 2.0;

/// A child of the launcher.
pub(super) struct Child {
    name: String,
    running: Option<Running>,
    start_at_s: f64,
    restarts: u64,
    restarted_s: VecDeque<f64>,
    never_up: u32,
}

struct Running {
    process: std::process::Child,
    handle: OwnedFd,
    started_s: f64,
    is_up: bool,
}

/// How a child ended.
pub(super) struct Death {
    /// In words, after the process's name: `was killed by signal 9 after 3.2 s`.
    pub(super) words: String,
    code: Option<i32>,
}

impl Child {
    pub(super) fn new(name: &str) -> Self {
        let restarted_s = VecDeque::new();
        Self { name: name.into(), running: None, start_at_s: 0.0, restarts: 0, restarted_s, never_up: 0 }
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn pid(&self) -> Option<u32> {
        self.running.as_ref().map(|r| r.process.id())
    }

    pub(super) fn restarts(&self) -> u64 {
        self.restarts
    }

    pub(super) fn is_running(&self) -> bool {
        self.running.is_some()
    }

    /// Readable once the child ended.
    pub(super) fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        self.running.as_ref().map(|r| r.handle.as_fd())
    }

    pub(super) fn is_due(&self, now_s: f64) -> bool {
        self.running.is_none() && now_s >= self.start_at_s
    }

    /// Starts the process; returns its id.
    pub(super) fn start(&mut self, config: &Path, log_file: Option<&Path>) -> Result<u32, GraphError> {
        let failed = |e: std::io::Error| GraphError::system(format!("starting process `{}`", self.name), e);
        // The program that runs now, even where its file was replaced meanwhile: all processes are of one version.
        let mut command = Command::new("/proc/self/exe");
        command.arg0("tsense").args(["process", &self.name, "--config"]).arg(config);
        command.stdin(Stdio::null()).stdout(Stdio::null());
        if let Some(path) = log_file {
            command.stderr(File::options().create(true).append(true).open(path).map_err(failed)?);
        }
        // A group of its own: Ctrl-C reaches the launcher alone, which then ends the others in order.
        let process = command.process_group(0).spawn().map_err(failed)?;
        let pid = process.id();
        let id = i32::try_from(pid).ok().and_then(Pid::from_raw).unwrap_or(Pid::INIT);
        let handle = pidfd_open(id, PidfdFlags::empty()).map_err(|e| failed(e.into()))?;
        tracing::debug!(process = self.name, pid, "process started");
        self.running = Some(Running { process, handle, started_s: machine_seconds(), is_up: false });
        Ok(pid)
    }

    /// A heartbeat of this very process arrived.
    pub(super) fn beats(&mut self) {
        self.never_up = 0;
        if let Some(running) = &mut self.running {
            running.is_up = true;
        }
    }

    /// How the child ended, if it did since this was asked last.
    pub(super) fn reap(&mut self) -> Result<Option<Death>, GraphError> {
        let Some(running) = &mut self.running else { return Ok(None) };
        let waited = running.process.try_wait();
        let waited = waited.map_err(|e| GraphError::system(format!("waiting for process `{}`", self.name), e))?;
        let Some(status) = waited else { return Ok(None) };
        let lived_s = machine_seconds() - running.started_s;
        self.never_up = if running.is_up { 0 } else { self.never_up + 1 };
        self.running = None;
        Ok(Some(Death { words: words(status, lived_s), code: status.code() }))
    }

    /// Decides when the dead child starts again; an error where that is no use.
    pub(super) fn plan_restart(&mut self, death: &Death, max: usize, window_s: f64) -> Result<(), GraphError> {
        let (process, words) = (self.name.clone(), death.words.clone());
        if let Some(code @ (2 | 3)) = death.code {
            return Err(GraphError::Refused { process, words, code: code as u8 });
        }
        let now_s = machine_seconds();
        self.restarted_s.retain(|at_s| now_s - at_s < window_s);
        if self.restarted_s.len() >= max {
            return Err(GraphError::KeptDying { process, words, restarts: self.restarted_s.len(), window_s });
        }
        let wait_s = back_off_s(self.never_up);
        tracing::warn!("process `{process}` {words}; it starts again in {wait_s:.1} s");
        self.restarted_s.push_back(now_s);
        self.restarts += 1;
        self.start_at_s = now_s + wait_s;
        Ok(())
    }

    pub(super) fn ask_to_end(&self) {
        self.signal(Signal::TERM);
    }

    /// Forgets the child where it ended.
    pub(super) fn note_end(&mut self) {
        let ended = self.running.as_mut().is_some_and(|r| !matches!(r.process.try_wait(), Ok(None)));
        if ended {
            self.running = None;
        }
    }

    /// Ends the child for good and waits for it.
    pub(super) fn kill(&mut self) {
        self.signal(Signal::KILL);
        if let Some(mut running) = self.running.take() {
            tracing::warn!("process `{}` did not end when asked and was killed", self.name);
            let _ = running.process.wait();
        }
    }

    fn signal(&self, signal: Signal) {
        if let Some(running) = &self.running {
            // It may have ended meanwhile; then nobody gets the signal, as the handle means this process alone.
            let _ = pidfd_send_signal(&running.handle, signal);
        }
    }
}

/// Nothing for a process that was up; doubling for one that never was.
fn back_off_s(never_up: u32) -> f64 {
    match never_up {
        0 => 0.0,
        n => (BACK_OFF_S * f64::from(1_u32 << (n - 1).min(16))).min(BACK_OFF_MAX_S),
    }
}

fn words(status: ExitStatus, lived_s: f64) -> String {
    let how = match (status.code(), status.signal()) {
        (Some(0), _) => "ended by itself".into(),
        (Some(101), _) => "panicked (exit code 101)".into(),
        (Some(code), _) => format!("ended with exit code {code}"),
        (None, Some(7)) => "was killed by signal 7 (SIGBUS: shared memory is full?)".into(),
        (None, signal) => format!("was killed by signal {}", signal.unwrap_or(0)),
    };
    format!("{how} after {lived_s:.1} s")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn death(code: Option<i32>) -> Death {
        Death { words: "ended".into(), code }
    }

    #[test]
    fn the_breaker_opens_after_so_many_restarts_within_the_window() {
        let mut child = Child::new("mapper");
        for _ in 0..5 {
            child.plan_restart(&death(None), 5, 60.0).unwrap();
        }
        assert_eq!(child.restarts(), 5);
        let error = child.plan_restart(&death(None), 5, 60.0).unwrap_err();
        assert_eq!(error.exit_code(), 5);
        assert!(error.to_string().contains("`mapper` ended; it was started again 5 times within 60 s"), "{error}");
        // A window that has passed forgets.
        child.plan_restart(&death(None), 5, 0.0).unwrap();
    }

    #[test]
    fn a_faulty_configuration_is_not_tried_again() {
        let error = Child::new("gpos").plan_restart(&death(Some(3)), 5, 60.0).unwrap_err();
        assert_eq!(error.exit_code(), 3);
    }

    #[test]
    fn who_never_was_up_waits_longer_each_time() {
        let waits: Vec<f64> = (0..8).map(back_off_s).collect();
        assert_eq!(waits, [0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0]);
        assert_eq!(back_off_s(u32::MAX), 2.0);
    }

    #[test]
    fn endings_are_told_in_words() {
        assert_eq!(words(ExitStatus::from_raw(9), 3.21), "was killed by signal 9 after 3.2 s");
        assert_eq!(words(ExitStatus::from_raw(101 << 8), 0.0), "panicked (exit code 101) after 0.0 s");
    }
}
