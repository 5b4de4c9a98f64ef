//! The fast walk by hand for 512-bit vectors: sixteen slabs at once, positions from tables instead of multiplications.
//!
//! Its numbers are those of [`crate::slab`] to the last bit, so that marks, chords and doubts are the same. What a
//! compiler makes of the portable code for such vectors is no faster than for half of them.
#![allow(unsafe_code, reason = "loads, stores, and functions that only some processors may run")]

mod axis;
mod order;
mod segment;

use super::{Miss, Walk, Work};
use crate::marks::{IN_TILE, MarkField, Room, TILE_BITS};
use crate::slab::LANES;
use axis::{Axis, lanes};
use order::{Order, Ways};
use segment::{Faces, Segment};
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
    let segment = Segment::of(start, end)?;
    let path = Path::new(field, &segment, miss.chord_min as f32);
    let mut room = field.room(miss.mark);
    let found = if miss.chord_min > 0.0 { path.find::<true>(&mut room) } else { path.find::<false>(&mut room) };
    let waiting = room.waiting();
    // SAFETY: the window holds both ends, and the path is sure.
    unsafe { field.found(found?, waiting) };
    Some(segment.voxels())
}

/// A segment as vectors.
struct Path<'a> {
    segment: &'a Segment,
    /// Positions of marks along the main axis, from the first slab, but for what the lesser axes add.
    main: __m512i,
    /// What sixteen slabs add to them.
    main_advance: __m512i,
    axis_a: Axis,
    axis_b: Axis,
    order: Order,
    ways: Ways,
}

impl<'a> Path<'a> {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn new(field: &MarkField, segment: &'a Segment, chord_min: f32) -> Self {
        let [main, a, b] = [0, 1, 2].map(|i| field.steps(segment.axes[i], segment.turns >> i & 1 == 1));
        let along = Axis::new(main, 0).parts(_mm512_add_epi32(lanes(), _mm512_set1_epi32(segment.first & IN_TILE)));
        let first = (main.zero + a.zero + b.zero).wrapping_add((segment.first >> TILE_BITS).wrapping_mul(main.tile));
        Self {
            segment,
            main: _mm512_add_epi32(along, _mm512_set1_epi32(first)),
            main_advance: _mm512_set1_epi32(main.tile),
            axis_a: Axis::new(a, segment.short_slope(1)),
            axis_b: Axis::new(b, segment.short_slope(2)),
            order: Order::new([segment.slopes[1], segment.slopes[2]]),
            ways: Ways::new(segment, chord_min),
        }
    }

    /// Writes the positions of all marks; how many. Nothing where the path is in doubt.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn find<const CHORDS: bool>(&self, room: &mut Room<'_>) -> Option<usize> {
        let (mut used, mut doubts, mut done) = (0, 0, 0);
        let mut here = self.at(0);
        loop {
            let left = self.segment.count - done;
            let path = room.path.get_mut(used..)?.first_chunk_mut()?;
            // Most slabs of a long segment are inner ones, which need less.
            let (count, doubt) = if done > 0 && left > 16 {
                self.sixteen::<CHORDS, true>(path, &here, left, false)
            } else {
                self.sixteen::<CHORDS, false>(path, &here, left, done == 0)
            };
            room.fetch(used);
            room.raise_some();
            (used, doubts, done) = (used + count, doubts | doubt, done + 16);
            if left <= 16 {
                return (doubts == 0).then_some(used);
            }
            here.main = _mm512_add_epi32(here.main, self.main_advance);
            if (done as usize).is_multiple_of(LANES) {
                here = Here { main: here.main, ..self.at(done) };
            } else {
                here.a.advance(&self.axis_a);
                here.b.advance(&self.axis_b);
            }
        }
    }

    /// Where a run of [`LANES`] slabs begins; only for the first run on the main axis.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn at(&self, done: i32) -> Here {
        let (a, b) = (self.segment.faces(1, &self.axis_a, done), self.segment.faces(2, &self.axis_b, done));
        Here { main: self.main, a, b }
    }

    /// Writes the positions of sixteen slabs' marks, or of those that are left; how many, and which slabs are in doubt.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    fn sixteen<const CHORDS: bool, const INNER: bool>(
        &self,
        room: &mut [u32; 48],
        here: &Here,
        left: i32,
        starts: bool,
    ) -> (usize, __mmask16) {
        let valid = if INNER { 0xffff } else { _bzhi_u32(0xffff, left.min(16) as u32) as __mmask16 };
        let on_a = self.axis_a.crossings::<INNER>(&here.a, valid);
        let on_b = self.axis_b.crossings::<INNER>(&here.b, valid);
        let (either, both) = (on_a.crosses | on_b.crosses, on_a.crosses & on_b.crosses);
        let lead = self.order.lead(on_a.fraction, on_b.fraction);
        let a_leads = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(lead, _mm512_setzero_ps());
        let doubts = on_a.doubts | on_b.doubts | self.order.ties(lead, both);
        let here = _mm512_add_epi32(here.main, _mm512_add_epi32(here.a.part, here.b.part));
        let (before_a, behind_a) = (_mm512_add_epi32(here, on_a.enter), _mm512_add_epi32(here, on_a.leave));
        let first = _mm512_add_epi32(before_a, on_b.enter);
        let last = _mm512_add_epi32(behind_a, on_b.leave);
        let middle = _mm512_add_epi32(
            _mm512_mask_blend_epi32(a_leads, before_a, behind_a),
            _mm512_mask_blend_epi32(a_leads, on_b.leave, on_b.enter),
        );
        let mut counting = [valid, either, both];
        if CHORDS {
            let start_lane = __mmask16::from(starts);
            let end_lane = if INNER || left > 16 { 0 } else { 1 << (left - 1) };
            let long = self.ways.long(&on_a, &on_b, start_lane, end_lane);
            counting = std::array::from_fn(|i| counting[i] & long[i]);
        }
        let mut count = 0;
        for (positions, counting) in [first, last, middle].into_iter().zip(counting) {
            store(_mm512_maskz_compress_epi32(counting, positions), room, count);
            count += counting.count_ones() as usize;
        }
        (count, doubts)
    }
}

/// Where sixteen slabs begin.
struct Here {
    main: __m512i,
    a: Faces,
    b: Faces,
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn store(positions: __m512i, room: &mut [u32; 48], from: usize) {
    let into = &mut room[from..from + 16];
    // SAFETY: room for sixteen numbers is there.
    unsafe { _mm512_storeu_si512(into.as_mut_ptr().cast(), positions) }
}
