//! The rolling window of blocks: which voxels the map holds now, and where each lies in the arena.
//!
//! The arena is one array with a fixed number of block slots; block `b` of an axis with `n` slots lives in slot
//! `b mod n`, so that a moving window never moves data. A voxel's position in the arena is a sum of three parts, one
//! for each axis (slot, brick, voxel within), read from tables: rolling and bricks cost nothing in the inner loop.
//! Units: voxels; indices from the UTM origin outside, from the window's first voxel inside.

use std::ops::Range;
use tsense_contract::{BLOCK_BRICKS, BLOCK_VOXELS, BRICK_EDGE, BRICK_VOXELS, BRICKS_PER_BLOCK, BlockKey};
use tsense_geometry::VoxelIndex;

/// Voxels of a block.
pub const VOXELS_PER_BLOCK: usize = BRICKS_PER_BLOCK * BRICK_VOXELS;

/// Most blocks of any window: positions in the arena are 32-bit, and 4096 blocks are 3.3 GB.
pub const ARENA_BLOCKS_MAX: usize = 4096;

/// Blocks along each axis that cover a space wherever its centre lies, or nothing where that is too many.
pub fn blocks_for(voxel_size_m: f64, space_m: [f64; 3]) -> Option<[usize; 3]> {
    let extents = extent_voxels(voxel_size_m, space_m)?;
    let blocks: [usize; 3] = std::array::from_fn(|axis| (extents[axis] as usize).div_ceil(BLOCK_VOXELS[axis]) + 1);
    let total = blocks.iter().try_fold(1usize, |product, n| product.checked_mul(*n))?;
    let fits = (0..3).all(|axis| blocks[axis] * BLOCK_VOXELS[axis] <= AXIS_VOXELS_MAX);
    (fits && total <= ARENA_BLOCKS_MAX).then_some(blocks)
}

/// A space in whole voxels.
fn extent_voxels(voxel_size_m: f64, space_m: [f64; 3]) -> Option<[i32; 3]> {
    // 30 m / 0.15 m must be 200 voxels, whatever the last bit of the quotient says.
    let extents = space_m.map(|m| (m / voxel_size_m - 1e-6).ceil());
    extents.iter().all(|v| (1.0..1e6).contains(v)).then(|| extents.map(|v| v as i32))
}

/// Most voxels of a window along an axis: 614 m at 0.15 m. A power of two, so that an index is made safe by a mask.
pub const AXIS_VOXELS_MAX: usize = 4096;

/// What each voxel of an axis adds to its position in the arena.
#[derive(Clone, Debug)]
pub struct AxisOffsets {
    table: Box<[u32; AXIS_VOXELS_MAX]>,
    len: usize,
}

impl AxisOffsets {
    fn new(offsets: impl Iterator<Item = u32>) -> Self {
        let (mut table, mut len) = (Box::new([0; AXIS_VOXELS_MAX]), 0);
        for (entry, offset) in table.iter_mut().zip(offsets) {
            *entry = offset;
            len += 1;
        }
        Self { table, len }
    }

    /// The part of voxel `index`, counted from the window's first; another index gives a part of some other voxel.
    #[inline(always)]
    pub fn at(&self, index: i32) -> u32 {
        self.table[index as usize & (AXIS_VOXELS_MAX - 1)]
    }

    /// The part of voxel `index`, or nothing outside of the window.
    fn get(&self, index: i32) -> Option<u32> {
        (0..self.len as i32).contains(&index).then(|| self.at(index))
    }
}

/// Which block slots hold which blocks, and the working space within.
#[derive(Clone, Debug)]
pub struct Window {
    slots: [usize; 3],
    extents: [i32; 3],
    first_block: BlockKey,
    center: VoxelIndex,
    placed: bool,
    offsets: [AxisOffsets; 3],
}

impl Window {
    /// A window for a working space, centred on voxel 0, or nothing where it needs too many blocks.
    pub fn new(voxel_size_m: f64, working_space_m: [f64; 3]) -> Option<Self> {
        let slots = blocks_for(voxel_size_m, working_space_m)?;
        let extents = extent_voxels(voxel_size_m, working_space_m)?;
        let offsets = std::array::from_fn(|_| AxisOffsets::new(std::iter::empty()));
        let mut window = Self { slots, extents, first_block: [0; 3], center: [0; 3], placed: false, offsets };
        window.center_on([0; 3]);
        // The first real centre is met exactly: see `center_on`.
        window.placed = false;
        Some(window)
    }

    /// Block slots in the arena.
    pub fn slot_count(&self) -> usize {
        self.slots.iter().product()
    }

    /// Block slots along each axis.
    pub fn slots(&self) -> [usize; 3] {
        self.slots
    }

    /// The voxel at the centre of the working space.
    pub fn center(&self) -> VoxelIndex {
        self.center
    }

    /// The voxel with the smallest indices that the window holds.
    #[inline]
    pub fn first_voxel(&self) -> VoxelIndex {
        tsense_contract::first_voxel(self.first_block)
    }

    /// Centres the working space. The block window follows by whole blocks, and only when the centre is a tenth of
    /// a block beyond the middle block: a vehicle that stands on a border must not create and drop blocks for ever.
    /// The first centre is met exactly, so that a space that never moves is held whole. True where the set of blocks
    /// changed.
    pub fn center_on(&mut self, center: VoxelIndex) -> bool {
        self.center = center;
        let moved = self.moves_blocks(center);
        for (axis, at) in center.into_iter().enumerate() {
            if self.moves_axis(axis, at) {
                self.first_block[axis] = self.wanted_first(axis, at);
                self.offsets[axis] = self.axis_offsets(axis);
            }
        }
        self.placed = true;
        moved
    }

    /// Whether [`Window::center_on`] would change the set of blocks.
    pub fn moves_blocks(&self, center: VoxelIndex) -> bool {
        (0..3).any(|axis| self.moves_axis(axis, center[axis]))
    }

    fn moves_axis(&self, axis: usize, center: i32) -> bool {
        let edge = BLOCK_VOXELS[axis] as i32;
        let twice_middle = (2 * self.first_block[axis] + self.slots[axis] as i32) * edge;
        !self.placed || (2 * center).abs_diff(twice_middle) > (edge + edge / 5) as u32
    }

    /// First block of the window whose middle is nearest to the centre.
    fn wanted_first(&self, axis: usize, center: i32) -> i32 {
        let edge = BLOCK_VOXELS[axis] as i32;
        (2 * center - self.slots[axis] as i32 * edge + edge).div_euclid(2 * edge)
    }

    /// Part of a position in the arena that each voxel of the window contributes on an axis.
    fn axis_offsets(&self, axis: usize) -> AxisOffsets {
        let per_slot = VOXELS_PER_BLOCK * self.slots[..axis].iter().product::<usize>();
        let per_brick = BRICK_VOXELS * BLOCK_BRICKS[..axis].iter().product::<usize>();
        let per_voxel = BRICK_EDGE.pow(axis as u32);
        let offset = |i: usize| {
            let block = self.first_block[axis] + (i / BLOCK_VOXELS[axis]) as i32;
            let slot = block.rem_euclid(self.slots[axis] as i32) as usize;
            let within = i % BLOCK_VOXELS[axis];
            (slot * per_slot + within / BRICK_EDGE * per_brick + within % BRICK_EDGE * per_voxel) as u32
        };
        AxisOffsets::new((0..self.slots[axis] * BLOCK_VOXELS[axis]).map(offset))
    }

    /// The tables: position in the arena = `x.at(i) + y.at(j) + z.at(k)`, indices from the window's first voxel.
    pub fn offsets(&self) -> [&AxisOffsets; 3] {
        [&self.offsets[0], &self.offsets[1], &self.offsets[2]]
    }

    /// The working space within the window, indices from the window's first voxel: beams are cut to it.
    pub fn working_space(&self) -> [Range<i32>; 3] {
        let first = self.first_voxel();
        std::array::from_fn(|axis| {
            let held = (self.slots[axis] * BLOCK_VOXELS[axis]) as i32;
            let low = self.center[axis] - self.extents[axis] / 2 - first[axis];
            low.clamp(0, held)..(low + self.extents[axis]).clamp(0, held)
        })
    }

    /// Where a voxel, indices from the UTM origin, lies in the arena; nothing where the window does not hold it.
    pub fn position_of(&self, voxel: VoxelIndex) -> Option<usize> {
        let first = self.first_voxel();
        let mut position = 0;
        for axis in 0..3 {
            position += self.offsets[axis].get(voxel[axis].checked_sub(first[axis])?)? as usize;
        }
        Some(position)
    }

    /// The slot of a block; nothing where the window does not hold it.
    pub fn slot_of(&self, key: BlockKey) -> Option<usize> {
        self.position_of(tsense_contract::first_voxel(key)).map(|position| position / VOXELS_PER_BLOCK)
    }

    /// All blocks of the window with their slots, x fastest.
    pub fn blocks(&self) -> impl Iterator<Item = (BlockKey, usize)> + use<> {
        let (first, slots @ [nx, ny, nz]) = (self.first_block, self.slots);
        let places = (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        places.map(move |place| key_and_slot(first, slots, place))
    }
}

fn key_and_slot(first: BlockKey, slots: [usize; 3], place: [usize; 3]) -> (BlockKey, usize) {
    let key: BlockKey = std::array::from_fn(|axis| first[axis] + place[axis] as i32);
    let [x, y, z] = std::array::from_fn(|axis| key[axis].rem_euclid(slots[axis] as i32) as usize);
    (key, x + slots[0] * (y + slots[1] * z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tsense_contract::locate;

    fn default_window() -> Window {
        Window::new(0.15, [30.0, 30.0, 12.0]).unwrap()
    }

    #[test]
    fn the_default_space_needs_27_blocks_wherever_it_lies() {
        assert_eq!(blocks_for(0.15, [30.0, 30.0, 12.0]), Some([3, 3, 3]));
        assert_eq!(blocks_for(0.15, [50.0, 50.0, 40.0]), Some([5, 5, 8]));
        assert_eq!(blocks_for(0.15, [f64::NAN, 30.0, 12.0]), None);
        assert_eq!(blocks_for(0.15, [1e9, 30.0, 12.0]), None);
    }

    #[test]
    fn positions_in_the_arena_agree_with_the_layout_that_readers_know() {
        let mut window = default_window();
        window.center_on([2_460_000, 21_860_000, -266]);
        let first = window.first_voxel();
        for voxel in [[0, 0, 0], [3, 4, 5], [99, 100, 39], [101, 203, 80], [299, 299, 119]] {
            let voxel = std::array::from_fn(|axis| first[axis] + voxel[axis]);
            let (key, brick, inner) = locate(voxel);
            let slot = window.slot_of(key).unwrap();
            let expected = slot * VOXELS_PER_BLOCK + brick * BRICK_VOXELS + inner;
            assert_eq!(window.position_of(voxel), Some(expected));
            assert!(window.blocks().any(|block| block == (key, slot)));
        }
        assert_eq!(window.position_of([first[0] - 1, first[1], first[2]]), None);
        assert_eq!(window.position_of([first[0] + 300, first[1], first[2]]), None);
    }

    #[test]
    fn standing_on_a_border_does_not_move_the_blocks_to_and_fro() {
        let mut window = default_window();
        window.center_on([1000, 0, 0]);
        let moves: usize = (0..100).map(|i| usize::from(window.center_on([1000 + 9 * (i % 2), 0, 0]))).sum();
        assert!(moves <= 1, "{moves}");
    }

    #[test]
    fn a_space_that_is_centred_once_is_held_whole_wherever_that_is() {
        for x in -150..150 {
            let mut window = default_window();
            window.center_on([x, 7 * x, 1000 - x]);
            let lengths = window.working_space().map(|range| range.end - range.start);
            assert_eq!(lengths, [200, 200, 80], "centre {x}");
        }
    }

    proptest! {
        #[test]
        fn the_blocks_cover_the_working_space_but_for_the_tenth_of_a_block_they_lag(
            steps in prop::collection::vec(prop::array::uniform3(-60i32..60), 1..40),
        ) {
            let mut window = default_window();
            let mut center = [3_000_000, -40, 25];
            for step in steps {
                for axis in 0..3 {
                    center[axis] += step[axis];
                }
                window.center_on(center);
                let space = window.working_space();
                for (axis, full) in [200, 200, 80].into_iter().enumerate() {
                    let missing = full - (space[axis].end - space[axis].start);
                    prop_assert!((0..=BLOCK_VOXELS[axis] as i32 / 10).contains(&missing), "{missing}");
                }
            }
        }
    }
}
