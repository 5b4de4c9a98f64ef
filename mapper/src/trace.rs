//! Marks the voxels that a segment crosses: the innermost loop, with run-time choice of the instruction set.
//!
//! In: a segment within the working space, voxels of the window; the weight of its beam; the least chord that counts.
//! Out: raised marks. Both instruction sets run the same code on the same numbers, so their marks are the same; where
//! the fast walk is in doubt, the plain one marks.

use crate::evidence::NOTHING;
use crate::slab::{LANES, Run, Sink, axes_of, walk_slabs};
use crate::walk::walk;
use crate::window::AxisOffsets;

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
}

impl InstructionSet {
    /// The best that this processor has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Portable
    }

    /// Its name for people and JSON.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
        }
    }
}

/// The marks of all slots, and where a voxel's mark lies: the sum of three table entries.
pub struct Field<'a> {
    /// A byte a voxel.
    pub marks: &'a mut [u8],
    /// By axis and index in the window.
    pub offsets: [&'a AxisOffsets; 3],
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
pub fn trace(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss, set: InstructionSet) -> u64 {
    let sure = match set {
        InstructionSet::Plain => false,
        InstructionSet::Portable => trace_slabs(field, start, end, miss),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => avx2::trace(field, start, end, miss),
    };
    if !sure {
        trace_plain(field, start, end, miss);
    }
    let steps = (0..3).map(|axis| (start[axis] as u64).abs_diff(end[axis] as u64));
    1 + steps.sum::<u64>()
}

/// One voxel at a time.
fn trace_plain(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss) {
    let [x, y, z] = field.offsets;
    walk(start, end, |voxel, chord| {
        let [i, j, k] = voxel;
        let mark = &mut field.marks[(x.at(i) + y.at(j) + z.at(k)) as usize];
        *mark |= if chord >= miss.chord_min { miss.mark } else { NOTHING };
    });
}

#[inline(always)]
fn trace_slabs(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
    let axes = axes_of(start, end);
    let mut marker = Marker {
        marks: field.marks,
        offsets: axes.map(|axis| field.offsets[axis]),
        mark: miss.mark,
        chord_min: miss.chord_min as f32,
    };
    walk_slabs(start, end, &mut marker)
}

/// Raises marks, a run of slabs at a time.
struct Marker<'a> {
    marks: &'a mut [u8],
    /// By axis of the walk: main, first and second lesser.
    offsets: [&'a AxisOffsets; 3],
    mark: u8,
    chord_min: f32,
}

impl Sink for Marker<'_> {
    #[inline(always)]
    fn take(&mut self, run: &Run) {
        let [main, a, b] = self.offsets;
        let raised =
            |chords: &[f32; LANES]| chords.map(|chord| if chord >= self.chord_min { self.mark } else { NOTHING });
        let (first, middle, last) = (raised(&run.first_chord), raised(&run.middle_chord), raised(&run.last_chord));
        let (mut at_a, mut at_b) = (a.at(run.a[0]), b.at(run.b[0]));
        for lane in 0..run.slabs.min(LANES) {
            let at = main.at(run.main.0 + run.main.1 * lane as i32);
            let (next_a, next_b) = (a.at(run.a[lane + 1]), b.at(run.b[lane + 1]));
            let leads = run.a_leads[lane] as u32;
            // Without a branch: the first axis' next index with the second's old one, or the other way round.
            let mixed = (at_a ^ ((at_a ^ next_a) & leads)) + (next_b ^ ((at_b ^ next_b) & leads));
            raise(self.marks, at + at_a + at_b, first[lane]);
            raise(self.marks, at + mixed, middle[lane]);
            raise(self.marks, at + next_a + next_b, last[lane]);
            (at_a, at_b) = (next_a, next_b);
        }
    }
}

#[inline(always)]
fn raise(marks: &mut [u8], position: u32, mark: u8) {
    marks[position as usize] |= mark;
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    //! The same code, compiled for 256-bit vectors.
    #![allow(unsafe_code, reason = "a function for one instruction set may only be called where the processor has it")]

    use super::{Field, Miss, trace_slabs};

    /// Call only where [`super::InstructionSet::best`] said so; it is asserted, at the cost of a load.
    pub fn trace(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        assert!(std::arch::is_x86_feature_detected!("avx2"));
        // SAFETY: the processor has AVX2, as just asserted.
        unsafe { compiled(field, start, end, miss) }
    }

    #[target_feature(enable = "avx2")]
    fn compiled(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        trace_slabs(field, start, end, miss)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::segments;
    use crate::window::{VOXELS_PER_BLOCK, Window};

    /// Segments compared, and voxels whose marks differ, between two ways over the same segments.
    fn compare(count: usize, chord_min: f64, one: InstructionSet, other: InstructionSet) -> (usize, usize) {
        let mut window = Window::new(0.15, [30.0, 30.0, 12.0]).unwrap();
        window.center_on([30_000, 40_000, 50]);
        let size = window.slot_count() * VOXELS_PER_BLOCK;
        let (mut left, mut right) = (vec![0; size], vec![0; size]);
        let mut compared = 0;
        for (i, (start, end)) in segments(count).enumerate() {
            let miss = Miss::new([1, 3, 7, 15][i % 4], chord_min);
            trace(&mut Field { marks: &mut left, offsets: window.offsets() }, start, end, miss, one);
            trace(&mut Field { marks: &mut right, offsets: window.offsets() }, start, end, miss, other);
            compared += 1;
        }
        (compared, left.iter().zip(&right).filter(|(l, r)| l != r).count())
    }

    #[test]
    fn the_fast_marks_are_the_plain_ones() {
        assert_eq!(compare(20_000, 0.0, InstructionSet::best(), InstructionSet::Plain), (20_000, 0));
    }

    #[test]
    fn all_instruction_sets_mark_the_same() {
        for chord_min in [0.0, 0.5] {
            let (best, portable) = (InstructionSet::best(), InstructionSet::Portable);
            assert_eq!(compare(20_000, chord_min, best, portable), (20_000, 0));
        }
    }
}
