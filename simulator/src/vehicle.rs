//! The vehicle: where it truly is at any instant, standing or driving, with the attitude the ground gives it.
//!
//! In: seconds of world time after the start. Out: the true pose in UTM. It does not slip, bounce or collide; the
//! ways of a scene are clear. What the position system reports of it is the business of `gpos`.

use crate::path::{Path, Way};
use crate::scene::{DRIVE_M_S, ORIGIN_M, Scene};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use tsense_geometry::{Attitude, Global, Mounting, Point, Transform, Vehicle as VehicleFrame, global_from_vehicle};

/// Does the vehicle stand or drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// It stands at the beginning of its way.
    #[default]
    Stand,
    /// It drives along its way.
    Drive,
}

/// How the vehicle moves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleOptions {
    /// Stands or drives.
    pub motion: Motion,
    /// The way it takes, or at the beginning of which it stands.
    pub way: Way,
    /// Speed once it has accelerated, metres per second.
    pub speed_m_s: f64,
    /// Stands this long before it drives off, seconds.
    pub waits_s: f64,
}

impl Default for VehicleOptions {
    fn default() -> Self {
        Self { motion: Motion::Stand, way: Way::Oval, speed_m_s: DRIVE_M_S, waits_s: 4.0 }
    }
}

/// Where the sensors sit on the vehicle: the same numbers belong into the system's configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Rig {
    /// Height of the vehicle frame's origin above the ground it stands on, metres.
    pub origin_above_ground_m: f64,
    /// Where the pan and tilt axes cross, in the vehicle frame.
    pub vehicle_from_base: Mounting,
    /// Where the ladar sits on the tilting body.
    pub tilt_from_ladar: Mounting,
}

impl Default for Rig {
    fn default() -> Self {
        let base = Mounting { x_m: 0.6, z_m: -1.7, ..Mounting::default() };
        let ladar = Mounting { x_m: 0.05, z_m: -0.1, ..Mounting::default() };
        Self { origin_above_ground_m: 0.0, vehicle_from_base: base, tilt_from_ladar: ladar }
    }
}

impl Rig {
    /// Height of the ladar above level ground with the head level, metres.
    pub fn ladar_above_ground_m(&self) -> f64 {
        // z points down.
        self.origin_above_ground_m - self.vehicle_from_base.z_m - self.tilt_from_ladar.z_m
    }
}

/// Half the distance between the axles, metres.
const HALF_BASE_M: f64 = 1.0;
/// Half the distance between left and right wheels, metres.
const HALF_TRACK_M: f64 = 0.7;
/// How fast it reaches its speed, metres per second squared.
const ACCELERATION_M_S2: f64 = 0.5;

/// A vehicle in a scene.
#[derive(Clone, Debug)]
pub struct Vehicle {
    scene: Arc<Scene>,
    path: Path,
    options: VehicleOptions,
    origin_above_ground_m: f64,
}

impl Vehicle {
    /// A vehicle in a scene.
    pub fn new(scene: Arc<Scene>, options: VehicleOptions, rig: &Rig) -> Self {
        let origin_above_ground_m = rig.origin_above_ground_m;
        Self { scene, path: Path::new(options.way), options, origin_above_ground_m }
    }

    /// Metres driven by an instant.
    pub fn driven_m(&self, world_s: f64) -> f64 {
        if self.options.motion == Motion::Stand {
            return 0.0;
        }
        let (driving_s, speed) = ((world_s - self.options.waits_s).max(0.0), self.options.speed_m_s);
        let ramp_s = speed / ACCELERATION_M_S2;
        if driving_s < ramp_s {
            return 0.5 * ACCELERATION_M_S2 * driving_s * driving_s;
        }
        speed * (driving_s - 0.5 * ramp_s)
    }

    /// The true pose at an instant.
    pub fn pose(&self, world_s: f64) -> Transform<Global, VehicleFrame> {
        let place = self.path.at(self.driven_m(world_s));
        let (sin, cos) = place.yaw_rad.sin_cos();
        // Yaw 0 faces north: forward is (sin, cos), right is (cos, -sin).
        let wheel = |forward: f64, right: f64| {
            let x = place.x_m + forward * HALF_BASE_M * sin + right * HALF_TRACK_M * cos;
            let y = place.y_m + forward * HALF_BASE_M * cos - right * HALF_TRACK_M * sin;
            self.scene.terrain.ground_m(x, y)
        };
        let [fl, fr, rl, rr] = [wheel(1.0, -1.0), wheel(1.0, 1.0), wheel(-1.0, -1.0), wheel(-1.0, 1.0)];
        let pitch_rad = ((fl + fr - rl - rr) / (4.0 * HALF_BASE_M)).atan();
        let roll_rad = ((fl + rl - fr - rr) / (4.0 * HALF_TRACK_M)).atan();
        let attitude = Attitude { roll_rad, pitch_rad, yaw_rad: place.yaw_rad };
        let under =
            Point::new(place.x_m + ORIGIN_M[0], place.y_m + ORIGIN_M[1], (fl + fr + rl + rr) / 4.0 + ORIGIN_M[2]);
        let resting = global_from_vehicle(attitude, under);
        // The origin lies above the wheels' plane along the vehicle's own vertical.
        Transform::new(resting.isometry.rotation, resting * Point::new(0.0, 0.0, -self.origin_above_ground_m))
    }

    /// Velocity east, north, up at an instant, metres per second.
    pub fn velocity_m_s(&self, world_s: f64) -> [f64; 3] {
        let half_s = 0.02;
        let step = self.pose(world_s + half_s).origin() - self.pose(world_s - half_s).origin();
        (step.xyz / (2.0 * half_s)).into()
    }

    /// The scene it is in.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{SceneName, Terrain, TerrainSpec};
    use tsense_geometry::attitude_of;

    fn on_slope() -> Arc<Scene> {
        let spec = TerrainSpec {
            slope: 0.2,
            uphill_rad: std::f64::consts::FRAC_PI_2,
            rolling_m: 0.0,
            roughness_m: 0.0,
            grass_cover: 0.0,
            grass_m: 0.0,
            ditch: None,
        };
        Arc::new(Scene::from_parts(Terrain::new(&spec, 1), vec![], vec![], vec![], vec![]))
    }

    #[test]
    fn facing_uphill_the_nose_is_up_and_across_the_hill_it_rolls() {
        let drive = VehicleOptions { motion: Motion::Drive, ..VehicleOptions::default() };
        let vehicle = Vehicle::new(on_slope(), drive, &Rig::default());
        let north = attitude_of(&vehicle.pose(0.0));
        assert!((north.pitch_rad - 0.2f64.atan()).abs() < 1e-4 && north.roll_rad.abs() < 1e-4);
        // A quarter of the oval on it faces west: uphill (north) is to the right, so the right side is up.
        let quarter_s = 4.0 + 0.7 + 51.054 / 4.0 / 0.7;
        let west = attitude_of(&vehicle.pose(quarter_s));
        assert!((west.yaw_rad + std::f64::consts::FRAC_PI_2).abs() < 0.02, "{}", west.yaw_rad);
        assert!((west.roll_rad + 0.2f64.atan()).abs() < 0.01, "{}", west.roll_rad);
    }

    #[test]
    fn it_waits_then_drives_at_its_speed_and_its_origin_keeps_its_height() {
        let scene = Arc::new(Scene::new(SceneName::Flat, 1));
        let drive = VehicleOptions { motion: Motion::Drive, ..VehicleOptions::default() };
        let rig = Rig { origin_above_ground_m: 0.5, ..Rig::default() };
        let vehicle = Vehicle::new(scene.clone(), drive, &rig);
        assert_eq!(vehicle.driven_m(3.9), 0.0);
        assert!((vehicle.driven_m(24.0) - vehicle.driven_m(14.0) - 7.0).abs() < 1e-9);
        let [east, north, _] = vehicle.velocity_m_s(14.0);
        assert!((east.hypot(north) - 0.7).abs() < 0.01);
        let at = vehicle.pose(14.0).origin();
        assert!((at.z() - scene.ground_at_m(at.x(), at.y()).unwrap() - 0.5).abs() < 0.03);
    }
}
