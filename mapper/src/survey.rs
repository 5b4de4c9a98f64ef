//! The map for recorded rays: beams with stamps in, one voxel map out, in one thread and without a graph.
//!
//! In: rays in `Global`, in order of time. Out: the blocks. It follows no vehicle: the working space is set once, to
//! hold the whole plot.

use crate::beams::Beam;
use crate::config::{Config, WindowRule};
use crate::evidence_window::EvidenceWindow;
use crate::voxel_map::{MapError, VoxelMap};
use tsense_contract::{BlockKey, Brick};
use tsense_geometry::{Global, Point, Timestamp};

/// A map fed by hand.
pub struct Survey {
    map: VoxelMap,
    window: EvidenceWindow,
}

impl Survey {
    /// An unknown world of `config.working_space_m` around `center`. Windows end by `config.evidence`; there is no
    /// nod, so a window by sweep ends by time. Nothing where the space is too large, or the centre not on Earth.
    pub fn new(config: &Config, center: Point<Global>) -> Result<Self, MapError> {
        let mut map = VoxelMap::new(config)?;
        map.center_on(center);
        Ok(Self { map, window: EvidenceWindow::new(&config.evidence) })
    }

    /// A configuration for a plot: a working space that holds the box between two corners, windows by time.
    pub fn config_for(min: Point<Global>, max: Point<Global>, voxel_size_m: f64, window_s: f64) -> Config {
        let mut config = Config { voxel_size_m, ..Config::default() };
        let extent_m = (max - min).xyz;
        // Two voxels more, so that points on the border lie inside.
        config.working_space_m = std::array::from_fn(|axis| extent_m[axis].max(0.0) + 2.0 * voxel_size_m);
        (config.evidence.window, config.evidence.window_s) = (WindowRule::Time, window_s);
        config
    }

    /// Takes in a ray; a window that its stamp ends is closed first. False where none of it lies in the space.
    pub fn insert(&mut self, stamp: Timestamp, beam: &Beam) -> bool {
        if self.window.ends_before(stamp, None) {
            self.map.close_window();
        }
        self.map.insert(beam)
    }

    /// Ends the last window.
    pub fn close(&mut self) {
        self.map.close_window();
    }

    /// Ends the last window and gives the map.
    pub fn finish(mut self) -> VoxelMap {
        self.close();
        self.map
    }

    /// Hands out the bricks that changed since this was asked last, with their position in the block; the open window's
    /// misses are not yet counted.
    pub fn take_changes(&mut self, take: impl FnMut(BlockKey, usize, &Brick)) {
        self.map.take_changes(take);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beams::{BeamKind, Weight};
    use tsense_contract::VoxelState;

    #[test]
    fn a_whole_plot_fits_and_windows_end_by_time() {
        let (min, max) = (Point::new(369_000.0, 3_279_000.0, 30.0), Point::new(369_050.0, 3_279_050.0, 70.0));
        let config = Survey::config_for(min, max, 0.15, 1.0);
        let center = min + (max - min).scaled(0.5);
        let mut survey = Survey::new(&config, center).unwrap();
        let hit = |end| Beam { origin: center, end, kind: BeamKind::Hit, weight: Weight::FULL };
        for (s, end) in [(0.0, min), (0.5, max), (2.0, min)] {
            assert!(survey.insert(Timestamp::from_seconds(s), &hit(end)), "{end:?}");
        }
        let map = survey.finish();
        for corner in [min, max] {
            let voxel = map.voxel(map.grid().index_of(corner).unwrap());
            assert_eq!(voxel.state, VoxelState::Occupied);
        }
        assert_eq!(map.voxel(map.grid().index_of(min).unwrap()).confidence, 16, "two windows");
        assert!(map.blocks().all(|(_, bricks)| bricks.len() == 6250));
    }
}
