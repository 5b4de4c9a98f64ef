//! The simulated outside world on its real wires, in the test's own process, and the configuration of a graph that senses it.

use super::Folder;
use tsense_simulator::{GposOptions, Lms151Options, PanTiltOptions, World, WorldClock, WorldOptions};

/// A world whose devices listen on any free ports of this machine; it ends when this is dropped.
pub struct TestWorld {
    /// The world.
    pub world: World,
    _folder: Folder,
}

impl TestWorld {
    /// The forest, with a vehicle that stands.
    pub fn start() -> Self {
        let folder = Folder::new("world");
        let any = "127.0.0.1:0".to_owned();
        let link = folder.0.join("pan-tilt").display().to_string();
        let options = WorldOptions {
            lms151: Some(Lms151Options { address: any.clone(), spin_up_s: 0.1, ..Lms151Options::default() }),
            pan_tilt: Some(PanTiltOptions { link, ..PanTiltOptions::default() }),
            gpos: Some(GposOptions { address: any, ..GposOptions::default() }),
            ..WorldOptions::default()
        };
        let world = World::start(&options, WorldClock::starting_now(1.0)).expect("the world starts");
        Self { world, _folder: folder }
    }

    /// Every stage, on this world's devices; further lines belong to `[bridge]`.
    pub fn sections(&self) -> String {
        let addresses = self.world.addresses();
        let ladar = addresses.lms151.expect("a ladar");
        let pan_tilt = addresses.pan_tilt.as_ref().expect("a pan-tilt unit");
        let gpos = addresses.gpos.expect("a position system");
        format!(
            "[[ladar]]\naddress = \"{ladar}\"\ntilt_from_ladar = {{ x_m = 0.05, z_m = -0.1 }}\n\
             [pan_tilt]\naddress = {pan_tilt:?}\nmount = {{ x_m = 0.6, z_m = -1.7 }}\n\
             [gpos]\naddress = \"tcp:{gpos}\"\n[mapper]\n[classifier]\n[kstore]\npublish_interval_s = 0.2\n\
             [bridge]\nlisten = \"127.0.0.1:0\"\n"
        )
    }
}
