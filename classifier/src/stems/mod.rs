//! The default tree detector: stems fitted to beams of finite width, proven by the beams that pass.
//!
//! In: the view, the returns behind it, the ground. Out: a [`Detection`] per tree, and a [`Rejected`] per other candidate.
//! Steps: candidates from returns in several slices above ground; for each the beams towards it; one fit of centre line,
//! lean, radius and taper to where beams end and where they pass; what the beams say of that stem; overlapping stems
//! give way to the better one. Source: docs/equations.md, "Stems".

mod background;
mod candidates;
pub(crate) mod config;
mod disc;
mod fit;
mod flank;
mod memory;
mod model;
mod normal;
mod points;
mod proof;
mod sight;
mod sights;
mod start;
#[cfg(test)]
mod tests;

pub use config::StemsConfig;
pub use memory::Memory;
pub use points::point_stems;

use crate::columns::View;
use crate::ground::Ground;
use crate::returns::{ReturnColumns, Returns};
use crate::trunk::{BREAST_HEIGHT_M, Reason, Rejected, Trunks};
use disc::{Disc, best_of_overlapping};
use fit::Fit;
use flank::{Front, is_flat};
use memory::{Entry, Turn, WorldCell};
use model::Stem;
use proof::Account;
use sight::{Place, Sight};
use sights::Wanted;
use start::start;
use tsense_contract::{Class, Detection};
use tsense_geometry::Raster;

/// What the detector works on.
pub struct StemScene<'a> {
    /// The voxels, for heights of trees.
    pub view: &'a View,
    /// The store of beams, settled.
    pub returns: &'a Returns,
    /// Its returns by column.
    pub columns: &'a ReturnColumns,
    /// The ground.
    pub ground: &'a Ground,
    /// When something was last met in each column, nanoseconds.
    pub met_ns: &'a Raster<i64>,
}

/// How far beside a candidate's place beams count for the start, metres.
const START_ASIDE_M: f64 = 0.6;
/// How far beside a stem beams count for its fit, metres.
const BESIDE_M: f64 = 0.45;
/// How far beside a stem's column what is met is news of it, columns.
const MET_CELLS: usize = 2;
/// Spacing of beams above one another, metres.
const START_SPACING_M: f64 = 0.1;
const FIT_SPACING_M: f64 = 0.03;
/// Beams that the start looks at.
const START_BEAMS: usize = 250;

/// Least one sigma of a diameter fitted to all echoes, metres; and what the fit's own is multiplied by where a beam ended at
/// the stem: it counts beams above one another as one, but stems lean and taper, so that n of them tell as n do. From 1,866
/// trees of plots with truth.
const SHARP_DBH_STD_MIN_M: f64 = 0.0028;
const SHARP_DBH_STD_SCALE: f64 = 13.7;
/// Share of what is not known of the beam's width at one station that is left: it differs from station to station.
const SHARP_WIDTH_SHARE: f64 = 0.5;
/// Candidates through which a larger share of beams passes are not fitted more sharply: that is no stem by far.
const SHARPENED_PASSED_MAX: f64 = 0.45;
/// What the sharper fit must show besides: a stem is found to centimetres, metres, and stands out.
const SHARP_POSITION_STD_MAX_M: f64 = 0.036;
const SHARP_CONTRAST_MIN: f64 = 0.35;
/// One sigma of what the model lacks: bark, bends, butts. Metres.
const POSITION_STD_MIN_M: f64 = 0.003;
const DBH_STD_MIN_M: f64 = 0.009;
/// What the fit's own deviations are multiplied by, so that 68 % of errors lie within them: from plots with truth.
const POSITION_STD_SCALE: f64 = 0.65;
const DBH_STD_SCALE: f64 = 0.95;

/// A stem that passed all tests.
#[derive(Clone)]
pub struct Proven {
    place: Place,
    fit: Fit,
    /// Fitted to beams with all of their echoes.
    is_sharp: bool,
    account: Account,
    height_m: f64,
    /// When something was last met around it, before it was fitted.
    stamp_ns: i64,
}

type Verdict<T> = Result<T, (Reason, f64)>;

/// Finds the stems. Of candidates that `memory` knows, those are judged again of which something new was seen.
pub fn stems(scene: &StemScene, memory: &mut Memory, config: &StemsConfig) -> Trunks {
    let mut rejected = Vec::new();
    let mut sure: Vec<Proven> = Vec::new();
    let places = candidates::candidates(scene.columns, scene.ground, config);
    let turns = memory.turns(scene, &places);
    for (at_m, (key, turn)) in places.into_iter().zip(turns) {
        if turn == Turn::Now {
            if let Some(stem) = sure.iter().find(|stem| stem.surely_holds(at_m)) {
                let value = stem.weight();
                rejected.push(Rejected { at_m: scene.utm_m(at_m), reason: Reason::Double, value });
                continue;
            }
            let stem = judged(scene, memory, (key, at_m), &sure, config);
            sure.extend(stem.filter(Proven::is_sure));
        }
    }
    let mut found = Vec::new();
    for entry in memory.entries() {
        match &entry.verdict {
            Ok(stem) => found.push(stem.clone()),
            Err((reason, value)) => {
                rejected.push(Rejected { at_m: scene.utm_m(entry.at_m), reason: *reason, value: *value });
            }
        }
    }
    let kept = best_of_overlapping(found, Proven::disc, Proven::weight, scene, &mut rejected);
    let mut mask = Raster::filled(scene.view.shape, false);
    kept.iter().flat_map(|stem| stem.disc().cells(scene.view)).for_each(|cell| mask[cell] = true);
    Trunks { trees: kept.iter().map(|stem| stem.detection(scene)).collect(), mask, rejected }
}

/// Judges a candidate, from the stem that stood there before where that is beyond doubt, and remembers the verdict.
fn judged(
    scene: &StemScene,
    memory: &mut Memory,
    (key, at_m): (WorldCell, [f64; 2]),
    sure: &[Proven],
    config: &StemsConfig,
) -> Option<Proven> {
    let known = memory.entry(key).and_then(Entry::known);
    let again = known.and_then(|known| refined(scene, known, config).ok());
    let (verdict, from_start) = match again {
        Some(stem) => (Ok(stem), false),
        None => (proven(scene, at_m, sure, config), true),
    };
    let stem = verdict.as_ref().ok().cloned();
    memory.remember(key, at_m, verdict, from_start, scene);
    stem
}

impl StemScene<'_> {
    fn corner_m(&self) -> [f64; 3] {
        let shape = self.view.shape;
        let [x, y] = shape.first_cell.map(|first| f64::from(first) * shape.cell_m);
        [x, y, self.view.base_m()]
    }

    /// The column of the world that holds a place.
    fn cell_of(&self, at_m: [f64; 2]) -> WorldCell {
        let shape = self.view.shape;
        [0, 1].map(|axis| shape.first_cell[axis] + (at_m[axis] / shape.cell_m).floor() as i32)
    }

    /// When something was last met around a place: what waited for its turn since then was not looked at again.
    fn met_ns(&self, at_m: [f64; 2]) -> i64 {
        let [easting, northing] = self.utm_m(at_m);
        let shape = self.met_ns.shape();
        let around = shape.cell_at(easting, northing).into_iter().flat_map(|cell| shape.around(cell, MET_CELLS));
        around.map(|cell| self.met_ns[cell]).max().unwrap_or(0)
    }

    fn utm_m(&self, at_m: [f64; 2]) -> [f64; 2] {
        let [x, y, _] = self.corner_m();
        [x + at_m[0], y + at_m[1]]
    }

    fn place(&self, at_m: [f64; 2]) -> Verdict<Place> {
        let [easting, northing] = self.utm_m(at_m);
        let ground_m = self.ground.height_m.at(easting, northing).copied().map_or(f64::NAN, f64::from);
        if !ground_m.is_finite() {
            return Err((Reason::Hidden, 0.0));
        }
        let ground_std_m = self.ground.std_m.at(easting, northing).copied().map_or(0.0, f64::from);
        Ok(Place { at_m, ground_m, ground_std_m, breast_m: ground_m + BREAST_HEIGHT_M })
    }
}

/// Fits a stem at a candidate's place and tests it, unless its start is one of the stems that are `sure`.
fn proven(scene: &StemScene, at_m: [f64; 2], sure: &[Proven], config: &StemsConfig) -> Verdict<Proven> {
    let place = scene.place(at_m)?;
    let (returns, corner_m) = (scene.returns, scene.corner_m());
    let near = Wanted { returns, corner_m, aside_m: START_ASIDE_M, spacing_m: START_SPACING_M, config };
    let first = near.sights(&place);
    let start = start(&fit::every(&first, START_BEAMS), config).ok_or((Reason::Empty, 0.0))?;
    at_least(Reason::RaysPass, start.evidence, 0.0)?;
    let start = start.stem;
    // Again around the start, so that the window of beams is the stem's own.
    let disc = Disc { at_m: [at_m[0] + start.east_m, at_m[1] + start.north_m], radius_m: start.radius_m };
    if let Some(stem) = sure.iter().find(|stem| stem.disc().agrees(&disc)) {
        return Err((Reason::Double, stem.weight()));
    }
    let place = scene.place(disc.at_m)?;
    let all = Wanted { aside_m: start.radius_m + BESIDE_M, spacing_m: FIT_SPACING_M, ..near }.sights(&place);
    let start = Stem { east_m: 0.0, north_m: 0.0, ..start };
    let coarse = fit::coarse(start, &all, config).ok_or((Reason::NoFit, 0.0))?;
    at_least(Reason::TooThin, coarse.radius_m, config.radius_min_m)?;
    finished(scene, place, coarse, &all, config)
}

/// Fits a stem that was found before to what is seen of it now, and tests it.
fn refined(scene: &StemScene, known: &Proven, config: &StemsConfig) -> Verdict<Proven> {
    let place = scene.place(known.axis_m())?;
    let start = Stem { east_m: 0.0, north_m: 0.0, ..known.fit.stem };
    let (returns, corner_m) = (scene.returns, scene.corner_m());
    let wanted = Wanted { returns, corner_m, aside_m: start.radius_m + BESIDE_M, spacing_m: FIT_SPACING_M, config };
    finished(scene, place, start, &wanted.sights(&place), config)
}

/// The last pass of a fit, and all tests.
fn finished(scene: &StemScene, place: Place, coarse: Stem, all: &[Sight], config: &StemsConfig) -> Verdict<Proven> {
    let some = fit::telling(&coarse, &fit::every(all, config.beams_max));
    let fit = fit::fine(coarse, &some, config).ok_or((Reason::NoFit, 0.0))?;
    let account = |fit: &Fit| Account::of(&fit.stem, all, config.fit_m[0] - BREAST_HEIGHT_M, config);
    // Where beams are told with all of their echoes, the later ones stand behind a stem like a wall.
    let one_echo = !scene.returns.stations().any(|station| scene.returns.has_all_echoes(station));
    let soft = Proven { place, height_m: 0.0, is_sharp: false, account: account(&fit), fit, stamp_ns: 0 };
    let may_be = !one_echo && soft.account.passed_share() < SHARPENED_PASSED_MAX;
    let sharp = may_be.then(|| fit::sharpened(&soft.fit, &some, config)).flatten();
    let stem = match sharp {
        Some(fit) => Proven { is_sharp: true, account: account(&fit), fit, ..soft },
        None => soft,
    };
    let height_m = stem.tests(config).and_then(|()| stem.tall_enough(scene.view, one_echo, config))?;
    match stem.front(all) {
        Some(front) if one_echo && is_flat(scene.columns, front) => Err((Reason::Flat, 2.0 * stem.fit.stem.radius_m)),
        _ => Ok(Proven { height_m, stamp_ns: scene.met_ns(stem.axis_m()), ..stem }),
    }
}

/// One sigma of a diameter fitted to all echoes of `hits` beams that ended at the stem.
fn sharp_dbh_std_m(fitted_m: f64, hits: usize, half_std_m: f64) -> f64 {
    let by_hits = SHARP_DBH_STD_SCALE / (hits.max(1) as f64).sqrt();
    root_of_squares([SHARP_DBH_STD_MIN_M, by_hits * fitted_m, 2.0 * SHARP_WIDTH_SHARE * half_std_m])
}

fn root_of_squares(parts: [f64; 3]) -> f64 {
    parts.iter().map(|part| part * part).sum::<f64>().sqrt()
}

fn at_most(reason: Reason, value: f64, limit: f64) -> Verdict<()> {
    if value <= limit { Ok(()) } else { Err((reason, value)) }
}

fn at_least(reason: Reason, value: f64, limit: f64) -> Verdict<()> {
    if value >= limit { Ok(()) } else { Err((reason, value)) }
}

impl Proven {
    fn tests(&self, config: &StemsConfig) -> Verdict<()> {
        let [solid, open] = self.account.slices();
        let lean = self.fit.stem.lean[0].hypot(self.fit.stem.lean[1]).atan();
        at_least(Reason::Empty, self.account.hits as f64, config.hits_min as f64)?;
        at_least(Reason::TooThin, self.fit.stem.radius_m, config.radius_min_m)?;
        at_most(Reason::TooWide, self.fit.stem.radius_m, 0.98 * config.radius_max_m)?;
        at_most(Reason::RaysPass, self.account.passed_share(), config.passed_share_max)?;
        at_least(Reason::NotVertical, solid as f64, config.solid_slices_min as f64)?;
        at_least(Reason::NotVertical, solid as f64, 2.0 * open as f64)?;
        at_least(Reason::Scattered, self.account.solid_share(), config.solid_share_min)?;
        at_most(Reason::Rough, self.account.roughness_m(), config.roughness_max_m)?;
        at_most(Reason::Leaning, lean, config.lean_max_rad)?;
        if self.is_sharp {
            at_most(Reason::NoFit, self.position_std_m(), SHARP_POSITION_STD_MAX_M)?;
            at_least(Reason::Surrounded, self.account.contrast(), SHARP_CONTRAST_MIN)?;
        }
        at_least(Reason::Surrounded, self.account.contrast(), config.contrast_min)
    }

    fn tall_enough(&self, view: &View, one_echo: bool, config: &StemsConfig) -> Verdict<f64> {
        let occupied_m = crate::trunk::height_above_m(view, &self.disc().cells(view), self.place.ground_m);
        let (slices, is_passed_above) = self.account.top();
        // Beams beside a thin stem clear its voxels.
        let height_m = occupied_m.max(config.fit_m[0] + slices as f64 * config.slice_m);
        // Near a vehicle the nod ends below two metres: where beams end with a stem, its height says nothing.
        let least_m = if one_echo && !is_passed_above { 0.0 } else { config.height_min_m };
        at_least(Reason::TooLow, height_m, least_m).map(|()| height_m)
    }

    /// Where the middle one of the beams towards it meets it.
    fn front(&self, sights: &[Sight]) -> Option<Front> {
        let (axis_m, radius_m) = (self.axis_m(), self.fit.stem.radius_m);
        let along = sights.get(sights.len() / 2)?.along;
        let at_m = [0, 1].map(|axis| axis_m[axis] - radius_m * along[axis]);
        Some(Front { at_m, ground_m: self.place.ground_m, diameter_m: 2.0 * radius_m })
    }

    /// The axis at breast height, east and north of the view's corner.
    fn axis_m(&self) -> [f64; 2] {
        self.disc().at_m
    }

    fn disc(&self) -> Disc {
        let Stem { east_m, north_m, radius_m, .. } = self.fit.stem;
        Disc { at_m: [self.place.at_m[0] + east_m, self.place.at_m[1] + north_m], radius_m }
    }

    /// Whether a place lies on this stem, and this stem is beyond doubt.
    fn surely_holds(&self, at_m: [f64; 2]) -> bool {
        // Nearness first: it is asked of many places, and costs little.
        self.disc().holds(at_m) && self.is_sure()
    }

    /// Whether this stem is beyond doubt.
    fn is_sure(&self) -> bool {
        let [solid, open] = self.account.slices();
        solid >= 3 * open.max(3) && self.account.contrast() > 0.6
    }

    /// Of two stems in one place, the one with more of this stays.
    fn weight(&self) -> f64 {
        self.account.contrast() * self.account.solid_share() * (self.account.hits as f64).sqrt()
    }

    /// One sigma of the position on an axis: the fit's, and what a wrong breast height makes of a lean.
    fn position_std_m(&self) -> f64 {
        let (stem, covariance) = (&self.fit.stem, &self.fit.covariance);
        let lean = stem.lean[0].hypot(stem.lean[1]);
        let fitted = (covariance[(0, 0)] + covariance[(1, 1)]) / 2.0;
        (POSITION_STD_MIN_M.powi(2)
            + POSITION_STD_SCALE.powi(2) * fitted
            + (lean * self.place.ground_std_m).powi(2) / 2.0)
            .sqrt()
    }

    /// One sigma of the diameter: the model's, the fit's, and what a wrong half width adds on both sides.
    fn dbh_std_m(&self) -> f64 {
        let (fitted_m, half_std_m) = (2.0 * self.fit.covariance[(2, 2)].sqrt(), self.account.half_std_m);
        match self.is_sharp {
            true => sharp_dbh_std_m(fitted_m, self.account.hits, half_std_m),
            false => root_of_squares([DBH_STD_MIN_M, DBH_STD_SCALE * fitted_m, 2.0 * half_std_m]),
        }
    }

    fn detection(&self, scene: &StemScene) -> Detection {
        let [easting_m, northing_m] = scene.utm_m(self.axis_m());
        let stem = &self.fit.stem;
        let confidence = self.account.contrast() * (self.account.hits as f64 / 30.0).min(1.0);
        Detection {
            stamp_ns: self.stamp_ns,
            easting_m,
            northing_m,
            ground_m: scene.ground.base_m + self.place.ground_m,
            position_std_m: self.position_std_m() as f32,
            dbh_m: 2.0 * stem.radius_m as f32,
            dbh_std_m: self.dbh_std_m() as f32,
            height_m: self.height_m as f32,
            confidence: confidence.clamp(0.0, 1.0) as f32,
            arc_coverage: self.account.arc_share() as f32,
            lean_rad: stem.lean.map(|lean| lean.atan() as f32),
            class: Class::Tree.to_wire(),
            reserved: [0; 7],
        }
    }
}
