//! The socket of a JAUS position source, and the receiver behind it.
//!
//! In: the configuration. Out: events of the receiver. No socket is opened unless the configuration names `jaus`.
#![allow(clippy::disallowed_methods, reason = "shell: the socket")]

use crate::gpos::config::Config;
use crate::gpos::jaus::{Client, fix_of};
use crate::gpos::receiver::{Event, Receiver};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::UdpSocket;
use std::time::Duration;
use tsense_geometry::Timestamp;
use tsense_ports::Clock;

/// Longest wait on the socket before the process loop is served.
const WAIT: Duration = Duration::from_millis(10);
/// Time between two attempts to open the socket, graph seconds.
const OPEN_PERIOD_S: f64 = 5.0;
/// Datagrams taken before the process loop gets its turn.
const DATAGRAMS_AT_ONCE: usize = 64;
/// Largest datagram there is.
const DATAGRAM_MAX: usize = 65_536;

/// A receiver and its JAUS client.
pub struct JausListening {
    config: Config,
    clock: Clock,
    /// The receiver.
    pub receiver: Receiver,
    client: Client,
    socket: Option<UdpSocket>,
    open_at: Timestamp,
    connected: bool,
    told: BTreeMap<&'static str, u64>,
    buffer: Vec<u8>,
}

impl JausListening {
    /// A receiver with no socket yet.
    pub fn new(config: &Config, clock: Clock) -> Self {
        Self {
            config: config.clone(),
            clock,
            receiver: Receiver::new(config),
            // The clock's microseconds are as good as drawn.
            client: Client::new(&config.jaus, (clock.now().ns / 1000) as u16),
            socket: None,
            open_at: clock.now(),
            connected: false,
            told: BTreeMap::new(),
            buffer: vec![0; DATAGRAM_MAX],
        }
    }

    /// Once around: open if due, ask, take what came.
    pub fn turn(&mut self) -> Vec<Event> {
        if self.socket.is_none() {
            self.open();
        }
        self.client.tick(self.clock.now());
        self.send();
        self.receive();
        self.note_condition();
        self.receiver.tick(self.clock.now());
        let drops: Vec<Event> = self.new_drops();
        std::iter::from_fn(|| self.receiver.event()).chain(drops).collect()
    }

    fn open(&mut self) {
        let now = self.clock.now();
        if now < self.open_at {
            return self.clock.sleep(WAIT.as_secs_f64() * self.clock.speed());
        }
        self.open_at = now.plus_seconds(OPEN_PERIOD_S);
        let listen = &self.config.jaus.listen;
        match UdpSocket::bind(listen).and_then(|s| s.set_read_timeout(Some(WAIT)).map(|()| s)) {
            Ok(socket) => self.socket = Some(socket),
            Err(error) => {
                tracing::error!(%error, listen, "the socket is not open, trying again every {OPEN_PERIOD_S} s");
                self.receiver.closed(&format!("cannot listen on {listen}: {error}"));
            }
        }
    }

    /// Waits for the first datagram, and takes what is there with it.
    fn receive(&mut self) {
        let Some(socket) = &self.socket else { return };
        for _ in 0..DATAGRAMS_AT_ONCE {
            match socket.recv_from(&mut self.buffer) {
                Ok((count, from)) => {
                    let now = self.clock.now();
                    for report in self.client.receive(now, from, &self.buffer[..count]) {
                        self.receiver.receive_fix(now, fix_of(&report, now, &self.config));
                    }
                }
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => return,
                // A signal, or an echo of a datagram that found nobody: the next turn tries again.
                Err(_) => return,
            }
        }
    }

    fn send(&mut self) {
        while let Some((to, datagram)) = self.client.next_datagram() {
            let Some(socket) = &self.socket else { continue };
            // Requests are a few dozen bytes and are made again: one that is lost is only late.
            if let Err(error) = socket.send_to(&datagram, to) {
                tracing::debug!(%error, %to, "a request was not sent");
            }
        }
    }

    /// The receiver is told when a sensor is found, and why there is none.
    fn note_condition(&mut self) {
        match self.client.sensor() {
            Ok(sensor) if !self.connected => {
                tracing::info!(%sensor, "poses come over jaus");
                self.connected = true;
                self.receiver.opened();
            }
            Ok(_) => {}
            Err(words) if self.socket.is_some() => {
                self.connected = false;
                self.receiver.closed(&words);
            }
            Err(_) => self.connected = false,
        }
    }

    fn new_drops(&mut self) -> Vec<Event> {
        let told = &mut self.told;
        let new = |(cause, total): (&&'static str, &u64)| {
            let before = told.insert(cause, *total).unwrap_or(0);
            (*total > before).then(|| Event::Dropped(cause, total - before))
        };
        self.client.drops().iter().filter_map(new).collect()
    }
}

impl Drop for JausListening {
    /// The sensor need not send for another minute to somebody who is gone.
    fn drop(&mut self) {
        self.client.stop(self.clock.now());
        self.send();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sensor in plain code: confirms the event, then sends the pose of now ten times a second.
    fn serve(socket: UdpSocket, clock: Clock) {
        let mut buffer = [0; 2048];
        let say = |to, body: &[u8]| {
            static SEQUENCE: std::sync::atomic::AtomicU16 = std::sync::atomic::AtomicU16::new(0);
            let sequence = SEQUENCE.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            let size = (body.len() + 14) as u16;
            let head = [&[2, 0][..], &size.to_le_bytes(), &[1, 40, 1, 1, 0, 30, 1, 7, 0]].concat();
            socket.send_to(&[&head, body, &sequence.to_le_bytes()].concat(), to).unwrap();
        };
        let client = loop {
            let (count, from) = socket.recv_from(&mut buffer).unwrap();
            if buffer[13..15] == [0xf0, 1] && count > 20 {
                break from;
            }
        };
        say(client, &[0xf3, 1, 1, 5, 0x58, 2]);
        for i in 0..30_u8 {
            let mut pose = vec![
                2, 0x44, 0xff, 1, 0xd2, 2, 0x52, 0xaa, 0xa8, 0x8c, 0x7f, 0x45, 0x5f, 0x73, 0x21, 0x39, 0x9c, 0xc4,
                0x20, 0, 0x68, 0x80, 0x2f, 0x7f, 0x1d, 0xbd, 0x2a, 0,
            ];
            pose.extend(tsense_jaus::time_stamp(clock.now().ns).to_le_bytes());
            say(client, &[&[0xf1, 0x41, 5, i, 32, 0, 0, 0][..], &pose].concat());
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    #[test]
    fn poses_come_from_a_foreign_sensor() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let clock = Clock::start(1.0);
        let mut config = Config { address: "jaus".into(), ..Config::default() };
        config.jaus.listen = "127.0.0.1:0".into();
        config.jaus.contacts = vec![socket.local_addr().unwrap().to_string()];
        config.jaus.sensor = "7.1.30".into();
        assert_eq!(config.validate(), []);
        let server = std::thread::spawn(move || serve(socket, clock));
        let mut listening = JausListening::new(&config, clock);
        let end = clock.now().plus_seconds(30.0);
        let mut poses = Vec::new();
        while poses.len() < 10 && clock.now() < end {
            poses.extend(listening.turn().into_iter().filter_map(|event| match event {
                Event::Pose(pose) => Some(pose),
                _ => None,
            }));
        }
        let pose = poses[9];
        // 29.7565 N, 82.2681 W is 17N 377392.09 E, 3292477.55 N by PROJ 9; grid yaw is 1.5 rad less the convergence.
        assert_eq!((pose.zone, pose.south), (17, 0));
        assert!(
            (pose.easting_m - 377_392.09).abs() < 0.05 && (pose.northing_m - 3_292_477.55).abs() < 0.05,
            "{pose:?}"
        );
        assert!((pose.yaw_rad + pose.convergence_rad - 1.5).abs() < 1e-4 && pose.convergence_rad < -0.01);
        assert!((clock.now().seconds_since(Timestamp::from_ns(pose.stamp_ns))).abs() < 5.0);
        assert!(listening.receiver.condition(clock.now()).1.contains("rtk fixed"));
        drop(listening);
        server.join().unwrap();
    }
}
