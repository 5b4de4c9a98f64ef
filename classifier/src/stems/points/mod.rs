//! The tree detector for clouds that do not say where their beams came from: stems fitted to points alone.
//!
//! In: the view, the points behind it, the ground. Out: a [`Detection`] per tree, a [`Rejected`] per other candidate.
//! Without beams nothing is known to be free: what speaks for a stem is a ring of points in several bands of heights,
//! next to nothing inside of it, less around it, on one axis. Steps: candidates as for beams; in each of several bands the
//! ring that stands out most; from the best one a leaning, tapering cylinder grown up and down along its axis; what its
//! slices hold; overlapping stems give way to the better one. Source: docs/equations.md, "Stems from points".

mod fit;
mod proof;
mod ring;
#[cfg(test)]
mod tests;

use super::candidates::candidates;
use super::config::StemsConfig;
use super::disc::{Disc, best_of_overlapping};
use super::model::{Stem, TAPER};
use super::sight::Place;
use super::{StemScene, Verdict, at_least, at_most};
use crate::trunk::{BREAST_HEIGHT_M, Reason, Rejected, Trunks};
use fit::PointFit;
use proof::Account;
use ring::Ring;
use tsense_contract::{Class, Detection};
use tsense_geometry::Raster;

/// A point around a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// East and north of the place, metres.
    pub at_m: [f64; 2],
    /// Above breast height, metres.
    pub up_m: f64,
}

/// How far around a place points are taken, beyond the largest diameter, metres.
const AROUND_M: f64 = 0.35;
/// Height of the bands in which rings are looked for, and from one band to the next, metres.
const BAND_M: f64 = 0.8;
const BAND_STEP_M: f64 = 0.6;
/// Fewest points of a band near the place.
const BAND_MIN: usize = 6;
/// Least evidence of a ring that a stem is grown from.
const EVIDENCE_MIN: f64 = 20.0;
/// How far outside of the ring points are taken for the fit and for what stands beside it, metres.
const BESIDE_M: f64 = 0.45;
/// Fewest points on a stem.
const ON_MIN: usize = 15;
/// Least share of the circumference that shows points.
const ARC_MIN: f64 = 0.25;
/// Least share of the points up to the surface that lie on it.
const SOLID_SHARE_MIN: f64 = 0.88;
/// Least contrast to what is beside it.
const CONTRAST_MIN: f64 = 0.62;
/// Fewest slices on end in which it stands out, where its surface is smooth; and where it is as thick as a moving scanner
/// leaves it, when leaves have rings of that kind over short heights.
const RUN_MIN: usize = 5;
const RUN_ROUGH_MIN: usize = 8;
/// Largest noise of a smooth surface and of any, metres.
const SMOOTH_M: f64 = 0.03;
const NOISE_MAX_M: f64 = 0.037;
/// One sigma of what the model lacks, metres.
const POSITION_STD_MIN_M: f64 = 0.01;
const DBH_STD_MIN_M: f64 = 0.015;

/// A stem that passed all tests.
struct Grown {
    place: Place,
    fit: PointFit,
    account: Account,
    height_m: f64,
}

/// Finds the stems of a cloud without beams.
pub fn point_stems(scene: &StemScene, config: &StemsConfig) -> Trunks {
    let mut rejected = Vec::new();
    let mut found: Vec<Grown> = Vec::new();
    for at_m in candidates(scene.columns, scene.ground, config) {
        let verdict = match found.iter().find(|stem| stem.disc().holds(at_m)) {
            Some(stem) => Err((Reason::Double, stem.weight())),
            None => grown(scene, at_m, config),
        };
        match verdict {
            Ok(stem) => found.push(stem),
            Err((reason, value)) => rejected.push(Rejected { at_m: scene.utm_m(at_m), reason, value }),
        }
    }
    let kept = best_of_overlapping(found, Grown::disc, Grown::weight, scene, &mut rejected);
    let mut mask = Raster::filled(scene.view.shape, false);
    kept.iter().flat_map(|stem| stem.disc().cells(scene.view)).for_each(|cell| mask[cell] = true);
    Trunks { trees: kept.iter().map(|stem| stem.detection(scene)).collect(), mask, rejected }
}

/// Grows a stem at a candidate's place and tests it.
fn grown(scene: &StemScene, at_m: [f64; 2], config: &StemsConfig) -> Verdict<Grown> {
    let place = scene.place(at_m)?;
    let spots = spots(scene, &place, 2.0 * config.radius_max_m + AROUND_M, config);
    let (ring, up_m) = best_band(&spots, config).ok_or((Reason::Empty, 0.0))?;
    at_least(Reason::NoFit, ring.evidence, EVIDENCE_MIN)?;
    // Again around the ring, so that the points are the stem's own.
    let place = scene.place([at_m[0] + ring.at_m[0], at_m[1] + ring.at_m[1]])?;
    let spots = self::spots(scene, &place, ring.radius_m + BESIDE_M, config);
    let radius_m = ring.radius_m - TAPER[0] * up_m;
    let start = Stem { east_m: 0.0, north_m: 0.0, radius_m, lean: [0.0; 2], taper: TAPER[0] };
    let fit = fit::fit(start, up_m, &spots, config.radius_max_m).ok_or((Reason::NoFit, 0.0))?;
    let [bottom_m, top_m] = config.fit_m.map(|height_m| height_m - BREAST_HEIGHT_M);
    let account = Account::of(&fit.fit.stem, &spots, fit.noise_m, [bottom_m, top_m, config.slice_m]);
    let stem = Grown { place, fit, account, height_m: 0.0 };
    let height_m = stem.tests(config).and_then(|()| stem.tall_enough(scene, config))?;
    Ok(Grown { height_m, ..stem })
}

/// The points around a place, over the heights that stems are fitted from.
fn spots(scene: &StemScene, place: &Place, within_m: f64, config: &StemsConfig) -> Vec<Spot> {
    let heights = config.fit_m[0]..config.fit_m[1];
    let of = |at_m: [f32; 3]| {
        let [x, y, z] = at_m.map(f64::from);
        Spot { at_m: [x - place.at_m[0], y - place.at_m[1]], up_m: z - place.breast_m }
    };
    let around = scene.columns.around(place.at_m, within_m).map(|item| of(item.at_m));
    around.filter(|spot| heights.contains(&(spot.up_m + BREAST_HEIGHT_M))).collect()
}

/// The ring with the most evidence of all bands, and the middle height of its band above breast height.
fn best_band(spots: &[Spot], config: &StemsConfig) -> Option<(Ring, f64)> {
    let bands = ((config.fit_m[1] - config.fit_m[0] - BAND_M) / BAND_STEP_M).max(0.0) as usize + 1;
    let middles = (0..bands).map(|i| config.fit_m[0] + BAND_M / 2.0 + i as f64 * BAND_STEP_M - BREAST_HEIGHT_M);
    let rings = middles.filter_map(|middle_m| {
        let band: Vec<Spot> =
            spots.iter().filter(|spot| (spot.up_m - middle_m).abs() < BAND_M / 2.0).copied().collect();
        let radius_m = [config.radius_min_m, config.radius_max_m];
        (band.len() >= BAND_MIN).then(|| ring::best_ring(&band, radius_m)).flatten().map(|ring| (ring, middle_m))
    });
    rings.max_by(|a, b| a.0.evidence.total_cmp(&b.0.evidence))
}

impl Grown {
    fn tests(&self, config: &StemsConfig) -> Verdict<()> {
        let stem = &self.fit.fit.stem;
        let run_min = if self.fit.noise_m < SMOOTH_M { RUN_MIN } else { RUN_ROUGH_MIN };
        at_least(Reason::Empty, self.account.on as f64, ON_MIN as f64)?;
        at_least(Reason::TooThin, stem.radius_m, config.radius_min_m)?;
        at_most(Reason::TooWide, stem.radius_m, 0.98 * config.radius_max_m)?;
        at_most(Reason::Rough, self.fit.noise_m, NOISE_MAX_M)?;
        at_least(Reason::NotVertical, self.account.run() as f64, run_min as f64)?;
        at_least(Reason::Scattered, self.account.solid_share(), SOLID_SHARE_MIN)?;
        at_most(Reason::Leaning, stem.lean[0].hypot(stem.lean[1]).atan(), config.lean_max_rad)?;
        at_least(Reason::Surrounded, self.account.contrast(), CONTRAST_MIN)?;
        at_least(Reason::Hidden, self.account.arc_share(), ARC_MIN)
    }

    fn tall_enough(&self, scene: &StemScene, config: &StemsConfig) -> Verdict<f64> {
        let height_m = crate::trunk::height_above_m(scene.view, &self.disc().cells(scene.view), self.place.ground_m);
        at_least(Reason::TooLow, height_m, config.height_min_m).map(|()| height_m)
    }

    fn disc(&self) -> Disc {
        let Stem { east_m, north_m, radius_m, .. } = self.fit.fit.stem;
        Disc { at_m: [self.place.at_m[0] + east_m, self.place.at_m[1] + north_m], radius_m }
    }

    /// Of two stems in one place, the one with more of this stays.
    fn weight(&self) -> f64 {
        let [solid, _] = self.account.slices();
        self.account.contrast() * self.account.solid_share() * solid as f64
    }

    fn detection(&self, scene: &StemScene) -> Detection {
        let [easting_m, northing_m] = scene.utm_m(self.disc().at_m);
        let PointFit { fit, noise_m } = &self.fit;
        let (stem, covariance) = (&fit.stem, &fit.covariance);
        let lean = stem.lean[0].hypot(stem.lean[1]);
        let fitted = (covariance[(0, 0)] + covariance[(1, 1)]) / 2.0;
        // Whether bark is in the middle of a thick surface or on its far side depends on beams that are not known: a sigma
        // of it on either side of the diameter, and once on the position, towards where it was seen from.
        let noise_m = *noise_m;
        let position = POSITION_STD_MIN_M.powi(2) + fitted + (lean * self.place.ground_std_m).powi(2) / 2.0;
        let position = position + noise_m.powi(2);
        let dbh = DBH_STD_MIN_M.powi(2) + 4.0 * (covariance[(2, 2)] + noise_m.powi(2));
        let [solid, open] = self.account.slices();
        let confidence = self.account.contrast() * solid as f64 / (solid + open) as f64;
        Detection {
            easting_m,
            northing_m,
            ground_m: scene.ground.base_m + self.place.ground_m,
            position_std_m: position.sqrt() as f32,
            dbh_m: 2.0 * stem.radius_m as f32,
            dbh_std_m: dbh.sqrt() as f32,
            height_m: self.height_m as f32,
            confidence: confidence.clamp(0.0, 1.0) as f32,
            arc_coverage: self.account.arc_share() as f32,
            lean_rad: stem.lean.map(|lean| lean.atan() as f32),
            class: Class::Tree.to_wire(),
            stamp_ns: 0,
            reserved: [0; 7],
        }
    }
}
