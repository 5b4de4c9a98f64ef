//! What a beam costs: run in release with `--ignored --nocapture`. Quote ratios, not nanoseconds across machines.
#![allow(clippy::disallowed_methods, reason = "measures time; no test of behaviour")]

use crate::beams::Beam;
use crate::config::Config;
use crate::scene::{AT, Scene};
use crate::trace::InstructionSet;
use crate::voxel_map::VoxelMap;
use std::time::Instant;
use tsense_geometry::Point;

struct Case {
    name: &'static str,
    scene: Scene,
    space_m: [f64; 3],
    scans: usize,
}

fn cases() -> [Case; 3] {
    let still = Scene::tripod();
    let drive = Scene { speed_m_s: 2.0, ..still };
    [
        Case { name: "A tripod", scene: still, space_m: [60.0, 60.0, 24.0], scans: 75 },
        Case { name: "B tripod, 30 x 30 x 12 m", scene: still, space_m: [30.0, 30.0, 12.0], scans: 75 },
        Case { name: "C 40 m drive", scene: drive, space_m: [60.0, 100.0, 24.0], scans: 500 },
    ]
}

/// Nanoseconds a beam of one pass through all scans, windows included, and voxel visits a beam.
fn pass(set: InstructionSet, config: &Config, case: &Case, scans: &[(u32, Vec<Beam>)]) -> (f64, f64) {
    let mut map = VoxelMap::new(&Config { working_space_m: case.space_m, ..config.clone() }).unwrap();
    map.use_instruction_set(set);
    map.center_on(Point::new(AT[0], AT[1] + if case.scans > 100 { 20.0 } else { 0.0 }, AT[2]));
    let (mut beams, mut visits, mut spent_s) = (0, 0, 0.0);
    // The first round touches the memory, the second is measured.
    for _ in 0..2 {
        visits = map.voxel_visits();
        let start = Instant::now();
        let mut sweep = 0;
        for (nod, scan) in scans {
            if *nod != sweep {
                sweep = *nod;
                map.close_window();
            }
            for beam in scan {
                map.insert(beam);
            }
        }
        map.close_window();
        spent_s = start.elapsed().as_secs_f64();
        beams = scans.len() * crate::scene::BEAMS;
        visits = map.voxel_visits() - visits;
    }
    (spent_s * 1e9 / beams as f64, visits as f64 / beams as f64)
}

#[test]
#[ignore = "measures; run in release"]
fn measure_beams() {
    let mut every = Config::default();
    let e = &mut every.evidence;
    (e.spare_voxels, e.chord_min_voxels, e.grazing_spare_share) = (0.0, 0.0, 0.0);
    for case in cases() {
        let scans: Vec<_> = (0..case.scans).map(|i| case.scene.scan(i)).map(|(_, nod, beams)| (nod, beams)).collect();
        let best = InstructionSet::best();
        for (rules, config, set) in [
            ("every voxel, portable", &every, InstructionSet::Portable),
            ("every voxel, best", &every, best),
            ("default rules, best", &Config::default(), best),
        ] {
            // The least of several passes: other programs only ever add.
            let passes: Vec<_> = (0..7).map(|_| pass(set, config, &case, &scans)).collect();
            let least = passes.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
            let mut all: Vec<_> = passes.iter().map(|p| p.0).collect();
            all.sort_by(f64::total_cmp);
            let visits = passes[0].1;
            eprintln!(
                "{:26} {rules:22} {least:6.0} ns a beam (median {:5.0}), {visits:5.1} voxels a beam, {:5.2} ns a visit",
                case.name,
                all[all.len() / 2],
                least / visits
            );
        }
    }
}
