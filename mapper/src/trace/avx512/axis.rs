//! What sixteen slabs have on a lesser axis.
#![allow(unsafe_code, reason = "a load")]

use super::segment::Faces;
use crate::marks::{STEPS, Steps};
use crate::slab::{DOUBT, FRACTION_BITS, ONE};
use std::arch::x86_64::*;

/// What sixteen slabs have on a lesser axis.
pub struct Crossings {
    /// Parts of positions where the segment enters and leaves each slab.
    pub enter: __m512i,
    pub leave: __m512i,
    /// Slabs in which it crosses a face.
    pub crosses: __mmask16,
    /// Where it enters, behind the point.
    pub fraction: __m512,
    /// Slabs that the line leaves too near to an edge.
    pub doubts: __mmask16,
}

/// A lesser axis, the same for all slabs.
pub struct Axis {
    low: __m512i,
    high: __m512i,
    rises: __m512i,
    slope_and_doubt: __m512i,
    /// What sixteen slabs add, and a tile to positions.
    pub advance: __m512i,
    pub tile: __m512i,
}

impl Axis {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn new(steps: &Steps, slope: i32) -> Self {
        let rises = _mm512_mullo_epi32(_mm512_set1_epi32(slope), lanes());
        let slope_and_doubt = _mm512_set1_epi32(slope + DOUBT);
        let (advance, tile) = (_mm512_set1_epi32(slope << 4), _mm512_set1_epi32(steps.tile));
        Self { low: loaded(steps, 0), high: loaded(steps, 1), rises, slope_and_doubt, advance, tile }
    }

    /// Parts of the positions of indices.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn parts(&self, indices: __m512i) -> __m512i {
        _mm512_permutex2var_epi32(self.low, indices, self.high)
    }

    /// `INNER`: the segment neither begins nor ends in these slabs.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn crossings<const INNER: bool>(&self, faces: &Faces, valid: __mmask16) -> Crossings {
        let line = _mm512_add_epi32(faces.near, self.rises);
        // A line that is higher by this lies in other voxels only where it is in doubt.
        let beyond = _mm512_add_epi32(line, self.slope_and_doubt);
        let doubtful = _mm512_set1_epi32((ONE - 1) & !(2 * DOUBT - 1));
        let doubts = _mm512_mask_testn_epi32_mask(valid, beyond, doubtful);
        let (mut near, mut far) = (line, beyond);
        if !INNER {
            near = _mm512_min_epi32(_mm512_max_epi32(near, faces.start), faces.end);
            far = _mm512_min_epi32(far, faces.end);
        }
        let [enter, leave] = [near, far].map(|at| _mm512_srli_epi32::<FRACTION_BITS>(at));
        Crossings {
            enter: self.parts(enter),
            leave: self.parts(leave),
            crosses: _mm512_mask_cmpneq_epi32_mask(valid, enter, leave),
            fraction: _mm512_cvtepi32_ps(_mm512_and_si512(near, _mm512_set1_epi32(ONE - 1))),
            doubts,
        }
    }
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
pub fn lanes() -> __m512i {
    _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
}

/// Half of a table.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn loaded(steps: &Steps, half: usize) -> __m512i {
    let (halves, _) = steps.parts.as_chunks::<{ STEPS / 2 }>();
    // SAFETY: sixteen numbers are there.
    unsafe { _mm512_loadu_si512(halves[half].as_ptr().cast()) }
}
