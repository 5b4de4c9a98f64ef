//! The exact ray walk: every voxel whose faces a segment crosses, in order, end points being real numbers.
//!
//! This is the plain version, one voxel a step in `f64` (Amanatides and Woo 1987); the mapper's fast walk must
//! visit the same voxels. In: two points in voxel units (metres divided by the voxel size). Out: voxel indices,
//! 6-connected, from the start's voxel to the end's. Count: `1 + |dx| + |dy| + |dz|` in index steps, which is
//! below the bound of thesis (2-2), `sqrt(3) L / S + 4`.

use crate::voxel::VoxelIndex;

/// Iterator over the voxels that a segment crosses. Made by [`ray_walk`].
#[derive(Clone, Debug)]
pub struct RayWalk {
    at: VoxelIndex,
    step: [i32; 3],
    /// Segment parameter, in [0, 1], at which the next face of each axis is crossed.
    next_face: [f64; 3],
    per_voxel: [f64; 3],
    faces_left: [u32; 3],
    done: bool,
}

/// Walks from `start` to `end`, both in voxel units and finite.
pub fn ray_walk(start: [f64; 3], end: [f64; 3]) -> RayWalk {
    let mut walk = RayWalk {
        at: [0; 3],
        step: [0; 3],
        next_face: [f64::INFINITY; 3],
        per_voxel: [f64::INFINITY; 3],
        faces_left: [0; 3],
        done: false,
    };
    for axis in 0..3 {
        walk.set_axis(axis, start[axis], end[axis]);
    }
    walk
}

impl RayWalk {
    fn set_axis(&mut self, axis: usize, start: f64, end: f64) {
        let (first, last) = (start.floor() as i32, end.floor() as i32);
        self.at[axis] = first;
        self.faces_left[axis] = first.abs_diff(last);
        if first == last {
            return;
        }
        let length = end - start;
        self.step[axis] = (last - first).signum();
        let face = if last > first { f64::from(first) + 1.0 } else { f64::from(first) };
        self.next_face[axis] = (face - start) / length;
        self.per_voxel[axis] = 1.0 / length.abs();
    }

    /// The axis whose face comes next; the lowest axis wins where the segment passes through an edge.
    fn next_axis(&self) -> Option<usize> {
        (0..3)
            .filter(|&axis| self.faces_left[axis] > 0)
            .min_by(|&a, &b| self.next_face[a].total_cmp(&self.next_face[b]))
    }
}

impl Iterator for RayWalk {
    type Item = VoxelIndex;

    fn next(&mut self) -> Option<VoxelIndex> {
        if self.done {
            return None;
        }
        let here = self.at;
        match self.next_axis() {
            None => self.done = true,
            Some(axis) => {
                self.at[axis] += self.step[axis];
                self.next_face[axis] += self.per_voxel[axis];
                self.faces_left[axis] -= 1;
            }
        }
        Some(here)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn walk(start: [f64; 3], end: [f64; 3]) -> Vec<VoxelIndex> {
        ray_walk(start, end).collect()
    }

    #[test]
    fn a_flat_diagonal_visits_the_voxels_a_hand_would_draw() {
        let expected = vec![[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 0]];
        assert_eq!(walk([0.5, 0.25, 0.5], [2.5, 1.75, 0.5]), expected);
        assert_eq!(walk([0.2, 0.2, 0.2], [0.8, 0.3, 0.9]), vec![[0, 0, 0]]);
        assert_eq!(walk([0.5, 0.5, 0.5], [-1.5, 0.5, 0.5]), vec![[0, 0, 0], [-1, 0, 0], [-2, 0, 0]]);
    }

    proptest! {
        #[test]
        fn the_chain_is_connected_reaches_the_end_and_stays_on_the_segment(
            start in prop::array::uniform3(-50.0..50.0f64),
            end in prop::array::uniform3(-50.0..50.0f64),
        ) {
            let chain = walk(start, end);
            prop_assert_eq!(chain[0], start.map(|c| c.floor() as i32));
            prop_assert_eq!(*chain.last().unwrap(), end.map(|c| c.floor() as i32));
            for pair in chain.windows(2) {
                let steps: u32 = (0..3).map(|a| pair[0][a].abs_diff(pair[1][a])).sum();
                prop_assert_eq!(steps, 1);
            }
            for voxel in &chain {
                prop_assert!(touches(start, end, *voxel));
            }
        }
    }

    /// Slab test with a hair's breadth of tolerance.
    fn touches(start: [f64; 3], end: [f64; 3], voxel: VoxelIndex) -> bool {
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for axis in 0..3 {
            let (low, high) = (f64::from(voxel[axis]) - 1e-9, f64::from(voxel[axis]) + 1.0 + 1e-9);
            let length = end[axis] - start[axis];
            let (a, b) = ((low - start[axis]) / length, (high - start[axis]) / length);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter <= leave
    }
}
