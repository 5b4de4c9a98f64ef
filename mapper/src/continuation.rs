//! Going on with a block that was stored: how old knowledge ages, and how new evidence continues it.
//!
//! In: bricks as they were stored, how long they lay, bricks as beams have made them since. Out: bricks as they would
//! be, had the block never left, but for one rule: what a beam has just shown to be occupied stays occupied. Pure.
//!
//! - Unknown now: the stored voxel. Unknown then: the voxel of now.
//! - Known in both: occupancies add up within the scheme's limits (they are sums of steps), and so do confidences. Where
//!   the voxel is occupied now, the sum is at least what it is now: sums are clamped, so that old free evidence may
//!   weigh more than it did when it came, and a new thing must show at once.
//! - Hit ratio: hits and misses add up, both halved until they fit a byte; the brick is derived from them.

use crate::config::{Config, FadingConfig, Scheme};
use crate::evidence::fade;
use crate::ratio::{Counters, Ratio};
use crate::tsmap::StoredBlock;
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK, Brick};
use tsense_geometry::{NS_PER_S, Timestamp};

/// When a block is taken back: the life of the mapper, what all its blocks had to lose by now, the newest beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Life of the mapper.
    pub epoch: u64,
    /// Units of fading due since that life began.
    pub faded: u32,
    /// Now.
    pub stamp: Timestamp,
}

/// How stored blocks are continued under a configuration.
#[derive(Clone, Debug)]
pub struct Continuation {
    limits: (i8, i8),
    ratio: Option<Ratio>,
    fading: FadingConfig,
    fade_stored: bool,
}

impl Continuation {
    /// The rules of a configuration.
    pub fn new(config: &Config) -> Self {
        let scheme = &config.scheme;
        Self {
            limits: match scheme.scheme {
                Scheme::Confidence => (scheme.occupancy_min, scheme.occupancy_max),
                _ => (-127, 127),
            },
            ratio: (scheme.scheme == Scheme::HitRatio).then(|| Ratio::new(scheme)),
            fading: config.fading.clone(),
            fade_stored: config.blocks.fade_stored,
        }
    }

    /// Units of confidence that fell due while a block lay. Within one life of the mapper the very units that its other
    /// blocks lost, by time and way; from another life by time alone, because nobody knows how far the vehicle drove.
    pub fn units_due(&self, block: &StoredBlock, now: &Moment) -> u32 {
        if !self.fade_stored || self.ratio.is_some() {
            return 0;
        }
        if block.epoch == now.epoch && block.epoch != 0 {
            return now.faded.saturating_sub(block.faded);
        }
        let lay_s = now.stamp.ns.saturating_sub(block.stamp.ns).max(0) as f64 / NS_PER_S as f64;
        (lay_s * self.fading.per_second) as u32
    }

    /// The stored bricks, aged to a moment.
    pub fn aged(&self, block: &StoredBlock, now: &Moment) -> StoredBlock {
        let mut aged = block.clone();
        let units = self.units_due(block, now).min(255) as u8;
        if units > 0 {
            for brick in &mut aged.bricks {
                fade(brick, units, self.fading.floor_occupied, self.fading.floor_free);
            }
        }
        (aged.epoch, aged.faded, aged.stamp) = (now.epoch, now.faded, now.stamp);
        aged
    }

    /// Continues an aged brick with what beams have made of it since: the result stands in `now`.
    pub fn brick(&self, then: &Brick, now: &mut Brick) {
        let (low, high) = self.limits;
        for voxel in 0..BRICK_VOXELS {
            let (old, new) = (then.occupancy[voxel].clamp(low, high), now.occupancy[voxel]);
            match (then.confidence[voxel], now.confidence[voxel]) {
                (0, _) => {}
                (confidence, 0) => (now.occupancy[voxel], now.confidence[voxel]) = (old, confidence),
                (before, since) => {
                    let sum = old.saturating_add(new).clamp(low, high);
                    now.occupancy[voxel] = if new > 0 { sum.max(new) } else { sum };
                    now.confidence[voxel] = before.saturating_add(since);
                }
            }
        }
    }

    /// The same for the hit-ratio scheme. Without stored counters they are estimated from the brick.
    pub fn counted(&self, then: (&Brick, Option<&Counters>), now: (&mut Brick, &mut Counters)) {
        let Some(ratio) = &self.ratio else { return };
        let estimated;
        let before = match then.1 {
            Some(counters) => counters,
            None => {
                estimated = ratio.estimate(then.0);
                &estimated
            }
        };
        ratio.add(before, now.1, now.0);
    }

    /// One stored block continued by another that was stored later: for a block that left again before its older part
    /// had been read.
    pub fn joined(&self, older: &StoredBlock, newer: &StoredBlock) -> StoredBlock {
        let moment = Moment { epoch: newer.epoch, faded: newer.faded, stamp: newer.stamp };
        let aged = self.aged(older, &moment);
        let (then, mut now) = (aged.to_bricks(), newer.to_bricks());
        let mut counters = newer.to_counters();
        if self.ratio.is_some() {
            counters.resize(BRICKS_PER_BLOCK, bytemuck::Zeroable::zeroed());
            let before = aged.to_counters();
            for (i, _) in aged.known_bricks() {
                self.counted((&then[i], before.get(i)), (&mut now[i], &mut counters[i]));
            }
        } else {
            then.iter().zip(&mut now).for_each(|(then, now)| self.brick(then, now));
        }
        let (stamp, epoch, faded) = (newer.stamp, newer.epoch, newer.faded);
        StoredBlock { stamp, epoch, faded, ..StoredBlock::of(newer.key, &now, &counters) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SchemeConfig;

    fn voxel(occupancy: i8, confidence: u8) -> Brick {
        let mut brick = Brick::UNKNOWN;
        (brick.occupancy[9], brick.confidence[9]) = (occupancy, confidence);
        brick
    }

    fn check(then: (i8, u8), now: (i8, u8), expected: (i8, u8)) {
        let mut brick = voxel(now.0, now.1);
        Continuation::new(&Config::default()).brick(&voxel(then.0, then.1), &mut brick);
        assert_eq!((brick.occupancy[9], brick.confidence[9]), expected, "{then:?} {now:?}");
    }

    #[test]
    fn evidence_adds_up_within_the_limits_and_a_new_thing_shows_at_once() {
        check((8, 40), (0, 0), (8, 40));
        check((0, 0), (-4, 8), (-4, 8));
        check((8, 40), (-4, 8), (4, 48));
        check((8, 40), (8, 16), (8, 56));
        check((-8, 250), (-8, 40), (-8, 255));
        check((-8, 250), (8, 8), (8, 255));
        check((4, 8), (-8, 16), (-4, 24));
        check((127, 9), (0, 0), (8, 9));
    }

    fn stored(epoch: u64, faded: u32, stamp_s: f64) -> StoredBlock {
        let block = StoredBlock::of([0; 3], &[voxel(8, 200), voxel(-8, 200)], &[]);
        StoredBlock { epoch, faded, stamp: Timestamp::from_seconds(stamp_s), ..block }
    }

    #[test]
    fn what_lay_fades_as_the_map_did_or_by_time_alone_after_a_restart() {
        let config = Config::default();
        let continuation = Continuation::new(&config);
        let now = Moment { epoch: 7, faded: 50, stamp: Timestamp::from_seconds(1000.0) };
        assert_eq!(continuation.units_due(&stored(7, 20, 0.0), &now), 30);
        // 0.25 units a second for 800 s.
        assert_eq!(continuation.units_due(&stored(6, 20, 200.0), &now), 200);
        assert_eq!(continuation.units_due(&stored(6, 20, 2000.0), &now), 0, "from the future");
        let aged = continuation.aged(&stored(6, 20, 200.0), &now);
        let voxels: Vec<_> = aged.bricks.iter().map(|b| (b.occupancy[9], b.confidence[9])).collect();
        assert_eq!(voxels, [(8, 1), (0, 0)], "age forgets free space, and never deletes what is occupied");
        let mut keeping = config;
        keeping.blocks.fade_stored = false;
        assert_eq!(Continuation::new(&keeping).units_due(&stored(6, 0, 0.0), &now), 0);
    }

    #[test]
    fn hits_and_misses_add_up_and_are_estimated_where_nobody_kept_them() {
        let scheme = SchemeConfig { scheme: Scheme::HitRatio, hit_ratio_min: 0.25, ..SchemeConfig::default() };
        let continuation = Continuation::new(&Config { scheme, ..Config::default() });
        let mut counters: Counters = bytemuck::Zeroable::zeroed();
        (counters.hits[9], counters.misses[9]) = (3, 1);
        let (mut brick, mut now) = (Brick::UNKNOWN, counters);
        continuation.counted((&Brick::UNKNOWN, Some(&counters)), (&mut brick, &mut now));
        assert_eq!((now.hits[9], now.misses[9], brick.confidence[9]), (6, 2, 8));
        assert!(brick.occupancy[9] > 0);
        let (mut again, mut estimated): (Brick, Counters) = (Brick::UNKNOWN, bytemuck::Zeroable::zeroed());
        continuation.counted((&brick, None), (&mut again, &mut estimated));
        assert_eq!((estimated.hits[9], estimated.misses[9]), (6, 2));
    }
}
