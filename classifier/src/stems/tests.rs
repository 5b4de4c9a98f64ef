//! A small world of upright cylinders before a wall, seen by beams of finite width from one side.
//!
//! The beams are cast here as discs of rays, not by the model under test: each ray meets the nearest surface, rays that
//! end together make an echo, and an echo of too little light is lost.

use super::*;
use crate::columns::Window;
use crate::returns::{PlacedBeam, ReturnsConfig};
use tsense_contract::GroundEvidence;
use tsense_geometry::{Point, Timestamp, VoxelGrid};

/// The ground lies 0.12 m above the bottom of its voxels, so that breast height's voxel ends 1.38 m above it.
const CORNER: [f64; 3] = [369_000.0, 3_279_000.0, 30.12];
const LADAR_M: f64 = 1.6;
const WALL_M: f64 = 13.0;

/// An upright cylinder: east and north of the ladar, radius, height; metres.
type Cylinder = ([f64; 2], f64, f64);

#[derive(Clone, Copy, PartialEq)]
enum Echoes {
    All,
    Strongest,
}

/// Range along a ray to the nearest cylinder, the ground or the wall.
fn range_m(direction: [f64; 3], cylinders: &[Cylinder]) -> f64 {
    let [x, y, z] = direction;
    let ground_m = if z < 0.0 { -LADAR_M / z } else { f64::INFINITY };
    let wall_m = if x > 0.0 { WALL_M / x } else { f64::INFINITY };
    let mut nearest = ground_m.min(wall_m);
    for &([east, north], radius, height) in cylinders {
        let (a, b, c) = (x * x + y * y, x * east + y * north, east * east + north * north - radius * radius);
        let root = b * b - a * c;
        let range = if root > 0.0 { (b - root.sqrt()) / a } else { f64::INFINITY };
        if range > 0.0 && LADAR_M + range * z < height {
            nearest = nearest.min(range);
        }
    }
    nearest
}

/// Echoes of a beam: mean ranges and shares of its light.
fn echoes(azimuth: f64, elevation: f64, cylinders: &[Cylinder]) -> Vec<(f64, f64)> {
    let mut ranges: Vec<f64> = Vec::new();
    for (i, j) in (-6..=6).flat_map(|i| (-6..=6).map(move |j| (f64::from(i) / 6.0, f64::from(j) / 6.0))) {
        if i * i + j * j <= 1.0 {
            let (a, e) = (azimuth + 0.0075 * i / elevation.cos(), elevation + 0.0075 * j);
            ranges.push(range_m([a.cos() * e.cos(), a.sin() * e.cos(), e.sin()], cylinders));
        }
    }
    ranges.sort_by(f64::total_cmp);
    let parts = ranges.chunk_by(|a, b| b - a < 0.6);
    let echo = |part: &[f64]| (part.iter().sum::<f64>() / part.len() as f64, part.len() as f64 / ranges.len() as f64);
    parts.map(echo).filter(|(_, share)| *share > 0.09).take(2).collect()
}

/// The world as returns and voxels.
fn world(cylinders: &[Cylinder], reported: Echoes) -> (View, Returns) {
    world_below(30.0, cylinders, reported)
}

/// The world as far as a nod that ends at an elevation shows it, degrees.
fn world_below(highest_deg: f64, cylinders: &[Cylinder], reported: Echoes) -> (View, Returns) {
    let mut returns = Returns::new(&ReturnsConfig::for_survey());
    let grid = VoxelGrid::new(0.15).unwrap();
    let origin = [CORNER[0] + 1.0, CORNER[1] + 8.0, CORNER[2] + LADAR_M];
    let first = CORNER.map(|c| (c / 0.15).floor() as i32);
    let mut view = View::unknown(Window { first, size: [108, 108, 40] }, grid);
    for (i, j) in (-90..=90).flat_map(|i| (-60..=60).map(move |j| (i, j))) {
        // Interlaced, as a nodding head's scans are.
        let (azimuth_deg, elevation_deg) = (0.5 * f64::from(i) + 0.125 * f64::from(j * 3 % 4), 0.5 * f64::from(j));
        if elevation_deg > highest_deg {
            continue;
        }
        let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
        let mut found = echoes(azimuth, elevation, cylinders);
        if reported == Echoes::Strongest {
            // Light comes back by the square of the range.
            found.sort_by(|a, b| (b.1 / b.0.powi(2)).total_cmp(&(a.1 / a.0.powi(2))));
            found.truncate(1);
        }
        for (range, _) in found {
            let way = [azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin()];
            let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| origin[axis] + range * way[axis]);
            let (origin, end) = (Point::new(origin[0], origin[1], origin[2]), Point::new(x, y, z));
            returns.insert(&PlacedBeam { ladar: 0, stamp: Timestamp::default(), origin, end, is_return: true });
            if let (Some((column, row)), Some(voxel)) = (view.shape.cell_at(x, y), grid.index_of(end)) {
                view.occupied.insert(row * 108 + column, (voxel[2] - first[2]).max(0) as usize);
            }
        }
    }
    returns.settle();
    (view, returns)
}

fn found(cylinders: &[Cylinder], reported: Echoes) -> Trunks {
    let (view, returns) = world(cylinders, reported);
    look(&view, &returns, &mut Memory::new(usize::MAX))
}

/// One snapshot of this world, whose stems are smooth and whose beams are discs of even light that start from a point: a tenth
/// of it lies beyond 0.7 half widths.
fn look(view: &View, returns: &Returns, memory: &mut Memory) -> Trunks {
    let disc = StemsConfig { beam_exit_m: 0.0, beam_sigma_share: 0.5, ..StemsConfig::default() };
    look_with(view, returns, memory, &StemsConfig { beam_seen_share: 0.7, bark_m: 0.0, ..disc })
}

/// One snapshot: level ground, and what is remembered of those before.
fn look_with(view: &View, returns: &Returns, memory: &mut Memory, config: &StemsConfig) -> Trunks {
    let level = Raster::filled(view.shape, (CORNER[2] - view.base_m()) as f32);
    let ground = Ground {
        base_m: view.base_m(),
        std_m: level.map(|_| 0.02),
        evidence: level.map(|_| GroundEvidence::Measured),
        height_m: level,
        measured_at_cells: vec![0.0; view.shape.len()],
    };
    let columns = ReturnColumns::of(returns, view);
    let met_ns = met_ns(view);
    let scene = StemScene { view, returns, columns: &columns, ground: &ground, met_ns: &met_ns };
    stems(&scene, memory, config)
}

/// Met 7 ns after the beginning to the east of 5.5 m from the ladar, 5 ns after it elsewhere.
fn met_ns(view: &View) -> Raster<i64> {
    let is_east = |i: usize| (i % view.shape.width) as f64 * view.shape.cell_m > 6.5;
    let met_ns = (0..view.shape.len()).map(|i| if is_east(i) { 7 } else { 5 }).collect();
    Raster::from_cells(view.shape, met_ns).unwrap()
}

/// Error of the diameter, and of the position, of the one tree that there is.
fn errors_m(trunks: &Trunks, ([east, north], radius, _): Cylinder) -> (f64, f64) {
    assert_eq!(trunks.trees.len(), 1, "{:?}", trunks.rejected);
    let tree = &trunks.trees[0];
    let off = [tree.easting_m - CORNER[0] - 1.0 - east, tree.northing_m - CORNER[1] - 8.0 - north];
    (f64::from(tree.dbh_m) - 2.0 * radius, off[0].hypot(off[1]))
}

#[test]
fn a_cylinder_seen_by_wide_beams_from_one_side_has_its_diameter_within_millimetres() {
    // At 7 m the beams are 6 cm apart and 11 cm wide.
    for (cylinder, most_m) in [(([4.0, 0.5], 0.15, 5.5), 0.003), (([7.0, -1.2], 0.2, 5.5), 0.01)] {
        let (dbh_m, place_m) = errors_m(&found(&[cylinder], Echoes::All), cylinder);
        assert!(dbh_m.abs() < most_m && place_m < most_m, "{cylinder:?}: {dbh_m:.4}, {place_m:.4}");
    }
}

#[test]
fn a_ladar_that_sends_the_strongest_echo_only_gives_the_true_diameter_at_any_range() {
    for (cylinder, most_m) in
        [(([3.0, 0.4], 0.1, 5.5), 0.015), (([5.0, 0.7], 0.15, 5.5), 0.02), (([8.0, -1.0], 0.2, 5.5), 0.03)]
    {
        let (dbh_m, place_m) = errors_m(&found(&[cylinder], Echoes::Strongest), cylinder);
        assert!(dbh_m.abs() < most_m && place_m < 0.02, "{cylinder:?}: {dbh_m:.4}, {place_m:.4}");
    }
}

#[test]
fn a_diameter_is_surer_the_more_beams_ended_at_the_stem() {
    // 13.7 x 10 mm / sqrt(1369) = 3.70 mm; with 2.8 mm and 2 x 0.5 x 1 mm the root of squares is 4.75 mm.
    assert!((sharp_dbh_std_m(0.010, 1369, 0.001) - 0.00475).abs() < 1e-5);
    assert!(sharp_dbh_std_m(0.010, 100, 0.001) > 0.0137 && sharp_dbh_std_m(0.0, 0, 0.0) > 0.002);
}

#[test]
fn two_stems_half_a_metre_apart_are_two() {
    let trunks = found(&[([4.0, 0.0], 0.08, 5.5), ([4.2, 0.5], 0.08, 5.5)], Echoes::All);
    assert_eq!(trunks.trees.len(), 2, "{:?}", trunks.rejected);
    assert!(trunks.mask.cells().iter().filter(|set| **set).count() >= 2);
}

#[test]
fn walls_stumps_and_bare_ground_are_no_trees() {
    assert!(found(&[], Echoes::All).trees.is_empty());
    assert!(found(&[([4.0, 0.0], 0.2, 1.1)], Echoes::All).trees.is_empty(), "a stump");
    let row: Vec<Cylinder> = (-8..8).map(|i| ([5.0, 0.12 * f64::from(i)], 0.1, 3.0)).collect();
    assert!(found(&row, Echoes::All).trees.is_empty(), "a wall of posts");
}

#[test]
fn a_stem_that_ends_with_the_nod_is_a_tree_and_one_that_beams_pass_above_is_a_post() {
    // At 4 m a nod to 8 degrees shows 0.56 m above the ladar: 2.16 m.
    let trees = |highest_deg: f64, height_m: f64, top_level: usize| {
        let (mut view, returns) = world_below(highest_deg, &[([4.0, 0.0], 0.1, height_m)], Echoes::Strongest);
        // Beams beside it clear its voxels.
        let above = (0..view.shape.len()).flat_map(|column| (top_level..40).map(move |level| (column, level)));
        for (column, level) in above {
            view.occupied.remove(column, level);
            view.free.insert(column, level);
        }
        look(&view, &returns, &mut Memory::new(usize::MAX)).trees.len()
    };
    // Breast height's voxel is the ninth.
    assert_eq!([trees(8.0, 5.5, 14), trees(8.0, 5.5, 9), trees(30.0, 5.5, 9), trees(30.0, 2.16, 14)], [1, 1, 1, 0]);
}

#[test]
fn the_same_beams_give_the_same_trees() {
    let cylinders = [([4.0, 0.5], 0.15, 5.5), ([7.0, -1.2], 0.2, 5.5)];
    let (a, b) = (found(&cylinders, Echoes::All), found(&cylinders, Echoes::All));
    assert_eq!(format!("{:?}", (&a.trees, &a.rejected)), format!("{:?}", (&b.trees, &b.rejected)));
}

#[test]
fn unknown_ground_gives_no_tree_and_no_panic() {
    let (view, returns) = world(&[([4.0, 0.5], 0.15, 5.5)], Echoes::All);
    let height_m = Raster::filled(view.shape, f32::NAN);
    let evidence = height_m.map(|_| GroundEvidence::Unknown);
    let ground = Ground { base_m: 0.0, std_m: height_m.clone(), evidence, height_m, measured_at_cells: Vec::new() };
    let columns = ReturnColumns::of(&returns, &view);
    let met_ns = Raster::filled(view.shape, 0);
    let scene = StemScene { view: &view, returns: &returns, columns: &columns, ground: &ground, met_ns: &met_ns };
    assert!(stems(&scene, &mut Memory::new(usize::MAX), &StemsConfig::default()).trees.is_empty());
}

const PAIR: [Cylinder; 2] = [([4.0, 0.5], 0.15, 5.5), ([7.0, -1.2], 0.2, 5.5)];

#[test]
fn a_stem_is_told_under_the_instant_at_which_something_was_last_met_around_it() {
    let mut trees = found(&PAIR, Echoes::All).trees;
    trees.sort_by(|a, b| a.easting_m.total_cmp(&b.easting_m));
    assert_eq!(trees.iter().map(|tree| tree.stamp_ns).collect::<Vec<_>>(), [5, 7]);
}

#[test]
fn without_news_nothing_is_judged_again_and_the_trees_stay() {
    let (view, mut returns) = world(&PAIR, Echoes::All);
    let mut memory = Memory::new(usize::MAX);
    let first = look(&view, &returns, &mut memory);
    assert!(memory.judged() >= 2);
    returns.seen();
    let second = look(&view, &returns, &mut memory);
    assert_eq!((memory.judged(), first.trees.len()), (0, 2));
    assert_eq!(format!("{:?}", first.trees), format!("{:?}", second.trees));
}

#[test]
fn one_candidate_a_snapshot_finds_the_same_trees_later() {
    let (view, mut returns) = world(&PAIR, Echoes::All);
    let at_once = look(&view, &returns, &mut Memory::new(usize::MAX));
    let mut memory = Memory::new(1);
    let mut trees = Vec::new();
    for _ in 0..60 {
        trees = look(&view, &returns, &mut memory).trees;
        assert!(memory.judged() <= 1);
        returns.seen();
    }
    assert_eq!(format!("{:?}", at_once.trees), format!("{trees:?}"));
}

#[test]
fn a_remembered_tree_stays_where_it_is_when_the_view_moves_and_goes_with_its_returns() {
    let (view, mut returns) = world(&PAIR, Echoes::All);
    let mut memory = Memory::new(usize::MAX);
    let before = look(&view, &returns, &mut memory);
    returns.seen();
    let first = [view.shape.first_cell[0] + 4, view.shape.first_cell[1] - 8, view.first_level - 4];
    let mut moved = View::unknown(Window { first, size: [108, 108, 44] }, VoxelGrid::new(0.15).unwrap());
    for (i, level) in (0..108 * 108).flat_map(|i| (0..40).map(move |level| (i, level))) {
        let (column, row) = (i % 108, i / 108);
        if view.occupied.contains(i, level) && column >= 4 && row < 100 {
            moved.occupied.insert((row + 8) * 108 + column - 4, level + 4);
        }
    }
    let after = look(&moved, &returns, &mut memory);
    assert_eq!(after.trees.len(), 2, "{:?}", after.rejected);
    for (a, b) in before.trees.iter().zip(&after.trees) {
        let off_m = (a.easting_m - b.easting_m).hypot(a.northing_m - b.northing_m).max((a.ground_m - b.ground_m).abs());
        assert!(off_m < 1e-3 && (a.dbh_m - b.dbh_m).abs() < 1e-3, "{a:?} {b:?}");
    }
    returns.clear();
    assert!(look(&moved, &returns, &mut memory).trees.is_empty());
}
