//! Occupied and free shares of the map over time: the thesis's figure 3-5, for a tripod and for a drive.
//!
//! In: rays of the simulator's forest. Out: counts after each second. The map is the system's by default: its working space
//! follows the ladar, windows end with the nod, confidence fades.

use super::recording::{Recording, Scan};
use crate::survey::input::InputError;
use serde::Serialize;
use std::sync::Arc;
use tsense_contract::VoxelState;
use tsense_geometry::{Global, Point};
use tsense_mapper::{Config, MapError, VoxelMap};
use tsense_simulator::{RayCase, RayOptions, Scene, SceneName, nod_turns_s};

/// Length of a recording, seconds: eleven nods. A drive of 40 m is then 1.3 m/s, 3 mph.
const FOR_S: f64 = 30.0;
/// The ladar's usable range, metres.
const RANGE_M: f64 = 20.0;
/// The middle of the working space above the ladar, metres.
const CENTER_UP_M: f64 = 0.3;

/// The map after some time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Shares {
    /// Seconds.
    pub at_s: f64,
    /// Voxels of the working space.
    pub voxels: usize,
    /// Those known to be free.
    pub free: usize,
    /// Those occupied.
    pub occupied: usize,
}

impl Shares {
    /// Of all voxels, as in the thesis.
    pub fn occupied_of_all(&self) -> f64 {
        self.occupied as f64 / self.voxels as f64
    }
    /// Of all voxels, as in the thesis.
    pub fn free_of_all(&self) -> f64 {
        self.free as f64 / self.voxels as f64
    }
    /// Of those that are known.
    pub fn occupied_of_known(&self) -> f64 {
        self.occupied as f64 / self.known().max(1) as f64
    }
    /// Free or occupied.
    pub fn known(&self) -> usize {
        self.free + self.occupied
    }
}

/// Why there are no shares.
#[derive(Debug, thiserror::Error)]
pub enum SharesError {
    /// The rays cannot be read.
    #[error(transparent)]
    Rays(#[from] InputError),
    /// There is no map.
    #[error(transparent)]
    Map(#[from] MapError),
}

/// One recording, second by second.
pub fn shares(case: RayCase) -> Result<Vec<Shares>, SharesError> {
    let options = RayOptions { case, for_s: FOR_S, ..RayOptions::default() };
    let scene = Arc::new(Scene::new(SceneName::Forest, 7));
    let recording = Recording::cast("shares", scene, &options, RANGE_M)?;
    let speed_m_s = if case == RayCase::Drive { 40.0 / FOR_S } else { 0.0 };
    let mut turns_s = nod_turns_s(&options).into_iter().peekable();
    let config = Config::default();
    let mut map = VoxelMap::new(&config)?;
    let fading = &config.fading;
    let (mut list, mut last_s) = (Vec::new(), 0.0);
    for scan in &recording.scans {
        let at_s = scan.stamp.ns as f64 * 1e-9;
        if turns_s.next_if(|turn_s| *turn_s <= at_s).is_some() {
            map.close_window();
        }
        map.fade((at_s - last_s) * (fading.per_second + fading.per_metre * speed_m_s));
        last_s = at_s;
        trace(&mut map, scan);
        if at_s >= (list.len() + 1) as f64 {
            map.fade_blocks(map.block_slots());
            list.push(count(&map, at_s, &config));
        }
    }
    Ok(list)
}

fn trace(map: &mut VoxelMap, scan: &Scan) {
    if let Some(first) = scan.beams.first() {
        let [x, y, z] = first.origin.to_array();
        map.center_on(Point::<Global>::new(x, y, z + CENTER_UP_M));
    }
    for beam in &scan.beams {
        map.insert(beam);
    }
}

/// Counts in the working space.
fn count(map: &VoxelMap, at_s: f64, config: &Config) -> Shares {
    let mut shares = Shares { at_s, voxels: 0, free: 0, occupied: 0 };
    let extent = config.working_space_m.map(|m| (m / config.voxel_size_m).round() as i32);
    let center = map.center();
    let range = |axis: usize| center[axis] - extent[axis] / 2..center[axis] + extent[axis] / 2;
    for k in range(2) {
        for j in range(1) {
            for i in range(0) {
                shares.voxels += 1;
                match map.voxel([i, j, k]).state {
                    VoxelState::Free => shares.free += 1,
                    VoxelState::Occupied => shares.occupied += 1,
                    VoxelState::Unknown => {}
                }
            }
        }
    }
    shares
}
