//! Shell: the process `jaus`. It reads the topics that are served and owns the UDP socket.
//!
//! In: topics grid, objects, scan, joint; datagrams. Out: datagrams; no topic. One thread: it waits on its sockets, 10 ms at
//! most, then serves the process loop. Nothing waits for a peer: what the network does not take is counted and gone.
#![allow(clippy::disallowed_methods, reason = "shell: the socket")]

use super::config::Config;
use super::rig::Rig;
use super::station::Station;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use tsense_contract::{Grid, Joints, Objects, ProcessState, Scan};
use tsense_geometry::Timestamp;
use tsense_jaus::judp;
use tsense_ports::{Clock, Inbox, PortError, Process, Wake};

/// Longest wait on the sockets before the process loop is served, nanoseconds.
const WAIT_NS: i64 = 10_000_000;
/// Wait while datagrams are still to be sent, nanoseconds.
const BETWEEN_BURSTS_NS: i64 = 1_000_000;
/// Bytes after which a burst ends: one packet of a grid, so that grids leave at 4 MB/s. JuniorRTE asks for a buffer that holds
/// three and empties it once a millisecond.
const BURST_BYTES: usize = 4000;
/// Datagrams taken before topics and events get their turn.
const DATAGRAMS_AT_ONCE: usize = 64;
/// Time between two attempts to open the socket, graph seconds.
const OPEN_PERIOD_S: f64 = 5.0;
/// Largest datagram there is.
const DATAGRAM_MAX: usize = 65_536;

/// Why the process ended.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A topic or an event failed.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Runs until the process is asked to stop.
pub fn run(mut process: Process, config: &Config, rig: &Rig) -> Result<(), Error> {
    let clock = process.clock();
    let mut inboxes = Inboxes::open(&mut process, rig)?;
    // The clock's microseconds are as good as drawn: numbers of before a restart are not repeated.
    let mut station = Station::new(config, rig, (clock.now().ns / 1000) as u16);
    let mut wire = Wire::new(config);
    let mut told = BTreeMap::new();
    while process.wait(0.0) != Wake::Stop {
        inboxes.take(&mut process, &mut station)?;
        wire.tend(&mut process, &station, clock.now());
        wire.receive(&mut station, &clock);
        station.tick(clock.now());
        let sent = wire.send(&mut station);
        process.health().sent(sent);
        tell(&mut process, &station, &mut told);
    }
    Ok(())
}

/// Everything that is served.
struct Inboxes {
    grid: Inbox<Grid>,
    objects: Inbox<Objects>,
    scans: Vec<Inbox<Scan>>,
    joints: Option<Inbox<Joints>>,
}

impl Inboxes {
    fn open(process: &mut Process, rig: &Rig) -> Result<Self, PortError> {
        let scans = rig.ladars.iter().map(|ladar| process.inbox(Some(&ladar.name))).collect::<Result<_, _>>()?;
        let joints = rig.head.as_ref().map(|_| process.inbox(None)).transpose()?;
        Ok(Self { grid: process.inbox(None)?, objects: process.inbox(None)?, scans, joints })
    }

    /// The newest of each; older ones are of no use to anybody, but for angles, which scans lie between.
    fn take(&mut self, process: &mut Process, station: &mut Station) -> Result<(), PortError> {
        let (grid, older_grids) = self.grid.take_newest()?;
        if let Some(sample) = &grid {
            station.grid(sample.header(), sample.items());
        }
        let (objects, older_objects) = self.objects.take_newest()?;
        if let Some(sample) = &objects {
            station.objects(sample.header(), sample.items());
        }
        let mut taken = older_grids + older_objects + u64::from(grid.is_some()) + u64::from(objects.is_some());
        for (index, inbox) in self.scans.iter_mut().enumerate() {
            let (scan, older) = inbox.take_newest()?;
            if let Some(sample) = &scan {
                station.scan(index, sample.header(), sample.items());
            }
            taken += older + u64::from(scan.is_some());
        }
        while let Some(sample) = self.joints.as_mut().map(Inbox::take).transpose()?.flatten() {
            station.joint(sample.header());
            taken += 1;
        }
        process.health().taken(taken);
        Ok(())
    }
}

/// Puts new drops into the heartbeat.
fn tell(process: &mut Process, station: &Station, told: &mut BTreeMap<&'static str, u64>) {
    for (cause, total) in station.drops() {
        let before = told.insert(cause, *total).unwrap_or(0);
        process.health().dropped(cause, total - before);
    }
}

/// The sockets, or why there are none.
struct Wire {
    config: Config,
    sockets: Vec<UdpSocket>,
    tried: Option<Timestamp>,
    more: bool,
    buffer: Vec<u8>,
}

impl Wire {
    fn new(config: &Config) -> Self {
        Self { config: config.clone(), sockets: Vec::new(), tried: None, more: false, buffer: vec![0; DATAGRAM_MAX] }
    }

    /// Opens the sockets where there are none, and states how it is.
    fn tend(&mut self, process: &mut Process, station: &Station, now: Timestamp) {
        if let Some(socket) = self.sockets.first() {
            let at = socket.local_addr().map_or_else(|_| self.config.listen.clone(), |address| address.to_string());
            let rights = if self.config.allow_control { "control allowed" } else { "read-only" };
            let words = format!("{at} as {}, {rights}, {}", self.config.main_id(), station.words());
            return process.health().set(ProcessState::Running, &words);
        }
        if self.tried.is_some_and(|tried| now.seconds_since(tried) < OPEN_PERIOD_S) {
            return;
        }
        self.tried = Some(now);
        match open(&self.config) {
            Ok(sockets) => self.sockets = sockets,
            Err(error) => {
                let words = format!("cannot listen on {}: {error}; trying again", self.config.listen);
                tracing::error!("{words} every {OPEN_PERIOD_S} s");
                process.health().set(ProcessState::Degraded, &words);
            }
        }
    }

    /// Takes what waits, and waits a little where nothing does.
    fn receive(&mut self, station: &mut Station, clock: &Clock) {
        self.wait();
        for socket in &self.sockets {
            for _ in 0..DATAGRAMS_AT_ONCE {
                match socket.recv_from(&mut self.buffer) {
                    Ok((count, from)) => station.receive(clock.now(), from, &self.buffer[..count]),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                    Err(_) => {
                        station.dropped("receiving failed", 1);
                        break;
                    }
                }
            }
        }
    }

    fn wait(&self) {
        let wait_ns = if self.more { BETWEEN_BURSTS_NS } else { WAIT_NS };
        let mut polled: Vec<PollFd<'_>> = self.sockets.iter().map(|s| PollFd::new(s, PollFlags::IN)).collect();
        // An error is a signal, which the process loop looks for anyway.
        let _ = poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: wait_ns }));
    }

    /// Sends a burst; what the network does not take at once is gone.
    fn send(&mut self, station: &mut Station) -> u64 {
        let (mut sent, mut bytes) = (0, 0);
        self.more = false;
        while let Some((to, datagram)) = station.next_datagram() {
            let Some(socket) = self.sockets.first() else { continue };
            match socket.send_to(&datagram, to) {
                Ok(_) => sent += 1,
                Err(error) if error.kind() == ErrorKind::WouldBlock => station.dropped("network does not take more", 1),
                Err(_) => station.dropped("sending failed", 1),
            }
            bytes += datagram.len();
            if bytes >= BURST_BYTES {
                self.more = true;
                break;
            }
        }
        sent
    }
}

/// The socket for everything, and one for the group where that does not hear it: bound to one address, Linux gives a
/// socket only what is sent to that address.
fn open(config: &Config) -> std::io::Result<Vec<UdpSocket>> {
    let address = config.address().unwrap_or(SocketAddr::from((Ipv4Addr::LOCALHOST, judp::PORT)));
    let mut sockets = vec![UdpSocket::bind(address)?];
    if let (Some(group), IpAddr::V4(interface)) = (config.group(), address.ip()) {
        sockets[0].set_multicast_ttl_v4(config.multicast_ttl)?;
        if !interface.is_unspecified() {
            sockets.push(UdpSocket::bind((group, judp::PORT))?);
        }
        let hears = &sockets[sockets.len() - 1];
        hears.join_multicast_v4(&group, &interface)?;
        // We need not hear ourselves.
        sockets[0].set_multicast_loop_v4(false)?;
    }
    for socket in &sockets {
        socket.set_nonblocking(true)?;
    }
    Ok(sockets)
}
