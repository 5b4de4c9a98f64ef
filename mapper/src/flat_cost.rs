//! Does a beam cost the same in a large window and in a map that has grown? Figures are in `mapper/EVIDENCE.md`.

use crate::beams::Beam;
use crate::config::Config;
use crate::scene::{AT, BEAMS, Scene};
use crate::speed::seconds;
use crate::voxel_map::VoxelMap;
use tsense_geometry::Point;

/// Windows of this width, metres.
const WIDTHS_M: [f64; 2] = [30.0, 300.0];
const ROUNDS: usize = 9;
/// Metres of the drive, and its speed.
const DRIVE_M: f64 = 1000.0;
const SPEED_M_S: f64 = 10.0;

fn map_of(width_m: f64) -> VoxelMap {
    let mut map = VoxelMap::new(&Config { working_space_m: [width_m, width_m, 12.0], ..Config::default() }).unwrap();
    map.center_on(Point::new(AT[0], AT[1], AT[2] + 2.0));
    map
}

/// A beam that stays within the small window, so that both windows do the same work.
fn is_inside(beam: &Beam) -> bool {
    let reach = WIDTHS_M[0] / 2.0 - 0.5;
    let [x, y, z] = beam.end.to_array();
    (x - AT[0]).abs() < reach && (y - AT[1]).abs() < reach && (z - AT[2] - 2.0).abs() < 5.5
}

fn median(mut list: Vec<f64>) -> f64 {
    list.sort_by(f64::total_cmp);
    list[list.len() / 2]
}

/// Nanoseconds a beam of three nods, their ends included.
fn pass(map: &mut VoxelMap, nods: &[Vec<Beam>]) -> f64 {
    let start = seconds();
    for beams in nods {
        for beam in beams {
            map.insert(beam);
        }
        map.close_window();
    }
    (seconds() - start) * 1e9 / nods.iter().map(Vec::len).sum::<usize>() as f64
}

#[test]
#[ignore = "measures; seconds"]
fn measure_window_sizes() {
    let scene = Scene::tripod();
    let per_sweep = scene.scans_per_sweep();
    let nod = |n: usize| (n * per_sweep..(n + 1) * per_sweep).flat_map(|i| scene.scan(i).2).filter(is_inside).collect();
    let nods: Vec<Vec<Beam>> = (0..3).map(nod).collect();
    let mut maps = WIDTHS_M.map(map_of);
    for map in &mut maps {
        pass(map, &nods);
    }
    let (mut ns, mut ratios) = ([Vec::new(), Vec::new()], Vec::new());
    for _ in 0..ROUNDS {
        let round = [0, 1].map(|i| pass(&mut maps[i], &nods));
        ratios.push(round[1] / round[0]);
        (0..2).for_each(|i| ns[i].push(round[i]));
    }
    assert_eq!(maps[0].voxel_visits(), maps[1].voxel_visits());
    let ([small, large], ratio) = (ns.map(median), median(ratios));
    eprintln!("30 m: {small:.0} ns a beam; 300 m: {large:.0} ns a beam; median ratio of a round {ratio:.3}");
    assert!(ratio < 1.2, "{ratio}");
}

#[test]
#[ignore = "measures; a minute"]
fn measure_a_drive_of_a_kilometre() {
    let scene = Scene { speed_m_s: SPEED_M_S, ..Scene::tripod() };
    let mut map = map_of(WIDTHS_M[0]);
    let scans = (DRIVE_M / SPEED_M_S * 25.0) as usize;
    let (mut quarters, mut sweep) = ([0.0; 4], 0);
    for i in 0..scans {
        let (_, nod, beams) = scene.scan(i);
        let start = seconds();
        let [x, y, z] = beams[0].origin.to_array();
        map.center_on(Point::new(x, y, z));
        if nod != sweep {
            sweep = nod;
            map.close_window();
        }
        for beam in &beams {
            map.insert(beam);
        }
        quarters[i * 4 / scans] += seconds() - start;
    }
    let ns = quarters.map(|s| s * 1e9 / (scans / 4 * BEAMS) as f64);
    eprintln!(
        "1 km: {:.0}, {:.0}, {:.0}, {:.0} ns a beam by quarters; ratio {:.3}",
        ns[0],
        ns[1],
        ns[2],
        ns[3],
        ns[3] / ns[0]
    );
    assert!(ns[3] < 1.2 * ns[0], "{ns:?}");
}
