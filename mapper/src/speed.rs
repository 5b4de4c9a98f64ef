//! What a beam costs: run in release with `--ignored --nocapture`. Quote ratios, not nanoseconds across machines.

use crate::beams::{Beam, PlacedScan, Weight};
use crate::config::Config;
use crate::ladar_mount::LadarMount;
use crate::mapper::Mapper;
use crate::scene::{AT, Scene};
use crate::testing::{joint_at, long_scan_at, pose_at, voxel_at};
use crate::trace::InstructionSet;
use crate::voxel_map::VoxelMap;
use rustix::time::{ClockId, clock_gettime};
use tsense_contract::{Brick, SensedVoxel, Topic, VoxelState, Voxels, VoxelsHeader};
use tsense_geometry::{Point, Timestamp};

/// Processor time of this thread: other programs cost it caches, but not time.
pub fn seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

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

/// Nanoseconds a beam of one pass through all scans, windows included; voxel visits a beam; microseconds that the end of
/// the last window took.
fn pass(set: InstructionSet, config: &Config, case: &Case, scans: &[(u32, Vec<Beam>)]) -> [f64; 3] {
    let mut map = VoxelMap::new(&Config { working_space_m: case.space_m, ..config.clone() }).unwrap();
    map.use_instruction_set(set);
    map.center_on(Point::new(AT[0], AT[1] + if case.scans > 100 { 20.0 } else { 0.0 }, AT[2]));
    let (mut beams, mut visits, mut spent_s, mut closing_s) = (0, 0, 0.0, 0.0);
    // The first round touches the memory, the second is measured.
    for _ in 0..2 {
        visits = map.voxel_visits();
        let start = seconds();
        let mut sweep = 0;
        for (nod, scan) in scans {
            if *nod != sweep {
                sweep = *nod;
                map.close_window();
            }
            map.insert_all(scan);
        }
        let closing = seconds();
        map.close_window();
        closing_s = seconds() - closing;
        spent_s = seconds() - start;
        beams = scans.len() * crate::scene::BEAMS;
        visits = map.voxel_visits() - visits;
    }
    [spent_s * 1e9 / beams as f64, visits as f64 / beams as f64, closing_s * 1e6]
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
            ("every voxel, plain", &every, InstructionSet::Plain),
            ("every voxel, portable", &every, InstructionSet::Portable),
            ("every voxel, best", &every, best),
            ("default rules, best", &Config::default(), best),
        ] {
            // The least of several passes: other programs only ever add.
            let passes: Vec<_> = (0..7).map(|_| pass(set, config, &case, &scans)).collect();
            let least = passes.iter().map(|p| p[0]).fold(f64::INFINITY, f64::min);
            let mut all: Vec<_> = passes.iter().map(|p| p[0]).collect();
            all.sort_by(f64::total_cmp);
            let visits = passes[0][1];
            eprintln!(
                "{:26} {rules:22} {least:6.0} ns a beam (median {:5.0}), {visits:5.1} voxels a beam, {:5.2} ns a visit, window {:5.0} us",
                case.name,
                all[all.len() / 2],
                least / visits,
                passes[0][2]
            );
        }
    }
}

#[test]
#[ignore = "measures; run in release"]
fn measure_placing_and_snapshots() {
    let mut mapper = Mapper::new(&Config::default(), vec![LadarMount::default()], 1).unwrap();
    let (mut placing_s, mut snapshots, mut scans) = (0.0, Vec::new(), 0);
    let (mut room, mut scan) = (vec![Brick::UNKNOWN; 6250], PlacedScan::default());
    for i in 0..250 {
        let s = 1000.0 + f64::from(i) * 0.04;
        for quarter in 0..4 {
            let s = s + f64::from(quarter) * 0.01;
            mapper.add_pose(&pose_at(s, [500_000.0, 5.0e6, 100.0]));
            mapper.add_joint(&joint_at(s, -0.3 + 0.2 * (s * 0.5).sin(), (i / 75) as u32));
        }
        let (header, returns) = long_scan_at(s - 0.04);
        mapper.add_scan(0, &header, &returns, Timestamp::from_seconds(s));
        let start = seconds();
        let is_placed = mapper.placer_mut().next_placed(Timestamp::from_seconds(s), &mut scan);
        placing_s += seconds() - start;
        if is_placed {
            scans += 1;
            mapper.trace(&mut scan);
        }
        if i % 5 == 4 {
            let start = seconds();
            if let Some(context) = mapper.take_snapshot(false, Timestamp::from_seconds(s)) {
                let snapshot = mapper.snapshot();
                let sent = snapshot.publish(&context, mapper.map(), |_, len, fill| {
                    fill(&mut room[..len]);
                    Ok::<(), ()>(())
                });
                snapshots.push(((seconds() - start) * 1e6, sent, snapshot.dirty_bricks));
            }
        }
    }
    snapshots.sort_by(|a, b| a.0.total_cmp(&b.0));
    eprintln!("placing: {:.0} ns a beam ({scans} scans)", placing_s * 1e9 / f64::from(scans * 1081));
    eprintln!("snapshot of five scans: median {:?} (us, samples, bricks)", snapshots[snapshots.len() / 2]);
}

/// A whole sample of another sensor's voxels, of the map's size and of four times that.
#[test]
#[ignore = "measures; run in release"]
fn measure_sensed_voxels() {
    let items = |edge_m: f32, state| {
        let at = move |i: usize| [i % 32, i / 32 % 32, i / 1024].map(|n| (n as f32 - 16.0) * edge_m);
        (0..Voxels::ITEMS_MAX).map(move |i| SensedVoxel::new(at(i), state)).collect::<Vec<_>>()
    };
    let mut map = VoxelMap::new(&Config { working_space_m: [60.0, 60.0, 24.0], ..Config::default() }).unwrap();
    map.center_on(Point::new(AT[0], AT[1], AT[2]));
    for edge_m in [0.15, 0.6] {
        for state in [VoxelState::Free, VoxelState::Occupied] {
            let (header, items) = (voxel_at(0.0, AT, state).0, items(edge_m, state));
            let header = VoxelsHeader { voxel_size_m: f64::from(edge_m), ..header };
            let mut ms = [0.0; 2];
            // The first round touches the memory.
            for _ in 0..2 {
                let start = seconds();
                map.fuse_sensed(&header, &items, Weight::new(0.5));
                let fused = seconds();
                map.close_window();
                ms = [fused - start, seconds() - fused].map(|s| s * 1e3);
            }
            println!("{edge_m} m, {state}: {:.1} ms to fuse, {:.1} ms to end the window", ms[0], ms[1]);
        }
    }
}
