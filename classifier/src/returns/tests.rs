//! Tests of the store: what is kept, what goes, what is found again.

use super::*;
use crate::columns::{View, Window};
use crate::moving::Moving;
use proptest::prelude::*;
use tsense_geometry::VoxelGrid;

const AT: [f64; 3] = [369_000.3, 3_279_000.3, 40.3];

fn beam(at_s: f64, origin: [f64; 3], end: [f64; 3]) -> PlacedBeam {
    let point = |[x, y, z]: [f64; 3]| Point::new(AT[0] + x, AT[1] + y, AT[2] + z);
    let stamp = Timestamp::from_seconds(at_s);
    PlacedBeam { ladar: 0, stamp, origin: point(origin), end: point(end), is_return: true }
}

fn store(change: impl FnOnce(&mut ReturnsConfig)) -> Returns {
    let mut config = ReturnsConfig::default();
    change(&mut config);
    Returns::new(&config)
}

#[test]
fn a_return_is_found_in_its_column_to_a_tenth_of_a_millimetre() {
    let mut returns = store(|_| {});
    returns.insert(&beam(0.0, [0.0; 3], [3.001, 2.002, 0.503]));
    returns.insert(&PlacedBeam { is_return: false, ..beam(0.0, [0.0; 3], [3.0, 2.0, 0.5]) });
    returns.settle();
    let grid = VoxelGrid::new(0.15).unwrap();
    let center = grid.index_of(Point::new(AT[0], AT[1], AT[2])).unwrap();
    let view = View::unknown(Window::around(center, [12.0, 12.0, 6.0], grid), grid);
    let columns = ReturnColumns::of(&returns, &view);
    assert_eq!(columns.len(), 1, "the beam without a return is no return");
    let (column, row) = view.shape.cell_at(AT[0] + 3.001, AT[1] + 2.002).unwrap();
    let found = columns.column(row * view.shape.width + column)[0];
    let corner_m = [0, 1].map(|axis| f64::from(view.shape.first_cell[axis]) * 0.15);
    for (axis, expected) in [AT[0] + 3.001, AT[1] + 2.002].into_iter().enumerate() {
        assert!((f64::from(found.at_m[axis]) + corner_m[axis] - expected).abs() < 1e-4);
    }
    assert!((f64::from(found.at_m[2]) + view.base_m() - AT[2] - 0.503).abs() < 1e-4);
    assert!((f64::from(found.range_m()) - 3.6424).abs() < 1e-3, "sqrt(3.001^2 + 2.002^2 + 0.503^2)");
    let place = [AT[0] + 3.0 - corner_m[0], AT[1] + 2.0 - corner_m[1]];
    assert_eq!((columns.around(place, 0.01).count(), columns.around(place, 0.001).count()), (1, 0));
    assert_eq!(columns.around([-50.0, 1e9], 3.0).count(), 0);
}

#[test]
fn columns_made_in_the_memory_of_a_larger_view_are_those_made_anew() {
    let (mut returns, grid) = (store(|_| {}), VoxelGrid::new(0.15).unwrap());
    let along = |i: usize, step: f64| (i as f64 * step).sin() * 7.0;
    (0..600).for_each(|i| returns.insert(&beam(0.0, [0.0; 3], [along(i, 0.7), along(i, 1.3), 0.1 * along(i, 2.1)])));
    returns.settle();
    let center = grid.index_of(Point::new(AT[0], AT[1], AT[2])).unwrap();
    let view = |size_m: f64| View::unknown(Window::around(center, [size_m, size_m, 6.0], grid), grid);
    let (large, small) = (view(16.0), view(5.0));
    let mut columns = ReturnColumns::of(&returns, &large);
    let many = columns.len();
    for view in [&small, &large] {
        columns = columns.filled(&returns, view, &Moving::default());
        let anew = ReturnColumns::of(&returns, view);
        (0..view.shape.len()).for_each(|i| assert_eq!(columns.column(i), anew.column(i)));
        assert_eq!((columns.fresh(), columns.len()), (anew.fresh(), anew.len()));
    }
    assert!(columns.len() == many && many > 300, "{many}");
}

#[test]
fn a_cell_of_direction_keeps_its_newest_and_counts_the_rest() {
    let mut returns = store(|config| config.per_cell_max = 2);
    for i in 0..5 {
        returns.insert(&beam(f64::from(i), [0.0; 3], [1.0 + f64::from(i), 0.0, 0.0]));
    }
    returns.settle();
    returns.settle();
    let kept: Vec<f32> = returns.stations().flat_map(|s| s.beams().iter().map(|b| b.end_m[0])).collect();
    assert_eq!(kept, [4.0, 5.0]);
    assert_eq!((returns.len(), returns.drops().thinned), (2, 3));
}

#[test]
fn a_full_store_drops_its_oldest_station_and_a_single_station_starts_anew() {
    let mut returns = store(|config| (config.beams_max, config.per_cell_max) = (1000, 1000));
    for i in 0..1500 {
        returns.insert(&beam(0.0, [f64::from(i / 600), 0.0, 0.0], [9.0, 1e-3 * f64::from(i), 1.0]));
    }
    assert_eq!((returns.stations().len(), returns.len(), returns.drops().full), (2, 900, 600));
    let mut one = store(|config| (config.beams_max, config.per_cell_max) = (1000, 5000));
    (0..1001).for_each(|i| one.insert(&beam(0.0, [0.0; 3], [9.0, 1e-3 * f64::from(i), 1.0])));
    assert_eq!((one.len(), one.drops().full), (0, 1001));
}

#[test]
fn stations_are_parted_by_place_ladar_and_time_and_roll_away() {
    let mut returns = store(|config| (config.station_s, config.age_max_s) = (5.0, 60.0));
    for (at_s, x) in [(0.0, 0.0), (1.0, 0.01), (2.0, 3.0), (3.0, 0.0), (6.0, 0.0)] {
        returns.insert(&beam(at_s, [x, 0.0, 0.0], [9.0, 9.0, 1.0]));
    }
    returns.insert(&PlacedBeam { ladar: 1, ..beam(6.0, [0.0; 3], [9.0, 9.0, 1.0]) });
    let counts = |returns: &Returns| returns.stations().map(|station| station.beams().len()).collect::<Vec<_>>();
    assert_eq!(counts(&returns), [3, 1, 1, 1]);
    let here = Point::new(AT[0] + 4.0, AT[1], AT[2]);
    returns.roll(here, 3.5, Timestamp::from_seconds(10.0));
    assert_eq!(counts(&returns), [1, 1, 1], "the first lies 4 m away, the next keeps those after it");
    returns.roll(here, 100.0, Timestamp::from_seconds(65.0));
    assert_eq!((counts(&returns), returns.drops().left), (vec![1, 1], 4));
    returns.clear();
    assert!(returns.is_empty());
}

#[test]
fn nonsense_is_counted_and_kept_out() {
    let mut returns = store(|_| {});
    for end in [[f64::NAN, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0], [1e9, 0.0, 0.0], [0.0; 3]] {
        returns.insert(&beam(0.0, [0.0; 3], end));
    }
    assert_eq!((returns.len(), returns.drops().bad), (0, 4));
}

#[test]
fn towards_gives_every_beam_in_the_range_of_directions() {
    let found = std::cell::Cell::new(0);
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let directions = prop::collection::vec((-3.2..3.2f64, -1.5..1.5f64), 200);
    let window = (-4.0..4.0f64, 0.0..2.0f64, -1.5..1.0f64, 0.0..1.0f64);
    runner
        .run(&(directions, window), |(directions, (azimuth, width, elevation, height))| {
            let mut returns = store(|config| config.per_cell_max = 1000);
            for (a, e) in &directions {
                returns.insert(&beam(0.0, [0.0; 3], [5.0 * a.cos() * e.cos(), 5.0 * a.sin() * e.cos(), 5.0 * e.sin()]));
            }
            returns.settle();
            let station = returns.stations().next().unwrap();
            let ends: Vec<_> = station
                .towards(returns.cells(), azimuth..azimuth + width, elevation..elevation + height, 1)
                .map(|beam| beam.end_m)
                .collect();
            for (a, e) in &directions {
                let inside = (a - azimuth).rem_euclid(std::f64::consts::TAU) < width;
                if inside && (elevation..elevation + height).contains(e) {
                    let end = [a.cos() * e.cos(), a.sin() * e.cos(), e.sin()].map(|c| (5.0 * c) as f32);
                    let near = |other: &[f32; 3]| (0..3).all(|axis| (other[axis] - end[axis]).abs() < 1e-3);
                    prop_assert_eq!(ends.iter().filter(|other| near(other)).count(), 1);
                    found.set(found.get() + 1);
                }
            }
            Ok(())
        })
        .unwrap();
    assert!(found.get() > 500, "{found:?} beams found");
}
