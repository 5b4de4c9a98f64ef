//! Marks the voxels that a segment crosses: the innermost loop, with run-time choice of the instruction set.
//!
//! In: a segment within the working space, voxels of the window; the weight of its beam; the least chord that counts.
//! Out: raised marks. Both instruction sets run the same code on the same numbers, so their marks are the same; where
//! the fast walk is in doubt, the plain one marks.

use crate::evidence::NOTHING;
use crate::slab::{Slab, axes_of, walk_slabs};
use crate::walk::walk;

/// What the processor offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
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
    pub offsets: [&'a [u32]; 3],
}

/// Evidence of one beam.
#[derive(Clone, Copy)]
pub struct Miss {
    weight: u8,
    chord_min: f64,
}

impl Miss {
    /// With a weight in 64ths, for voxels with a chord of at least `chord_min` voxels. With 0, for every voxel: a chord
    /// through an edge may come out a hair below zero.
    pub fn new(weight: u8, chord_min: f64) -> Self {
        Self { weight, chord_min: if chord_min > 0.0 { chord_min } else { f64::NEG_INFINITY } }
    }
}

/// Marks what the segment crosses as missed; how many voxels that are.
pub fn trace(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss, set: InstructionSet) -> u64 {
    let sure = match set {
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
pub fn trace_plain(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss) {
    let [x, y, z] = field.offsets;
    walk(start, end, |voxel, chord| {
        let [i, j, k] = voxel.map(|index| index as usize);
        let mark = &mut field.marks[(x[i] + y[j] + z[k]) as usize];
        *mark = (*mark).max(if chord >= miss.chord_min { miss.weight } else { NOTHING });
    });
}

#[inline(always)]
fn trace_slabs(field: &mut Field<'_>, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
    let axes = axes_of(start, end);
    let [main, a, b] = axes.map(|axis| field.offsets[axis]);
    let chord_min = miss.chord_min as f32;
    let marks = &mut *field.marks;
    let mut raise = |position: u32, chord: f32| {
        let mark = &mut marks[position as usize];
        *mark = (*mark).max(if chord >= chord_min { miss.weight } else { NOTHING });
    };
    walk_slabs(start, end, |slab: Slab| {
        let at = main[slab.main as usize];
        let [a0, a1] = [a[slab.first[0] as usize], a[slab.last[0] as usize]];
        let [b0, b1] = [b[slab.first[1] as usize], b[slab.last[1] as usize]];
        let middle = if slab.first_axis_leads { a1 + b0 } else { a0 + b1 };
        raise(at + a0 + b0, slab.chords[0]);
        raise(at + middle, slab.chords[1]);
        raise(at + a1 + b1, slab.chords[2]);
    })
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

    /// Marks of two ways over the same segments, in the same arena; how many segments were compared.
    fn compare(count: usize, chord_min: f64, one: InstructionSet, other: Option<InstructionSet>) -> (usize, usize) {
        let mut window = Window::new(0.15, [30.0, 30.0, 12.0]).unwrap();
        window.center_on([30_000, 40_000, 50]);
        let size = window.slot_count() * VOXELS_PER_BLOCK;
        let (mut left, mut right) = (vec![0; size], vec![0; size]);
        let mut compared = 0;
        for (i, (start, end)) in segments(count).enumerate() {
            // The window is 120 voxels high.
            let flat = |p: [f64; 3]| [p[0], p[1], p[2] * 0.6];
            let (start, end, miss) = (flat(start), flat(end), Miss::new(1 + (i % 64) as u8, chord_min));
            trace(&mut Field { marks: &mut left, offsets: window.offsets() }, start, end, miss, one);
            let mut field = Field { marks: &mut right, offsets: window.offsets() };
            match other {
                Some(set) => drop(trace(&mut field, start, end, miss, set)),
                None => trace_plain(&mut field, start, end, miss),
            }
            compared += 1;
        }
        (compared, left.iter().zip(&right).filter(|(l, r)| l != r).count())
    }

    #[test]
    fn the_fast_marks_are_the_plain_ones() {
        assert_eq!(compare(20_000, 0.0, InstructionSet::best(), None), (20_000, 0));
    }

    #[test]
    fn all_instruction_sets_mark_the_same() {
        for chord_min in [0.0, 0.5] {
            let (best, portable) = (InstructionSet::best(), InstructionSet::Portable);
            assert_eq!(compare(20_000, chord_min, best, Some(portable)), (20_000, 0));
        }
    }
}
