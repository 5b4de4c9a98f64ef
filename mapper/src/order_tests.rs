//! The order of the beams of a window does not matter: the same map, voxel by voxel, for shuffled scans.

use crate::beams::{Beam, BeamKind, Weight};
use crate::config::{Config, Scheme};
use crate::scene::{AT, Person, Scene};
use crate::testing::Random;
use crate::voxel_map::VoxelMap;
use tsense_geometry::Point;

/// Beams of two nods, each in an order of its own, with weights by turns; a wall and a person make sides of things.
fn map_of(scheme: Scheme, order: u64) -> VoxelMap {
    let mut config = Config::default();
    config.scheme.scheme = scheme;
    let mut map = VoxelMap::new(&config).unwrap();
    map.center_on(Point::new(AT[0], AT[1], AT[2]));
    let person = Person { east_m: AT[0] + 1.0, north_m: AT[1] + 5.0, radius_m: 0.25, height_m: 1.8 };
    let scene = Scene { person: Some(person), wall_m: Some(7.0), ..Scene::tripod() };
    let per_sweep = scene.scans_per_sweep();
    for sweep in 0..2 {
        let scans = sweep * per_sweep..(sweep + 1) * per_sweep;
        let mut beams: Vec<Beam> = scans.flat_map(|i| scene.scan(i).2).collect();
        for (i, beam) in beams.iter_mut().enumerate() {
            beam.weight = Weight::new([1.0, 0.5, 0.25][i % 3]);
        }
        shuffle(&mut beams, order);
        for beam in &beams {
            map.insert(&map.above_ground(beam));
        }
        map.close_window();
    }
    map
}

/// 0 keeps the order.
fn shuffle(beams: &mut [Beam], order: u64) {
    let mut random = Random(order);
    for last in (1..beams.len()).rev().take_while(|_| order > 0) {
        beams.swap(last, random.bits() as usize % (last + 1));
    }
}

#[test]
fn shuffled_beams_of_a_window_give_the_same_map() {
    for scheme in [Scheme::Confidence, Scheme::HitRatio, Scheme::IncrementDecrement] {
        let expected = map_of(scheme, 0);
        let mut occupied = 0;
        for order in 1..=3 {
            let map = map_of(scheme, order);
            assert_eq!(map.voxel_visits(), expected.voxel_visits());
            let mut pairs = 0;
            for ((key, bricks), (expected_key, expected_bricks)) in map.blocks().zip(expected.blocks()) {
                assert_eq!(key, expected_key);
                assert!(bricks == expected_bricks, "{scheme:?}, order {order}, block {key:?}");
                occupied += bricks.iter().flat_map(|brick| brick.occupancy).filter(|o| *o > 0).count();
                pairs += 1;
            }
            assert_eq!((map.blocks().count(), expected.blocks().count()), (pairs, pairs));
        }
        assert!(occupied > 10_000, "{occupied}");
    }
}

#[test]
fn what_a_window_finds_above_a_hit_counts_from_the_next_window_on() {
    let hit = |z: f64| Beam {
        origin: Point::new(-60.2, 0.5, 0.5),
        end: Point::new(0.6, 0.5, z),
        kind: BeamKind::Hit,
        weight: Weight::FULL,
    };
    let config = Config { voxel_size_m: 1.0, working_space_m: [200.0, 200.0, 80.0], ..Config::default() };
    let mut freed = Vec::new();
    for beams in [[hit(0.5), hit(1.5)], [hit(1.5), hit(0.5)]] {
        let mut map = VoxelMap::new(&config).unwrap();
        for _ in 0..2 {
            beams.iter().for_each(|beam| assert!(map.insert(beam)));
            map.close_window();
            freed.push((-60..0).rev().find(|x| map.voxel([*x, 0, 0]).confidence > 0).unwrap());
        }
    }
    // 60.8 m with a tenth spared, then with two voxels spared; shorter chords than half a voxel do not count.
    assert_eq!(freed, [-6, -2, -6, -2]);
}
