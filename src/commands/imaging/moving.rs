//! Is a person who walks over found by differencing, where, and what else is taken for one: on the simulator's scenes.
//!
//! In: a scene, a seed. Out: distances from the truth, metres, and the number of things that did not move. A tripod
//! records a person who stands, walks eight metres and stands again; the map is compared before and after.

use crate::bench::Recording;
use crate::commands::Failure;
use serde::Serialize;
use std::sync::Arc;
use tsense_classifier::imaging::{Mover, MoverSize, difference, movers};
use tsense_classifier::{View, Window};
use tsense_mapper::{Survey, VoxelMap};
use tsense_simulator::{ORIGIN_M, Person, RayOptions, Scene, SceneName};

/// How long the person stands at each end, seconds: three nods and the rest of a fourth.
const STANDS_S: f64 = 10.0;
/// The ladar's usable range, metres.
const RANGE_M: f64 = 20.0;
/// Length of a window of evidence, seconds: a nod takes 2.7.
const WINDOW_S: f64 = 2.7;
/// Edge of a voxel, metres.
const VOXEL_M: f64 = 0.15;
/// Smallest group of touching voxels that is no flicker.
const TOUCHING: usize = 4;
/// A thing within this distance of the person is the person, metres.
const SAME_M: f64 = 0.75;

/// One scene.
#[derive(Clone, Debug, Serialize)]
pub struct MovingRow {
    /// The scene.
    pub scene: &'static str,
    /// Its seed.
    pub seed: u64,
    /// Distance of the thing that came from where the person stands, metres; null where none was found.
    pub came_off_m: Option<f64>,
    /// Distance of the thing that left from where the person stood, metres.
    pub left_off_m: Option<f64>,
    /// Things that came or left elsewhere.
    pub false_things: usize,
}

/// Records the person and compares the maps.
pub fn moving(name: SceneName, seed: u64) -> Result<MovingRow, Failure> {
    let person = Person { stands_s: STANDS_S, ..Person::WALKER };
    let walk_s = (person.to_m[0] - person.from_m[0]).hypot(person.to_m[1] - person.from_m[1]) / person.speed_m_s;
    let scene = Arc::new(Scene::new(name, seed).with_person(Some(person)));
    let options = RayOptions { for_s: 2.0 * STANDS_S + walk_s, ..RayOptions::default() };
    let recording = Recording::cast(name.as_str(), scene, &options, RANGE_M).map_err(|e| Failure::new(6, e))?;
    let [before, after] = views(&recording, STANDS_S)?;
    let changes = difference(&before, &after, TOUCHING).ok_or_else(|| Failure::new(1, "the views do not compare"))?;
    let things = movers(&changes, [&before, &after], &MoverSize::default());
    let off_m = |thing: &Mover| {
        let place = if thing.came { person.to_m } else { person.from_m };
        (thing.at_m[0] - ORIGIN_M[0] - place[0]).hypot(thing.at_m[1] - ORIGIN_M[1] - place[1])
    };
    let nearest = |came| {
        things.iter().filter(|thing| thing.came == came).map(off_m).filter(|off| *off <= SAME_M).reduce(f64::min)
    };
    let (came_off_m, left_off_m) = (nearest(true), nearest(false));
    let found = usize::from(came_off_m.is_some()) + usize::from(left_off_m.is_some());
    Ok(MovingRow { scene: name.as_str(), seed, came_off_m, left_off_m, false_things: things.len() - found })
}

/// The map after `at_s` seconds and at the end, in one window.
fn views(recording: &Recording, at_s: f64) -> Result<[View; 2], Failure> {
    let failed = |e: tsense_mapper::MapError| Failure::new(2, e);
    let config = Survey::config_for(recording.low, recording.high, VOXEL_M, WINDOW_S);
    let middle = recording.low + (recording.high - recording.low).scaled(0.5);
    let map_until = |until_s: f64| -> Result<VoxelMap, Failure> {
        let mut survey = Survey::new(&config, middle).map_err(failed)?;
        for scan in recording.scans.iter().take_while(|scan| scan.stamp.ns as f64 * 1e-9 < until_s) {
            for beam in &scan.beams {
                survey.insert(scan.stamp, beam);
            }
        }
        Ok(survey.finish())
    };
    let maps: [VoxelMap; 2] = [map_until(at_s)?, map_until(f64::INFINITY)?];
    let keys = maps.iter().flat_map(|map| map.blocks().map(|(key, _)| key));
    let window = Window::covering(keys).ok_or_else(|| Failure::new(1, "the recording is too large for one view"))?;
    Ok([0, 1].map(|i| View::of_blocks(window, maps[i].grid(), maps[i].blocks(), 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_person_who_walked_over_is_found_within_a_voxel_and_nothing_else_is() {
        let row = moving(SceneName::Person, 7).unwrap();
        assert!(row.came_off_m.is_some_and(|off| off <= VOXEL_M), "{row:?}");
        assert!(row.left_off_m.is_some_and(|off| off <= VOXEL_M), "{row:?}");
        assert_eq!(row.false_things, 0);
    }
}
