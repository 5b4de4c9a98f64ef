//! The process of the position system: owns the line, publishes `pose`, keeps the UTM zone for the life of the graph.
//!
//! In: the configuration. Out: `pose`, health in words with drops by cause, and one small file with the pinned zone in
//! the graph's folder, so that a restart beyond a zone's border does not change the map. One thread: the read waits
//! 20 ms at most. [`probe`] looks at a source without a graph.
#![allow(clippy::disallowed_methods, reason = "shell: the loop around the line, and the zone's file")]

use super::config::Config;
use super::receiver::{Event, Receiver};
use super::utm::Zone;
use crate::shell::line::{Line, LineError, Opening, TCP};
use serde::Serialize;
use std::collections::BTreeMap;
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
    let mut listening = Listening::new(config, clock);
    if let Some(zone) = zone_file.read() {
        listening.receiver.remember(zone);
    }
    while process.wait(0.0) != Wake::Stop {
        for event in listening.turn() {
            publish(&mut process, &mut outbox, &zone_file, event)?;
        }
        let (state, reason) = listening.receiver.condition(clock.now());
        process.health().set(state, &reason);
        if listening.line.is_none() {
            process.wait(NO_LINE_WAIT_S);
        }
    }
    Ok(())
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
struct Listening {
    receiver: Receiver,
    line: Option<Line>,
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
    fn new(config: &Config, clock: Clock) -> Self {
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
    fn turn(&mut self) -> Vec<Event> {
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

/// What [`probe`] found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The address asked.
    pub address: String,
    /// Rate of the line at which frames came, bits per second; 0 with `tcp:`.
    pub baud: u32,
    /// Frames by kind: sentence names, log names and numbers.
    pub frames: BTreeMap<String, u64>,
    /// The date the source gave.
    pub date: Option<String>,
    /// What was thrown away, by cause.
    pub dropped: BTreeMap<String, u64>,
    /// The newest pose.
    pub pose: Option<PoseReport>,
    /// How the driver would be in a graph.
    pub condition: String,
}

/// A pose for people and tools.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseReport {
    /// UTM zone and hemisphere.
    pub zone: String,
    /// Easting, northing, height above the ellipsoid, metres.
    pub position_m: [f64; 3],
    /// Roll, pitch, grid yaw, degrees.
    pub attitude_deg: [f64; 3],
    /// Grid convergence, degrees.
    pub convergence_deg: f64,
    /// How far it may be trusted, in words.
    pub quality: String,
}

impl PoseReport {
    fn new(pose: &Pose) -> Self {
        Self {
            zone: Zone { number: pose.zone, south: pose.south != 0 }.to_string(),
            position_m: [pose.easting_m, pose.northing_m, pose.altitude_m],
            attitude_deg: [pose.roll_rad, pose.pitch_rad, pose.yaw_rad].map(f64::to_degrees),
            convergence_deg: pose.convergence_rad.to_degrees(),
            quality: pose.quality().to_string(),
        }
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let counts = |map: &BTreeMap<String, u64>| {
            map.iter().map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
        };
        writeln!(f, "position source at {}, {} bits/s", self.address, self.baud)?;
        writeln!(f, "frames: {}", counts(&self.frames))?;
        writeln!(f, "date: {}", self.date.as_deref().unwrap_or("not said"))?;
        if !self.dropped.is_empty() {
            writeln!(f, "dropped: {}", counts(&self.dropped))?;
        }
        if let Some(pose) = &self.pose {
            let ([e, n, h], [roll, pitch, yaw]) = (pose.position_m, pose.attitude_deg);
            writeln!(f, "position: {} {e:.3} E {n:.3} N, {h:.3} m above the ellipsoid, {}", pose.zone, pose.quality)?;
            let gamma = pose.convergence_deg;
            writeln!(f, "attitude: roll {roll:.2}, pitch {pitch:.2}, grid yaw {yaw:.2} deg (convergence {gamma:.3})")?;
        }
        write!(f, "condition: {}", self.condition)
    }
}

/// Why [`probe`] found nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ProbeError {
    /// The line itself.
    #[error(transparent)]
    Line(#[from] LineError),
    /// A line, but no frame with a right checksum on it.
    #[error("neither NMEA nor NovAtel frames come from {address} ({tried}): {seen}")]
    Silent {
        /// The address.
        address: String,
        /// The line rates tried.
        tried: String,
        /// What came instead.
        seen: String,
    },
}

/// Line rates of receivers, the likeliest first.
const BAUDS: [u32; 6] = [115_200, 9600, 38_400, 57_600, 230_400, 4800];
/// How long a source may take for its first frame, seconds: most send one a second or more.
const FIRST_FRAME_S: f64 = 2.5;
/// How long it is listened to from then on, seconds.
const LISTEN_S: f64 = 2.0;

/// Listens to what is at an address; sends nothing. Without `baud` the usual line rates are tried.
pub fn probe(address: &str, baud: Option<u32>) -> Result<Report, ProbeError> {
    let bauds = match baud {
        _ if address.starts_with(TCP) => vec![0],
        Some(baud) => vec![baud],
        None => BAUDS.to_vec(),
    };
    let mut seen = String::new();
    for &baud in &bauds {
        match listen(address, baud)? {
            Ok(report) => return Ok(report),
            Err(what) => seen = what,
        }
    }
    let tried: Vec<String> = bauds.iter().map(u32::to_string).collect();
    Err(ProbeError::Silent { address: address.into(), tried: format!("{} bits/s", tried.join(", ")), seen })
}

fn listen(address: &str, baud: u32) -> Result<Result<Report, String>, LineError> {
    let clock = Clock::start(1.0);
    let config = Config { address: address.into(), baud, ..Config::default() };
    let mut listening = Listening::new(&config, clock);
    // The first opening here, so that its error is the caller's.
    listening.line = Some(Line::open(address, baud)?);
    listening.receiver.opened();
    let (mut pose, mut dropped) = (None, BTreeMap::new());
    let mut end = clock.now().plus_seconds(FIRST_FRAME_S);
    let mut heard = false;
    while clock.now() < end && listening.line.is_some() {
        for event in listening.turn() {
            match event {
                Event::Pose(newest) => pose = Some(PoseReport::new(&newest)),
                Event::Dropped(cause, count) => *dropped.entry(cause.to_string()).or_default() += count,
                Event::Pinned(_) | Event::Notice(_) => {}
            }
        }
        if !heard && !listening.receiver.seen().frames.is_empty() {
            (heard, end) = (true, clock.now().plus_seconds(LISTEN_S));
        }
    }
    if !heard {
        let bytes: u64 = dropped.values().sum();
        return Ok(Err(if bytes == 0 { "nothing at all".into() } else { format!("{bytes} bytes of something else") }));
    }
    let (state, reason) = listening.receiver.condition(clock.now());
    let seen = listening.receiver.seen();
    Ok(Ok(Report {
        address: address.into(),
        baud,
        frames: seen.frames.clone(),
        date: seen.date.clone(),
        dropped,
        pose,
        condition: format!("{state}: {reason}"),
    }))
}

#[cfg(test)]
mod tests {
    use super::super::frame::tests::sentence;
    use super::*;
    use std::io::Write;
    use std::net::{TcpListener, TcpStream};
    use std::time::Duration;

    fn burst(second: u32) -> String {
        let time = format!("1200{:02}.{}00", second / 10 % 60, second % 10);
        sentence(&format!("GPZDA,{time},22,11,2026,00,00"))
            + &sentence(&format!("GPGGA,{time},3000.0000,N,08221.0000,W,4,17,0.7,42.0,M,-28.5,M,1.0,0001"))
            + &sentence(&format!("PASHR,{time},90.00,T,1.0,-2.0,0.0,0.01,0.01,0.05,2,1"))
    }

    /// A receiver on a socket, ten epochs a second, for as many connections.
    fn serve(listener: TcpListener, connections: usize, epochs: u32) {
        for _ in 0..connections {
            let Ok((mut socket, _)) = listener.accept() else { return };
            for i in 0..epochs {
                if send(&mut socket, i).is_err() {
                    break;
                }
            }
        }
    }

    fn send(socket: &mut TcpStream, i: u32) -> std::io::Result<()> {
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
    fn a_probe_says_what_a_source_sends_and_where_it_is() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp:{}", listener.local_addr().unwrap());
        let server = std::thread::spawn(move || serve(listener, 1, 60));
        let report = probe(&address, None).unwrap();
        let pose = report.pose.as_ref().unwrap();
        assert_eq!((pose.zone.as_str(), pose.quality.as_str()), ("17N", "rtk fixed"));
        assert_eq!(report.date.as_deref(), Some("2026-11-22"));
        assert!(report.frames["PASHR"] >= 5, "{report}");
        assert!(report.to_string().contains("17N 369"), "{report}");
        server.join().unwrap();
    }

    #[test]
    fn a_probe_of_something_else_says_so() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp:{}", listener.local_addr().unwrap());
        let server = std::thread::spawn(move || {
            let (mut socket, _) = listener.accept().unwrap();
            let _ = socket.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n");
            std::thread::sleep(Duration::from_secs(3));
        });
        let error = probe(&address, None).unwrap_err().to_string();
        assert!(error.ends_with("28 bytes of something else"), "{error}");
        server.join().unwrap();
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
