//! Voxels and blocks as integers: where a point falls, and which block holds a voxel.
//!
//! A voxel index counts voxels from the UTM origin; at 0.15 m the largest northing (10,000 km) is 6.7e7, well
//! inside an `i32`. A block is a fixed box of voxels; its key counts boxes, also from the UTM origin.

use crate::frame::{Global, Point};

/// A voxel's indices along x (east), y (north), z (up), counted from the UTM origin.
pub type VoxelIndex = [i32; 3];

/// Farthest from the UTM origin that is accepted on any axis, metres: the Earth's quarter is 1.0e7.
pub const COORDINATE_MAX_M: f64 = 2.0e7;

/// The cubic grid: voxel `i` covers `[i, i + 1) * size_m` on each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelGrid {
    size_m: f64,
}

impl VoxelGrid {
    /// A grid of cubes with edges of `size_m`, or nothing where that is not a size from 1 cm to 10 m.
    pub fn new(size_m: f64) -> Option<Self> {
        (0.01..=10.0).contains(&size_m).then_some(Self { size_m })
    }

    /// Edge of a voxel, metres.
    pub fn size_m(&self) -> f64 {
        self.size_m
    }

    /// The voxel that holds `point`, or nothing where a coordinate is NaN, infinite or off the Earth.
    #[inline]
    pub fn index_of(&self, point: Point<Global>) -> Option<VoxelIndex> {
        let inside = point.xyz.iter().all(|c| c.abs() <= COORDINATE_MAX_M);
        inside.then(|| point.to_array().map(|c| (c / self.size_m).floor() as i32))
    }

    /// The centre of a voxel.
    pub fn center_of(&self, index: VoxelIndex) -> Point<Global> {
        let [x, y, z] = index.map(|i| (f64::from(i) + 0.5) * self.size_m);
        Point::new(x, y, z)
    }

    /// The corner of a voxel with the smallest coordinates.
    pub fn corner_of(&self, index: VoxelIndex) -> Point<Global> {
        let [x, y, z] = index.map(|i| f64::from(i) * self.size_m);
        Point::new(x, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_falls_into_the_voxel_whose_corner_is_not_above_it() {
        let grid = VoxelGrid::new(0.15).unwrap();
        assert_eq!(grid.index_of(Point::new(0.0, 0.149, -0.001)), Some([0, 0, -1]));
        assert_eq!(grid.index_of(Point::new(369_000.07, 3_279_000.0, 40.0)), Some([2_460_000, 21_860_000, 266]));
        assert!((grid.center_of([0, 1, -1]).y() - 0.225).abs() < 1e-12);
    }

    #[test]
    fn nonsense_has_no_voxel() {
        let grid = VoxelGrid::new(0.15).unwrap();
        for bad in [f64::NAN, f64::INFINITY, 1e300, -2.1e7] {
            assert_eq!(grid.index_of(Point::new(0.0, bad, 0.0)), None);
        }
        assert!(VoxelGrid::new(f64::NAN).is_none());
    }
}
