//! Evidence of one window, and what it does to the voxels of a brick, once a window.
//!
//! While a window is open, each voxel has marks: the largest weight of the beams that passed, and of those that ended
//! there (see `marks`). A miss is a bit for each weight; a hit is a byte in which a weight of n quarters is n ones.
//! So "the larger of the two" is an OR: the order of beams does not matter, and the innermost loop has no branch. A
//! hit protects its voxel. A hit counts at once, so that new things show in the next snapshot; misses count when the
//! window ends, because a later beam may still hit. The result is the same as if both counted at the end. Why
//! windows: with every beam counting, most of the ground ends up free (see `EVIDENCE.md`).

use crate::beams::Weight;
use crate::config::{Scheme, SchemeConfig};
use tsense_contract::{BRICK_VOXELS, Brick};

/// No beam came here.
pub const NOTHING: u8 = 0;

/// Weights that a beam may have: quarters, the first is 1.
pub const LEVELS: usize = Weight::FULL.quarters() as usize;

/// The level of a weight.
pub const fn level_of(weight: Weight) -> usize {
    weight.quarters() as usize - 1
}

/// The mark of a beam that ended.
pub const fn hit_mark(weight: Weight) -> u8 {
    told_hit_mark(weight) | BEAM
}

/// The mark of a hit that no beam made: another sensor told of it.
pub const fn told_hit_mark(weight: Weight) -> u8 {
    ((1 << weight.quarters()) - 1) << 4
}

/// In the mark of a hit: a beam ended there.
const BEAM: u8 = 2;

/// Whether misses of so many quarters overrule the hits of a voxel: only another sensor told of these, and beams of
/// more weight passed. A beam's own hit protects from all misses, for what grazes the ground misses it more often
/// than it hits.
pub fn overrules(miss_quarters: u8, hits: u8) -> bool {
    hits & BEAM == 0 && miss_quarters > hit_quarters(hits)
}

/// Quarters of the largest hit of a mark.
pub fn hit_quarters(mark: u8) -> u8 {
    (mark >> 4).count_ones() as u8
}

/// Marks of hits of a brick's voxels.
#[repr(C, align(64))]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Marks(pub [u8; BRICK_VOXELS]);

/// Voxels of a brick that beams passed and that no hit protects: a bit each, for each weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed(pub [u64; LEVELS]);

impl Passed {
    /// With any weight.
    #[inline(always)]
    pub fn any(&self) -> u64 {
        self.0.iter().fold(0, |any, voxels| any | voxels)
    }

    /// Quarters of the largest weight that passed a voxel.
    fn quarters(&self, voxel: usize) -> u8 {
        let passed = |level: &usize| self.0[*level] >> voxel & 1 == 1;
        (0..LEVELS).rev().find(passed).map_or(0, |level| level as u8 + 1)
    }

    /// The voxels, where all passed with full weight.
    #[inline(always)]
    fn full(&self) -> Option<u64> {
        let [lesser @ .., full] = self.0;
        (lesser == [0; LEVELS - 1]).then_some(full)
    }
}

/// A byte for each bit of a word: none where the bit is none. No closures: they would not be compiled for the
/// instruction set.
#[inline(always)]
fn bytes_of(word: u64) -> [u8; BRICK_VOXELS] {
    // Eight copies of each byte, of which each keeps another bit.
    let mut bytes = [0; 8];
    for (byte, of_byte) in bytes.iter_mut().enumerate() {
        let copies = (word >> (8 * byte) & 0xff) * 0x0101_0101_0101_0101;
        *of_byte = (copies & 0x8040_2010_0804_0201).to_le();
    }
    bytemuck::cast(bytes)
}

/// A brick on cache lines of its own: occupancies on one, confidences on the next.
#[repr(C, align(64))]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct AlignedBrick(pub Brick);

/// Schemes 1 and 3: steps up and down between clamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    hit: i16,
    miss: i16,
    occupancy_max: i16,
    occupancy_min: i16,
    confidence: i16,
}

impl Steps {
    /// The steps of a scheme. Scheme 1 counts by one between the limits of a byte, and what was seen once stays
    /// known.
    pub fn new(config: &SchemeConfig) -> Self {
        match config.scheme {
            Scheme::Confidence => Self {
                hit: config.hit_step.into(),
                miss: config.miss_step.into(),
                occupancy_max: config.occupancy_max.into(),
                occupancy_min: config.occupancy_min.into(),
                confidence: config.confidence_step.into(),
            },
            _ => Self { hit: 1, miss: 1, occupancy_max: 127, occupancy_min: -127, confidence: 1 },
        }
    }

    /// A voxel was hit with weight `to`, after weight `from` (0: not yet) in the same window; quarters.
    pub fn hit(&self, brick: &mut Brick, voxel: usize, from: u8, to: u8) {
        let rise = weighed(self.hit, to) - weighed(self.hit, from);
        let sure = weighed(self.confidence, to) - weighed(self.confidence, from);
        let occupancy = i16::from(brick.occupancy[voxel]) + rise;
        brick.occupancy[voxel] = occupancy.min(self.occupancy_max) as i8;
        brick.confidence[voxel] = (i16::from(brick.confidence[voxel]) + sure).min(255) as u8;
    }

    /// The window ended: voxels that beams only passed lose. True where something changed.
    #[inline(always)]
    pub fn misses(&self, brick: &mut Brick, passed: &Passed) -> bool {
        match passed.full() {
            Some(voxels) => self.full_misses(brick, voxels),
            None => self.weighed_misses(brick, passed),
        }
    }

    /// The same for full weight alone, as a ladar leaves it: bytes, without multiplications.
    #[inline(always)]
    fn full_misses(&self, brick: &mut Brick, voxels: u64) -> bool {
        let [miss, sure] = [self.miss, self.confidence].map(|step| weighed(step, Weight::FULL.quarters()) as u8);
        let (lowest, passed) = (self.occupancy_min as i8, bytes_of(voxels));
        // Bits that changed in any voxel: comparing bricks afterwards would cost a copy and a call each.
        let mut changed = 0;
        for voxel in 0..BRICK_VOXELS {
            let passed = if passed[voxel] == 0 { 0 } else { u8::MAX };
            let occupancy = brick.occupancy[voxel].saturating_sub((miss & passed) as i8).max(lowest);
            let confidence = brick.confidence[voxel].saturating_add(sure & passed);
            changed |= (occupancy ^ brick.occupancy[voxel]) as u8 | (confidence ^ brick.confidence[voxel]);
            (brick.occupancy[voxel], brick.confidence[voxel]) = (occupancy, confidence);
        }
        changed != 0
    }

    fn weighed_misses(&self, brick: &mut Brick, passed: &Passed) -> bool {
        let before = *brick;
        for voxel in 0..BRICK_VOXELS {
            let weight = passed.quarters(voxel);
            let occupancy = i16::from(brick.occupancy[voxel]) - weighed(self.miss, weight);
            brick.occupancy[voxel] = occupancy.max(self.occupancy_min) as i8;
            let confidence = i16::from(brick.confidence[voxel]) + weighed(self.confidence, weight);
            brick.confidence[voxel] = confidence.min(255) as u8;
        }
        *brick != before
    }
}

/// A step for a weight in quarters: rounded, and at least 1 for any weight at all.
fn weighed(step: i16, quarters: u8) -> i16 {
    let scaled = (step * i16::from(quarters) + 2) >> 2;
    scaled.max(i16::from(quarters > 0))
}

/// Lowers the confidence of a brick by `units`; the state's floor holds. True where something changed.
pub fn fade(brick: &mut Brick, units: u8, floor_occupied: u8, floor_free: u8) -> bool {
    // Of what is unknown nothing is written: pages that no beam has reached stay no memory.
    if brick.confidence == [0; BRICK_VOXELS] {
        return false;
    }
    let mut changed = 0;
    for voxel in 0..BRICK_VOXELS {
        let floor = if brick.occupancy[voxel] > 0 { floor_occupied } else { floor_free };
        let confidence = brick.confidence[voxel];
        brick.confidence[voxel] = confidence.saturating_sub(units).max(floor.min(confidence));
        changed |= brick.confidence[voxel] ^ confidence;
        // What is forgotten starts anew: old evidence without confidence would come back with the next beam.
        let known = brick.confidence[voxel] > 0;
        brick.occupancy[voxel] = if known { brick.occupancy[voxel] } else { 0 };
    }
    changed != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps() -> Steps {
        Steps::new(&SchemeConfig::default())
    }

    /// One voxel that beams of a weight passed.
    fn passed(voxel: usize, weight: Weight) -> Passed {
        let mut words = [0; LEVELS];
        words[level_of(weight)] = 1 << voxel;
        Passed(words)
    }

    #[test]
    fn a_hit_shows_at_once_and_two_windows_of_misses_free_what_was_sure() {
        let mut brick = Brick::UNKNOWN;
        for _ in 0..5 {
            steps().hit(&mut brick, 7, 0, 4);
        }
        assert_eq!((brick.occupancy[7], brick.confidence[7]), (8, 40));
        for expected in [4, 0] {
            steps().misses(&mut brick, &passed(7, Weight::FULL));
            assert_eq!(brick.occupancy[7], expected);
        }
        for _ in 0..9 {
            steps().misses(&mut brick, &passed(7, Weight::FULL));
        }
        assert_eq!(brick.occupancy[7], -8);
        steps().hit(&mut brick, 7, 0, 4);
        assert_eq!(brick.occupancy[7], 4, "one hit shows a new thing in free space");
    }

    #[test]
    fn marks_keep_the_largest_weight_of_each_kind_in_any_order() {
        for a in 1..=4u8 {
            for b in 1..=4u8 {
                let [a_weight, b_weight] = [a, b].map(|w| Weight::new(f64::from(w) / 4.0));
                let words = [a_weight, b_weight].map(|weight| passed(5, weight).0);
                let both = Passed(std::array::from_fn(|level| words[0][level] | words[1][level]));
                assert_eq!((both.quarters(5), both.quarters(4)), (a.max(b), 0));
                assert_eq!(hit_quarters(hit_mark(a_weight) | hit_mark(b_weight)), a.max(b));
            }
        }
    }

    #[test]
    fn misses_overrule_what_was_told_with_less_weight_and_never_a_beams_hit() {
        for (miss, hit) in (1..=4).flat_map(|miss| (1..=4).map(move |hit| (miss, hit))) {
            let weight = Weight::new(f64::from(hit) / 4.0);
            assert_eq!(overrules(miss, told_hit_mark(weight)), miss > hit);
            assert!(!overrules(miss, hit_mark(weight)));
        }
    }

    #[test]
    fn what_no_beam_passed_does_not_change() {
        let mut brick = Brick::UNKNOWN;
        assert!(steps().misses(&mut brick, &passed(2, Weight::FULL)));
        assert_eq!((&brick.occupancy[..4], &brick.confidence[..4]), (&[0, 0, -4, 0][..], &[0, 0, 8, 0][..]));
        let before = brick;
        assert!(!steps().misses(&mut brick, &Passed([0; LEVELS])) && brick == before);
    }

    #[test]
    fn full_weight_does_the_same_in_bytes_as_weighed() {
        for config in [Scheme::Confidence, Scheme::IncrementDecrement]
            .map(|scheme| SchemeConfig { scheme, ..SchemeConfig::default() })
        {
            let steps = Steps::new(&config);
            for occupancy in i8::MIN..=i8::MAX {
                let mut brick = Brick::UNKNOWN;
                brick.occupancy.fill(occupancy);
                brick.confidence = std::array::from_fn(|voxel| (4 * voxel) as u8 + 3);
                let (mut bytes, mut weighed) = (brick, brick);
                let voxels = 0x9e37_79b9_7f4a_7c15_u64.rotate_left(occupancy as u8 as u32);
                steps.full_misses(&mut bytes, voxels);
                steps.weighed_misses(&mut weighed, &Passed([0, 0, 0, voxels]));
                assert!(bytes == weighed, "{config:?} {occupancy}");
            }
        }
    }

    #[test]
    fn half_the_weight_takes_half_the_step_and_a_second_ladar_adds_the_rest() {
        let mut brick = Brick::UNKNOWN;
        steps().hit(&mut brick, 0, 0, 2);
        assert_eq!((brick.occupancy[0], brick.confidence[0]), (6, 4));
        steps().hit(&mut brick, 0, 2, 4);
        assert_eq!((brick.occupancy[0], brick.confidence[0]), (8, 8));
        steps().misses(&mut brick, &passed(1, Weight::new(0.25)));
        assert_eq!((brick.occupancy[1], brick.confidence[1]), (-1, 2));
    }

    #[test]
    fn age_lowers_confidence_and_deletes_nothing_above_its_floor() {
        let mut brick = Brick::UNKNOWN;
        (brick.occupancy[0], brick.confidence[0]) = (12, 10);
        (brick.occupancy[1], brick.confidence[1]) = (-8, 10);
        assert!(fade(&mut brick, 4, 1, 0));
        assert_eq!((brick.confidence[0], brick.confidence[1]), (6, 6));
        assert_eq!((brick.occupancy[0], brick.occupancy[1]), (12, -8));
        assert!(fade(&mut brick, 200, 1, 0));
        assert_eq!((brick.occupancy[0], brick.confidence[0]), (12, 1), "standing things stay");
        assert_eq!((brick.occupancy[1], brick.confidence[1]), (0, 0), "free space is forgotten");
        assert!(!fade(&mut brick, 200, 1, 0));
        assert_eq!(brick.confidence[2], 0, "the unknown stays unknown");
    }
}
