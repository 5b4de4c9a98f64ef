//! The graph's control socket: one word in, one JSON document out. Mode 0600, in the graph's private root.
//!
//! `status` is answered with the table, `stop` with the same table and a graph that ends. A client that dawdles is cut
//! off: the launcher has children to look after.
#![allow(clippy::disallowed_methods, reason = "shell: a socket")]

use super::{GraphError, Status};
use std::io::{Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::Duration;
use tsense_ports::{Domain, PortError};

/// Longest the launcher waits for a client's word, or for it to read; a client that was slower asks again.
const CLIENT_PATIENCE: Duration = Duration::from_millis(100);
/// Longest a client waits for the launcher, which may be cleaning up after deaths.
const LAUNCHER_PATIENCE: Duration = Duration::from_secs(3);
/// Times a client asks: on a busy machine it may have been cut off as a dawdler.
const TRIES: usize = 5;
/// Longest word.
const WORD_MAX: u64 = 16;

/// What a client asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// The table.
    Status,
    /// The end of the graph.
    Stop,
}

impl Asked {
    const ALL: [Self; 2] = [Self::Status, Self::Stop];

    fn word(self) -> &'static str {
        match self {
            Self::Status => "status\n",
            Self::Stop => "stop\n",
        }
    }
}

/// The launcher's end.
pub(super) struct Server {
    listener: UnixListener,
}

impl Server {
    pub(super) fn bind(path: &Path) -> Result<Self, GraphError> {
        let failed = |e| GraphError::system(format!("opening {}", path.display()), e);
        let listener = UnixListener::bind(path).map_err(failed)?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        Ok(Self { listener })
    }

    pub(super) fn descriptor(&self) -> BorrowedFd<'_> {
        self.listener.as_fd()
    }

    /// Answers everybody who waits; true where somebody asked for the end.
    pub(super) fn answer(&self, status: &Status) -> bool {
        let mut stop = false;
        while let Ok((stream, _)) = self.listener.accept() {
            stop |= converse(stream, status).is_ok_and(|asked| asked == Some(Asked::Stop));
        }
        stop
    }
}

fn converse(mut stream: UnixStream, status: &Status) -> std::io::Result<Option<Asked>> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(CLIENT_PATIENCE))?;
    stream.set_write_timeout(Some(CLIENT_PATIENCE))?;
    let mut word = String::new();
    let mut byte = [0];
    while !word.ends_with('\n') && (word.len() as u64) < WORD_MAX && stream.read(&mut byte)? == 1 {
        word.push(char::from(byte[0]));
    }
    let asked = Asked::ALL.into_iter().find(|asked| asked.word() == word);
    match asked {
        Some(_) => stream.write_all(&serde_json::to_vec(status)?)?,
        None => stream.write_all(b"{\"error\":\"say status or stop\"}")?,
    }
    Ok(asked)
}

/// Asks a running graph; its table.
pub fn ask(domain: &Domain, asked: Asked) -> Result<Status, PortError> {
    let path = domain.socket();
    let mut seen = String::new();
    for _ in 0..TRIES {
        match talk(&path, asked) {
            Ok(status) => return Ok(status),
            Err(e) => seen = format!("{}: {e}", path.display()),
        }
        // Nobody listens: the graph is not there, and asking again does not change that.
        if !path.exists() || seen.contains("refused") {
            break;
        }
    }
    Err(PortError::NoGraph { name: domain.name().into(), seen })
}

fn talk(path: &Path, asked: Asked) -> std::io::Result<Status> {
    let mut stream = UnixStream::connect(path)?;
    stream.set_read_timeout(Some(LAUNCHER_PATIENCE))?;
    stream.write_all(asked.word().as_bytes())?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(serde_json::from_slice(&answer)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_is_answered_in_kind_and_a_mute_one_holds_nobody_up() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        let status = Status { graph: "g".into(), processes: Vec::new() };
        theirs.write_all(b"stop\n").unwrap();
        assert_eq!(converse(ours, &status).unwrap(), Some(Asked::Stop));
        let mut answer = String::new();
        theirs.read_to_string(&mut answer).unwrap();
        assert_eq!(serde_json::from_str::<Status>(&answer).unwrap(), status);
        let (ours, _mute) = UnixStream::pair().unwrap();
        assert!(converse(ours, &status).is_err());
        let (ours, mut endless) = UnixStream::pair().unwrap();
        endless.write_all(&[b'x'; 100]).unwrap();
        assert_eq!(converse(ours, &status).unwrap(), None);
    }
}
