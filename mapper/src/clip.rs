//! Cutting a segment to a box, before it is walked. Units: voxels from the window's first voxel.
//!
//! Out: end points that lie inside the box, or on its lower faces, in `f64`. Source: Liang and Barsky 1984.

use std::ops::Range;

/// A box, half open on each axis.
#[derive(Clone, Copy, Debug)]
pub struct Space([[f64; 2]; 3]);

impl Space {
    /// The box of nothing.
    pub const EMPTY: Self = Self([[f64::INFINITY, f64::NEG_INFINITY]; 3]);

    /// The box of these voxels.
    pub fn of(voxels: &[Range<i32>; 3]) -> Self {
        Self(voxels.each_ref().map(|range| [range.start, range.end].map(f64::from)))
    }

    /// What lies in both.
    pub fn and(self, other: Self) -> Self {
        Self(std::array::from_fn(|axis| {
            let ([low, high], [other_low, other_high]) = (self.0[axis], other.0[axis]);
            [low.max(other_low), high.min(other_high)]
        }))
    }

    /// Whether a point lies within.
    #[inline]
    pub fn contains(&self, point: [f64; 3]) -> bool {
        // No branch between the axes: nearly all are inside.
        (0..3).fold(true, |inside, axis| inside & (self.0[axis][0] <= point[axis]) & (point[axis] < self.0[axis][1]))
    }

    /// The part of a finite segment that lies within; nothing where there is none.
    pub fn clip(&self, start: [f64; 3], end: [f64; 3]) -> Option<([f64; 3], [f64; 3])> {
        if self.contains(start) && self.contains(end) {
            return Some((start, end));
        }
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for axis in 0..3 {
            let length = end[axis] - start[axis];
            let [low, high] = self.0[axis];
            if length == 0.0 {
                if !(low <= start[axis] && start[axis] < high) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - start[axis]) / length, (high - start[axis]) / length);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        if enter >= leave {
            return None;
        }
        let at = |fraction: f64, axis: usize| {
            let c = match fraction {
                0.0 => start[axis],
                1.0 => end[axis],
                f => start[axis] + (end[axis] - start[axis]) * f,
            };
            // Rounding may put a cut end a hair outside, and the upper faces belong to the voxels beyond.
            c.clamp(self.0[axis][0], self.0[axis][1].next_down())
        };
        Some((std::array::from_fn(|axis| at(enter, axis)), std::array::from_fn(|axis| at(leave, axis))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::cell::Cell;
    use std::collections::BTreeSet;
    use tsense_geometry::{VoxelIndex, ray_walk};

    const SPACE: [Range<i32>; 3] = [2..12, 0..10, 5..9];

    fn clip(start: [f64; 3], end: [f64; 3], space: &[Range<i32>; 3]) -> Option<([f64; 3], [f64; 3])> {
        Space::of(space).clip(start, end)
    }

    #[test]
    fn a_segment_inside_stays_as_it_is_to_the_last_bit() {
        let (start, end) = ([2.1, 0.3, 5.7], [11.9, 9.99, 8.1]);
        assert_eq!(clip(start, end, &SPACE), Some((start, end)));
        assert_eq!(clip(start, start, &SPACE), Some((start, start)), "of no length too");
    }

    #[test]
    fn a_segment_outside_is_nothing_and_one_through_is_cut_at_the_faces() {
        assert_eq!(clip([0.0; 3], [1.0, 9.0, 7.0], &SPACE), None);
        assert_eq!(clip([12.0, 1.0, 6.0], [12.0, 9.0, 6.0], &SPACE), None, "the upper face is beyond");
        let (start, end) = clip([-8.0, 5.0, 6.0], [22.0, 5.0, 6.0], &SPACE).unwrap();
        assert_eq!((start, end[0].floor()), ([2.0, 5.0, 6.0], 11.0));
    }

    /// The whole path, and only then what lies in the box.
    fn plain(start: [f64; 3], end: [f64; 3]) -> BTreeSet<VoxelIndex> {
        ray_walk(start, end).filter(|v| (0..3).all(|axis| SPACE[axis].contains(&v[axis]))).collect()
    }

    #[test]
    fn clipping_first_and_walking_then_visits_what_walking_first_would() {
        let compared = Cell::new(0);
        let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(20_000));
        let point = || prop::array::uniform3(-10.0..25.0f64);
        let result = runner.run(&(point(), point()), |(start, end)| {
            let clipped = clip(start, end, &SPACE).map(|(a, b)| ray_walk(a, b).collect()).unwrap_or_default();
            prop_assert_eq!(plain(start, end), clipped);
            compared.set(compared.get() + 1);
            Ok(())
        });
        result.unwrap();
        assert!(compared.get() >= 20_000);
    }
}
