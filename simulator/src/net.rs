//! TCP for simulated devices: accept, a bounded queue of bytes a client, a thread that writes them.
//!
//! A client that does not read loses what does not fit its queue (counted), never anybody else's data.
#![allow(clippy::disallowed_methods, reason = "shell: a simulated device owns its sockets")]

use crate::clock::WorldClock;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Writes a client may lag behind: more than a second of scans or sentences.
const QUEUE: usize = 128;
/// How often blocked threads look whether they shall end, seconds.
const LOOK_S: f64 = 0.1;
/// Pause between the pieces of a fragmented telegram, so that they arrive apart, seconds of the wall clock.
const PIECE_PAUSE_S: f64 = 0.0002;

/// A lock whose data is plain values: a panic elsewhere has not broken them.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// True when the descriptor has something to read within a time of the wall clock.
pub(crate) fn readable(fd: impl std::os::fd::AsFd, timeout_s: f64) -> bool {
    let ns = (timeout_s.clamp(0.0, 10.0) * 1e9) as i64;
    let timeout = Timespec { tv_sec: ns / 1_000_000_000, tv_nsec: ns % 1_000_000_000 };
    let mut fds = [PollFd::new(&fd, PollFlags::IN)];
    poll(&mut fds, Some(&timeout)).is_ok_and(|n| n > 0)
}

/// Calls `on_client` for every connection until told to stop.
pub(crate) fn accept_loop(listener: &TcpListener, stop: &AtomicBool, mut on_client: impl FnMut(TcpStream)) {
    if listener.set_nonblocking(true).is_err() {
        return;
    }
    while !stop.load(Ordering::Relaxed) {
        if !readable(listener, LOOK_S) {
            continue;
        }
        while let Ok((stream, peer)) = listener.accept() {
            tracing::info!(%peer, "a client connected");
            on_client(stream);
        }
    }
}

/// The way out to one client.
#[derive(Debug)]
pub(crate) struct Outgoing {
    queue: SyncSender<Vec<Vec<u8>>>,
    socket: TcpStream,
    gone: Arc<AtomicBool>,
    /// Sends that did not fit.
    pub overflows: AtomicU64,
}

impl Outgoing {
    /// The way out to a client, with the thread that writes.
    pub fn start(socket: TcpStream, name: &str) -> std::io::Result<(Arc<Self>, JoinHandle<()>)> {
        socket.set_nonblocking(false)?;
        socket.set_nodelay(true)?;
        socket.set_read_timeout(Some(Duration::from_secs_f64(LOOK_S)))?;
        // A client that takes nothing for this long is gone.
        socket.set_write_timeout(Some(Duration::from_secs(3)))?;
        let (queue, inbox) = sync_channel(QUEUE);
        let gone = Arc::new(AtomicBool::new(false));
        let (writer, flag) = (socket.try_clone()?, gone.clone());
        let thread =
            std::thread::Builder::new().name(name.to_owned()).spawn(move || write_loop(writer, &inbox, &flag))?;
        Ok((Arc::new(Self { queue, socket, gone, overflows: AtomicU64::new(0) }), thread))
    }

    /// Queues the pieces of a send; drops them where the queue is full.
    pub fn send(&self, pieces: Vec<Vec<u8>>) {
        match self.queue.try_send(pieces) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => _ = self.overflows.fetch_add(1, Ordering::Relaxed),
            Err(TrySendError::Disconnected(_)) => self.close(),
        }
    }

    /// Reads what has come: no bytes where nothing came in time, nothing once the client is gone.
    pub fn read<'a>(&self, buffer: &'a mut [u8]) -> Option<&'a [u8]> {
        use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
        if self.is_gone() {
            return None;
        }
        match (&self.socket).read(buffer) {
            Ok(0) => None,
            Ok(n) => Some(&buffer[..n]),
            Err(e) if matches!(e.kind(), Interrupted | TimedOut | WouldBlock) => Some(&[]),
            Err(_) => None,
        }
    }

    /// True once the connection has ended.
    pub fn is_gone(&self) -> bool {
        self.gone.load(Ordering::Relaxed)
    }

    /// Ends the connection.
    pub fn close(&self) {
        self.gone.store(true, Ordering::Relaxed);
        // It may be closed already: that is what is wanted.
        let _ = self.socket.shutdown(Shutdown::Both);
        let _ = self.queue.try_send(Vec::new());
    }
}

fn write_loop(mut socket: TcpStream, inbox: &Receiver<Vec<Vec<u8>>>, gone: &AtomicBool) {
    while let Ok(pieces) = inbox.recv() {
        if gone.load(Ordering::Relaxed) {
            break;
        }
        let last = pieces.len().saturating_sub(1);
        for (i, piece) in pieces.iter().enumerate() {
            if socket.write_all(piece).is_err() {
                gone.store(true, Ordering::Relaxed);
                let _ = socket.shutdown(Shutdown::Both);
                return;
            }
            if i < last {
                WorldClock::sleep_real(PIECE_PAUSE_S);
            }
        }
    }
}
