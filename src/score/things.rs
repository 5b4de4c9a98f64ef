//! Drops, rocks and walls of a survey against those of a scene.
//!
//! In: shapes, the scene, which places count. Out: shares, metres. Rocks are counted one by one, as live. A drop or a wall is
//! long: of it counts which of its cells are covered, or lie beside one that is, and of what is told which share lies
//! within 0.3 m of a true one, wherever it is told.

use super::shapes::{STEP_M, Shape, middle_m};
use serde::Serialize;
use std::collections::BTreeSet;
use tsense_simulator::{ReportedThing, Scene, ThingKind as Kind, score_things};

/// Depth below the ground beside it from which a place in a ditch is to be found, metres: as live.
const DROP_MIN_M: f64 = 0.5;
/// Farthest from a true drop or wall that what is told may lie, cells: 0.3 m.
const NEAR_CELLS: i64 = 2;

/// Rocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RockScore {
    /// Rocks higher than 0.3 m in places that count.
    #[serde(rename = "true")]
    pub truth: usize,
    /// Those of them that were told.
    pub found: usize,
    /// Rocks told.
    pub told: usize,
    /// Those of them that are there.
    pub right: usize,
    /// Distance of the middles of those found, rms, metres.
    pub position_rmse_m: Option<f64>,
}

/// Long things.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LongScore {
    /// Area in places that count, square metres.
    pub true_m2: f64,
    /// Share of it that was found.
    pub found: Option<f64>,
    /// Area told, square metres.
    pub told_m2: f64,
    /// Share of it that is there.
    pub right: Option<f64>,
    /// How far across the true thing the middle of what is right lies beside its own, metres.
    pub off_m: Option<f64>,
}

/// All of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ShapeScore {
    /// Rocks.
    pub rocks: RockScore,
    /// Drops.
    pub drops: LongScore,
    /// Walls.
    pub walls: LongScore,
}

/// Scores shapes; `places` are the cells that count, `is_near` says the same of any place.
pub fn score(scene: &Scene, shapes: &[Shape], places: &[[i64; 2]], is_near: impl Fn([f64; 2]) -> bool) -> ShapeScore {
    let of = |kind: Kind| shapes.iter().filter(move |shape| shape.kind == kind);
    let told: Vec<ReportedThing> =
        of(Kind::Rock).filter_map(|rock| Some(ReportedThing { kind: Kind::Rock, at_m: rock.middle_m()? })).collect();
    let rocks = score_things(scene, &told, is_near);
    let cells = |kind: Kind| of(kind).flat_map(|shape| shape.cells.iter().copied()).collect::<BTreeSet<_>>();
    let drop = |least_m: f64| move |[e, n]: [f64; 2]| scene.drop_at_m(e, n) > least_m;
    let wall = |[e, n]: [f64; 2]| scene.is_wall(e, n);
    let ditch = scene.true_drops().first().map(|drop| drop.ends_m);
    let side = scene.true_walls().first().map(|wall| wall.ends_m);
    ShapeScore {
        rocks: RockScore {
            truth: rocks.rocks_true,
            found: rocks.rocks_found,
            told: rocks.rocks.reported,
            right: rocks.rocks.right,
            position_rmse_m: rocks.rock_position_rmse_m,
        },
        drops: long(&cells(Kind::Drop), places, drop(DROP_MIN_M), drop(0.0), ditch),
        walls: long(&cells(Kind::Wall), places, wall, wall, side),
    }
}

fn long(
    told: &BTreeSet<[i64; 2]>,
    places: &[[i64; 2]],
    is_wanted: impl Fn([f64; 2]) -> bool,
    is_there: impl Fn([f64; 2]) -> bool,
    ends_m: Option<[[f64; 2]; 2]>,
) -> LongScore {
    let wanted: Vec<[i64; 2]> = places.iter().copied().filter(|cell| is_wanted(middle_m(*cell))).collect();
    let found = wanted.iter().filter(|cell| around(**cell, 1).any(|cell| told.contains(&cell))).count();
    let right: Vec<[i64; 2]> =
        told.iter().copied().filter(|cell| around(*cell, NEAR_CELLS).any(|cell| is_there(middle_m(cell)))).collect();
    let share = |part: usize, whole: usize| (whole > 0).then(|| part as f64 / whole as f64);
    let across_m = |[[x0, y0], [x1, y1]]: [[f64; 2]; 2]| {
        let (east, north, length) = (x1 - x0, y1 - y0, (x1 - x0).hypot(y1 - y0));
        let across = |cell: &[i64; 2]| {
            let [x, y] = middle_m(*cell);
            (east * (y - y0) - north * (x - x0)) / length
        };
        right.iter().map(across).sum::<f64>() / right.len() as f64
    };
    LongScore {
        true_m2: wanted.len() as f64 * STEP_M * STEP_M,
        found: share(found, wanted.len()),
        told_m2: told.len() as f64 * STEP_M * STEP_M,
        right: share(right.len(), told.len()),
        off_m: ends_m.filter(|_| !right.is_empty()).map(|ends_m| across_m(ends_m).abs()),
    }
}

/// A cell and those around it.
fn around([column, row]: [i64; 2], reach: i64) -> impl Iterator<Item = [i64; 2]> {
    (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |x| [column + x, row + y]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_simulator::{ORIGIN_M, SceneName};

    fn places() -> Vec<[i64; 2]> {
        let first = [0, 1].map(|axis| (ORIGIN_M[axis] / STEP_M) as i64 - 150);
        (0..300).flat_map(|row| (0..300).map(move |column| [first[0] + column, first[1] + row])).collect()
    }

    fn shape(kind: Kind, of: impl Fn([f64; 2]) -> bool) -> Shape {
        Shape { kind, cells: places().into_iter().filter(|cell| of(middle_m(*cell))).collect() }
    }

    #[test]
    fn half_a_ditch_is_half_found_and_what_is_told_beside_it_is_wrong() {
        let scene = Scene::new(SceneName::Ditch, 1);
        let west = |[e, n]: [f64; 2]| e < ORIGIN_M[0] + 4.0 && scene.drop_at_m(e, n) > 0.3;
        let half = shape(Kind::Drop, west);
        let score = |shapes: &[Shape]| score(&scene, shapes, &places(), |_| true).drops;
        let one = score(std::slice::from_ref(&half));
        assert!((0.4..0.7).contains(&one.found.unwrap()) && one.right == Some(1.0) && one.true_m2 > 10.0, "{one:?}");
        assert!(one.off_m.unwrap() < 0.05, "{one:?}");
        let beside = shape(Kind::Drop, |[e, n]| west([e, n + 5.0]));
        let both = score(&[half, beside]);
        assert!((both.right.unwrap() - 0.5).abs() < 0.05 && both.found == one.found, "{both:?}");
        assert_eq!(score(&[]).found, Some(0.0));
    }

    #[test]
    fn a_wall_told_half_a_metre_beside_itself_is_not_found() {
        let scene = Scene::new(SceneName::Wall, 1);
        let walls = |off: f64| {
            let told = shape(Kind::Wall, |[e, n]| scene.is_wall(e, n + off));
            score(&scene, &[told], &places(), |_| true).walls
        };
        assert_eq!((walls(0.0).found, walls(0.0).right), (Some(1.0), Some(1.0)));
        assert!(walls(0.9).found < Some(0.1) && walls(0.9).right < Some(0.1), "{:?}", walls(0.9));
        assert!((walls(0.2).off_m.unwrap() - 0.2).abs() < 0.06, "{:?}", walls(0.2));
    }

    #[test]
    fn rocks_are_counted_one_by_one() {
        let scene = Scene::new(SceneName::Rocks, 1);
        let rock = scene.true_rocks().into_iter().max_by(|a, b| a.height_m.total_cmp(&b.height_m)).unwrap();
        let at = |[e, n]: [f64; 2]| (e - rock.easting_m).hypot(n - rock.northing_m);
        let cell = [rock.easting_m, rock.northing_m].map(|m| (m / STEP_M).floor() as i64);
        let shapes = [Shape { kind: Kind::Rock, cells: around(cell, 1).collect() }];
        let score = score(&scene, &shapes, &[], |place| at(place) < 0.1).rocks;
        assert_eq!((score.truth, score.found, score.told, score.right), (1, 1, 1, 1));
        assert!(score.position_rmse_m.unwrap() < 0.11);
    }
}
