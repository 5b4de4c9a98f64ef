//! Known voxels as points at their centres, and what colour they get.
//!
//! In: blocks of a map file and what is wanted of them. Out: points in the map's own coordinates, metres, in the order
//! of the file: the same file gives the same points.

use clap::ValueEnum;
use tsense_contract::{BLOCK_BRICKS, BRICK_EDGE, BlockKey, VoxelState, first_voxel};
use tsense_geometry::{VoxelGrid, VoxelIndex};
use tsense_mapper::tsmap::StoredBlock;

/// Which voxels become points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// Voxels in which beams end.
    Occupied,
    /// Voxels that beams pass.
    Free,
    /// Both.
    All,
}

/// What the colour shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Shade {
    /// Height: blue is the lowest point of the file, red the highest.
    Height,
    /// Evidence: blue is the surest free voxel, red the surest occupied one.
    Occupancy,
    /// How much evidence there is: blue is the least, red the most.
    Confidence,
}

/// A voxel as a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelPoint {
    /// Its centre, metres.
    pub at_m: [f64; 3],
    /// Evidence: positive occupied, negative free.
    pub occupancy: i8,
    /// Updates behind it.
    pub confidence: u8,
}

impl What {
    /// Whether it is one of them.
    pub fn wants(self, state: VoxelState) -> bool {
        match state {
            VoxelState::Unknown => false,
            VoxelState::Free => self != Self::Occupied,
            VoxelState::Occupied => self != Self::Free,
        }
    }
}

/// The points of a block.
pub fn points_of(block: &StoredBlock, grid: VoxelGrid, what: What) -> impl Iterator<Item = VoxelPoint> {
    voxels_of(block).filter(move |(_, state, ..)| what.wants(*state)).map(move |(voxel, _, occupancy, confidence)| {
        VoxelPoint { at_m: grid.center_of(voxel).to_array(), occupancy, confidence }
    })
}

/// All known voxels of a block: index, state, occupancy, confidence.
pub fn voxels_of(block: &StoredBlock) -> impl Iterator<Item = (VoxelIndex, VoxelState, i8, u8)> {
    let key = block.key;
    block.known_bricks().flat_map(move |(place, brick)| {
        let known = (0..64).filter(|i| brick.state(*i) != VoxelState::Unknown);
        known.map(move |i| (voxel_of(key, place, i), brick.state(i), brick.occupancy[i], brick.confidence[i]))
    })
}

/// The index of voxel `i` of the brick at `place` of a block.
pub fn voxel_of(key: BlockKey, place: usize, i: usize) -> VoxelIndex {
    let (first, corner, inner) = (first_voxel(key), place_of_brick(place), place_of_voxel(i));
    std::array::from_fn(|axis| first[axis] + corner[axis] + inner[axis])
}

/// First voxel of a brick within its block.
fn place_of_brick(place: usize) -> [i32; 3] {
    let [x, y, _] = BLOCK_BRICKS;
    [place % x, place / x % y, place / (x * y)].map(|brick| (brick * BRICK_EDGE) as i32)
}

/// A voxel's place within its brick.
fn place_of_voxel(i: usize) -> [i32; 3] {
    [i % BRICK_EDGE, i / BRICK_EDGE % BRICK_EDGE, i / (BRICK_EDGE * BRICK_EDGE)].map(|edge| edge as i32)
}

/// The range of what is shown, over all points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    shade: Shade,
    low: f64,
    high: f64,
}

impl Scale {
    /// Nothing was seen yet.
    pub fn new(shade: Shade) -> Self {
        Self { shade, low: f64::INFINITY, high: f64::NEG_INFINITY }
    }

    /// Widens the range.
    pub fn add(&mut self, point: &VoxelPoint) {
        let value = self.value(point);
        (self.low, self.high) = (self.low.min(value), self.high.max(value));
    }

    fn value(&self, point: &VoxelPoint) -> f64 {
        match self.shade {
            Shade::Height => point.at_m[2],
            Shade::Occupancy => point.occupancy.into(),
            Shade::Confidence => point.confidence.into(),
        }
    }

    /// Red, green and blue: blue, cyan, green, yellow, red in equal steps.
    pub fn color(&self, point: &VoxelPoint) -> [u8; 3] {
        let span = self.high - self.low;
        let share = if span > 0.0 { (self.value(point) - self.low) / span } else { 0.5 };
        let hill = |centre: f64| ((1.5 - (share * 4.0 - centre).abs()).clamp(0.0, 1.0) * 255.0).round() as u8;
        [hill(3.5), hill(2.0), hill(0.5)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_contract::{BRICKS_PER_BLOCK, Brick, brick_offset, locate, voxel_offset};

    #[test]
    fn points_lie_at_the_centres_of_the_wanted_voxels() {
        let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
        let (place, inner) = (brick_offset([2, 24, 9]), voxel_offset([1, 2, 3]));
        (bricks[place].occupancy[inner], bricks[place].confidence[inner]) = (8, 16);
        (bricks[place].occupancy[0], bricks[place].confidence[0]) = (-4, 8);
        let block = StoredBlock::of([1, -1, 0], &bricks, &[]);
        let grid = VoxelGrid::new(0.5).unwrap();
        let of = |what| points_of(&block, grid, what).collect::<Vec<_>>();
        let voxel = [100 + 9, -100 + 98, 39];
        assert_eq!(locate(voxel), ([1, -1, 0], place, inner));
        assert_eq!(of(What::Occupied), [VoxelPoint { at_m: [54.75, -0.75, 19.75], occupancy: 8, confidence: 16 }]);
        assert_eq!((of(What::Free).len(), of(What::All).len()), (1, 2));
    }

    #[test]
    fn colours_run_from_blue_to_red() {
        let at = |z: f64| VoxelPoint { at_m: [0.0, 0.0, z], occupancy: 1, confidence: 1 };
        let mut scale = Scale::new(Shade::Height);
        [at(10.0), at(30.0)].iter().for_each(|point| scale.add(point));
        let colors = [10.0, 20.0, 30.0].map(|z| scale.color(&at(z)));
        assert_eq!(colors, [[0, 0, 255], [0, 255, 0], [255, 0, 0]]);
    }
}
