//! How far beside a stem a ladar still sees it that sends one echo a beam, the strongest: that depends on what is behind.
//!
//! A beam's light lies normally across it, one sigma being a share of half its width. A stem at range r that is met by
//! the share p of the light sends p / r^2 back, what stands behind at range R sends (1 - p) / R^2. The stem's echo is the
//! stronger one from p = 1 / (1 + (R / r)^2) on; the normal distribution being close to a logistic one of 1.702 its argument, a
//! beam meets that share while its middle runs (2 / 1.702) sigma ln(R / r) beside the edge. Nothing behind is as good as
//! something where a stem that fills the beam is just seen. In: sights whose half widths are whole. Out: the half widths
//! that see edges. Source: docs/equations.md, "Stems".

use super::config::StemsConfig;
use super::sight::Sight;
use crate::trunk::BREAST_HEIGHT_M;

/// Sigmas beside the edge for each unit of ln(R / r): two over the factor between the normal and the logistic distribution.
const SIGMAS: f64 = 2.0 / 1.702;
/// One sigma of the share of a half width: light is not quite normal, bark not as bright as what is behind.
const SHARE_STD: f64 = 0.15;
/// Most of a half width that sees edges.
const SHARE_MAX: f64 = 0.83;
/// An echo this far behind the place is the background's, metres: nearer ones melt with the stem's.
const BEHIND_M: f64 = 0.7;
/// Height of a slice, metres, and slices; what is higher counts to the last.
const SLICE_M: f64 = 0.3;
const SLICES: usize = 16;

/// Mean of some shares.
#[derive(Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, share: f64) {
        (self.sum, self.count) = (self.sum + share, self.count + 1);
    }
    fn value(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

/// Narrows whole half widths to those that see edges. A beam that goes on behind the place shows what is behind; for
/// the others it is what their neighbours on the same side and about the same height show.
pub fn narrow(sights: &mut [Sight], config: &StemsConfig) {
    let mut all = Mean::default();
    let mut slices = [[Mean::default(); 2]; SLICES];
    for sight in sights.iter() {
        if let Some(share) = own_share(sight, config) {
            let (slice, side) = place(sight);
            slices[slice][side].add(share);
            all.add(share);
        }
    }
    let default = share_before(config.beam_reach_m, 1.0, config);
    for sight in sights {
        let (slice, side) = place(sight);
        let around = || slices[slice][side].value().or(all.value()).unwrap_or(default);
        sight.half_std_m = SHARE_STD * sight.half_m;
        // A disc of even light has half its radius as one sigma across.
        sight.spot_m = 2.0 * config.beam_sigma_share * sight.half_m;
        sight.half_m *= own_share(sight, config).unwrap_or_else(around);
    }
}

fn place(sight: &Sight) -> (usize, usize) {
    let slice = ((sight.up_m + BREAST_HEIGHT_M) / SLICE_M) as usize;
    (slice.min(SLICES - 1), usize::from(sight.left_m > 0.0))
}

/// By what a beam met behind the place; nothing where it ended before or at it.
fn own_share(sight: &Sight, config: &StemsConfig) -> Option<f64> {
    let [first_m, _] = sight.echoes_m;
    (first_m > sight.ahead_m + BEHIND_M).then(|| share_before(first_m, sight.ahead_m, config))
}

/// Share of half a beam's width by which it sees a stem before a background.
fn share_before(background_m: f64, stem_m: f64, config: &StemsConfig) -> f64 {
    let ratio = background_m.min(config.beam_reach_m) / stem_m.max(0.1);
    (SIGMAS * config.beam_sigma_share * ratio.ln()).clamp(0.0, SHARE_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(left_m: f64, first_m: f64) -> Sight {
        Sight {
            along: [1.0, 0.0],
            ahead_m: 5.0,
            left_m,
            up_m: 0.0,
            half_m: 0.04,
            spot_m: 0.04,
            half_std_m: 0.0,
            echoes_m: [first_m, f64::INFINITY],
        }
    }

    #[test]
    fn a_far_background_lets_edges_be_seen_by_little_light_and_a_near_one_by_half() {
        let config = StemsConfig { beam_sigma_share: 0.5, beam_reach_m: 30.0, ..StemsConfig::default() };
        // ln(10 / 5) = 0.693; 0.693 x 2 / 1.702 = 0.8145 sigma of half a half width.
        assert!((share_before(10.0, 5.0, &config) - 0.407).abs() < 1e-3);
        // A fifth of the light on the stem, 1 / (1 + 2^2): normally 0.84 sigma beside the edge.
        assert!((share_before(10.0, 5.0, &config) / 0.5 - 0.8416).abs() < 0.03);
        assert_eq!(share_before(5.0, 5.0, &config), 0.0);
        assert_eq!(share_before(f64::INFINITY, 1.0, &config), SHARE_MAX);
    }

    #[test]
    fn a_beam_that_ends_at_the_stem_takes_its_neighbours_background() {
        let config = StemsConfig { beam_sigma_share: 0.5, beam_reach_m: 30.0, ..StemsConfig::default() };
        let mut sights = [sight(0.3, 10.0), sight(0.1, 4.9), sight(-0.1, 4.9), sight(-0.3, 5.8)];
        narrow(&mut sights, &config);
        let [far, left, right, near] = sights.map(|sight| sight.half_m / 0.04);
        assert!((far - 0.407).abs() < 1e-3 && (left - far).abs() < 1e-12);
        assert!((near - 0.5 * SIGMAS * 1.16f64.ln()).abs() < 1e-12 && (right - near).abs() < 1e-12);
    }
}
