//! What the demo sets up: a folder, a world, and the configuration of a graph that fits the world's devices.
#![allow(clippy::disallowed_methods, reason = "shell: a folder for the demo's store and log")]

use super::DemoArgs;
use crate::commands::Failure;
use crate::config::Config;
use std::path::{Path, PathBuf};
use tsense_ports::logging::LogFormat;
use tsense_simulator::{Addresses, GposOptions, Lms151Options, PanTiltOptions, VehicleOptions, WorldOptions};

/// Any free port of this machine.
const ANY_PORT: &str = "127.0.0.1:0";

/// The demo's folder; a temporary one goes with the demo.
pub struct Folder {
    path: PathBuf,
    is_temporary: bool,
}

impl Folder {
    /// Makes the folder.
    pub fn new(keep: Option<&Path>) -> Result<Self, Failure> {
        let path = match keep {
            Some(path) => path.to_owned(),
            None => std::env::temp_dir().join(format!("tsense-demo-{}", std::process::id())),
        };
        std::fs::create_dir_all(&path).map_err(|e| Failure::new(1, format!("{}: {e}", path.display())))?;
        Ok(Self { path, is_temporary: keep.is_none() })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if self.is_temporary {
            // The system's own cleaning takes what cannot be removed now.
            let _ = std::fs::remove_dir_all(&self.path);
        }
    }
}

/// The world of these arguments: every device on a free port of this machine.
pub fn world(args: &DemoArgs, folder: &Path) -> WorldOptions {
    WorldOptions {
        scene: args.scene,
        seed: args.seed,
        vehicle: VehicleOptions {
            motion: args.vehicle,
            speed_m_s: args.scene.speed_m_s(),
            ..VehicleOptions::default()
        },
        lms151: Some(Lms151Options { address: ANY_PORT.into(), ..Lms151Options::default() }),
        pan_tilt: Some(PanTiltOptions {
            link: folder.join("pan-tilt").display().to_string(),
            ..PanTiltOptions::default()
        }),
        gpos: Some(GposOptions {
            address: ANY_PORT.into(),
            errors: args.scene.pose_errors(),
            ..GposOptions::default()
        }),
        ..WorldOptions::default()
    }
}

/// Every stage with its defaults, on the world's devices, mounted as the world's rig is.
pub fn config(args: &DemoArgs, world: &WorldOptions, addresses: &Addresses, folder: &Path) -> Result<Config, Failure> {
    let mut config = Config::full();
    config.graph.name = format!("demo-{}", std::process::id());
    config.graph.state_dir = folder.to_owned();
    config.graph.log_format = LogFormat::Human;
    let missing = |device: &str| Failure::new(4, format!("the world has no {device}"));
    for ladar in &mut config.ladars {
        ladar.address = addresses.lms151.ok_or_else(|| missing("ladar"))?.to_string();
        ladar.tilt_from_ladar = world.rig.tilt_from_ladar;
    }
    if let Some(section) = &mut config.pan_tilt {
        let terminal = addresses.pan_tilt.as_ref().ok_or_else(|| missing("pan-tilt unit"))?;
        section.address = terminal.display().to_string();
        section.mount = world.rig.vehicle_from_base;
        // The simulated unit samples its position at the delimiter itself.
        section.sample_delay_ms = 0.0;
    }
    if let Some(section) = &mut config.gpos {
        let address = addresses.gpos.ok_or_else(|| missing("position system"))?;
        section.address = format!("tcp:{address}");
        section.latency_ms = GposOptions::default().latency_s * 1e3;
    }
    if let Some(section) = &mut config.classifier {
        section.vehicle.origin_height_m = world.rig.origin_above_ground_m;
        section.traversability.ladar_height_m = world.rig.ladar_above_ground_m();
    }
    if let (Some(section), true) = (&mut config.bridge, args.headless) {
        section.listen = ANY_PORT.into();
    }
    Ok(config)
}
