//! What sixteen slabs have on the main axis or on the third.
#![allow(unsafe_code, reason = "a load")]

use crate::marks::{STEPS, Steps};
use crate::runs::{DOUBT, Faces, ONE};
use std::arch::x86_64::*;

/// Where a segment enters and leaves sixteen slabs.
pub struct SlabFaces {
    pub enter: __m512i,
    pub leave: __m512i,
    /// Slabs that the line leaves too near to a face of this axis.
    pub doubts: __mmask16,
}

/// An axis, the same for all slabs.
pub struct Line {
    rises: __m512i,
    slope: __m512i,
}

impl Line {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn new(slope: u32) -> Self {
        Self { rises: _mm512_mullo_epi32(all(slope), lanes()), slope: all(slope) }
    }

    /// `INNER`: the segment neither begins nor ends in these slabs; otherwise it goes on behind the slabs of `inner`.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn faces<const INNER: bool>(&self, faces: &Faces, inner: __mmask16) -> SlabFaces {
        let line = _mm512_add_epi32(all(faces.base), self.rises);
        let far = _mm512_add_epi32(line, self.slope);
        let doubtful = all((ONE - 1) & !(2 * DOUBT - 1));
        let doubts = _mm512_mask_testn_epi32_mask(inner, _mm512_add_epi32(far, all(DOUBT)), doubtful);
        let (mut enter, mut leave) = (line, far);
        if !INNER {
            let end = all(faces.end);
            enter = _mm512_min_epu32(_mm512_max_epu32(line, all(faces.start)), end);
            leave = _mm512_mask_blend_epi32(inner, end, far);
        }
        SlabFaces { enter, leave, doubts }
    }
}

/// A table of what the indices from a tile's first on add to positions.
pub struct Parts {
    low: __m512i,
    high: __m512i,
}

impl Parts {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn new(steps: &Steps) -> Self {
        let [low, high] = bytemuck::cast_ref::<[i32; STEPS], [[i32; STEPS / 2]; 2]>(&steps.parts);
        Self { low: loaded(low), high: loaded(high) }
    }

    /// The parts of indices.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn of(&self, indices: __m512i) -> __m512i {
        _mm512_permutex2var_epi32(self.low, indices, self.high)
    }
}

/// The same number in all lanes.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
pub fn all(number: u32) -> __m512i {
    _mm512_set1_epi32(number as i32)
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
pub fn lanes() -> __m512i {
    _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
}

/// Sixteen numbers, a lane each.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
pub fn loaded(numbers: &[i32; 16]) -> __m512i {
    // SAFETY: sixteen numbers are there.
    unsafe { _mm512_loadu_si512(numbers.as_ptr().cast()) }
}
