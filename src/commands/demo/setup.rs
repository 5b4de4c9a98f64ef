//! What the demo sets up: a folder, a world, and the configuration of a graph that fits the world's devices.
#![allow(clippy::disallowed_methods, reason = "shell: a folder for the demo's store and log")]

use super::DemoArgs;
use crate::commands::Failure;
use crate::config::Config;
use crate::files::make_folder;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use tsense_drivers::lms151;
use tsense_geometry::Mounting;
use tsense_ports::logging::LogFormat;
use tsense_simulator::{Addresses, GposOptions, Lms151Options, PanTiltOptions, Rig, VehicleOptions, WorldOptions};

/// Any free port of this machine.
const ANY_PORT: &str = "127.0.0.1:0";

/// Ladars beside the first on the same head: name, how far to the right of the head's middle (metres), and how much higher
/// each looks than the first (degrees), so that their scans lie between one another's.
const MORE_LADARS: [(&str, f64, f64); 3] =
    [("ladar-left", -0.3, 6.0), ("ladar-right", 0.3, -6.0), ("ladar-top", 0.0, 12.0)];

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
        make_folder(&path)?;
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
        more_ladars: more_ladars(args.ladars),
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

fn more_ladars(ladars: u8) -> Vec<Lms151Options> {
    let middle = Rig::default().tilt_from_ladar;
    let more = MORE_LADARS.iter().take(usize::from(ladars.saturating_sub(1)));
    more.map(|(_, y_m, pitch_deg)| Lms151Options {
        address: ANY_PORT.into(),
        tilt_from_ladar: Some(Mounting { y_m: *y_m, pitch_deg: *pitch_deg, ..middle }),
        ..Lms151Options::default()
    })
    .collect()
}

/// The sections of the world's ladars, each mounted as the world says.
fn ladars(world: &WorldOptions, addresses: &Addresses) -> Result<Vec<lms151::config::Config>, Failure> {
    let ladar = |name: &str, address: SocketAddr, mount: Option<Mounting>| lms151::config::Config {
        name: name.into(),
        address: address.to_string(),
        tilt_from_ladar: mount.unwrap_or(world.rig.tilt_from_ladar),
        ..lms151::config::Config::default()
    };
    let first = ladar("ladar", addresses.lms151.ok_or_else(|| missing("ladar"))?, None);
    let more = MORE_LADARS.iter().zip(&world.more_ladars).zip(&addresses.more_ladars);
    let more = more.map(|(((name, ..), options), address)| ladar(name, *address, options.tilt_from_ladar));
    Ok(std::iter::once(first).chain(more).collect())
}

fn missing(device: &str) -> Failure {
    Failure::new(4, format!("the world has no {device}"))
}

/// Every stage with its defaults, on the world's devices, mounted as the world's rig is.
pub fn config(args: &DemoArgs, world: &WorldOptions, addresses: &Addresses, folder: &Path) -> Result<Config, Failure> {
    let mut config = Config::full();
    config.graph.name = format!("demo-{}", std::process::id());
    config.graph.state_dir = folder.to_owned();
    config.graph.log_format = LogFormat::Human;
    config.ladars = ladars(world, addresses)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ladar_of_the_demo_is_a_process_of_its_own_where_the_world_has_it() {
        let more = more_ladars(4);
        let world = WorldOptions { more_ladars: more.clone(), ..WorldOptions::default() };
        assert_eq!((more_ladars(1).len(), more.len()), (0, 3));
        let address = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let addresses = Addresses {
            lms151: Some(address(1)),
            more_ladars: vec![address(2), address(3), address(4)],
            ..Addresses::default()
        };
        let ladars = ladars(&world, &addresses).unwrap();
        let names: Vec<&str> = ladars.iter().map(|ladar| ladar.name.as_str()).collect();
        assert_eq!(names, ["ladar", "ladar-left", "ladar-right", "ladar-top"]);
        for (ladar, options) in ladars[1..].iter().zip(&more) {
            assert_eq!((Some(ladar.tilt_from_ladar), ladar.validate()), (options.tilt_from_ladar, vec![]));
        }
        assert_eq!(ladars[2].address, "127.0.0.1:3");
    }
}
