//! What is measured on: recorded rays, cut to a range and grouped into scans.
//!
//! In: a ray cloud from a file or from the simulator. Out: beams in UTM, metres, in order of time.

use crate::survey::input::{self, InputError, InputOptions, Ray};
use std::path::Path;
use std::sync::Arc;
use tsense_geometry::{Global, Point, Timestamp};
use tsense_mapper::{Beam, BeamKind, Weight};
use tsense_simulator::{RayCase, RayOptions, Scene, SceneName, ray_cloud};

/// Rays that one mirror turn takes, seconds, where a file does not say: an LMS-151 at 25 Hz.
const SCAN_S: f64 = 0.04;

/// One mirror turn.
pub struct Scan {
    /// Of its first beam.
    pub stamp: Timestamp,
    /// As the map takes them.
    pub beams: Vec<Beam>,
}

/// Scans in order, and the box that holds all their beams.
pub struct Recording {
    /// What it is called in results.
    pub name: String,
    /// In order of time.
    pub scans: Vec<Scan>,
    /// Least coordinates.
    pub low: Point<Global>,
    /// Greatest coordinates.
    pub high: Point<Global>,
}

impl Recording {
    /// Reads a file.
    pub fn open(path: &Path, range_m: f64) -> Result<Self, InputError> {
        let recording = Self::of(path.display().to_string(), input::open(path, &InputOptions::default())?, range_m)?;
        match recording.beams() {
            0 => Err(InputError::new(path, "no ray in it", "there is nothing to measure")),
            _ => Ok(recording),
        }
    }

    /// Records a case in the simulator's forest; the same on every machine.
    pub fn simulated(case: RayCase, range_m: f64) -> Result<Self, InputError> {
        let (name, for_s) = match case {
            RayCase::Static => ("static", 10.0),
            RayCase::Clipped => ("clipped", 10.0),
            RayCase::Drive => ("drive", 20.0),
            RayCase::Oval => ("oval", 20.0),
        };
        let scene = Arc::new(Scene::new(SceneName::Forest, 7));
        Self::cast(name, scene, &RayOptions { case, for_s, ..RayOptions::default() }, range_m)
    }

    /// Records rays in any scene of the simulator.
    pub fn cast(name: &str, scene: Arc<Scene>, options: &RayOptions, range_m: f64) -> Result<Self, InputError> {
        let (ply, _) = ray_cloud(scene, options);
        Self::of(name.into(), input::read_ply(name, ply)?, range_m)
    }

    fn of(name: String, rays: impl Iterator<Item = Result<Ray, InputError>>, range_m: f64) -> Result<Self, InputError> {
        let (mut scans, mut low, mut high) = (Vec::<Scan>::new(), [f64::MAX; 3], [f64::MIN; 3]);
        for ray in rays {
            let ray = ray?;
            let beam = cut(&ray, range_m);
            for axis in 0..3 {
                let (a, b) = (beam.origin.to_array()[axis], beam.end.to_array()[axis]);
                (low[axis], high[axis]) = (low[axis].min(a.min(b)), high[axis].max(a.max(b)));
            }
            match scans.last_mut().filter(|scan| ray.stamp.seconds_since(scan.stamp) < SCAN_S) {
                Some(scan) => scan.beams.push(beam),
                None => scans.push(Scan { stamp: ray.stamp, beams: vec![beam] }),
            }
        }
        let corner = |[x, y, z]: [f64; 3]| Point::new(x, y, z);
        Ok(Self { name, scans, low: corner(low), high: corner(high) })
    }

    /// Beams in all.
    pub fn beams(&self) -> usize {
        self.scans.iter().map(|scan| scan.beams.len()).sum()
    }
}

/// A ray longer than the range becomes one without return, as in the peers' programs.
fn cut(ray: &Ray, range_m: f64) -> Beam {
    let way = ray.end - ray.origin;
    let keep = (range_m / way.xyz.norm().max(1e-9)).min(1.0);
    let kind = if ray.is_return && keep >= 1.0 { BeamKind::Hit } else { BeamKind::NoReturn };
    Beam { origin: ray.origin, end: ray.origin + way.scaled(keep), kind, weight: Weight::FULL }
}
