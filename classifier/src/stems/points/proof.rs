//! Whether a stem that was fitted to points is one: what its slices hold on its surface, inside of it and beside it.
//!
//! In: a stem and the points around it. Out: an [`Account`]; tests are the caller's. Shares, metres.

use super::super::model::Stem;
use super::Spot;
use super::fit::outside;
use std::f64::consts::{PI, TAU};

/// Directions around a stem that are told apart.
const ARC_BINS: usize = 32;
/// How far off the surface points are the stem's: sigmas, and bounds, metres.
const OFF_SIGMAS: f64 = 2.5;
const OFF_M: [f64; 2] = [0.025, 0.06];
/// How far beside it points count against it, metres.
const BESIDE_M: f64 = 0.25;
/// Fewest points of a slice that say something.
const SLICE_MIN: usize = 3;

#[derive(Clone, Copy, Debug, Default)]
struct Slice {
    on: usize,
    inside: usize,
    beside: usize,
    arc: u32,
}

/// What the points around a stem say.
#[derive(Clone, Debug)]
pub struct Account {
    slices: Vec<Slice>,
    /// Points on the surface, inside of it, beside it.
    pub on: usize,
    inside: usize,
    off_m: f64,
    radius_m: f64,
    arc: u32,
}

impl Account {
    /// Counts the points around a stem, in slices of `slice_m` from `bottom_m` above breast height.
    pub fn of(stem: &Stem, spots: &[Spot], noise_m: f64, [bottom_m, top_m, slice_m]: [f64; 3]) -> Self {
        let count = ((top_m - bottom_m) / slice_m).ceil().max(1.0) as usize;
        let off_m = (OFF_SIGMAS * noise_m).clamp(OFF_M[0], OFF_M[1]);
        let slices = vec![Slice::default(); count];
        let mut account = Self { slices, on: 0, inside: 0, off_m, radius_m: stem.radius_m, arc: 0 };
        for spot in spots {
            let at = (((spot.up_m - bottom_m) / slice_m).max(0.0) as usize).min(count - 1);
            let slice = &mut account.slices[at];
            let (out_m, [x, y]) = outside(stem, spot);
            if out_m.abs() <= off_m {
                let bin = (y.atan2(x).rem_euclid(TAU) / TAU * ARC_BINS as f64) as u32;
                slice.on += 1;
                slice.arc |= 1 << bin.min(ARC_BINS as u32 - 1);
            } else if out_m < 0.0 {
                slice.inside += 1;
            } else if out_m < off_m + BESIDE_M {
                slice.beside += 1;
            }
        }
        let solid: Vec<Slice> = account.slices.iter().filter(|slice| account.is_solid(slice)).copied().collect();
        account.arc = solid.iter().fold(0, |arc, slice| arc | slice.arc);
        account.on = account.slices.iter().map(|slice| slice.on).sum();
        account.inside = account.slices.iter().map(|slice| slice.inside).sum();
        account
    }

    /// Points a square metre on the surface, and beside it.
    fn densities(&self, on: usize, beside: usize) -> [f64; 2] {
        let disc = |r: f64| PI * r.max(0.0).powi(2);
        let (low, high) = (self.radius_m - self.off_m, self.radius_m + self.off_m);
        [on as f64 / (disc(high) - disc(low)), beside as f64 / (disc(high + BESIDE_M) - disc(high))]
    }

    fn is_solid(&self, slice: &Slice) -> bool {
        let [on, beside] = self.densities(slice.on, slice.beside);
        slice.on >= SLICE_MIN && slice.on >= 2 * slice.inside && on > 2.0 * beside
    }

    fn is_open(&self, slice: &Slice) -> bool {
        slice.inside + slice.beside >= SLICE_MIN && !self.is_solid(slice)
    }

    /// Slices in which it stands out, and slices in which other things stand there.
    pub fn slices(&self) -> [usize; 2] {
        let open = self.slices.iter().filter(|slice| self.is_open(slice)).count();
        [self.slices.iter().filter(|slice| self.is_solid(slice)).count(), open]
    }

    /// Most slices on end in which it stands out.
    pub fn run(&self) -> usize {
        let runs = self.slices.iter().scan(0, |run, slice| {
            *run = if self.is_solid(slice) { *run + 1 } else { 0 };
            Some(*run)
        });
        runs.max().unwrap_or(0)
    }

    /// Share of the points up to its surface that lie on it: leaves lie inside, too.
    pub fn solid_share(&self) -> f64 {
        self.on as f64 / (self.on + self.inside).max(1) as f64
    }

    /// How much denser points lie on it than beside it, over the slices in which it stands out: 1 where none lie beside.
    pub fn contrast(&self) -> f64 {
        let solid = self.slices.iter().filter(|slice| self.is_solid(slice));
        let (on, beside) = solid.fold((0, 0), |(on, beside), slice| (on + slice.on, beside + slice.beside));
        let [on, beside] = self.densities(on, beside);
        if on > 0.0 { (on - beside) / (on + beside) } else { -1.0 }
    }

    /// Share of the circumference on which points lie, solid slices together.
    pub fn arc_share(&self) -> f64 {
        f64::from(self.arc.count_ones()) / ARC_BINS as f64
    }
}
