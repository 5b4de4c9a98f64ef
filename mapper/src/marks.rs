//! The evidence of the open window: for every voxel of the map's window the largest weight of the beams that passed,
//! and of those that ended there.
//!
//! Two bytes a voxel in two arrays, so that passing needs no look at what was hit: where beams of full weight pass, a
//! mark is stored and not even read. The arrays follow the window's own indices, brick by brick, x fastest; they are
//! emptied before the window rolls. Pages that no beam reaches cost no memory.

use crate::clip::Space;
use crate::evidence::{FULL_MISS, Marks, NOTHING};
use crate::slab::{mask, select};
use crate::untouched::Untouched;
use crate::window::AXIS_VOXELS_MAX;
use tsense_contract::{BLOCK_BRICKS, BRICK_EDGE, BRICK_VOXELS};

/// How a voxel's index on one axis moves its mark: `index * voxel + (index mod 4) * correction`. Bricks of 4 x 4 x 4
/// cost a multiplication more than rows, and no table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    voxel: i32,
    correction: i32,
}

/// Bits of an index that count within a brick.
pub const IN_BRICK: i32 = BRICK_EDGE as i32 - 1;

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

/// How many these are.
pub const BRICK_BITS: u32 = BRICK_EDGE.ilog2();

/// Indices of a [`Steps`] table.
pub const STEPS: usize = 32;

/// What the indices from a brick's first on add to positions: a table, for processors that look up many at once.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Steps {
    /// The parts of the first indices.
    pub parts: [i32; STEPS],
    /// The way from a brick to the next.
    pub brick: i32,
    /// The part of index 0, which is `-1` on an axis that is turned round.
    pub zero: i32,
}

impl Steps {
    fn new(stride: Stride, is_turned: bool) -> Self {
        let (stride, zero) = stride.turned(mask(is_turned));
        Self { parts: std::array::from_fn(|i| stride.at(i as i32)), brick: stride.at(BRICK_EDGE as i32), zero }
    }
}

/// In the mark of a hit: the voxel was occupied when the window opened. Hits leave the lower half of the byte to misses,
/// and these have an array of their own.
const WAS_OCCUPIED: u8 = 1;

/// Positions of the longest path: three voxels a slab, and room for what three vectors write beyond it.
const PATH_MAX: usize = 3 * (AXIS_VOXELS_MAX + 16);

/// Positions that are found before they are marked: as many as the nearest cache holds beside the marks themselves.
const FOUND_MAX: usize = 2048;

/// Voxels to be marked, of many paths: their marking is one long loop, whose end the processor seldom mistakes.
struct Found {
    positions: Box<[u32]>,
    used: usize,
    mark: u8,
}

impl Found {
    fn new() -> Self {
        Self { positions: vec![0; FOUND_MAX + PATH_MAX].into(), used: 0, mark: NOTHING }
    }

    /// Raises their marks.
    #[inline(always)]
    fn raise(&mut self, marks: &mut [u8]) {
        // The largest mark there is needs no reading of what was there.
        if self.mark == FULL_MISS {
            self.raise_by(marks, |_| FULL_MISS);
        } else {
            let mark = self.mark;
            self.raise_by(marks, |before| before | mark);
        }
        self.used = 0;
    }

    #[inline(always)]
    #[allow(unsafe_code, reason = "a check for each mark costs a fifth of the walk")]
    fn raise_by(&self, marks: &mut [u8], raised: impl Fn(u8) -> u8) {
        for position in &self.positions[..self.used] {
            // SAFETY: a reference is readable. Volatile, for the compiler gathers these loads into vectors otherwise, and
            // then takes the vectors apart again.
            let position = unsafe { std::ptr::from_ref(position).read_volatile() } as usize;
            debug_assert!(position < marks.len());
            // SAFETY: `MarkField::found` was promised that there is such a mark.
            let mark = unsafe { marks.get_unchecked_mut(position) };
            *mark = raised(*mark);
        }
    }
}

/// Marks of all voxels of a window.
pub struct MarkField {
    misses: Untouched<Marks>,
    hits: Untouched<Marks>,
    /// Positions of all marks in `hits`: as many as voxels were hit.
    hit_positions: Vec<u32>,
    strides: [Stride; 3],
    /// The same as tables, straight and turned round.
    steps: [[Steps; 2]; 3],
    bricks: [usize; 3],
    /// All of it.
    space: Space,
    /// Misses that are not in their array yet.
    found: Found,
}

impl MarkField {
    /// No marks, for a window of so many blocks along each axis.
    pub fn new(blocks: [usize; 3]) -> Self {
        let bricks: [usize; 3] = std::array::from_fn(|axis| blocks[axis] * BLOCK_BRICKS[axis]);
        let [x, y, z] = bricks;
        let brick = [BRICK_VOXELS, BRICK_VOXELS * x, BRICK_VOXELS * x * y];
        let strides = std::array::from_fn(|axis| Stride::new(brick[axis], BRICK_EDGE.pow(axis as u32)));
        Self {
            misses: Untouched::zeroed(x * y * z),
            hits: Untouched::zeroed(x * y * z),
            hit_positions: Vec::new(),
            strides,
            steps: strides.map(|stride| [false, true].map(|is_turned| Steps::new(stride, is_turned))),
            bricks,
            space: Space::of(&bricks.map(|bricks| 0..(bricks * BRICK_EDGE) as i32)),
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
    pub fn position(&self, voxel: [i32; 3]) -> usize {
        (0..3).map(|axis| self.strides[axis].at(voxel[axis])).sum::<i32>() as usize
    }

    /// Whether both ends of a segment, and so all of it, lie in the window.
    #[inline(always)]
    pub fn holds(&self, start: [f64; 3], end: [f64; 3]) -> bool {
        self.space.contains(start) & self.space.contains(end)
    }

    /// Room for the positions of one path whose marks are to be raised to `mark` at least.
    #[inline(always)]
    pub fn room(&mut self, mark: u8) -> &mut [u32] {
        if mark != self.found.mark || self.found.used > FOUND_MAX {
            self.raise();
            self.found.mark = mark;
        }
        &mut self.found.positions[self.found.used..]
    }

    /// So many positions were written there.
    ///
    /// # Safety
    ///
    /// They are positions of voxels that the window holds: where a walk is sure of a path, the index of each of its
    /// voxels lies between those of the segment's ends, on every axis.
    #[inline(always)]
    #[allow(unsafe_code, reason = "a check for each mark costs a fifth of the walk")]
    pub unsafe fn found(&mut self, count: usize) {
        self.found.used += count;
    }

    /// Takes back what was found and is not marked.
    #[cfg(test)]
    pub fn forget_found(&mut self) -> Vec<u32> {
        let used = std::mem::take(&mut self.found.used);
        self.found.positions[..used].to_vec()
    }

    #[inline(always)]
    fn raise(&mut self) {
        self.found.raise(bytemuck::cast_slice_mut(&mut self.misses));
    }

    /// Marks of the beams that passed, a byte a voxel.
    pub fn misses(&mut self) -> &mut [u8] {
        self.raise();
        bytemuck::cast_slice_mut(&mut self.misses)
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
        self.raise();
        for position in self.hit_positions.drain(..) {
            let (brick, voxel) = (position as usize / BRICK_VOXELS, position as usize % BRICK_VOXELS);
            (self.misses[brick].0[voxel], self.hits[brick].0[voxel]) = (NOTHING, NOTHING);
        }
    }

    /// The misses of all bricks, a row along x after the other, and how many bricks there are along each axis.
    pub fn bricks(&mut self) -> (&mut [Marks], [usize; 3]) {
        self.raise();
        (&mut self.misses, self.bricks)
    }
}
