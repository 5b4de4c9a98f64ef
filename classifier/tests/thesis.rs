//! The thesis's chain, whole: each of its tunables has a hold on what it finds.

use tsense_classifier::config::{Config, Detector, GroundMethod};
use tsense_classifier::{Input, Memory, View, Window, detect};
use tsense_geometry::{Timestamp, VoxelGrid};

/// Numbers from 0 to 99 that look drawn, always the same.
fn drawn(column: usize, level: usize) -> u64 {
    let mixed = (column as u64 * 64 + level as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 33) % 100
}

/// A slope with gaps in it and a step, lost beams below it, brush of single voxels, hedges, and trunks of four columns
/// each, of which some are met more often than others. In the east there is ground alone.
fn scene() -> View {
    let width = 80;
    let window = Window { first: [0; 3], size: [width, width, 64] };
    let mut view = View::unknown(window, VoxelGrid::new(0.15).unwrap());
    for column in 0..width * width {
        let (x, y) = (column % width, column / width);
        let ground = 16 + x / 12 + 3 * usize::from(y > 40);
        if drawn(column, 0) < 50 && !(20..36).contains(&x) && !(52..78).contains(&x) {
            view.occupied.insert(column, ground);
        }
        if drawn(column, 1) < 1 {
            view.free.insert(column, ground - 14);
        }
        let occupied = match (x % 14, y % 14) {
            (0..2, 0..2) => 10 + drawn(x / 14, y / 14),
            (_, 5) if x % 28 < 14 => 70,
            _ => 6,
        };
        for level in (ground + 1..ground + 24).filter(|_| x <= 50) {
            let drawn = drawn(column, level);
            if drawn < occupied {
                view.occupied.insert(column, level);
            } else if drawn < 90 {
                view.free.insert(column, level);
            }
        }
    }
    view
}

/// Ground, trees and candidates that are none, as text.
fn found(view: &View, config: &Config) -> String {
    assert_eq!(config.validate(), []);
    let input = Input { view, returns: None, vehicle: None, stamp: Timestamp::default() };
    let mut memory = Memory::new(usize::MAX);
    let found = detect(&input, &mut memory, config).finish(&input, &mut memory, config);
    let trees = found.trees.iter().map(|tree| (tree.easting_m, tree.northing_m, tree.dbh_m));
    format!("{:?} {:?} {:?}", found.ground.height_m.cells(), trees.collect::<Vec<_>>(), found.rejected)
}

#[test]
fn each_tunable_of_the_thesis_changes_what_its_chain_finds() {
    use GroundMethod::{Interpolation, Tiles};
    type Change = fn(&mut Config);
    let changes: [(&str, GroundMethod, Change); 14] = [
        ("kernel size", Interpolation, |config| config.trunk.kernel_cells = 9),
        ("kernel centre", Interpolation, |config| config.trunk.kernel_center_m = 0.4),
        ("kernel outside", Interpolation, |config| config.trunk.kernel_outside = 0.5),
        ("kernel fall-off", Interpolation, |config| config.trunk.kernel_falloff_m = 0.3),
        ("threshold", Interpolation, |config| config.trunk.threshold = 0.3),
        ("start height", Interpolation, |config| config.density.start_m = 0.9),
        ("penalty", Interpolation, |config| config.density.free_penalty = 0.2),
        ("pyramid depth", Interpolation, |config| config.ground.pyramid_depth_m = 3.0),
        ("pyramid slope", Interpolation, |config| config.ground.pyramid_slope = 3.0),
        ("gap limit", Interpolation, |config| config.ground.gap_max_m = 1.0),
        ("extrapolation limit", Interpolation, |config| config.ground.extrapolation_max_m = 1.0),
        ("tile size", Tiles, |config| config.ground.tile_m = 1.5),
        ("rejection of sparse tiles", Tiles, |config| config.ground.tile_cells_min = 200),
        ("rejection of uneven tiles", Tiles, |config| config.ground.tile_std_max_m = 0.05),
    ];
    let view = scene();
    let does_nothing = |(_, method, change): &(&str, GroundMethod, Change)| {
        let mut config = Config { detector: Detector::Thesis, ..Config::default() };
        config.ground.method = *method;
        let before = found(&view, &config);
        change(&mut config);
        found(&view, &config) == before
    };
    let idle: Vec<_> = changes.into_iter().filter(does_nothing).map(|(name, ..)| name).collect();
    assert!(idle.is_empty(), "without effect: {idle:?}");
}
