//! The hits of the open window: a byte a voxel, and a word a brick of what they protect.

use super::layout::{HitStride, TILE_BRICKS, Tiles};
use crate::evidence::{Marks, NOTHING};
use crate::untouched::Untouched;
use tsense_contract::BRICK_VOXELS;
use tsense_geometry::VoxelIndex;

/// In the mark of a hit: the voxel was occupied when the window opened.
const WAS_OCCUPIED: u8 = 1;

/// Marks of the beams that ended.
pub struct Hits {
    marks: Untouched<Marks>,
    /// A bit for each voxel that was hit.
    protected: Untouched<u64>,
    /// Positions of all marks: as many as voxels were hit.
    positions: Vec<u32>,
    strides: [HitStride; 3],
}

impl Hits {
    /// None.
    pub fn new(tiles: Tiles) -> Self {
        let bricks = tiles.count() * TILE_BRICKS;
        Self {
            marks: Untouched::zeroed(bricks),
            protected: Untouched::zeroed(bricks),
            positions: Vec::new(),
            strides: tiles.hit_strides(),
        }
    }

    /// Position of a voxel, counted from the window's first.
    #[inline(always)]
    pub fn position(&self, voxel: VoxelIndex) -> usize {
        (0..3).map(|axis| self.strides[axis].at(voxel[axis])).sum::<i32>() as usize
    }

    /// Raises a mark; what it was before. The first one of a window notes whether the voxel was occupied until then.
    #[inline(always)]
    pub fn raise(&mut self, position: usize, mark: u8, occupied: bool) -> u8 {
        let marked = &mut bytemuck::cast_slice_mut::<Marks, u8>(&mut self.marks)[position];
        let before = *marked;
        *marked |= mark;
        if before == NOTHING {
            *marked |= u8::from(occupied) * WAS_OCCUPIED;
            self.protected[position / BRICK_VOXELS] |= 1 << (position % BRICK_VOXELS);
            self.positions.push(position as u32);
        }
        before
    }

    /// Whether a voxel was occupied when the window opened, where a beam has ended in it since; nothing where none has.
    #[inline(always)]
    pub fn was_occupied(&self, position: usize) -> Option<bool> {
        let mark = self.mark(position);
        (mark != NOTHING).then_some(mark & WAS_OCCUPIED != 0)
    }

    /// The mark of a voxel.
    pub fn mark(&self, position: usize) -> u8 {
        bytemuck::cast_slice::<Marks, u8>(&self.marks)[position]
    }

    /// Takes back a hit.
    pub fn take_back(&mut self, position: usize) {
        bytemuck::cast_slice_mut::<Marks, u8>(&mut self.marks)[position] = NOTHING;
        self.protected[position / BRICK_VOXELS] &= !(1 << (position % BRICK_VOXELS));
    }

    /// A word for each brick of a tile: voxels that misses do nothing to.
    #[inline(always)]
    pub fn protected(&self, tile: usize) -> &[u64; TILE_BRICKS] {
        &self.protected.as_chunks().0[tile]
    }

    /// Takes back all.
    pub fn leave(&mut self) {
        let mut positions = std::mem::take(&mut self.positions);
        positions.drain(..).for_each(|position| self.take_back(position as usize));
        // For its memory.
        self.positions = positions;
    }
}
