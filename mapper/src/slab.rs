//! The fast ray walk: slab by slab along the axis on which the segment is longest.
//!
//! A slab is one voxel thick. Where the segment enters and leaves it on the other two axes is a multiplication and an
//! addition in fixed point, so no slab waits for the one before, and sixteen of them go through the same instructions
//! at once. In each slab a segment crosses one to three voxels. In: two points in voxel units, not below zero. Out: for
//! each slab the voxels where it enters and leaves, and which of two faces it crosses first. The path is that of
//! `geometry::ray_walk`: where fixed point cannot tell which face comes first, the walk says so and the caller takes
//! the plain one (about one random segment in 1000). No branch depends on a lane, so that a loop over the lanes
//! becomes vectors.

use tsense_contract::BRICK_EDGE;

/// Slabs that share an anchor.
pub const LANES: usize = 16;

/// Bits behind the point in a lane: a run of slabs and a sign fit before it in an `i32`.
const FRACTION_BITS: u32 = 24;
const ONE: i32 = 1 << FRACTION_BITS;
const PER_ONE: f32 = 1.0 / ONE as f32;

/// Bits behind the point of a run's begin, in an `i64`: the slope's rounding, a thousand slabs on, is below a lane's.
const LONG_BITS: u32 = 40;
const LONG_ONE: f64 = (1u64 << LONG_BITS) as f64;

/// Closer to a face than this is too close to call: slope and start are rounded to 2^-25, sixteen times over.
const DOUBT: i32 = 1 << 5;
/// The same in voxels.
const DOUBT_VOXELS: f32 = 2.0 / (1 << 20) as f32;

/// Shortest way along the longest axis that is walked here, voxels.
const LENGTH_MIN: f64 = 1e-2;

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

/// A lesser axis of a segment, in long fixed point.
#[derive(Clone, Copy)]
struct Lesser {
    start: i64,
    end: i64,
    /// Position at the face before the first slab, by extension of the segment.
    origin: i64,
    slope: i64,
}

/// Which of two crossings comes first, from the fractions of both axes and without a division:
/// `ta / slope_a < tb / slope_b` where `constant + b * fraction_b - a * fraction_a` is above zero.
#[derive(Clone, Copy)]
struct Order {
    constant: f32,
    a: f32,
    b: f32,
    tie: f32,
}

/// What turns fractions into ways.
#[derive(Clone, Copy)]
struct Chords {
    /// Way to the next face of a lesser axis = `offset + per_fraction * fraction`, in ways along the main axis.
    offset: [f32; 2],
    per_fraction: [f32; 2],
    /// Ways along the main axis from the start to the first face, and from the last face to the end.
    lengths: [f32; 2],
    /// Length of the segment for each voxel along the main axis.
    way: f32,
}

/// Sixteen slabs, or the rest of them.
pub struct Run<'a> {
    /// What is to be added to the indices of a slab on the lesser axes; multiples of the edge of a brick.
    pub anchors: [i32; 2],
    /// Lane of the segment's last slab; beyond the last lane where another run follows.
    pub end_lane: i32,
    start_lane: i32,
    faces: [Faces; 2],
    slabs: &'a Slabs,
}

/// Positions on a lesser axis in fixed point, from the anchor.
#[derive(Clone, Copy)]
struct Faces {
    base: i32,
    slope: i32,
    start: i32,
    end: i32,
}

/// What a segment crosses in one slab; indices on the two lesser axes, from the run's anchors. With two crossings the
/// middle voxel is `(leave[0], enter[1])` where `a_leads`, else `(enter[0], leave[1])`. What is true is all bits, as in
/// a vector.
#[derive(Clone, Copy)]
pub struct Slab {
    /// Where it enters.
    pub enter: [i32; 2],
    /// Where it leaves.
    pub leave: [i32; 2],
    /// It crosses a face of the first lesser axis, of the second.
    pub crosses: [i32; 2],
    /// It crosses the first axis' face first.
    pub a_leads: i32,
    /// Fixed point cannot tell the path.
    pub doubt: i32,
    /// Ways in the first, the middle and the last voxel, voxel units.
    pub chords: [f32; 3],
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
        Some(Self {
            axes,
            count,
            main: (from, if up { 1 } else { -1 }),
            lesser: [
                Lesser::new(start[a], end[a], slopes[0], before_start),
                Lesser::new(start[b], end[b], slopes[1], before_start),
            ],
            order: Order::new(slopes.map(|slope| slope as f32)),
            chords: Chords::new(slopes.map(|slope| slope as f32), lengths.map(|length| length as f32)),
        })
    }

    /// Index of a slab on the main axis.
    #[inline(always)]
    pub fn main_at(&self, slab: i32) -> i32 {
        self.main.0 + self.main.1 * slab
    }

    /// The run that begins `done` slabs after the first.
    #[inline(always)]
    pub fn run(&self, done: i32) -> Run<'_> {
        let [(anchor_a, a), (anchor_b, b)] = [self.lesser[0].faces(done), self.lesser[1].faces(done)];
        Run {
            anchors: [anchor_a, anchor_b],
            end_lane: self.count - 1 - done,
            start_lane: if done == 0 { 0 } else { -1 },
            faces: [a, b],
            slabs: self,
        }
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
        // Casts cut; start and end are not below zero, so their voxels are right to the last bit.
        let [start_fixed, end, origin, slope] =
            [start, end, start - slope * before_start, slope].map(|value| (value * LONG_ONE) as i64);
        Self { start: start_fixed, end, origin, slope }
    }

    /// The anchor and the faces of the run that begins `done` slabs after the first.
    #[inline(always)]
    fn faces(&self, done: i32) -> (i32, Faces) {
        let begin = self.origin.wrapping_add(self.slope.wrapping_mul(done.into()));
        let anchor = (begin >> LONG_BITS) & !(BRICK_EDGE as i64 - 1);
        let short = |long: i64| (long >> (LONG_BITS - FRACTION_BITS)).wrapping_sub(anchor << FRACTION_BITS) as i32;
        let slope = (self.slope >> (LONG_BITS - FRACTION_BITS)) as i32;
        (anchor as i32, Faces { base: short(begin), slope, start: short(self.start), end: short(self.end) })
    }
}

/// Way to the next face of an axis, in voxels, as `offset + sign * fraction`.
#[inline(always)]
fn to_face(slope: f32) -> (f32, f32) {
    if slope >= 0.0 { (1.0, -PER_ONE) } else { (0.0, PER_ONE) }
}

impl Order {
    #[inline(always)]
    fn new([slope_a, slope_b]: [f32; 2]) -> Self {
        let ((offset_a, sign_a), (offset_b, sign_b)) = (to_face(slope_a), to_face(slope_b));
        let (a, b) = (slope_a.abs(), slope_b.abs());
        Self { constant: offset_b * a - offset_a * b, a: sign_a * b, b: sign_b * a, tie: DOUBT_VOXELS * (a + b) }
    }
}

impl Chords {
    #[inline(always)]
    fn new(slopes: [f32; 2], lengths: [f32; 2]) -> Self {
        let [a, b] = slopes;
        let [(offset_a, per_a), (offset_b, per_b)] = slopes.map(|slope| {
            let ((offset, sign), per_voxel) = (to_face(slope), 1.0 / slope.abs().max(1e-12));
            (offset * per_voxel, sign * per_voxel)
        });
        let way = (1.0 + a * a + b * b).sqrt();
        Self { offset: [offset_a, offset_b], per_fraction: [per_a, per_b], lengths, way }
    }

    /// Ways in the first, the middle and the last voxel of a slab.
    #[inline(always)]
    fn of(&self, run: &Run<'_>, lane: i32, crosses: [i32; 2], fractions: [f32; 2]) -> [f32; 3] {
        let length = if lane == run.end_lane { self.lengths[1] } else { 1.0 };
        let length = if lane == run.start_lane { self.lengths[0] } else { length };
        let at = |axis: usize| (self.offset[axis] + self.per_fraction[axis] * fractions[axis]).min(length);
        let (at_a, at_b) = (at(0), at(1));
        let either = |axis: usize, at: f32, otherwise: f32| if crosses[axis] != 0 { at } else { otherwise };
        let enter = either(0, at_a, length).min(either(1, at_b, length));
        let leave = either(0, at_a, 0.0).max(either(1, at_b, 0.0));
        [enter * self.way, (leave - enter).max(0.0) * self.way, (length - leave) * self.way]
    }
}

impl Run<'_> {
    /// One slab; lanes beyond `end_lane` mean nothing.
    #[inline(always)]
    pub fn slab<const CHORDS: bool>(&self, lane: i32) -> Slab {
        let ([a, b], order) = (&self.faces, &self.slabs.order);
        let (at_a, at_b) = (a.at(lane), b.at(lane));
        // The segment begins and ends within its first and last slab, not at their faces.
        let (first, last) = (mask(lane == self.start_lane), mask(lane == self.end_lane));
        let enter = [select(first, a.start, at_a), select(first, b.start, at_b)];
        let leave = [select(last, a.end, at_a.wrapping_add(a.slope)), select(last, b.end, at_b.wrapping_add(b.slope))];
        let (enter_index, leave_index) = (enter.map(index), leave.map(index));
        let crosses = [mask(enter_index[0] != leave_index[0]), mask(enter_index[1] != leave_index[1])];
        let fractions = enter.map(|at| (at & (ONE - 1)) as f32);
        let lead = order.constant + fractions[1] * order.b - fractions[0] * order.a;
        let tie = crosses[0] & crosses[1] & mask(lead.abs() < order.tie) & mask(lane <= self.end_lane);
        let edge = (near_face(leave[0]) | near_face(leave[1])) & mask(lane < self.end_lane);
        let a_leads = crosses[0] & (!crosses[1] | mask(lead > 0.0));
        let chords = if CHORDS { self.slabs.chords.of(self, lane, crosses, fractions) } else { [0.0; 3] };
        Slab { enter: enter_index, leave: leave_index, crosses, a_leads, doubt: tie | edge, chords }
    }
}

impl Faces {
    #[inline(always)]
    fn at(&self, lane: i32) -> i32 {
        self.base.wrapping_add(self.slope.wrapping_mul(lane))
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

/// Whether the segment passes a slab's face too near to an edge of two voxels.
#[inline(always)]
fn near_face(at: i32) -> i32 {
    mask((at.wrapping_add(DOUBT) & (ONE - 1)) < 2 * DOUBT)
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
            if lanes.iter().any(|slab| slab.doubt != 0) {
                return false;
            }
            for (lane, slab) in lanes.iter().enumerate() {
                let mut push = |a: i32, b: i32, chord: f32| {
                    let mut voxel = [0; 3];
                    voxel[slabs.axes[0]] = slabs.main_at(done + lane as i32);
                    (voxel[slabs.axes[1]], voxel[slabs.axes[2]]) = (run.anchors[0] + a, run.anchors[1] + b);
                    path.push((voxel, chord));
                };
                let (enter, leave) = (slab.enter, slab.leave);
                push(enter[0], enter[1], slab.chords[0]);
                if slab.crosses[0] & slab.crosses[1] != 0 {
                    let middle = if slab.a_leads != 0 { [leave[0], enter[1]] } else { [enter[0], leave[1]] };
                    push(middle[0], middle[1], slab.chords[1]);
                }
                if slab.crosses[0] | slab.crosses[1] != 0 {
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
