//! SIGTERM and SIGINT: a flag and a file descriptor that becomes readable, so that waiting ends at once.
//!
//! In: the two signals. Out: [`requested`]. It installs its handlers once a process; the middleware's own signal
//! handling is switched off everywhere.

use crate::error::PortError;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

struct Handlers {
    terminate: Arc<AtomicBool>,
    interrupt: Arc<AtomicUsize>,
    wake: UnixStream,
}

static HANDLERS: OnceLock<Handlers> = OnceLock::new();

/// Which signal asked this process to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopSignal {
    /// SIGINT: Ctrl-C.
    Interrupt,
    /// SIGTERM: a service manager, or the launcher.
    Terminate,
}

/// Installs the handlers; later calls do nothing.
pub fn install() -> Result<(), PortError> {
    if HANDLERS.get().is_none() {
        let handlers = create().map_err(|e| PortError::system("installing signal handlers", e))?;
        let _ = HANDLERS.set(handlers);
    }
    Ok(())
}

fn create() -> std::io::Result<Handlers> {
    let (wake, writer) = UnixStream::pair()?;
    wake.set_nonblocking(true)?;
    let handlers = Handlers { terminate: Arc::default(), interrupt: Arc::default(), wake };
    signal_hook::flag::register(SIGTERM, handlers.terminate.clone())?;
    signal_hook::flag::register_usize(SIGINT, handlers.interrupt.clone(), 1)?;
    signal_hook::low_level::pipe::register(SIGTERM, writer.try_clone()?)?;
    signal_hook::low_level::pipe::register(SIGINT, writer)?;
    Ok(handlers)
}

/// The signal that asked this process to end, if any came.
pub fn requested() -> Option<StopSignal> {
    let handlers = HANDLERS.get()?;
    if handlers.interrupt.load(Ordering::Relaxed) > 0 {
        return Some(StopSignal::Interrupt);
    }
    handlers.terminate.load(Ordering::Relaxed).then_some(StopSignal::Terminate)
}

/// A descriptor that is readable from the first signal on.
pub fn descriptor() -> Option<std::os::fd::BorrowedFd<'static>> {
    HANDLERS.get().map(|h| h.wake.as_fd())
}
