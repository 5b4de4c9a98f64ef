//! Optimal one-to-one matching within a distance: as many pairs as possible, then the least sum of distances.
//!
//! In: places as east, north in metres. Out: pairs of indices. The method is the Hungarian one with potentials
//! (Kuhn and Munkres), on the few true places that lie near any reported one.

/// A pair that may not be: dearer than any sum of allowed ones.
const FORBIDDEN: f64 = 1e6;

/// Pairs (reported, true) with both indices used at most once and no pair farther apart than `distance_max_m`.
pub fn matching(reported: &[[f64; 2]], truth: &[[f64; 2]], distance_max_m: f64) -> Vec<(usize, usize)> {
    let distance = |r: &[f64; 2], t: &[f64; 2]| (r[0] - t[0]).hypot(r[1] - t[1]);
    let near: Vec<usize> =
        (0..truth.len()).filter(|t| reported.iter().any(|r| distance(r, &truth[*t]) <= distance_max_m)).collect();
    let candidates: Vec<usize> = (0..reported.len())
        .filter(|r| near.iter().any(|t| distance(&reported[*r], &truth[*t]) <= distance_max_m))
        .collect();
    let cost = |i: usize, j: usize| {
        // Columns beyond the true places stand for "not matched".
        let Some(t) = near.get(j) else { return FORBIDDEN };
        let d = distance(&reported[candidates[i]], &truth[*t]);
        if d <= distance_max_m { d } else { FORBIDDEN }
    };
    let columns = near.len() + candidates.len();
    let assigned = assign(candidates.len(), columns, cost);
    let pairs = assigned.into_iter().enumerate().filter(|(i, j)| cost(*i, *j) < FORBIDDEN);
    pairs.map(|(i, j)| (candidates[i], near[j])).collect()
}

/// The cheapest column for every row, no column twice; there are at least as many columns as rows.
fn assign(rows: usize, columns: usize, cost: impl Fn(usize, usize) -> f64) -> Vec<usize> {
    // Index 0 is a place-holder, rows and columns count from 1.
    let (mut row_price, mut column_price) = (vec![0.0; rows + 1], vec![0.0; columns + 1]);
    let mut row_of = vec![0; columns + 1];
    for row in 1..=rows {
        row_of[0] = row;
        let mut here = 0;
        let (mut least, mut way, mut done) =
            (vec![f64::INFINITY; columns + 1], vec![0; columns + 1], vec![false; columns + 1]);
        while row_of[here] != 0 {
            done[here] = true;
            let (i, mut delta, mut next) = (row_of[here], f64::INFINITY, 0);
            for j in (1..=columns).filter(|j| !done[*j]) {
                let reduced = cost(i - 1, j - 1) - row_price[i] - column_price[j];
                if reduced < least[j] {
                    (least[j], way[j]) = (reduced, here);
                }
                if least[j] < delta {
                    (delta, next) = (least[j], j);
                }
            }
            for j in 0..=columns {
                if done[j] {
                    row_price[row_of[j]] += delta;
                    column_price[j] -= delta;
                } else {
                    least[j] -= delta;
                }
            }
            here = next;
        }
        while here != 0 {
            row_of[here] = row_of[way[here]];
            here = way[here];
        }
    }
    let mut column_of = vec![0; rows];
    for j in (1..=columns).filter(|j| row_of[*j] > 0) {
        column_of[row_of[j] - 1] = j - 1;
    }
    column_of
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    #[test]
    fn the_greedy_choice_is_given_up_for_one_more_pair() {
        // Nearest first would pair report 0 with truth 0 (0.05 m) and leave report 1 alone.
        let reported = [[0.05, 0.0], [-0.25, 0.0]];
        let truth = [[0.0, 0.0], [0.3, 0.0]];
        assert_eq!(matching(&reported, &truth, 0.3), vec![(0, 1), (1, 0)]);
    }

    #[test]
    fn nothing_matches_beyond_the_distance_and_empty_lists_are_fine() {
        assert!(matching(&[[0.0, 0.0]], &[[0.31, 0.0]], 0.3).is_empty());
        assert!(matching(&[], &[[0.0, 0.0]], 0.3).is_empty());
        assert!(matching(&[[0.0, 0.0]], &[], 0.3).is_empty());
    }

    /// The plain version: every choice is tried.
    fn best(reported: &[[f64; 2]], truth: &[[f64; 2]], used: &mut Vec<bool>, row: usize) -> (usize, f64) {
        if row == reported.len() {
            return (0, 0.0);
        }
        let mut top = best(reported, truth, used, row + 1);
        for t in 0..truth.len() {
            let d = (reported[row][0] - truth[t][0]).hypot(reported[row][1] - truth[t][1]);
            if !used[t] && d <= 0.3 {
                used[t] = true;
                let (count, sum) = best(reported, truth, used, row + 1);
                used[t] = false;
                if count + 1 > top.0 || (count + 1 == top.0 && sum + d < top.1) {
                    top = (count + 1, sum + d);
                }
            }
        }
        top
    }

    #[test]
    fn it_equals_trying_everything() {
        let (mut rng, mut cases) = (Rng::new(8), 0);
        for _ in 0..300 {
            let mut places = |n: u32| -> Vec<[f64; 2]> { (0..n).map(|_| [rng.unit(), rng.unit() * 0.3]).collect() };
            let (reported, truth) = (places(5), places(6));
            let pairs = matching(&reported, &truth, 0.3);
            let sum: f64 =
                pairs.iter().map(|(r, t)| (reported[*r][0] - truth[*t][0]).hypot(reported[*r][1] - truth[*t][1])).sum();
            let (count, least) = best(&reported, &truth, &mut vec![false; 6], 0);
            assert_eq!(pairs.len(), count);
            assert!((sum - least).abs() < 1e-9, "{sum} {least}");
            cases += pairs.len();
        }
        assert!(cases > 600, "only {cases} pairs");
    }
}
