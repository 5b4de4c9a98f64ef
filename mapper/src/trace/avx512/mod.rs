//! The fast walk by hand for 512-bit vectors: sixteen slabs at once, positions from tables instead of multiplications.
//!
//! Its numbers are those of [`crate::runs`] to the last bit, so that runs and doubts are the same. What a compiler
//! makes of the portable code for such vectors is no faster than for half of them.
#![allow(unsafe_code, reason = "loads, stores, and functions that only some processors may run")]

mod axis;
mod bits;
mod cut;

use super::flat::trace_flat;
use super::{Miss, Walk, Work, fixed};
use crate::marks::{IN_TILE, MarkField, Room, TILE_BITS};
use crate::runs::{FRACTION_BITS, Group, LANES, ONE, RUN_MAX, Segment, Slabs};
use axis::{Line, Parts, all, lanes};
use bits::Bits;
use cut::Cut;
use std::arch::is_x86_feature_detected;
use std::arch::x86_64::*;

/// Whether the processor has all that [`run`] needs.
pub fn is_here() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("popcnt")
}

/// Does work on this instruction set. Call only where it [`is_here`]; that is asserted.
pub fn run<J: Work>(work: J) -> J::Out {
    assert!(is_here());
    // SAFETY: the processor has these features, as just asserted.
    unsafe { run_here(work) }
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn run_here<J: Work>(work: J) -> J::Out {
    work.on::<Avx512>()
}

/// Sixteen lanes.
struct Avx512;

impl Walk for Avx512 {
    #[inline(always)]
    fn try_trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64> {
        // SAFETY: only [`run`] walks so.
        unsafe { trace_here(field, start, end, miss) }
    }
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn trace_here(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64> {
    if !field.holds(start, end) {
        return None;
    }
    let Some(cut) = Cut::of(start, end) else {
        return trace_flat(field, &Segment::of(start, end)?, miss);
    };
    let along_min = miss.along_min(cut.lengths);
    let path = Path::new(field, &cut, along_min);
    let mut room = field.room(miss.level, cut.axes[0]);
    let found = if along_min > 0.0 { path.find::<true>(&mut room) } else { path.find::<false>(&mut room) };
    let waiting = room.waiting();
    // SAFETY: the window holds both ends, and the path is sure.
    unsafe { field.found(found?, waiting) };
    Some(cut.voxels)
}

/// A segment as vectors.
struct Path<'a> {
    slabs: &'a Slabs,
    main: Line,
    third: Line,
    /// Position of the first group's rows, but for what the main axis and the third add; and what a group adds to it.
    row: i32,
    row_advance: i32,
    /// What each lane adds to it.
    along: __m512i,
    /// What indices on the third axis add.
    parts: Parts,
    /// From a tile to the next on the main axis and on the third, and each tile of a group on the main one.
    tiles: [i32; 2],
    main_tiles: __m512i,
    per_third: __m512,
    doubt: __m512i,
    bits: Bits,
}

impl<'a> Path<'a> {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn new(field: &MarkField, cut: &'a Cut, along_min: f64) -> Self {
        let (slabs, [axis, second, third]) = (&cut.slabs, cut.axes);
        let second = field.steps(axis, second, slabs.turns[0] != 0);
        let third = field.steps(axis, third, slabs.turns[1] != 0);
        let main_tile = field.steps(axis, axis, false).tile;
        let [main_slope, third_slope] = slabs.slopes();
        let first = slabs.first >> TILE_BITS;
        Self {
            slabs,
            main: Line::new(main_slope),
            third: Line::new(third_slope),
            row: field
                .first_row(axis)
                .wrapping_add(second.zero)
                .wrapping_add(third.zero)
                .wrapping_add(first.wrapping_mul(second.tile)),
            row_advance: second.tile,
            along: Parts::new(second).of(_mm512_add_epi32(lanes(), all((slabs.first & IN_TILE) as u32))),
            parts: Parts::new(third),
            tiles: [main_tile, third.tile],
            main_tiles: _mm512_mullo_epi32(lanes(), all(main_tile as u32)),
            per_third: _mm512_set1_ps(slabs.per_third),
            doubt: all(slabs.doubt),
            bits: Bits::new(fixed(along_min)),
        }
    }

    /// Writes all runs; how many. Nothing where the path is in doubt.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn find<const CHORDS: bool>(&self, room: &mut Room<'_>) -> Option<usize> {
        let (mut used, mut doubts, mut done, mut row) = (0, 0, 0, self.row);
        loop {
            let left = self.slabs.count - done;
            let group = self.slabs.group(done);
            let here = row
                .wrapping_add(group.tiles[0].wrapping_mul(self.tiles[0]))
                .wrapping_add(group.tiles[1].wrapping_mul(self.tiles[1]));
            let positions = room.positions.get_mut(used..)?.first_chunk_mut()?;
            let bits = room.bits.get_mut(used..)?.first_chunk_mut()?;
            // Most slabs of a long segment are inner ones, which need less.
            let (count, doubt) = if done > 0 && left > LANES as i32 {
                self.sixteen::<CHORDS, true>(positions, bits, &group, here, left)
            } else {
                self.sixteen::<CHORDS, false>(positions, bits, &group, here, left)
            };
            room.raise_some();
            (used, doubts, done) = (used + count, doubts | doubt, done + LANES as i32);
            row = row.wrapping_add(self.row_advance);
            if left <= LANES as i32 {
                return (doubts == 0).then_some(used);
            }
        }
    }

    /// Writes the runs of sixteen slabs, or of those that are left; how many, and which slabs are in doubt.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn sixteen<const CHORDS: bool, const INNER: bool>(
        &self,
        positions: &mut [u32; 2 * LANES],
        bits: &mut [u32; 2 * LANES],
        group: &Group,
        row: i32,
        left: i32,
    ) -> (usize, __mmask16) {
        let (valid, inner) = if INNER { (0xffff, 0xffff) } else { (first_lanes(left), first_lanes(left - 1)) };
        let main = self.main.faces::<INNER>(&group.main, inner);
        let third = self.third.faces::<INNER>(&group.third, inner);
        let [before, behind] = [third.enter, third.leave].map(|at| _mm512_srli_epi32::<FRACTION_BITS>(at));
        let crosses = _mm512_mask_cmpneq_epi32_mask(valid, before, behind);
        let between = _mm512_min_epu32(_mm512_add_epi32(main.enter, self.way_to_face(third.enter)), main.leave);
        let doubts = main.doubts | third.doubts | self.doubts(between, crosses);
        let row = _mm512_add_epi32(self.along, all(row as u32));
        let [before, behind] = [before, behind].map(|index| _mm512_add_epi32(row, self.parts.of(index)));
        let turn = _mm512_mask_blend_epi32(crosses, main.leave, between);
        store(self.position(before, main.enter), positions, 0);
        store(self.bits.of::<CHORDS>(main.enter, turn), bits, 0);
        let count = if INNER { LANES } else { left.min(LANES as i32) as usize };
        store(_mm512_maskz_compress_epi32(crosses, self.position(behind, between)), positions, count);
        store(_mm512_maskz_compress_epi32(crosses, self.bits.of::<CHORDS>(between, main.leave)), bits, count);
        (count + crosses.count_ones() as usize, doubts)
    }

    /// The way along the main axis from where a segment enters a slab to the third axis' next face.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn way_to_face(&self, third: __m512i) -> __m512i {
        let rest = _mm512_sub_epi32(all(ONE), _mm512_and_si512(third, all(ONE - 1)));
        let way = _mm512_mul_ps(_mm512_cvtepi32_ps(rest), self.per_third);
        _mm512_cvttps_epi32(_mm512_min_ps(way, _mm512_set1_ps((RUN_MAX as u32 * ONE) as f32)))
    }

    /// Slabs in which that face is too near to one of the main axis.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn doubts(&self, between: __m512i, crosses: __mmask16) -> __mmask16 {
        let from_face = _mm512_and_si512(_mm512_add_epi32(between, self.doubt), all(ONE - 1));
        _mm512_mask_cmplt_epu32_mask(crosses, from_face, _mm512_add_epi32(self.doubt, self.doubt))
    }

    /// Positions of rows where runs begin on the main axis.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn position(&self, row: __m512i, begin: __m512i) -> __m512i {
        let tile = _mm512_srli_epi32::<{ FRACTION_BITS + TILE_BITS }>(begin);
        _mm512_add_epi32(row, _mm512_permutexvar_epi32(tile, self.main_tiles))
    }
}

/// So many lanes, or all sixteen.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn first_lanes(count: i32) -> __mmask16 {
    _bzhi_u32(0xffff, count.min(LANES as i32) as u32) as __mmask16
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn store(numbers: __m512i, into: &mut [u32; 2 * LANES], from: usize) {
    let into = &mut into[from..from + LANES];
    // SAFETY: room for sixteen numbers is there.
    unsafe { _mm512_storeu_si512(into.as_mut_ptr().cast(), numbers) }
}
