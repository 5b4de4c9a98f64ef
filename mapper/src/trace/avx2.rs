//! The portable walk, compiled for 256-bit vectors.
#![allow(unsafe_code, reason = "a function for one instruction set may only be called where the processor has it")]

use super::portable::{Pack, trace_runs};
use super::{Miss, Walk, Work};
use crate::marks::MarkField;
use std::arch::is_x86_feature_detected;
use std::arch::x86_64::*;

/// Whether the processor has all that [`run`] needs.
pub fn is_here() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt")
}

/// Does work on this instruction set. Call only where it [`is_here`]; that is asserted.
pub fn run<J: Work>(work: J) -> J::Out {
    assert!(is_here());
    // SAFETY: the processor has these features, as just asserted.
    unsafe { run_here(work) }
}

#[target_feature(enable = "avx2,popcnt")]
fn run_here<J: Work>(work: J) -> J::Out {
    work.on::<Avx2>()
}

/// Eight lanes, packed by a table of which lanes stay.
pub struct Avx2;

impl Walk for Avx2 {
    #[inline(always)]
    fn try_trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64> {
        // SAFETY: only [`run`] walks so.
        unsafe { trace_here(field, start, end, miss) }
    }
}

#[inline(never)]
#[target_feature(enable = "avx2,popcnt")]
fn trace_here(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> Option<u64> {
    trace_runs::<8, Avx2>(field, start, end, miss)
}

impl Pack<8> for Avx2 {
    #[inline(always)]
    fn pack(values: [u32; 8], masks: [u32; 8], into: &mut [u32]) -> usize {
        // SAFETY: only [`run`] walks so.
        unsafe { pack_avx2(values, masks, into) }
    }
}

/// For each set of lanes, these in order.
static STAYING: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut set = 0;
    while set < 256 {
        let (mut lane, mut used) = (0, 0);
        while lane < 8 {
            if set >> lane & 1 == 1 {
                table[set][used] = lane as u8;
                used += 1;
            }
            lane += 1;
        }
        set += 1;
    }
    table
};

#[inline]
#[target_feature(enable = "avx2,popcnt")]
fn pack_avx2(values: [u32; 8], masks: [u32; 8], into: &mut [u32]) -> usize {
    let into = &mut into[..8];
    let (values, masks): (__m256i, __m256i) = (bytemuck::cast(values), bytemuck::cast(masks));
    let set = _mm256_movemask_ps(_mm256_castsi256_ps(masks)) as u8;
    let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(STAYING[usize::from(set)])));
    let packed: [u32; 8] = bytemuck::cast(_mm256_permutevar8x32_epi32(values, order));
    into.copy_from_slice(&packed);
    set.count_ones() as usize
}
