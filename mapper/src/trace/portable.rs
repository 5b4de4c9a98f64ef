//! The fast walk for any processor: slabs in lanes, written so that a compiler makes vectors of them.

use super::flat::trace_flat;
use super::{Miss, Rows, Walk, fixed, ones};
use crate::marks::{IN_TILE, MarkField, Room, RowStride, TILE_BITS};
use crate::runs::{FRACTION_BITS, Group, LANES, Segment, Slab, Slabs, mask};

/// Four lanes, packed one by one.
pub struct Portable;

impl Walk for Portable {
    #[inline(always)]
    fn try_trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64> {
        trace_runs::<4, OneByOne>(field, start, end, miss)
    }
}

/// Run by run, of `WIDTH` slabs at a time; nothing where the plain walk must mark.
#[inline(always)]
#[allow(unsafe_code, reason = "positions are promised to be of this window")]
pub fn trace_runs<const WIDTH: usize, P: Pack<WIDTH>>(
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

/// The runs of all slabs; how many. Nothing where the path is in doubt. `CHORDS`: voxels in which the segment runs
/// less than `along_min` along its main axis do not count.
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

/// How an instruction set moves the lanes that count together.
pub trait Pack<const WIDTH: usize> {
    /// Writes those values whose mask is all bits, in order, and something else up to `WIDTH`; how many there are.
    fn pack(values: [u32; WIDTH], masks: [u32; WIDTH], into: &mut [u32]) -> usize;
}

/// One lane at a time.
pub struct OneByOne;

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
