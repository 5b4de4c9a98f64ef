//! Whether a fitted stem is one: what beams say of it, slice by slice.
//!
//! In: a fit and its sights. Out: an [`Account`] of hits, passes, slices and arc; tests are the caller's. Shares, metres.

use super::config::StemsConfig;
use super::fit::Sharpness;
use super::model::{Outcome, Stem};
use super::sight::Sight;
use std::f64::consts::TAU;

/// Directions around a stem that are told apart.
const ARC_BINS: usize = 32;
/// How far beside a stem the contrast is taken, metres.
const BESIDE_M: f64 = 0.3;
/// Share of passes from which a slice is open.
const OPEN_SHARE: f64 = 0.34;
/// Slices over which a stem must stand out from what is beside it.
const CONTRAST_SLICES: usize = 4;
/// Fewest beams in it and beside it that say whether it does.
const CONTRAST_BEAMS: f64 = 4.0;
/// Slices below its top and above it that tell whether beams passed above it.
const TOP_SLICES: usize = 3;
/// Share of hits among what ends there from which a slice is solid.
const SOLID_SHARE: f64 = 0.25;

/// What beams did at a slice of a stem.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Slice {
    hits: usize,
    passes: usize,
    scattered: usize,
    /// Beams to the left of it and to the right, and how many of them end there.
    beside: [usize; 2],
    ended_beside: [usize; 2],
}

impl Slice {
    fn is_open(&self) -> bool {
        self.passes as f64 > OPEN_SHARE * (self.hits + self.passes) as f64
    }
    fn is_solid(&self) -> bool {
        self.hits > 0 && !self.is_open() && self.hits as f64 >= SOLID_SHARE * (self.hits + self.scattered) as f64
    }
}

/// Contrast of some slices, against the side where more beams end; -1 where too few beams say something.
fn contrast(slices: &[Slice]) -> f64 {
    let sum = |of: &dyn Fn(&Slice) -> usize| slices.iter().map(of).sum::<usize>() as f64;
    let (hits, passes) = (sum(&|slice| slice.hits), sum(&|slice| slice.passes));
    let sides = [0, 1].map(|side| (sum(&|slice| slice.ended_beside[side]), sum(&|slice| slice.beside[side])));
    let told = sides.into_iter().filter(|(_, beams)| *beams >= CONTRAST_BEAMS);
    match told.map(|(ended, beams)| ended / beams).reduce(f64::max) {
        Some(beside) if hits >= CONTRAST_BEAMS => hits / (hits + passes) - beside,
        _ => -1.0,
    }
}

/// What beams did at a stem.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Account {
    /// Beams that ended at it.
    pub hits: usize,
    /// Sum of how far their echoes lie off the surface, metres.
    off_m: f64,
    /// Beams that passed where it should stand.
    pub passes: usize,
    /// Beams that ended just before or in it, but not at its surface.
    pub scattered: usize,
    /// Slices, bottom up.
    slices: Vec<Slice>,
    /// Directions from which its surface was seen, a bit each.
    arc: u32,
    /// Least one sigma of the half width of a beam that ended at it, metres.
    pub half_std_m: f64,
}

impl Account {
    /// What `sights` say of `stem`. `bottom_m` is the height of the lowest slice above breast height.
    pub fn of(stem: &Stem, sights: &[Sight], bottom_m: f64, config: &StemsConfig) -> Self {
        let count = ((config.fit_m[1] - config.fit_m[0]) / config.slice_m).ceil() as usize;
        let mut account =
            Self { slices: vec![Slice::default(); count.max(1)], half_std_m: f64::INFINITY, ..Self::default() };
        let tolerance_m = Sharpness::last(config).tolerance_m;
        for sight in sights {
            let meeting = stem.meet(sight);
            let slice = (((sight.up_m - bottom_m) / config.slice_m).max(0.0) as usize).min(account.slices.len() - 1);
            let (outcome, _) = meeting.outcome(sight, tolerance_m);
            let core_m = meeting.radius_m + 0.4 * meeting.half_m;
            let edge_m = meeting.radius_m + meeting.half_m;
            match (meeting.left_m.abs(), outcome) {
                (aside, Outcome::Hit(behind_m)) if aside <= edge_m => {
                    account.off_m += behind_m.abs();
                    account.hit(slice, &meeting, sight);
                }
                (aside, Outcome::Blocked) if aside <= core_m && meeting.is_near(sight) => {
                    account.scattered += 1;
                    account.slices[slice].scattered += 1;
                }
                (aside, Outcome::Passed) if aside <= core_m => {
                    account.passes += 1;
                    account.slices[slice].passes += 1;
                }
                (aside, _) if aside > edge_m + 0.03 && aside < edge_m + 0.03 + BESIDE_M => {
                    account.beside(slice, &meeting, sight);
                }
                _ => {}
            }
        }
        account
    }

    fn hit(&mut self, slice: usize, meeting: &super::model::Meeting, sight: &Sight) {
        self.hits += 1;
        self.slices[slice].hits += 1;
        self.half_std_m = self.half_std_m.min(sight.half_std_m);
        // From the axis to where the beam meets the surface.
        let across = (-meeting.left_m / meeting.radius_m).clamp(-1.0, 1.0);
        let back = -(1.0 - across * across).sqrt();
        let [x, y] = sight.along;
        // `across` is measured to the right of the beam's way to the axis where positive: left is (-y, x).
        let (east, north) = (back * x - across * y, back * y + across * x);
        let bin = (north.atan2(east).rem_euclid(TAU) / TAU * ARC_BINS as f64) as u32;
        self.arc |= 1 << bin.min(ARC_BINS as u32 - 1);
    }

    fn beside(&mut self, slice: usize, meeting: &super::model::Meeting, sight: &Sight) {
        let near = |echo_m: &f64| (echo_m - meeting.ahead_m).abs() < meeting.radius_m + BESIDE_M;
        let blocked = sight.echoes_m[0] < meeting.ahead_m - meeting.radius_m - BESIDE_M;
        if !blocked {
            let side = usize::from(meeting.left_m > 0.0);
            self.slices[slice].beside[side] += 1;
            self.slices[slice].ended_beside[side] += usize::from(sight.echoes_m.iter().any(near));
        }
    }

    /// Mean distance of echoes from the surface, metres: those of leaves lie anywhere in the tolerance.
    pub fn roughness_m(&self) -> f64 {
        self.off_m / self.hits.max(1) as f64
    }

    /// Share of beams that passed where it should stand.
    pub fn passed_share(&self) -> f64 {
        self.passes as f64 / (self.hits + self.passes).max(1) as f64
    }

    /// Share of beams that ended in it, less that of beams that ended beside it, over the metre where it stands out most.
    pub fn contrast(&self) -> f64 {
        let windows = self.slices.windows(CONTRAST_SLICES.min(self.slices.len()));
        windows.map(contrast).fold(-1.0, f64::max)
    }

    /// Share of the beams that end near it that end at its surface.
    pub fn solid_share(&self) -> f64 {
        self.hits as f64 / (self.hits + self.scattered).max(1) as f64
    }

    /// Slices up to its highest solid one below which none is open, and whether beams passed above that: as they do above a
    /// post, but not where they end for want of a higher nod.
    pub fn top(&self) -> (usize, bool) {
        let open = self.slices.iter().position(Slice::is_open).unwrap_or(self.slices.len());
        let top = self.slices[..open].iter().rposition(Slice::is_solid).map_or(0, |highest| highest + 1);
        let (below, above) = self.slices.split_at(top);
        let hits: usize = below.iter().rev().take(TOP_SLICES).map(|slice| slice.hits).sum();
        let passes: usize = above.iter().take(TOP_SLICES).map(|slice| slice.passes).sum();
        (top, passes as f64 > OPEN_SHARE * hits as f64)
    }

    /// Slices in which it is solid, and slices in which beams pass.
    pub fn slices(&self) -> [usize; 2] {
        let count = |is: fn(&Slice) -> bool| self.slices.iter().filter(|slice| is(slice)).count();
        [count(Slice::is_solid), count(Slice::is_open)]
    }

    /// Share of the circumference that was seen.
    pub fn arc_share(&self) -> f64 {
        f64::from(self.arc.count_ones()) / ARC_BINS as f64
    }
}
