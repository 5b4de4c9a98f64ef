//! What the command line asks of one LMS-151: "show me scans", "what is there?". No process graph is needed.
//!
//! In: an address. Out: records that serialise to JSON, or an error in words. Neither call changes how the device measures;
//! [`scan`] starts the measurement where it is stopped.
#![allow(clippy::disallowed_methods, reason = "shell: opens the socket")]

use super::link::{Happened, Link, connect};
use crate::lms151::assemble::{Assembler, millimetres};
use crate::lms151::commands::{Reply, Request, Variable, status_name};
use crate::lms151::config::{Config, DialectChoice};
use crate::lms151::fault_code::FaultCode;
use crate::lms151::scan_data::ScanData;
use crate::lms151::session::{Session, Settings, State};
use crate::lms151::telegram::{Dialect, Packet, StreamFramer, Verb};
use serde::Serialize;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use tsense_ports::Clock;

/// Wait for one answer while probing, seconds.
const ANSWER_S: f64 = 1.0;
/// Without a scan for this long, an interrupted stream is given up, seconds.
const INTERRUPTED_S: f64 = 10.0;

/// Why a device gave nothing.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// No connection.
    #[error("no device answers at {address}: {why}; check the address (HOST:PORT), the cable and the power")]
    Unreachable {
        /// The address.
        address: String,
        /// What the system said.
        why: String,
    },
    /// A connection, but no answer that makes sense.
    #[error("{address} accepts connections but does not work as an LMS-151: {why}")]
    Silent {
        /// The address.
        address: String,
        /// What was tried.
        why: String,
    },
}

/// One scan for people and tools.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScanRecord {
    /// The device's telegram counter.
    pub telegram_counter: u16,
    /// The device's mirror-turn counter.
    pub scan_counter: u16,
    /// Instant of the first beam, nanoseconds since the epoch.
    pub stamp_ns: i64,
    /// Device angle of the first beam, degrees.
    pub start_deg: f64,
    /// Device angle from a beam to the next, degrees.
    pub step_deg: f64,
    /// Distance of each beam, scaled; values below 16 are codes and stand as they came.
    pub distances_mm: Vec<u32>,
    /// Echo strength of each beam, where sent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remission: Option<Vec<u16>>,
}

/// What a device says of itself. Absent: it did not say.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Probe {
    /// The address asked.
    pub address: String,
    /// Its dialect.
    pub dialect: String,
    /// Type and version.
    pub identity: Option<String>,
    /// Firmware.
    pub firmware: Option<String>,
    /// Name its user gave it.
    pub location: Option<String>,
    /// What it does.
    pub state: Option<String>,
    /// 0 busy, 1 ready, 2 error.
    pub device_state: Option<u32>,
    /// 0 none, 1 warning, 2 error, 3 fatal.
    pub contamination: Option<u32>,
    /// Nominal turns a second.
    pub frequency_hz: Option<f64>,
    /// Angle between beams.
    pub resolution_deg: Option<f64>,
    /// Operating time.
    pub operating_hours: Option<f64>,
    /// Times switched on.
    pub power_ons: Option<u32>,
    /// A scan stream was running towards this connection.
    pub streaming: bool,
}

impl std::fmt::Display for Probe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "not said".into());
        let number = |value: Option<f64>| value.map_or("not said".into(), |n| n.to_string());
        writeln!(
            f,
            "{} at {}, {}, firmware {}",
            text(&self.identity),
            self.address,
            self.dialect,
            text(&self.firmware)
        )?;
        writeln!(f, "location: {}", text(&self.location))?;
        writeln!(f, "state: {}", text(&self.state))?;
        writeln!(f, "turns: {} Hz, a beam every {} degrees", number(self.frequency_hz), number(self.resolution_deg))?;
        writeln!(
            f,
            "contamination: {} (0 none, 1 warning, 2 error, 3 fatal)",
            number(self.contamination.map(f64::from))
        )?;
        let power_ons = number(self.power_ons.map(f64::from));
        write!(f, "operating hours: {}, switched on {power_ons} times", number(self.operating_hours))
    }
}

/// Reads `count` scans, handing each out as it comes; `false` ends it early.
pub fn scan(
    address: &str,
    dialect: DialectChoice,
    count: u64,
    mut on_scan: impl FnMut(&ScanRecord) -> bool,
) -> Result<(), DeviceError> {
    let clock = Clock::start(1.0);
    let now = || clock.now();
    let mut link = Link::new(address, Session::new(Settings::as_it_is(address, dialect)));
    let mut assembler = Assembler::new(&Config::default());
    let (mut seen, mut newest) = (0, now());
    while seen < count {
        for happened in link.turn(&now) {
            let Happened::Scan(data, received) = happened else { continue };
            newest = received;
            let Ok(scan) = assembler.take(&data, received, link.session.contamination()) else { continue };
            if seen < count && !on_scan(&record(&data, scan.header.stamp_ns)) {
                seen = count;
            }
            seen += 1;
        }
        let interrupted = seen > 0 && now().seconds_since(newest) > INTERRUPTED_S;
        if (seen == 0 && link.session.is_waiting_to_reconnect()) || interrupted {
            return Err(failure(address, &link.session));
        }
    }
    link.shut_down(&now);
    Ok(())
}

fn failure(address: &str, session: &Session) -> DeviceError {
    let (state, why) = session.state();
    let why = why.split("; connecting again").next().unwrap_or(why);
    let why = why.trim_start_matches("cannot connect: ").trim_start_matches(&format!("{address}: ")).into();
    let address = address.into();
    if session.counts().connections == 0 && state != State::Refused {
        DeviceError::Unreachable { address, why }
    } else {
        DeviceError::Silent { address, why }
    }
}

fn record(data: &ScanData, stamp_ns: i64) -> ScanRecord {
    let distances = data.channel(b"DIST1");
    ScanRecord {
        telegram_counter: data.telegram_counter,
        scan_counter: data.scan_counter,
        stamp_ns,
        start_deg: distances.map_or(0.0, |c| f64::from(c.start_e4_deg) / 1e4),
        step_deg: distances.map_or(0.0, |c| f64::from(c.step_e4_deg) / 1e4),
        distances_mm: distances.map_or(vec![], |c| c.raw.iter().map(|raw| millimetres(c, *raw)).collect()),
        remission: data.channel(b"RSSI1").map(|c| c.raw.clone()),
    }
}

/// Asks a device what it is and how it is.
pub fn probe(address: &str, dialect: DialectChoice) -> Result<Probe, DeviceError> {
    let stream =
        connect(address).map_err(|e| DeviceError::Unreachable { address: address.into(), why: e.to_string() })?;
    let mut asker = Asker::new(stream, address, dialect);
    let silent = |why: &str| DeviceError::Silent { address: address.into(), why: why.into() };
    let firmware = asker.find_dialect(dialect).ok_or_else(|| silent("no answer in CoLa-A or CoLa-B"))?;
    let mut probe = Probe { address: address.into(), dialect: asker.speak.to_string(), ..Probe::default() };
    probe.firmware = text(firmware);
    probe.identity = text(asker.ask(Variable::DeviceIdent));
    probe.location = text(asker.ask(Variable::LocationName));
    probe.state = number(asker.ask(Variable::Status)).map(|n| status_name(n.min(255) as u8).into());
    probe.device_state = number(asker.ask(Variable::DeviceState));
    probe.contamination = number(asker.ask(Variable::Contamination));
    probe.operating_hours = number(asker.ask(Variable::OperatingHours)).map(|tenths| f64::from(tenths) / 10.0);
    probe.power_ons = number(asker.ask(Variable::PowerOns));
    if let Answer::Reply(Reply::ScanConfig { config, .. }) = asker.ask(Variable::ScanConfig) {
        probe.frequency_hz = Some(f64::from(config.frequency_centihz) / 100.0);
        probe.resolution_deg = Some(f64::from(config.step_e4_deg) / 1e4);
    }
    probe.streaming = asker.events > 0;
    Ok(probe)
}

/// What came of one question.
enum Answer {
    Reply(Reply),
    Fault,
    Nothing,
}

fn text(answer: Answer) -> Option<String> {
    let Answer::Reply(Reply::Texts(texts)) = answer else { return None };
    Some(texts.iter().map(|t| t.trim()).collect::<Vec<_>>().join(" "))
}

fn number(answer: Answer) -> Option<u32> {
    if let Answer::Reply(Reply::Number(number)) = answer { Some(number) } else { None }
}

/// One question after the other over an open connection.
struct Asker {
    stream: TcpStream,
    clock: Clock,
    framer: StreamFramer,
    speak: Dialect,
    events: u64,
}

impl Asker {
    fn new(stream: TcpStream, address: &str, dialect: DialectChoice) -> Self {
        let guess = Settings::as_it_is(address, dialect).dialect_guess;
        let speak = dialect.fixed().unwrap_or(guess);
        Self { stream, clock: Clock::start(1.0), framer: StreamFramer::new(dialect.fixed()), speak, events: 0 }
    }

    /// Asks for the firmware in one dialect and then the other; any answer will do.
    fn find_dialect(&mut self, choice: DialectChoice) -> Option<Answer> {
        for attempt in 0..3 {
            let answer = self.ask(Variable::FirmwareVersion);
            if !matches!(answer, Answer::Nothing) {
                return Some(answer);
            }
            self.speak = match (choice.fixed(), self.framer.dialect()) {
                (Some(fixed), _) => fixed,
                (None, Some(found)) => found,
                (None, None) if attempt < 2 => self.speak.other(),
                (None, None) => return None,
            };
        }
        None
    }

    fn ask(&mut self, variable: Variable) -> Answer {
        let request = Request::Read(variable);
        if self.stream.write_all(&self.speak.frame(&request.encode(self.speak))).is_err() {
            return Answer::Nothing;
        }
        let asked = self.clock.now();
        let mut buffer = [0; 4096];
        while self.clock.now().seconds_since(asked) < ANSWER_S {
            let count = match self.stream.read(&mut buffer) {
                Ok(0) => return Answer::Nothing,
                Ok(count) => count,
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => continue,
                Err(_) => return Answer::Nothing,
            };
            for payload in self.framer.feed(&buffer[..count]) {
                if let Some(answer) = self.look_at(&request, &payload) {
                    return answer;
                }
            }
        }
        Answer::Nothing
    }

    fn look_at(&mut self, request: &Request, payload: &[u8]) -> Option<Answer> {
        let packet = Packet::parse(self.framer.dialect()?, payload).ok()?;
        match packet.verb {
            Verb::Event => {
                self.events += 1;
                None
            }
            Verb::Fault => {
                let code = packet.fields().u16("error code").ok().map(FaultCode);
                tracing::debug!(request = request.name(), ?code, "error answer");
                Some(Answer::Fault)
            }
            _ if request.is_answered_by(&packet) => {
                Some(request.parse_reply(&packet).map_or(Answer::Fault, Answer::Reply))
            }
            _ => None,
        }
    }
}
