//! Scores: what the system reports against what is there. Plain values in, plain values out.
//!
//! Trees: optimal one-to-one matching within 0.3 m of the axis at 1.3 m above ground. A true tree counts when the
//! sensor could see it ([`Sight`] states the rule); a report that matches a tree which does not count is neither
//! right nor wrong for recall, and right for precision: the tree is there. Ground: cells on rocks, walls and
//! outside of the scene do not count. Brush: heights where both see some, below 3 m.

use crate::matching::matching;
use crate::scene::{Scene, TrueTree};
use crate::vehicle::{Rig, Vehicle};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use tsense_geometry::{Global, PanTiltAngles, Transform, Vehicle as VehicleFrame, vehicle_from_ladar};

/// Farthest a report may lie from the axis at 1.3 m, metres.
pub const MATCH_M: f64 = 0.3;
/// Vegetation higher than this is not brush, metres.
pub const BRUSH_MAX_M: f64 = 3.0;
/// Brush lower than this is not told from rough ground, metres.
pub const BRUSH_MIN_M: f64 = 0.2;

/// When a true tree counts: from some place of the way, at most `reach_m` away and within the sensor's field, at least
/// `heights_min` of six heights of the trunk (0.4 to 2.4 m) are in view. A height is in view when the sensor's
/// nodding fan sweeps it and at least `transmission_min` of the light passes what stands between.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sight {
    /// Farthest horizontal distance, metres.
    pub reach_m: f64,
    /// Lowest tilt of the nod, degrees.
    pub tilt_low_deg: f64,
    /// Highest tilt of the nod, degrees.
    pub tilt_high_deg: f64,
    /// Widest angle from straight ahead, degrees; the scanner itself reaches 135.
    pub azimuth_max_deg: f64,
    /// Share of the light that must pass, 0 to 1.
    pub transmission_min: f64,
    /// Heights that must be in view, of six.
    pub heights_min: usize,
    /// Distance between the places that are tried, metres.
    pub place_step_m: f64,
}

impl Default for Sight {
    fn default() -> Self {
        Self {
            reach_m: 12.0,
            tilt_low_deg: -30.0,
            tilt_high_deg: 15.0,
            azimuth_max_deg: 75.0,
            transmission_min: 0.5,
            heights_min: 4,
            place_step_m: 1.0,
        }
    }
}

/// Heights of a trunk that are looked for, metres above ground.
const HEIGHTS_M: [f64; 6] = [0.4, 0.8, 1.2, 1.6, 2.0, 2.4];

impl Sight {
    /// For every true tree whether it counts, for a vehicle that moved from one instant to another (world seconds).
    pub fn counted(&self, vehicle: &Vehicle, rig: &Rig, from_s: f64, to_s: f64) -> Vec<bool> {
        let scene = vehicle.scene();
        let poses = self.poses(vehicle, from_s, to_s);
        let seen = |tree: usize| poses.iter().any(|pose| self.sees(scene, rig, pose, tree));
        (0..scene.trees.len()).map(seen).collect()
    }

    /// Poses along the way, one every `place_step_m`.
    fn poses(&self, vehicle: &Vehicle, from_s: f64, to_s: f64) -> Vec<Transform<Global, VehicleFrame>> {
        let mut poses = vec![vehicle.pose(from_s)];
        let (mut last_m, step_s) = (vehicle.driven_m(from_s), 0.1);
        let steps = ((to_s - from_s).max(0.0) / step_s) as usize;
        for k in 1..=steps {
            let at_s = from_s + k as f64 * step_s;
            if vehicle.driven_m(at_s) - last_m >= self.place_step_m {
                last_m = vehicle.driven_m(at_s);
                poses.push(vehicle.pose(at_s));
            }
        }
        poses
    }

    fn sees(&self, scene: &Scene, rig: &Rig, pose: &Transform<Global, VehicleFrame>, tree: usize) -> bool {
        let level = vehicle_from_ladar(
            rig.vehicle_from_base.transform(),
            PanTiltAngles::default(),
            rig.tilt_from_ladar.transform(),
        );
        let global_from_ladar = *pose * level;
        let eye = scene.to_local(global_from_ladar.origin());
        let trunk = &scene.trees[tree];
        if (trunk.breast_m[0] - eye.x).hypot(trunk.breast_m[1] - eye.y) > self.reach_m {
            return false;
        }
        let ladar_from_global = global_from_ladar.inverse();
        let in_view = |height_m: f64| {
            let aim = trunk.axis_at(height_m);
            let seen_from = ladar_from_global * scene.to_global(aim);
            self.in_field(seen_from.xyz.coords)
                && self.lights(scene, eye, aim, trunk.radius_at_m(height_m), tree) >= self.transmission_min
        };
        HEIGHTS_M.into_iter().filter(|h| in_view(*h)).count() >= self.heights_min
    }

    /// The scan plane turned by tilt t about the sensor's right axis holds directions with elevation
    /// `atan(tan t * cos azimuth)`: to the side the nod hardly moves it.
    fn in_field(&self, d: Vector3<f64>) -> bool {
        let azimuth = d.y.atan2(d.x);
        let elevation = (-d.z).atan2(d.x.hypot(d.y));
        let reached = |tilt_deg: f64| (tilt_deg.to_radians().tan() * azimuth.cos()).atan();
        let (a, b) = (reached(self.tilt_low_deg), reached(self.tilt_high_deg));
        azimuth.abs() <= self.azimuth_max_deg.to_radians() && elevation >= a.min(b) && elevation <= a.max(b)
    }

    /// Mean share of the light that reaches the trunk left of, on and right of its axis.
    fn lights(&self, scene: &Scene, eye: Vector3<f64>, aim: Vector3<f64>, radius_m: f64, tree: usize) -> f64 {
        let side = (aim - eye).cross(&Vector3::z()).normalize() * (0.6 * radius_m);
        [-1.0, 0.0, 1.0].into_iter().map(|k| scene.transmission(eye, aim + side * k, tree)).sum::<f64>() / 3.0
    }
}

/// A tree as the system reports it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReportedTree {
    /// UTM easting of the axis at 1.3 m above ground, metres.
    pub easting_m: f64,
    /// UTM northing, metres.
    pub northing_m: f64,
    /// Diameter at 1.3 m, metres; NaN where not reported.
    pub dbh_m: f64,
}

/// How well trees were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TreeScore {
    /// True trees that count.
    #[serde(rename = "true")]
    pub truth: usize,
    /// Reported trees.
    pub reported: usize,
    /// Counted trees that were matched.
    pub matched: usize,
    /// Reports that match a tree which does not count.
    pub matched_uncounted: usize,
    /// Share of the reports that match any tree; 1 without reports.
    pub precision: f64,
    /// Share of the counted trees that were matched; 1 where none counts.
    pub recall: f64,
    /// Root mean square distance of all matches, metres; nothing without a match.
    pub position_rmse_m: Option<f64>,
    /// Root mean square error of the diameters that were reported, metres.
    pub dbh_rmse_m: Option<f64>,
    /// Mean error of the diameters, metres; positive where too thick.
    pub dbh_bias_m: Option<f64>,
}

/// Scores reported trees against true ones; `counted` goes with `truth`.
pub fn score_trees(truth: &[TrueTree], counted: &[bool], reported: &[ReportedTree]) -> TreeScore {
    let places: Vec<[f64; 2]> = truth.iter().map(|t| [t.easting_m, t.northing_m]).collect();
    let reports: Vec<[f64; 2]> = reported.iter().map(|r| [r.easting_m, r.northing_m]).collect();
    let pairs = matching(&reports, &places, MATCH_M);
    let counts = |t: usize| counted.get(t).copied().unwrap_or(false);
    let matched = pairs.iter().filter(|(_, t)| counts(*t)).count();
    let distances = pairs.iter().map(|(r, t)| (reports[*r][0] - places[*t][0]).hypot(reports[*r][1] - places[*t][1]));
    let dbh_errors: Vec<f64> =
        pairs.iter().map(|(r, t)| reported[*r].dbh_m - truth[*t].dbh_m).filter(|e| e.is_finite()).collect();
    let total = (0..truth.len()).filter(|t| counts(*t)).count();
    let share = |part: usize, whole: usize| if whole == 0 { 1.0 } else { part as f64 / whole as f64 };
    TreeScore {
        truth: total,
        reported: reported.len(),
        matched,
        matched_uncounted: pairs.len() - matched,
        precision: share(pairs.len(), reported.len()),
        recall: share(matched, total),
        position_rmse_m: rms(distances),
        dbh_rmse_m: rms(dbh_errors.iter().copied()),
        dbh_bias_m: mean(&dbh_errors),
    }
}

/// How well a height was found, over cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeightScore {
    /// Cells compared.
    pub cells: usize,
    /// Root mean square error, metres; nothing without a cell.
    pub rmse_m: Option<f64>,
    /// Mean error, metres; positive where too high.
    pub bias_m: Option<f64>,
}

fn heights(errors: &[f64]) -> HeightScore {
    HeightScore { cells: errors.len(), rmse_m: rms(errors.iter().copied()), bias_m: mean(errors) }
}

/// Scores ground heights: easting, northing, height above the ellipsoid of cell centres; NaN heights do not count.
pub fn score_ground(scene: &Scene, cells: impl IntoIterator<Item = [f64; 3]>) -> HeightScore {
    let error = |[e, n, z]: [f64; 3]| {
        let truth = scene.ground_at_m(e, n)?;
        (z.is_finite() && !scene.is_covered(e, n)).then_some(z - truth)
    };
    heights(&cells.into_iter().filter_map(error).collect::<Vec<f64>>())
}

/// How well brush was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BrushScore {
    /// Heights where truth and report both see brush.
    pub height: HeightScore,
    /// Share of the cells reported as brush that are.
    pub precision: f64,
    /// Share of the brush cells given that were reported.
    pub recall: f64,
}

/// Scores brush heights: easting, northing, height above ground of cell centres, 0 where none, NaN where unknown.
/// Cells under crowns, on rocks and on walls may hold vegetation that is not brush: above 3 m nothing is compared.
pub fn score_brush(scene: &Scene, cells: impl IntoIterator<Item = [f64; 3]>) -> BrushScore {
    let (mut errors, mut reported, mut truth) = (Vec::new(), 0, 0);
    for [e, n, height_m] in cells {
        let true_m = scene.brush_at_m(e, n);
        if !height_m.is_finite() || height_m > BRUSH_MAX_M || true_m > BRUSH_MAX_M || scene.is_covered(e, n) {
            continue;
        }
        let (says, is) = (height_m > BRUSH_MIN_M, true_m > BRUSH_MIN_M);
        reported += usize::from(says);
        truth += usize::from(is);
        if says && is {
            errors.push(height_m - true_m);
        }
    }
    let share = |whole: usize| if whole == 0 { 1.0 } else { errors.len() as f64 / whole as f64 };
    BrushScore { height: heights(&errors), precision: share(reported), recall: share(truth) }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(s, c), v| (s + v * v, c + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{ORIGIN_M, SceneName};
    use crate::vehicle::{Motion, VehicleOptions};
    use std::sync::Arc;

    fn tree(e: f64, n: f64, dbh_m: f64) -> TrueTree {
        TrueTree { easting_m: e, northing_m: n, ground_m: 0.0, dbh_m, height_m: 10.0, lean_rad: [0.0; 2] }
    }

    fn report(e: f64, n: f64, dbh_m: f64) -> ReportedTree {
        ReportedTree { easting_m: e, northing_m: n, dbh_m }
    }

    #[test]
    fn two_of_three_trees_and_one_false_one_score_two_thirds() {
        let truth = [tree(0.0, 0.0, 0.3), tree(5.0, 0.0, 0.2), tree(9.0, 0.0, 0.4), tree(20.0, 0.0, 0.3)];
        let counted = [true, true, true, false];
        let reported =
            [report(0.1, 0.0, 0.34), report(5.0, 0.2, f64::NAN), report(7.0, 0.0, 0.2), report(20.0, 0.1, 0.27)];
        let score = score_trees(&truth, &counted, &reported);
        assert_eq!((score.truth, score.reported, score.matched, score.matched_uncounted), (3, 4, 2, 1));
        assert!((score.precision - 0.75).abs() < 1e-12 && (score.recall - 2.0 / 3.0).abs() < 1e-12);
        assert!((score.position_rmse_m.unwrap() - (0.06f64 / 3.0).sqrt()).abs() < 1e-9);
        assert!((score.dbh_rmse_m.unwrap() - (0.0025f64 / 2.0).sqrt()).abs() < 1e-9);
        assert!((score.dbh_bias_m.unwrap() - 0.005).abs() < 1e-9);
        assert_eq!(score_trees(&[], &[], &[]).position_rmse_m, None);
    }

    #[test]
    fn ground_five_centimetres_too_high_has_that_error_and_that_bias() {
        let scene = Scene::new(SceneName::Forest, 1);
        let cells = (0..200).map(|i| {
            let (e, n) = (ORIGIN_M[0] - 8.0 + 0.08 * f64::from(i), ORIGIN_M[1] + 0.3);
            [e, n, if i % 10 == 0 { f64::NAN } else { scene.ground_at_m(e, n).unwrap() + 0.05 }]
        });
        let score = score_ground(&scene, cells);
        assert!(score.cells > 150);
        assert!((score.rmse_m.unwrap() - 0.05).abs() < 1e-9 && (score.bias_m.unwrap() - 0.05).abs() < 1e-9);
    }

    #[test]
    fn brush_reported_where_there_is_none_costs_precision() {
        let scene = Scene::new(SceneName::Flat, 1);
        let cells = [[ORIGIN_M[0], ORIGIN_M[1], 0.5], [ORIGIN_M[0] + 1.0, ORIGIN_M[1], 0.0]];
        let score = score_brush(&scene, cells);
        assert_eq!((score.precision, score.recall, score.height.cells), (0.0, 1.0, 0));
    }

    #[test]
    fn standing_sees_fewer_trees_than_driving_round_and_never_one_behind_the_wall_of_distance() {
        let scene = Arc::new(Scene::new(SceneName::Forest, 7));
        let rig = Rig::default();
        let count = |motion| {
            let options = VehicleOptions { motion, ..VehicleOptions::default() };
            let vehicle = Vehicle::new(scene.clone(), options, &rig);
            let counted = Sight::default().counted(&vehicle, &rig, 0.0, 85.0);
            assert_eq!(counted.len(), scene.true_trees().len());
            counted.into_iter().filter(|c| *c).count()
        };
        let (standing, driving) = (count(Motion::Stand), count(Motion::Drive));
        assert!((2..=20).contains(&standing), "{standing}");
        assert!((20..=45).contains(&driving), "{driving}");
    }

    #[test]
    fn the_field_is_narrow_to_the_side() {
        let sight = Sight { azimuth_max_deg: 135.0, ..Sight::default() };
        // 20 degrees down: in view ahead, not at the side, for z points down.
        let down = |azimuth_deg: f64| {
            let a = azimuth_deg.to_radians();
            sight.in_field(Vector3::new(a.cos(), a.sin(), 20f64.to_radians().tan()))
        };
        assert!(down(0.0) && down(40.0) && !down(80.0) && !down(140.0));
    }
}
