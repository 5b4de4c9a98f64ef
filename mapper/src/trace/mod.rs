//! Marks the voxels that a segment crosses: the innermost loop, with run-time choice of the instruction set.
//!
//! In: a segment within the working space, voxels of the window; the weight of its beam; the least chord that counts.
//! Out: marks, a run of voxels at a time. All instruction sets reckon with the same numbers, so their marks are the
//! same; where the fast walk is in doubt, the plain one marks.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod flat;
mod portable;

use crate::beams::Weight;
use crate::evidence::level_of;
use crate::marks::{MarkField, RowStride};
use crate::runs::{ONE, Segment};
use crate::walk::walk;
use portable::Portable;

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
            sets.extend(avx2::is_here().then_some(Self::Avx2));
            sets.extend(avx512::is_here().then_some(Self::Avx512));
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
    /// That of its weight.
    level: usize,
    chord_min: f64,
}

impl Miss {
    /// Marks voxels with a chord of at least `chord_min` voxels. With 0, every voxel: a chord through an edge may
    /// come out a hair below zero.
    pub fn new(weight: Weight, chord_min: f64) -> Self {
        Self { level: level_of(weight), chord_min: if chord_min > 0.0 { chord_min } else { f64::NEG_INFINITY } }
    }

    /// The same chord as a way along the main axis of a segment that runs so far along its axes, voxels; 0 where
    /// every voxel counts.
    #[inline(always)]
    fn along_min(self, [main, second, third]: [f64; 3]) -> f64 {
        if self.chord_min > 0.0 {
            self.chord_min * main / (main * main + second * second + third * third).sqrt()
        } else {
            0.0
        }
    }
}

/// A way to walk: what an instruction set has of its own.
pub trait Walk {
    /// Marks what the segment crosses as missed; how many voxels that are. Nothing where it is in doubt: the plain walk
    /// must mark then.
    fn try_trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64>;
}

/// Work that is compiled anew for each instruction set, so that no call lies between a beam and its walk.
pub trait Work {
    /// What comes of it.
    type Out;

    /// Does it; to be inlined.
    fn on<W: Walk>(self) -> Self::Out;
}

impl InstructionSet {
    /// Does work on this instruction set.
    pub fn run<J: Work>(self, work: J) -> J::Out {
        match self {
            Self::Plain => work.on::<Plain>(),
            Self::Portable => work.on::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => avx2::run(work),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => avx512::run(work),
        }
    }
}

/// Marks what the segment crosses as missed; how many voxels that are.
#[inline(always)]
pub fn trace<W: Walk>(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> u64 {
    W::try_trace(field, start, end, miss).unwrap_or_else(|| trace_plain(field, start, end, miss))
}

/// One voxel at a time.
#[cold]
fn trace_plain(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> u64 {
    let mut crossed = 0;
    walk(start, end, |voxel, chord| {
        if chord >= miss.chord_min {
            field.miss(voxel, miss.level);
        }
        crossed += 1;
    });
    crossed
}

/// Always in doubt.
struct Plain;

impl Walk for Plain {
    fn try_trace(_: &mut MarkField, _: [f64; 3], _: [f64; 3], _: Miss) -> Option<u64> {
        None
    }
}

/// Where the rows along a segment's main axis lie, its axes in its own order.
struct Rows {
    first: i32,
    strides: [RowStride; 3],
}

impl Rows {
    #[inline(always)]
    fn of(field: &MarkField, segment: &Segment) -> Self {
        let strides = field.strides(segment.axes[0]);
        Self { first: field.first_row(segment.axes[0]), strides: segment.axes.map(|axis| strides[axis]) }
    }
}

/// A way along the main axis in the fixed point of a lane, at least 1.
#[inline(always)]
fn fixed(along_min: f64) -> u32 {
    ((along_min * f64::from(ONE)) as u32).max(1)
}

/// So many ones.
#[inline(always)]
fn ones(count: i32) -> u32 {
    (1u32 << (count & 31)) - 1
}

#[cfg(test)]
mod tests;
