//! The way of a beam through a point cloud: which points lie so near that the beam should have met them.
//!
//! In: a beam, metres from the store's own origin. Out: yes or no for points and boxes. A point is near within half a
//! voxel of the beam; the last two voxels before a return do not count, as in the voxel map.

use nalgebra::Vector3;

/// Farthest that a near point lies from the beam, metres.
pub const RADIUS_M: f32 = 0.075;
/// What a beam leaves alone before its return, metres.
const SPARE_M: f32 = 0.3;

/// The part of a beam that says "free".
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Where the beam begins.
    pub origin: Vector3<f32>,
    /// Of length 1.
    pub direction: Vector3<f32>,
    /// Metres.
    pub length: f32,
}

impl Way {
    /// The way of a beam between two points.
    pub fn new(origin: Vector3<f32>, end: Vector3<f32>, is_return: bool) -> Self {
        let (along, spare) = (end - origin, if is_return { SPARE_M } else { 0.0 });
        let length = along.norm();
        Self { origin, direction: along / length.max(1e-6), length: (length - spare).max(0.0) }
    }

    /// Whether a point lies near: the norm of a cross product, as the thesis has it.
    #[inline]
    pub fn passes(&self, point: [f32; 3]) -> bool {
        let to = Vector3::from(point) - self.origin;
        let along = to.dot(&self.direction);
        (0.0..=self.length).contains(&along) && to.cross(&self.direction).norm_squared() <= RADIUS_M * RADIUS_M
    }

    /// Whether a box may hold near points: the beam meets the box widened by the radius.
    pub fn meets(&self, low: [f32; 3], high: [f32; 3]) -> bool {
        let (mut enter, mut leave) = (0.0f32, self.length);
        for axis in 0..3 {
            let (from, direction) = (self.origin[axis], self.direction[axis]);
            let (low, high) = (low[axis] - RADIUS_M - from, high[axis] + RADIUS_M - from);
            if direction.abs() < 1e-9 {
                if low > 0.0 || high < 0.0 {
                    return false;
                }
                continue;
            }
            let (a, b) = (low / direction, high / direction);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        enter <= leave
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_passes_what_lies_within_half_a_voxel_and_not_the_end() {
        let way = Way::new(Vector3::zeros(), Vector3::new(10.0, 0.0, 0.0), true);
        assert!(way.passes([5.0, 0.05, 0.05]));
        assert!(!way.passes([5.0, 0.08, 0.0]) && !way.passes([9.8, 0.0, 0.0]) && !way.passes([-0.1, 0.0, 0.0]));
        assert!(way.meets([4.0, 0.07, -1.0], [5.0, 2.0, 1.0]));
        assert!(!way.meets([4.0, 0.08, -1.0], [5.0, 2.0, 1.0]) && !way.meets([9.9, -1.0, -1.0], [11.0, 1.0, 1.0]));
    }
}
