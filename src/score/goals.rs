//! What must be reached on the plots, and what peers reached there.
//!
//! Goals by plot, lengths in metres. A plot is known by the first letter of its folder's name, A to E; any other has the
//! goals of B. Peers' figures were measured on the plots' own seeds (101 to 505) with the programs named; they are
//! facts about those runs and are not measured anew.

use super::plot::PlotScore;
use serde::Serialize;

/// Goals of one plot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Goals {
    /// Least F1 of trees.
    pub f1: f64,
    /// Most position error, rms.
    pub position_m: f64,
    /// Most ground error, rms over all cells.
    pub ground_m: f64,
}

/// Least precision of trees.
pub const PRECISION: f64 = 0.97;
/// Most DBH error, rms: all trees, and those within 8 m of a stop.
pub const DBH_M: [f64; 2] = [0.05, 0.035];
/// Most mean error of DBH and of ground.
pub const BIAS_M: [f64; 2] = [0.01, 0.02];
/// Shares within one sigma.
pub const SIGMA: [f64; 2] = [0.60, 0.76];
/// Most error of brush heights, rms, and least F1 of brush.
pub const BRUSH: (f64, f64) = (0.15, 0.9);
/// Most time for 100,000 rays on one core, seconds.
pub const SECONDS: f64 = 0.25;

impl Goals {
    /// The goals of a plot.
    pub fn of(plot: &str) -> Self {
        let (f1, position_m, ground_m) = match plot.chars().next() {
            Some('A') => (0.99, 0.03, 0.04),
            Some('C') => (0.93, 0.04, 0.04),
            Some('D') => (0.95, 0.04, 0.07),
            Some('E') => (0.94, 0.04, 0.10),
            _ => (0.96, 0.04, 0.06),
        };
        Self { f1, position_m, ground_m }
    }

    /// Every goal against a score; `seconds` for 100,000 rays where they were measured.
    pub fn checks(&self, score: &PlotScore, seconds: Option<f64>) -> Vec<Check> {
        let most = |what, value: Option<f64>, most: f64| Check::new(what, value, [f64::NEG_INFINITY, most]);
        let least = |what, value: Option<f64>, least: f64| Check::new(what, value, [least, f64::INFINITY]);
        let within = |what, value: Option<f64>, most: f64| Check::new(what, value, [-most, most]);
        let mut checks = vec![
            least("tree F1", Some(score.f1), self.f1),
            least("tree precision", Some(score.precision), PRECISION),
            most("position rms, m", score.position_rmse_m, self.position_m),
            most("DBH rms, m", score.dbh_rmse_m, DBH_M[0]),
            most("DBH rms within 8 m, m", score.near_dbh_rmse_m, DBH_M[1]),
            within("DBH bias, m", score.dbh_bias_m, BIAS_M[0]),
            Check::new("DBH within 1 sigma", score.dbh_within_1_sigma, SIGMA),
            most("ground rms, m", score.ground_rmse_m, self.ground_m),
            within("ground bias, m", score.ground_bias_m, BIAS_M[1]),
            most("ground unknown", Some(score.ground_unknown), 0.0),
            Check::new("ground within 1 sigma", score.ground_within_1_sigma, SIGMA),
        ];
        if score.brush_f1.is_some() {
            checks.push(most("brush height rms, m", score.brush_height_rmse_m, BRUSH.0));
            checks.push(least("brush F1", score.brush_f1, BRUSH.1));
        }
        if seconds.is_some() {
            checks.push(most("seconds per 100,000 rays", seconds, SECONDS));
        }
        checks
    }
}

/// One goal and what was reached.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// What, with its unit.
    pub what: &'static str,
    /// What was reached; null where it could not be measured.
    pub value: Option<f64>,
    /// Least and most; null for no bound.
    pub range: [Option<f64>; 2],
    /// Whether it was reached.
    pub is_met: bool,
}

impl Check {
    fn new(what: &'static str, value: Option<f64>, [least, most]: [f64; 2]) -> Self {
        // A figure that could not be measured has not reached its goal.
        let is_met = value.is_some_and(|value| (least..=most).contains(&value));
        Self { what, value, range: [least, most].map(|bound| bound.is_finite().then_some(bound)), is_met }
    }
}

/// A peer on a plot: precision, recall, position and DBH error (rms, metres).
pub type Peer = (&'static str, [f64; 4]);

/// What peers reached on a plot.
pub fn peers(plot: &str) -> [Peer; 4] {
    let figures = match plot.chars().next() {
        Some('A') => [
            [1.0, 0.97, 0.087, 0.171],
            [1.0, 0.97, 0.028, 0.052],
            [0.97, 0.97, 0.072, 0.109],
            [1.0, 0.22, 0.040, 0.012],
        ],
        Some('C') => [
            [0.99, 0.74, 0.072, 0.132],
            [0.90, 0.89, 0.056, 0.064],
            [0.85, 0.71, 0.056, 0.130],
            [1.0, 0.12, 0.027, 0.023],
        ],
        Some('D') => [
            [1.0, 0.68, 0.100, 0.161],
            [0.66, 0.93, 0.083, 0.071],
            [0.97, 0.88, 0.074, 0.125],
            [1.0, 0.12, 0.089, 0.048],
        ],
        Some('E') => [
            [0.93, 0.81, 0.106, 0.088],
            [0.28, 1.0, 0.147, 0.066],
            [0.85, 0.69, 0.025, 0.026],
            [1.0, 0.38, 0.146, 0.015],
        ],
        _ => [
            [1.0, 0.83, 0.080, 0.102],
            [0.58, 0.96, 0.057, 0.071],
            [0.98, 0.81, 0.051, 0.093],
            [1.0, 0.07, 0.068, 0.013],
        ],
    };
    let names = ["rayextract trunks", "rayextract trees", "sylva (tuned)", "3DFin (tuned)"];
    std::array::from_fn(|i| (names[i], figures[i]))
}

/// Ground error (rms over all cells, metres) of rayextract, of sylva's CSF, and of a triangulation of the true ground
/// returns.
pub fn peers_ground_m(plot: &str) -> [f64; 3] {
    match plot.chars().next() {
        Some('A') => [0.047, 0.038, 0.032],
        Some('C') => [0.062, 0.041, 0.021],
        Some('D') => [0.185, 4.15, 0.041],
        Some('E') => [0.556, 4.63, 0.055],
        _ => [0.187, 0.72, 0.033],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_measured_has_not_reached_its_goal() {
        let score = PlotScore { f1: 0.97, precision: 0.98, position_rmse_m: Some(0.02), ..PlotScore::default() };
        let checks = Goals::of("B_slope").checks(&score, Some(0.3));
        let met = |what: &str| checks.iter().find(|check| check.what == what).unwrap().is_met;
        assert!(met("tree F1") && met("tree precision") && met("position rms, m") && met("ground unknown"));
        assert!(!met("DBH rms, m") && !met("seconds per 100,000 rays"));
        assert!(!Goals::of("A_open").checks(&score, None)[0].is_met);
    }
}
