//! The process of the position system: owns the line, publishes `pose`, keeps the UTM zone for the life of the graph.
//!
//! In: the configuration. Out: `pose`, health in words with drops by cause, and one small file with the pinned zone in
//! the graph's folder, so that a restart beyond a zone's border does not change the map. One thread: the read waits
//! 20 ms at most.
#![allow(clippy::disallowed_methods, reason = "shell: the loop around the line, and the zone's file")]

pub use super::shell::probe::{PoseReport, ProbeError, Report, probe};

use super::config::{Config, JAUS};
use super::receiver::{Event, Receiver};
use super::shell::jaus::JausListening;
use super::utm::Zone;
use crate::shell::line::{Line, Opening};
use std::path::{Path, PathBuf};
use tsense_contract::{Pose, Poses};
use tsense_geometry::Timestamp;
use tsense_ports::{Clock, Outbox, PortError, Process, Wake};

/// Longest wait on the line before the process loop is served, seconds.
const WAIT_MAX_S: f64 = 0.02;
/// Wait while there is no line, seconds.
const NO_LINE_WAIT_S: f64 = 0.05;
/// First wait before the line is opened again, seconds; doubles up to [`BACK_OFF_MAX_S`].
const BACK_OFF_MIN_S: f64 = 0.5;
/// Longest wait before the line is opened again, seconds.
const BACK_OFF_MAX_S: f64 = 8.0;
/// A line that is silent this long is opened anew, seconds: a connection may be dead without saying so.
const SILENT_S: f64 = 5.0;
/// What is read at once: a second of a busy line.
const READ_BYTES: usize = 16_384;
/// Name of the zone's file in the graph's folder.
const ZONE_FILE: &str = "utm-zone";

/// Runs until the graph asks it to stop.
pub fn run(mut process: Process, config: &Config) -> Result<(), PortError> {
    let mut outbox = process.outbox::<Poses>(None)?;
    let clock = process.clock();
    let zone_file = ZoneFile::new(process.state_dir());
    let mut source = Source::new(config, clock);
    if let Some(zone) = zone_file.read() {
        source.receiver().remember(zone);
    }
    while process.wait(0.0) != Wake::Stop {
        for event in source.turn() {
            publish(&mut process, &mut outbox, &zone_file, event)?;
        }
        let (state, reason) = source.receiver().condition(clock.now());
        process.health().set(state, &reason);
        if matches!(&source, Source::Line(listening) if listening.line.is_none()) {
            process.wait(NO_LINE_WAIT_S);
        }
    }
    Ok(())
}

/// Where poses come from.
enum Source {
    /// Bytes of a line.
    Line(Box<Listening>),
    /// Reports of a GlobalPoseSensor.
    Jaus(Box<JausListening>),
}

impl Source {
    fn new(config: &Config, clock: Clock) -> Self {
        match config.address.as_str() {
            JAUS => Self::Jaus(Box::new(JausListening::new(config, clock))),
            _ => Self::Line(Box::new(Listening::new(config, clock))),
        }
    }

    fn turn(&mut self) -> Vec<Event> {
        match self {
            Self::Line(listening) => listening.turn(),
            Self::Jaus(listening) => listening.turn(),
        }
    }

    fn receiver(&mut self) -> &mut Receiver {
        match self {
            Self::Line(listening) => &mut listening.receiver,
            Self::Jaus(listening) => &mut listening.receiver,
        }
    }
}

fn publish(
    process: &mut Process,
    outbox: &mut Outbox<Poses>,
    zone_file: &ZoneFile,
    event: Event,
) -> Result<(), PortError> {
    match event {
        Event::Pose(pose) => send(process, outbox, &pose)?,
        Event::Pinned(zone) => {
            tracing::info!(%zone, "UTM zone pinned");
            if let Err(error) = zone_file.write(zone) {
                tracing::warn!(%error, "the UTM zone is not kept: a restart beyond the border would change it");
            }
        }
        Event::Dropped(cause, count) => process.health().dropped(cause, count),
        Event::Notice(text) => tracing::warn!("{text}"),
    }
    Ok(())
}

fn send(process: &mut Process, outbox: &mut Outbox<Poses>, pose: &Pose) -> Result<(), PortError> {
    outbox.send(pose, &[])?;
    let health = process.health();
    health.taken(1);
    health.sent(1);
    health.newest(Timestamp::from_ns(pose.stamp_ns));
    Ok(())
}

/// The pinned zone on disk: one short line.
struct ZoneFile {
    path: PathBuf,
}

impl ZoneFile {
    fn new(folder: &Path) -> Self {
        Self { path: folder.join(ZONE_FILE) }
    }

    fn read(&self) -> Option<Zone> {
        Zone::parse(std::fs::read_to_string(&self.path).ok()?.trim())
    }

    /// Written beside and renamed: a killed process leaves the old zone or the new one.
    fn write(&self, zone: Zone) -> std::io::Result<()> {
        let beside = self.path.with_extension("new");
        std::fs::write(&beside, format!("{zone}\n"))?;
        std::fs::rename(&beside, &self.path)
    }
}

/// A receiver and its line.
pub(super) struct Listening {
    pub(super) receiver: Receiver,
    pub(super) line: Option<Line>,
    opening: Option<Opening>,
    clock: Clock,
    address: String,
    baud: u32,
    open_at: Timestamp,
    back_off_s: f64,
    last_byte: Timestamp,
    buffer: Vec<u8>,
}

impl Listening {
    /// A receiver with no line yet.
    pub(super) fn new(config: &Config, clock: Clock) -> Self {
        Self {
            receiver: Receiver::new(config),
            line: None,
            opening: None,
            clock,
            address: config.address.clone(),
            baud: config.baud,
            open_at: clock.now(),
            back_off_s: BACK_OFF_MIN_S,
            last_byte: clock.now(),
            buffer: vec![0; READ_BYTES],
        }
    }

    /// Once around: open if due, read, and take note of the time.
    pub(super) fn turn(&mut self) -> Vec<Event> {
        if self.line.is_none() {
            self.open();
        }
        let until_s = self.receiver.deadline().map_or(WAIT_MAX_S, |at| at.seconds_since(self.clock.now()));
        self.read(until_s.clamp(0.0, WAIT_MAX_S));
        self.receiver.tick(self.clock.now());
        let events: Vec<Event> = std::iter::from_fn(|| self.receiver.event()).collect();
        if events.iter().any(|event| matches!(event, Event::Pose(_))) {
            self.back_off_s = BACK_OFF_MIN_S;
        }
        events
    }

    /// Begins to open the line when it is time, and takes it when it is open.
    fn open(&mut self) {
        let Some(opening) = &self.opening else {
            if self.clock.now() >= self.open_at {
                self.opening = Some(Opening::begin(&self.address, self.baud));
            }
            return;
        };
        let Some(result) = opening.poll() else { return };
        self.opening = None;
        match result {
            Ok(line) => {
                self.line = Some(line);
                self.last_byte = self.clock.now();
                self.receiver.opened();
            }
            Err(error) => self.broken(&error.to_string()),
        }
    }

    fn read(&mut self, wait_s: f64) {
        let Some(line) = &mut self.line else { return };
        match line.read(&mut self.buffer, self.clock.real(wait_s)) {
            Ok(0) if self.clock.now().seconds_since(self.last_byte) > SILENT_S * self.clock.speed() => {
                self.broken(&format!("{} is silent for more than {SILENT_S} s", self.address));
            }
            Ok(0) => {}
            Ok(count) => {
                self.last_byte = self.clock.now();
                self.receiver.receive(self.last_byte, &self.buffer[..count]);
            }
            Err(error) => self.broken(&error.to_string()),
        }
    }

    fn broken(&mut self, reason: &str) {
        tracing::warn!("{reason}; trying again in {} s", self.back_off_s);
        self.line = None;
        self.receiver.closed(reason);
        self.open_at = self.clock.now().plus_seconds(self.back_off_s);
        self.back_off_s = (self.back_off_s * 2.0).min(BACK_OFF_MAX_S);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::frame::tests::sentence;
    use super::*;
    use std::io::Write;
    use std::net::{TcpListener, TcpStream};
    use std::time::Duration;

    /// One epoch, a tenth of a second after the last.
    pub fn burst(second: u32) -> String {
        let time = format!("1200{:02}.{}00", second / 10 % 60, second % 10);
        sentence(&format!("GPZDA,{time},22,11,2026,00,00"))
            + &sentence(&format!("GPGGA,{time},3000.0000,N,08221.0000,W,4,17,0.7,42.0,M,-28.5,M,1.0,0001"))
            + &sentence(&format!("PASHR,{time},90.00,T,1.0,-2.0,0.0,0.01,0.01,0.05,2,1"))
    }

    /// Sends an epoch and waits for the next.
    pub fn send(socket: &mut TcpStream, i: u32) -> std::io::Result<()> {
        socket.write_all(burst(i).as_bytes())?;
        std::thread::sleep(Duration::from_millis(100));
        Ok(())
    }

    #[test]
    fn poses_come_over_a_socket_and_again_after_it_broke() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp:{}", listener.local_addr().unwrap());
        // The second connection goes on in time where the first broke off, so nothing is out of order.
        let server = std::thread::spawn(move || {
            for part in 0..2 {
                let (mut socket, _) = listener.accept().unwrap();
                for i in 0..5 {
                    let _ = send(&mut socket, part * 20 + i);
                }
            }
        });
        let clock = Clock::start(1.0);
        let mut listening = Listening::new(&Config { address, ..Config::default() }, clock);
        let end = clock.now().plus_seconds(30.0);
        let (mut poses, mut pinned) = (0, Vec::new());
        while poses < 10 && clock.now() < end {
            for event in listening.turn() {
                match event {
                    Event::Pose(_) => poses += 1,
                    Event::Pinned(zone) => pinned.push(zone.to_string()),
                    _ => {}
                }
            }
        }
        drop(listening);
        server.join().unwrap();
        assert_eq!((poses, pinned), (10, vec!["17N".to_string()]));
    }

    #[test]
    fn the_zone_outlives_the_process() {
        let folder = std::env::temp_dir().join(format!("tsense-gpos-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let file = ZoneFile::new(&folder);
        assert_eq!(file.read(), None);
        file.write(Zone { number: 56, south: true }).unwrap();
        assert_eq!(file.read(), Some(Zone { number: 56, south: true }));
        std::fs::write(folder.join(ZONE_FILE), "77Q").unwrap();
        assert_eq!(file.read(), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
