//! A line of bytes to a device: a serial port, or a TCP connection (a serial server, a unit with its own network).
//!
//! In: an address, `/dev/...` or `tcp:HOST:PORT`. Out: bytes as they come, errors in words. It knows no protocol.
#![allow(clippy::disallowed_methods, reason = "shell: opens ports and sockets")]

use serialport::{SerialPort, TTYPort};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;

/// What marks an address as a network one.
pub(crate) const TCP: &str = "tcp:";
/// How long a connection may take to come about.
const CONNECT: Duration = Duration::from_secs(2);
/// How long the system may take to accept bytes: requests are short, so longer means that nobody takes them.
const WRITE: Duration = Duration::from_millis(500);
/// Shortest wait a socket can be told; zero would mean for ever.
const WAIT_MIN: Duration = Duration::from_millis(1);

/// Why a line is of no use, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// It could not be opened.
    #[error("cannot open {address}: {seen}; check the cable, the address and who else uses it")]
    Open {
        /// The address.
        address: String,
        /// What the system said.
        seen: String,
    },
    /// It was open and is no more.
    #[error("lost {address}: {seen}")]
    Lost {
        /// The address.
        address: String,
        /// What the system said.
        seen: String,
    },
}

enum Wire {
    Serial(TTYPort),
    Tcp(TcpStream),
}

/// An open line.
pub(crate) struct Line {
    address: String,
    wire: Wire,
}

impl Line {
    /// Opens a line. `baud` matters on serial ports only.
    pub(crate) fn open(address: &str, baud: u32) -> Result<Self, LineError> {
        let wire = match address.strip_prefix(TCP) {
            Some(host) => connect(host).map(Wire::Tcp),
            None => serial(address, baud).map(Wire::Serial),
        };
        let address = address.to_string();
        match wire {
            Ok(wire) => Ok(Self { address, wire }),
            Err(seen) => Err(LineError::Open { address, seen }),
        }
    }

    /// Reads what is there, waiting for the first byte up to `wait`. Nothing is zero bytes.
    pub(crate) fn read(&mut self, buffer: &mut [u8], wait: Duration) -> Result<usize, LineError> {
        let read = match &mut self.wire {
            Wire::Serial(port) => port.set_timeout(wait).map_err(Into::into).and_then(|()| port.read(buffer)),
            Wire::Tcp(socket) => socket.set_read_timeout(Some(wait.max(WAIT_MIN))).and_then(|()| socket.read(buffer)),
        };
        match read {
            Ok(0) => Err(self.lost("the other end closed it")),
            Ok(count) => Ok(count),
            Err(e) if matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(0),
            Err(e) => Err(self.lost(&e.to_string())),
        }
    }

    /// Hands all bytes to the system.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        let written = match &mut self.wire {
            Wire::Serial(port) => port.set_timeout(WRITE).map_err(Into::into).and_then(|()| port.write_all(bytes)),
            Wire::Tcp(socket) => socket.write_all(bytes),
        };
        written.map_err(|e| self.lost(&e.to_string()))
    }

    fn lost(&self, seen: &str) -> LineError {
        LineError::Lost { address: self.address.clone(), seen: seen.into() }
    }
}

/// A line that is being opened on a thread of its own: a name that nobody resolves and a host that does not answer take
/// seconds, and the process's heartbeat must go on meanwhile.
pub(crate) struct Opening {
    address: String,
    result: Receiver<Result<Line, LineError>>,
}

impl Opening {
    /// Begins to open a line.
    pub(crate) fn begin(address: &str, baud: u32) -> Self {
        let (sender, result) = channel();
        let theirs = address.to_string();
        // The receiver may be gone by then: nobody wants the line any more.
        std::thread::spawn(move || sender.send(Line::open(&theirs, baud)));
        Self { address: address.into(), result }
    }

    /// The line, or why there is none; nothing while it is not decided.
    pub(crate) fn poll(&self) -> Option<Result<Line, LineError>> {
        match self.result.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(LineError::Open { address: self.address.clone(), seen: "the attempt broke off".into() }))
            }
        }
    }
}

fn serial(path: &str, baud: u32) -> Result<TTYPort, String> {
    let mut port = serialport::new(path, baud).timeout(WRITE).open_native().map_err(|e| e.to_string())?;
    // The kernel's exclusive mark outlives a killed process as long as anybody else holds the terminal, and would keep
    // the restarted driver out. The lock on the file does not; it still keeps a second driver from opening.
    port.set_exclusive(false).map_err(|e| e.to_string())?;
    Ok(port)
}

fn connect(host: &str) -> Result<TcpStream, String> {
    let addresses = host.to_socket_addrs().map_err(|e| format!("{e}; expected tcp:HOST:PORT"))?;
    let mut seen = "the name has no address".to_string();
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(socket) => {
                let set = socket.set_nodelay(true).and_then(|()| socket.set_write_timeout(Some(WRITE)));
                return set.map(|()| socket).map_err(|e| e.to_string());
            }
            Err(e) => seen = e.to_string(),
        }
    }
    Err(seen)
}

/// Rates of a line in words; 0 is a socket's.
pub(crate) fn rates(bauds: &[u32]) -> String {
    match bauds {
        [0] => "a socket".into(),
        _ => format!("{} bits/s", bauds.iter().map(u32::to_string).collect::<Vec<_>>().join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[test]
    fn a_socket_has_no_rate() {
        assert_eq!([rates(&[0]), rates(&[9600, 4800])], ["a socket", "9600, 4800 bits/s"]);
    }

    #[test]
    fn a_second_driver_is_kept_out_and_a_restarted_one_is_let_in() {
        let (_master, slave) = TTYPort::pair().unwrap();
        let path = slave.name().unwrap();
        let first = Line::open(&path, 9600).unwrap();
        let second = Line::open(&path, 9600);
        assert!(matches!(second, Err(LineError::Open { .. })), "two drivers on one line");
        drop(first);
        assert!(Line::open(&path, 9600).is_ok());
    }

    #[test]
    fn a_line_says_when_its_other_end_is_gone() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp:{}", listener.local_addr().unwrap());
        let mut line = Line::open(&address, 0).unwrap();
        let (mut other, _) = listener.accept().unwrap();
        let mut buffer = [0; 8];
        assert_eq!(line.read(&mut buffer, Duration::from_millis(5)), Ok(0));
        other.write_all(b"abc").unwrap();
        assert_eq!(line.read(&mut buffer, Duration::from_secs(5)), Ok(3));
        drop(other);
        let error = line.read(&mut buffer, Duration::from_secs(5)).unwrap_err();
        assert_eq!(error.to_string(), format!("lost {address}: the other end closed it"));
    }

    #[test]
    fn what_cannot_be_opened_is_named() {
        let error = Line::open("/dev/no-such-port", 9600).map(|_| ()).unwrap_err().to_string();
        assert!(error.starts_with("cannot open /dev/no-such-port: "), "{error}");
        assert!(Line::open("tcp:no-port-given", 0).is_err());
    }
}
