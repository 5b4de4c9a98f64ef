//! Ray clouds of a scene, faster than real time: what a scanner on a tripod or a driving vehicle would record.
//!
//! Out: binary little-endian PLY, one vertex a ray: x y z (double, UTM, the end point), time (double, s), nx ny nz (float,
//! from the end point back to the sensor), red green blue alpha (uchar); alpha 0 is a ray without a return, whose end
//! lies at the longest range (or, clipped, on the border of the space). Beams that were dazzled or too weak tell
//! nothing about the space they crossed and are left out. The same scene and options give the same bytes.

use crate::cast::{BeamReturn, Code, Optics};
use crate::lms151::ScanShape;
use crate::pan_tilt::{Dynamics, Head};
use crate::path::{Path, Way};
use crate::scene::{ORIGIN_M, Ray, Scene};
use crate::vehicle::{Motion, Rig, Vehicle, VehicleOptions};
use crate::view::View;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use tsense_geometry::{Mounting, Timestamp};

/// Which recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RayCase {
    /// A tripod that stands.
    #[default]
    Static,
    /// The same, every ray clipped to 30 x 30 x 12 m around the tripod.
    Clipped,
    /// A drive of 40 m.
    Drive,
    /// A drive once round the oval, 51 m.
    Oval,
}

impl std::str::FromStr for RayCase {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "static" => Ok(Self::Static),
            "clipped" => Ok(Self::Clipped),
            "drive" => Ok(Self::Drive),
            "oval" => Ok(Self::Oval),
            _ => Err(format!("no case is called '{text}'; there are static, clipped, drive, oval")),
        }
    }
}

/// How a ray cloud is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RayOptions {
    /// Which recording.
    pub case: RayCase,
    /// Its length, seconds; a drive takes this long for its way.
    pub for_s: f64,
    /// Lowest and highest tilt of the nod, degrees.
    pub tilt_deg: [f64; 2],
    /// Speed of the nod, degrees per second.
    pub nod_deg_s: f64,
    /// What the scanner's light can do.
    pub optics: Optics,
}

impl Default for RayOptions {
    fn default() -> Self {
        Self { case: RayCase::Static, for_s: 10.0, tilt_deg: [-35.0, 15.0], nod_deg_s: 20.0, optics: Optics::default() }
    }
}

/// What a ray cloud holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RayCounts {
    /// Rays written.
    pub rays: usize,
    /// Those with a return.
    pub returns: usize,
    /// Beams left out: dazzled or too weak.
    pub left_out: usize,
}

/// 1081 beams at 25 Hz: about 27,000 a second.
const SHAPE: ScanShape = ScanShape { frequency_centihz: 2500, step_e4deg: 2500 };
/// Half extents of the clipped space east and north, and how far it reaches below and above the tripod's foot, metres.
const CLIP_HALF_M: f64 = 15.0;
const CLIP_BELOW_M: f64 = 3.0;
const CLIP_ABOVE_M: f64 = 9.0;

/// The PLY file of a recording, as bytes, and what it holds. 48 bytes a ray: 13 MB for ten seconds.
pub fn ray_cloud(scene: Arc<Scene>, options: &RayOptions) -> (Vec<u8>, RayCounts) {
    let view = standing_or_driving(scene, options);
    let mut nod = Nod::new(options);
    let scans = (options.for_s / SHAPE.period_s()).floor().max(0.0) as u64;
    let mut cloud = Cloud { vertices: Vec::new(), counts: RayCounts::default(), clip: clip_box(&view, options) };
    for turn in 0..scans {
        for index in 0..SHAPE.beams() {
            let at_s = turn as f64 * SHAPE.period_s() + index as f64 * SHAPE.beam_interval_s();
            let beam = view.beam(at_s, nod.angles(at_s), SHAPE.angle_rad(index));
            let back = view.measure(&options.optics, &beam, at_s, turn, index);
            cloud.add(&beam, &back, at_s, options.optics.range_max_m);
        }
    }
    (cloud.file(), cloud.counts)
}

/// Instants at which the nod of a recording turns round, seconds: where windows of evidence by sweep end.
pub fn nod_turns_s(options: &RayOptions) -> Vec<f64> {
    let (mut nod, mut turns_s) = (Nod::new(options), Vec::new());
    let scans = (options.for_s / SHAPE.period_s()).floor().max(0.0) as u64;
    for turn in 0..scans {
        for index in 0..SHAPE.beams() {
            let (at_s, before) = (turn as f64 * SHAPE.period_s() + index as f64 * SHAPE.beam_interval_s(), nod.next);
            nod.angles(at_s);
            if nod.next != before && at_s > 0.0 {
                turns_s.push(at_s);
            }
        }
    }
    turns_s
}

fn standing_or_driving(scene: Arc<Scene>, options: &RayOptions) -> View {
    let (drives, way, length_m) = match options.case {
        RayCase::Static | RayCase::Clipped => (false, Way::Oval, 0.0),
        RayCase::Drive => (true, Way::Line, 40.0),
        RayCase::Oval => (true, Way::Oval, Path::new(Way::Oval).length_m()),
    };
    // A tripod's scanner is 1.6 m above ground, a vehicle's 1.8 m.
    let tripod = Rig {
        origin_above_ground_m: 0.0,
        vehicle_from_base: Mounting { z_m: -1.5, ..Mounting::default() },
        tilt_from_ladar: Mounting { z_m: -0.1, ..Mounting::default() },
    };
    let rig = if drives { Rig::default() } else { tripod };
    let motion = if drives { Motion::Drive } else { Motion::Stand };
    let vehicle = VehicleOptions { motion, way, speed_m_s: length_m / options.for_s.max(1.0), waits_s: 0.0 };
    View { vehicle: Vehicle::new(scene.clone(), vehicle, &rig), scene, rig }
}

fn clip_box(view: &View, options: &RayOptions) -> Option<[Vector3<f64>; 2]> {
    let foot = view.scene.to_local(view.vehicle.pose(0.0).origin());
    let low = foot - Vector3::new(CLIP_HALF_M, CLIP_HALF_M, CLIP_BELOW_M);
    let high = foot + Vector3::new(CLIP_HALF_M, CLIP_HALF_M, CLIP_ABOVE_M);
    (options.case == RayCase::Clipped).then_some([low, high])
}

/// The nodding head, moved as a host moves it: to one limit, then to the other.
struct Nod {
    head: Head,
    limits: [f64; 2],
    next: usize,
    dynamics: Dynamics,
}

impl Nod {
    fn new(options: &RayOptions) -> Self {
        let head = Head::new(46.2857);
        let positions = |deg: f64| head.positions(deg.to_radians());
        let limits = options.tilt_deg.map(positions);
        // 100 degrees per second squared: a turn takes 0.4 s at 20 degrees a second.
        let dynamics = Dynamics { base: 0.0, acceleration: positions(100.0), speed: positions(options.nod_deg_s) };
        Self { head, limits, next: 0, dynamics }
    }

    fn angles(&mut self, at_s: f64) -> tsense_geometry::PanTiltAngles {
        let at = Timestamp::from_seconds(at_s);
        if at >= self.head.axes[1].arrival() {
            self.head.axes[1].go_to(at, self.limits[self.next], &self.dynamics);
            self.next = 1 - self.next;
        }
        self.head.angles(at)
    }
}

struct Cloud {
    vertices: Vec<u8>,
    counts: RayCounts,
    clip: Option<[Vector3<f64>; 2]>,
}

impl Cloud {
    fn add(&mut self, beam: &Ray, back: &BeamReturn, at_s: f64, range_max_m: f64) {
        let (mut range_m, mut is_return) = match back {
            BeamReturn::Echoes { strongest, .. } => (strongest.range_m, true),
            BeamReturn::Nothing(Code::NoReturn) => (range_max_m, false),
            BeamReturn::Nothing(_) => {
                self.counts.left_out += 1;
                return;
            }
        };
        if let Some(leave_m) = self.clip.map(|clip| leaves(beam, &clip)).filter(|l| *l < range_m) {
            (range_m, is_return) = (leave_m, false);
        }
        let (end, back) = (beam.at(range_m), beam.direction * -range_m);
        for (c, origin) in end.iter().zip(ORIGIN_M) {
            self.vertices.extend_from_slice(&(c + origin).to_le_bytes());
        }
        self.vertices.extend_from_slice(&at_s.to_le_bytes());
        for c in back.iter() {
            self.vertices.extend_from_slice(&(*c as f32).to_le_bytes());
        }
        self.vertices.extend_from_slice(&[200, 200, 200, if is_return { 255 } else { 0 }]);
        self.counts.rays += 1;
        self.counts.returns += usize::from(is_return);
    }

    fn file(&self) -> Vec<u8> {
        let properties = ["double x", "double y", "double z", "double time", "float nx", "float ny", "float nz"];
        let colours = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
        let mut header =
            format!("ply\nformat binary_little_endian 1.0\ncomment ray cloud\nelement vertex {}\n", self.counts.rays);
        for property in properties.iter().chain(&colours) {
            header.push_str(&format!("property {property}\n"));
        }
        header.push_str("end_header\n");
        [header.as_bytes(), &self.vertices].concat()
    }
}

/// The range at which a beam from inside leaves a box.
fn leaves(beam: &Ray, [low, high]: &[Vector3<f64>; 2]) -> f64 {
    let axis = |i: usize| {
        let d = beam.direction[i];
        let wall = if d > 0.0 { high[i] } else { low[i] };
        if d == 0.0 { f64::INFINITY } else { (wall - beam.origin[i]) / d }
    };
    axis(0).min(axis(1)).min(axis(2)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SceneName;

    fn cloud(case: RayCase, seed: u64) -> (Vec<u8>, RayCounts) {
        let scene = Arc::new(Scene::new(SceneName::Forest, seed));
        ray_cloud(scene, &RayOptions { case, for_s: 0.3, ..RayOptions::default() })
    }

    fn vertices(file: &[u8]) -> &[u8] {
        let end = b"end_header\n";
        let at = file.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        &file[at..]
    }

    #[test]
    fn the_same_seed_writes_the_same_bytes_and_another_seed_others() {
        assert_eq!(cloud(RayCase::Static, 7).0, cloud(RayCase::Static, 7).0);
        assert_ne!(cloud(RayCase::Static, 7).0, cloud(RayCase::Static, 8).0);
    }

    #[test]
    fn the_header_counts_the_rays_and_every_ray_leads_back_to_the_sensor() {
        let (file, counts) = cloud(RayCase::Static, 7);
        let text = String::from_utf8_lossy(&file[..120]);
        assert!(text.contains(&format!("element vertex {}\n", counts.rays)), "{text}");
        assert_eq!(vertices(&file).len(), counts.rays * 48);
        // Level beams in a forest: most pass between the trees.
        assert!(counts.returns * 6 > counts.rays && counts.returns < counts.rays, "{counts:?}");
        let f64_at = |v: &[u8], i: usize| f64::from_le_bytes(v[i..i + 8].try_into().unwrap());
        let f32_at = |v: &[u8], i: usize| f64::from(f32::from_le_bytes(v[i..i + 4].try_into().unwrap()));
        for vertex in vertices(&file).chunks(48) {
            // The tripod stands at the oval's eastern end; its head nods about an axis 0.1 m below the scanner.
            let (e, n) = (f64_at(vertex, 0) + f32_at(vertex, 32), f64_at(vertex, 8) + f32_at(vertex, 36));
            assert!((e - ORIGIN_M[0] - 10.0).abs() < 0.2 && (n - ORIGIN_M[1]).abs() < 0.2, "{e} {n}");
        }
    }

    #[test]
    fn a_nod_takes_its_angle_and_its_turn() {
        let turns_s = nod_turns_s(&RayOptions { for_s: 8.0, ..RayOptions::default() });
        // 35 degrees down first, then 50 up and down, at 20 degrees a second and 0.2 s to start and stop.
        for (turn_s, expected_s) in turns_s.iter().zip([1.95, 4.65, 7.35]) {
            assert!((turn_s - expected_s).abs() < 0.05, "{turns_s:?}");
        }
        assert_eq!(turns_s.len(), 3);
    }

    #[test]
    fn clipped_rays_end_inside_the_space() {
        let (file, counts) = cloud(RayCase::Clipped, 7);
        assert!(counts.returns > 0 && counts.returns < counts.rays);
        for vertex in vertices(&file).chunks(48) {
            let east = f64::from_le_bytes(vertex[0..8].try_into().unwrap()) - ORIGIN_M[0] - 10.0;
            assert!(east.abs() < CLIP_HALF_M + 1e-6, "{east}");
        }
    }
}
