//! A segment cut into slabs along its second longest axis.

use super::{DOUBT, FRACTION_BITS, LANES, LENGTH_MIN, LONG_BITS, LONG_ONE, ONE, RUN_MAX, Segment};
use crate::marks::TILE_BITS;

/// Shortest way along the third axis that counts: with less, where it crosses a face is always in doubt.
pub const THIRD_MIN: f64 = LENGTH_MIN / (1u64 << 20) as f64;

/// A segment cut into slabs.
pub struct Slabs {
    /// Slabs in all.
    pub count: i32,
    /// Index of the first slab, turned as the axis is.
    pub first: i32,
    /// All bits where the second axis is turned round, and the third: an index is turned back by XOR.
    pub turns: [i32; 2],
    pub main: Line,
    pub third: Line,
    /// Voxels along the main axis for one along the third.
    pub per_third: f32,
    /// [`DOUBT`] about where the segment crosses a face of the third axis, on the main axis.
    pub doubt: u32,
}

/// An axis of a segment in long fixed point.
pub struct Line {
    pub start: i64,
    pub end: i64,
    /// Position at the face before the first slab, by extension of the segment.
    pub origin: i64,
    /// What a slab adds.
    pub slope: i64,
}

/// Sixteen slabs, or the rest of them. Lanes beyond the last slab cross nothing.
pub struct Group {
    /// The tiles from whose first voxels positions count, on the main axis and on the third.
    pub tiles: [i32; 2],
    pub main: Faces,
    pub third: Faces,
}

/// Positions on an axis in fixed point from the first voxel of a tile.
#[derive(Clone, Copy)]
pub struct Faces {
    pub base: u32,
    pub slope: u32,
    /// Where the segment begins and ends, if that is in this group.
    pub start: u32,
    pub end: u32,
}

/// What a segment crosses in one slab, from the group's tiles on.
#[derive(Clone, Copy)]
pub struct Slab {
    /// Where it enters, crosses a face of the third axis, and leaves, on the main axis. The middle one says nothing
    /// where it crosses none.
    pub enter: u32,
    pub between: u32,
    pub leave: u32,
    /// Index on the third axis where it enters, and where it leaves: the same, or one more.
    pub third: [u32; 2],
    /// All bits where its path is in doubt.
    pub doubt: u32,
}

impl Slabs {
    /// Cuts a segment that is not flat.
    #[inline(always)]
    pub fn of(segment: &Segment) -> Self {
        let Segment { start, end, lengths: [main, second, third], .. } = *segment;
        let turns = [end[1] < start[1], end[2] < start[2]].map(|falls| -i64::from(falls));
        let first = (start[1] as i32) ^ turns[0] as i32;
        let last = (end[1] as i32) ^ turns[0] as i32;
        // The way from the first slab's face to the start.
        let before = if turns[0] == 0 { start[1] - f64::from(first) } else { f64::from(-first) - start[1] };
        let slope = |length: f64| length / second;
        let per_third = (main / third.max(THIRD_MIN)) as f32;
        Self {
            count: last - first + 1,
            first,
            turns: turns.map(|turn| turn as i32),
            main: Line::new(start[0], end[0], slope(main), before, 0),
            third: Line::new(start[2], end[2], slope(third), before, turns[1]),
            per_third,
            doubt: doubt(per_third),
        }
    }

    /// What a slab adds in a lane: on the main axis, and on the third.
    #[inline(always)]
    pub fn slopes(&self) -> [u32; 2] {
        [self.main.short_slope(), self.third.short_slope()]
    }

    /// What each lane of a group adds to its begin, on the same axes.
    #[inline(always)]
    pub fn rises(&self) -> [[u32; LANES]; 2] {
        self.slopes().map(|slope| std::array::from_fn(|lane| slope.wrapping_mul(lane as u32)))
    }

    /// The way along the main axis from a position on the third to the next face there; a long one is cut.
    #[inline(always)]
    #[allow(unsafe_code, reason = "the safe cast is not compiled to vectors: the portable walk takes a third longer")]
    fn way_to_face(&self, third: u32) -> u32 {
        let rest = (ONE - (third & (ONE - 1))) as i32 as f32;
        // The minimum of a number and none is the number.
        let way = (rest * self.per_third).max(0.0).min((RUN_MAX as u32 * ONE) as f32);
        // SAFETY: it lies between 0 and 2^28.
        unsafe { way.to_int_unchecked::<i32>() as u32 }
    }

    /// The group that begins `done` slabs after the first.
    #[inline(always)]
    pub fn group(&self, done: i32) -> Group {
        let ends = self.count - done <= LANES as i32;
        let [(main_tile, main), (third_tile, third)] = [&self.main, &self.third].map(|line| line.faces(done, ends));
        Group { tiles: [main_tile, third_tile], main, third }
    }
}

impl Line {
    #[inline(always)]
    fn new(start: f64, end: f64, slope: f64, before: f64, turn: i64) -> Self {
        // Casts cut; start and end are not below zero, so their voxels are right to the last bit, and a turn keeps
        // them.
        let fixed = |value: f64| (value * LONG_ONE) as i64;
        let rise = if turn == 0 { slope } else { -slope };
        let [start_fixed, end, origin] = [start, end, start - rise * before].map(|value| fixed(value) ^ turn);
        Self { start: start_fixed, end, origin, slope: fixed(slope) }
    }

    #[inline(always)]
    fn short_slope(&self) -> u32 {
        short_of(self.slope)
    }

    /// The tile and the faces of the group that begins `done` slabs after the first.
    #[inline(always)]
    fn faces(&self, done: i32, ends: bool) -> (i32, Faces) {
        let begin = self.origin.wrapping_add(self.slope.wrapping_mul(done.into()));
        let tile = begin >> (LONG_BITS + TILE_BITS);
        let from_tile = |long: i64| short_of(long.wrapping_sub(tile << (LONG_BITS + TILE_BITS)));
        let faces = Faces {
            base: from_tile(begin),
            slope: self.short_slope(),
            start: if done == 0 { from_tile(self.start) } else { 0 },
            end: if ends { from_tile(self.end) } else { u32::MAX },
        };
        (tile as i32, faces)
    }
}

/// [`DOUBT`] about a face of the third axis, on the main one: that many times, and once for what rounds there.
#[inline(always)]
pub fn doubt(per_third: f32) -> u32 {
    (DOUBT as f32 * (1.0 + per_third)).min((ONE / 2) as f32) as i32 as u32
}

/// Long fixed point to that of a lane.
#[inline(always)]
fn short_of(long: i64) -> u32 {
    (long >> (LONG_BITS - FRACTION_BITS)) as u32
}

impl Group {
    /// One slab, with the lane's rises, where `left` slabs are left from the lane on, itself included.
    #[inline(always)]
    pub fn slab(&self, slabs: &Slabs, rises: [u32; 2], left: i32) -> Slab {
        // The last slab ends where the segment does, which may be at its face, and that is no doubt.
        let ends = mask(left <= 1);
        let (enter, leave, far_main) = self.main.at(rises[0], ends);
        let (third, next_third, far_third) = self.third.at(rises[1], ends);
        let way = slabs.way_to_face(third);
        let between = enter.wrapping_add(way).min(leave);
        let indices = [third, next_third].map(|at| at >> FRACTION_BITS);
        let edge = (is_near(far_main, DOUBT) | is_near(far_third, DOUBT)) & !ends;
        let slab = Slab { enter, between, leave, third: indices, doubt: edge };
        Slab { doubt: edge | is_near(between, slabs.doubt) & slab.crosses(left), ..slab }
    }
}

impl Slab {
    /// All bits where it crosses a face of the third axis, where `left` slabs are left.
    #[inline(always)]
    pub fn crosses(&self, left: i32) -> u32 {
        mask(self.third[0] != self.third[1]) & mask(left > 0)
    }
}

impl Faces {
    /// Where the segment enters and leaves a slab, and where the line leaves it: the segment begins and ends within its
    /// first and last slab, not at their faces. Rounding is always down, so that what is clamped was beyond.
    #[inline(always)]
    fn at(&self, rise: u32, ends: u32) -> (u32, u32, u32) {
        let near = self.base.wrapping_add(rise);
        let far = near.wrapping_add(self.slope);
        (near.max(self.start).min(self.end), far & !ends | self.end & ends, far)
    }
}

/// All bits where `is`.
#[inline(always)]
pub fn mask(is: bool) -> u32 {
    u32::from(is).wrapping_neg()
}

/// All bits where a position is nearer to a face than `doubt`.
#[inline(always)]
fn is_near(at: u32, doubt: u32) -> u32 {
    mask(at.wrapping_add(doubt) & (ONE - 1) < 2 * doubt)
}
