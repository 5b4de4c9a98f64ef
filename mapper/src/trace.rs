//! Marks the voxels that a segment crosses: the innermost loop, with run-time choice of the instruction set.
//!
//! In: a segment within the working space, voxels of the window; the weight of its beam; the least chord that counts.
//! Out: raised marks. Both instruction sets run the same code on the same numbers, so their marks are the same; where
//! the fast walk is in doubt, the plain one marks.

use crate::evidence::{FULL_MISS, NOTHING};
use crate::marks::{MarkField, Stride};
use crate::slab::{LANES, Margin, Run, Slabs, mask, select};
use crate::walk::walk;

/// What the processor offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// One voxel at a time in `f64`: the reference, for tests and measurements.
    Plain,
    /// What every processor of its kind has.
    Portable,
    /// 256-bit vectors of integers.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors with masks: the features F, BW, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// The best that this processor has.
    pub fn best() -> Self {
        *Self::available().last().unwrap_or(&Self::Portable)
    }

    /// All that this processor has, the fastest last.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![Self::Plain, Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            sets.extend(x86::has_avx2().then_some(Self::Avx2));
            sets.extend(x86::has_avx512().then_some(Self::Avx512));
        }
        sets
    }

    /// Its name for people and JSON.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "AVX-512",
        }
    }
}

/// Evidence of one beam.
#[derive(Clone, Copy)]
pub struct Miss {
    mark: u8,
    chord_min: f64,
}

impl Miss {
    /// Raises `mark` in voxels with a chord of at least `chord_min` voxels. With 0, for every voxel: a chord
    /// through an edge may come out a hair below zero.
    pub fn new(mark: u8, chord_min: f64) -> Self {
        Self { mark, chord_min: if chord_min > 0.0 { chord_min } else { f64::NEG_INFINITY } }
    }
}

/// Marks what the segment crosses as missed; how many voxels that are.
pub fn trace(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss, set: InstructionSet) -> u64 {
    let sure = match set {
        InstructionSet::Plain => false,
        InstructionSet::Portable => trace_slabs::<4, OneByOne>(field, start, end, miss),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2 => x86::trace_avx2(field, start, end, miss),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512 => x86::trace_avx512(field, start, end, miss),
    };
    if !sure {
        trace_plain(field, start, end, miss);
    }
    let steps = (0..3).map(|axis| (start[axis] as u64).abs_diff(end[axis] as u64));
    1 + steps.sum::<u64>()
}

/// One voxel at a time.
fn trace_plain(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) {
    walk(start, end, |voxel, chord| {
        let position = field.position(voxel);
        field.misses()[position] |= if chord >= miss.chord_min { miss.mark } else { NOTHING };
    });
}

/// Slab by slab, `WIDTH` at a time; false where the plain walk must mark.
#[inline(always)]
fn trace_slabs<const WIDTH: usize, P: Pack<WIDTH>>(
    field: &mut MarkField,
    start: [f64; 3],
    end: [f64; 3],
    miss: Miss,
) -> bool {
    let Some(slabs) = Slabs::of(start, end) else {
        return false;
    };
    let highest = field.position(std::array::from_fn(|axis| start[axis].max(end[axis]) as i32));
    let strides = slabs.axes.map(|axis| field.strides()[axis]);
    let (marks, path) = field.misses_and_path();
    let found = if miss.chord_min > 0.0 {
        find::<WIDTH, true, P>(path, &slabs, strides, miss.chord_min as f32)
    } else {
        find::<WIDTH, false, P>(path, &slabs, strides, 0.0)
    };
    let Some(positions) = found else {
        return false;
    };
    // The largest mark there is needs no reading of what was there.
    if miss.mark == FULL_MISS {
        mark_all(marks, positions, highest, |_| FULL_MISS)
    } else {
        mark_all(marks, positions, highest, |mark| mark | miss.mark)
    }
    true
}

/// Raises the marks at `positions`, none of which is above `highest`.
#[inline(always)]
#[allow(unsafe_code, reason = "a check for each mark costs a fifth of the walk")]
fn mark_all(marks: &mut [u8], positions: &[u32], highest: usize, raised: impl Fn(u8) -> u8) {
    assert!(highest < marks.len());
    for position in positions {
        debug_assert!(*position as usize <= highest);
        // SAFETY: where `find` is sure of a path, every index of it lies between those of the segment's ends, so none of
        // its positions is above that of their highest indices; this is below the length, as asserted.
        let mark = unsafe { marks.get_unchecked_mut(*position as usize) };
        *mark = raised(*mark);
    }
}

/// Writes to `path` where the marks of all voxels lie. Nothing where the path is in doubt. `CHORDS`: voxels whose chord
/// is below `chord_min` do not count.
#[inline(always)]
fn find<'a, const WIDTH: usize, const CHORDS: bool, P: Pack<WIDTH>>(
    path: &'a mut [u32],
    slabs: &Slabs,
    strides: [Stride; 3],
    chord_min: f32,
) -> Option<&'a [u32]> {
    let [main, a, b] = strides;
    let [turn_a, turn_b] = slabs.turns();
    let ((a, zero_a), (b, zero_b)) = (a.turned(turn_a), b.turned(turn_b));
    // A run is a whole number of bricks long, so the main axis' parts repeat.
    let along: [i32; LANES] = std::array::from_fn(|lane| main.at(slabs.main_at(lane as i32)));
    let zero = zero_a + zero_b - along[0];
    let mut least = Least { edge: [u32::MAX; WIDTH], tie: [u32::MAX; WIDTH] };
    let mut used = 0;
    for done in (0..slabs.count).step_by(LANES) {
        let run = slabs.run(done);
        let base = zero + main.at(slabs.main_at(done)) + a.at(run.anchors[0]) + b.at(run.anchors[1]);
        let here = Here { base, lesser: [a, b], chord_min };
        for (few, along) in along.as_chunks::<WIDTH>().0.iter().enumerate() {
            let lane = (few * WIDTH) as i32;
            if lane > run.end_lane {
                break;
            }
            let room = path.get_mut(used..used + 3 * WIDTH)?;
            used += positions::<WIDTH, CHORDS, P>(room, &run, lane, along, &here, &mut least);
        }
    }
    slabs.is_sure(least.margin()).then(|| &path[..used])
}

/// The least margins so far, lane by lane.
struct Least<const WIDTH: usize> {
    edge: [u32; WIDTH],
    tie: [u32; WIDTH],
}

impl<const WIDTH: usize> Least<WIDTH> {
    fn margin(&self) -> Margin {
        let least = |of: &[u32]| of.iter().fold(u32::MAX, |least, margin| least.min(*margin));
        Margin { edge: least(&self.edge), tie: least(&self.tie) }
    }
}

/// What turns a run's indices into positions.
struct Here {
    base: i32,
    lesser: [Stride; 2],
    chord_min: f32,
}

/// The first, last and middle voxels of `WIDTH` slabs; how many.
#[inline(always)]
fn positions<const WIDTH: usize, const CHORDS: bool, P: Pack<WIDTH>>(
    path: &mut [u32],
    run: &Run<'_>,
    from: i32,
    along: &[i32; WIDTH],
    here: &Here,
    least: &mut Least<WIDTH>,
) -> usize {
    let [a, b] = here.lesser;
    let [mut first, mut middle, mut last] = [([0; WIDTH], [0; WIDTH]); 3];
    for (i, along) in along.iter().enumerate() {
        let lane = from + i as i32;
        let slab = run.slab::<CHORDS>(lane);
        let counts = |chord: usize| if CHORDS { mask(slab.chords[chord] >= here.chord_min) } else { -1 };
        let at = here.base + along + a.at(slab.enter[0]) + b.at(slab.enter[1]);
        let (next_a, next_b) = (a.next(slab.enter[0]), b.next(slab.enter[1]));
        let [stays_a, stays_b] = slab.stays;
        first.0[i] = at as u32;
        last.0[i] = (at + (next_a & !stays_a) + (next_b & !stays_b)) as u32;
        middle.0[i] = (at + select(slab.a_leads, next_a, next_b)) as u32;
        first.1[i] = counts(0) & mask(lane <= run.end_lane);
        last.1[i] = counts(2) & !(stays_a & stays_b);
        middle.1[i] = counts(1) & !(stays_a | stays_b);
        least.edge[i] = least.edge[i].min(slab.margin.edge);
        least.tie[i] = least.tie[i].min(slab.margin.tie);
    }
    let mut used = if CHORDS {
        P::pack(first.0, first.1, path)
    } else {
        path[..WIDTH].copy_from_slice(&first.0);
        WIDTH.min((run.end_lane + 1 - from) as usize)
    };
    used += P::pack(last.0, last.1, &mut path[used..]);
    used + P::pack(middle.0, middle.1, &mut path[used..])
}

/// How an instruction set moves the lanes that count together.
trait Pack<const WIDTH: usize> {
    /// Writes those values whose mask is all bits, in order, and something else up to `WIDTH`; how many there are.
    fn pack(values: [u32; WIDTH], masks: [i32; WIDTH], into: &mut [u32]) -> usize;
}

/// One lane at a time.
struct OneByOne;

impl<const WIDTH: usize> Pack<WIDTH> for OneByOne {
    #[inline(always)]
    fn pack(values: [u32; WIDTH], masks: [i32; WIDTH], into: &mut [u32]) -> usize {
        let (into, mut used) = (&mut into[..WIDTH], 0);
        for lane in 0..WIDTH {
            into[used % WIDTH] = values[lane];
            used += usize::from(masks[lane] != 0);
        }
        used
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    //! The same code, compiled for wider vectors.
    #![allow(unsafe_code, reason = "a function for one instruction set may only be called where the processor has it")]

    use super::{MarkField, Miss, Pack, trace_slabs};
    use std::arch::is_x86_feature_detected;
    use std::arch::x86_64::*;
    use std::mem::transmute;

    /// Whether the processor has all that [`trace_avx2`] needs.
    pub fn has_avx2() -> bool {
        is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt")
    }

    /// Call only where [`has_avx2`]; it is asserted, at the cost of a load.
    pub fn trace_avx2(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        assert!(has_avx2());
        // SAFETY: the processor has these features, as just asserted.
        unsafe { compiled_avx2(field, start, end, miss) }
    }

    #[target_feature(enable = "avx2,popcnt")]
    fn compiled_avx2(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        trace_slabs::<8, Avx2>(field, start, end, miss)
    }

    /// Eight lanes by a table of which lanes stay.
    pub struct Avx2;

    impl Pack<8> for Avx2 {
        #[inline(always)]
        fn pack(values: [u32; 8], masks: [i32; 8], into: &mut [u32]) -> usize {
            // SAFETY: only the functions compiled for AVX2 and more name this type.
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
    fn pack_avx2(values: [u32; 8], masks: [i32; 8], into: &mut [u32]) -> usize {
        let into = &mut into[..8];
        let (values, masks): (__m256i, __m256i) = (bytemuck::cast(values), bytemuck::cast(masks));
        let set = _mm256_movemask_ps(_mm256_castsi256_ps(masks)) as u8;
        let order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(STAYING[usize::from(set)])));
        let packed: [u32; 8] = bytemuck::cast(_mm256_permutevar8x32_epi32(values, order));
        into.copy_from_slice(&packed);
        set.count_ones() as usize
    }

    /// Whether the processor has all that [`trace_avx512`] needs.
    pub fn has_avx512() -> bool {
        is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && has_avx2()
    }

    /// Call only where [`has_avx512`]; it is asserted.
    pub fn trace_avx512(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        assert!(has_avx512());
        // SAFETY: the processor has these features, as just asserted.
        unsafe { compiled_avx512(field, start, end, miss) }
    }

    #[target_feature(enable = "avx2,popcnt,avx512f,avx512bw,avx512dq,avx512vl")]
    fn compiled_avx512(field: &mut MarkField, start: [f64; 3], end: [f64; 3], miss: Miss) -> bool {
        trace_slabs::<16, Avx512>(field, start, end, miss)
    }

    /// Sixteen lanes by the instruction made for it.
    pub struct Avx512;

    impl Pack<16> for Avx512 {
        #[inline(always)]
        fn pack(values: [u32; 16], masks: [i32; 16], into: &mut [u32]) -> usize {
            // SAFETY: only the functions compiled for AVX-512 name this type.
            unsafe { pack_avx512(values, masks, into) }
        }
    }

    #[inline]
    #[target_feature(enable = "popcnt,avx512f,avx512dq")]
    fn pack_avx512(values: [u32; 16], masks: [i32; 16], into: &mut [u32]) -> usize {
        let into = &mut into[..16];
        // SAFETY: vectors and arrays of sixteen numbers, any of which is one.
        let (values, masks) =
            unsafe { (transmute::<[u32; 16], __m512i>(values), transmute::<[i32; 16], __m512i>(masks)) };
        let staying = _mm512_movepi32_mask(masks);
        let packed = _mm512_maskz_compress_epi32(staying, values);
        // SAFETY: the same the other way.
        into.copy_from_slice(&unsafe { transmute::<__m512i, [u32; 16]>(packed) });
        staying.count_ones() as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::segments;

    /// Lanes that count, by every way to pack that this processor has.
    fn packed<const WIDTH: usize, P: Pack<WIDTH>>(set: usize) -> Vec<u32> {
        let mut into = [u32::MAX; 32];
        let values = std::array::from_fn(|lane| 100 + lane as u32);
        let used = P::pack(values, std::array::from_fn(|lane| mask(set >> lane & 1 == 1)), &mut into);
        into[..used].to_vec()
    }

    #[test]
    fn all_ways_to_pack_keep_the_lanes_that_count_in_order() {
        for set in 0..1 << 16 {
            let expected = |lanes: u32| -> Vec<_> {
                (0..lanes).filter(|lane| set >> lane & 1 == 1).map(|lane| 100 + lane).collect()
            };
            assert_eq!(packed::<16, OneByOne>(set), expected(16));
            #[cfg(target_arch = "x86_64")]
            if x86::has_avx2() {
                assert_eq!(packed::<8, x86::Avx2>(set), expected(8));
            }
            #[cfg(target_arch = "x86_64")]
            if x86::has_avx512() {
                assert_eq!(packed::<16, x86::Avx512>(set), expected(16));
            }
        }
    }

    /// Segments traced, and voxels whose marks differ between two ways over the same segments.
    fn compare(count: usize, chord_min: f64, one: InstructionSet, other: InstructionSet) -> (usize, usize) {
        let (mut left, mut right) = (MarkField::new([2, 2, 3]), MarkField::new([2, 2, 3]));
        let mut compared = 0;
        for (i, (start, end)) in segments(count).enumerate() {
            let miss = Miss::new([1, 3, 7, 15][i % 4], chord_min);
            trace(&mut left, start, end, miss, one);
            trace(&mut right, start, end, miss, other);
            compared += 1;
        }
        let differing = left.misses().iter().zip(right.misses()).filter(|(l, r)| l != r).count();
        (compared, differing)
    }

    #[test]
    fn the_fast_marks_are_the_plain_ones() {
        assert_eq!(compare(20_000, 0.0, InstructionSet::best(), InstructionSet::Plain), (20_000, 0));
    }

    #[test]
    fn all_instruction_sets_mark_the_same() {
        for set in InstructionSet::available().into_iter().skip(2) {
            for chord_min in [0.0, 0.5] {
                assert_eq!(compare(20_000, chord_min, set, InstructionSet::Portable), (20_000, 0), "{set:?}");
            }
        }
        if InstructionSet::best().as_str() != "AVX-512" {
            eprintln!("SKIPPED: AVX-512, which this processor lacks");
        }
    }
}
