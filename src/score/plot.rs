//! The score of a survey of a plot with truth. Definitions as in score.py; those marked are beyond it.

use super::found::{Found, FoundTree};
use super::statistics::{mean, quantile, rms, share};
use super::truth::{BRUSH_CELL_M, GROUND_CELL_M, TrueTree, Truth};
use serde::Serialize;
use tsense_simulator::{MATCH_M, matching};

/// Returns that a cell needs to be brush for sure.
const BRUSH_RETURNS: u32 = 3;
/// Brush is higher than this, metres.
const BRUSH_ABOVE_M: f64 = 0.2;
/// Trees within this distance of a stop are near, metres.
pub const NEAR_M: f64 = 8.0;

/// Figures of one survey. Lengths in metres, shares from 0 to 1; null where nothing could be compared.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PlotScore {
    /// True trees.
    pub trees: usize,
    /// Reported trees inside the plot.
    pub detected: usize,
    /// Pairs within 0.3 m.
    pub matched: usize,
    /// Share of the reports that match.
    pub precision: f64,
    /// Share of the true trees that were matched.
    pub recall: f64,
    /// Harmonic mean of the two.
    pub f1: f64,
    /// Of the matches.
    pub position_rmse_m: Option<f64>,
    /// Of the diameters of the matches.
    pub dbh_rmse_m: Option<f64>,
    /// Mean error of the diameters.
    pub dbh_bias_m: Option<f64>,
    /// Of trees within 8 m of a stop (not in score.py).
    pub near_dbh_rmse_m: Option<f64>,
    /// Position of those (not in score.py).
    pub near_position_rmse_m: Option<f64>,
    /// Share of diameters within one reported sigma of the truth.
    pub dbh_within_1_sigma: Option<f64>,
    /// Of the heights of the matches.
    pub height_rmse_m: Option<f64>,
    /// Over all cells whose height is known.
    pub ground_rmse_m: Option<f64>,
    /// Mean error.
    pub ground_bias_m: Option<f64>,
    /// 95 of 100 errors are smaller.
    pub ground_p95_m: Option<f64>,
    /// Share of the cells without a height.
    pub ground_unknown: f64,
    /// Over cells that a beam met.
    pub ground_rmse_seen_m: Option<f64>,
    /// Share of heights within one reported sigma of the truth (not in score.py).
    pub ground_within_1_sigma: Option<f64>,
    /// Where both see brush.
    pub brush_height_rmse_m: Option<f64>,
    /// Share of the reported brush cells that are.
    pub brush_precision: Option<f64>,
    /// Share of the brush cells that were reported.
    pub brush_recall: Option<f64>,
    /// Harmonic mean of the two (not in score.py); null where the plot has no brush.
    pub brush_f1: Option<f64>,
}

/// Scores a survey.
pub fn score(truth: &Truth, found: &Found) -> PlotScore {
    let mut score = PlotScore::default();
    score_trees(&mut score, truth, found);
    score_ground(&mut score, truth, found);
    score_brush(&mut score, truth, found);
    score
}

fn score_trees(score: &mut PlotScore, truth: &Truth, found: &Found) {
    let inside = |tree: &&FoundTree| {
        (0..2).all(|axis| {
            let along_m = tree.at_m[axis] - truth.corner_m[axis];
            (-MATCH_M..=truth.size_m + MATCH_M).contains(&along_m)
        })
    };
    let detected: Vec<FoundTree> = found.trees.iter().filter(inside).copied().collect();
    let places = |trees: &[FoundTree]| trees.iter().map(|tree| tree.at_m).collect::<Vec<_>>();
    let true_places: Vec<[f64; 2]> = truth.trees.iter().map(|tree| tree.at_m).collect();
    let pairs: Vec<(FoundTree, TrueTree)> = matching(&places(&detected), &true_places, MATCH_M)
        .into_iter()
        .map(|(report, tree)| (detected[report], truth.trees[tree]))
        .collect();
    (score.trees, score.detected, score.matched) = (truth.trees.len(), detected.len(), pairs.len());
    score.precision = pairs.len() as f64 / detected.len().max(1) as f64;
    score.recall = pairs.len() as f64 / truth.trees.len().max(1) as f64;
    score.f1 = f1(score.precision, score.recall);
    let off_m = |(report, tree): &(FoundTree, TrueTree)| distance_m(report.at_m, tree.at_m);
    let dbh_m = |(report, tree): &(FoundTree, TrueTree)| report.dbh_m - tree.dbh_m;
    score.position_rmse_m = rms(pairs.iter().map(off_m));
    score.dbh_rmse_m = rms(pairs.iter().map(dbh_m));
    score.dbh_bias_m = mean(pairs.iter().map(dbh_m));
    score.height_rmse_m = rms(pairs.iter().map(|(report, tree)| report.height_m - tree.height_m));
    let near: Vec<_> = pairs.iter().filter(|pair| to_stop_m(truth, pair.1.at_m) <= NEAR_M).collect();
    score.near_dbh_rmse_m = rms(near.iter().map(|pair| dbh_m(pair)));
    score.near_position_rmse_m = rms(near.iter().map(|pair| off_m(pair)));
    if pairs.iter().any(|(report, _)| report.dbh_std_m.is_finite()) {
        score.dbh_within_1_sigma = share(pairs.iter().map(|pair| dbh_m(pair).abs() <= pair.0.dbh_std_m));
    }
}

fn f1(precision: f64, recall: f64) -> f64 {
    2.0 * precision * recall / (precision + recall).max(1e-9)
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn to_stop_m(truth: &Truth, at_m: [f64; 2]) -> f64 {
    truth.stops_m.iter().map(|stop| distance_m(*stop, at_m)).fold(f64::INFINITY, f64::min)
}

fn score_ground(score: &mut PlotScore, truth: &Truth, found: &Found) {
    let center = |i: usize| [i % truth.ground_width, i / truth.ground_width].map(|c| 0.075 + GROUND_CELL_M * c as f64);
    let place = |i: usize| [0, 1].map(|axis| truth.corner_m[axis] + center(i)[axis]);
    let cells = 0..truth.ground_m.len();
    let errors: Vec<f64> =
        cells.clone().map(|i| (place(i), truth.ground_m[i])).map(|([e, n], z)| found.ground.at(e, n) - z).collect();
    score.ground_rmse_m = rms(errors.iter().copied());
    score.ground_bias_m = mean(errors.iter().copied());
    score.ground_p95_m = quantile(errors.iter().map(|e| e.abs()), 0.95);
    score.ground_unknown = share(errors.iter().map(|e| e.is_nan())).unwrap_or(1.0);
    score.ground_rmse_seen_m = rms(cells.clone().filter(|i| truth.ground_hits[*i] > 0.0).map(|i| errors[i]));
    if let Some(std) = &found.ground_std {
        let known = cells.filter(|i| !errors[*i].is_nan());
        score.ground_within_1_sigma =
            share(known.map(|i| (place(i), errors[i])).map(|([e, n], error)| error.abs() <= std.at(e, n)));
    }
}

fn score_brush(score: &mut PlotScore, truth: &Truth, found: &Found) {
    let Some(brush) = &found.brush else { return };
    // The highest of the four cells of the survey's raster in each cell of brush.
    let reported_m = |i: usize| {
        let [e, n] = [0, 1].map(|axis| {
            truth.corner_m[axis] + BRUSH_CELL_M * [i % truth.brush_width, i / truth.brush_width][axis] as f64
        });
        let quarters = [[0.075, 0.075], [0.075, 0.225], [0.225, 0.075], [0.225, 0.225]];
        quarters.into_iter().map(|[x, y]| brush.at(e + x, n + y)).filter(|h| h.is_finite()).fold(0.0, f64::max)
    };
    let (mut errors, mut sure_both, mut sure_says, mut is_count) = (Vec::new(), 0, 0, 0);
    for (i, cell) in truth.brush.iter().enumerate() {
        let reported_m = reported_m(i);
        let is = cell.height_m > BRUSH_ABOVE_M && cell.returns >= BRUSH_RETURNS;
        let says = reported_m > BRUSH_ABOVE_M;
        let is_sure = cell.returns >= BRUSH_RETURNS || cell.returns == 0;
        is_count += usize::from(is);
        sure_says += usize::from(says && is_sure);
        if is && says {
            errors.push(reported_m - cell.height_m);
            sure_both += usize::from(is_sure);
        }
    }
    let (precision, recall) =
        (sure_both as f64 / sure_says.max(1) as f64, errors.len() as f64 / is_count.max(1) as f64);
    score.brush_height_rmse_m = rms(errors);
    (score.brush_precision, score.brush_recall) = (Some(precision), Some(recall));
    score.brush_f1 = (is_count > 0).then(|| f1(precision, recall));
}
