//! The bits of runs in their rows.

use super::axis::{all, loaded};
use crate::marks::IN_TILE;
use crate::runs::{FRACTION_BITS, RUN_MAX};
use std::arch::x86_64::*;

/// What makes bits of where runs begin and end.
pub struct Bits {
    /// Ones for runs that end so many voxels behind their first; none for the last number, which is -1.
    ones: __m512i,
    /// The way along the main axis that counts.
    along_min: __m512i,
}

impl Bits {
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn new(along_min: u32) -> Self {
        const ONES: [i32; 16] = {
            let (mut ones, mut voxels) = ([0; 16], 1);
            while voxels <= RUN_MAX {
                ones[voxels - 1] = (1 << voxels) - 1;
                voxels += 1;
            }
            ones
        };
        Self { ones: loaded(&ONES), along_min: all(along_min) }
    }

    /// The bits of runs in the rows of the tiles where they begin. See `bits_of`.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi2,popcnt")]
    pub fn of<const CHORDS: bool>(&self, enter: __m512i, leave: __m512i) -> __m512i {
        let voxel = |at| _mm512_srli_epi32::<FRACTION_BITS>(at);
        if CHORDS {
            let before = _mm512_sub_epi32(self.along_min, all(1));
            let first = voxel(_mm512_add_epi32(enter, before));
            let last = voxel(_mm512_sub_epi32(leave, self.along_min));
            let counts = _mm512_cmpge_epi32_mask(_mm512_sub_epi32(leave, enter), self.along_min);
            let ones = _mm512_maskz_permutexvar_epi32(counts, _mm512_sub_epi32(last, first), self.ones);
            let tile = _mm512_andnot_si512(all(IN_TILE as u32), voxel(enter));
            _mm512_sllv_epi32(ones, _mm512_sub_epi32(first, tile))
        } else {
            let (first, last) = (voxel(enter), voxel(leave));
            let ones = _mm512_permutexvar_epi32(_mm512_sub_epi32(last, first), self.ones);
            _mm512_sllv_epi32(ones, _mm512_and_si512(first, all(IN_TILE as u32)))
        }
    }
}
