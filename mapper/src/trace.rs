//! Marks the voxels that a segment crosses: the innermost loop, with run-time choice of the instruction set.
//!
//! In: a segment within the working space, voxels of the window; the weight of its beam; the least chord that counts.
//! Out: raised marks. Both instruction sets run the same code on the same numbers, so their marks are the same; where
//! the fast walk is in doubt, the plain one marks.

use crate::beams::Weight;
use crate::evidence::{NOTHING, miss_mark};
use crate::marks::{MarkField, Stride};
use crate::slab::{LANES, Run, Slabs, mask, select};
use crate::walk::walk;
use tsense_contract::BRICK_VOXELS;

/// The largest mark there is.
const FULL: u8 = miss_mark(Weight::FULL);

/// What the processor offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// One voxel at a time in `f64`: the reference, for tests and measurements.
    Plain,
    /// What every processor of its kind has.
    Portable,
    /// 256-bit vectors of integers.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors with masks: the features F, BW, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// The best that this processor has.
    pub fn best() -> Self {
        *Self::available().last().unwrap_or(&Self::Portable)
    }

    /// All that this processor has, the fastest last.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![Self::Plain, Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            sets.extend(std::arch::is_x86_feature_detected!("avx2").then_some(Self::Avx2));
            sets.extend(x86::has_avx512().then_some(Self::Avx512));
        }
        sets
    }

    /// Its name for people and JSON.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "AVX-512",
        }
    }
}

/// Evidence of one beam.
#[derive(Clone, Copy)]
pub struct Miss {
    mark: u8,
    chord_min: f64,
}

impl Miss {
    /// Raises `mark` in voxels with a chord of at least `chord_min` voxels. With 0, for every voxel: a chord
    /// through an edge may come out a hair below zero.
    pub fn new(mark: u8, chord_min: f64) -> Self {
        Self { mark, chord_min: if chord_min > 0.0 { chord_min } else { f64::NEG_INFINITY } }
    }
}

/// Marks what the segment crosses as missed; how many voxels that are.
pub fn trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss, set: InstructionSet) -> u64 {
    let sure = match set {
        InstructionSet::Plain => false,
        InstructionSet::Portable => trace_slabs::<4>(field, start, end, miss),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => x86::trace_avx2(field, start, end, miss),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => x86::trace_avx512(field, start, end, miss),
    };
    if !sure {
        trace_plain(field, start, end, miss);
    }
    let steps = (0..3).map(|axis| (start[axis] as u64).abs_diff(end[axis] as u64));
    1 + steps.sum::<u64>()
}

/// One voxel at a time.
fn trace_plain(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) {
    walk(start, end, |voxel, chord| {
        let position = field.position(voxel);
        field.misses()[position] |= if chord >= miss.chord_min { miss.mark } else { NOTHING };
    });
}

/// Slab by slab, `WIDTH` at a time; false where the plain walk must mark.
#[inline(always)]
fn trace_slabs<const WIDTH: usize>(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
    let Some(slabs) = Slabs::of(start, end) else {
        return false;
    };
    let strides = slabs.axes.map(|axis| field.strides()[axis]);
    let (marks, path) = field.misses_and_path();
    let nowhere = (marks.len() - BRICK_VOXELS) as i32;
    let found = if miss.chord_min > 0.0 {
        find::<WIDTH, true>(path, &slabs, strides, nowhere, miss.chord_min as f32)
    } else {
        find::<WIDTH, false>(path, &slabs, strides, nowhere, 0.0)
    };
    let Some(found) = found.filter(|found| (found.highest as usize) < marks.len()) else {
        return false;
    };
    // The largest mark there is needs no reading of what was there.
    if miss.mark == FULL {
        found.mark(marks, |_| FULL)
    } else {
        found.mark(marks, |mark| mark | miss.mark)
    }
    true
}

/// Where the marks of all voxels of a path lie.
struct Found<'a> {
    positions: &'a [u32],
    highest: u32,
}

impl Found<'_> {
    /// Raises the marks, of which there are more than `highest`.
    #[inline(always)]
    #[allow(unsafe_code, reason = "a check for each mark costs a fifth of the walk")]
    fn mark(&self, marks: &mut [u8], raised: impl Fn(u8) -> u8) {
        assert!((self.highest as usize) < marks.len());
        for few in self.positions.chunks_exact(4) {
            for position in few {
                // SAFETY: no position is above `highest`, by `find`, and `highest` is below the length, as asserted.
                let mark = unsafe { marks.get_unchecked_mut(*position as usize) };
                *mark = raised(*mark);
            }
        }
    }
}

/// Writes to `path` where the marks of all voxels lie; those that do not count lie `nowhere`. Nothing where the path is
/// in doubt. `CHORDS`: chords below `chord_min` do not count.
#[inline(always)]
fn find<'a, const WIDTH: usize, const CHORDS: bool>(
    path: &'a mut [u32],
    slabs: &Slabs,
    strides: [Stride; 3],
    nowhere: i32,
    chord_min: f32,
) -> Option<Found<'a>> {
    let [main, a, b] = strides;
    // A run is a whole number of bricks long, so the main axis' parts repeat.
    let along: [i32; LANES] = std::array::from_fn(|lane| main.at(slabs.main_at(lane as i32)));
    let mut all = Gathered { doubt: [0; WIDTH], highest: [0; WIDTH] };
    let mut used = 0;
    for done in (0..slabs.count).step_by(LANES) {
        let run = slabs.run(done);
        let base = main.at(slabs.main_at(done)) - along[0] + a.at(run.anchors[0]) + b.at(run.anchors[1]);
        let here = Here { base, lesser: [a, b], nowhere, chord_min };
        for (few, along) in along.chunks_exact(WIDTH).enumerate() {
            let lane = (few * WIDTH) as i32;
            if lane > run.end_lane {
                break;
            }
            let part: &mut [u32] = path.get_mut(used..used + 3 * WIDTH)?;
            positions::<WIDTH, CHORDS>(part, &run, lane, along, &here, &mut all);
            used += 3 * WIDTH;
        }
    }
    let highest = all.highest.iter().fold(0, |highest, position| highest.max(*position));
    let doubt = all.doubt.iter().fold(0, |all, doubt| all | doubt);
    (doubt == 0).then(|| Found { positions: &path[..used], highest })
}

/// What holds for all slabs, lane by lane.
struct Gathered<const WIDTH: usize> {
    /// Not zero where fixed point cannot tell the path.
    doubt: [i32; WIDTH],
    highest: [u32; WIDTH],
}

/// What turns a run's indices into positions.
struct Here {
    base: i32,
    lesser: [Stride; 2],
    nowhere: i32,
    chord_min: f32,
}

/// The first, middle and last voxels of `WIDTH` slabs.
#[inline(always)]
fn positions<const WIDTH: usize, const CHORDS: bool>(
    path: &mut [u32],
    run: &Run<'_>,
    from: i32,
    along: &[i32],
    here: &Here,
    all: &mut Gathered<WIDTH>,
) {
    let [a, b] = here.lesser;
    let (mut first, mut middle, mut last) = ([0; WIDTH], [0; WIDTH], [0; WIDTH]);
    for i in 0..WIDTH {
        let lane = from + i as i32;
        let slab = run.slab::<CHORDS>(lane);
        let base = here.base + along[i];
        let (enter_a, enter_b) = (a.at(slab.enter[0]), b.at(slab.enter[1]));
        let (leave_a, leave_b) = (a.at(slab.leave[0]), b.at(slab.leave[1]));
        let mixed = select(slab.a_leads, leave_a + enter_b, enter_a + leave_b);
        let counts = |chord: usize| {
            mask(lane <= run.end_lane) & if CHORDS { mask(slab.chords[chord] >= here.chord_min) } else { -1 }
        };
        let [crosses_a, crosses_b] = slab.crosses;
        let aside = here.nowhere + lane;
        first[i] = select(counts(0), base + enter_a + enter_b, aside) as u32;
        middle[i] = select(counts(1) & crosses_a & crosses_b, base + mixed, aside) as u32;
        last[i] = select(counts(2) & (crosses_a | crosses_b), base + leave_a + leave_b, aside) as u32;
        all.highest[i] = all.highest[i].max(first[i].max(middle[i]).max(last[i]));
        all.doubt[i] |= slab.doubt;
    }
    path[..WIDTH].copy_from_slice(&first);
    path[WIDTH..2 * WIDTH].copy_from_slice(&middle);
    path[2 * WIDTH..].copy_from_slice(&last);
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    //! The same code, compiled for wider vectors.
    #![allow(unsafe_code, reason = "a function for one instruction set may only be called where the processor has it")]

    use super::{MarkField, Miss, trace_slabs};
    use std::arch::is_x86_feature_detected;

    /// Call only where [`super::InstructionSet::best`] said so; it is asserted, at the cost of a load.
    pub fn trace_avx2(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        assert!(is_x86_feature_detected!("avx2"));
        // SAFETY: the processor has AVX2, as just asserted.
        unsafe { compiled_avx2(field, start, end, miss) }
    }

    #[target_feature(enable = "avx2")]
    fn compiled_avx2(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        trace_slabs::<8>(field, start, end, miss)
    }

    /// Whether the processor has all that [`trace_avx512`] needs.
    pub fn has_avx512() -> bool {
        is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
    }

    /// Call only where [`has_avx512`]; it is asserted.
    pub fn trace_avx512(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        assert!(has_avx512());
        // SAFETY: the processor has these features, as just asserted.
        unsafe { compiled_avx512(field, start, end, miss) }
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
    fn compiled_avx512(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        trace_slabs::<16>(field, start, end, miss)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::segments;

    /// Segments traced, and voxels whose marks differ between two ways over the same segments.
    fn compare(count: usize, chord_min: f64, one: InstructionSet, other: InstructionSet) -> (usize, usize) {
        let (mut left, mut right) = (MarkField::new([2, 2, 3]), MarkField::new([2, 2, 3]));
        let mut compared = 0;
        for (i, (start, end)) in segments(count).enumerate() {
            let miss = Miss::new([1, 3, 7, 15][i % 4], chord_min);
            trace(&mut left, start, end, miss, one);
            trace(&mut right, start, end, miss, other);
            compared += 1;
        }
        let voxels = left.misses().len() - BRICK_VOXELS;
        let (left, right) = (&left.misses()[..voxels], &right.misses()[..voxels]);
        (compared, left.iter().zip(right).filter(|(l, r)| l != r).count())
    }

    #[test]
    fn the_fast_marks_are_the_plain_ones() {
        assert_eq!(compare(20_000, 0.0, InstructionSet::best(), InstructionSet::Plain), (20_000, 0));
    }

    #[test]
    fn all_instruction_sets_mark_the_same() {
        for set in InstructionSet::available().into_iter().skip(2) {
            for chord_min in [0.0, 0.5] {
                assert_eq!(compare(20_000, chord_min, set, InstructionSet::Portable), (20_000, 0), "{set:?}");
            }
        }
        if InstructionSet::best().as_str() != "AVX-512" {
            eprintln!("SKIPPED: AVX-512, which this processor lacks");
        }
    }
}
