//! Marks the voxels that a segment crosses: the innermost loop, with run-time choice of the instruction set.
//!
//! In: a segment within the working space, voxels of the window; the weight of its beam; the least chord that counts.
//! Out: marks, a run of voxels at a time. Both instruction sets run the same code on the same numbers, so their marks are the same; where
//! the fast walk is in doubt, the plain one marks.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;

use crate::beams::Weight;
use crate::evidence::level_of;
use crate::marks::{IN_TILE, MarkField, Room, RowStride, TILE_BITS};
use crate::runs::{FRACTION_BITS, Group, LANES, ONE, Segment, Slab, Slabs, flat_runs, mask};
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
    /// That of its weight.
    level: usize,
    chord_min: f64,
}

impl Miss {
    /// Marks voxels with a chord of at least `chord_min` voxels. With 0, every voxel: a chord through an edge may come out a
    /// hair below zero.
    pub fn new(weight: Weight, chord_min: f64) -> Self {
        Self { level: level_of(weight), chord_min: if chord_min > 0.0 { chord_min } else { f64::NEG_INFINITY } }
    }

    /// The same chord as a way along the main axis of a segment that runs so far along its axes, voxels; 0 where every voxel
    /// counts.
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

/// Four lanes, packed one by one.
struct Portable;

impl Walk for Portable {
    #[inline(always)]
    fn try_trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64> {
        trace_runs::<4, OneByOne>(field, start, end, miss)
    }
}

/// Run by run, of `WIDTH` slabs at a time; nothing where the plain walk must mark.
#[inline(always)]
#[allow(unsafe_code, reason = "positions are promised to be of this window")]
fn trace_runs<const WIDTH: usize, P: Pack<WIDTH>>(
    field: &mut MarkField,
    start: [f64; 3],
    end: [f64; 3],
    miss: Miss,
) -> Option<u64> {
    if !field.holds(start, end) {
        return None;
    }
    let segment = Segment::of(start, end)?;
    if segment.is_flat() {
        return trace_flat(field, &segment, miss);
    }
    let (rows, along_min) = (Rows::of(field, &segment), miss.along_min(segment.lengths));
    let mut room = field.room(miss.level, segment.axes[0]);
    let found = if along_min > 0.0 {
        find::<WIDTH, true, P>(&mut room, &segment, &rows, along_min)
    } else {
        find::<WIDTH, false, P>(&mut room, &segment, &rows, 0.0)
    };
    let waiting = room.waiting();
    // SAFETY: the window holds both ends, and the path is sure.
    unsafe { field.found(found?, waiting) };
    Some(segment.voxels())
}

/// The same for a segment whose runs are few and long.
#[inline(always)]
#[allow(unsafe_code, reason = "positions are promised to be of this window")]
fn trace_flat(field: &mut MarkField, segment: &Segment, miss: Miss) -> Option<u64> {
    let rows = Rows::of(field, segment);
    let mut room = field.room(miss.level, segment.axes[0]);
    let found = find_flat(&mut room, segment, &rows, miss.along_min(segment.lengths));
    let waiting = room.waiting();
    // SAFETY: the window holds both ends, and the path is sure.
    unsafe { field.found(found?, waiting) };
    Some(segment.voxels())
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

/// The runs of a flat segment, tile by tile; how many. Nothing where its path is in doubt.
#[inline(always)]
fn find_flat(room: &mut Room<'_>, segment: &Segment, rows: &Rows, along_min: f64) -> Option<usize> {
    let [main, second, third] = rows.strides;
    let (mut used, mut is_full) = (0, false);
    let is_sure = flat_runs(segment, along_min, |[first, last], row| {
        let row = rows.first + second.at(row[0]) + third.at(row[1]);
        for tile in first >> TILE_BITS..=last >> TILE_BITS {
            let begin = tile << TILE_BITS;
            let (from, to) = ((first - begin).max(0), (last - begin).min(IN_TILE));
            match (room.positions.get_mut(used), room.bits.get_mut(used)) {
                (Some(position), Some(bits)) => {
                    (*position, *bits) = ((row + tile * main.tile()) as u32, ones(to - from + 1) << from);
                    used += 1;
                }
                _ => is_full = true,
            }
        }
    });
    room.raise_some();
    (is_sure && !is_full).then_some(used)
}

/// The runs of all slabs; how many. Nothing where the path is in doubt. `CHORDS`: voxels in which the segment runs less than `along_min`
/// along its main axis do not count.
#[inline(always)]
fn find<const WIDTH: usize, const CHORDS: bool, P: Pack<WIDTH>>(
    room: &mut Room<'_>,
    segment: &Segment,
    rows: &Rows,
    along_min: f64,
) -> Option<usize> {
    let slabs = Slabs::of(segment);
    let [main, second, third] = rows.strides;
    let ((second, zero_second), (third, zero_third)) = (second.turned(slabs.turns[0]), third.turned(slabs.turns[1]));
    // A group is as long as a tile, so the second axis' parts repeat.
    let along: [i32; LANES] = std::array::from_fn(|lane| second.at((slabs.first & IN_TILE) + lane as i32));
    let rises = slabs.rises();
    let mut base = rows.first + zero_second + zero_third + (slabs.first >> TILE_BITS) * second.tile();
    let mut doubts = [0; WIDTH];
    let mut used = 0;
    for done in (0..slabs.count).step_by(LANES) {
        let group = slabs.group(done);
        let row = base + group.tiles[0] * main.tile() + group.tiles[1] * third.tile();
        let here = Here { slabs: &slabs, group, row, main, third, along_min: fixed(along_min) };
        for from in (0..LANES).step_by(WIDTH) {
            let left = slabs.count - done - from as i32;
            if left <= 0 {
                break;
            }
            let lanes = Lanes {
                along: *along[from..].first_chunk()?,
                rises: [*rises[0][from..].first_chunk()?, *rises[1][from..].first_chunk()?],
            };
            let end = used + 2 * WIDTH;
            let into = (room.positions.get_mut(used..end)?, room.bits.get_mut(used..end)?);
            used += runs::<WIDTH, CHORDS, P>(into, &here, &lanes, left, &mut doubts);
        }
        base += second.tile();
        room.raise_some();
    }
    (doubts == [0; WIDTH]).then_some(used)
}

/// What turns a group's indices into positions.
struct Here<'a> {
    slabs: &'a Slabs,
    group: Group,
    row: i32,
    main: RowStride,
    third: RowStride,
    along_min: u32,
}

/// What is each lane's own.
struct Lanes<const WIDTH: usize> {
    along: [i32; WIDTH],
    rises: [[u32; WIDTH]; 2],
}

/// The runs of `WIDTH` slabs: the first of each, then the second where there is one; how many.
#[inline(always)]
fn runs<const WIDTH: usize, const CHORDS: bool, P: Pack<WIDTH>>(
    (positions, bits): (&mut [u32], &mut [u32]),
    here: &Here,
    lanes: &Lanes<WIDTH>,
    left: i32,
    doubts: &mut [u32; WIDTH],
) -> usize {
    let [mut first, mut second] = [([0; WIDTH], [0; WIDTH]); 2];
    let mut crosses = [0; WIDTH];
    for lane in 0..WIDTH {
        let (rises, left) = ([lanes.rises[0][lane], lanes.rises[1][lane]], left - lane as i32);
        let slab @ Slab { enter, between, leave, third, doubt } = here.group.slab(here.slabs, rises, left);
        crosses[lane] = slab.crosses(left);
        let turn = between & crosses[lane] | leave & !crosses[lane];
        let row = here.row + lanes.along[lane];
        let [before, behind] = third.map(|third| row + here.third.at(third as i32));
        first.0[lane] = here.position(before, enter);
        first.1[lane] = bits_of::<CHORDS>(enter, turn, here.along_min);
        second.0[lane] = here.position(behind, between);
        second.1[lane] = bits_of::<CHORDS>(between, leave, here.along_min);
        doubts[lane] |= doubt;
    }
    positions[..WIDTH].copy_from_slice(&first.0);
    bits[..WIDTH].copy_from_slice(&first.1);
    let used = WIDTH.min(left as usize);
    P::pack(second.0, crosses, &mut positions[used..]);
    used + P::pack(second.1, crosses, &mut bits[used..])
}

impl Here<'_> {
    /// Position of a row where a run begins on the main axis.
    #[inline(always)]
    fn position(&self, row: i32, begin: u32) -> u32 {
        let tile = (begin >> (FRACTION_BITS + TILE_BITS)) as i32;
        row.wrapping_add(tile.wrapping_mul(self.main.tile())) as u32
    }
}

/// The bits of a run in the row of the tile where it begins.
#[inline(always)]
fn bits_of<const CHORDS: bool>(enter: u32, leave: u32, along_min: u32) -> u32 {
    let tile = enter >> (FRACTION_BITS + TILE_BITS) << TILE_BITS;
    if CHORDS {
        let (first, last) = (enter.wrapping_add(along_min - 1), leave.wrapping_sub(along_min));
        let (first, last) = (first >> FRACTION_BITS, last >> FRACTION_BITS);
        let counts = mask(leave.wrapping_sub(enter) as i32 >= along_min as i32);
        (ones(last.wrapping_sub(first).wrapping_add(1) as i32) & counts) << (first - tile)
    } else {
        let (first, last) = (enter >> FRACTION_BITS, leave >> FRACTION_BITS);
        ones(last.wrapping_sub(first).wrapping_add(1) as i32) << (first - tile)
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

/// How an instruction set moves the lanes that count together.
trait Pack<const WIDTH: usize> {
    /// Writes those values whose mask is all bits, in order, and something else up to `WIDTH`; how many there are.
    fn pack(values: [u32; WIDTH], masks: [u32; WIDTH], into: &mut [u32]) -> usize;
}

/// One lane at a time.
struct OneByOne;

impl<const WIDTH: usize> Pack<WIDTH> for OneByOne {
    #[inline(always)]
    fn pack(values: [u32; WIDTH], masks: [u32; WIDTH], into: &mut [u32]) -> usize {
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
