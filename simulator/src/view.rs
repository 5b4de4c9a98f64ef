//! Where a beam starts and points: the vehicle's pose, the head's angles and the two constant transforms, all at the
//! beam's own instant. Thesis (2-7) to (2-10), the other way round from the mapper.

use crate::cast::{BeamReturn, Optics};
use crate::rng::hash;
use crate::scene::{Ray, Scene};
use crate::vehicle::{Rig, Vehicle};
use std::sync::Arc;
use tsense_geometry::{Mounting, PanTiltAngles, Point, beam_direction, vehicle_from_ladar};

/// A ladar on a head on a vehicle in a scene.
#[derive(Clone, Debug)]
pub(crate) struct View {
    pub scene: Arc<Scene>,
    pub vehicle: Vehicle,
    pub rig: Rig,
}

impl View {
    /// A beam of the rig's ladar at a device angle, in the scene's own metres.
    pub fn beam(&self, world_s: f64, joint: PanTiltAngles, angle_rad: f64) -> Ray {
        self.beam_of(&self.rig.tilt_from_ladar, world_s, joint, angle_rad)
    }

    /// The same of a ladar that sits elsewhere on the head.
    pub fn beam_of(&self, tilt_from_ladar: &Mounting, world_s: f64, joint: PanTiltAngles, angle_rad: f64) -> Ray {
        // Thesis (2-10)
        let ladar = vehicle_from_ladar(self.rig.vehicle_from_base.transform(), joint, tilt_from_ladar.transform());
        let global_from_ladar = self.vehicle.pose(world_s) * ladar;
        let origin = self.scene.to_local(global_from_ladar * Point::new(0.0, 0.0, 0.0));
        Ray { origin, direction: (global_from_ladar * beam_direction(angle_rad)).xyz }
    }

    /// What comes of a beam; `turn` and `index` name it, so that the same beam of the same seed always ends alike.
    pub fn measure(&self, optics: &Optics, beam: &Ray, world_s: f64, turn: u64, index: usize) -> BeamReturn {
        let chance = hash(&[self.scene.seed(), turn, index as u64]);
        self.scene.cast(optics, beam, chance, self.scene.figure(world_s).as_ref())
    }
}
