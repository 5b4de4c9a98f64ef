//! Synthetic scans for the tests: sloping ground and a person, seen by a nodding LMS-151.
//!
//! 1081 beams over 270 degrees, 25 scans a second, a nod of 20 degrees a second between two tilts, 12 mm noise, thin
//! beams. Not the simulator: a plane, a cylinder and a few lines, so that the map's figures stand on their own.

use crate::beams::{Beam, BeamKind, Weight};
use crate::testing::Random;
use tsense_geometry::{
    Attitude, Global, Ladar, PanTiltAngles, Point, Timestamp, Transform, Vector, beam_direction, global_from_vehicle,
    vehicle_from_ladar,
};

pub const BEAMS: usize = 1081;
const SCAN_S: f64 = 0.04;
const NOD_RAD_S: f64 = 20.0 * std::f64::consts::PI / 180.0;
const NOISE_M: f64 = 0.012;
const RANGE_MAX_M: f64 = 20.0;
const NO_RETURN_M: f64 = 10.0;
/// Far from the UTM origin, where an f32 would step by a quarter of a metre.
pub const AT: [f64; 3] = [500_003.1, 5_412_007.7, 212.4];

/// A vertical cylinder that stands on the ground.
#[derive(Clone, Copy)]
pub struct Person {
    pub east_m: f64,
    pub north_m: f64,
    pub radius_m: f64,
    pub height_m: f64,
}

#[derive(Clone, Copy)]
pub struct Scene {
    /// Rise of the ground per metre east.
    pub slope: f64,
    pub ladar_height_m: f64,
    /// Speed north.
    pub speed_m_s: f64,
    /// Lowest and highest tilt of the nod.
    pub tilts_deg: [f64; 2],
    pub person: Option<Person>,
    /// A wall without end across the view, this far north of the start.
    pub wall_m: Option<f64>,
}

impl Scene {
    pub fn tripod() -> Self {
        Self { slope: 0.1, ladar_height_m: 1.7, speed_m_s: 0.0, tilts_deg: [-40.0, 20.0], person: None, wall_m: None }
    }

    pub fn sweep_s(&self) -> f64 {
        (self.tilts_deg[1] - self.tilts_deg[0]).to_radians() / NOD_RAD_S
    }

    pub fn scans_per_sweep(&self) -> usize {
        (self.sweep_s() / SCAN_S).round() as usize
    }

    fn tilt_rad(&self, t_s: f64) -> f64 {
        let phase = (t_s / self.sweep_s()).rem_euclid(2.0);
        let up = if phase < 1.0 { phase } else { 2.0 - phase };
        (self.tilts_deg[0] + up * (self.tilts_deg[1] - self.tilts_deg[0])).to_radians()
    }

    fn ground_m(&self, east_m: f64) -> f64 {
        AT[2] + self.slope * (east_m - AT[0])
    }

    fn ladar_at(&self, t_s: f64) -> Transform<Global, Ladar> {
        let place = Point::new(AT[0], AT[1] + self.speed_m_s * t_s, AT[2] + self.ladar_height_m);
        let angles = PanTiltAngles { pan_rad: 0.0, tilt_rad: self.tilt_rad(t_s) };
        global_from_vehicle(Attitude::default(), place)
            * vehicle_from_ladar(Transform::identity(), angles, Transform::identity())
    }

    /// Scan number `i`: its stamp, its nod and its beams.
    pub fn scan(&self, i: usize) -> (Timestamp, u32, Vec<Beam>) {
        // A mirror turn and a nod that are no multiples of each other: no two sweeps see the same.
        let start_s = i as f64 * SCAN_S * 1.000_7;
        let mut random = Random(i as u64);
        let beam = |b: usize| {
            let t_s = start_s + b as f64 * SCAN_S / 1440.0;
            let here = self.ladar_at(t_s);
            let angle_rad = (-45.0 + 0.25 * b as f64).to_radians();
            self.beam(here.origin(), here * beam_direction(angle_rad), &mut random)
        };
        let beams = (0..BEAMS).map(beam).collect();
        (Timestamp::from_seconds(1000.0 + start_s), (start_s / self.sweep_s()) as u32, beams)
    }

    fn beam(&self, origin: Point<Global>, direction: Vector<Global>, random: &mut Random) -> Beam {
        let range_m = self.range_m(origin, direction) + NOISE_M * random.gauss();
        let (kind, length_m) = match range_m {
            r if r <= RANGE_MAX_M => (BeamKind::Hit, r),
            r if r.is_finite() => (BeamKind::NoReturn, RANGE_MAX_M),
            _ => (BeamKind::NoReturn, NO_RETURN_M),
        };
        Beam { origin, end: origin + direction.scaled(length_m), kind, weight: Weight::FULL }
    }

    fn range_m(&self, origin: Point<Global>, direction: Vector<Global>) -> f64 {
        let sinks = self.slope * direction.xyz.x - direction.xyz.z;
        let above_m = origin.z() - self.ground_m(origin.x());
        let ground_m = if sinks > 0.0 { above_m / sinks } else { f64::INFINITY };
        // The ladar's own range: 50 m.
        let ground_m = if ground_m > 50.0 { f64::INFINITY } else { ground_m };
        let wall_m = self.wall_m.map_or(f64::INFINITY, |wall_m| (AT[1] + wall_m - origin.y()) / direction.xyz.y);
        let wall_m = if wall_m > 0.0 { wall_m } else { f64::INFINITY };
        self.person_m(origin, direction).unwrap_or(f64::INFINITY).min(ground_m).min(wall_m)
    }

    fn person_m(&self, origin: Point<Global>, direction: Vector<Global>) -> Option<f64> {
        let person = self.person?;
        let d = direction.xyz;
        let (x, y) = (origin.x() - person.east_m, origin.y() - person.north_m);
        let (a, b, c) = (d.x * d.x + d.y * d.y, x * d.x + y * d.y, x * x + y * y - person.radius_m.powi(2));
        let root = b * b - a * c;
        let range_m = (root >= 0.0 && a > 0.0).then(|| (-b - root.sqrt()) / a)?;
        let height_m = origin.z() + range_m * d.z - self.ground_m(person.east_m);
        (range_m > 0.0 && (0.0..person.height_m).contains(&height_m)).then_some(range_m)
    }
}
