//! Which of two faces a segment crosses first, and how far it runs between.

use super::axis::Crossings;
use super::segment::Segment;
use crate::slab::{DOUBT_VOXELS, PER_ONE};
use std::arch::x86_64::*;

/// See `slab::Order`.
pub struct Order {
    constant: __m512,
    a: __m512,
    b: __m512,
    tie: __m512,
}

impl Order {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn new([a, b]: [f32; 2]) -> Self {
        let all = |x| _mm512_set1_ps(x);
        Self { constant: all(a - b), a: all(b * PER_ONE), b: all(a * PER_ONE), tie: all(DOUBT_VOXELS * (a + b)) }
    }

    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn lead(&self, fraction_a: __m512, fraction_b: __m512) -> __m512 {
        let of_a = _mm512_add_ps(self.constant, _mm512_mul_ps(fraction_a, self.a));
        _mm512_sub_ps(of_a, _mm512_mul_ps(fraction_b, self.b))
    }

    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn ties(&self, lead: __m512, both: __mmask16) -> __mmask16 {
        _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(both, _mm512_abs_ps(lead), self.tie)
    }
}

/// See `slab::Chords`.
pub struct Ways {
    per_voxel: [__m512; 2],
    lengths: [__m512; 2],
    way: __m512,
    chord_min: __m512,
}

impl Ways {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn new(segment: &Segment, chord_min: f32) -> Self {
        let [_, a, b, _] = segment.slopes;
        Self {
            per_voxel: [a, b].map(|slope| _mm512_set1_ps(1.0 / slope.max(1e-12))),
            lengths: segment.lengths.map(|length| _mm512_set1_ps(length)),
            way: _mm512_set1_ps((1.0 + a * a + b * b).sqrt()),
            chord_min: _mm512_set1_ps(chord_min),
        }
    }

    /// Slabs whose first, last and middle voxels have chords that count.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn long(
        &self,
        on_a: &Crossings,
        on_b: &Crossings,
        start_lane: __mmask16,
        end_lane: __mmask16,
    ) -> [__mmask16; 3] {
        let one = _mm512_set1_ps(1.0);
        let length = _mm512_mask_blend_ps(end_lane, one, self.lengths[1]);
        let length = _mm512_mask_blend_ps(start_lane, length, self.lengths[0]);
        let at = |fraction, per_voxel| {
            let left = _mm512_sub_ps(one, _mm512_mul_ps(fraction, _mm512_set1_ps(PER_ONE)));
            _mm512_min_ps(_mm512_mul_ps(left, per_voxel), length)
        };
        let (at_a, at_b) = (at(on_a.fraction, self.per_voxel[0]), at(on_b.fraction, self.per_voxel[1]));
        let either = |otherwise| {
            let a = _mm512_mask_blend_ps(on_a.crosses, otherwise, at_a);
            (a, _mm512_mask_blend_ps(on_b.crosses, otherwise, at_b))
        };
        let ((enter_a, enter_b), (leave_a, leave_b)) = (either(length), either(_mm512_setzero_ps()));
        let (enter, leave) = (_mm512_min_ps(enter_a, enter_b), _mm512_max_ps(leave_a, leave_b));
        let between = _mm512_max_ps(_mm512_sub_ps(leave, enter), _mm512_setzero_ps());
        [enter, _mm512_sub_ps(length, leave), between]
            .map(|way| _mm512_cmp_ps_mask::<_CMP_GE_OQ>(_mm512_mul_ps(way, self.way), self.chord_min))
    }
}
