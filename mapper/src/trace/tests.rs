//! All instruction sets find the same path, and it is that of the plain walk.

use super::portable::{OneByOne, Pack};
use super::*;
use crate::evidence::Passed;
use crate::marks::{IN_TILE, TakenTile};
use crate::runs::mask;
use crate::testing::segments;
use tsense_geometry::VoxelIndex;

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
        let expected =
            |lanes: u32| -> Vec<_> { (0..lanes).filter(|lane| set >> lane & 1 == 1).map(|lane| 100 + lane).collect() };
        assert_eq!(packed::<16, OneByOne>(set), expected(16));
        #[cfg(target_arch = "x86_64")]
        if avx2::is_here() {
            assert_eq!(packed::<8, avx2::Avx2>(set), expected(8));
        }
    }
}

struct Tracing<'a> {
    field: &'a mut MarkField,
    start: [f64; 3],
    end: [f64; 3],
    miss: Miss,
}

impl Work for Tracing<'_> {
    type Out = Option<u64>;

    #[inline(always)]
    fn on<W: Walk>(self) -> Option<u64> {
        W::try_trace(self.field, self.start, self.end, self.miss)
    }
}

/// The runs of one segment, rows and bits, in order, and how many voxels it crosses; nothing where the walk is in
/// doubt.
fn path(
    field: &mut MarkField,
    set: InstructionSet,
    segment: ([f64; 3], [f64; 3]),
    chord_min: f64,
) -> Option<(Vec<(u32, u32)>, u64)> {
    let miss = Miss::new(Weight::FULL, chord_min);
    let crossed = set.run(Tracing { field, start: segment.0, end: segment.1, miss });
    let mut runs = field.forget_found();
    runs.retain(|(_, bits)| *bits != 0);
    runs.sort_unstable();
    crossed.map(|crossed| (runs, crossed))
}

/// Each voxel of runs along an axis on its own: its row, and its bit of that.
fn voxels(field: &MarkField, main: usize, runs: &[(u32, u32)]) -> Vec<(u32, u32)> {
    let next = field.strides(main)[main].tile() as u32;
    let mut voxels: Vec<_> = runs
        .iter()
        .flat_map(|(row, bits)| (0..32).filter(move |bit| bits >> bit & 1 == 1).map(move |bit| (*row, bit)))
        .map(|(row, bit)| if bit < 16 { (row, bit) } else { (row + next, bit - 16) })
        .collect();
    voxels.sort_unstable();
    voxels
}

/// The same of the plain walk.
fn plain_voxels(field: &MarkField, (start, end): ([f64; 3], [f64; 3]), main: usize, chord_min: f64) -> Vec<(u32, u32)> {
    let (strides, mut voxels) = (field.strides(main), Vec::new());
    walk(start, end, |voxel, chord| {
        let row = field.first_row(main) + (0..3).map(|axis| strides[axis].at(voxel[axis])).sum::<i32>();
        voxels.extend((chord >= chord_min).then_some((row as u32, (voxel[main] & IN_TILE) as u32)));
    });
    voxels.sort_unstable();
    voxels
}

fn field() -> MarkField {
    let mut field = MarkField::new([2, 2, 3]);
    for place in 0..12 {
        field.reach([place % 2, place / 2 % 2, place / 4]);
    }
    field
}

/// All misses of a field, taken out of it: bricks by their first voxels.
fn misses(field: &mut MarkField) -> Vec<(VoxelIndex, Passed)> {
    let (mut tile, mut bricks, mut from) = (TakenTile::none(), Vec::new(), 0);
    while field.take_tile(from, &mut tile) {
        for brick in (0..64).filter(|brick| tile.bricks() >> brick & 1 == 1).collect::<Vec<_>>() {
            bricks.push((tile.voxel(brick), field.take_brick(&mut tile, brick)));
        }
        from = tile.next();
    }
    bricks
}

/// Every second one reaches into other blocks, and over more than 100 slabs.
fn stretched(count: usize) -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
    let stretch = |[x, y, z]: [f64; 3]| [1.9 * x, 1.9 * y, z];
    segments(count)
        .enumerate()
        .map(move |(i, (start, end))| if i / 8 % 2 == 0 { (start, end) } else { (stretch(start), stretch(end)) })
}

#[test]
fn all_instruction_sets_find_the_same_path_and_doubt_the_same() {
    let (mut field, mut sure) = (field(), 0);
    for set in InstructionSet::available().into_iter().skip(2) {
        for chord_min in [0.0, 0.5] {
            for segment in stretched(100_000) {
                let portable = path(&mut field, InstructionSet::Portable, segment, chord_min);
                assert_eq!(path(&mut field, set, segment, chord_min), portable, "{set:?} {chord_min} {segment:?}");
                sure += usize::from(portable.is_some());
            }
        }
    }
    if InstructionSet::best() == InstructionSet::Portable {
        eprintln!("SKIPPED: this processor has neither AVX2 nor AVX-512");
    } else {
        assert!(sure > 100_000, "{sure} sure paths");
    }
}

#[test]
fn the_best_path_is_the_plain_walks() {
    let (mut field, mut sure) = (field(), 0);
    for segment in stretched(100_000) {
        let Some((found, crossed)) = path(&mut field, InstructionSet::best(), segment, 0.0) else { continue };
        let main = Segment::of(segment.0, segment.1).unwrap().axes[0];
        let plain = plain_voxels(&field, segment, main, f64::NEG_INFINITY);
        assert_eq!((voxels(&field, main, &found), crossed), (plain.clone(), plain.len() as u64), "{segment:?}");
        sure += 1;
    }
    assert!(sure > 50_000, "{sure} sure paths");
}

#[test]
fn the_voxels_that_count_are_those_with_chords_that_do() {
    let (mut field, mut sure, mut rounded) = (field(), 0, 0);
    for segment in stretched(40_000) {
        for chord_min in [0.1, 0.5, 0.93] {
            let Some((found, _)) = path(&mut field, InstructionSet::best(), segment, chord_min) else { continue };
            let main = Segment::of(segment.0, segment.1).unwrap().axes[0];
            let found = voxels(&field, main, &found);
            let [more, same, fewer] = [-1e-4, 0.0, 1e-4].map(|by| plain_voxels(&field, segment, main, chord_min + by));
            assert!(fewer.iter().all(|voxel| found.contains(voxel)), "{segment:?} {chord_min}");
            assert!(found.iter().all(|voxel| more.contains(voxel)), "{segment:?} {chord_min}");
            rounded += u32::from(found != same);
            sure += 1;
        }
    }
    assert!(sure > 50_000 && rounded * 20 < sure, "{rounded} of {sure} paths");
}

#[test]
fn what_the_window_does_not_hold_is_in_doubt() {
    let (mut field, inside) = (field(), [5.51, 6.37, 7.83]);
    for set in InstructionSet::available().into_iter().skip(1) {
        assert!(path(&mut field, set, (inside, [190.31, 100.72, 100.13]), 0.0).is_some());
        for outside in [[f64::NAN, 6.0, 9.0], [-0.5, 6.0, 9.0], [5.0, 200.0, 9.0], [5.0, 6.0, f64::INFINITY]] {
            for segment in [(inside, outside), (outside, inside)] {
                assert_eq!(path(&mut field, set, segment, 0.0), None, "{set:?} {segment:?}");
            }
        }
    }
}

/// The fast walk, and the plain one where that is in doubt.
struct Whole<'a>(Tracing<'a>);
impl Work for Whole<'_> {
    type Out = u64;

    #[inline(always)]
    fn on<W: Walk>(self) -> u64 {
        let Tracing { field, start, end, miss } = self.0;
        trace::<W>(field, start, end, miss)
    }
}

#[test]
fn marks_of_many_segments_are_the_plain_walks() {
    let mut plain = field();
    let mut fields: Vec<_> = InstructionSet::available().into_iter().skip(1).map(|set| (set, field())).collect();
    for (i, (start, end)) in stretched(3_000).enumerate() {
        // Another weight for every few paths: those that wait are marked with their own.
        let miss = Miss::new(Weight::new([0.25, 0.5, 1.0, 1.0, 1.0][i / 7 % 5]), 0.0);
        InstructionSet::Plain.run(Whole(Tracing { field: &mut plain, start, end, miss }));
        for (set, field) in &mut fields {
            set.run(Whole(Tracing { field, start, end, miss }));
        }
    }
    let plain = misses(&mut plain);
    assert!(plain.iter().map(|(_, passed)| passed.any().count_ones()).sum::<u32>() > 100_000);
    for (set, mut field) in fields {
        assert!(misses(&mut field) == plain, "{set:?}");
        assert_eq!(misses(&mut field), [], "all were taken");
    }
}

#[test]
fn what_is_in_doubt_is_marked_by_the_plain_walk() {
    let (mut best, mut plain, mut doubts) = (field(), field(), 0);
    for segment in
        segments(20_000).filter(|segment| path(&mut field(), InstructionSet::best(), *segment, 0.0).is_none()).take(40)
    {
        doubts += 1;
        let (start, end) = segment;
        for (field, set) in [(&mut best, InstructionSet::best()), (&mut plain, InstructionSet::Plain)] {
            set.run(Whole(Tracing { field, start, end, miss: Miss::new(Weight::FULL, 0.0) }));
        }
        assert!(misses(&mut best) == misses(&mut plain), "{segment:?}");
    }
    assert_eq!(doubts, 40);
}
