//! The running world: scene, vehicle, head and devices, from start to stop.
//!
//! In: options and a clock. Out: the addresses the devices really have, and the truth. In-process or as a child of
//! a demo; a parent that rebuilds `Scene::new(name, seed)` knows the same truth as the child.

use crate::clock::WorldClock;
use crate::faults::Faults;
use crate::gpos::{self, GposOptions};
use crate::lms151::{self, Lms151Options};
use crate::net::lock;
use crate::pan_tilt::{self, Head, PanTiltOptions};
use crate::scene::{Person, Scene, SceneName};
use crate::vehicle::{Rig, Vehicle, VehicleOptions};
use crate::view::View;
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use tsense_geometry::{Global, PanTiltAngles, Timestamp, Transform, Vehicle as VehicleFrame};

/// What world there shall be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WorldOptions {
    /// The scene's name.
    pub scene: SceneName,
    /// The seed of everything that chance decides.
    pub seed: u64,
    /// How the vehicle moves.
    pub vehicle: VehicleOptions,
    /// Where the sensors sit.
    pub rig: Rig,
    /// Somebody else than the scene's own person, or somebody where there is none.
    pub person: Option<Person>,
    /// The ladar, where there is one.
    pub lms151: Option<Lms151Options>,
    /// Further ladars on the same head.
    pub more_ladars: Vec<Lms151Options>,
    /// The pan-tilt unit, where there is one.
    pub pan_tilt: Option<PanTiltOptions>,
    /// The position system, where there is one.
    pub gpos: Option<GposOptions>,
}

impl Default for WorldOptions {
    fn default() -> Self {
        Self {
            scene: SceneName::Forest,
            seed: 7,
            vehicle: VehicleOptions::default(),
            rig: Rig::default(),
            person: None,
            lms151: Some(Lms151Options::default()),
            more_ladars: Vec::new(),
            pan_tilt: Some(PanTiltOptions::default()),
            gpos: Some(GposOptions::default()),
        }
    }
}

impl WorldOptions {
    /// The scene these options describe, without starting anything.
    pub fn build_scene(&self) -> Scene {
        let scene = Scene::new(self.scene, self.seed);
        if self.person.is_some() { scene.with_person(self.person) } else { scene }
    }
}

/// Where the devices are really found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Addresses {
    /// The ladar's.
    pub lms151: Option<SocketAddr>,
    /// Those of further ladars, in the order of the options.
    pub more_ladars: Vec<SocketAddr>,
    /// The pan-tilt unit's terminal.
    pub pan_tilt: Option<PathBuf>,
    /// The position system's.
    pub gpos: Option<SocketAddr>,
}

/// What happened so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Scans sent.
    pub scans: u64,
    /// Beams in them.
    pub beams: u64,
    /// Turns of the mirror that were let go because the machine was too slow.
    pub turns_skipped: u64,
    /// Position epochs sent.
    pub epochs: u64,
}

/// Why a world cannot start.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// A device's address or terminal is not to be had.
    #[error("the simulated {device} cannot have {wanted}: {source}; choose another, or port 0 for any free one")]
    Device {
        /// Which device.
        device: &'static str,
        /// The address or link asked for.
        wanted: String,
        /// What the operating system said.
        source: std::io::Error,
    },
}

#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub scans: AtomicU64,
    pub beams: AtomicU64,
    pub turns_skipped: AtomicU64,
    pub epochs: AtomicU64,
}

/// What all devices share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub clock: WorldClock,
    pub view: View,
    pub head: Mutex<Head>,
    pub stop: AtomicBool,
    pub counters: Counters,
}

impl Shared {
    /// True while a device with these faults must send nothing.
    pub fn stalled(&self, faults: &Faults) -> bool {
        faults.stalled(self.clock.now().seconds_since(self.clock.start()))
    }
}

/// A world that runs until it is stopped or dropped.
#[derive(Debug)]
pub struct World {
    shared: Arc<Shared>,
    addresses: Addresses,
    threads: Vec<JoinHandle<()>>,
}

impl World {
    /// Builds the scene and starts the devices.
    pub fn start(options: &WorldOptions, clock: WorldClock) -> Result<Self, WorldError> {
        let scene = Arc::new(options.build_scene());
        let vehicle = Vehicle::new(scene.clone(), options.vehicle, &options.rig);
        let resolution = options.pan_tilt.clone().unwrap_or_default().resolution_arcsec;
        let shared = Arc::new(Shared {
            clock,
            view: View { scene, vehicle, rig: options.rig },
            head: Mutex::new(Head::new(resolution)),
            stop: AtomicBool::new(false),
            counters: Counters::default(),
        });
        // From here on a failure drops the world, which ends what was started.
        let mut world = Self { shared, addresses: Addresses::default(), threads: Vec::new() };
        if let Some(lms151) = &options.lms151 {
            world.addresses.lms151 = Some(world.start_ladar(lms151, 0)?);
        }
        for (lms151, number) in options.more_ladars.iter().zip(1..) {
            let address = world.start_ladar(lms151, number)?;
            world.addresses.more_ladars.push(address);
        }
        if let Some(pan_tilt) = &options.pan_tilt {
            let started = pan_tilt::start(world.shared.clone(), pan_tilt.clone());
            let (path, thread) = started.map_err(|e| refused("pan-tilt unit", &pan_tilt.link, e))?;
            world.addresses.pan_tilt = Some(path);
            world.threads.push(thread);
        }
        if let Some(gpos) = &options.gpos {
            let started = gpos::start(world.shared.clone(), gpos.clone());
            let (address, threads) = started.map_err(|e| refused("position system", &gpos.address, e))?;
            world.addresses.gpos = Some(address);
            world.threads.extend(threads);
        }
        Ok(world)
    }

    fn start_ladar(&mut self, options: &Lms151Options, number: u64) -> Result<SocketAddr, WorldError> {
        let started = lms151::start(self.shared.clone(), options.clone(), number);
        let (address, threads) = started.map_err(|e| refused("LMS-151", &options.address, e))?;
        self.threads.extend(threads);
        Ok(address)
    }

    /// Where the devices are found.
    pub fn addresses(&self) -> &Addresses {
        &self.addresses
    }

    /// The scene, which knows the truth.
    pub fn scene(&self) -> &Scene {
        &self.shared.view.scene
    }

    /// The vehicle, which knows where it truly was at any instant.
    pub fn vehicle(&self) -> &Vehicle {
        &self.shared.view.vehicle
    }

    /// World time.
    pub fn clock(&self) -> WorldClock {
        self.shared.clock
    }

    /// The vehicle's true pose at an instant.
    pub fn pose(&self, at: Timestamp) -> Transform<Global, VehicleFrame> {
        self.vehicle().pose(at.seconds_since(self.shared.clock.start()))
    }

    /// The head's true angles at an instant of the last few motions.
    pub fn angles(&self, at: Timestamp) -> PanTiltAngles {
        lock(&self.shared.head).angles(at)
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        let count = |c: &AtomicU64| c.load(Ordering::Relaxed);
        let c = &self.shared.counters;
        Counts {
            scans: count(&c.scans),
            beams: count(&c.beams),
            turns_skipped: count(&c.turns_skipped),
            epochs: count(&c.epochs),
        }
    }

    /// Ends every device and waits for its threads.
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a thread of a simulated device had panicked");
            }
        }
    }
}

impl Drop for World {
    fn drop(&mut self) {
        self.end();
    }
}

fn refused(device: &'static str, wanted: &str, source: std::io::Error) -> WorldError {
    WorldError::Device { device, wanted: wanted.to_owned(), source }
}
