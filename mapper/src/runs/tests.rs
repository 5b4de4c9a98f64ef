//! The voxels of all runs are those of the plain walk.

use super::*;
use crate::testing::segments;
use tsense_geometry::{VoxelIndex, ray_walk};

/// The fast walk's voxels, and whether its path is sure.
fn fast(start: [f64; 3], end: [f64; 3], voxels: &mut Vec<VoxelIndex>) -> bool {
    voxels.clear();
    let Some(segment) = Segment::of(start, end) else { return false };
    let mut path = Path { axes: segment.axes, voxels };
    if segment.is_flat() { flat_runs(&segment, 0.0, &mut path) } else { slab_runs(&segment, &mut path) }
}

struct Path<'a> {
    axes: [usize; 3],
    voxels: &'a mut Vec<VoxelIndex>,
}

impl TakeRuns for Path<'_> {
    fn take(&mut self, [first, last]: [i32; 2], [second, third]: [i32; 2]) {
        for main in first..=last {
            let mut voxel = [0; 3];
            for (axis, index) in self.axes.into_iter().zip([main, second, third]) {
                voxel[axis] = index;
            }
            self.voxels.push(voxel);
        }
    }
}

fn slab_runs(segment: &Segment, path: &mut Path) -> bool {
    let slabs = Slabs::of(segment);
    let rises = slabs.rises();
    let mut is_sure = true;
    for slab in 0..slabs.count {
        let lane = slab as usize % LANES;
        let group = slabs.group(slab - lane as i32);
        let left = slabs.count - slab;
        let of = group.slab(&slabs, [rises[0][lane], rises[1][lane]], left);
        is_sure &= of.doubt == 0;
        let main = |at: u32| (at >> FRACTION_BITS) as i32 + LANES as i32 * group.tiles[0];
        let row = of.third.map(|third| {
            [(slabs.first + slab) ^ slabs.turns[0], (third as i32 + LANES as i32 * group.tiles[1]) ^ slabs.turns[1]]
        });
        if of.third[0] == of.third[1] {
            path.take([main(of.enter), main(of.leave)], row[0]);
        } else {
            path.take([main(of.enter), main(of.between)], row[0]);
            path.take([main(of.between), main(of.leave)], row[1]);
        }
    }
    is_sure
}

#[test]
fn the_voxels_are_the_plain_walks_on_more_than_a_million_segments() {
    let (mut compared, mut left, mut random, mut random_left) = (0u32, 0u32, 0u32, 0u32);
    let (mut voxels, mut plain) = (Vec::new(), Vec::new());
    for (i, (start, end)) in segments(1_700_000).enumerate() {
        let is_sure = fast(start, end, &mut voxels);
        if is_sure {
            plain.clear();
            plain.extend(ray_walk(start, end));
            plain.sort_unstable();
            voxels.sort_unstable();
            assert!(voxels == plain, "{start:?} {end:?}");
            assert_eq!(Segment::of(start, end).unwrap().voxels(), plain.len() as u64);
            compared += 1;
        } else {
            left += 1;
        }
        random += u32::from(i % 8 < 3);
        random_left += u32::from(i % 8 < 3 && !is_sure);
    }
    assert!(compared >= 1_000_000, "{compared} compared, {left} left to the plain walk");
    assert!(random_left * 200 < random, "{random_left} of {random} random segments are too many");
}

#[test]
fn axes_are_in_the_order_of_their_lengths_and_the_longest_rises() {
    for (start, end) in segments(10_000) {
        let Some(segment) = Segment::of(start, end) else { continue };
        assert!(segment.lengths.is_sorted_by(|longer, other| longer >= other), "{segment:?}");
        assert!(segment.start[0] < segment.end[0]);
        let mut axes = segment.axes;
        axes.sort_unstable();
        assert_eq!(axes, [0, 1, 2]);
        for (i, axis) in segment.axes.into_iter().enumerate() {
            assert_eq!(segment.lengths[i], (end[axis] - start[axis]).abs());
        }
    }
}
