//! The line: a pseudo terminal whose bytes travel as slowly as on RS-232, and the thread that serves it.
//!
//! A byte takes ten bits. What a client writes at once arrives byte by byte; answers leave likewise, after the echo.

use super::unit::{Reply, Unit};
use super::{Head, PanTiltOptions};
use crate::faults::every;
use crate::net::{lock, readable};
use crate::world::Shared;
use rustix::fd::{AsFd, OwnedFd};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use tsense_geometry::Timestamp;

/// Bytes on the way at most, each way: a pty holds 4096 itself; more is a client gone mad, and is lost.
const BYTES_MAX: usize = 8192;
/// How often the thread looks whether it shall end, seconds of the wall clock.
const LOOK_S: f64 = 0.02;

/// Bytes travelling one way.
#[derive(Debug, Default)]
struct Lane {
    bytes: VecDeque<(Timestamp, u8)>,
    free_at: Timestamp,
}

impl Lane {
    /// Puts bytes on the lane, not before an instant.
    fn send(&mut self, bytes: &[u8], at: Timestamp, byte_s: f64) {
        for byte in bytes.iter().take(BYTES_MAX.saturating_sub(self.bytes.len())) {
            self.free_at = self.free_at.max(at).plus_seconds(byte_s);
            self.bytes.push_back((self.free_at, *byte));
        }
    }

    /// The next byte that has arrived.
    fn arrived(&mut self, now: Timestamp) -> Option<(Timestamp, u8)> {
        let due = self.bytes.front().is_some_and(|(at, _)| *at <= now);
        if due { self.bytes.pop_front() } else { None }
    }

    fn next_at(&self) -> Option<Timestamp> {
        self.bytes.front().map(|(at, _)| *at)
    }
}

struct Line {
    shared: Arc<Shared>,
    options: PanTiltOptions,
    unit: Unit,
    master: OwnedFd,
    /// Kept open so that the terminal lives while no client does.
    _slave: OwnedFd,
    link: Option<PathBuf>,
    byte_s: f64,
    incoming: Lane,
    outgoing: Lane,
    /// The controller takes no command before, while it waits for a motion to end.
    busy_until: Timestamp,
    answers: u64,
}

/// Starts the unit; its thread ends when the world stops. Says where a client finds the terminal.
pub(crate) fn start(shared: Arc<Shared>, options: PanTiltOptions) -> io::Result<(PathBuf, JoinHandle<()>)> {
    let (master, slave, terminal) = open_pty()?;
    let link = (!options.link.is_empty()).then(|| PathBuf::from(&options.link));
    if let Some(link) = &link {
        point(link, &terminal)?;
    }
    let found_at = link.clone().unwrap_or(terminal);
    let line = Line {
        unit: Unit::new(&options),
        byte_s: 10.0 / f64::from(options.baud.max(1)),
        shared,
        options,
        master,
        _slave: slave,
        link,
        incoming: Lane::default(),
        outgoing: Lane::default(),
        busy_until: Timestamp::default(),
        answers: 0,
    };
    let thread = std::thread::Builder::new().name("sim-pan-tilt".into()).spawn(move || line.run())?;
    Ok((found_at, thread))
}

fn open_pty() -> io::Result<(OwnedFd, OwnedFd, PathBuf)> {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&master)?;
    unlockpt(&master)?;
    let name = ptsname(&master, Vec::new())?;
    let slave = rustix::fs::open(&name, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?;
    let mut settings = tcgetattr(&slave)?;
    settings.make_raw();
    tcsetattr(&slave, OptionalActions::Now, &settings)?;
    rustix::fs::fcntl_setfl(&master, OFlags::RDWR | OFlags::NONBLOCK)?;
    Ok((master, slave, PathBuf::from(name.to_string_lossy().into_owned())))
}

/// Makes the link; replaces an old link, never a file.
fn point(link: &Path, terminal: &Path) -> io::Result<()> {
    if link.symlink_metadata().is_ok_and(|m| m.file_type().is_symlink()) {
        std::fs::remove_file(link)?;
    }
    std::os::unix::fs::symlink(terminal, link)
}

impl Line {
    fn run(mut self) {
        while !self.shared.stop.load(Ordering::Relaxed) {
            let now = self.shared.clock.now();
            self.think(now);
            self.transmit(now);
            let next = [self.incoming.next_at().map(|at| at.max(self.busy_until)), self.outgoing.next_at()];
            let wait_s =
                next.into_iter().flatten().map(|at| self.shared.clock.real_seconds_until(at)).fold(LOOK_S, f64::min);
            if readable(self.master.as_fd(), wait_s) {
                self.receive();
            }
        }
        if let Some(link) = &self.link {
            // Somebody may have replaced it: then it is not ours to remove, and a failure says nothing.
            let _ = std::fs::remove_file(link);
        }
    }

    fn receive(&mut self) {
        let mut buffer = [0u8; 512];
        let now = self.shared.clock.now();
        match rustix::io::read(&self.master, &mut buffer) {
            Ok(count) => self.incoming.send(&buffer[..count], now, self.byte_s),
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => {}
            Err(_) => crate::clock::WorldClock::sleep_real(LOOK_S),
        }
    }

    fn think(&mut self, now: Timestamp) {
        while now >= self.busy_until {
            let Some((at, byte)) = self.incoming.arrived(now) else { break };
            // A byte that came while the controller waited is read when the wait is over.
            let read_at = at.max(self.busy_until);
            let replies = self.with_head(|unit, head| unit.input(head, byte, read_at));
            replies.into_iter().for_each(|reply| self.reply(reply));
        }
        let events = self.with_head(|unit, head| unit.events(head, now));
        events.into_iter().for_each(|reply| self.reply(reply));
    }

    fn with_head<T>(&mut self, act: impl FnOnce(&mut Unit, &mut Head) -> T) -> T {
        act(&mut self.unit, &mut lock(&self.shared.head))
    }

    fn reply(&mut self, reply: Reply) {
        if reply.is_answer {
            self.answers += 1;
            self.busy_until = reply.at;
            if every(self.options.faults.drop_every, self.answers) || self.shared.stalled(&self.options.faults) {
                return;
            }
        }
        self.outgoing.send(reply.text.as_bytes(), reply.at, self.byte_s);
    }

    fn transmit(&mut self, now: Timestamp) {
        let mut due = Vec::new();
        while let Some((_, byte)) = self.outgoing.arrived(now) {
            due.push(byte);
        }
        if !due.is_empty() {
            // A full terminal means that nobody reads: the bytes are lost, as on a wire.
            let _ = rustix::io::write(&self.master, &due);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_arrive_one_after_the_other_at_line_speed() {
        let mut lane = Lane::default();
        let start = Timestamp::from_seconds(100.0);
        lane.send(b"TP ", start, 10.0 / 9600.0);
        lane.send(b"PP ", start, 10.0 / 9600.0);
        assert_eq!(lane.arrived(start.plus_seconds(0.001)), None);
        assert_eq!(lane.arrived(start.plus_seconds(0.0011)).unwrap().1, b'T');
        let late = start.plus_seconds(1.0);
        let rest: Vec<(Timestamp, u8)> = std::iter::from_fn(|| lane.arrived(late)).collect();
        assert_eq!(rest.iter().map(|(_, b)| *b).collect::<Vec<_>>(), b"P PP ");
        let last_s = rest.last().unwrap().0.seconds_since(start);
        assert!((last_s - 6.0 * 10.0 / 9600.0).abs() < 1e-6, "{last_s}");
    }
}
