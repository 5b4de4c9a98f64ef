//! Occupied and free voxels over time: how fast the map came to know the plot (the thesis's figure 3-5, on any input).
//!
//! In: the bricks of the map that changed between some instants from the first to the last ray. Out: counts at each, summed
//! over tiles. Only whole bricks whose first voxel lies in a tile's core are counted, so that no voxel counts twice.

use serde::Serialize;
use std::collections::BTreeMap;
use tsense_contract::{BLOCK_BRICKS, BRICK_EDGE, BRICKS_PER_BLOCK, BlockKey, Brick, first_voxel};
use tsense_geometry::{RasterShape, Timestamp};
use tsense_mapper::{Survey, VoxelMap};

/// Instants that are looked at.
const SAMPLES: usize = 24;

/// Voxels at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    /// Since the first ray, seconds.
    pub at_s: f64,
    /// Voxels in which beams end.
    pub occupied: u64,
    /// Voxels that beams pass.
    pub free: u64,
}

/// Counts over time.
#[derive(Clone, Debug)]
pub struct Timeline {
    start: Timestamp,
    counts: Vec<Counts>,
}

impl Timeline {
    /// Equal steps from the first to the last ray; one step where there is no time between them.
    pub fn new(first: Timestamp, last: Timestamp) -> Self {
        let span_s = last.seconds_since(first);
        let steps = if span_s > 0.0 { SAMPLES } else { 1 };
        let at = |i: usize| Counts { at_s: span_s * (i + 1) as f64 / steps as f64, ..Counts::default() };
        Self { start: first, counts: (0..steps).map(at).collect() }
    }

    /// Counts over time, tiles summed.
    pub fn counts(&self) -> &[Counts] {
        &self.counts
    }

    /// Begins to follow a tile.
    pub fn follow(&mut self, core: RasterShape) -> Follower<'_> {
        Follower { timeline: self, core, next: 0, now: Counts::default(), told: BTreeMap::new(), is_changed: false }
    }
}

/// Counts one tile at the instants as they pass.
pub struct Follower<'a> {
    timeline: &'a mut Timeline,
    core: RasterShape,
    next: usize,
    now: Counts,
    /// Occupied and free voxels of each brick as they were counted last, by block.
    told: BTreeMap<BlockKey, Vec<[u8; 2]>>,
    is_changed: bool,
}

impl Follower<'_> {
    /// Told of every ray before it is inserted.
    pub fn before(&mut self, stamp: Timestamp, map: &mut Survey) {
        let at_s = stamp.seconds_since(self.timeline.start);
        // The last instant is counted when the map is done.
        while self.next + 1 < self.timeline.counts.len() && at_s > self.timeline.counts[self.next].at_s {
            self.sample(map);
        }
        self.is_changed = true;
    }

    /// Ends the map, and counts it for all instants that are left.
    pub fn finish(mut self, mut map: Survey) -> VoxelMap {
        map.close();
        self.is_changed = true;
        while self.next < self.timeline.counts.len() {
            self.sample(&mut map);
        }
        map.finish()
    }

    fn sample(&mut self, map: &mut Survey) {
        if std::mem::take(&mut self.is_changed) {
            map.take_changes(|key, at, brick| self.count(key, at, brick));
        }
        let sum = &mut self.timeline.counts[self.next];
        (sum.occupied, sum.free) = (sum.occupied + self.now.occupied, sum.free + self.now.free);
        self.next += 1;
    }

    /// Counts a brick anew, where it belongs to the core.
    fn count(&mut self, key: BlockKey, at: usize, brick: &Brick) {
        let first = first_voxel(key);
        let brick_at = [at % BLOCK_BRICKS[0], at / BLOCK_BRICKS[0] % BLOCK_BRICKS[1]];
        let inside = |axis: usize, cells: usize| {
            let from =
                i64::from(first[axis]) + (brick_at[axis] * BRICK_EDGE) as i64 - i64::from(self.core.first_cell[axis]);
            (0..cells as i64).contains(&from)
        };
        if inside(0, self.core.width) && inside(1, self.core.height) {
            let told = &mut self.told.entry(key).or_insert_with(|| vec![[0; 2]; BRICKS_PER_BLOCK])[at];
            let [occupied, free] = counted(brick);
            self.now.occupied = self.now.occupied + u64::from(occupied) - u64::from(told[0]);
            self.now.free = self.now.free + u64::from(free) - u64::from(told[1]);
            *told = [occupied, free];
        }
    }
}

/// Occupied and free voxels of a brick.
fn counted(brick: &Brick) -> [u8; 2] {
    let (mut occupied, mut free) = (0, 0);
    for (occupancy, confidence) in brick.occupancy.iter().zip(&brick.confidence) {
        let known = u8::from(*confidence > 0);
        occupied += known & u8::from(*occupancy > 0);
        free += known & u8::from(*occupancy < 0);
    }
    [occupied, free]
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::{Point, Vector};
    use tsense_mapper::{Beam, BeamKind, Weight};

    #[test]
    fn a_core_counts_its_own_voxels_at_each_instant() {
        let low = Point::new(0.0, 0.0, 0.0);
        let config = Survey::config_for(low, low + Vector::new(12.0, 12.0, 6.0), 0.15, 1.0);
        let mut survey = Survey::new(&config, low + Vector::new(6.0, 6.0, 3.0)).unwrap();
        let at = Timestamp::from_seconds;
        let mut timeline = Timeline::new(at(0.0), at(24.0));
        let core = RasterShape { first_cell: [0, 0], width: 40, height: 80, cell_m: 0.15 };
        let mut follower = timeline.follow(core);
        for i in 0..25 {
            let x = 0.2 + 0.45 * f64::from(i);
            let beam = Beam {
                origin: Point::new(x, 1.0, 5.0),
                end: Point::new(x, 1.0, 1.0),
                kind: BeamKind::Hit,
                weight: Weight::FULL,
            };
            follower.before(at(f64::from(i)), &mut survey);
            survey.insert(at(f64::from(i)), &beam);
        }
        let map = follower.finish(survey);
        let plain = map.blocks().flat_map(|(_, bricks)| bricks).map(|brick| u64::from(counted(brick)[0])).sum::<u64>();
        assert_eq!(plain, 25, "those beyond the core are in the map");
        let counts = timeline.counts();
        assert_eq!(counts.len(), 24);
        // A ray each 0.45 m: thirteen fall into the first 6 m.
        assert_eq!((counts[1].occupied, counts[23].occupied, counts[23].at_s), (3, 13, 24.0));
        assert!(counts[23].free > counts[5].free && counts[5].free > 0);
    }
}
