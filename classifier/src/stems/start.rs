//! Where to start a fit: the best of a few hundred upright stems behind the returns of a candidate.
//!
//! In: some of the sights of a candidate's place. Out: the start and what beams say of it, as a sum of logarithms of how
//! much likelier a stem makes what each beam did than brush does. Metres. It decides cheaply; the fit decides well.

use super::config::StemsConfig;
use super::model::{Stem, TAPER};
use super::sight::Sight;
use crate::trunk::BREAST_HEIGHT_M;

/// Radii that are tried, metres.
const RADII_M: [f64; 7] = [0.03, 0.06, 0.10, 0.15, 0.22, 0.32, 0.45];
/// Returns that are tried as the nearest point of a stem.
const FRONTS: usize = 32;
/// How far from the candidate's place a stem's front may lie, metres.
const REACH_M: f64 = 0.3;
/// Tolerance of a hit, metres.
const TOLERANCE_M: f32 = 0.08;
/// How far beside a stem beams count for it, metres.
const BESIDE_M: f32 = 0.15;
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
const HIT: f32 = 1.1;
const PASSED: f32 = -1.95;
const ENDED_BESIDE: f32 = -1.1;
const PASSED_BESIDE: f32 = 0.25;

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
    let lanes: Vec<Lanes> = sights.chunks(LANES).map(Lanes::of).collect();
    let (mut best, mut most) = (None, f32::NEG_INFINITY);
    for (sight, at_m) in fronts.iter().step_by(fronts.len().div_ceil(FRONTS).max(1)) {
        for radius_m in RADII_M.into_iter().filter(|&radius_m| radius_m <= config.radius_max_m) {
            let [east_m, north_m] = [0, 1].map(|axis| at_m[axis] + radius_m * sight.along[axis]);
            let stem = Stem { east_m, north_m, radius_m, lean: [0.0; 2], taper: TAPER[0] };
            let sum = sum_of(&lanes, &Disc::of(&stem));
            if sum > most {
                (best, most) = (Some(stem), sum);
            }
        }
    }
    best.map(|stem| Start { stem, evidence: clipped(&lanes, sights, &Disc::of(&stem)) })
}

/// An echo near the place, east and north of it.
fn front(sight: &Sight) -> Option<[f64; 2]> {
    let echo_m = sight.echoes_m.into_iter().find(|echo_m| (echo_m - sight.ahead_m).abs() < REACH_M)?;
    let ([x, y], on_m) = (sight.along, echo_m - sight.ahead_m);
    // The place lies `left_m` to the left of the beam, so the beam passes that far to the right of the place.
    (sight.left_m.abs() < REACH_M).then_some([x * on_m + y * sight.left_m, y * on_m - x * sight.left_m])
}

/// Sum over slices of which none says too much: brush around the foot of a stem does not outweigh what stands out of it.
fn clipped(lanes: &[Lanes], sights: &[Sight], disc: &Disc) -> f64 {
    let mut slices = [0.0; SLICES];
    for (lanes, sights) in lanes.iter().zip(sights.chunks(LANES)) {
        let evidence = lanes.evidence(disc);
        sights.iter().zip(evidence).for_each(|(sight, evidence)| slices[slice(sight)] += f64::from(evidence));
    }
    slices.iter().map(|sum| f64::clamp(*sum, -SLICE_LOSS_MAX, SLICE_GAIN_MAX)).sum()
}

fn slice(sight: &Sight) -> usize {
    (((sight.up_m + BREAST_HEIGHT_M) / SLICE_M) as usize).min(SLICES - 1)
}

/// Sights that are looked at side by side.
const LANES: usize = 8;

/// Eight sights, field by field, so that one instruction does the same for several of them.
struct Lanes {
    east: [f32; LANES],
    north: [f32; LANES],
    left_m: [f32; LANES],
    ahead_m: [f32; LANES],
    half_m: [f32; LANES],
    slack_m: [f32; LANES],
    echoes_m: [[f32; LANES]; 2],
}

/// An upright stem.
struct Disc {
    east_m: f32,
    north_m: f32,
    radius_m: f32,
}

impl Disc {
    fn of(stem: &Stem) -> Self {
        Self { east_m: stem.east_m as f32, north_m: stem.north_m as f32, radius_m: stem.radius_m as f32 }
    }
}

fn sum_of(lanes: &[Lanes], disc: &Disc) -> f32 {
    let mut sums = [0.0; LANES];
    for lanes in lanes {
        sums.iter_mut().zip(lanes.evidence(disc)).for_each(|(sum, evidence)| *sum += evidence);
    }
    sums.iter().sum()
}

impl Lanes {
    /// Up to eight sights; what is missing passes far beside.
    fn of(sights: &[Sight]) -> Self {
        let field = |of: &dyn Fn(&Sight) -> f64, missing: f32| {
            std::array::from_fn(|i| sights.get(i).map_or(missing, |sight| of(sight) as f32))
        };
        Self {
            east: field(&|sight| sight.along[0], 0.0),
            north: field(&|sight| sight.along[1], 0.0),
            left_m: field(&|sight| sight.left_m, 1e9),
            ahead_m: field(&|sight| sight.ahead_m, 0.0),
            half_m: field(&|sight| sight.half_m, 0.0),
            slack_m: field(&|sight| LEAN_SLACK * sight.up_m.abs(), 0.0),
            echoes_m: [0, 1].map(|echo| field(&|sight| sight.echoes_m[echo], f32::INFINITY)),
        }
    }

    /// What each beam says of an upright stem. Both sides of each choice are worked out, so that no lane waits.
    #[inline]
    fn evidence(&self, disc: &Disc) -> [f32; LANES] {
        let mut evidence = [0.0; LANES];
        for (i, evidence) in evidence.iter_mut().enumerate() {
            let (x, y, slack_m) = (self.east[i], self.north[i], self.slack_m[i]);
            let aside_m = (self.left_m[i] + x * disc.north_m - y * disc.east_m).abs();
            let inside_m = disc.radius_m + self.half_m[i] - aside_m;
            let ahead_m = self.ahead_m[i] + x * disc.east_m + y * disc.north_m;
            let front_m = ahead_m - (disc.radius_m * disc.radius_m - aside_m * aside_m).max(0.0).sqrt();
            let [first_m, second_m] = [self.echoes_m[0][i], self.echoes_m[1][i]];
            let off_m = (first_m - front_m).abs().min((second_m - front_m).abs());
            let far_m = (first_m - ahead_m).abs().min((second_m - ahead_m).abs());
            let passed = if first_m > ahead_m + disc.radius_m + slack_m { PASSED } else { 0.0 };
            let inside = if off_m < TOLERANCE_M + slack_m { HIT } else { passed };
            let passed = if first_m > ahead_m { PASSED_BESIDE } else { 0.0 };
            let beside = if far_m < disc.radius_m + BESIDE_M { ENDED_BESIDE } else { passed };
            let beside = if inside_m < -slack_m && inside_m > -BESIDE_M - slack_m { beside } else { 0.0 };
            *evidence = if inside_m > slack_m { inside } else { beside };
        }
        evidence
    }
}
