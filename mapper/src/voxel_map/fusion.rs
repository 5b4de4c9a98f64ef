//! Another sensor's voxels in the same map: a radar's, a camera's, a map file's.
//!
//! In: voxels that are free or occupied, and what the sensor counts against a ladar of weight 1. Out: marks of the open
//! window, as if beams had passed or ended there: the largest weight of a window counts, and the order does not matter.
//! One rule more: a beam's hit protects its voxel from all misses, a hit that was told only from those of no more than its own
//! weight. Where beams of more weight saw through in the same window, it is taken back; or the least sensor, saying the
//! same in every window, would hold a voxel against all others. What is known from earlier is no evidence of now: it
//! fills voxels that are unknown. It does not look at how the sensor came to know.
//! Source: thesis section on data structures: cells are weighted by the sensor's confidence.

use super::{Rule, VoxelMap};
use crate::beams::Weight;
use crate::evidence::{level_of, told_hit_mark};
use std::ops::Range;
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK, SensedVoxel, VoxelState, VoxelsHeader, VoxelsKind};
use tsense_geometry::{Point, VoxelIndex};

/// Largest edge of a sensor's voxel, in voxels of the map: 64 of these are then as occupied as it is. What is coarser says too
/// little of any of them.
pub const EDGE_VOXELS_MAX: f64 = 4.0;

/// How a sensor's word counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word {
    /// Against a ladar of weight 1.
    pub weight: Weight,
    /// Evidence, or known from earlier.
    pub kind: VoxelsKind,
}

/// A hit that a sensor told of before any beam ended there: what the voxel was, should beams overrule it.
#[derive(Clone, Copy, Debug)]
pub struct ToldHit {
    /// Counted from the window's first.
    voxel: VoxelIndex,
    occupancy: i8,
}

/// What became of a sample's voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fused {
    /// Voxels of the sample that lie in the working space, if only in part.
    pub inside: usize,
    /// Voxels that are nowhere, or in no state.
    pub invalid: usize,
}

impl VoxelMap {
    /// Takes in what another sensor knows of a voxel of [`VoxelMap::grid`]. False where it says nothing, that is where
    /// the voxel is unknown to it or outside of the working space.
    pub fn insert_voxel(&mut self, index: VoxelIndex, state: VoxelState, weight: Weight) -> bool {
        let is_told = state != VoxelState::Unknown && self.holds(index);
        if is_told {
            let first = self.window.first_voxel();
            let voxel = std::array::from_fn(|axis| index[axis] - first[axis]);
            self.tell(voxel, state, Word { weight, kind: VoxelsKind::Measured });
        }
        is_told
    }

    /// Takes in a list of voxels with [`VoxelMap::insert_voxel`]; how many of them said something.
    pub fn fuse(&mut self, voxels: impl IntoIterator<Item = (VoxelIndex, VoxelState)>, weight: Weight) -> usize {
        voxels.into_iter().filter(|(index, state)| self.insert_voxel(*index, *state, weight)).count()
    }

    /// Takes in a sample of a sensor's own voxels. One that is no larger than the map's counts for the voxel that holds its
    /// middle; a larger one for every voxel whose middle it holds.
    pub fn fuse_sensed(&mut self, header: &VoxelsHeader, items: &[SensedVoxel], weight: Weight) -> Fused {
        let word = Word { weight, kind: header.kind() };
        let edge = header.voxel_size_m / self.grid.size_m();
        let mut fused = Fused::default();
        for item in items {
            let at_m: [f64; 3] = std::array::from_fn(|axis| header.origin_m[axis] + f64::from(item.xyz_m[axis]));
            let (state, middle) =
                (VoxelState::from_wire(item.state), self.in_window(Point::new(at_m[0], at_m[1], at_m[2])));
            match middle {
                Some(middle) if state.to_wire() == item.state => {
                    fused.inside += usize::from(self.tell_cube(middle, edge, state, word));
                }
                _ => fused.invalid += 1,
            }
        }
        fused
    }

    /// A cube around a point, both in voxels of the window. False where none of it lies in the working space.
    fn tell_cube(&mut self, middle: [f64; 3], edge: f64, state: VoxelState, word: Word) -> bool {
        let [x, y, z]: [Range<i32>; 3] = std::array::from_fn(|axis| {
            let held = voxels_of(middle[axis], edge);
            held.start.max(self.space[axis].start)..held.end.min(self.space[axis].end)
        });
        let is_inside = !(x.is_empty() || y.is_empty() || z.is_empty());
        if is_inside && state != VoxelState::Unknown {
            for k in z {
                for j in y.clone() {
                    x.clone().for_each(|i| self.tell([i, j, k], state, word));
                }
            }
        }
        is_inside
    }

    /// A voxel of the working space, counted from the window's first, is free or occupied.
    fn tell(&mut self, voxel: VoxelIndex, state: VoxelState, word: Word) {
        let position = self.position_in_window(voxel);
        let (brick, within) = (&self.bricks[position / BRICK_VOXELS].0, position % BRICK_VOXELS);
        if word.kind == VoxelsKind::Prior && brick.state(within) != VoxelState::Unknown {
            return;
        }
        let (occupancy, middle) = (brick.occupancy[within], voxel.map(|i| f64::from(i) + 0.5));
        self.enter_blocks(middle, middle);
        if state == VoxelState::Free {
            self.marks.miss(voxel, level_of(word.weight));
            self.voxel_visits += 1;
            return;
        }
        if self.marks.was_occupied(voxel).is_none() {
            self.told.push(ToldHit { voxel, occupancy });
        }
        self.hit(middle, told_hit_mark(word.weight), word.weight);
    }

    /// Hits that no beam confirmed, and through which beams of more weight saw, have not been.
    pub(super) fn take_back_overruled(&mut self) {
        let mut told = std::mem::take(&mut self.told);
        for ToldHit { voxel, occupancy } in told.drain(..) {
            if !self.marks.take_back_overruled(voxel) {
                continue;
            }
            let position = self.position_in_window(voxel);
            let (at, within) = (position / BRICK_VOXELS, position % BRICK_VOXELS);
            let brick = &mut self.bricks[at].0;
            match &mut self.rule {
                Rule::Steps(_) => brick.occupancy[within] = occupancy,
                Rule::Ratio(ratio, counters) => ratio.take_back(&mut counters[at], brick, within),
            }
            self.blocks[at / BRICKS_PER_BLOCK].dirty.insert(at % BRICKS_PER_BLOCK);
        }
        // For its memory.
        self.told = told;
    }
}

/// The voxels on an axis that a cube around a point means.
fn voxels_of(middle: f64, edge: f64) -> Range<i32> {
    // Casts saturate: what lies beyond any window is cut off by the caller.
    if edge <= 1.0 + EDGE_SAME {
        let voxel = middle.floor() as i32;
        return voxel..voxel.saturating_add(1);
    }
    let [low, high] = [-0.5, 0.5].map(|side| (middle + side * edge - 0.5).ceil() as i32);
    low..high
}

/// Edges that differ by no more are the same, voxels of the map: a sender's 0.15 m may be an f32's.
const EDGE_SAME: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beams::{Beam, BeamKind};
    use crate::config::{Config, Scheme};
    use bytemuck::Zeroable;
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

    /// The states of voxels 1 and 2 after a window in which a beam of full weight passes both, in every order.
    fn in_any_order<const N: usize>(steps: [fn(&mut VoxelMap, &Beam); N], expected: [(i8, u8); 2]) {
        let through = Beam {
            origin: Point::new(-3.5, 0.5, 0.5),
            end: Point::new(5.5, 0.5, 0.5),
            kind: BeamKind::NoReturn,
            weight: Weight::FULL,
        };
        let orders = (1..=N).product();
        for order in 0..orders {
            let (mut left, mut number): (Vec<usize>, usize) = ((0..N).collect(), order);
            let mut map = map(Scheme::Confidence);
            while !left.is_empty() {
                steps[left.remove(number % left.len())](&mut map, &through);
                number /= left.len() + 1;
            }
            map.close_window();
            assert_eq!([1, 2].map(|x| state_of(&map, x)), expected, "order {order} of {orders}");
        }
    }

    #[test]
    fn within_a_window_the_order_of_sensors_does_not_matter() {
        let steps: [fn(&mut VoxelMap, &Beam); 4] = [
            |map, beam| assert!(map.insert(beam)),
            |map, _| assert!(map.insert_voxel([1, 0, 0], Free, Weight::FULL)),
            |map, _| assert!(map.insert_voxel([1, 0, 0], Occupied, Weight::FULL)),
            |map, _| assert!(map.insert_voxel([2, 0, 0], Free, Weight::new(0.75))),
        ];
        // A hit of the beam's own weight protects; the beam's weight is the larger one in voxel 2.
        in_any_order(steps, [(8, 8), (-4, 8)]);
    }

    #[test]
    fn what_beams_of_more_weight_see_through_is_taken_back_and_what_a_beam_hit_is_not() {
        let steps: [fn(&mut VoxelMap, &Beam); 5] = [
            |map, beam| assert!(map.insert(beam)),
            |map, _| assert!(map.insert_voxel([1, 0, 0], Occupied, Weight::new(0.25))),
            |map, _| assert!(map.insert_voxel([1, 0, 0], Occupied, Weight::new(0.75))),
            |map, _| assert!(map.insert_voxel([2, 0, 0], Occupied, Weight::new(0.5))),
            |map, beam| {
                let hit = Beam { end: Point::new(2.5, 0.5, 0.5), weight: Weight::new(0.25), ..*beam };
                assert!(map.insert(&Beam { kind: BeamKind::Hit, ..hit }));
            },
        ];
        // Voxel 1: three quarters of 8 were told, and the beam takes 4. Voxel 2: half of 12 and of 8.
        in_any_order(steps, [(-4, 14), (6, 4)]);
    }

    #[test]
    fn a_sensor_of_low_weight_that_insists_does_not_hold_a_voxel_against_the_ladar() {
        for scheme in [Scheme::Confidence, Scheme::HitRatio, Scheme::IncrementDecrement] {
            for (weight, is_occupied) in [(0.25, false), (0.75, false), (1.0, true)] {
                let mut map = map(scheme);
                for _ in 0..20 {
                    map.fuse([([1, 0, 0], Occupied)], Weight::new(weight));
                    map.fuse([([1, 0, 0], Free)], Weight::FULL);
                    map.close_window();
                }
                let state = map.voxel([1, 0, 0]).state;
                assert_eq!(state == Occupied, is_occupied, "{scheme:?} {weight}: {state:?}");
            }
        }
    }

    #[test]
    fn a_prior_fills_what_is_unknown_and_is_no_evidence_where_something_is_known() {
        let mut map = map(Scheme::Confidence);
        map.fuse([([0, 0, 0], Free)], Weight::FULL);
        map.close_window();
        let header = VoxelsHeader { voxel_size_m: 1.0, kind: VoxelsKind::Prior.to_wire(), ..VoxelsHeader::zeroed() };
        let items = [0.5, 1.5].map(|x| SensedVoxel::new([x, 0.5, 0.5], Occupied));
        for _ in 0..10 {
            assert_eq!(map.fuse_sensed(&header, &items, Weight::new(0.25)), Fused { inside: 2, invalid: 0 });
            map.close_window();
        }
        // A quarter of 12 and of 8, once.
        assert_eq!([0, 1].map(|x| state_of(&map, x)), [(-4, 8), (3, 2)]);
    }

    /// Voxels along x that a voxel of a sensor means, in a map of 1 m.
    fn meant(edge_m: f64, middle_m: f32) -> Vec<i32> {
        let mut map = map(Scheme::Confidence);
        let header = VoxelsHeader { voxel_size_m: edge_m, ..VoxelsHeader::zeroed() };
        map.fuse_sensed(&header, &[SensedVoxel::new([middle_m, 0.5, 0.5], Occupied)], Weight::FULL);
        (-50..50).filter(|x| map.voxel([*x, 0, 0]).state == Occupied).collect()
    }

    #[test]
    fn voxels_of_another_size_mean_those_whose_middles_they_hold() {
        assert_eq!(meant(1.0, 7.5), [7]);
        assert_eq!(meant(1.0, 7.9), [7]);
        assert_eq!(meant(f64::from(1.0f32) + 1e-8, -7.9), [-8]);
        assert_eq!(meant(0.1, -0.05), [-1]);
        assert_eq!(meant(2.0, 8.0), [7, 8]);
        assert_eq!(meant(2.0, 8.2), [7, 8]);
        assert_eq!(meant(1.4, 7.5), [7]);
        assert_eq!(meant(1.4, 8.0), [7, 8]);
        assert_eq!(meant(4.0, 0.0), [-2, -1, 0, 1]);
    }

    #[test]
    fn voxels_that_are_nowhere_or_in_no_state_are_counted() {
        let mut map = map(Scheme::Confidence);
        let good = SensedVoxel::new([0.5; 3], Free);
        let far = SensedVoxel::new([9e3, 0.5, 0.5], Free);
        let items = [
            good,
            far,
            SensedVoxel::new([0.5; 3], Unknown),
            SensedVoxel { state: 3, ..good },
            SensedVoxel { xyz_m: [f32::NAN, 0.0, 0.0], ..good },
            SensedVoxel { xyz_m: [0.0, f32::MAX, 0.0], ..good },
        ];
        let header = VoxelsHeader { voxel_size_m: 1.0, ..VoxelsHeader::zeroed() };
        assert_eq!(map.fuse_sensed(&header, &items, Weight::FULL), Fused { inside: 2, invalid: 3 });
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
