//! The evidence of the open window: for every voxel of the map's window the largest weight of the beams that passed,
//! and of those that ended there.
//!
//! Two bytes a voxel in two arrays, so that passing needs no look at what was hit: where beams of full weight pass, a
//! mark is stored and not even read. The arrays follow the window's own indices, brick by brick, x fastest; they are
//! emptied before the window rolls. Pages that no beam reaches cost no memory.

use crate::evidence::{Marks, NOTHING};
use crate::slab::{mask, select};
use crate::window::AXIS_VOXELS_MAX;
use std::ops::Range;
use tsense_contract::{BLOCK_BRICKS, BRICK_EDGE, BRICK_VOXELS};

/// How a voxel's index on one axis moves its mark: `index * voxel + (index mod 4) * correction`. Bricks of 4 x 4 x 4
/// cost a multiplication more than rows, and no table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    voxel: i32,
    correction: i32,
}

/// Bits of an index that count within a brick.
const IN_BRICK: i32 = BRICK_EDGE as i32 - 1;

impl Stride {
    fn new(brick: usize, within: usize) -> Self {
        let voxel = (brick / BRICK_EDGE) as i32;
        Self { voxel, correction: within as i32 - voxel }
    }

    /// The part of index `i`.
    #[inline(always)]
    pub fn at(self, i: i32) -> i32 {
        i.wrapping_mul(self.voxel).wrapping_add((i & IN_BRICK).wrapping_mul(self.correction))
    }

    /// The way from index `i` to the next.
    #[inline(always)]
    pub fn next(self, i: i32) -> i32 {
        let ends_brick = mask(i & IN_BRICK == IN_BRICK);
        select(ends_brick, self.voxel.wrapping_sub(3 * self.correction), self.voxel.wrapping_add(self.correction))
    }

    /// The stride for indices `-1 - i` where the mask is all bits, and the part of index 0 then.
    #[inline(always)]
    pub fn turned(self, turn: i32) -> (Self, i32) {
        let sign = turn | 1;
        (Self { voxel: self.voxel * sign, correction: self.correction * sign }, self.at(-1) & turn)
    }
}

/// In the mark of a hit: the voxel was occupied when the window opened. Hits leave the lower half of the byte to misses,
/// and these have an array of their own.
const WAS_OCCUPIED: u8 = 1;

/// Positions of the longest path: three voxels a slab, and room for what three vectors write beyond it.
const PATH_MAX: usize = 3 * (AXIS_VOXELS_MAX + 16);

/// Marks of all voxels of a window.
pub struct MarkField {
    misses: Box<[Marks]>,
    hits: Box<[Marks]>,
    /// Positions of all marks in `hits`: as many as voxels were hit.
    hit_positions: Vec<u32>,
    strides: [Stride; 3],
    bricks: [usize; 3],
    /// Room for the positions of a path, three a slab.
    path: Box<[u32]>,
}

impl MarkField {
    /// No marks, for a window of so many blocks along each axis.
    pub fn new(blocks: [usize; 3]) -> Self {
        let bricks: [usize; 3] = std::array::from_fn(|axis| blocks[axis] * BLOCK_BRICKS[axis]);
        let [x, y, z] = bricks;
        let brick = [BRICK_VOXELS, BRICK_VOXELS * x, BRICK_VOXELS * x * y];
        Self {
            misses: bytemuck::zeroed_slice_box(x * y * z),
            hits: bytemuck::zeroed_slice_box(x * y * z),
            hit_positions: Vec::new(),
            strides: std::array::from_fn(|axis| Stride::new(brick[axis], BRICK_EDGE.pow(axis as u32))),
            bricks,
            path: vec![0; PATH_MAX].into(),
        }
    }

    /// The strides of x, y, z.
    pub fn strides(&self) -> [Stride; 3] {
        self.strides
    }

    /// Position of a voxel, counted from the window's first.
    pub fn position(&self, voxel: [i32; 3]) -> usize {
        (0..3).map(|axis| self.strides[axis].at(voxel[axis])).sum::<i32>() as usize
    }

    /// Marks of the beams that passed, a byte a voxel.
    pub fn misses(&mut self) -> &mut [u8] {
        bytemuck::cast_slice_mut(&mut self.misses)
    }

    /// The same, and room for the positions of a path.
    pub fn misses_and_path(&mut self) -> (&mut [u8], &mut [u32]) {
        (bytemuck::cast_slice_mut(&mut self.misses), &mut self.path)
    }

    /// Raises the mark of the beams that ended in the voxel at `position`; what it was before. The first one of a window
    /// notes whether the voxel was occupied until then.
    pub fn hit(&mut self, position: usize, mark: u8, occupied: bool) -> u8 {
        let marked = &mut self.hits[position / BRICK_VOXELS].0[position % BRICK_VOXELS];
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
        let mark = self.hits[position / BRICK_VOXELS].0[position % BRICK_VOXELS];
        (mark != NOTHING).then_some(mark & WAS_OCCUPIED != 0)
    }

    /// Raises the mark of what passed through the voxel at `position`.
    pub fn miss(&mut self, position: usize, mark: u8) {
        self.misses[position / BRICK_VOXELS].0[position % BRICK_VOXELS] |= mark;
    }

    /// Takes back the misses of all voxels that were hit, and the hits.
    pub fn protect_hits(&mut self) {
        for position in self.hit_positions.drain(..) {
            let (brick, voxel) = (position as usize / BRICK_VOXELS, position as usize % BRICK_VOXELS);
            (self.misses[brick].0[voxel], self.hits[brick].0[voxel]) = (NOTHING, NOTHING);
        }
    }

    /// Takes the misses of a block's bricks, in their order; the block is counted from the window's first.
    pub fn take_block(&mut self, block: [usize; 3], mut taken: impl FnMut(usize, &Marks)) {
        let [x, y, z]: [Range<usize>; 3] =
            std::array::from_fn(|axis| block[axis] * BLOCK_BRICKS[axis]..(block[axis] + 1) * BLOCK_BRICKS[axis]);
        let mut brick = 0;
        for k in z {
            for j in y.clone() {
                let row = (k * self.bricks[1] + j) * self.bricks[0];
                for i in x.clone() {
                    let misses = &mut self.misses[row + i];
                    if !misses.are_empty() {
                        taken(brick, misses);
                        misses.0 = [NOTHING; BRICK_VOXELS];
                    }
                    brick += 1;
                }
            }
        }
    }
}
