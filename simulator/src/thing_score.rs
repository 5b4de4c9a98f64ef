//! Scores reported things that are no trees: is there such a thing where one is reported, and how many rocks were found.
//!
//! In: places of reported things, and places that the system knows something of. Out: counts. A thing is right when what
//! it is called stands within [`NEAR_M`] of its place. Pieces of walls, ditches and brush are counted one by one; only rocks
//! are things that can be missed as a whole: those that are known, high enough, and have their middle in a known place.

use crate::scene::{Scene, TrueRock};
use crate::score::BRUSH_MIN_M;
use serde::{Deserialize, Serialize};

/// Farthest a report may lie from the edge of what it reports, metres.
const NEAR_M: f64 = 0.3;
/// A rock that is higher counts as missed where it is not reported, metres.
const ROCK_MIN_M: f64 = 0.3;

/// What a thing is reported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThingKind {
    /// A rock.
    Rock,
    /// A piece of a wall.
    Wall,
    /// A piece of the edge of a ditch.
    Drop,
    /// A patch of brush.
    Brush,
}

/// A reported thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedThing {
    /// What it is reported as.
    pub kind: ThingKind,
    /// UTM easting and northing of its middle, metres.
    pub at_m: [f64; 2],
}

/// Reports of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KindScore {
    /// Things reported.
    pub reported: usize,
    /// Those of them that are there.
    pub right: usize,
}

/// How well things were told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ThingScore {
    /// Rocks.
    pub rocks: KindScore,
    /// Rocks in known places, and how many of them were reported.
    pub rocks_true: usize,
    /// Rocks in known places that were reported.
    pub rocks_found: usize,
    /// Root mean square distance of those from their middles, metres; nothing without one.
    pub rock_position_rmse_m: Option<f64>,
    /// Pieces of walls.
    pub walls: KindScore,
    /// Pieces of drops.
    pub drops: KindScore,
    /// Patches of brush.
    pub brush: KindScore,
}

/// Scores things against the scene; `is_known` says whether anything is known of a place.
pub fn score_things(scene: &Scene, things: &[ReportedThing], is_known: impl Fn([f64; 2]) -> bool) -> ThingScore {
    let count = |kind: ThingKind| {
        let of_kind = || things.iter().filter(|thing| thing.kind == kind);
        KindScore { reported: of_kind().count(), right: of_kind().filter(|thing| scene.has(thing)).count() }
    };
    let counts = |rock: &TrueRock| rock.height_m > ROCK_MIN_M && is_known([rock.easting_m, rock.northing_m]);
    let in_sight: Vec<TrueRock> = scene.true_rocks().into_iter().filter(counts).collect();
    let rocks = || things.iter().filter(|thing| thing.kind == ThingKind::Rock);
    let nearest_m = |rock: &TrueRock| {
        let near = rocks().map(|thing| off_m(rock, thing.at_m)).filter(|off_m| *off_m <= rock.reach_m / 2.0 + NEAR_M);
        near.min_by(f64::total_cmp)
    };
    let off: Vec<f64> = in_sight.iter().filter_map(nearest_m).collect();
    let mean_square = off.iter().map(|m| m * m).sum::<f64>() / off.len() as f64;
    ThingScore {
        rocks: count(ThingKind::Rock),
        rocks_true: in_sight.len(),
        rocks_found: off.len(),
        rock_position_rmse_m: (!off.is_empty()).then(|| mean_square.sqrt()),
        walls: count(ThingKind::Wall),
        drops: count(ThingKind::Drop),
        brush: count(ThingKind::Brush),
    }
}

fn off_m(rock: &TrueRock, [easting, northing]: [f64; 2]) -> f64 {
    (rock.easting_m - easting).hypot(rock.northing_m - northing)
}

impl Scene {
    /// Whether what a thing is reported as stands at its place or near it.
    fn has(&self, thing: &ReportedThing) -> bool {
        let [easting, northing] = thing.at_m;
        let near = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|k| k * NEAR_M);
        let any =
            |is: &dyn Fn(f64, f64) -> bool| near.iter().any(|x| near.iter().any(|y| is(easting + x, northing + y)));
        match thing.kind {
            ThingKind::Rock => {
                self.true_rocks().iter().any(|rock| off_m(rock, thing.at_m) <= rock.reach_m / 2.0 + NEAR_M)
            }
            ThingKind::Wall => any(&|e, n| self.is_wall(e, n)),
            ThingKind::Drop => any(&|e, n| self.drop_at_m(e, n) > 0.0),
            ThingKind::Brush => any(&|e, n| self.brush_at_m(e, n) >= BRUSH_MIN_M),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SceneName;

    #[test]
    fn every_rock_reported_a_little_off_is_found_and_one_in_the_open_is_wrong() {
        let scene = Scene::new(SceneName::Rocks, 1);
        let high: Vec<TrueRock> = scene.true_rocks().into_iter().filter(|rock| rock.height_m > ROCK_MIN_M).collect();
        let mut things: Vec<ReportedThing> = high
            .iter()
            .map(|rock| ReportedThing { kind: ThingKind::Rock, at_m: [rock.easting_m + 0.1, rock.northing_m] })
            .collect();
        let open = |at_m: &[f64; 2]| scene.true_rocks().iter().all(|rock| off_m(rock, *at_m) > 2.0);
        let at_m = (0..100).map(|i| [high[0].easting_m + f64::from(i), high[0].northing_m]).find(open).unwrap();
        things.push(ReportedThing { kind: ThingKind::Rock, at_m });
        let score = score_things(&scene, &things, |_| true);
        assert_eq!(score.rocks, KindScore { reported: high.len() + 1, right: high.len() });
        assert_eq!((score.rocks_true, score.rocks_found), (high.len(), high.len()));
        assert!(score.rock_position_rmse_m.unwrap() <= 0.1 + 1e-9 && high.len() > 100);
        assert_eq!(score_things(&scene, &[], |_| false), ThingScore::default());
    }

    #[test]
    fn a_piece_of_a_wall_is_right_beside_it_and_wrong_a_metre_away() {
        let scene = Scene::new(SceneName::Wall, 1);
        let [[east, north], _] = scene.true_walls()[0].ends_m;
        let piece = |off: f64| ReportedThing { kind: ThingKind::Wall, at_m: [east + 1.0, north + off] };
        let score = score_things(&scene, &[piece(0.0), piece(0.4), piece(-1.0)], |_| true);
        assert_eq!(score.walls, KindScore { reported: 3, right: 2 });
    }
}
