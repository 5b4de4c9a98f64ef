//! The TCP connection of a session: does what the session asks, feeds it bytes and time.
//!
//! In: an address, a session, a clock. Out: scans as telegrams with their time of receipt, and state changes. Name look-up and
//! connecting happen on a thread of their own, so that the caller's loop never waits longer than [`PATIENCE`].
#![allow(clippy::disallowed_methods, reason = "shell: opens the socket and waits on it")]

use crate::lms151::scan_data::ScanData;
use crate::lms151::session::{Action, Session, State};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::Duration;
use tsense_geometry::Timestamp;

/// Longest wait in one turn: one telegram period, so deadlines are late by that at most.
pub const PATIENCE: Duration = Duration::from_millis(20);
/// Wait for a connection to be accepted.
const CONNECT: Duration = Duration::from_secs(3);
/// Wait for room in the send buffer. Requests are some tens of bytes: a full buffer means the peer is gone.
const WRITE: Duration = Duration::from_secs(1);
/// Addresses tried of one name.
const ADDRESSES_MAX: usize = 4;
/// Bytes a read takes at most: a second of scans in CoLa-B.
const READ_BYTES: usize = 64 * 1024;

/// What a turn brought.
#[derive(Debug)]
pub enum Happened {
    /// A scan and when its last byte was received.
    Scan(Box<ScanData>, Timestamp),
    /// The session's state or reason changed.
    Entered(State, String),
}

/// A session and its connection.
pub struct Link {
    /// The conversation.
    pub session: Session,
    address: String,
    stream: Option<TcpStream>,
    opening: Option<Receiver<io::Result<TcpStream>>>,
    buffer: Vec<u8>,
}

impl Link {
    /// A link that opens its connection in the first turns.
    pub fn new(address: &str, session: Session) -> Self {
        Self { session, address: address.into(), stream: None, opening: None, buffer: vec![0; READ_BYTES] }
    }

    /// Does what is due, then waits for bytes, for the connection or for [`PATIENCE`], whichever comes first.
    pub fn turn(&mut self, now: &dyn Fn() -> Timestamp) -> Vec<Happened> {
        let mut happened = Vec::new();
        self.session.on_time(now());
        self.act(now, &mut happened);
        if self.stream.is_some() {
            self.read(now);
        } else if self.opening.is_some() {
            self.await_opening(now);
        } else {
            std::thread::sleep(PATIENCE);
        }
        self.act(now, &mut happened);
        happened
    }

    /// Cancels the stream and closes the connection; takes half a second at most.
    pub fn shut_down(&mut self, now: &dyn Fn() -> Timestamp) {
        self.session.shut_down(now());
        while self.session.state().0 != State::Closed {
            self.turn(now);
        }
        self.act(now, &mut Vec::new());
    }

    fn act(&mut self, now: &dyn Fn() -> Timestamp, happened: &mut Vec<Happened>) {
        while let Some(action) = self.session.poll() {
            match action {
                Action::Connect => self.opening = Some(open(&self.address)),
                Action::Send(bytes) => self.send(&bytes, now),
                Action::Disconnect => self.stream = None,
                Action::Scan(data, received) => happened.push(Happened::Scan(data, received)),
                Action::Entered(state, reason) => happened.push(Happened::Entered(state, reason)),
            }
        }
    }

    fn send(&mut self, bytes: &[u8], now: &dyn Fn() -> Timestamp) {
        let Some(stream) = &mut self.stream else { return };
        if let Err(e) = stream.write_all(bytes) {
            self.stream = None;
            self.session.connection_lost(now(), &e.to_string());
        }
    }

    fn read(&mut self, now: &dyn Fn() -> Timestamp) {
        let Some(stream) = &mut self.stream else { return };
        let read = stream.read(&mut self.buffer);
        // Nothing between the read and the clock: this is the scan's time of receipt.
        let received = now();
        match read {
            Ok(0) => self.lose(received, "the device closed it"),
            Ok(count) => self.session.received(received, &self.buffer[..count]),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(e) => self.lose(received, &e.to_string()),
        }
    }

    fn lose(&mut self, now: Timestamp, why: &str) {
        self.stream = None;
        self.session.connection_lost(now, why);
    }

    fn await_opening(&mut self, now: &dyn Fn() -> Timestamp) {
        let Some(opening) = &self.opening else { return };
        let opened = match opening.recv_timeout(PATIENCE) {
            Err(RecvTimeoutError::Timeout) => return,
            Err(RecvTimeoutError::Disconnected) => Err(io::Error::other("the connecting thread ended")),
            Ok(opened) => opened,
        };
        self.opening = None;
        match opened {
            Ok(stream) => {
                self.stream = Some(stream);
                self.session.connected(now());
            }
            Err(e) => self.session.connection_lost(now(), &format!("{}: {e}", self.address)),
        }
    }
}

/// Opens a connection on a thread that ends by itself after some seconds, wanted or not.
fn open(address: &str) -> Receiver<io::Result<TcpStream>> {
    let (sender, receiver) = mpsc::channel();
    let address = address.to_string();
    let spawned = std::thread::Builder::new().name("connect".into()).spawn(move || {
        // The receiver may be gone: then nobody wants this connection any more.
        let _ = sender.send(connect(&address));
    });
    drop(spawned);
    receiver
}

/// Connects to the first address of `HOST:PORT` that accepts.
pub(super) fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
    for address in address.to_socket_addrs()?.take(ADDRESSES_MAX) {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(PATIENCE))?;
                stream.set_write_timeout(Some(WRITE))?;
                return Ok(stream);
            }
            Err(e) => last = e,
        }
    }
    Err(last)
}
