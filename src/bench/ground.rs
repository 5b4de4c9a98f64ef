//! Does the ground stay and does a person go: the map's promises, measured on the simulator's scenes.
//!
//! In: scenes, a tripod or a drive. Out: a [`GroundRow`] each. Only voxels of the true ground count: hit three times in two
//! scans at least, their middle within [`NEAR_GROUND_M`] of it. Windows end with the nod, rules are the default ones.

use super::recording::{Recording, Scan};
use super::shares::SharesError;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use tsense_contract::VoxelState;
use tsense_geometry::{Point, VoxelIndex};
use tsense_mapper::{BeamKind, Config, VoxelMap};
use tsense_simulator::{Person, RayCase, RayOptions, Scene, SceneName, nod_turns_s};

/// Farthest of a ground voxel's middle from the ground, metres.
const NEAR_GROUND_M: f64 = 0.15;
/// The ladar's usable range, metres.
const RANGE_M: f64 = 20.0;
/// Length of the recordings, seconds: ten nods, and 40 m at 2 m/s.
const FOR_S: [f64; 2] = [26.5, 20.0];
/// Nods for which the person stands, and nods after that.
const PERSON_NODS: [usize; 2] = [4, 4];

/// Ground voxels of one recording.
#[derive(Clone, Debug, Serialize)]
pub struct GroundRow {
    /// The scene.
    pub scene: &'static str,
    /// The recording: `static` or `drive`.
    pub case: &'static str,
    /// Ground voxels that were hit often enough.
    pub ground: usize,
    /// Share of them that end not occupied.
    pub eroded_share: f64,
    /// Those on which nothing grows.
    pub bare: usize,
    /// Share of them that end not occupied.
    pub bare_eroded_share: f64,
}

/// A person in one scene.
#[derive(Clone, Debug, Serialize)]
pub struct PersonRow {
    /// The scene.
    pub scene: &'static str,
    /// Occupied voxels of the person: when it leaves, and after each nod without it.
    pub occupied: Vec<usize>,
    /// Of those that are left at the end: beams have ended there since, in grass or leaves.
    pub hit_again: usize,
    /// Of the others: three nods or more have seen through them. The map promises that there is none.
    pub seen_through: usize,
}

/// Hits of a voxel, scans that hit it, and the last of those.
type Seen = (u32, u32, usize);

/// Measures the ground of a scene.
pub fn ground(name: SceneName, seed: u64, case: RayCase, config: &Config) -> Result<GroundRow, SharesError> {
    let for_s = FOR_S[usize::from(case == RayCase::Drive)];
    let options = RayOptions { case, for_s, ..RayOptions::default() };
    let scene = Arc::new(Scene::new(name, seed).with_person(None));
    let recording = Recording::cast(name.as_str(), scene.clone(), &options, RANGE_M)?;
    let mut run = Run::new(&recording, &options, config)?;
    let mut seen = BTreeMap::<VoxelIndex, Seen>::new();
    for (i, scan) in recording.scans.iter().enumerate() {
        run.feed(i..i + 1);
        for beam in scan.beams.iter().filter(|beam| beam.kind == BeamKind::Hit) {
            if let Some(voxel) = run.map.grid().index_of(beam.end) {
                let entry = seen.entry(voxel).or_insert((0, 0, usize::MAX));
                *entry = (entry.0 + 1, entry.1 + u32::from(entry.2 != i), i);
            }
        }
    }
    run.map.close_window();
    let sure = seen.into_iter().filter(|(_, seen)| seen.0 >= 3 && seen.1 >= 2).map(|(voxel, _)| voxel);
    let sure: Vec<_> = sure.filter(|voxel| is_ground(&scene, &run.map, *voxel)).collect();
    let bare: Vec<_> = sure.iter().copied().filter(|voxel| is_bare(&scene, &run.map, *voxel)).collect();
    let share = |voxels: &[VoxelIndex]| {
        let lost = voxels.iter().filter(|voxel| run.map.voxel(**voxel).state != VoxelState::Occupied).count();
        lost as f64 / voxels.len().max(1) as f64
    };
    Ok(GroundRow {
        scene: name.as_str(),
        case: if case == RayCase::Drive { "drive" } else { "static" },
        ground: sure.len(),
        eroded_share: share(&sure),
        bare: bare.len(),
        bare_eroded_share: share(&bare),
    })
}

fn is_ground(scene: &Scene, map: &VoxelMap, voxel: VoxelIndex) -> bool {
    let [x, y, z] = map.grid().center_of(voxel).to_array();
    scene.ground_at_m(x, y).is_some_and(|ground_m| (z - ground_m).abs() <= NEAR_GROUND_M)
}

/// Nothing grows within a voxel, and neither rock nor wall stands there.
fn is_bare(scene: &Scene, map: &VoxelMap, voxel: VoxelIndex) -> bool {
    let ([x, y, _], size_m) = (map.grid().center_of(voxel).to_array(), map.grid().size_m());
    let around = [[0.0, 0.0], [size_m, 0.0], [-size_m, 0.0], [0.0, size_m], [0.0, -size_m]];
    around.iter().all(|[dx, dy]| scene.brush_at_m(x + dx, y + dy) == 0.0 && !scene.is_covered(x + dx, y + dy))
}

/// Lets a person leave and counts what stays of it.
pub fn person(name: SceneName, seed: u64, config: &Config) -> Result<PersonRow, SharesError> {
    // A nod takes at most 2.7 s.
    let for_s = 2.7 * (PERSON_NODS[0] + PERSON_NODS[1] + 1) as f64;
    let options = RayOptions { for_s, ..RayOptions::default() };
    let leaves_s = nod_turns_s(&options).get(PERSON_NODS[0] - 1).copied().unwrap_or(0.0);
    let stands = Person { leaves_at_s: Some(leaves_s), ..Person::STANDING };
    let scene = Scene::new(name, seed);
    let [x, y] = stands.from_m;
    let feet = scene.to_global(nalgebra::Vector3::new(x, y, 0.0));
    let ground_m = scene.ground_at_m(feet.x(), feet.y()).unwrap_or(0.0);
    let without = Recording::cast(name.as_str(), Arc::new(scene.clone().with_person(None)), &options, RANGE_M)?;
    let with = Recording::cast(name.as_str(), Arc::new(scene.with_person(Some(stands))), &options, RANGE_M)?;
    let (mut empty, mut run) = (Run::new(&without, &options, config)?, Run::new(&with, &options, config)?);
    for _ in 0..PERSON_NODS[0] {
        empty.feed_a_nod();
        run.feed_a_nod();
    }
    // Feet stand on the ground, and grass stays.
    let body: Vec<VoxelIndex> = box_around(&run.map, [feet.x(), feet.y(), ground_m])
        .into_iter()
        .filter(|voxel| run.map.voxel(*voxel).state == VoxelState::Occupied)
        .filter(|voxel| empty.map.voxel(*voxel).state != VoxelState::Occupied)
        .collect();
    let (mut occupied, mut nods) = (vec![body.len()], Vec::new());
    for _ in 0..PERSON_NODS[1] {
        let left_at = run.scans;
        run.feed_a_nod();
        nods.push(&with.scans[left_at..run.scans]);
        occupied.push(body.iter().filter(|voxel| run.map.voxel(**voxel).state == VoxelState::Occupied).count());
    }
    let hits = nods.iter().copied().flatten().flat_map(|scan| &scan.beams);
    let hits: BTreeSet<_> =
        hits.filter(|beam| beam.kind == BeamKind::Hit).filter_map(|beam| run.map.grid().index_of(beam.end)).collect();
    let left = body.into_iter().filter(|voxel| run.map.voxel(*voxel).state == VoxelState::Occupied);
    let (again, others): (Vec<_>, Vec<_>) = left.partition(|voxel| hits.contains(voxel));
    let often = |voxel: &&VoxelIndex| nods.iter().filter(|nod| is_seen_through(&run.map, nod, **voxel)).count() >= 3;
    Ok(PersonRow {
        scene: name.as_str(),
        occupied,
        hit_again: again.len(),
        seen_through: others.iter().filter(often).count(),
    })
}

/// Whether a beam of a nod passes a quarter of a voxel or less from a voxel's middle and ends two voxels beyond or farther.
fn is_seen_through(map: &VoxelMap, nod: &[Scan], voxel: VoxelIndex) -> bool {
    let (center, size_m) = (map.grid().center_of(voxel), map.grid().size_m());
    nod.iter().flat_map(|scan| &scan.beams).any(|beam| {
        let (along, to_center) = (beam.end - beam.origin, center - beam.origin);
        let at_m = to_center.xyz.dot(&along.xyz) / along.xyz.norm();
        let beside_m = (to_center.xyz.norm_squared() - at_m * at_m).max(0.0).sqrt();
        at_m >= 0.0 && at_m + 2.0 * size_m <= along.xyz.norm() && beside_m <= 0.25 * size_m
    })
}

/// Voxels of a person whose feet are here, 0.3 m above ground and higher.
fn box_around(map: &VoxelMap, [x, y, z]: [f64; 3]) -> Vec<VoxelIndex> {
    let index = |x, y, z| map.grid().index_of(Point::new(x, y, z)).unwrap_or_default();
    let (low, high) = (index(x - 0.4, y - 0.4, z + 0.3), index(x + 0.4, y + 0.4, z + 1.8));
    let [xs, ys, zs]: [_; 3] = std::array::from_fn(|axis| low[axis]..=high[axis]);
    zs.flat_map(|k| ys.clone().flat_map(move |j| (low[0]..=high[0]).map(move |i| [i, j, k])))
        .filter(|voxel| xs.contains(&voxel[0]))
        .collect()
}

/// A map being fed with a recording.
struct Run<'a> {
    recording: &'a Recording,
    turns_s: Vec<f64>,
    map: VoxelMap,
    scans: usize,
    turns: usize,
}

impl<'a> Run<'a> {
    fn new(recording: &'a Recording, options: &RayOptions, config: &Config) -> Result<Self, SharesError> {
        let extent = (recording.high - recording.low).xyz;
        let working_space_m = std::array::from_fn(|axis| extent[axis] + 1.0);
        let mut map = VoxelMap::new(&Config { working_space_m, ..config.clone() })?;
        map.center_on(recording.low + (recording.high - recording.low).scaled(0.5));
        Ok(Self { recording, turns_s: nod_turns_s(options), map, scans: 0, turns: 0 })
    }

    /// Whether a nod ends before a scan.
    fn turns_before(&self, scan: usize) -> bool {
        let at_s = self.recording.scans[scan].stamp.ns as f64 * 1e-9;
        self.turns_s.get(self.turns).is_some_and(|turn_s| *turn_s <= at_s)
    }

    fn feed(&mut self, scans: std::ops::Range<usize>) {
        for i in scans {
            if self.turns_before(i) {
                self.turns += 1;
                self.map.close_window();
            }
            for beam in &self.recording.scans[i].beams {
                self.map.insert(beam);
            }
            self.scans = i + 1;
        }
    }

    /// Up to the end of a nod, its window closed.
    fn feed_a_nod(&mut self) {
        while self.scans < self.recording.scans.len() && !self.turns_before(self.scans) {
            self.feed(self.scans..self.scans + 1);
        }
        self.turns += 1;
        self.map.close_window();
    }
}
