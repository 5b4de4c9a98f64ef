//! The fit of one stem to all beams towards it: where it hits, how deep, and where beams pass beside.
//!
//! Likelihood of a beam with margin m = R + w - |u|: it ends at the stem with q(m) = a + (1 - a - b) / (1 + exp(-m / s)),
//! a and b being the shares of beams that twigs end outside and that miss inside; and the echo of a beam that ends there
//! lies normally around the expected depth, far ones weighing less. Fisher scoring in three passes with narrowing edges.
//! In: sights and a start. Out: the stem and its covariance. Source: docs/equations.md, "Stems".

use super::config::StemsConfig;
use super::model::{Meeting, Outcome, Stem, TAPER, UNKNOWNS};
use super::normal::{Column, Matrix, Sums};
use super::sight::Sight;

/// Passes: width of the edge and tolerance of a hit, metres; the last is what range noise and bark leave.
const PASSES: [(f64, f64); 4] = [(0.04, 0.15), (0.025, 0.10), (0.015, 0.08), (0.01, 0.07)];
/// Widths of the edge in the passes of [`sharpened`], metres, and by how much of that they grow a metre of range: an
/// echo is lost within millimetres of where the outermost light leaves the stem.
const SHARP_M: [f64; 3] = [0.006, 0.004, 0.003];
const SHARP_GROWTH: f64 = 0.1;
/// Ranges that tell as much as one there, and the share of beams inside the silhouette that pass.
const SHARP_ALIKE: f64 = 5.0;
const SHARP_PASSED: f64 = 0.01;
/// Beams in all passes but the last.
const COARSE_BEAMS: usize = 300;
/// How far off a stem's surface and axis an echo may lie and still say something of it, metres: the widest tolerance, and
/// what a fit moves.
const REACH_M: f64 = 0.4;
/// Azimuths closer than this are one, radians.
const AZIMUTH_STEP: f64 = 0.002;
/// Ranges that tell as much as one: what the model lacks (bark, bends) is alike in neighbours.
const RANGES_ALIKE: f64 = 30.0;
/// Radii of the starts, in radii of what was found first.
const STARTS: [f64; 2] = [1.0, 0.6];
/// Logarithm of the likelihood of a beam that ends around the surface, but not at it.
const BLOCKED: f64 = -1.5;
/// Most steps of a pass, and the step below which it ends, metres.
const STEPS: usize = 4;
const STEP_MIN_M: f64 = 2e-4;
/// Margin, in widths of the edge, beyond which a beam says nothing of it.
const EDGE_REACH: f64 = 12.0;
/// Share of beams beside a stem that end there all the same (twigs, leaves, brush): where it starts, and its bounds.
const ENDED_OUTSIDE: f64 = 0.12;
const ENDED_OUTSIDE_MIN: f64 = 0.04;
const ENDED_OUTSIDE_MAX: f64 = 0.5;
/// Share of beams inside a stem's silhouette that pass: bark, bends, poses.
const PASSED_INSIDE: f64 = 0.03;
/// Growth of the edge's width with the range: half a step between beams is not known better.
const EDGE_GROWTH: f64 = 0.0008;
/// One sigma of the lean, metres a metre up.
const LEAN_STD: f64 = 0.1;
/// Largest step of a radius or a position at once, metres.
const STEP_MAX_M: f64 = 0.06;

/// A stem with what is known of it.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The most likely stem.
    pub stem: Stem,
    /// Its covariance, from the Fisher information; unscaled.
    pub covariance: Matrix,
}

/// How sharp edges and ranges are in a pass.
#[derive(Clone, Copy, Debug)]
pub struct Sharpness {
    edge_m: f64,
    /// Growth of the edge's width with the range.
    growth: f64,
    /// Tolerance of a hit, metres.
    pub tolerance_m: f64,
    range_std_m: f64,
    /// Ranges that tell as much as one.
    alike: f64,
    ended_outside: f64,
    passed_inside: f64,
}

impl Sharpness {
    /// That of a pass.
    fn of(pass: usize, config: &StemsConfig) -> Self {
        let (edge_m, tolerance_m) = PASSES[pass];
        Self {
            edge_m,
            growth: EDGE_GROWTH,
            tolerance_m,
            range_std_m: config.range_std_m,
            alike: 1.0,
            ended_outside: ENDED_OUTSIDE,
            passed_inside: PASSED_INSIDE,
        }
    }

    /// That of a pass of [`sharpened`].
    fn sharp(edge_m: f64, config: &StemsConfig) -> Self {
        let (growth, alike, passed_inside) = (SHARP_GROWTH * edge_m, SHARP_ALIKE, SHARP_PASSED);
        Self { edge_m, growth, alike, passed_inside, ..Self::last(config) }
    }

    /// With the share of beams that end beside this stem as it is counted there.
    fn beside(self, stem: &Stem, sights: &[Sight]) -> Self {
        let (mut ended, mut beams) = (1.0, 1.0 / ENDED_OUTSIDE);
        for sight in sights {
            let meeting = stem.meet(sight);
            if meeting.inside_m() < -3.0 * self.edge_m(&meeting) {
                match meeting.outcome(sight, self.tolerance_m).0 {
                    Outcome::Hit(_) => (ended, beams) = (ended + 1.0, beams + 1.0),
                    Outcome::Passed => beams += 1.0,
                    Outcome::Blocked => {}
                }
            }
        }
        Self { ended_outside: (ended / beams).clamp(ENDED_OUTSIDE_MIN, ENDED_OUTSIDE_MAX), ..self }
    }

    /// That of the last pass.
    pub fn last(config: &StemsConfig) -> Self {
        Self::of(PASSES.len() - 1, config)
    }

    fn edge_m(&self, meeting: &Meeting) -> f64 {
        let growth_m = self.growth * meeting.ahead_m;
        (self.edge_m * self.edge_m + growth_m * growth_m).sqrt()
    }

    /// Weight of an echo that lies so far behind the expected surface, 1 / m^2: far ones weigh less.
    fn range_weight(&self, behind_m: f64) -> f64 {
        let far = behind_m / (3.0 * self.range_std_m);
        1.0 / ((1.0 + far * far) * self.range_std_m).powi(2)
    }

    /// Probability that a beam ends at the stem, and its derivative by the margin.
    fn ending(&self, meeting: &Meeting) -> (f64, f64) {
        let edge_m = self.edge_m(meeting);
        let span = 1.0 - self.ended_outside - self.passed_inside;
        let margin = meeting.inside_m() / edge_m;
        if margin.abs() > EDGE_REACH {
            return (if margin > 0.0 { self.ended_outside + span } else { self.ended_outside }, 0.0);
        }
        let p = 1.0 / (1.0 + (-margin).exp());
        (self.ended_outside + span * p, span * p * (1.0 - p) / edge_m)
    }
}

/// Every n-th, so that about `count` remain.
pub fn every(sights: &[Sight], count: usize) -> Vec<Sight> {
    sights.iter().step_by(sights.len().div_ceil(count).max(1)).copied().collect()
}

/// Those that may say something of a stem near this one. A beam that ended well before it, and sent no later echo from near
/// it, is blocked wherever a fit moves the stem.
pub fn telling(stem: &Stem, sights: &[Sight]) -> Vec<Sight> {
    let tells = |sight: &&Sight| {
        let meeting = stem.meet(sight);
        let behind_m = sight.echoes_m.map(|echo_m| echo_m - meeting.ahead_m);
        let before_m = -(meeting.radius_m + REACH_M);
        behind_m[0] > before_m || (before_m..REACH_M).contains(&behind_m[1])
    };
    sights.iter().filter(tells).copied().collect()
}

/// The passes with wide edges, on some of the beams. Edges pull only from near, so a thinner start is tried as well.
pub fn coarse(start: Stem, sights: &[Sight], config: &StemsConfig) -> Option<Stem> {
    let some = telling(&start, &every(sights, COARSE_BEAMS));
    let passes: [_; PASSES.len() - 1] = std::array::from_fn(|pass| Sharpness::of(pass, config));
    let starts = STARTS.map(|share| Stem { radius_m: share * start.radius_m, ..start });
    let stems = starts.into_iter().filter_map(|start| converge(start, &some, &passes, config));
    let valued = stems.map(|stem| (log_likelihood(&stem, &some, Sharpness::last(config)), stem));
    Some(valued.max_by(|a, b| a.0.total_cmp(&b.0))?.1)
}

/// The last pass, on all beams.
pub fn fine(coarse: Stem, sights: &[Sight], config: &StemsConfig) -> Option<Fit> {
    let last = Sharpness::last(config);
    fitted(converge(coarse, sights, &[last], config)?, sights, last)
}

/// A fit to the same beams, where they come with all of their echoes: then edges are known to millimetres, and tell
/// more of a radius than ranges do.
pub fn sharpened(fit: &Fit, sights: &[Sight], config: &StemsConfig) -> Option<Fit> {
    let passes = SHARP_M.map(|edge_m| Sharpness::sharp(edge_m, config));
    let mut fit = fitted(converge(fit.stem, sights, &passes, config)?, sights, passes[SHARP_M.len() - 1])?;
    fit.stem.radius_m -= config.bark_m;
    Some(fit)
}

fn fitted(stem: Stem, sights: &[Sight], sharp: Sharpness) -> Option<Fit> {
    Some(Fit { stem, covariance: covariance(&stem, sights, sharp.beside(&stem, sights))? })
}

/// Scoring steps of some passes.
fn converge(start: Stem, sights: &[Sight], passes: &[Sharpness], config: &StemsConfig) -> Option<Stem> {
    let mut stem = start;
    for pass in passes {
        let sharp = pass.beside(&stem, sights);
        for _ in 0..STEPS {
            let (gradient, fisher) = score(&stem, sights, sharp);
            let step = damped(&fisher).cholesky()?.solve(&gradient);
            stem = moved(&stem, &step, config);
            if step.fixed_rows::<3>(0).amax() < STEP_MIN_M && step.fixed_rows::<3>(3).amax() < STEP_MIN_M {
                break;
            }
        }
    }
    stem.unknowns().iter().all(|value| value.is_finite()).then_some(stem)
}

/// Logarithm of the likelihood of all sights.
fn log_likelihood(stem: &Stem, sights: &[Sight], sharp: Sharpness) -> f64 {
    let of_sight = |sight: &Sight| {
        let meeting = stem.meet(sight);
        let (q, _) = sharp.ending(&meeting);
        match meeting.outcome(sight, sharp.tolerance_m).0 {
            Outcome::Hit(behind_m) => q.ln() - 2.0 * (1.0 + (behind_m / (3.0 * sharp.range_std_m)).powi(2)).ln(),
            Outcome::Passed => (1.0 - q).ln(),
            Outcome::Blocked => BLOCKED,
        }
    };
    sights.iter().map(of_sight).sum()
}

/// Covariance of a fit: the Fisher information of edges counts once an azimuth, however many beams lie above one another.
fn covariance(stem: &Stem, sights: &[Sight], sharp: Sharpness) -> Option<Matrix> {
    let (mut ranges, mut edges) = (Sums::default(), Sums::default());
    let mut azimuths: Vec<[i32; 2]> = Vec::new();
    for sight in sights {
        let meeting = stem.meet(sight);
        let (outcome, depth) = meeting.outcome(sight, sharp.tolerance_m);
        if outcome == Outcome::Blocked {
            continue;
        }
        if meeting.inside_m().abs() < 3.0 * sharp.edge_m(&meeting) {
            let (q, slope) = sharp.ending(&meeting);
            edges.add(by_margin(sight, &meeting), sight.up_m, 0.0, slope * slope / (q * (1.0 - q)));
            azimuths.push([sight.along[0].atan2(sight.along[1]) / AZIMUTH_STEP, sight.ahead_m / 0.2].map(|v| v as i32));
        }
        if let Outcome::Hit(behind_m) = outcome {
            let weight = sharp.range_weight(behind_m) / RANGES_ALIKE;
            ranges.add(by_range(sight, depth), sight.up_m, 0.0, weight);
        }
    }
    let count = azimuths.len();
    azimuths.sort_unstable();
    azimuths.dedup();
    let share = azimuths.len() as f64 / count.max(1) as f64;
    Some((priors(stem).1 + ranges.fisher() + edges.fisher() * share).cholesky()?.inverse())
}

/// Shorter steps where little is known.
fn damped(fisher: &Matrix) -> Matrix {
    let mut damped = *fisher;
    for i in 0..UNKNOWNS {
        damped[(i, i)] += 0.1 * fisher[(i, i)] + 100.0;
    }
    damped
}

fn moved(stem: &Stem, step: &Column, config: &StemsConfig) -> Stem {
    let longest = step[0].abs().max(step[1].abs()).max(step[2].abs());
    let scale = (STEP_MAX_M / longest.max(1e-9)).min(1.0);
    let mut unknowns = stem.unknowns();
    for (i, value) in unknowns.iter_mut().enumerate() {
        *value += scale * step[i];
    }
    unknowns[2] = unknowns[2].clamp(0.01, config.radius_max_m);
    Stem::from_unknowns(unknowns)
}

/// Gradient of the logarithm of the likelihood, and the Fisher information, priors included.
fn score(stem: &Stem, sights: &[Sight], sharp: Sharpness) -> (Column, Matrix) {
    let mut sums = Sums::default();
    for sight in sights {
        let meeting = stem.meet(sight);
        let (outcome, depth) = meeting.outcome(sight, sharp.tolerance_m);
        if outcome == Outcome::Blocked {
            continue;
        }
        let (q, slope) = sharp.ending(&meeting);
        if slope > 0.0 {
            let pull = if matches!(outcome, Outcome::Hit(_)) { slope / q } else { -slope / (1.0 - q) };
            sums.add(by_margin(sight, &meeting), sight.up_m, pull, slope * slope / (q * (1.0 - q)));
        }
        if let Outcome::Hit(behind_m) = outcome {
            let weight = sharp.range_weight(behind_m) / sharp.alike;
            sums.add(by_range(sight, depth), sight.up_m, -behind_m * weight, weight);
        }
    }
    let (gradient, fisher) = priors(stem);
    (gradient + sums.gradient(), fisher + sums.fisher())
}

/// Gradient and information of what is known of stems before anything was seen.
pub fn priors(stem: &Stem) -> (Column, Matrix) {
    let (mut gradient, mut fisher) = (Column::zeros(), Matrix::zeros());
    for (i, value, mean, std) in
        [(3, stem.lean[0], 0.0, LEAN_STD), (4, stem.lean[1], 0.0, LEAN_STD), (5, stem.taper, TAPER[0], TAPER[1])]
    {
        gradient[i] = (mean - value) / (std * std);
        fisher[(i, i)] = 1.0 / (std * std);
    }
    // A radius and a place that no beam bounds are unknown to half a metre.
    (0..3).for_each(|i| fisher[(i, i)] += 4.0);
    (gradient, fisher)
}

/// Of the margin R + w - |u|, by east, north and radius at the beam's height.
fn by_margin(sight: &Sight, meeting: &Meeting) -> [f64; 3] {
    let side = meeting.left_m.signum();
    [side * sight.along[1], -side * sight.along[0], 1.0]
}

/// Of how far an echo lies behind the expected surface, alike.
fn by_range(sight: &Sight, [_, by_left, by_radius]: [f64; 3]) -> [f64; 3] {
    let [x, y] = sight.along;
    [-x - y * by_left, -y + x * by_left, by_radius]
}
