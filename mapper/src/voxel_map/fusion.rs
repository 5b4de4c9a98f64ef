//! Another sensor's voxels in the same map: a radar's, a camera's, a map file's.
//!
//! In: voxels that are free or occupied, and what the sensor counts against a ladar of weight 1. Out: marks of the open
//! window, as if beams had passed or ended there; so all rules of `evidence` hold: a hit protects its voxel, the
//! largest weight of a window counts, and the order does not matter. It does not look at how the sensor came to know.
//! Source: thesis section on data structures: cells are weighted by the sensor's confidence.

use super::VoxelMap;
use crate::beams::Weight;
use crate::evidence::miss_mark;
use tsense_contract::VoxelState;
use tsense_geometry::VoxelIndex;

impl VoxelMap {
    /// Takes in what another sensor knows of a voxel of [`VoxelMap::grid`]. False where it says nothing, that is where
    /// the voxel is unknown to it or outside of the working space.
    pub fn insert_voxel(&mut self, index: VoxelIndex, state: VoxelState, weight: Weight) -> bool {
        if !self.holds(index) {
            return false;
        }
        let first = self.window.first_voxel();
        let voxel: VoxelIndex = std::array::from_fn(|axis| index[axis] - first[axis]);
        let middle = voxel.map(|i| f64::from(i) + 0.5);
        self.enter_blocks(middle, middle);
        match state {
            VoxelState::Unknown => false,
            VoxelState::Occupied => self.hit(middle, weight),
            VoxelState::Free => {
                self.marks.miss(self.marks.position(voxel), miss_mark(weight));
                self.voxel_visits += 1;
                true
            }
        }
    }

    /// Takes in a list of voxels with [`VoxelMap::insert_voxel`]; how many of them said something.
    pub fn fuse(&mut self, voxels: impl IntoIterator<Item = (VoxelIndex, VoxelState)>, weight: Weight) -> usize {
        voxels.into_iter().filter(|(index, state)| self.insert_voxel(*index, *state, weight)).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beams::{Beam, BeamKind};
    use crate::config::{Config, Scheme};
    use tsense_contract::VoxelState::{Free, Occupied, Unknown};
    use tsense_geometry::Point;

    fn map(scheme: Scheme) -> VoxelMap {
        let mut config = Config { voxel_size_m: 1.0, working_space_m: [200.0, 200.0, 80.0], ..Config::default() };
        config.scheme.scheme = scheme;
        VoxelMap::new(&config).unwrap()
    }

    fn state_of(map: &VoxelMap, x: i32) -> (i8, u8) {
        let voxel = map.voxel([x, 0, 0]);
        (voxel.occupancy, voxel.confidence)
    }

    #[test]
    fn voxels_of_another_sensor_count_by_their_weight() {
        let mut map = map(Scheme::Confidence);
        let list = [([0, 0, 0], Occupied), ([1, 0, 0], Free), ([2, 0, 0], Unknown), ([900, 0, 0], Occupied)];
        assert_eq!(map.fuse(list, Weight::new(0.5)), 2);
        assert_eq!(state_of(&map, 0), (6, 4), "a hit shows at once");
        map.close_window();
        // Half of the steps 12, 4 and 8.
        assert_eq!([0, 1, 2].map(|x| state_of(&map, x)), [(6, 4), (-2, 4), (0, 0)]);
    }

    #[test]
    fn within_a_window_the_order_of_sensors_does_not_matter_and_any_hit_protects() {
        let through = Beam {
            origin: Point::new(-3.5, 0.5, 0.5),
            end: Point::new(5.5, 0.5, 0.5),
            kind: BeamKind::NoReturn,
            weight: Weight::FULL,
        };
        let steps: [fn(&mut VoxelMap, &Beam); 4] = [
            |map, beam| assert!(map.insert(beam)),
            |map, _| assert!(map.insert_voxel([1, 0, 0], Free, Weight::FULL)),
            |map, _| assert!(map.insert_voxel([1, 0, 0], Occupied, Weight::new(0.25))),
            |map, _| assert!(map.insert_voxel([2, 0, 0], Free, Weight::new(0.75))),
        ];
        let mut orders = 0;
        for order in 0..24 {
            let (mut left, mut number): (Vec<usize>, usize) = ((0..4).collect(), order);
            let mut map = map(Scheme::Confidence);
            while !left.is_empty() {
                steps[left.remove(number % left.len())](&mut map, &through);
                number /= left.len() + 1;
            }
            map.close_window();
            // A quarter of 12 and of 8; the beam's full weight is the larger one in voxel 2.
            assert_eq!([1, 2].map(|x| state_of(&map, x)), [(3, 2), (-4, 8)], "order {order}");
            orders += 1;
        }
        assert_eq!(orders, 24);
    }

    #[test]
    fn the_hit_ratio_counts_them_once_a_window() {
        let mut map = map(Scheme::HitRatio);
        for _ in 0..3 {
            assert_eq!(map.fuse([([0, 0, 0], Occupied), ([0, 0, 0], Occupied), ([0, 0, 0], Free)], Weight::FULL), 3);
            map.close_window();
        }
        assert_eq!((map.voxel([0, 0, 0]).state, map.voxel([0, 0, 0]).confidence), (Occupied, 3));
    }
}
