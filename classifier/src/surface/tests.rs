//! Small worlds by hand: a plane under grass, a bank, a log, ghosts, nothing at all.

use super::*;

const CELL_M: f64 = 0.15;

fn shape() -> RasterShape {
    RasterShape { first_cell: [100, 200], width: 96, height: 96, cell_m: CELL_M }
}

/// A number from 0 to 1 that depends on a column alone.
fn chance(column: usize, salt: u64) -> f32 {
    let bits = (column as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(salt.wrapping_mul(0xbf58_476d));
    ((bits ^ bits >> 29).wrapping_mul(0x94d0_49bb_1331_11eb) >> 40) as f32 / (1u64 << 24) as f32
}

/// A foot in every column, 14.4 x 14.4 m, at the height that `at` gives for a place and a column's number.
fn feet(at: impl Fn(f32, f32, usize) -> f32) -> Vec<Foot> {
    let foot = |i: usize| {
        let [x, y] = [i % 96, i / 96].map(|k| (k as f32 + 0.5) * CELL_M as f32);
        Foot { at_m: [x, y, at(x, y, i)], std_m: 0.01, towards: UP }
    };
    (0..96 * 96).map(foot).filter(|foot| foot.at_m[2].is_finite()).collect()
}

fn rms(surface: &Surface, truth: impl Fn(f32, f32) -> f32) -> f32 {
    let errors = (0..96 * 96).map(|i| {
        let [x, y] = [i % 96, i / 96].map(|k| (k as f32 + 0.5) * CELL_M as f32);
        (surface.heights.at(x, y) - truth(x, y)).powi(2)
    });
    (errors.sum::<f32>() / (96.0 * 96.0)).sqrt()
}

fn slope(x: f32, y: f32) -> f32 {
    3.0 + 0.2 * x - 0.1 * y
}

fn surface_of(feet: &[Foot]) -> Surface {
    ground_surface(feet, shape(), &SurfaceConfig::default()).unwrap()
}

#[test]
fn a_slope_under_grass_with_holes_in_ten_of_a_hundred_columns_is_found_to_two_centimetres() {
    let grass = |x, y, i| slope(x, y) + if chance(i, 1) < 0.1 { 0.0 } else { 0.1 + 0.7 * chance(i, 2) };
    let error_m = rms(&surface_of(&feet(grass)), slope);
    assert!(error_m < 0.02, "{error_m}");
}

#[test]
fn grass_that_hides_all_ground_of_a_third_of_the_plot_does_not_lift_it_and_costs_certainty() {
    let grass = |x: f32, y, i| match x > 9.6 {
        true => slope(x, y) + 0.15 + 0.8 * chance(i, 3).sqrt(),
        false => slope(x, y) + if chance(i, 1) < 0.3 { 0.0 } else { 0.8 * chance(i, 2) },
    };
    let surface = surface_of(&feet(grass));
    let hidden = surface.heights.level.node_at(13.0, 7.0);
    let seen = surface.heights.level.node_at(5.0, 7.0);
    assert_ne!(surface.sight[hidden], Sight::Strong);
    assert!(surface.std_m[hidden] > 2.0 * surface.std_m[seen], "{} {}", surface.std_m[hidden], surface.std_m[seen]);
    assert!((surface.heights.at(13.0, 7.0) - slope(13.0, 7.0)).abs() < 0.12, "{}", surface.heights.at(13.0, 7.0));
}

#[test]
fn a_log_and_a_crown_without_ground_below_are_no_ground() {
    let log = |x: f32, y: f32| (x - 5.0).abs() < 0.2 && (2.0..8.0).contains(&y);
    let crown = |x: f32, y: f32| (x - 10.0).hypot(y - 10.0) < 2.0;
    let height = |x, y, _| {
        slope(x, y)
            + if log(x, y) {
                0.4
            } else if crown(x, y) {
                6.0
            } else {
                0.0
            }
    };
    let surface = surface_of(&feet(height));
    assert!((surface.heights.at(5.0, 5.0) - slope(5.0, 5.0)).abs() < 0.05, "{}", surface.heights.at(5.0, 5.0));
    assert!((surface.heights.at(10.0, 10.0) - slope(10.0, 10.0)).abs() < 0.05);
}

#[test]
fn a_bank_of_one_in_two_is_followed() {
    let bank = |x: f32, _: f32| 3.0 + (0.5 * (x - 6.0)).clamp(0.0, 1.0);
    let error_m = rms(&surface_of(&feet(|x, y, _| bank(x, y))), bank);
    assert!(error_m < 0.04, "{error_m}");
}

#[test]
fn one_sigma_grows_with_the_distance_to_ground_that_was_seen() {
    let surface = surface_of(&feet(|x, y, _| if x < 5.0 { slope(x, y) } else { f32::NAN }));
    let std_m = |x: f32| surface.std_m[surface.heights.level.node_at(x, 7.0)];
    assert!(std_m(3.0) < 0.02 && std_m(3.0) < std_m(6.0) && std_m(6.0) < std_m(9.0), "{} {}", std_m(6.0), std_m(9.0));
    assert!((surface.heights.at(9.0, 7.0) - slope(9.0, 7.0)).abs() < 0.05, "a slope goes on");
}

#[test]
fn the_same_feet_give_the_same_surface_to_the_last_bit_and_none_give_none() {
    let grass = feet(|x, y, i| slope(x, y) + chance(i, 5));
    assert_eq!(surface_of(&grass).heights.height_m, surface_of(&grass).heights.height_m);
    assert!(ground_surface(&[], shape(), &SurfaceConfig::default()).is_none());
}

#[test]
fn the_surface_does_not_continue_a_bank_at_the_rim_of_what_was_seen() {
    // Seen up to 9.6 m; its last 1.2 m fall by half a metre.
    let bank = |x: f32, y, _| match x {
        x if x > 9.6 => f32::NAN,
        x => slope(x, y) - 0.4 * (x - 8.4).max(0.0),
    };
    let feet = feet(bank);
    let off_m = |config: &SurfaceConfig| {
        let surface = ground_surface(&feet, shape(), config).unwrap();
        let std_m = surface.std_m[surface.heights.level.node_at(13.0, 7.0)];
        ((surface.heights.at(13.0, 7.0) - slope(13.0, 7.0)).abs(), std_m)
    };
    let (plain_m, _) = off_m(&SurfaceConfig { trend_m: 0.0, ..SurfaceConfig::default() });
    let (held_m, std_m) = off_m(&SurfaceConfig::for_survey());
    assert!(plain_m > 0.6 && held_m < 0.6 * plain_m && std_m < plain_m, "{plain_m} {held_m} {std_m}");
}

#[test]
fn shifted_rasters_agree_on_a_slope_and_without_any_ground_nothing_is_sure() {
    let survey = SurfaceConfig::for_survey();
    let surface = ground_surface(&feet(|x, y, _| slope(x, y)), shape(), &survey).unwrap();
    assert!(rms(&surface, slope) < 0.005 && surface.std_m.iter().all(|std_m| *std_m < 0.02));
    let lone = [Foot { at_m: [3.0, 3.0, 1.0], std_m: 0.01, towards: UP }];
    let surface = ground_surface(&lone, shape(), &survey).unwrap();
    assert!(surface.std_m.iter().all(|std_m| *std_m == f32::INFINITY), "{:?}", surface.std_m[0]);
}
