//! What ties a child to its launcher: the parent-death signal, the name seen in `ps`, and a watchdog.
//!
//! A child never outlives its launcher: the kernel sends it SIGTERM when the launcher dies, however it dies, and a
//! child that does not end within [`STOP_TIMEOUT_S`] of any stop signal kills itself.

use crate::domain::{Domain, Facts};
use crate::error::PortError;
use crate::signals;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Signal, getpid, getppid, kill_process, set_parent_process_death_signal};
use std::time::Duration;

/// How long a process may take to end once asked, seconds: a store flushes, a head halts.
pub const STOP_TIMEOUT_S: f64 = 3.0;

/// Ties this process to the launcher; fails where the launcher is not its parent, or died meanwhile.
pub(crate) fn bind(process: &str, domain: &Domain, facts: &Facts) -> Result<(), PortError> {
    set_parent_process_death_signal(Some(Signal::TERM))
        .map_err(|e| PortError::system("asking for a signal at the launcher's death", e))?;
    // A launcher that died before the line above sends no signal; then this process already has another parent.
    let parent = getppid().map_or(0, |p| p.as_raw_nonzero().get().unsigned_abs());
    if parent == facts.launcher {
        return Ok(());
    }
    Err(PortError::NotOurParent {
        process: process.into(),
        name: domain.name().into(),
        launcher: facts.launcher,
        parent,
    })
}

/// Gives this process a name in `ps` and `top`: `tsense:mapper`, cut to the kernel's 15 characters.
pub(crate) fn set_title(process: &str) {
    let title: String = format!("tsense:{process}").chars().take(15).collect();
    if let Ok(title) = std::ffi::CString::new(title) {
        let _ = rustix::thread::set_name(&title);
    }
}

/// Starts the watchdog: a thread that sleeps until a stop signal, and kills the process if it then hangs.
pub(crate) fn watch() -> Result<(), PortError> {
    let body = || {
        let Some(descriptor) = signals::descriptor() else { return };
        while signals::requested().is_none() {
            let _ = poll(&mut [PollFd::new(&descriptor, PollFlags::IN)], None);
        }
        crate::service::sleep(Duration::from_secs_f64(STOP_TIMEOUT_S));
        tracing::error!("asked to stop {STOP_TIMEOUT_S} s ago and still here: ending the hard way");
        let _ = kill_process(getpid(), Signal::KILL);
    };
    let thread = std::thread::Builder::new().name("watchdog".into()).spawn(body);
    thread.map(drop).map_err(|e| PortError::system("starting the watchdog", e))
}
