//! The fast ray walk: slab by slab along the axis on which the segment is longest.
//!
//! A slab is one voxel thick. Where the segment enters and leaves it on the other two axes is a multiplication and an
//! addition in fixed point, so no slab waits for the one before, and many of them go through the same instructions
//! at once. In each slab a segment crosses one to three voxels. In: two points in voxel units, not below zero. Out: for
//! each slab the voxel where it enters, the faces that it crosses, and which of two it crosses first. The path is that
//! of `geometry::ray_walk`: where fixed point cannot tell which face comes first, the walk says so and the caller takes
//! the plain one (about one random segment in 1000). No branch depends on a lane, so that a loop over the lanes
//! becomes vectors. A lesser axis on which the segment falls is turned round, index `i` to `-1 - i`, so that no slope
//! is below zero.

use crate::marks::IN_TILE;

/// Slabs that share an anchor: more of them need more bits, fewer more anchors.
pub const LANES: usize = 32;

/// Bits behind the point in a lane: a run of slabs and a sign fit before it in an `i32`.
pub const FRACTION_BITS: u32 = 24;
pub const ONE: i32 = 1 << FRACTION_BITS;
pub const PER_ONE: f32 = 1.0 / ONE as f32;

/// Bits behind the point of a run's begin, in an `i64`: the slope's rounding, a thousand slabs on, is below a lane's.
pub const LONG_BITS: u32 = 40;
pub const LONG_ONE: f64 = (1u64 << LONG_BITS) as f64;

/// Closer to a face than this is too close to call: slope and start are rounded down to 2^-24, 32 times over.
pub const DOUBT: i32 = 1 << 6;
/// The same in voxels.
pub const DOUBT_VOXELS: f32 = 4.0 / (1 << 20) as f32;

/// Shortest way along the longest axis that is walked here, voxels.
pub const LENGTH_MIN: f64 = 1e-2;

/// A segment cut into slabs.
pub struct Slabs {
    /// The axis on which the segment is longest, and the two lesser ones in order.
    pub axes: [usize; 3],
    /// Slabs in all.
    pub count: i32,
    /// Index of the first slab on the main axis, and the step to the next.
    main: (i32, i32),
    lesser: [Lesser; 2],
    order: Order,
    chords: Chords,
}

/// A lesser axis of a segment, in long fixed point, turned so that the segment rises.
#[derive(Clone, Copy)]
struct Lesser {
    /// All bits where the axis is turned round.
    turn: i64,
    start: i64,
    end: i64,
    /// Position at the face before the first slab, by extension of the segment.
    origin: i64,
    slope: i64,
    /// What each lane of a run adds to its begin, short.
    rises: [i32; LANES],
}

/// Which of two crossings comes first, from the fractions of both axes and without a division:
/// `(1 - fraction_a) / slope_a < (1 - fraction_b) / slope_b` where
/// `constant + a * fraction_a - b * fraction_b` is above zero.
#[derive(Clone, Copy)]
struct Order {
    constant: f32,
    a: f32,
    b: f32,
    tie: u32,
}

/// What turns fractions into ways.
#[derive(Clone, Copy)]
struct Chords {
    /// Ways along the main axis for a voxel of each lesser axis.
    per_voxel: [f32; 2],
    /// Ways along the main axis from the start to the first face, and from the last face to the end.
    lengths: [f32; 2],
    /// Length of the segment for each voxel along the main axis.
    way: f32,
}

/// So many slabs as share an anchor, or the rest of them. Lanes beyond the last slab stay where the segment ends and cross nothing.
pub struct Run<'a> {
    /// What is to be added to the indices of a slab on the lesser axes; multiples of the edge of a tile.
    pub anchors: [i32; 2],
    /// Lane of the segment's last slab; beyond the last lane where another run follows.
    pub end_lane: i32,
    start_lane: i32,
    faces: [Faces<'a>; 2],
    slabs: &'a Slabs,
}

/// Positions on a lesser axis in fixed point, from the anchor.
#[derive(Clone, Copy)]
struct Faces<'a> {
    base: i32,
    slope: i32,
    rises: &'a [i32; LANES],
    /// Where the segment begins and ends, if that is in this run.
    start: i32,
    end: i32,
}

/// What a segment crosses in one slab; indices on the two lesser axes, turned as these are, from the run's anchors.
/// What is true is all bits, as in a vector.
#[derive(Clone, Copy)]
pub struct Slab {
    /// Where it enters.
    pub enter: [i32; 2],
    /// It crosses no face of the first lesser axis, of the second; where it crosses one, its index rises by 1.
    pub stays: [i32; 2],
    /// With two crossings, it crosses the first axis' face first.
    pub a_leads: i32,
    /// How sure its path is, for [`Slabs::is_sure`].
    pub margin: Margin,
    /// Ways in the first, the middle and the last voxel, voxel units.
    pub chords: [f32; 3],
}

/// How far a segment keeps from what fixed point cannot tell; no unit but order.
#[derive(Clone, Copy)]
pub struct Margin {
    /// From edges between two slabs.
    pub edge: u32,
    /// From crossing two faces at once.
    pub tie: u32,
}

impl Slabs {
    /// Cuts a segment; nothing where it is too short for slabs.
    #[inline(always)]
    pub fn of(start: [f64; 3], end: [f64; 3]) -> Option<Self> {
        let axes = axes_of(start, end);
        let [main, a, b] = axes;
        let main_length = (end[main] - start[main]).abs();
        if main_length < LENGTH_MIN {
            return None;
        }
        let up = end[main] > start[main];
        let (from, to) = (start[main] as i32, end[main] as i32);
        // Ways from the face before the start, and to the end from the face before it.
        let into = |c: f64, index: i32| if up { c - f64::from(index) } else { f64::from(index) + 1.0 - c };
        let (before_start, before_end) = (into(start[main], from), into(end[main], to));
        let per_length = 1.0 / main_length;
        let slopes = [a, b].map(|axis| (end[axis] - start[axis]) * per_length);
        let count = (to - from).abs() + 1;
        let lengths = if count == 1 { [main_length; 2] } else { [1.0 - before_start, before_end] };
        let short_slopes = slopes.map(|slope| slope.abs() as f32);
        Some(Self {
            axes,
            count,
            main: (from, if up { 1 } else { -1 }),
            lesser: [
                Lesser::new(start[a], end[a], slopes[0], before_start),
                Lesser::new(start[b], end[b], slopes[1], before_start),
            ],
            order: Order::new(short_slopes),
            chords: Chords::new(short_slopes, lengths.map(|length| length as f32)),
        })
    }

    /// Voxels that the segment crosses.
    #[inline(always)]
    pub fn voxels(&self) -> u64 {
        let rise = |of: &Lesser| (of.end >> LONG_BITS) - (of.start >> LONG_BITS);
        (i64::from(self.count) + rise(&self.lesser[0]) + rise(&self.lesser[1])) as u64
    }

    /// Index of a slab on the main axis.
    #[inline(always)]
    pub fn main_at(&self, slab: i32) -> i32 {
        self.main.0 + self.main.1 * slab
    }

    /// All bits for each lesser axis that is turned round: an index of it is turned back by XOR.
    #[inline(always)]
    pub fn turns(&self) -> [i32; 2] {
        [self.lesser[0].turn as i32, self.lesser[1].turn as i32]
    }

    /// The run that begins `done` slabs after the first.
    #[inline(always)]
    pub fn run(&self, done: i32) -> Run<'_> {
        let end_lane = self.count - 1 - done;
        let (starts, ends) = (done == 0, end_lane < LANES as i32);
        let [(anchor_a, a), (anchor_b, b)] = [0, 1].map(|axis| self.lesser[axis].faces(done, starts, ends));
        let start_lane = if starts { 0 } else { -1 };
        Run { anchors: [anchor_a, anchor_b], end_lane, start_lane, faces: [a, b], slabs: self }
    }

    /// Whether the path is that of the plain walk in all slabs whose least margins these are.
    #[inline(always)]
    pub fn is_sure(&self, least: Margin) -> bool {
        least.edge >= (2 * DOUBT as u32) << (32 - FRACTION_BITS) && least.tie >= self.order.tie
    }
}

/// The main axis of a segment, and the two others in order.
fn axes_of(start: [f64; 3], end: [f64; 3]) -> [usize; 3] {
    let [x, y, z] = std::array::from_fn(|axis| (end[axis] - start[axis]).abs());
    if x >= y && x >= z {
        [0, 1, 2]
    } else if y >= z {
        [1, 0, 2]
    } else {
        [2, 0, 1]
    }
}

impl Lesser {
    #[inline(always)]
    fn new(start: f64, end: f64, slope: f64, before_start: f64) -> Self {
        let turn = -i64::from(slope < 0.0);
        // Casts cut; start and end are not below zero, so their voxels are right to the last bit, and a turn keeps them.
        let fixed = |value: f64| (value * LONG_ONE) as i64;
        let [start_fixed, end, origin] = [start, end, start - slope * before_start].map(|value| fixed(value) ^ turn);
        let slope = fixed(slope.abs());
        let short = short_of(slope);
        let rises = std::array::from_fn(|lane| short * lane as i32);
        Self { turn, start: start_fixed, end, origin, slope, rises }
    }

    /// The anchor and the faces of the run that begins `done` slabs after the first.
    #[inline(always)]
    fn faces(&self, done: i32, starts: bool, ends: bool) -> (i32, Faces<'_>) {
        let begin = self.origin.wrapping_add(self.slope.wrapping_mul(done.into()));
        let anchor = (begin >> LONG_BITS) & !i64::from(IN_TILE);
        let from_anchor = |long: i64| short_of(long.wrapping_sub(anchor << LONG_BITS));
        let faces = Faces {
            base: from_anchor(begin),
            slope: short_of(self.slope),
            rises: &self.rises,
            start: if starts { from_anchor(self.start) } else { i32::MIN },
            end: if ends { from_anchor(self.end) } else { i32::MAX },
        };
        (anchor as i32, faces)
    }
}

/// Long fixed point to that of a lane.
#[inline(always)]
fn short_of(long: i64) -> i32 {
    (long >> (LONG_BITS - FRACTION_BITS)) as i32
}

impl Order {
    #[inline(always)]
    fn new([a, b]: [f32; 2]) -> Self {
        Self { constant: a - b, a: b * PER_ONE, b: a * PER_ONE, tie: (DOUBT_VOXELS * (a + b)).to_bits() }
    }
}

impl Chords {
    #[inline(always)]
    fn new(slopes: [f32; 2], lengths: [f32; 2]) -> Self {
        let [a, b] = slopes;
        Self { per_voxel: slopes.map(|slope| 1.0 / slope.max(1e-12)), lengths, way: (1.0 + a * a + b * b).sqrt() }
    }

    /// Ways in the first, the middle and the last voxel of a slab.
    #[inline(always)]
    fn of(&self, run: &Run<'_>, lane: i32, stays: [i32; 2], fractions: [f32; 2]) -> [f32; 3] {
        let length = if lane == run.end_lane { self.lengths[1] } else { 1.0 };
        let length = if lane == run.start_lane { self.lengths[0] } else { length };
        let at = |axis: usize| ((1.0 - fractions[axis] * PER_ONE) * self.per_voxel[axis]).min(length);
        let (at_a, at_b) = (at(0), at(1));
        let either = |axis: usize, at: f32, otherwise: f32| if stays[axis] == 0 { at } else { otherwise };
        let enter = either(0, at_a, length).min(either(1, at_b, length));
        let leave = either(0, at_a, 0.0).max(either(1, at_b, 0.0));
        [enter * self.way, (leave - enter).max(0.0) * self.way, (length - leave) * self.way]
    }
}

impl Run<'_> {
    /// One slab.
    #[inline(always)]
    pub fn slab<const CHORDS: bool>(&self, lane: i32) -> Slab {
        let order = &self.slabs.order;
        let [(enter_a, leave_a, far_a), (enter_b, leave_b, far_b)] = self.faces.map(|faces| faces.at(lane));
        let enter = [index(enter_a), index(enter_b)];
        let stays = [mask(enter[0] == index(leave_a)), mask(enter[1] == index(leave_b))];
        let fractions = [enter_a, enter_b].map(|at| (at & (ONE - 1)) as f32);
        let lead = order.constant + fractions[0] * order.a - fractions[1] * order.b;
        let tie = (lead.to_bits() & !(1 << 31)) | (stays[0] | stays[1]) as u32;
        let edge = from_face(far_a).min(from_face(far_b));
        let chords = if CHORDS { self.slabs.chords.of(self, lane, stays, fractions) } else { [0.0; 3] };
        Slab { enter, stays, a_leads: mask(lead > 0.0), margin: Margin { edge, tie }, chords }
    }
}

impl Faces<'_> {
    /// Where the segment enters and leaves a slab, and where the line leaves it: the segment begins and ends within its
    /// first and last slab, not at their faces. Rounding is always down, so that what is clamped was beyond.
    #[inline(always)]
    fn at(&self, lane: i32) -> (i32, i32, i32) {
        let near = self.base.wrapping_add(self.rises[lane as usize]);
        let far = near.wrapping_add(self.slope);
        (near.max(self.start).min(self.end), far.min(self.end), far)
    }
}

/// All bits where `is`.
#[inline(always)]
pub fn mask(is: bool) -> i32 {
    -i32::from(is)
}

/// `yes` where the mask is all bits, `no` where it is none.
#[inline(always)]
pub fn select(mask: i32, yes: i32, no: i32) -> i32 {
    no ^ ((no ^ yes) & mask)
}

/// How far above a face less [`DOUBT`] a line leaves a slab: little where that is too near to an edge of two voxels.
#[inline(always)]
fn from_face(at: i32) -> u32 {
    (at.wrapping_add(DOUBT) as u32) << (32 - FRACTION_BITS)
}

#[inline(always)]
fn index(fixed: i32) -> i32 {
    fixed >> FRACTION_BITS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::segments;
    use crate::walk::walk;
    use tsense_geometry::{VoxelIndex, ray_walk};

    /// The fast walk's path with its chords, and whether it is whole.
    fn fast(start: [f64; 3], end: [f64; 3], path: &mut Vec<(VoxelIndex, f32)>) -> bool {
        path.clear();
        let Some(slabs) = Slabs::of(start, end) else { return false };
        for done in (0..slabs.count).step_by(LANES) {
            let run = slabs.run(done);
            let lanes: Vec<_> = (0..=run.end_lane.min(LANES as i32 - 1)).map(|lane| run.slab::<true>(lane)).collect();
            if lanes.iter().any(|slab| !slabs.is_sure(slab.margin)) {
                return false;
            }
            for (lane, slab) in lanes.iter().enumerate() {
                let mut push = |a: i32, b: i32, chord: f32| {
                    let mut voxel = [0; 3];
                    voxel[slabs.axes[0]] = slabs.main_at(done + lane as i32);
                    let [turn_a, turn_b] = slabs.turns();
                    voxel[slabs.axes[1]] = (run.anchors[0] + a) ^ turn_a;
                    voxel[slabs.axes[2]] = (run.anchors[1] + b) ^ turn_b;
                    path.push((voxel, chord));
                };
                let enter = slab.enter;
                let leave = [0, 1].map(|axis| enter[axis] + 1 + slab.stays[axis]);
                push(enter[0], enter[1], slab.chords[0]);
                if slab.stays[0] | slab.stays[1] == 0 {
                    let middle = if slab.a_leads != 0 { [leave[0], enter[1]] } else { [enter[0], leave[1]] };
                    push(middle[0], middle[1], slab.chords[1]);
                }
                if slab.stays[0] & slab.stays[1] == 0 {
                    push(leave[0], leave[1], slab.chords[2]);
                }
            }
        }
        true
    }

    #[test]
    fn the_path_is_the_plain_walks_on_more_than_a_million_segments() {
        let (mut compared, mut plain, mut random, mut random_plain) = (0u32, 0u32, 0u32, 0u32);
        let mut path = Vec::new();
        for (i, (start, end)) in segments(1_700_000).enumerate() {
            let sure = fast(start, end, &mut path);
            let path = path.iter().map(|(voxel, _)| *voxel);
            if sure {
                assert!(ray_walk(start, end).eq(path), "{start:?} {end:?}");
                compared += 1;
            } else {
                // What was visited before the doubt is right too.
                assert!(path.zip(ray_walk(start, end)).all(|(a, b)| a == b), "{start:?} {end:?}");
                plain += 1;
            }
            random += u32::from(i % 8 < 3);
            random_plain += u32::from(i % 8 < 3 && !sure);
        }
        assert!(compared >= 1_000_000, "{compared} compared, {plain} left to the plain walk");
        assert!(random_plain * 200 < random, "{random_plain} of {random} random segments are too many");
    }

    #[test]
    fn the_chords_are_the_plain_walks() {
        let (mut compared, mut chords) = (0, Vec::new());
        for (start, end) in segments(40_000) {
            if fast(start, end, &mut chords) {
                let mut plain = Vec::new();
                walk(start, end, |voxel, chord| plain.push((voxel, chord)));
                for (fast, slow) in chords.iter().zip(&plain) {
                    assert!((f64::from(fast.1) - slow.1).abs() < 1e-3, "{start:?} {end:?} {fast:?} {slow:?}");
                    compared += 1;
                }
            }
        }
        assert!(compared > 1_000_000, "{compared}");
    }
}
