//! Which rigid move lays the trees in sight on the stored ones: each pair of a seen and a stored tree votes for a
//! move, and the move that most trees agree with wins, if no other comes near it.
//!
//! In: places (metres) and diameters of both. Out: a move about a place, and how many trees agree.
//! Source: consensus of pair offsets (a Hough transform over moves), then the least-squares rigid fit of the pairs
//! (Procrustes in the plane).

use crate::correction::{Correction, distance_m, minus, plus, turned};
use crate::object::Estimate;
use std::collections::{BTreeMap, BTreeSet};

/// A tree as a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landmark {
    /// Easting, northing, metres.
    pub place_m: [f64; 2],
    /// Trunk diameter.
    pub dbh: Option<Estimate>,
}

impl Landmark {
    /// False where the diameters say that these are two trees.
    pub fn may_be(&self, other: &Self) -> bool {
        match (self.dbh, other.dbh) {
            (Some(a), Some(b)) => (a.value - b.value).abs() <= 3.0 * a.std.hypot(b.std) + DBH_SLACK_M,
            _ => true,
        }
    }
}

/// A place that is seen and the stored one it belongs to.
pub type Pair = ([f64; 2], [f64; 2]);

/// Diameters are off by this much for reasons that their deviations do not know, metres.
const DBH_SLACK_M: f64 = 0.05;
/// Edge of a bin of votes, metres: a few standard deviations of a pair's offset.
const BIN_M: f64 = 0.25;
/// Bins that are looked at closely.
const BINS: usize = 6;
/// Rounds of pairing and fitting: the second one pairs what the turn of the first brought near.
const ROUNDS: usize = 3;
/// Pairs from which a turn is taken; fewer tell only the offset.
const TURN_PAIRS_MIN: usize = 6;
/// A pose's heading is not farther off than this, radians (6 degrees).
pub const TURN_MAX_RAD: f64 = 0.105;

/// A move and who agrees with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Consensus {
    /// The move, about the given place.
    pub correction: Correction,
    /// Trees in sight that lie on a stored one after it.
    pub agreed: usize,
    /// The same for the best move that is another one.
    pub runner_up: usize,
}

/// The move about `about_m` that most of `seen` agree with; offsets up to `reach_m`, agreement within `agree_m`.
pub fn consensus(
    seen: &[Landmark],
    stored: &[Landmark],
    about_m: [f64; 2],
    reach_m: f64,
    agree_m: f64,
) -> Option<Consensus> {
    let mut moves: Vec<(usize, Correction)> = fullest_bins(seen, stored, reach_m)
        .into_iter()
        .map(|offset_m| fit(seen, stored, about_m, Correction { offset_m, turn_rad: 0.0 }, agree_m))
        .collect();
    // Of equals the shortest: the pose is rarely off.
    moves.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.length_m().total_cmp(&b.1.length_m())));
    let &(agreed, correction) = moves.first()?;
    let is_another = |c: &Correction| distance_m(c.offset_m, correction.offset_m) > 2.0 * agree_m;
    let runner_up = moves.iter().filter(|(_, c)| is_another(c)).map(|(n, _)| *n).max().unwrap_or(0);
    Some(Consensus { correction, agreed, runner_up })
}

/// Offsets that many pairs have in common, the most popular first.
fn fullest_bins(seen: &[Landmark], stored: &[Landmark], reach_m: f64) -> Vec<[f64; 2]> {
    let mut bins: BTreeMap<(i64, i64), (usize, [f64; 2])> = BTreeMap::new();
    for a in seen {
        for b in stored.iter().filter(|b| a.may_be(b)) {
            let offset = minus(b.place_m, a.place_m);
            if offset[0].hypot(offset[1]) <= reach_m {
                let [column, row] = offset.map(|x| (x / BIN_M).floor() as i64);
                let bin = bins.entry((column, row)).or_default();
                *bin = (bin.0 + 1, plus(bin.1, offset));
            }
        }
    }
    // With its neighbours: a bin's border may cut a cluster in two.
    let around = |&(column, row): &(i64, i64)| {
        let near = (column - 1..=column + 1).flat_map(|c| (row - 1..=row + 1).map(move |r| (c, r)));
        let (votes, sum) =
            near.filter_map(|key| bins.get(&key)).fold((0, [0.0; 2]), |s, b| (s.0 + b.0, plus(s.1, b.1)));
        (votes, sum.map(|x| x / votes.max(1) as f64))
    };
    let mut sums: Vec<(usize, [f64; 2])> = bins.keys().map(around).collect();
    sums.sort_by_key(|(votes, _)| std::cmp::Reverse(*votes));
    let mut best: Vec<[f64; 2]> = Vec::new();
    for (_, offset) in sums {
        if best.len() < BINS && best.iter().all(|b| distance_m(*b, offset) > BIN_M) {
            best.push(offset);
        }
    }
    best
}

/// Pairs, fits, and pairs again; how many agree in the end, and the move.
fn fit(
    seen: &[Landmark],
    stored: &[Landmark],
    about_m: [f64; 2],
    start: Correction,
    agree_m: f64,
) -> (usize, Correction) {
    let mut correction = start;
    for _ in 0..ROUNDS {
        correction = rigid(&pairs(seen, stored, about_m, &correction, agree_m), about_m).unwrap_or(correction);
    }
    (pairs(seen, stored, about_m, &correction, agree_m).len(), correction)
}

/// Each seen tree with the nearest stored one after the move, each stored tree once.
pub fn pairs(
    seen: &[Landmark],
    stored: &[Landmark],
    about_m: [f64; 2],
    correction: &Correction,
    agree_m: f64,
) -> Vec<Pair> {
    let mut taken = BTreeSet::new();
    let mut pairs = Vec::new();
    for a in seen {
        let moved = correction.apply(about_m, a.place_m);
        let near =
            stored.iter().enumerate().filter(|(_, b)| a.may_be(b)).map(|(i, b)| (distance_m(moved, b.place_m), i));
        if let Some((distance_m, i)) = near.min_by(|a, b| a.0.total_cmp(&b.0))
            && distance_m <= agree_m
            && taken.insert(i)
        {
            pairs.push((a.place_m, stored[i].place_m));
        }
    }
    pairs
}

/// The least-squares move about a place that takes the first of each pair to the second; nothing without pairs.
pub fn rigid(pairs: &[Pair], about_m: [f64; 2]) -> Option<Correction> {
    let n = pairs.len() as f64;
    let mean = |side: fn(&Pair) -> [f64; 2]| pairs.iter().map(side).fold([0.0; 2], plus).map(|x| x / n);
    let (from, to) = (mean(|p| p.0), mean(|p| p.1));
    let turn_rad = if pairs.len() < TURN_PAIRS_MIN { 0.0 } else { turn(pairs, from, to) };
    let offset_m = minus(minus(to, about_m), turned(minus(from, about_m), turn_rad));
    (!pairs.is_empty()).then_some(Correction { offset_m, turn_rad })
}

/// The angle of the rigid fit; none where it is larger than a heading can be wrong.
fn turn(pairs: &[Pair], from: [f64; 2], to: [f64; 2]) -> f64 {
    let (mut cross, mut dot) = (0.0, 0.0);
    for (a, b) in pairs {
        let (a, b) = (minus(*a, from), minus(*b, to));
        cross += a[0] * b[1] - a[1] * b[0];
        dot += a[0] * b[0] + a[1] * b[1];
    }
    let turn_rad = f64::atan2(cross, dot);
    if turn_rad.abs() <= TURN_MAX_RAD { turn_rad } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trees(places: &[[f64; 2]]) -> Vec<Landmark> {
        places.iter().map(|place_m| Landmark { place_m: *place_m, dbh: None }).collect()
    }

    /// No two pairs of these stand alike.
    const STAND: [[f64; 2]; 8] =
        [[0.0, 0.0], [3.1, 0.4], [7.0, -2.0], [1.0, 5.2], [-4.0, 2.5], [6.3, 6.1], [-2.2, -5.0], [10.0, 3.0]];

    #[test]
    fn a_turn_and_an_offset_are_found_and_nothing_comes_near_them() {
        let truth = Correction { offset_m: [1.3, -0.9], turn_rad: 0.03 };
        let stored: Vec<[f64; 2]> = STAND.iter().map(|p| truth.apply([2.0, 1.0], *p)).collect();
        let found = consensus(&trees(&STAND), &trees(&stored), [2.0, 1.0], 3.0, 0.4).unwrap();
        assert!((found.correction.turn_rad - 0.03).abs() < 1e-9, "{found:?}");
        assert!(distance_m(found.correction.offset_m, truth.offset_m) < 1e-9);
        assert!(found.agreed == 8 && found.runner_up <= 3, "{found:?}");
    }

    /// A row planted every two metres looks the same two metres on.
    #[test]
    fn a_planted_row_leaves_it_open_which_tree_is_which() {
        let row: Vec<[f64; 2]> = (0..10).map(|i| [2.0 * f64::from(i), 0.0]).collect();
        let seen: Vec<[f64; 2]> = (2..8).map(|i| [2.0 * f64::from(i) + 1.0, 0.0]).collect();
        let found = consensus(&trees(&seen), &trees(&row), [10.0, 0.0], 3.0, 0.4).unwrap();
        assert_eq!((found.agreed, found.runner_up), (6, 6));
    }

    #[test]
    fn trunks_of_another_width_do_not_vote() {
        let wide = |dbh: f64| Some(Estimate { value: dbh, std: 0.02 });
        let (thin, thick) = ([0.0, 0.0], [1.0, 0.0]);
        let seen = [Landmark { place_m: thin, dbh: wide(0.2) }];
        let stored = [Landmark { place_m: thick, dbh: wide(0.6) }];
        assert_eq!(consensus(&seen, &stored, [0.0; 2], 3.0, 0.4), None);
        assert_eq!(consensus(&seen, &[], [0.0; 2], 3.0, 0.4), None);
    }
}
