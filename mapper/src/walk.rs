//! The exact ray walk with chords: every voxel that a segment crosses, and how far the segment runs in it.
//!
//! In: two points in voxel units. Out: calls of `visit` with the voxel's index and the chord, voxel units, in order.
//! The path is that of `geometry::ray_walk`, to the last tie. Source: Amanatides and Woo 1987; thesis (2-2).

use tsense_geometry::VoxelIndex;

/// One axis of a walk.
#[derive(Clone, Copy)]
struct Axis {
    at: i32,
    step: i32,
    faces_left: u32,
    /// Segment parameter, in [0, 1], of the next face.
    next_face: f64,
    per_voxel: f64,
}

impl Axis {
    fn new(start: f64, end: f64) -> Self {
        let (first, last) = (start.floor() as i32, end.floor() as i32);
        let length = end - start;
        let mut axis = Self {
            at: first,
            step: (last - first).signum(),
            faces_left: first.abs_diff(last),
            next_face: f64::INFINITY,
            per_voxel: f64::INFINITY,
        };
        if axis.faces_left > 0 {
            let face = if last > first { f64::from(first) + 1.0 } else { f64::from(first) };
            axis.next_face = (face - start) / length;
            axis.per_voxel = 1.0 / length.abs();
        }
        axis
    }

    fn cross(&mut self) {
        self.at += self.step;
        self.faces_left -= 1;
        self.next_face = if self.faces_left > 0 { self.next_face + self.per_voxel } else { f64::INFINITY };
    }
}

/// Walks from `start` to `end`, both finite.
pub fn walk(start: [f64; 3], end: [f64; 3], mut visit: impl FnMut(VoxelIndex, f64)) {
    let mut axes: [Axis; 3] = std::array::from_fn(|axis| Axis::new(start[axis], end[axis]));
    let length = (0..3).map(|axis| (end[axis] - start[axis]).powi(2)).sum::<f64>().sqrt();
    let steps = axes.iter().map(|axis| axis.faces_left).sum::<u32>();
    let mut entered = 0.0;
    for _ in 0..steps {
        let [x, y, z] = axes.map(|axis| axis.next_face);
        // The lowest axis wins where the segment passes through an edge.
        let next = if x <= y && x <= z {
            0
        } else if y <= z {
            1
        } else {
            2
        };
        let left = axes[next].next_face;
        visit(axes.map(|axis| axis.at), (left - entered) * length);
        entered = left;
        axes[next].cross();
    }
    visit(axes.map(|axis| axis.at), (1.0 - entered) * length);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::segments;
    use tsense_geometry::ray_walk;

    #[test]
    fn the_path_is_the_plain_walks_on_a_million_random_and_degenerate_segments() {
        let (mut compared, mut path) = (0, Vec::new());
        for (start, end) in segments(1_000_000) {
            path.clear();
            walk(start, end, |voxel, _| path.push(voxel));
            assert!(ray_walk(start, end).eq(path.iter().copied()), "{start:?} {end:?}");
            compared += 1;
        }
        assert!(compared >= 1_000_000, "{compared}");
    }

    #[test]
    fn the_chords_add_up_to_the_segment() {
        for (start, end) in segments(20_000) {
            let mut sum = 0.0;
            walk(start, end, |_, chord| {
                assert!(chord >= -1e-9 && chord <= 3f64.sqrt() + 1e-9, "{chord}");
                sum += chord;
            });
            let length = (0..3).map(|a| (end[a] - start[a]).powi(2)).sum::<f64>().sqrt();
            assert!((sum - length).abs() < 1e-9);
        }
    }
}
