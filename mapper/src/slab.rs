//! The fast ray walk: slab by slab along the axis on which the segment is longest.
//!
//! A slab is one voxel thick. Where the segment enters and leaves it on the other two axes is a multiplication and an
//! addition in fixed point, so no step waits for the one before, and sixteen slabs go through the same instructions
//! at once. In each slab a segment crosses one to three voxels. In: two points in voxel units, not below zero. Out: for
//! each slab the voxels and the chords. The path is that of `geometry::ray_walk`: where fixed point cannot tell which
//! of two faces comes first, the walk says so and the caller takes the plain one (about one random segment in 1000).
//! Plain loops over arrays of fixed size; the compiler makes vectors of them.

/// Slabs that are computed together.
pub const LANES: usize = 16;

/// Bits behind the point: 17 voxels and a sign fit before it in an `i32`.
const FRACTION_BITS: u32 = 24;
const ONE: i32 = 1 << FRACTION_BITS;

/// Closer to a face than this is too close to call: slope and start are rounded to 2^-25, sixteen times over.
const DOUBT: i32 = 1 << 5;
/// The same in voxels.
const DOUBT_VOXELS: f32 = 2.0 / (1 << 20) as f32;

/// Shortest way along the longest axis that is walked here, voxels.
const LENGTH_MIN: f64 = 1e-2;

/// What a segment crosses in a run of slabs: indices on the two lesser axes `a` and `b`, chords in voxels. In a slab
/// it enters voxel `(a[lane], b[lane])` and leaves `(a[lane + 1], b[lane + 1])`.
pub struct Run {
    /// Slabs in use; what lies in the lanes beyond means nothing.
    pub slabs: usize,
    /// Index of the first slab on the main axis, and the step to the next.
    pub main: (i32, i32),
    /// Indices on the first lesser axis, at each slab's face.
    pub a: [i32; LANES + 1],
    /// Indices on the second lesser axis, at each slab's face.
    pub b: [i32; LANES + 1],
    /// All bits where `a` changes first: the middle voxel is then `(a[lane + 1], b[lane])`, else `(a[lane], b[lane + 1])`.
    /// With fewer than two changes that is one of the other two.
    pub a_leads: [i32; LANES],
    /// Way in the first voxel of each slab.
    pub first_chord: [f32; LANES],
    /// Way in the middle one, 0 where there is none.
    pub middle_chord: [f32; LANES],
    /// Way in the last one.
    pub last_chord: [f32; LANES],
}

/// Takes the runs of a walk. A trait and no closure, because a closure cannot be told to be compiled into its caller.
pub trait Sink {
    /// The next run of slabs.
    fn take(&mut self, run: &Run);
}

/// The main axis of a segment, and the two others in order.
pub fn axes_of(start: [f64; 3], end: [f64; 3]) -> [usize; 3] {
    let [x, y, z] = std::array::from_fn(|axis| (end[axis] - start[axis]).abs());
    if x >= y && x >= z {
        [0, 1, 2]
    } else if y >= z {
        [1, 0, 2]
    } else {
        [2, 0, 1]
    }
}

/// Positions of the segment on a lesser axis at the faces of a run of slabs, in fixed point from `anchor`.
#[derive(Clone, Copy)]
struct Faces {
    anchor: i32,
    at: [i32; LANES + 1],
}

/// A lesser axis of a segment.
#[derive(Clone, Copy)]
struct Lesser {
    start: f64,
    end: f64,
    /// Position at the face before the first slab, by extension of the segment.
    origin: f64,
    slope: f64,
    slope_fixed: i32,
}

impl Lesser {
    #[inline(always)]
    fn new(start: f64, end: f64, main_length: f64, before_start: f64) -> Self {
        let slope = (end - start) / main_length;
        let slope_fixed = round(slope * f64::from(ONE));
        Self { start, end, origin: start - slope * before_start, slope, slope_fixed }
    }

    #[inline(always)]
    fn faces(&self, from: i32, slabs: i32) -> Faces {
        let begin = self.origin + self.slope * f64::from(from);
        let anchor = floor(begin);
        let base = ((begin - f64::from(anchor)) * f64::from(ONE)) as i32;
        let mut at = [0; LANES + 1];
        for (lane, at) in at.iter_mut().enumerate() {
            *at = base.wrapping_add(self.slope_fixed.wrapping_mul(lane as i32));
        }
        // The segment begins and ends within its first and last slab, not at their faces.
        if from == 0 {
            at[0] = fixed(self.start, anchor);
        }
        if let Some(last) = at.get_mut((slabs - from) as usize) {
            *last = fixed(self.end, anchor);
        }
        Faces { anchor, at }
    }
}

/// Floor of what is above -1024: a cast is one instruction everywhere, `floor` is not.
#[inline(always)]
fn floor(value: f64) -> i32 {
    (value + 1024.0) as i32 - 1024
}

#[inline(always)]
fn round(value: f64) -> i32 {
    (value + f64::from(i32::MAX / 2) + 0.5) as i64 as i32 - i32::MAX / 2
}

/// Rounded down, so that the voxel is right to the last bit.
#[inline(always)]
fn fixed(value: f64, anchor: i32) -> i32 {
    floor_fixed((value - f64::from(anchor)) * f64::from(ONE))
}

#[inline(always)]
fn floor_fixed(value: f64) -> i32 {
    let cut = value as i32;
    cut - i32::from(f64::from(cut) > value)
}

/// Walks a segment, sixteen slabs a call of `sink`. False where the plain walk must be taken; what the sink took up to
/// then is right.
#[inline(always)]
pub fn walk_slabs(start: [f64; 3], end: [f64; 3], sink: &mut impl Sink) -> bool {
    let [main, first, second] = axes_of(start, end);
    let main_length = (end[main] - start[main]).abs();
    if main_length < LENGTH_MIN {
        return false;
    }
    let up = end[main] > start[main];
    let (from, to) = (start[main] as i32, end[main] as i32);
    let slabs = (to - from).abs() + 1;
    // Ways from the face before the start, and to the end from the face before it.
    let into = |c: f64, index: i32| if up { c - f64::from(index) } else { f64::from(index) + 1.0 - c };
    let (before_start, before_end) = (into(start[main], from), into(end[main], to));
    let a = Lesser::new(start[first], end[first], main_length, before_start);
    let b = Lesser::new(start[second], end[second], main_length, before_start);
    let step = if up { 1 } else { -1 };
    let mut done = 0;
    while done < slabs {
        let here = (slabs - done).min(LANES as i32);
        let mut lengths = [1.0f32; LANES];
        if done == 0 {
            lengths[0] = (1.0 - before_start) as f32;
        }
        if done + here == slabs {
            lengths[(here - 1) as usize & (LANES - 1)] = before_end as f32;
        }
        if slabs == 1 {
            lengths[0] = main_length as f32;
        }
        let Some(mut run) = run_of(&a, &b, done, slabs, &lengths) else {
            return false;
        };
        (run.slabs, run.main) = (here as usize, (from + step * done, step));
        sink.take(&run);
        done += here;
    }
    true
}

/// Sixteen slabs at once; nothing where it is too close to call which of two faces comes first.
#[inline(always)]
fn run_of(a: &Lesser, b: &Lesser, from: i32, slabs: i32, lengths: &[f32; LANES]) -> Option<Run> {
    let (fa, fb) = (a.faces(from, slabs), b.faces(from, slabs));
    let (ia, ib) = (indices(&fa), indices(&fb));
    let (ta, tb) = (to_face(&fa, a.slope_fixed), to_face(&fb, b.slope_fixed));
    let (sa, sb) = (a.slope.abs() as f32, b.slope.abs() as f32);
    let (ra, rb) = (1.0 / sa.max(1e-12), 1.0 / sb.max(1e-12));
    let way = (1.0 + sa * sa + sb * sb).sqrt();
    let tie = DOUBT_VOXELS * (sa + sb);
    let (mut a_leads, mut doubt) = ([0; LANES], edge_doubt(&fa, from, slabs) | edge_doubt(&fb, from, slabs));
    let (mut first_chord, mut middle_chord, mut last_chord) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let crosses_a = ia[lane] != ia[lane + 1];
        let crosses_b = ib[lane] != ib[lane + 1];
        // Which of two crossings comes first: ta / sa < tb / sb without a division.
        let lead = tb[lane] * sa - ta[lane] * sb;
        let real = from + (lane as i32) < slabs;
        doubt |= i32::from(crosses_a & crosses_b & (lead.abs() < tie) & real);
        a_leads[lane] = -i32::from(crosses_a & (!crosses_b | (lead > 0.0)));
        let length = lengths[lane];
        let (at_a, at_b) = ((ta[lane] * ra).min(length), (tb[lane] * rb).min(length));
        let enter = if crosses_a { at_a } else { length }.min(if crosses_b { at_b } else { length });
        let leave = if crosses_a { at_a } else { 0.0 }.max(if crosses_b { at_b } else { 0.0 });
        first_chord[lane] = enter * way;
        middle_chord[lane] = (leave - enter).max(0.0) * way;
        last_chord[lane] = (length - leave) * way;
    }
    (doubt == 0).then_some(Run { slabs: 0, main: (0, 0), a: ia, b: ib, a_leads, first_chord, middle_chord, last_chord })
}

#[inline(always)]
fn indices(faces: &Faces) -> [i32; LANES + 1] {
    let mut indices = [0; LANES + 1];
    for (index, at) in indices.iter_mut().zip(&faces.at) {
        *index = faces.anchor + (at >> FRACTION_BITS);
    }
    indices
}

/// Voxels from where the segment enters a slab to the next face of a lesser axis.
#[inline(always)]
fn to_face(faces: &Faces, slope_fixed: i32) -> [f32; LANES] {
    let mut ways = [0.0; LANES];
    for (way, at) in ways.iter_mut().zip(&faces.at) {
        let fraction = at & (ONE - 1);
        let fixed = if slope_fixed >= 0 { ONE - fraction } else { fraction };
        *way = fixed as f32 * (1.0 / ONE as f32);
    }
    ways
}

/// Not zero where the segment passes a slab's face too near to an edge of two voxels. Its ends are exact.
#[inline(always)]
fn edge_doubt(faces: &Faces, from: i32, slabs: i32) -> i32 {
    let mut doubt = 0;
    for (lane, at) in faces.at.iter().enumerate() {
        let face = from + lane as i32;
        let near = (at.wrapping_add(DOUBT) & (ONE - 1)) < 2 * DOUBT;
        doubt |= i32::from(near & (face > 0) & (face < slabs));
    }
    doubt
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::segments;
    use crate::walk::walk;
    use tsense_geometry::{VoxelIndex, ray_walk};

    /// The voxels of a walk in order, with their chords; those of less than three in a slab left out.
    struct Path {
        axes: [usize; 3],
        voxels: Vec<(VoxelIndex, f32)>,
    }

    impl Path {
        fn push(&mut self, main: i32, lesser: [i32; 2], chord: f32) {
            let mut voxel = [0; 3];
            (voxel[self.axes[0]], voxel[self.axes[1]], voxel[self.axes[2]]) = (main, lesser[0], lesser[1]);
            self.voxels.push((voxel, chord));
        }
    }

    impl Sink for Path {
        fn take(&mut self, run: &Run) {
            for lane in 0..run.slabs {
                let main = run.main.0 + run.main.1 * lane as i32;
                let (first, last) = ([run.a[lane], run.b[lane]], [run.a[lane + 1], run.b[lane + 1]]);
                let middle = if run.a_leads[lane] != 0 { [last[0], first[1]] } else { [first[0], last[1]] };
                self.push(main, first, run.first_chord[lane]);
                if middle != first && middle != last {
                    self.push(main, middle, run.middle_chord[lane]);
                }
                if last != first {
                    self.push(main, last, run.last_chord[lane]);
                }
            }
        }
    }

    /// The fast walk's path, and whether it is whole.
    fn fast(start: [f64; 3], end: [f64; 3]) -> (Vec<(VoxelIndex, f32)>, bool) {
        let mut path = Path { axes: axes_of(start, end), voxels: Vec::with_capacity(700) };
        let sure = walk_slabs(start, end, &mut path);
        (path.voxels, sure)
    }

    #[test]
    fn the_path_is_the_plain_walks_on_more_than_a_million_segments() {
        let (mut compared, mut plain, mut random, mut random_plain) = (0u32, 0u32, 0u32, 0u32);
        for (i, (start, end)) in segments(1_700_000).enumerate() {
            let (path, sure) = fast(start, end);
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
        let mut compared = 0;
        for (start, end) in segments(40_000) {
            if let (chords, true) = fast(start, end) {
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
