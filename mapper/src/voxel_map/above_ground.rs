//! Beams that never came back end above the ground that was met.
//!
//! In: a beam, and the map as it was when the window opened, so that the order of the window's beams does not matter. Out: the
//! beam, cut. A beam that was lost on the ground is told from one that went on by nothing but the map: behind the ground it
//! would clear what no beam can reach, and what is free below the ground is a drop to whoever reads the map.

use super::VoxelMap;
use crate::beams::{Beam, BeamKind};
use crate::clip::Space;
use tsense_contract::{BRICK_EDGE, BRICK_VOXELS};
use tsense_geometry::{VoxelIndex, ray_walk};

impl VoxelMap {
    /// The beam, up to where it would go on below what was met: out of an occupied voxel into one that is not, below one that
    /// is. Beams that came back, or look upwards, stay as they are.
    pub fn above_ground(&self, beam: &Beam) -> Beam {
        let looks_down = beam.end.to_array()[2] < beam.origin.to_array()[2];
        if beam.kind != BeamKind::NoReturn || !looks_down {
            return *beam;
        }
        let cut =
            self.in_window(beam.origin).zip(self.in_window(beam.end)).and_then(|(start, end)| self.cut(start, end));
        cut.map_or(*beam, |share| Beam { end: beam.origin + (beam.end - beam.origin).scaled(share), ..*beam })
    }

    /// The share of a segment after which it would go on below what was met, voxels of the window.
    fn cut(&self, start: [f64; 3], end: [f64; 3]) -> Option<f64> {
        let (from, to) = Space::of(&self.space).clip(start, end)?;
        let from = self.first_met(from, to)?;
        let mut before: Option<VoxelIndex> = None;
        for voxel in ray_walk(from, to) {
            let is_met = self.was_met(voxel);
            if let Some(left) = before
                && !is_met
                && self.was_met([voxel[0], voxel[1], voxel[2] + 1])
            {
                // Of the three axes one was stepped along: through the face between the two voxels.
                let axis = (0..3).find(|&axis| left[axis] != voxel[axis])?;
                let face = f64::from(left[axis].max(voxel[axis]));
                return Some((face - start[axis]) / (end[axis] - start[axis]));
            }
            before = is_met.then_some(voxel);
        }
        None
    }

    /// Where a segment within the working space enters the first brick of which anything is occupied: most of its way is free,
    /// and in bricks that is found out in a quarter of the steps.
    fn first_met(&self, from: [f64; 3], to: [f64; 3]) -> Option<[f64; 3]> {
        let edge = BRICK_EDGE as i32;
        let [first, last] = [from, to].map(|point| point.map(|c| c / f64::from(edge)));
        let first_voxels = ray_walk(first, last).map(|brick| brick.map(|i| i * edge));
        let is_met = |voxel: &VoxelIndex| {
            let brick = &self.bricks[self.position_in_window(*voxel) / BRICK_VOXELS].0;
            brick.occupancy.iter().fold(false, |any, occupancy| any | (*occupancy > 0))
        };
        let brick = first_voxels.into_iter().find(is_met)?.map(|i| i..i + edge);
        Some(Space::of(&brick).clip(from, to).map_or(from, |(enters, _)| enters))
    }

    /// Whether a voxel was occupied when the window opened. Hits alone change what the map holds until the window ends, so
    /// what is not occupied now was not.
    fn was_met(&self, voxel: VoxelIndex) -> bool {
        self.in_space(voxel) && {
            let position = self.position_in_window(voxel);
            self.bricks[position / BRICK_VOXELS].0.occupancy[position % BRICK_VOXELS] > 0 && self.was_occupied(voxel)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beams::Weight;
    use crate::config::Config;
    use tsense_contract::VoxelState;
    use tsense_geometry::Point;

    fn beam(from: [f64; 3], to: [f64; 3], kind: BeamKind) -> Beam {
        let [origin, end] = [from, to].map(|[x, y, z]| Point::new(x, y, z));
        Beam { origin, end, kind, weight: Weight::FULL }
    }

    /// Voxels of 1 m; ground was met at level 0, to the west of x = 4, and its window is over.
    fn ground() -> VoxelMap {
        let config = Config { voxel_size_m: 1.0, working_space_m: [200.0, 200.0, 80.0], ..Config::default() };
        let mut map = VoxelMap::new(&config).unwrap();
        let voxels = (-20..4).map(|x| ([x, 0, 0], VoxelState::Occupied));
        assert_eq!(map.fuse(voxels, Weight::FULL), 24);
        map.close_window();
        map
    }

    fn end(map: &VoxelMap, from: [f64; 3], to: [f64; 3]) -> [f64; 3] {
        map.above_ground(&beam(from, to, BeamKind::NoReturn)).end.to_array()
    }

    #[test]
    fn a_beam_that_was_lost_on_the_ground_ends_there() {
        let map = ground();
        assert_eq!(end(&map, [-8.5, 0.5, 4.0], [-0.5, 0.5, -4.0]), [-4.5, 0.5, 0.0]);
        let [from, to] = [[-8.5, 0.5, 4.0], [-0.5, 0.5, -4.0]];
        assert_eq!(end(&map, to, from), from, "it looks upwards");
        let hit = beam(from, to, BeamKind::Hit);
        assert_eq!(map.above_ground(&hit), hit, "it came back");
    }

    #[test]
    fn a_beam_over_an_edge_goes_on_into_the_ditch() {
        let map = ground();
        for (from, to) in [([0.5, 0.5, 3.5], [9.5, 0.5, -5.5]), ([-8.5, 0.5, 1.2], [11.5, 0.5, 0.2])] {
            assert_eq!(end(&map, from, to), to);
        }
        let under = end(&map, [-8.5, 0.5, 1.2], [11.5, 0.5, -8.8]);
        assert!(under[2].abs() < 1e-9 && under[0] < 4.0, "{under:?}: below the edge it would be in the ground");
    }

    #[test]
    fn what_the_open_window_met_does_not_count_yet() {
        let mut map = ground();
        map.fuse((4..20).map(|x| ([x, 0, 0], VoxelState::Occupied)), Weight::FULL);
        let (from, to) = ([6.5, 0.5, 4.0], [14.5, 0.5, -4.0]);
        assert_eq!(end(&map, from, to), to);
        map.close_window();
        assert_eq!(end(&map, from, to), [10.5, 0.5, 0.0]);
    }
}
