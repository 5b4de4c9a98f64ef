//! The device's sockets and threads: one that accepts, two a client, one that turns the mirror.
#![allow(clippy::disallowed_methods, reason = "shell: a simulated device owns its sockets and threads")]

use super::Lms151Options;
use super::cola::{Deframer, Dialect};
use super::device::{Device, Measuring, Outcome, Session};
use super::link::Link;
use super::mirror::Mirror;
use crate::cast::BeamReturn;
use crate::clock::WorldClock;
use crate::net::{Outgoing, accept_loop, lock};
use crate::world::Shared;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use tsense_geometry::Timestamp;

/// Clients at a time; the real device takes few as well.
const CLIENTS_MAX: usize = 8;
/// Beams are cast in parts while the mirror turns, so that the last part is small when the telegram is due.
const PARTS: usize = 8;
/// Turns it may fall behind before it lets some go.
const BEHIND_MAX: f64 = 2.0;

struct Client {
    out: Arc<Outgoing>,
    session: Mutex<Session>,
    link: Mutex<Link>,
    /// Of its newest request.
    dialect: Mutex<Option<Dialect>>,
}

struct Server {
    shared: Arc<Shared>,
    options: Lms151Options,
    /// Which ladar it is, from 0: chance treats the beams of each in its own way.
    number: u64,
    device: Mutex<Device>,
    mirror: Mutex<Mirror>,
    clients: Mutex<Vec<Arc<Client>>>,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

/// Where a device listens, and its threads.
type Started = (SocketAddr, Vec<JoinHandle<()>>);

/// Starts ladar `number`; its threads end when the world stops.
pub(crate) fn start(shared: Arc<Shared>, options: Lms151Options, number: u64) -> std::io::Result<Started> {
    let listener = TcpListener::bind(&options.address)?;
    let address = listener.local_addr()?;
    let (now, seed) = (shared.clock.now(), shared.view.scene.seed());
    let server = Arc::new(Server {
        device: Mutex::new(Device::new(&options, now)),
        mirror: Mutex::new(Mirror::new(&options, seed.wrapping_add(number))),
        shared,
        options,
        number,
        clients: Mutex::default(),
        threads: Mutex::default(),
    });
    let turning = server.clone();
    let mirror = std::thread::Builder::new().name("sim-mirror".into()).spawn(move || turning.turn())?;
    let door = std::thread::Builder::new().name("sim-lms151".into()).spawn(move || server.serve(&listener))?;
    Ok((address, vec![mirror, door]))
}

impl Server {
    fn stopping(&self) -> bool {
        self.shared.stop.load(Ordering::Relaxed)
    }

    fn serve(self: &Arc<Self>, listener: &TcpListener) {
        accept_loop(listener, &self.shared.stop, |stream| {
            if let Err(error) = self.admit(stream) {
                tracing::warn!(%error, "a client could not be served");
            }
            lock(&self.threads).retain(|t| !t.is_finished());
        });
        for client in lock(&self.clients).iter() {
            client.out.close();
        }
        for thread in std::mem::take(&mut *lock(&self.threads)) {
            // A client's thread that panicked has said so on its own; the device goes on to its end.
            let _ = thread.join();
        }
    }

    fn admit(self: &Arc<Self>, stream: TcpStream) -> std::io::Result<()> {
        let mut clients = lock(&self.clients);
        clients.retain(|c| !c.out.is_gone());
        if clients.len() >= CLIENTS_MAX {
            tracing::warn!("refused: {CLIENTS_MAX} clients are connected");
            return Ok(());
        }
        let (out, writer) = Outgoing::start(stream, "sim-lms151-tx")?;
        let client = Arc::new(Client {
            out,
            session: Mutex::default(),
            link: Mutex::new(Link::new(self.options.faults)),
            dialect: Mutex::default(),
        });
        clients.push(client.clone());
        let server = self.clone();
        let reader = std::thread::Builder::new().name("sim-lms151-rx".into()).spawn(move || server.listen(&client))?;
        lock(&self.threads).extend([writer, reader]);
        Ok(())
    }

    /// Reads one client's requests until it goes.
    fn listen(&self, client: &Client) {
        let connected = self.shared.clock.now();
        let (mut deframer, mut buffer) = (Deframer::default(), [0u8; 4096]);
        while !self.stopping() {
            let Some(bytes) = client.out.read(&mut buffer) else { break };
            deframer.push(bytes);
            while let Some((dialect, payload)) = deframer.next_frame() {
                *lock(&client.dialect) = Some(dialect);
                self.answer(client, dialect, &payload);
            }
            if self.options.faults.cut(self.shared.clock.now().seconds_since(connected)) {
                tracing::info!("fault: the connection is cut");
                break;
            }
        }
        client.out.close();
    }

    fn answer(&self, client: &Client, dialect: Dialect, payload: &[u8]) {
        let now = self.shared.clock.now();
        let outcome = lock(&self.device).handle(&mut lock(&client.session), dialect, payload, now);
        let send = |bytes| {
            if !self.shared.stalled(&self.options.faults) {
                client.out.send(lock(&client.link).answer(bytes));
            }
        };
        match outcome {
            Outcome::Answer { bytes, after_s } => {
                self.shared.clock.sleep_until(now.plus_seconds(after_s));
                send(bytes);
            }
            Outcome::NextScan => {}
            Outcome::Reboot(bytes) => {
                send(bytes);
                WorldClock::sleep_real(0.02);
                lock(&self.device).reboot(self.shared.clock.now());
                lock(&self.mirror).reboot();
                for other in lock(&self.clients).iter() {
                    other.out.close();
                }
            }
        }
    }

    /// Turns the mirror while the device measures.
    fn turn(&self) {
        let mut newest: Option<(Measuring, Timestamp)> = None;
        while !self.stopping() {
            let now = self.shared.clock.now();
            let Some(measuring) = lock(&self.device).measuring(now) else {
                newest = None;
                WorldClock::sleep_real(0.005);
                continue;
            };
            let period_s = measuring.shape.period_s();
            let mut first_beam = match newest {
                Some((before, start)) if before.since == measuring.since => start.plus_seconds(period_s),
                _ => {
                    lock(&self.mirror).turns_measured = 0;
                    measuring.since
                }
            };
            let behind = now.seconds_since(first_beam) / period_s - 1.0;
            if behind > BEHIND_MAX {
                let turns = behind.floor();
                lock(&self.mirror).skip(turns as u64);
                self.shared.counters.turns_skipped.fetch_add(turns as u64, Ordering::Relaxed);
                first_beam = first_beam.plus_seconds(turns * period_s);
            }
            self.scan(&measuring, first_beam);
            newest = Some((measuring, first_beam));
        }
    }

    /// One turn: cast its beams as they fly, then send the telegram to whoever wants it.
    fn scan(&self, measuring: &Measuring, first_beam: Timestamp) {
        let listeners: Vec<Arc<Client>> = lock(&self.clients).iter().filter(|c| c.wants_scans()).cloned().collect();
        let due = lock(&self.mirror).transmission_s();
        let sent = first_beam.plus_seconds(measuring.shape.sweep_s() + due);
        if listeners.is_empty() || !lock(&self.mirror).is_output(&measuring.data) {
            self.shared.clock.sleep_until(first_beam.plus_seconds(measuring.shape.period_s()));
            lock(&self.mirror).skip(1);
            return;
        }
        let returns = self.cast(measuring, first_beam);
        let contamination = lock(&self.device).contamination();
        let telegram = lock(&self.mirror).telegram(measuring, first_beam, contamination, &returns);
        self.shared.clock.sleep_until(sent);
        if self.shared.stalled(&self.options.faults) {
            return;
        }
        self.shared.counters.scans.fetch_add(1, Ordering::Relaxed);
        self.shared.counters.beams.fetch_add(returns.len() as u64, Ordering::Relaxed);
        for client in listeners {
            let Some(dialect) = *lock(&client.dialect) else { continue };
            let polled = std::mem::take(&mut lock(&client.session).polled);
            let mut writes = Vec::new();
            if polled {
                writes.extend(lock(&client.link).answer(telegram.framed(dialect, "sRA")));
            }
            if lock(&client.session).streaming {
                writes.extend(lock(&client.link).telegram(telegram.framed(dialect, "sSN"), dialect));
            }
            client.out.send(writes);
        }
    }

    fn cast(&self, measuring: &Measuring, first_beam: Timestamp) -> Vec<BeamReturn> {
        let (shape, view) = (measuring.shape, &self.shared.view);
        let beams = shape.beams();
        let turn = ((first_beam.seconds_since(self.shared.clock.start()) / shape.period_s()).round()) as u64;
        // Turns of one ladar never reach those of the next: half a million years.
        let turn = turn + (self.number << 48);
        let mount = self.options.tilt_from_ladar.unwrap_or(view.rig.tilt_from_ladar);
        let mut returns = Vec::with_capacity(beams);
        for part in 0..PARTS {
            let (low, high) = (part * beams / PARTS, (part + 1) * beams / PARTS);
            let instant = |i: usize| first_beam.plus_seconds(i as f64 * shape.beam_interval_s());
            self.shared.clock.sleep_until(instant(high - 1));
            let joints: Vec<_> = {
                let head = lock(&self.shared.head);
                (low..high).map(|i| head.angles(instant(i))).collect()
            };
            for (i, joint) in (low..high).zip(joints) {
                let world_s = instant(i).seconds_since(self.shared.clock.start());
                let beam = view.beam_of(&mount, world_s, joint, shape.angle_rad(i));
                returns.push(view.measure(&self.options.optics, &beam, world_s, turn, i));
            }
        }
        returns
    }
}

impl Client {
    fn wants_scans(&self) -> bool {
        let session = lock(&self.session);
        !self.out.is_gone() && (session.streaming || session.polled)
    }
}
