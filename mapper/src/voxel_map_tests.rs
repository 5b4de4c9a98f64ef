//! Tests of the map: what a beam does, what is dropped, what a snapshot sends.

use crate::beams::{Beam, BeamKind, Weight};
use crate::config::Config;
use crate::voxel_map::{MapError, VoxelMap};
use tsense_contract::VoxelState::{Free, Occupied, Unknown};
use tsense_geometry::{Global, Point, VoxelIndex};

/// Voxels of 1 m, so that metres are voxels; a beam frees all it crosses.
fn plain_map() -> VoxelMap {
    let mut config = Config { voxel_size_m: 1.0, working_space_m: [200.0, 200.0, 80.0], ..Config::default() };
    let e = &mut config.evidence;
    (e.spare_voxels, e.grazing_spare_share, e.chord_min_voxels) = (0.0, 0.0, 0.0);
    VoxelMap::new(&config).unwrap()
}

fn at(x: f64, y: f64, z: f64) -> Point<Global> {
    Point::new(x, y, z)
}

fn beam(origin: Point<Global>, end: Point<Global>, kind: BeamKind) -> Beam {
    Beam { origin, end, kind, weight: Weight::FULL }
}

fn states(map: &VoxelMap, voxels: &[VoxelIndex]) -> Vec<tsense_contract::VoxelState> {
    voxels.iter().map(|voxel| map.voxel(*voxel).state).collect()
}

#[test]
fn a_beam_frees_its_way_and_occupies_its_end() {
    let mut map = plain_map();
    assert!(map.insert(&beam(at(0.5, 0.5, 0.5), at(3.5, 0.5, 0.5), BeamKind::Hit)));
    let row = [[0, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 0]];
    assert_eq!(states(&map, &row), [Unknown, Unknown, Occupied, Unknown], "a hit shows at once");
    map.close_window();
    assert_eq!(states(&map, &row), [Free, Free, Occupied, Unknown]);
    assert!(map.insert(&beam(at(0.5, 0.5, 0.5), at(5.5, 0.5, 0.5), BeamKind::NoReturn)));
    map.close_window();
    assert_eq!(states(&map, &row), [Free, Free, Occupied, Free], "one window does not delete");
    assert_eq!(map.voxel_visits(), 4 + 1 + 6);
}

#[test]
fn a_hit_protects_its_voxel_from_all_beams_of_its_window_whatever_their_order() {
    let hit = beam(at(0.5, 0.5, 0.5), at(3.5, 0.5, 0.5), BeamKind::Hit);
    let past = beam(at(0.5, 0.5, 0.5), at(9.5, 0.5, 0.5), BeamKind::NoReturn);
    for order in [[hit, past, past], [past, hit, past], [past, past, hit]] {
        let mut map = plain_map();
        order.iter().for_each(|beam| assert!(map.insert(beam)));
        map.close_window();
        let voxel = map.voxel([3, 0, 0]);
        assert_eq!((voxel.occupancy, voxel.confidence), (8, 8), "one hit, one update");
        assert_eq!(map.voxel([4, 0, 0]).occupancy, -4, "one miss");
    }
}

#[test]
fn a_beam_spares_the_last_voxels_before_its_hit_and_those_it_only_grazes() {
    let config = Config { voxel_size_m: 1.0, working_space_m: [200.0, 200.0, 80.0], ..Config::default() };
    let mut map = VoxelMap::new(&config).unwrap();
    map.insert(&beam(at(0.1, 0.5, 0.5), at(10.1, 0.5, 0.5), BeamKind::Hit));
    map.close_window();
    assert_eq!(states(&map, &[[7, 0, 0], [8, 0, 0], [9, 0, 0], [10, 0, 0]]), [Free, Unknown, Unknown, Occupied]);
    // A corner of 0.2 x 0.2 voxels is cut on a way of 0.28.
    map.insert(&beam(at(0.5, 20.3, 0.5), at(1.9, 21.7, 0.5), BeamKind::NoReturn));
    map.close_window();
    assert_eq!(states(&map, &[[0, 20, 0], [1, 20, 0], [1, 21, 0]]), [Free, Unknown, Free]);
}

#[test]
fn the_ground_is_spared_further_than_the_side_of_a_thing() {
    let mut config = Config { voxel_size_m: 1.0, working_space_m: [200.0, 200.0, 80.0], ..Config::default() };
    (config.evidence.spare_voxels, config.evidence.grazing_spare_share) = (1.0, 0.1);
    let freed = |tall: bool| {
        let mut map = VoxelMap::new(&config).unwrap();
        if tall {
            map.insert(&beam(at(60.5, 0.5, 9.5), at(60.5, 0.5, 1.5), BeamKind::Hit));
            map.close_window();
        }
        map.insert(&beam(at(0.7, 0.5, 0.5), at(60.7, 0.5, 0.5), BeamKind::Hit));
        map.close_window();
        (0..60).rev().find(|x| map.voxel([*x, 0, 0]).state == Free).unwrap()
    };
    assert_eq!(freed(false), 54, "6 of 60 m are spared");
    assert_eq!(freed(true), 59);
}

#[test]
fn what_is_not_on_earth_is_refused() {
    let mut map = plain_map();
    let good = at(0.5, 0.5, 0.5);
    for bad in [at(f64::NAN, 0.0, 0.0), at(0.0, f64::INFINITY, 0.0), at(0.0, 0.0, 1e300)] {
        assert!(!map.insert(&beam(good, bad, BeamKind::Hit)));
        assert!(!map.insert(&beam(bad, good, BeamKind::NoReturn)));
        assert!(!map.center_on(bad));
    }
    assert_eq!((map.blocks().count(), map.voxel_visits()), (0, 0));
    assert!(matches!(VoxelMap::new(&Config { voxel_size_m: 0.0, ..Config::default() }), Err(MapError::VoxelSize(_))));
}

#[test]
fn beams_are_cut_to_the_working_space() {
    let mut map = plain_map();
    assert!(map.insert(&beam(at(-500.0, 0.5, 0.5), at(500.0, 0.5, 0.5), BeamKind::Hit)));
    assert_eq!(map.voxel_visits(), 200);
    assert!(!map.insert(&beam(at(-500.0, 300.5, 0.5), at(500.0, 300.5, 0.5), BeamKind::Hit)));
}

#[test]
fn blocks_behind_are_dropped_and_unknown_when_the_vehicle_is_back() {
    let mut map = plain_map();
    map.insert(&beam(at(0.5, 0.5, 0.5), at(3.5, 0.5, 0.5), BeamKind::Hit));
    map.close_window();
    map.center_on(at(90.0, 0.0, 0.0));
    assert_eq!(map.voxel([3, 0, 0]).state, Occupied, "still in the working space");
    for far in [at(800.0, 0.0, 0.0), at(9.0e6, 9.0e6, 0.0)] {
        map.center_on(far);
        assert_eq!(map.voxel([3, 0, 0]).state, Unknown);
        assert_eq!(map.blocks().count(), 0);
    }
    map.center_on(at(0.0, 0.0, 0.0));
    assert_eq!(map.voxel([3, 0, 0]).state, Unknown);
}

#[test]
fn confidence_fades_with_time_and_way_and_comes_back_with_the_next_beam() {
    let mut map = plain_map();
    let here = beam(at(0.5, 0.5, 0.5), at(3.5, 0.5, 0.5), BeamKind::Hit);
    map.insert(&here);
    map.close_window();
    map.fade(2.4);
    map.fade_blocks(map.block_slots());
    assert_eq!(map.voxel([3, 0, 0]).confidence, 6);
    map.fade(0.7);
    map.fade_blocks(map.block_slots());
    assert_eq!(map.voxel([3, 0, 0]).confidence, 5, "fractions add up");
    map.fade(100.0);
    map.fade_blocks(map.block_slots());
    assert_eq!(states(&map, &[[2, 0, 0], [3, 0, 0]]), [Unknown, Occupied], "only contrary rays delete");
    map.insert(&here);
    map.close_window();
    assert_eq!(states(&map, &[[2, 0, 0], [3, 0, 0]]), [Free, Occupied]);
    assert_eq!(map.voxel([3, 0, 0]).confidence, 9);
}
