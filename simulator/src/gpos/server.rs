//! The receiver's socket and threads: every epoch's sentences to every client.
#![allow(clippy::disallowed_methods, reason = "shell: a simulated device owns its sockets and threads")]

use super::GposOptions;
use super::nmea::{Fix, epoch};
use super::utm::geodetic_of_utm;
use crate::faults::every;
use crate::net::{Outgoing, accept_loop, lock};
use crate::scene::ZONE;
use crate::world::Shared;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use tsense_geometry::{Timestamp, attitude_of};

/// Clients at a time.
const CLIENTS_MAX: usize = 8;

struct Client {
    out: Arc<Outgoing>,
    since: Timestamp,
}

struct Server {
    shared: Arc<Shared>,
    options: GposOptions,
    clients: Mutex<Vec<Client>>,
    writers: Mutex<Vec<JoinHandle<()>>>,
}

/// Starts the receiver; its threads end when the world stops.
pub(crate) fn start(shared: Arc<Shared>, options: GposOptions) -> std::io::Result<(SocketAddr, Vec<JoinHandle<()>>)> {
    let listener = TcpListener::bind(&options.address)?;
    let address = listener.local_addr()?;
    let server = Arc::new(Server { shared, options, clients: Mutex::default(), writers: Mutex::default() });
    let talking = server.clone();
    let talker = std::thread::Builder::new().name("sim-gpos".into()).spawn(move || talking.talk())?;
    let door = std::thread::Builder::new().name("sim-gpos-door".into()).spawn(move || server.serve(&listener))?;
    Ok((address, vec![talker, door]))
}

/// What the receiver reports of the truth at an instant.
pub(crate) fn fix_at(shared: &Shared, options: &GposOptions, at: Timestamp) -> Fix {
    let world_s = at.seconds_since(shared.clock.start());
    let vehicle = &shared.view.vehicle;
    let (pose, velocity) = (vehicle.pose(world_s), vehicle.velocity_m_s(world_s));
    let offset = options.errors.at(shared.view.scene.seed(), world_s);
    let (origin, attitude) = (pose.origin(), attitude_of(&pose));
    let [east, north, up] = offset.position_m;
    let place = geodetic_of_utm(origin.x() + east, origin.y() + north, ZONE);
    // The grid's north is turned from true north by the convergence.
    let true_deg = |grid_rad: f64| (grid_rad + place.convergence_rad).to_degrees().rem_euclid(360.0);
    let speed_m_s = velocity[0].hypot(velocity[1]);
    let heading_rad = attitude.yaw_rad + offset.attitude.yaw_rad;
    let course_rad = if speed_m_s > 0.02 { velocity[0].atan2(velocity[1]) } else { heading_rad };
    let [_, _, level, heading] = options.errors.quality.sigmas();
    Fix {
        at,
        latitude_deg: place.latitude_rad.to_degrees(),
        longitude_deg: place.longitude_rad.to_degrees(),
        ellipsoidal_m: origin.z() + up,
        heading_deg: true_deg(heading_rad),
        roll_deg: (attitude.roll_rad + offset.attitude.roll_rad).to_degrees(),
        pitch_deg: (attitude.pitch_rad + offset.attitude.pitch_rad).to_degrees(),
        speed_m_s,
        course_deg: true_deg(course_rad),
        quality: options.errors.quality.gga(),
        sigmas_deg: [level, heading],
    }
}

impl Server {
    fn serve(&self, listener: &TcpListener) {
        accept_loop(listener, &self.shared.stop, |stream| {
            if let Err(error) = self.admit(stream) {
                tracing::warn!(%error, "a client could not be served");
            }
            lock(&self.writers).retain(|t| !t.is_finished());
        });
        for client in lock(&self.clients).iter() {
            client.out.close();
        }
        for thread in std::mem::take(&mut *lock(&self.writers)) {
            let _ = thread.join();
        }
    }

    fn admit(&self, stream: TcpStream) -> std::io::Result<()> {
        let mut clients = lock(&self.clients);
        clients.retain(|c| !c.out.is_gone());
        if clients.len() >= CLIENTS_MAX {
            tracing::warn!("refused: {CLIENTS_MAX} clients are connected");
            return Ok(());
        }
        let (out, writer) = Outgoing::start(stream, "sim-gpos-tx")?;
        clients.push(Client { out, since: self.shared.clock.now() });
        lock(&self.writers).push(writer);
        Ok(())
    }

    fn talk(&self) {
        let period_ms = (1000.0 / f64::from(self.options.rate_hz.clamp(1, 200))).round() as i64;
        let period_ns = period_ms * 1_000_000;
        let mut sentences = 0;
        // Epochs lie on whole multiples of the period in UTC, as receivers do.
        let mut next_ns = (self.shared.clock.now().ns / period_ns + 1) * period_ns;
        while !self.shared.stop.load(Ordering::Relaxed) {
            let at = Timestamp::from_ns(next_ns);
            self.shared.clock.sleep_until(at.plus_seconds(self.options.latency_s));
            if !self.shared.stalled(&self.options.faults) {
                self.send(at, &mut sentences);
            }
            // Late by several epochs: those are lost.
            let now_ns = self.shared.clock.now().ns - (self.options.latency_s * 1e9) as i64;
            next_ns = (next_ns + period_ns).max((now_ns / period_ns) * period_ns);
        }
    }

    fn send(&self, at: Timestamp, sentences: &mut u64) {
        let mut clients = lock(&self.clients);
        let faults = &self.options.faults;
        for client in clients.iter().filter(|c| faults.cut(at.seconds_since(c.since))) {
            client.out.close();
        }
        clients.retain(|c| !c.out.is_gone());
        if clients.is_empty() {
            return;
        }
        self.shared.counters.epochs.fetch_add(1, Ordering::Relaxed);
        let mut bytes = Vec::with_capacity(512);
        for mut line in epoch(&fix_at(&self.shared, &self.options, at)) {
            *sentences += 1;
            if every(faults.drop_every, *sentences) {
                continue;
            }
            if every(faults.bad_checksum_every, *sentences) {
                // The first letter changes, the checksum does not.
                line[1] ^= 1;
            }
            let times = if every(faults.duplicate_every, *sentences) { 2 } else { 1 };
            (0..times).for_each(|_| bytes.extend_from_slice(&line));
        }
        let pieces: Vec<Vec<u8>> = match faults.fragment_bytes as usize {
            0 => vec![bytes],
            size => bytes.chunks(size).map(<[u8]>::to_vec).collect(),
        };
        for client in clients.iter() {
            client.out.send(pieces.clone());
        }
    }
}
