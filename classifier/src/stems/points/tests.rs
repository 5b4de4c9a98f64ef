//! Stems of clouds without beams, made by hand: rings, a bush, a wall.

use crate::classify::{Input, detect};
use crate::columns::{View, Window};
use crate::config::Config;
use crate::returns::{Returns, ReturnsConfig};
use crate::{Classification, Memory, Reason};
use std::f64::consts::TAU;
use tsense_geometry::{Point, VoxelGrid};

/// Numbers between 0 and 1, always the same.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Nearly normal, one sigma.
    fn normal(&mut self, std: f64) -> f64 {
        std * (0..12).map(|_| self.next() - 0.5).sum::<f64>()
    }
}

/// A stem: 400 points over 6 m, on a share of the circumference.
fn stem(at: [f64; 2], radius_m: f64, share: f64, thick_m: f64) -> Vec<[f64; 3]> {
    let mut noise = Noise(7 + (1000.0 * at[0]) as u64);
    let point = |_| {
        let (z, angle) = (6.0 * noise.next(), share * TAU * noise.next());
        let r = radius_m - 0.006 * (z - 1.3) + noise.normal(thick_m);
        [at[0] + r * angle.cos(), at[1] + r * angle.sin(), z]
    };
    (0..400).map(point).collect()
}

fn filled(low: [f64; 3], high: [f64; 3], count: usize) -> Vec<[f64; 3]> {
    let mut noise = Noise(count as u64);
    (0..count).map(|_| std::array::from_fn(|axis| low[axis] + noise.next() * (high[axis] - low[axis]))).collect()
}

/// Classifies things on level ground of 12 x 12 m, five points a column.
fn classified(things: &[Vec<[f64; 3]>]) -> Classification {
    let mut points = filled([0.0, 0.0, -0.01], [12.0, 12.0, 0.01], 32_000);
    points.extend(things.iter().flatten());
    let grid = VoxelGrid::new(0.15).unwrap();
    let window = Window { first: [0, 0, -8], size: [80, 80, 64] };
    let (mut view, mut returns) = (View::unknown(window, grid), Returns::new(&ReturnsConfig::for_survey()));
    for [x, y, z] in points {
        let voxel = grid.index_of(Point::new(x, y, z)).unwrap();
        let column = (voxel[1] * 80 + voxel[0]) as usize;
        view.occupied.insert(column, (voxel[2] + 8) as usize);
        view.touched.insert(column, (voxel[2] + 8) as usize);
        returns.insert_point(Point::new(x, y, z));
    }
    let (input, mut memory, config) = (Input::of_survey(&view, &returns), Memory::new(usize::MAX), Config::default());
    detect(&input, &mut memory, &config).finish(&input, &mut memory, &config)
}

#[test]
fn a_smooth_ring_half_a_ring_and_a_thick_one_are_stems_of_the_right_size() {
    let truths = [([3.0, 3.0], 0.18, 1.0, 0.008), ([8.0, 4.0], 0.30, 0.5, 0.012), ([5.0, 9.0], 0.20, 1.0, 0.025)];
    let found = classified(&truths.map(|(at, radius_m, share, thick_m)| stem(at, radius_m, share, thick_m)));
    assert_eq!(found.trees.len(), 3, "{:?}", found.rejected);
    for (at, radius_m, _, thick_m) in truths {
        let tree = found.trees.iter().find(|t| (t.easting_m - at[0]).hypot(t.northing_m - at[1]) < 0.03).unwrap();
        let error_m = f64::from(tree.dbh_m) - 2.0 * radius_m;
        assert!(error_m.abs() < 0.015 + 0.4 * thick_m, "{at:?}: {error_m}");
        assert!(f64::from(tree.dbh_std_m) > 1.5 * thick_m && tree.dbh_std_m < 0.08 && tree.height_m > 5.0);
    }
}

#[test]
fn a_bush_a_wall_and_a_thin_pole_of_leaves_are_none_and_say_why() {
    let wall = filled([2.0, 9.0, 0.0], [6.0, 9.03, 4.0], 6000);
    let bush = filled([8.0, 7.0, 0.0], [10.0, 9.0, 2.5], 5000);
    let low = stem([3.0, 3.0], 0.2, 1.0, 0.01).into_iter().filter(|[_, _, z]| *z < 1.2).collect();
    let found = classified(&[wall, bush, low]);
    assert!(found.trees.is_empty(), "{:?}", found.trees);
    let reasons = |west: [f64; 2], east: [f64; 2]| {
        let inside = |r: &&crate::Rejected| (0..2).all(|i| (west[i]..east[i]).contains(&r.at_m[i]));
        found.rejected.iter().filter(inside).map(|r| r.reason).collect::<Vec<_>>()
    };
    assert!(reasons([7.9, 6.9], [10.1, 9.1]).len() > 5, "the bush has many candidates");
    assert!(reasons([2.5, 2.5], [3.5, 3.5]).iter().all(|r| [Reason::NotVertical, Reason::Empty].contains(r)));
}

#[test]
fn a_stem_in_a_bush_is_found_where_its_ring_is_denser() {
    let bush = filled([2.0, 2.0, 0.0], [4.0, 4.0, 1.5], 800);
    let found = classified(&[bush, stem([3.0, 3.0], 0.2, 1.0, 0.01)]);
    assert_eq!(found.trees.len(), 1, "{:?}", found.rejected);
    assert!((f64::from(found.trees[0].dbh_m) - 0.4).abs() < 0.02);
}
