//! Where to start a fit: the best of a few hundred upright stems behind the returns of a candidate.
//!
//! In: some of the sights of a candidate's place. Out: the start and what beams say of it, as a sum of logarithms of how
//! much likelier a stem makes what each beam did than brush does. Metres. It decides cheaply; the fit decides well.

use super::config::StemsConfig;
use super::model::{Stem, TAPER};
use super::sights::Sight;
use crate::trunk::BREAST_HEIGHT_M;

/// Radii that are tried, metres.
const RADII_M: [f64; 7] = [0.03, 0.06, 0.10, 0.15, 0.22, 0.32, 0.45];
/// Returns that are tried as the nearest point of a stem.
const FRONTS: usize = 32;
/// How far from the candidate's place a stem's front may lie, metres.
const REACH_M: f64 = 0.3;
/// Tolerance of a hit, metres.
const TOLERANCE_M: f64 = 0.08;
/// How far beside a stem beams count for it, metres.
const BESIDE_M: f64 = 0.15;
/// How far an upright stem may be off at each metre above or below breast height, because true ones lean: metres.
const LEAN_SLACK: f64 = 0.03;
/// Height of a slice, metres.
const SLICE_M: f64 = 0.3;
/// Slices; what is higher counts to the last.
const SLICES: usize = 16;
/// Least and most that one slice says.
const SLICE_LOSS_MAX: f64 = 2.0;
const SLICE_GAIN_MAX: f64 = 8.0;
/// Logarithms of likelihood ratios, stem against brush. Brush ends three beams in ten at the distance in question, a
/// stem nine in ten inside its silhouette and one in ten beside it.
const HIT: f64 = 1.1;
const PASSED: f64 = -1.95;
const ENDED_BESIDE: f64 = -1.1;
const PASSED_BESIDE: f64 = 0.25;

/// A start and the evidence for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// The stem.
    pub stem: Stem,
    /// Sum of the logarithms of the likelihood ratios.
    pub evidence: f64,
}

/// The upright stem with the most evidence, or nothing where nothing was hit.
pub fn start(sights: &[Sight], config: &StemsConfig) -> Option<Start> {
    let fronts: Vec<(&Sight, [f64; 2])> = sights.iter().filter_map(|sight| Some((sight, front(sight)?))).collect();
    let (mut best, mut most) = (None, f64::NEG_INFINITY);
    for (sight, at_m) in fronts.iter().step_by(fronts.len().div_ceil(FRONTS).max(1)) {
        for radius_m in RADII_M.into_iter().filter(|&radius_m| radius_m <= config.radius_max_m) {
            let [east_m, north_m] = [0, 1].map(|axis| at_m[axis] + radius_m * sight.along[axis]);
            let slices = evidence([east_m, north_m], radius_m, sights);
            let sum: f64 = slices.iter().sum();
            if sum > most {
                most = sum;
                let stem = Stem { east_m, north_m, radius_m, lean: [0.0; 2], taper: TAPER[0] };
                best = Some(Start { stem, evidence: clipped(&slices) });
            }
        }
    }
    best
}

/// An echo near the place, east and north of it.
fn front(sight: &Sight) -> Option<[f64; 2]> {
    let echo_m = sight.echoes_m.into_iter().find(|echo_m| (echo_m - sight.ahead_m).abs() < REACH_M)?;
    let ([x, y], on_m) = (sight.along, echo_m - sight.ahead_m);
    // The place lies `left_m` to the left of the beam, so the beam passes that far to the right of the place.
    (sight.left_m.abs() < REACH_M).then_some([x * on_m + y * sight.left_m, y * on_m - x * sight.left_m])
}

/// Sum over slices of which none says too much: brush around the foot of a stem does not outweigh what stands out of it.
fn clipped(slices: &[f64; SLICES]) -> f64 {
    slices.iter().map(|sum| f64::clamp(*sum, -SLICE_LOSS_MAX, SLICE_GAIN_MAX)).sum()
}

/// What beams say of an upright stem, slice by slice.
fn evidence([east_m, north_m]: [f64; 2], radius_m: f64, sights: &[Sight]) -> [f64; SLICES] {
    let mut slices = [0.0; SLICES];
    for sight in sights {
        let [x, y] = sight.along;
        let aside_m = (sight.left_m + x * north_m - y * east_m).abs();
        let inside_m = radius_m + sight.half_m - aside_m;
        let slack_m = LEAN_SLACK * sight.up_m.abs();
        if inside_m > -BESIDE_M - slack_m {
            let ahead_m = sight.ahead_m + x * east_m + y * north_m;
            slices[slice(sight)] += match inside_m {
                inside_m if inside_m > slack_m => inside(sight, ahead_m, aside_m, radius_m, slack_m),
                inside_m if inside_m < -slack_m => beside(sight, ahead_m, radius_m),
                _ => 0.0,
            };
        }
    }
    slices
}

fn slice(sight: &Sight) -> usize {
    (((sight.up_m + BREAST_HEIGHT_M) / SLICE_M) as usize).min(SLICES - 1)
}

fn inside(sight: &Sight, ahead_m: f64, aside_m: f64, radius_m: f64, slack_m: f64) -> f64 {
    let front_m = ahead_m - (radius_m * radius_m - aside_m * aside_m).max(0.0).sqrt();
    let near = |echo_m: &f64| (echo_m - front_m).abs() < TOLERANCE_M + slack_m;
    match sight.echoes_m.iter().any(near) {
        true => HIT,
        false if sight.echoes_m[0] > ahead_m + radius_m + slack_m => PASSED,
        false => 0.0,
    }
}

fn beside(sight: &Sight, ahead_m: f64, radius_m: f64) -> f64 {
    let near = |echo_m: &f64| (echo_m - ahead_m).abs() < radius_m + BESIDE_M;
    match sight.echoes_m.iter().any(near) {
        true => ENDED_BESIDE,
        false if sight.echoes_m[0] > ahead_m => PASSED_BESIDE,
        false => 0.0,
    }
}
