//! The dense view of a map: every column of voxels as bits, for tests that look at many voxels at once.
//!
//! In: blocks of bricks and a window in voxel indices. Out: sets of voxels, occupied, free and touched; a voxel in none
//! is unknown. Levels count up from the window's lowest voxel. It keeps no evidence counts and does not follow the
//! vehicle; a view is made anew for each snapshot.

use crate::column_bits::ColumnBits;
use tsense_contract::{BLOCK_BRICKS, BLOCK_VOXELS, BRICK_EDGE, BlockKey, Brick, brick_offset, first_voxel};
use tsense_geometry::{RasterShape, VoxelGrid, VoxelIndex};

/// Most columns of a view: 300 x 300 m at 0.15 m, 64 MB of bits a set at 128 levels.
pub const COLUMNS_MAX: usize = 4_000_000;
/// Most levels of a view: 153.6 m at 0.15 m, beyond any tree on any slope of a working space.
pub const LEVELS_MAX: usize = 1024;

/// A box of voxels, aligned to bricks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// The voxel with the smallest indices.
    pub first: VoxelIndex,
    /// Voxels along x, y, z.
    pub size: [usize; 3],
}

impl Window {
    /// The box of `size_m` around a voxel, grown outwards to whole bricks; sizes are cut to the bounds of a view.
    pub fn around(center: VoxelIndex, size_m: [f64; 3], grid: VoxelGrid) -> Self {
        let edge = BRICK_EDGE as i32;
        let (mut first, mut size) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            let most = if axis == 2 { LEVELS_MAX } else { 2000 };
            let half = ((size_m[axis] / grid.size_m() / 2.0).ceil() as i32).clamp(edge, most as i32 / 2 - edge);
            let from = center[axis].saturating_sub(half).div_euclid(edge) * edge;
            let to = (center[axis].saturating_add(half - 1).div_euclid(edge)) * edge + edge;
            (first[axis], size[axis]) = (from, (to - from).max(edge) as usize);
        }
        Self { first, size }
    }

    /// Most columns of such a box, wherever its centre lies.
    pub fn columns_max(size_m: [f64; 3], grid: VoxelGrid) -> usize {
        let boxes = (0..BRICK_EDGE as i32).map(|at| Self::around([at; 3], size_m, grid));
        let size = boxes.fold([0; 2], |most, b| [0, 1].map(|axis| b.size[axis].max(most[axis])));
        size[0] * size[1]
    }

    /// The box that covers whole blocks, or nothing where there is none or the box is beyond the bounds of a view.
    pub fn covering(keys: impl IntoIterator<Item = BlockKey>) -> Option<Self> {
        let mut ends: Option<(BlockKey, BlockKey)> = None;
        for key in keys {
            let (low, high) = ends.get_or_insert((key, key));
            for axis in 0..3 {
                low[axis] = low[axis].min(key[axis]);
                high[axis] = high[axis].max(key[axis]);
            }
        }
        let (low, high) = ends?;
        let blocks = |axis: usize| high[axis].abs_diff(low[axis]) as usize + 1;
        let size: [usize; 3] = std::array::from_fn(|axis| blocks(axis).saturating_mul(BLOCK_VOXELS[axis]));
        let fits = size[0].saturating_mul(size[1]) <= COLUMNS_MAX && size[2] <= LEVELS_MAX;
        fits.then(|| Self { first: first_voxel(low), size })
    }
}

/// What is known of a box of voxels at one instant.
#[derive(Clone, Debug)]
pub struct View {
    /// Where its columns stand; a cell is a column.
    pub shape: RasterShape,
    /// Voxel index of level 0 along z.
    pub first_level: i32,
    /// Levels of a column.
    pub levels: usize,
    /// Voxels in which beams end.
    pub occupied: ColumnBits,
    /// Voxels that beams pass.
    pub free: ColumnBits,
    /// Voxels in which some beams ended: the occupied ones, and porous ones that more beams pass.
    pub touched: ColumnBits,
}

impl View {
    /// An empty view of a window.
    pub fn unknown(window: Window, grid: VoxelGrid) -> Self {
        let [width, height, levels] = window.size;
        let first_cell = [window.first[0], window.first[1]];
        let shape = RasterShape { first_cell, width, height, cell_m: grid.size_m() };
        let bits = ColumnBits::empty(shape.len(), levels);
        Self { shape, first_level: window.first[2], levels, occupied: bits.clone(), free: bits.clone(), touched: bits }
    }

    /// The view of a window from the blocks that reach into it. Voxels with less than `confidence_min` are unknown.
    pub fn of_blocks<'a>(
        window: Window,
        grid: VoxelGrid,
        blocks: impl IntoIterator<Item = (BlockKey, &'a [Brick])>,
        confidence_min: u8,
    ) -> Self {
        let mut view = Self::unknown(window, grid);
        for (key, bricks) in blocks {
            view.add_block(key, bricks, confidence_min.max(1));
        }
        view
    }

    /// Height of the lower face of a level, metres above the ellipsoid.
    pub fn level_bottom_m(&self, level: usize) -> f64 {
        (f64::from(self.first_level) + level as f64) * self.shape.cell_m
    }

    /// The lower face of the view, metres above the ellipsoid: heights of a classification are relative to it.
    pub fn base_m(&self) -> f64 {
        self.level_bottom_m(0)
    }

    fn add_block(&mut self, key: BlockKey, bricks: &[Brick], confidence_min: u8) {
        let corner = first_voxel(key);
        let Some([xs, ys, zs]) = self.bricks_inside(corner) else { return };
        for z in zs {
            for y in ys.clone() {
                for x in xs.clone() {
                    // A block shorter than promised ends here; what is missing stays unknown.
                    let Some(brick) = bricks.get(brick_offset([x, y, z])) else { return };
                    let states = States::of(brick, confidence_min);
                    if states.occupied | states.free | states.touched != 0 {
                        let at = [x, y, z].map(|i| (i * BRICK_EDGE) as i32);
                        self.add_brick(std::array::from_fn(|axis| corner[axis] + at[axis]), &states);
                    }
                }
            }
        }
    }

    /// Which bricks of a block lie wholly inside the view, along each axis.
    fn bricks_inside(&self, corner: VoxelIndex) -> Option<[std::ops::Range<usize>; 3]> {
        let first = [self.shape.first_cell[0], self.shape.first_cell[1], self.first_level];
        let size = [self.shape.width, self.shape.height, self.levels];
        let edge = BRICK_EDGE as i64;
        let mut ranges = [0..0, 0..0, 0..0];
        for axis in 0..3 {
            let start = i64::from(first[axis]) - i64::from(corner[axis]);
            let end = start + size[axis] as i64;
            let from = (start + edge - 1).div_euclid(edge).max(0);
            let to = end.div_euclid(edge).min(BLOCK_BRICKS[axis] as i64);
            if from >= to {
                return None;
            }
            ranges[axis] = from as usize..to as usize;
        }
        Some(ranges)
    }

    fn add_brick(&mut self, voxel: VoxelIndex, states: &States) {
        let column0 = (voxel[0] - self.shape.first_cell[0]) as usize;
        let row0 = (voxel[1] - self.shape.first_cell[1]) as usize;
        let level = (voxel[2] - self.first_level) as usize;
        for y in 0..BRICK_EDGE {
            for x in 0..BRICK_EDGE {
                let column = (row0 + y) * self.shape.width + column0 + x;
                let inner = x + BRICK_EDGE * y;
                self.occupied.insert_four(column, level, column_of_brick(states.occupied, inner));
                self.free.insert_four(column, level, column_of_brick(states.free, inner));
                self.touched.insert_four(column, level, column_of_brick(states.touched, inner));
            }
        }
    }
}

/// Least occupancy of a porous voxel. A voxel that only ever was passed has an occupancy of minus its confidence, until
/// clamps and fading part the two; far below zero nothing is left to tell.
const POROUS_MIN: i8 = -4;

/// The voxels of a brick by state, as bits in its own order. Undecided voxels are neither occupied nor free.
struct States {
    occupied: u64,
    free: u64,
    touched: u64,
}

impl States {
    fn of(brick: &Brick, confidence_min: u8) -> Self {
        let mut states = Self { occupied: 0, free: 0, touched: 0 };
        // Most bricks of the air and below the ground are unknown.
        if bytemuck::cast_slice::<u8, [u8; 8]>(&brick.confidence).iter().all(|eight| u64::from_le_bytes(*eight) == 0) {
            return states;
        }
        let known = brick.confidence.map(|confidence| confidence >= confidence_min);
        let set = |is: [bool; 64]| packed(std::array::from_fn(|i| is[i] & known[i]));
        states.occupied = set(brick.occupancy.map(|o| o > 0));
        states.free = set(brick.occupancy.map(|o| o < 0));
        // An occupancy of at least -4 has a positive counterpart, and confidences above 127 need not be told apart.
        let confidence = brick.confidence.map(|confidence| confidence.min(127) as i8);
        let is_porous = |i: usize| brick.occupancy[i].wrapping_neg() < confidence[i];
        states.touched = set(std::array::from_fn(|i| (brick.occupancy[i] >= POROUS_MIN) & is_porous(i)));
        states
    }
}

/// Sixty-four truths as bits: eight bytes of 0 or 1 at a time, gathered into the highest byte by a product whose partial
/// products do not meet.
fn packed(truths: [bool; 64]) -> u64 {
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let bytes = truths.map(u8::from);
    let eights = bytemuck::cast_slice::<u8, [u8; 8]>(&bytes).iter();
    let bits = eights.map(|eight| u64::from_le_bytes(*eight).wrapping_mul(GATHER) >> 56);
    bits.enumerate().fold(0, |bits, (i, eight)| bits | eight << (8 * i))
}

/// The four levels of one column of a brick: bits `inner + 16 * level` gathered into the lowest four by a product
/// whose partial sums do not meet.
fn column_of_brick(bits: u64, inner: usize) -> u64 {
    const LEVELS: u64 = 1 | 1 << 16 | 1 << 32 | 1 << 48;
    const GATHER: u64 = 1 << 48 | 1 << 33 | 1 << 18 | 1 << 3;
    ((bits >> inner & LEVELS).wrapping_mul(GATHER) >> 48) & 0xf
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::cell::Cell;
    use tsense_contract::{BRICKS_PER_BLOCK, VoxelState, locate};

    fn grid() -> VoxelGrid {
        VoxelGrid::new(0.15).unwrap()
    }

    #[test]
    fn a_window_is_aligned_to_bricks_and_holds_its_size() {
        let window = Window::around([2_460_001, -7, 266], [30.0, 30.0, 12.0], grid());
        assert!(window.first.iter().all(|i| i.rem_euclid(4) == 0));
        assert_eq!(window.size, [204, 204, 84], "200 x 200 x 80 grown to whole bricks");
        assert_eq!(Window::around([2_460_000, -8, 264], [30.0, 30.0, 12.0], grid()).size, [200, 200, 80]);
        assert_eq!(Window::covering([[0, 0, 0], [1, 0, 2]]).unwrap().size, [200, 100, 120]);
        assert_eq!(Window::covering([[0, 0, 0], [i32::MAX, 0, i32::MIN]]), None);
    }

    /// The plain version: one voxel at a time.
    #[test]
    fn a_view_says_of_every_voxel_what_its_brick_says() {
        let (compared, known) = (Cell::new(0), Cell::new(0));
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let corner = prop::array::uniform3(-30i32..60);
        runner
            .run(&(corner, any::<u64>()), |(first, seed)| {
                let block = noisy_block(seed);
                let window = Window { first: first.map(|i| i.div_euclid(4) * 4), size: [40, 32, 72] };
                let view = View::of_blocks(window, grid(), [([0, 0, 0], &block[..])], 1);
                for (x, y, z) in (0..40).flat_map(|x| (0..32).flat_map(move |y| (0..72).map(move |z| (x, y, z)))) {
                    let voxel: VoxelIndex = [0, 1, 2].map(|a| window.first[a] + [x, y, z][a] as i32);
                    let (key, brick, inner) = locate(voxel);
                    let expected = match (key, &block[brick]) {
                        ([0, 0, 0], brick) if brick.occupancy[inner] != 0 => brick.state(inner),
                        _ => VoxelState::Unknown,
                    };
                    let column = y * 40 + x;
                    prop_assert_eq!(view.occupied.contains(column, z), expected == VoxelState::Occupied);
                    prop_assert_eq!(view.free.contains(column, z), expected == VoxelState::Free);
                    prop_assert!(expected != VoxelState::Occupied || view.touched.contains(column, z));
                    known.set(known.get() + usize::from(expected != VoxelState::Unknown));
                    compared.set(compared.get() + 1);
                }
                Ok(())
            })
            .unwrap();
        assert!(compared.get() > 1_000_000 && known.get() > 100_000, "{compared:?} compared, {known:?} known");
    }

    /// The plain version: one voxel at a time, at the corners of what bytes hold.
    #[test]
    fn the_states_of_a_brick_are_those_of_its_voxels() {
        let values = [0u8, 1, 3, 4, 5, 127, 128, 250, 255];
        let mut told = [0; 3];
        for (k, confidence_min) in (0..200).flat_map(|k| [1u8, 4, 200].map(|min| (k, min))) {
            let mut brick = Brick::UNKNOWN;
            for i in 0..64 {
                brick.occupancy[i] = values[(i * 5 + k) % 9] as i8;
                brick.confidence[i] = values[(i * i + 2 * k) % 9];
            }
            let states = States::of(&brick, confidence_min);
            for i in 0..64 {
                let (o, c) = (i32::from(brick.occupancy[i]), i32::from(brick.confidence[i]));
                let known = c >= i32::from(confidence_min);
                let plain = [known && o > 0, known && o < 0, known && o > -c && o >= -4];
                let fast = [states.occupied, states.free, states.touched].map(|bits| bits >> i & 1 == 1);
                assert_eq!(fast, plain, "occupancy {o}, confidence {c}, at least {confidence_min}");
                (0..3).for_each(|s| told[s] += usize::from(plain[s]));
            }
        }
        assert!(told.iter().all(|count| *count > 1000), "{told:?}");
    }

    fn noisy_block(mut seed: u64) -> Vec<Brick> {
        let mut block = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
        for brick in &mut block {
            for i in 0..64 {
                seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                brick.confidence[i] = (seed >> 60) as u8 / 4;
                brick.occupancy[i] = (seed >> 50) as i8 / 40;
            }
        }
        block
    }

    #[test]
    fn a_block_cut_short_leaves_the_rest_unknown() {
        let block = noisy_block(1);
        let window = Window::covering([[0, 0, 0]]).unwrap();
        let view = View::of_blocks(window, grid(), [([0, 0, 0], &block[..1])], 1);
        assert!((4..100).all(|column| view.occupied.count(column, 0, 40) == 0));
    }
}
