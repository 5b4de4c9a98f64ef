//! What is at an address: for a person at the command line, without a graph.
//!
//! In: an address. Out: what the source sends and where that is, or why there is nothing. Nothing is sent to it.

use crate::gpos::config::Config;
use crate::gpos::process::Listening;
use crate::gpos::receiver::Event;
use crate::gpos::utm::Zone;
use crate::shell::line::{Line, LineError, TCP, rates};
use serde::Serialize;
use std::collections::BTreeMap;
use tsense_contract::Pose;
use tsense_ports::Clock;

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
        writeln!(f, "position source at {}, {}", self.address, rates(&[self.baud]))?;
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
    Err(ProbeError::Silent { address: address.into(), tried: rates(&bauds), seen })
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
#[allow(clippy::disallowed_methods, reason = "tests own their sockets and threads")]
mod tests {
    use super::*;
    use crate::gpos::process::tests::send;
    use std::io::Write;
    use std::net::TcpListener;
    use std::time::Duration;

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
}
