//! What a segment's slabs share, and where its lesser axes are from run to run.

use super::axis::Axis;
use crate::marks::TILE_BITS;
use crate::slab::{FRACTION_BITS, LANES, LENGTH_MIN, LONG_BITS, LONG_ONE};
use std::arch::x86_64::*;

/// A segment's axes in the order main, lesser, lesser, each turned so that the segment rises.
pub struct Segment {
    pub axes: [usize; 3],
    /// A bit for each of these that is turned round: index `i` is `-1 - i` then.
    pub turns: u8,
    /// Slabs in all, and the index of the first one.
    pub count: i32,
    pub first: i32,
    /// In long fixed point; the main axis' numbers say nothing.
    start: [i64; 4],
    end: [i64; 4],
    origin: [i64; 4],
    slope: [i64; 4],
    /// Voxels along each axis for one along the main axis.
    pub slopes: [f32; 4],
    /// Ways along the main axis in the first and the last slab.
    pub lengths: [f32; 2],
}

/// Orders of the axes: the main one, then the two others. By whether |x| >= |y| (1), |x| >= |z| (2), |y| >= |z| (4).
const ORDERS: [[u8; 3]; 8] = {
    let [x, y, z] = [[0, 1, 2], [1, 0, 2], [2, 0, 1]];
    [z, z, z, x, y, y, y, x]
};

impl Segment {
    /// Nothing where the segment is too short for slabs. See `Slabs::of`.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn of(start: [f64; 3], end: [f64; 3]) -> Option<Self> {
        let [start_xyz, end_xyz] = [start, end].map(|[x, y, z]| _mm256_set_pd(0.0, z, y, x));
        let way = _mm256_sub_pd(end_xyz, start_xyz);
        let reach = _mm256_andnot_pd(_mm256_set1_pd(-0.0), way);
        let (one, other) =
            (_mm256_permute4x64_pd::<0b00_01_00_00>(reach), _mm256_permute4x64_pd::<0b00_10_10_01>(reach));
        let axes = ORDERS[usize::from(_mm256_cmp_pd_mask::<_CMP_GE_OQ>(one, other) & 7)];
        let [m, a, b] = axes.map(i64::from);
        let order = _mm256_set_epi64x(3, b, a, m);
        let ordered = |xyz| _mm256_permutexvar_pd(order, xyz);
        let (start, end, way) = (ordered(start_xyz), ordered(end_xyz), ordered(way));
        let main_way = _mm256_cvtsd_f64(way);
        let main_length = main_way.abs();
        if main_length < LENGTH_MIN {
            return None;
        }
        let up = main_way > 0.0;
        let (from, to) = (whole(start), whole(end));
        let into = |at: __m256d, index: i32| {
            let c = _mm256_cvtsd_f64(at);
            if up { c - f64::from(index) } else { f64::from(index) + 1.0 - c }
        };
        let (before_start, before_end) = (into(start, from), into(end, to));
        let slopes = _mm256_mul_pd(way, _mm256_set1_pd(1.0 / main_length));
        let origin = _mm256_sub_pd(start, _mm256_mul_pd(slopes, _mm256_set1_pd(before_start)));
        let falls = _mm256_cmp_pd_mask::<_CMP_LT_OQ>(slopes, _mm256_setzero_pd());
        let steep = _mm256_andnot_pd(_mm256_set1_pd(-0.0), slopes);
        let turned = |at| _mm256_mask_xor_epi64(fixed(at), falls, fixed(at), _mm256_set1_epi64x(-1));
        let count = (to - from).abs() + 1;
        let lengths = if count == 1 { [main_length; 2] } else { [1.0 - before_start, before_end] };
        Some(Self {
            axes: axes.map(usize::from),
            turns: falls,
            count,
            first: from ^ -i32::from(!up),
            start: longs(turned(start)),
            end: longs(turned(end)),
            origin: longs(turned(origin)),
            slope: longs(fixed(steep)),
            slopes: singles(_mm256_cvtpd_ps(steep)),
            lengths: lengths.map(|length| length as f32),
        })
    }

    /// Voxels that the segment crosses.
    pub fn voxels(&self) -> u64 {
        let rise = |axis: usize| (self.end[axis] >> LONG_BITS) - (self.start[axis] >> LONG_BITS);
        (i64::from(self.count) + rise(1) + rise(2)) as u64
    }

    /// What one slab adds to a lesser axis, in the fixed point of a lane.
    pub fn short_slope(&self, axis: usize) -> i32 {
        (self.slope[axis] >> (LONG_BITS - FRACTION_BITS)) as i32
    }

    /// A lesser axis at the run of [`LANES`] slabs that begins `done` after the first.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn faces(&self, axis: usize, on: &Axis, done: i32) -> Faces {
        let begin = self.origin[axis].wrapping_add(self.slope[axis].wrapping_mul(done.into()));
        let anchor = begin >> (LONG_BITS + TILE_BITS);
        let from_anchor = |long: i64| {
            let from_anchor = long.wrapping_sub(anchor << (LONG_BITS + TILE_BITS));
            _mm512_set1_epi32((from_anchor >> (LONG_BITS - FRACTION_BITS)) as i32)
        };
        let ends = self.count - 1 - done < LANES as i32;
        Faces {
            part: _mm512_mullo_epi32(on.tile, _mm512_set1_epi32(anchor as i32)),
            near: from_anchor(begin),
            start: if done == 0 { from_anchor(self.start[axis]) } else { _mm512_set1_epi32(-BEYOND) },
            end: if ends { from_anchor(self.end[axis]) } else { _mm512_set1_epi32(BEYOND) },
        }
    }
}

/// Farther than any face of a run, and small enough to stay so when the anchor moves.
const BEYOND: i32 = 1 << 30;

/// Index of the voxel of the first number, which is not below zero.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn whole(at: __m256d) -> i32 {
    _mm_cvttsd_i32(_mm256_castpd256_pd128(at))
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn fixed(at: __m256d) -> __m256i {
    _mm256_cvttpd_epi64(_mm256_mul_pd(at, _mm256_set1_pd(LONG_ONE)))
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn longs(vector: __m256i) -> [i64; 4] {
    bytemuck::cast(vector)
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
fn singles(vector: __m128) -> [f32; 4] {
    bytemuck::cast(vector)
}

/// A lesser axis at the first of sixteen slabs; the same number in all lanes, for what is a vector stays one.
#[derive(Clone, Copy)]
pub struct Faces {
    /// What the tile from which positions count adds to marks' positions.
    pub part: __m512i,
    /// Where the line, the segment's start and its end are, in fixed point from that tile.
    pub near: __m512i,
    pub start: __m512i,
    pub end: __m512i,
}

impl Faces {
    /// The same sixteen slabs on, which begin behind the start.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn advance(&mut self, axis: &Axis) {
        let near = _mm512_add_epi32(self.near, axis.advance);
        let tiles = _mm512_srli_epi32::<{ FRACTION_BITS + TILE_BITS }>(near);
        let moved = _mm512_slli_epi32::<{ FRACTION_BITS + TILE_BITS }>(tiles);
        self.part = _mm512_add_epi32(self.part, _mm512_mullo_epi32(tiles, axis.tile));
        self.near = _mm512_sub_epi32(near, moved);
        self.end = _mm512_sub_epi32(self.end, moved);
        self.start = _mm512_set1_epi32(-BEYOND);
    }
}
