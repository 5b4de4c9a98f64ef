//! Scheme 2: the share of hits, p = n_h / (n_h + n_p), a byte each, both halved when one saturates. Thesis (2-4).
//!
//! The two counters live beside the bricks; the brick that readers see is derived from them: occupancy is the
//! distance of p from the threshold, confidence the number of windows counted. Counts windows; weights are not used:
//! a sensor of any weight counts one.
//!
//! It clears slowly by its definition: after h hits, p falls to a threshold t with the first m misses for which
//! m >= h (1 - t) / t; 3 hits and t = 0.3 make 7. Only saturation bounds that: 255 hits are forgotten after 403 misses.

use crate::config::SchemeConfig;
use crate::evidence::Passed;
use tsense_contract::{BRICK_VOXELS, Brick};

/// Hits and misses of a brick's voxels.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Counters {
    /// Windows in which a beam ended in the voxel.
    pub hits: [u8; BRICK_VOXELS],
    /// Windows in which beams only passed.
    pub misses: [u8; BRICK_VOXELS],
}

/// The threshold of scheme 2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratio {
    min: f64,
}

impl Ratio {
    /// From the configuration.
    pub fn new(config: &SchemeConfig) -> Self {
        Self { min: config.hit_ratio_min }
    }

    /// A voxel was hit for the first time in a window.
    pub fn hit(&self, counters: &mut Counters, brick: &mut Brick, voxel: usize) {
        (counters.hits[voxel], counters.misses[voxel]) = count(counters.hits[voxel], counters.misses[voxel]);
        self.derive(counters, brick, voxel);
    }

    /// A hit did not count after all.
    pub fn take_back(&self, counters: &mut Counters, brick: &mut Brick, voxel: usize) {
        counters.hits[voxel] = counters.hits[voxel].saturating_sub(1);
        self.derive(counters, brick, voxel);
    }

    /// The window ended: voxels that beams only passed. True where readers see a change.
    pub fn misses(&self, counters: &mut Counters, brick: &mut Brick, passed: &Passed) -> bool {
        let (before, passed) = (*brick, passed.any());
        for voxel in 0..BRICK_VOXELS {
            if passed >> voxel & 1 == 1 {
                (counters.misses[voxel], counters.hits[voxel]) = count(counters.misses[voxel], counters.hits[voxel]);
                self.derive(counters, brick, voxel);
            }
        }
        *brick != before
    }

    /// Adds the counts of an earlier time; both are halved until they fit a byte.
    pub fn add(&self, earlier: &Counters, counters: &mut Counters, brick: &mut Brick) {
        for voxel in 0..BRICK_VOXELS {
            let mut hits = u16::from(counters.hits[voxel]) + u16::from(earlier.hits[voxel]);
            let mut misses = u16::from(counters.misses[voxel]) + u16::from(earlier.misses[voxel]);
            while hits.max(misses) > 255 {
                (hits, misses) = (hits / 2, misses / 2);
            }
            (counters.hits[voxel], counters.misses[voxel]) = (hits as u8, misses as u8);
            if hits + misses > 0 {
                self.derive(counters, brick, voxel);
            }
        }
    }

    /// Counts that give about this brick: for maps from elsewhere, which carry none.
    pub fn estimate(&self, brick: &Brick) -> Counters {
        let mut counters = Counters { hits: [0; BRICK_VOXELS], misses: [0; BRICK_VOXELS] };
        for voxel in 0..BRICK_VOXELS {
            let share = (f64::from(brick.occupancy[voxel]) / 127.0 + self.min).clamp(0.0, 1.0);
            let hits = (share * f64::from(brick.confidence[voxel])).round() as u8;
            (counters.hits[voxel], counters.misses[voxel]) = (hits, brick.confidence[voxel] - hits);
        }
        counters
    }

    fn derive(&self, counters: &Counters, brick: &mut Brick, voxel: usize) {
        let (hits, all) =
            (u16::from(counters.hits[voxel]), u16::from(counters.hits[voxel]) + u16::from(counters.misses[voxel]));
        let above = f64::from(hits) / f64::from(all.max(1)) - self.min;
        // Away from zero, so that the sign alone says which side of the threshold p is.
        let scaled = if above > 0.0 { (above * 127.0).ceil() } else { (above * 127.0).floor() };
        brick.occupancy[voxel] = scaled as i8;
        brick.confidence[voxel] = all.min(255) as u8;
    }
}

/// One more of the first; both halved when it would pass a byte.
fn count(first: u8, second: u8) -> (u8, u8) {
    match first.checked_add(1) {
        Some(more) => (more, second),
        None => (128, second / 2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn the_share_of_hits_decides_and_survives_saturation() {
        let ratio = Ratio::new(&SchemeConfig { hit_ratio_min: 0.5, ..Default::default() });
        let (mut counters, mut brick) = (Counters::zeroed(), Brick::UNKNOWN);
        let passed = Passed([0, 0, 0, 1 << 3]);
        for _ in 0..300 {
            ratio.hit(&mut counters, &mut brick, 3);
            ratio.misses(&mut counters, &mut brick, &passed);
            ratio.hit(&mut counters, &mut brick, 3);
        }
        let share = f64::from(counters.hits[3]) / f64::from(counters.hits[3] as u16 + counters.misses[3] as u16);
        assert!((share - 2.0 / 3.0).abs() < 0.02, "{share}");
        assert!(brick.occupancy[3] > 0 && brick.confidence[3] == 255);
        assert_eq!((brick.occupancy[4], brick.confidence[4]), (0, 0));
    }

    /// Windows of misses until a voxel with so many hits is no longer occupied, by default.
    fn misses_after(hits: usize) -> usize {
        let ratio = Ratio::new(&SchemeConfig::default());
        let (mut counters, mut brick) = (Counters::zeroed(), Brick::UNKNOWN);
        let passed = Passed([0, 0, 0, 1]);
        (0..hits).for_each(|_| ratio.hit(&mut counters, &mut brick, 0));
        let still = |_: &usize| {
            ratio.misses(&mut counters, &mut brick, &passed);
            brick.occupancy[0] > 0
        };
        1 + (0..1000).take_while(still).count()
    }

    #[test]
    fn a_voxel_clears_as_the_definition_says() {
        // h / (h + m) <= 0.3.
        assert_eq!([1, 2, 3, 6, 30].map(misses_after), [3, 5, 7, 14, 70]);
        // 255 hits, 255 misses: the next miss halves both to 127 and 128; the 128th after it again to 63 and 128; then
        // 63 / (63 + 147) = 0.3.
        assert_eq!(misses_after(255), 256 + 128 + 19);
    }

    #[test]
    fn saturation_halves_both_counters_and_keeps_their_share() {
        assert_eq!(count(254, 101), (255, 101));
        assert_eq!((count(255, 101), count(255, 255), count(255, 1)), ((128, 50), (128, 127), (128, 0)));
        // The share is off by less than half a count of 128.
        for second in 0..=255u8 {
            let (first, halved) = count(255, second);
            let exact = 256.0 / (256.0 + f64::from(second));
            let share = f64::from(first) / (f64::from(first) + f64::from(halved));
            assert!((share - exact).abs() <= 0.5 / 128.0, "{second}: {share} {exact}");
        }
    }

    #[test]
    fn equal_hits_and_misses_at_a_threshold_of_a_half_are_not_occupied() {
        let ratio = Ratio::new(&SchemeConfig { hit_ratio_min: 0.5, ..Default::default() });
        let (mut counters, mut brick) = (Counters::zeroed(), Brick::UNKNOWN);
        ratio.hit(&mut counters, &mut brick, 0);
        assert!(brick.occupancy[0] > 0);
        let passed = Passed([0, 0, 0, 1]);
        ratio.misses(&mut counters, &mut brick, &passed);
        assert_eq!(brick.occupancy[0], 0);
    }
}
