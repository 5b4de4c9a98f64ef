//! The evidence of the open window: for every voxel of the map's window the largest weight of the beams that passed,
//! and of those that ended there.
//!
//! Two bytes a voxel in two arrays, so that passing needs no look at what was hit: where beams of full weight pass, a
//! mark is stored and not even read. The arrays follow the window's own indices as `layout` says; they are emptied before
//! the window rolls. Pages that no beam reaches cost no memory.

mod found;
mod layout;

use crate::clip::Space;
use crate::evidence::{Marks, NOTHING, overrules};
use crate::untouched::Untouched;
use crate::window::AXIS_VOXELS_MAX;
use found::Found;
use layout::{TILE_EDGE, Tile};
use tsense_contract::{BLOCK_VOXELS, BRICK_EDGE};
use tsense_geometry::VoxelIndex;

pub use found::Room;
pub use layout::{IN_TILE, STEPS, Steps, Stride, TILE_BITS};

/// In the mark of a hit: the voxel was occupied when the window opened. Hits leave the lower half of the byte to misses,
/// and these have an array of their own; the bit above it says that a beam made the hit.
const WAS_OCCUPIED: u8 = 1;

/// Marks of all voxels of a window.
pub struct MarkField {
    misses: Untouched<Tile>,
    hits: Untouched<Tile>,
    /// Positions of all marks in `hits`: as many as voxels were hit.
    hit_positions: Vec<u32>,
    strides: [Stride; 3],
    /// The same as tables, straight and turned round.
    steps: [[Steps; 2]; 3],
    tiles: [usize; 3],
    /// Tiles that marks may have come to: the others need not even be read.
    reached: Vec<bool>,
    /// All of it.
    space: Space,
    /// Misses that are not in their array yet.
    found: Found,
}

impl MarkField {
    /// No marks, for a window of so many blocks along each axis.
    pub fn new(blocks: [usize; 3]) -> Self {
        let voxels: [usize; 3] = std::array::from_fn(|axis| blocks[axis] * BLOCK_VOXELS[axis]);
        let tiles = voxels.map(|voxels| voxels.div_ceil(TILE_EDGE));
        let count = tiles.iter().product();
        let strides = Stride::of(tiles);
        Self {
            misses: Untouched::zeroed(count),
            hits: Untouched::zeroed(count),
            hit_positions: Vec::new(),
            strides,
            steps: strides.map(|stride| [false, true].map(|is_turned| Steps::new(stride, is_turned))),
            tiles,
            reached: vec![false; count],
            space: Space::of(&voxels.map(|voxels| 0..voxels as i32)),
            found: Found::new(),
        }
    }

    /// The strides of x, y, z.
    pub fn strides(&self) -> [Stride; 3] {
        self.strides
    }

    /// The stride of an axis as a table.
    pub fn steps(&self, axis: usize, is_turned: bool) -> &Steps {
        &self.steps[axis][usize::from(is_turned)]
    }

    /// Position of a voxel, counted from the window's first.
    pub fn position(&self, voxel: VoxelIndex) -> usize {
        (0..3).map(|axis| self.strides[axis].at(voxel[axis])).sum::<i32>() as usize
    }

    /// Whether both ends of a segment, and so all of it, lie in the window.
    #[inline(always)]
    pub fn holds(&self, start: [f64; 3], end: [f64; 3]) -> bool {
        self.space.contains(start) & self.space.contains(end)
    }

    /// Notes that marks may come to the block at a place of the window.
    pub fn reach(&mut self, place: [usize; 3]) {
        let [x, y, z] = std::array::from_fn(|axis| {
            let first = place[axis] * BLOCK_VOXELS[axis];
            first / TILE_EDGE..(first + BLOCK_VOXELS[axis]).div_ceil(TILE_EDGE)
        });
        for z in z {
            for y in y.clone() {
                let row = (z * self.tiles[1] + y) * self.tiles[0];
                self.reached[row + x.start..row + x.end].fill(true);
            }
        }
    }

    /// Room for the positions of one path whose marks are to be raised to `mark` at least.
    #[inline(always)]
    pub fn room(&mut self, mark: u8) -> Room<'_> {
        self.found.room(mark, bytes(&mut self.misses))
    }

    /// So many positions were written there, and so many before them still wait.
    ///
    /// # Safety
    ///
    /// They are positions of voxels that the window holds: where a walk is sure of a path, the index of each of its
    /// voxels lies between those of the segment's ends, on every axis.
    #[inline(always)]
    #[allow(unsafe_code, reason = "a check for each mark costs a fifth of the walk")]
    pub unsafe fn found(&mut self, count: usize, waiting: usize) {
        self.found.add(count, waiting);
    }

    /// Takes back what was found and is not marked.
    #[cfg(test)]
    pub fn forget_found(&mut self) -> Vec<u32> {
        self.found.forget()
    }

    /// Marks of the beams that passed, a byte a voxel.
    pub fn misses(&mut self) -> &mut [u8] {
        let misses = bytes(&mut self.misses);
        self.found.raise(misses);
        misses
    }

    /// Raises the mark of the beams that ended in the voxel at `position`; what it was before. The first one of a window
    /// notes whether the voxel was occupied until then.
    pub fn hit(&mut self, position: usize, mark: u8, occupied: bool) -> u8 {
        let marked = &mut bytes(&mut self.hits)[position];
        let before = *marked;
        *marked |= mark;
        if before == NOTHING {
            *marked |= u8::from(occupied) * WAS_OCCUPIED;
            self.hit_positions.push(position as u32);
        }
        before
    }

    /// Whether a voxel was occupied when the window opened, where a beam has ended in it since; nothing where none has.
    pub fn was_occupied(&self, position: usize) -> Option<bool> {
        let mark = bytemuck::cast_slice::<Tile, u8>(&self.hits)[position];
        (mark != NOTHING).then_some(mark & WAS_OCCUPIED != 0)
    }

    /// Raises the mark of what passed through the voxel at `position`.
    pub fn miss(&mut self, position: usize, mark: u8) {
        bytes(&mut self.misses)[position] |= mark;
    }

    /// Whether beams that passed the voxel at `position` overrule what was told of it.
    pub fn are_overruled(&mut self, position: usize) -> bool {
        let misses = self.misses()[position];
        overrules(misses, bytes(&mut self.hits)[position])
    }

    /// Takes back the misses of all voxels that were hit, but for those which overrule; and the hits.
    pub fn protect_hits(&mut self) {
        let (misses, hits) = (bytes(&mut self.misses), bytes(&mut self.hits));
        self.found.raise(misses);
        for position in self.hit_positions.drain(..) {
            let (miss, hit) = (&mut misses[position as usize], &mut hits[position as usize]);
            if !overrules(*miss, *hit) {
                *miss = NOTHING;
            }
            *hit = NOTHING;
        }
    }

    /// The first tile with misses, `from` or behind it.
    #[inline(always)]
    pub fn marked_tile(&self, from: usize) -> Option<MarkedTile> {
        for tile in from..self.reached.len() {
            if !self.reached[tile] {
                continue;
            }
            let bricks = self.misses[tile].marked_bricks();
            if bricks != 0 {
                let [x, y, _] = self.tiles;
                let first = [tile % x, tile / x % y, tile / (x * y)].map(|tile| (tile * TILE_EDGE) as i32);
                return Some(MarkedTile { tile, first, bricks });
            }
        }
        None
    }

    /// The misses of a brick of a tile.
    #[inline(always)]
    pub fn brick(&mut self, of: &MarkedTile, brick: usize) -> &mut Marks {
        &mut self.misses[of.tile].0[brick]
    }

    /// All marks were taken away.
    pub fn leave(&mut self) {
        self.reached.fill(false);
    }
}

/// Marks one by one.
#[inline(always)]
fn bytes(tiles: &mut [Tile]) -> &mut [u8] {
    bytemuck::cast_slice_mut(tiles)
}

/// A tile with misses, and those of its bricks that have some.
#[derive(Clone, Copy)]
pub struct MarkedTile {
    tile: usize,
    /// Its first voxel, counted from the window's first.
    first: VoxelIndex,
    bricks: u64,
}

impl MarkedTile {
    /// The tile behind it.
    #[inline(always)]
    pub fn next(&self) -> usize {
        self.tile + 1
    }

    /// Takes out a brick.
    #[inline(always)]
    pub fn take_brick(&mut self) -> Option<usize> {
        let brick = self.bricks.trailing_zeros() as usize;
        self.bricks &= self.bricks.wrapping_sub(1);
        (brick < u64::BITS as usize).then_some(brick)
    }

    /// The first voxel of a brick.
    #[inline(always)]
    pub fn voxel(&self, brick: usize) -> VoxelIndex {
        let [x, y, z] = self.first;
        let part = |bits: u32| (brick >> bits) as i32 % BRICK_EDGE as i32 * BRICK_EDGE as i32;
        [x + part(0), y + part(2), z + part(4)]
    }
}
