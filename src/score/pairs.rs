//! Do the stems of two surveys of one plot agree: the rigid motion that brings most of them together, and the pairs.
//!
//! In: two tables of trees, each in coordinates of its own, metres. Out: the rotation and shift from the first to the
//! second, the pairs with their distances and differences in diameter, and how many pairs the best other motion
//! makes: what chance alone would give. Every two stems of one table are laid on every two of the other that stand
//! equally far apart; the best motion is then fitted to its pairs by least squares. Heights do not take part.

use super::found::FoundTree;
use super::statistics::{mean, rms};
use serde::Serialize;
use tsense_simulator::matching;

/// Stems nearer than this do not say how a plot is turned, metres.
const APART_MIN_M: f64 = 3.0;
/// Most stems of a table, the thickest first: the search grows with the fourth power.
const STEMS_MAX: usize = 60;
/// Motions that differ by less than this are the same: radians, metres.
const SAME: (f64, f64) = (0.09, 1.5);
/// Rounds of fitting after the search.
const ROUNDS: usize = 10;

/// A turn about the vertical and a shift.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Motion {
    /// Counter-clockwise, radians.
    pub turn_rad: f64,
    /// Where the first table's middle goes, metres, in the second's coordinates.
    pub middle_m: [f64; 2],
    /// The first table's middle, metres.
    pub from_m: [f64; 2],
}

impl Motion {
    fn apply(&self, at_m: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let [x, y] = [0, 1].map(|axis| at_m[axis] - self.from_m[axis]);
        [self.middle_m[0] + cos * x - sin * y, self.middle_m[1] + sin * x + cos * y]
    }
}

/// Two stems that are taken for one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// Line of the first table, from 1.
    pub a: usize,
    /// Line of the second table, from 1.
    pub b: usize,
    /// How far apart they are, metres.
    pub distance_m: f64,
    /// Diameters, metres; null where not reported.
    pub dbh_m: [Option<f64>; 2],
}

/// How two tables agree.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Stems in each table.
    pub stems: [usize; 2],
    /// From the first to the second.
    pub motion: Motion,
    /// The pairs, in order of the first table.
    pub pairs: Vec<Pair>,
    /// Root mean square distance of the pairs, metres.
    pub distance_rms_m: Option<f64>,
    /// Mean of the second's diameter minus the first's, metres, and root mean square.
    pub dbh_difference_m: [Option<f64>; 2],
    /// Pairs that the best clearly different motion makes.
    pub pairs_by_chance: usize,
}

/// The agreement of two tables; stems within `within_m` pair. Nothing where no two stems of each stand alike.
pub fn agreement(a: &[FoundTree], b: &[FoundTree], within_m: f64) -> Option<Agreement> {
    let (thick_a, thick_b) = (thickest(a), thickest(b));
    let mut motions = candidates(&thick_a, &thick_b, within_m);
    motions.sort_by_key(|(pairs, _)| std::cmp::Reverse(*pairs));
    let best = motions.first()?.1;
    // The first table's middle: motions that bring it to one place, turned alike, are one.
    let middle_m = [0, 1].map(|axis| mean(a.iter().map(|tree| tree.at_m[axis])).unwrap_or(0.0));
    let other = |motion: &Motion| {
        let turn = (motion.turn_rad - best.turn_rad).sin().atan2((motion.turn_rad - best.turn_rad).cos());
        turn.abs() > SAME.0 || distance_m(motion.apply(middle_m), best.apply(middle_m)) > SAME.1
    };
    let pairs_by_chance = motions.iter().find(|(_, motion)| other(motion)).map_or(0, |(pairs, _)| *pairs);
    let (places_a, places_b) = (places(a), places(b));
    let mut motion = best;
    for _ in 0..ROUNDS {
        motion = fit(&places_a, &places_b, &pairs_of(&motion, &places_a, &places_b, within_m)).unwrap_or(motion);
    }
    let mut pairs: Vec<Pair> = pairs_of(&motion, &places_a, &places_b, within_m)
        .into_iter()
        .map(|(i, j)| Pair {
            a: i + 1,
            b: j + 1,
            distance_m: distance_m(motion.apply(places_a[i]), places_b[j]),
            dbh_m: [a[i].dbh_m, b[j].dbh_m].map(|d| d.is_finite().then_some(d)),
        })
        .collect();
    pairs.sort_by_key(|pair| pair.a);
    let differences = || pairs.iter().filter_map(|pair| Some(pair.dbh_m[1]? - pair.dbh_m[0]?));
    Some(Agreement {
        stems: [a.len(), b.len()],
        distance_rms_m: rms(pairs.iter().map(|pair| pair.distance_m)),
        dbh_difference_m: [mean(differences()), rms(differences())],
        motion,
        pairs_by_chance,
        pairs,
    })
}

fn places(trees: &[FoundTree]) -> Vec<[f64; 2]> {
    trees.iter().map(|tree| tree.at_m).collect()
}

fn thickest(trees: &[FoundTree]) -> Vec<[f64; 2]> {
    let mut sorted: Vec<&FoundTree> = trees.iter().collect();
    sorted.sort_by(|a, b| b.dbh_m.total_cmp(&a.dbh_m));
    sorted.iter().take(STEMS_MAX).map(|tree| tree.at_m).collect()
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Every motion that lays two stems on two, with the stems that then lie near one.
fn candidates(a: &[[f64; 2]], b: &[[f64; 2]], within_m: f64) -> Vec<(usize, Motion)> {
    let mut motions = Vec::new();
    for (i, p) in a.iter().enumerate() {
        for q in &a[i + 1..] {
            let apart_m = distance_m(*p, *q);
            if apart_m < APART_MIN_M {
                continue;
            }
            for r in b {
                for s in b.iter().filter(|s| (distance_m(*r, **s) - apart_m).abs() <= within_m) {
                    let motion = laid([*p, *q], [*r, *s]);
                    let near = |at_m: &&[f64; 2]| b.iter().any(|to| distance_m(motion.apply(**at_m), *to) <= within_m);
                    motions.push((a.iter().filter(near).count(), motion));
                }
            }
        }
    }
    motions
}

/// The motion that lays the middle and the direction of two places on those of two others.
fn laid([p, q]: [[f64; 2]; 2], [r, s]: [[f64; 2]; 2]) -> Motion {
    let direction = |from: [f64; 2], to: [f64; 2]| (to[1] - from[1]).atan2(to[0] - from[0]);
    let middle = |from: [f64; 2], to: [f64; 2]| [0, 1].map(|axis| (from[axis] + to[axis]) / 2.0);
    Motion { turn_rad: direction(r, s) - direction(p, q), middle_m: middle(r, s), from_m: middle(p, q) }
}

fn pairs_of(motion: &Motion, a: &[[f64; 2]], b: &[[f64; 2]], within_m: f64) -> Vec<(usize, usize)> {
    let moved: Vec<[f64; 2]> = a.iter().map(|at_m| motion.apply(*at_m)).collect();
    matching(&moved, b, within_m)
}

/// The motion nearest to pairs in the sense of least squares.
fn fit(a: &[[f64; 2]], b: &[[f64; 2]], pairs: &[(usize, usize)]) -> Option<Motion> {
    let count = (pairs.len() >= 2).then_some(pairs.len() as f64)?;
    let middle = |of: &dyn Fn(&(usize, usize)) -> [f64; 2]| {
        [0, 1].map(|axis| pairs.iter().map(|pair| of(pair)[axis]).sum::<f64>() / count)
    };
    let (from_m, middle_m) = (middle(&|(i, _)| a[*i]), middle(&|(_, j)| b[*j]));
    let (mut cross, mut dot) = (0.0, 0.0);
    for (i, j) in pairs {
        let [x, y] = [0, 1].map(|axis| a[*i][axis] - from_m[axis]);
        let [u, v] = [0, 1].map(|axis| b[*j][axis] - middle_m[axis]);
        (cross, dot) = (cross + x * v - y * u, dot + x * u + y * v);
    }
    Some(Motion { turn_rad: cross.atan2(dot), middle_m, from_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(x: f64, y: f64, dbh_m: f64) -> FoundTree {
        FoundTree { at_m: [x, y], dbh_m, dbh_std_m: f64::NAN, height_m: f64::NAN }
    }

    #[test]
    fn a_turned_and_shifted_table_is_laid_on_the_other() {
        // Eight stems, turned by 40 degrees and shifted far away; one of each table is unknown to the other.
        let spots =
            [[0.0, 0.0], [4.0, 1.0], [9.0, -2.0], [3.0, 7.0], [12.0, 6.0], [7.5, 11.0], [-3.0, 5.0], [1.0, 13.0]];
        let (sin, cos) = 40f64.to_radians().sin_cos();
        let mut a: Vec<FoundTree> = spots.iter().map(|[x, y]| tree(*x, *y, 0.30)).collect();
        let mut b: Vec<FoundTree> = spots
            .iter()
            .enumerate()
            .map(|(i, [x, y])| {
                let wobble = 0.05 * if i % 2 == 0 { 1.0 } else { -1.0 };
                tree(5000.0 + cos * x - sin * y + wobble, 700.0 + sin * x + cos * y, 0.32)
            })
            .rev()
            .collect();
        a.push(tree(20.0, 20.0, 0.2));
        b.push(tree(5030.0, 690.0, 0.2));
        let found = agreement(&a, &b, 0.3).unwrap();
        assert_eq!((found.pairs.len(), found.stems), (8, [9, 9]));
        assert!((found.motion.turn_rad.to_degrees() - 40.0).abs() < 0.5, "{:?}", found.motion);
        assert!(found.pairs.iter().all(|pair| pair.a + pair.b == 9), "{:?}", found.pairs);
        assert!(found.distance_rms_m.unwrap() < 0.06 && (found.dbh_difference_m[0].unwrap() - 0.02).abs() < 1e-9);
        assert!(found.pairs_by_chance < 6, "{}", found.pairs_by_chance);
    }

    #[test]
    fn too_few_stems_say_nothing() {
        assert!(agreement(&[], &[tree(0.0, 0.0, 0.3)], 0.3).is_none());
        assert!(agreement(&[tree(0.0, 0.0, 0.3)], &[tree(0.0, 0.0, 0.3)], 0.3).is_none());
    }
}
