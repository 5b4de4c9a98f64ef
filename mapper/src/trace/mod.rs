//! Marks the voxels that a segment crosses: the innermost loop, with run-time choice of the instruction set.
//!
//! In: a segment within the working space, voxels of the window; the weight of its beam; the least chord that counts.
//! Out: raised marks. Both instruction sets run the same code on the same numbers, so their marks are the same; where
//! the fast walk is in doubt, the plain one marks.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;

use crate::evidence::NOTHING;
use crate::marks::{MarkField, Room, Stride};
use crate::slab::{LANES, Margin, Run, Slabs, mask, select};
use crate::walk::walk;

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
        let position = field.position(voxel);
        field.miss(position, if chord >= miss.chord_min { miss.mark } else { NOTHING });
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

/// Four lanes, packed one by one.
struct Portable;

impl Walk for Portable {
    #[inline(always)]
    fn try_trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64> {
        trace_slabs::<4, OneByOne>(field, start, end, miss)
    }
}

/// Slab by slab, `WIDTH` at a time; nothing where the plain walk must mark.
#[inline(always)]
#[allow(unsafe_code, reason = "positions are promised to be of this window")]
fn trace_slabs<const WIDTH: usize, P: Pack<WIDTH>>(
    field: &mut MarkField,
    start: [f64; 3],
    end: [f64; 3],
    miss: Miss,
) -> Option<u64> {
    if !field.holds(start, end) {
        return None;
    }
    let slabs = Slabs::of(start, end)?;
    let strides = slabs.axes.map(|axis| field.strides()[axis]);
    let mut room = field.room(miss.mark);
    let found = if miss.chord_min > 0.0 {
        find::<WIDTH, true, P>(&mut room, &slabs, strides, miss.chord_min as f32)
    } else {
        find::<WIDTH, false, P>(&mut room, &slabs, strides, 0.0)
    };
    let waiting = room.waiting();
    // SAFETY: the window holds both ends, and the path is sure.
    unsafe { field.found(found?, waiting) };
    Some(slabs.voxels())
}

/// Writes to `path` where the marks of all voxels lie; how many. Nothing where the path is in doubt. `CHORDS`: voxels whose chord
/// is below `chord_min` do not count.
#[inline(always)]
fn find<const WIDTH: usize, const CHORDS: bool, P: Pack<WIDTH>>(
    room: &mut Room<'_>,
    slabs: &Slabs,
    strides: [Stride; 3],
    chord_min: f32,
) -> Option<usize> {
    let [main, a, b] = strides;
    let [turn_a, turn_b] = slabs.turns();
    let ((a, zero_a), (b, zero_b)) = (a.turned(turn_a), b.turned(turn_b));
    // A run is a whole number of tiles long, so the main axis' parts repeat.
    let along: [i32; LANES] = std::array::from_fn(|lane| main.at(slabs.main_at(lane as i32)));
    let zero = zero_a + zero_b - along[0];
    let mut least = Least { edge: [u32::MAX; WIDTH], tie: [u32::MAX; WIDTH] };
    let mut used = 0;
    for done in (0..slabs.count).step_by(LANES) {
        let run = slabs.run(done);
        let base = zero + main.at(slabs.main_at(done)) + a.at(run.anchors[0]) + b.at(run.anchors[1]);
        let here = Here { base, lesser: [a, b], chord_min };
        for (few, along) in along.as_chunks::<WIDTH>().0.iter().enumerate() {
            let lane = (few * WIDTH) as i32;
            if lane > run.end_lane {
                break;
            }
            let path = room.path.get_mut(used..used + 3 * WIDTH)?;
            used += positions::<WIDTH, CHORDS, P>(path, &run, lane, along, &here, &mut least);
            if lane % 16 == 0 {
                room.raise_some();
            }
        }
    }
    slabs.is_sure(least.margin()).then_some(used)
}

/// The least margins so far, lane by lane.
struct Least<const WIDTH: usize> {
    edge: [u32; WIDTH],
    tie: [u32; WIDTH],
}

impl<const WIDTH: usize> Least<WIDTH> {
    fn margin(&self) -> Margin {
        let least = |of: &[u32]| of.iter().fold(u32::MAX, |least, margin| least.min(*margin));
        Margin { edge: least(&self.edge), tie: least(&self.tie) }
    }
}

/// What turns a run's indices into positions.
struct Here {
    base: i32,
    lesser: [Stride; 2],
    chord_min: f32,
}

/// The first, last and middle voxels of `WIDTH` slabs; how many.
#[inline(always)]
fn positions<const WIDTH: usize, const CHORDS: bool, P: Pack<WIDTH>>(
    path: &mut [u32],
    run: &Run<'_>,
    from: i32,
    along: &[i32; WIDTH],
    here: &Here,
    least: &mut Least<WIDTH>,
) -> usize {
    let [a, b] = here.lesser;
    let [mut first, mut middle, mut last] = [([0; WIDTH], [0; WIDTH]); 3];
    for (i, along) in along.iter().enumerate() {
        let lane = from + i as i32;
        let slab = run.slab::<CHORDS>(lane);
        let counts = |chord: usize| if CHORDS { mask(slab.chords[chord] >= here.chord_min) } else { -1 };
        let at = here.base + along + a.at(slab.enter[0]) + b.at(slab.enter[1]);
        let (next_a, next_b) = (a.next(slab.enter[0]), b.next(slab.enter[1]));
        let [stays_a, stays_b] = slab.stays;
        first.0[i] = at as u32;
        last.0[i] = (at + (next_a & !stays_a) + (next_b & !stays_b)) as u32;
        middle.0[i] = (at + select(slab.a_leads, next_a, next_b)) as u32;
        let beyond = mask(lane > run.end_lane);
        first.1[i] = counts(0) & !beyond;
        last.1[i] = counts(2) & !(stays_a & stays_b);
        middle.1[i] = counts(1) & !(stays_a | stays_b);
        least.edge[i] = least.edge[i].min(slab.margin.edge | beyond as u32);
        least.tie[i] = least.tie[i].min(slab.margin.tie);
    }
    let mut used = if CHORDS {
        P::pack(first.0, first.1, path)
    } else {
        path[..WIDTH].copy_from_slice(&first.0);
        WIDTH.min((run.end_lane + 1 - from) as usize)
    };
    used += P::pack(last.0, last.1, &mut path[used..]);
    used + P::pack(middle.0, middle.1, &mut path[used..])
}

/// How an instruction set moves the lanes that count together.
trait Pack<const WIDTH: usize> {
    /// Writes those values whose mask is all bits, in order, and something else up to `WIDTH`; how many there are.
    fn pack(values: [u32; WIDTH], masks: [i32; WIDTH], into: &mut [u32]) -> usize;
}

/// One lane at a time.
struct OneByOne;

impl<const WIDTH: usize> Pack<WIDTH> for OneByOne {
    #[inline(always)]
    fn pack(values: [u32; WIDTH], masks: [i32; WIDTH], into: &mut [u32]) -> usize {
        let (into, mut used) = (&mut into[..WIDTH], 0);
        for lane in 0..WIDTH {
            into[used % WIDTH] = values[lane];
            used += usize::from(masks[lane] != 0);
        }
        used
    }
}

#[cfg(test)]
mod tests;
