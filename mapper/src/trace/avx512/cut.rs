//! A segment cut into slabs, its axes all at once.

use crate::runs::{LENGTH_MIN, LONG_BITS, LONG_ONE, Line, ORDERS, STEEP_MAX, Slabs, THIRD_MIN, doubt};
use std::arch::x86_64::*;

/// A segment that is not flat, cut. See `Segment` and `Slabs`.
pub struct Cut {
    /// The main axis, the second longest and the third.
    pub axes: [usize; 3],
    /// How far it runs along each.
    pub lengths: [f64; 3],
    pub slabs: Slabs,
    /// Voxels that it crosses.
    pub voxels: u64,
}

impl Cut {
    /// Nothing where the segment is flat, or too short to have a direction.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn of(start: [f64; 3], end: [f64; 3]) -> Option<Self> {
        let [start, end] = [start, end].map(|[x, y, z]| _mm256_set_pd(0.0, z, y, x));
        let reach = absolute(_mm256_sub_pd(end, start));
        let axes = order_of(reach);
        // The fourth lane is the main axis once more.
        let order = _mm256_set_epi64x(axes[0].into(), axes[2].into(), axes[1].into(), axes[0].into());
        let [start, end, reach] = [start, end, reach].map(|xyz| _mm256_permutexvar_pd(order, xyz));
        let lengths: [f64; 4] = doubles(reach);
        let [main, second, third, _] = lengths;
        if main < LENGTH_MIN || main > STEEP_MAX * second {
            return None;
        }
        let rises = _mm256_cmp_pd_mask::<_CMP_LE_OQ>(start, end);
        let keeps = if rises & 1 == 1 { 0xf } else { 0 };
        let (start, end) = (_mm256_mask_blend_pd(keeps, end, start), _mm256_mask_blend_pd(keeps, start, end));
        let falls = _mm256_cmp_pd_mask::<_CMP_LT_OQ>(end, start);
        let turned = |at: __m256d| _mm256_mask_xor_epi64(fixed(at), falls, fixed(at), _mm256_set1_epi64x(-1));
        let (from, to) = (turned(start), turned(end));
        let faces = longs(_mm256_sub_epi64(voxels(to), voxels(from)));
        let (first, begin) = (longs(voxels(from))[1] as i32, doubles(start)[1]);
        let before = if falls & 2 == 0 { begin - f64::from(first) } else { f64::from(-first) - begin };
        let per = _mm256_set_pd(third.max(THIRD_MIN), second, second, second);
        let slopes = _mm256_div_pd(reach, per);
        let steps = _mm256_mask_sub_pd(slopes, falls, _mm256_setzero_pd(), slopes);
        let origin = _mm256_sub_pd(start, _mm256_mul_pd(steps, _mm256_set1_pd(before)));
        let [from, to, origin, slope] = [from, to, turned(origin), fixed(slopes)].map(|axes| longs(axes));
        let line = |axis: usize| Line { start: from[axis], end: to[axis], origin: origin[axis], slope: slope[axis] };
        let per_third = doubles(slopes)[3] as f32;
        Some(Self {
            axes: axes.map(usize::from),
            lengths: [main, second, third],
            slabs: Slabs {
                count: faces[1] as i32 + 1,
                first,
                turns: [-i32::from(falls >> 1 & 1), -i32::from(falls >> 2 & 1)],
                main: line(0),
                third: line(2),
                per_third,
                doubt: doubt(per_third),
            },
            voxels: (1 + faces[0] + faces[1] + faces[2]) as u64,
        })
    }
}

/// Axes by their lengths, the longest first.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn order_of(reach: __m256d) -> [u8; 3] {
    let (one, other) = (_mm256_permute4x64_pd::<0b00_01_00_00>(reach), _mm256_permute4x64_pd::<0b00_10_10_01>(reach));
    ORDERS[usize::from(_mm256_cmp_pd_mask::<_CMP_GE_OQ>(one, other) & 7)]
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn absolute(way: __m256d) -> __m256d {
    _mm256_andnot_pd(_mm256_set1_pd(-0.0), way)
}

/// Long fixed point, cut.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn fixed(at: __m256d) -> __m256i {
    _mm256_cvttpd_epi64(_mm256_mul_pd(at, _mm256_set1_pd(LONG_ONE)))
}

/// Indices of long fixed point.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn voxels(at: __m256i) -> __m256i {
    _mm256_srai_epi64::<LONG_BITS>(at)
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn longs(vector: __m256i) -> [i64; 4] {
    bytemuck::cast(vector)
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn doubles(vector: __m256d) -> [f64; 4] {
    bytemuck::cast(vector)
}
