//! The fit of one stem to points on its surface, whatever beams they came from.
//!
//! A leaning, tapering cylinder; least squares of the horizontal distances from its surface, weights falling with the
//! distance, over a range of heights that grows from where the ring was found. In: points around a place and a start.
//! Out: the stem, its covariance and the noise of its surface, metres.

use super::super::fit::{Fit, priors};
use super::super::model::Stem;
use super::super::normal::Sums;
use super::Spot;

/// Passes: half of the range of heights around the ring, and how far off the surface points count, metres.
const PASSES: [(f64, f64); 4] = [(0.6, 0.08), (1.2, 0.06), (2.0, 0.06), (4.5, 0.06)];
/// Steps of a pass.
const STEPS: usize = 5;
/// Bounds of the noise of a surface, metres: bark, and a moving scanner's thickness.
const NOISE_M: [f64; 2] = [0.006, 0.04];
/// Points that tell as much as one: bark and poses are alike in neighbours.
const ALIKE: f64 = 10.0;

/// A stem, and the noise of its points.
#[derive(Clone, Debug)]
pub struct PointFit {
    /// The stem and its covariance.
    pub fit: Fit,
    /// One sigma of the points' distances from its surface, metres.
    pub noise_m: f64,
}

/// How far a point lies outside of a stem's surface, metres, and the direction there.
pub fn outside(stem: &Stem, spot: &Spot) -> (f64, [f64; 2]) {
    let axis = [stem.east_m + stem.lean[0] * spot.up_m, stem.north_m + stem.lean[1] * spot.up_m];
    let [x, y] = [spot.at_m[0] - axis[0], spot.at_m[1] - axis[1]];
    let away_m = x.hypot(y).max(1e-6);
    (away_m - stem.radius_at_m(spot.up_m), [x / away_m, y / away_m])
}

/// The stem near a start, from a ring at `up_m` above breast height.
pub fn fit(start: Stem, up_m: f64, spots: &[Spot], radius_max_m: f64) -> Option<PointFit> {
    let (mut stem, mut noise_m) = (start, 0.02);
    for (half_m, off_m) in PASSES {
        let near: Vec<Spot> = spots.iter().filter(|spot| (spot.up_m - up_m).abs() < half_m).copied().collect();
        for _ in 0..STEPS {
            let sums = sums(&stem, &near, noise_m, off_m);
            let (gradient, fisher) = priors(&stem);
            let step = (fisher + sums.fisher()).cholesky()?.solve(&(gradient + sums.gradient()));
            let mut unknowns = stem.unknowns();
            unknowns.iter_mut().zip(step.iter()).for_each(|(value, step)| *value += step.clamp(-0.1, 0.1));
            unknowns[2] = unknowns[2].clamp(0.01, radius_max_m);
            stem = Stem::from_unknowns(unknowns);
        }
        noise_m = noise(&stem, &near, off_m)?;
    }
    let sums = sums(&stem, spots, noise_m, PASSES[PASSES.len() - 1].1);
    let covariance = (priors(&stem).1 + sums.fisher() / ALIKE).cholesky()?.inverse();
    let is_finite = stem.unknowns().iter().all(|value| value.is_finite());
    is_finite.then_some(PointFit { fit: Fit { stem, covariance }, noise_m })
}

fn sums(stem: &Stem, spots: &[Spot], noise_m: f64, off_m: f64) -> Sums {
    let mut sums = Sums::default();
    for spot in spots {
        let (out_m, [x, y]) = outside(stem, spot);
        if out_m.abs() < off_m {
            let far = out_m / (2.0 * noise_m);
            let weight = 1.0 / ((1.0 + far * far) * noise_m).powi(2);
            sums.add([x, y, 1.0], spot.up_m, out_m * weight, weight);
        }
    }
    sums
}

/// One sigma from the middle of the distances; nothing where too few points are near.
fn noise(stem: &Stem, spots: &[Spot], off_m: f64) -> Option<f64> {
    let mut off: Vec<f64> = spots.iter().map(|spot| outside(stem, spot).0.abs()).filter(|off| *off < off_m).collect();
    let middle = off.len() / 2;
    let (_, median, _) = (off.len() > 3).then(|| off.select_nth_unstable_by(middle, f64::total_cmp))?;
    Some((1.4826 * *median).clamp(NOISE_M[0], NOISE_M[1]))
}
