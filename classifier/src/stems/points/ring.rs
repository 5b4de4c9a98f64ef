//! The ring that stands out most among the points of a band of heights: where a fit to points alone starts.
//!
//! In: points of a band, horizontally, around a candidate's place. Out: a circle and the evidence for it. Circles through
//! three points are tried, a bounded number of them, and judged by how much denser points lie on the ring than around it and
//! that next to none lie inside. Metres.

use super::Spot;
use std::f64::consts::PI;

/// A circle in a band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Its centre, east and north of the place.
    pub at_m: [f64; 2],
    /// Its radius.
    pub radius_m: f64,
    /// Logarithm of how much likelier it makes the points of the band than an even spread does.
    pub evidence: f64,
}

/// Half the thickness of a ring, metres: bark, and the noise of a moving scanner.
const HALF_M: f64 = 0.03;
/// How far outside a ring points count against it, metres.
const BESIDE_M: f64 = 0.3;
/// What a point inside a ring costs.
const INSIDE_COST: f64 = 1.5;
/// How far from the place the first point of a circle may lie, metres.
const ANCHOR_M: f64 = 0.3;
/// First points, and circles through each of them at each scale.
const ANCHORS: usize = 8;
const CIRCLES: usize = 8;
/// How far apart the points of a circle may lie, metres: a circle wants points about its own diameter apart.
const SCALES_M: [f64; 4] = [0.12, 0.25, 0.5, 1.1];
/// Most points of a band that are looked at.
const SPOTS_MAX: usize = 300;

/// The ring with the most evidence, radius between two bounds.
pub fn best_ring(band: &[Spot], radius_m: [f64; 2]) -> Option<Ring> {
    let spots: Vec<[f32; 2]> =
        band.iter().step_by(band.len().div_ceil(SPOTS_MAX).max(1)).map(|spot| spot.at_m.map(|c| c as f32)).collect();
    let anchors: Vec<[f32; 2]> = spots.iter().filter(|[x, y]| f64::from(x.hypot(*y)) < ANCHOR_M).copied().collect();
    let mut best: Option<Ring> = None;
    for anchor in anchors.iter().step_by(anchors.len().div_ceil(ANCHORS).max(1)) {
        let near = Near::of(&spots, *anchor);
        for scale_m in SCALES_M {
            for (second, third) in pairs(near.within(scale_m)) {
                let Some((at_m, r_m)) = circle([[0.0; 2], near.spot(second), near.spot(third)]) else { continue };
                if (radius_m[0]..=radius_m[1]).contains(&r_m) {
                    let evidence = near.evidence(at_m, r_m);
                    if best.is_none_or(|best| evidence > best.evidence) {
                        let at_m = [0, 1].map(|axis| at_m[axis] + f64::from(anchor[axis]));
                        best = Some(Ring { at_m, radius_m: r_m, evidence });
                    }
                }
            }
        }
    }
    best
}

/// The points of a band relative to one of them, the nearest first.
struct Near {
    away_m: Vec<f32>,
    east_m: Vec<f32>,
    north_m: Vec<f32>,
}

impl Near {
    fn of(spots: &[[f32; 2]], anchor: [f32; 2]) -> Self {
        let ways = spots.iter().map(|[x, y]| [x - anchor[0], y - anchor[1]]);
        let mut ways: Vec<(f32, [f32; 2])> = ways.map(|way| (way[0].hypot(way[1]), way)).collect();
        ways.sort_by(|a, b| a.0.total_cmp(&b.0));
        let field = |of: fn(&(f32, [f32; 2])) -> f32| ways.iter().map(of).collect();
        Self { away_m: field(|way| way.0), east_m: field(|way| way.1[0]), north_m: field(|way| way.1[1]) }
    }

    fn within(&self, away_m: f64) -> usize {
        self.away_m.partition_point(|away| f64::from(*away) < away_m)
    }

    fn spot(&self, i: usize) -> [f64; 2] {
        [f64::from(self.east_m[i]), f64::from(self.north_m[i])]
    }

    /// Poisson likelihood of a dense ring, an empty inside and an even outside, against an even spread.
    fn evidence(&self, at_m: [f64; 2], radius_m: f64) -> f64 {
        let bounds_m = [radius_m - HALF_M, radius_m + HALF_M, radius_m + BESIDE_M];
        // The ring runs through the first point: what is farther away than this lies outside of all bounds.
        let [inside, on, beside] = self.counts(self.within(bounds_m[2] + radius_m), at_m, bounds_m);
        let disc = |r: f64| PI * r.max(0.0).powi(2);
        let even = (on + inside + beside) / disc(bounds_m[2]);
        let term = |count: f64, area: f64| if count > 0.0 { count * (count / area / even).ln() } else { 0.0 };
        let areas = [disc(bounds_m[1]) - disc(bounds_m[0]), disc(bounds_m[2]) - disc(bounds_m[1])];
        term(on, areas[0]) + term(beside, areas[1]) - INSIDE_COST * inside
    }

    /// How many of the first points lie below the first bound, between it and the second, between that and the third.
    fn counts(&self, first: usize, at_m: [f64; 2], bounds_m: [f64; 3]) -> [f64; 3] {
        let [x, y] = at_m.map(|c| c as f32);
        let [low, high, end] = bounds_m.map(|bound_m| bound_m.max(0.0) as f32).map(|bound_m| bound_m * bound_m);
        let mut below = [0u32; 3];
        for (east_m, north_m) in self.east_m[..first].iter().zip(&self.north_m[..first]) {
            let square = (east_m - x) * (east_m - x) + (north_m - y) * (north_m - y);
            below[0] += u32::from(square < low);
            below[1] += u32::from(square < high);
            below[2] += u32::from(square < end);
        }
        [below[0], below[1] - below[0], below[2] - below[1]].map(f64::from)
    }
}

/// Pairs of the neighbours of an anchor, itself left out: the far ones with the middle ones, always the same.
fn pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    let tries = if count > 2 { CIRCLES } else { 0 };
    (0..tries).filter_map(move |i| {
        // Two sequences that fill the range evenly and meet rarely: multiples of the golden and of the plastic ratio.
        let pick = |ratio: f64| 1 + (((i as f64 + 0.5) * ratio).fract() * (count - 1) as f64) as usize;
        let (second, third) = (pick(0.618_033_988_75), pick(0.754_877_666_25));
        (second != third).then_some((second, third))
    })
}

/// The circle through three points; nothing where they lie on a line.
fn circle([a, b, c]: [[f64; 2]; 3]) -> Option<([f64; 2], f64)> {
    let ([bx, by], [cx, cy]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let twice_area = 2.0 * (bx * cy - by * cx);
    if twice_area.abs() < 1e-6 {
        return None;
    }
    let (bb, cc) = (bx * bx + by * by, cx * cx + cy * cy);
    let (x, y) = ((cy * bb - by * cc) / twice_area, (bx * cc - cx * bb) / twice_area);
    Some(([a[0] + x, a[1] + y], x.hypot(y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_through_three_points_is_the_known_one() {
        let (at_m, radius_m) = circle([[3.0, 1.0], [1.0, 3.0], [-1.0, 1.0]]).unwrap();
        assert!((at_m[0] - 1.0).abs() < 1e-9 && (at_m[1] - 1.0).abs() < 1e-9 && (radius_m - 2.0).abs() < 1e-9);
        assert!(circle([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]).is_none());
    }

    #[test]
    fn half_a_ring_among_leaves_is_found() {
        let mut band = Vec::new();
        for i in 0..40 {
            let angle = PI * f64::from(i) / 40.0;
            let wobble = 0.01 * f64::from(i % 3 - 1);
            let at_m = [0.15 + (0.2 + wobble) * angle.cos(), 0.05 + (0.2 + wobble) * angle.sin()];
            band.push(Spot { at_m, up_m: 0.0 });
            // Leaves all over two square metres.
            band.push(Spot { at_m: [f64::from(i * 7 % 40) / 20.0 - 1.0, f64::from(i) / 40.0 - 1.1], up_m: 0.0 });
        }
        let ring = best_ring(&band, [0.02, 0.6]).unwrap();
        assert!(
            (ring.at_m[0] - 0.15).hypot(ring.at_m[1] - 0.05) < 0.04 && (ring.radius_m - 0.2).abs() < 0.03,
            "{ring:?}"
        );
    }
}
