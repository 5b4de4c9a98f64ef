//! What is at an address: for a person at the command line, without a graph.
//!
//! In: an address. Out: what the unit says it is, or why there is none. The head does not move.

use crate::pan_tilt::config::Config;
use crate::pan_tilt::process::Conversation;
use crate::pan_tilt::session::{Event, Purpose};
use crate::pan_tilt::unit::Unit;
use crate::shell::line::{Line, LineError, TCP, rates};
use serde::Serialize;
use tsense_ports::Clock;

/// What [`probe`] found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The address asked.
    pub address: String,
    /// Rate of the line at which the unit answered, bits per second.
    pub baud: u32,
    /// What the unit says it is.
    pub unit: Unit,
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "pan-tilt unit at {}, {}\n{}", self.address, rates(&[self.baud]), self.unit)
    }
}

/// Why [`probe`] found nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProbeError {
    /// The line itself.
    #[error(transparent)]
    Line(#[from] LineError),
    /// A line, but no unit on it.
    #[error("no pan-tilt unit answers at {address} ({tried}): {seen}; is it powered, and is it the right port?")]
    Silent {
        /// The address.
        address: String,
        /// The line rates tried.
        tried: String,
        /// What happened last.
        seen: String,
    },
}

/// Line rates of these units, the likeliest first.
const BAUDS: [u32; 5] = [9600, 115_200, 57_600, 38_400, 19_200];
/// How long a unit may take to say what it is, seconds: 15 questions at 9600 baud take under one.
const PROBE_S: f64 = 4.0;

/// Between two looks whether the line is open, seconds.
const OPENING_WAIT_S: f64 = 0.005;

/// Asks what is at an address. Moves nothing. Without `baud` the usual line rates are tried.
pub fn probe(address: &str, baud: Option<u32>) -> Result<Report, ProbeError> {
    let bauds = match baud {
        Some(baud) => vec![baud],
        // A network unit has no rate of its own.
        None if address.starts_with(TCP) => vec![0],
        None => BAUDS.to_vec(),
    };
    // What cannot be opened at one rate cannot be at another.
    drop(Line::open(address, bauds[0])?);
    let mut seen = String::new();
    for &baud in &bauds {
        match look(address, baud) {
            Ok(unit) => return Ok(Report { address: address.into(), baud, unit }),
            Err(notice) => seen = notice,
        }
    }
    Err(ProbeError::Silent { address: address.into(), tried: rates(&bauds), seen })
}

fn look(address: &str, baud: u32) -> Result<Unit, String> {
    let config = Config { address: address.into(), baud, ..Config::default() };
    let clock = Clock::start(1.0);
    let mut talk = Conversation::new(&config, Purpose::Look, clock);
    let end = clock.now().plus_seconds(PROBE_S);
    let mut seen = "no answer".to_string();
    while clock.now() < end {
        for event in talk.turn() {
            match event {
                Event::Surveyed(unit) => return Ok(*unit),
                // The session would wait and try again; for a look the first failure is the answer.
                Event::Notice(notice) if talk.line.is_none() => return Err(notice),
                Event::Notice(notice) => seen = notice,
                _ => {}
            }
        }
        if talk.line.is_none() {
            clock.sleep(OPENING_WAIT_S);
        }
    }
    Err(seen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pan_tilt::fake_unit::bench;
    use serialport::{SerialPort, TTYPort};

    #[test]
    fn a_probe_says_what_is_there_and_moves_nothing() {
        let unit = bench(|path| {
            let report = probe(path, Some(9600)).unwrap();
            assert!(report.unit.combined_query);
            assert!(report.to_string().contains("version: Pan-Tilt Controller v1.90.0d"), "{report}");
        });
        assert_eq!(unit.position, [0.0, 100.0]);
        assert!(!unit.log.contains(&"H".into()));
    }

    #[test]
    fn a_probe_of_a_silent_terminal_says_so() {
        let (_master, slave) = TTYPort::pair().unwrap();
        let error = probe(&slave.name().unwrap(), Some(9600)).unwrap_err().to_string();
        assert!(error.starts_with("no pan-tilt unit answers at "), "{error}");
        assert!(matches!(probe("/dev/no-such-port", None), Err(ProbeError::Line(_))));
    }
}
