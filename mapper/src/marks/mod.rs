//! The evidence of the open window: for every voxel of the map's window the largest weight of the beams that passed,
//! and of those that ended there.
//!
//! What passed is a bit a voxel for each weight, so that a run of voxels is marked at once; what ended is a byte a
//! voxel, in an array of its own, so that passing needs no look at what was hit. The arrays follow the window's own
//! indices as `layout` says; they are emptied before the window rolls. Pages that no beam reaches cost no memory.

mod found;
mod hits;
mod layout;
mod level;
mod rows;
mod taken;

use crate::clip::Space;
use crate::evidence::{LEVELS, Passed, overrules};
use crate::window::AXIS_VOXELS_MAX;
use found::Found;
use hits::Hits;
use layout::{TILE_EDGE, Tiles};
use level::{Fields, Level};
use tsense_contract::BLOCK_VOXELS;
use tsense_geometry::VoxelIndex;

pub use found::Room;
pub use layout::{IN_TILE, RowStride, STEPS, Steps, TILE_BITS};
pub use taken::{TakenTile, take_lowest};

/// Marks of all voxels of a window.
pub struct MarkField {
    /// What passed, by weight: a quarter, two, three, four.
    levels: [Level; LEVELS],
    fields: Fields,
    /// The strides of rows as tables: for each field, each axis, straight and turned round.
    steps: [[[Steps; 2]; 3]; 3],
    /// What ended.
    hits: Hits,
    tiles: Tiles,
    /// Tiles that marks may have come to: the others need not even be read.
    reached: Vec<bool>,
    /// All of it.
    space: Space,
    /// Misses that are not in their rows yet.
    found: Found,
}

impl MarkField {
    /// No marks, for a window of so many blocks along each axis.
    pub fn new(blocks: [usize; 3]) -> Self {
        let voxels: [usize; 3] = std::array::from_fn(|axis| blocks[axis] * BLOCK_VOXELS[axis]);
        let tiles = Tiles(voxels.map(|voxels| voxels.div_ceil(TILE_EDGE)));
        Self {
            levels: std::array::from_fn(|_| Level::new(tiles)),
            fields: Fields::new(tiles),
            steps: [0, 1, 2].map(|main| tiles.row_strides(main).map(Steps::both)),
            hits: Hits::new(tiles),
            tiles,
            reached: vec![false; tiles.count()],
            space: Space::of(&voxels.map(|voxels| 0..voxels as i32)),
            found: Found::new(),
        }
    }

    /// The strides of x, y, z in the field of an axis.
    #[inline(always)]
    pub fn strides(&self, main: usize) -> [RowStride; 3] {
        self.fields.strides(main)
    }

    /// A stride in the field of an axis as a table.
    #[inline(always)]
    pub fn steps(&self, main: usize, axis: usize, is_turned: bool) -> &Steps {
        &self.steps[main][axis][usize::from(is_turned)]
    }

    /// Position of the first row in the field of an axis.
    #[inline(always)]
    pub fn first_row(&self, main: usize) -> i32 {
        self.fields.first(main)
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
                let row = (z * self.tiles.0[1] + y) * self.tiles.0[0];
                self.reached[row + x.start..row + x.end].fill(true);
            }
        }
    }

    /// Room for the runs of one path along an axis, of a beam of this level.
    #[inline(always)]
    pub fn room(&mut self, level: usize, main: usize) -> Room<'_> {
        if self.found.is_full_for(level) {
            self.raise();
            self.found.begin(level);
        }
        let level = &mut self.levels[level];
        level.run_along(main);
        self.found.room(level.rows())
    }

    /// So many runs were written there, and so many before them still wait.
    ///
    /// # Safety
    ///
    /// Their positions are those of rows that the window holds: where a walk is sure of a path, the index of each of
    /// its voxels lies between those of the segment's ends, on every axis.
    #[inline(always)]
    #[allow(unsafe_code, reason = "a check for each run costs a tenth of the walk")]
    pub unsafe fn found(&mut self, count: usize, waiting: usize) {
        self.found.add(count, waiting);
    }

    /// Sets the bits that were found.
    #[inline(always)]
    fn raise(&mut self) {
        let rows = self.levels[self.found.level()].rows();
        self.found.raise(rows);
    }

    /// Takes back what was found and is not marked.
    #[cfg(test)]
    pub fn forget_found(&mut self) -> Vec<(u32, u32)> {
        self.found.forget()
    }

    /// A beam of this level passed through a voxel.
    pub fn miss(&mut self, voxel: VoxelIndex, level: usize) {
        self.levels[level].miss(&self.fields, voxel);
    }

    /// Raises the mark of the beams that ended in a voxel; what it was before. The first one of a window notes
    /// whether the voxel was occupied until then.
    #[inline(always)]
    pub fn hit(&mut self, voxel: VoxelIndex, mark: u8, occupied: bool) -> u8 {
        self.hits.raise(self.hits.position(voxel), mark, occupied)
    }

    /// Whether a voxel was occupied when the window opened, where a beam has ended in it since; nothing where none has.
    #[inline(always)]
    pub fn was_occupied(&self, voxel: VoxelIndex) -> Option<bool> {
        self.hits.was_occupied(self.hits.position(voxel))
    }

    /// Takes back the hits of a voxel where beams that passed overrule what was told of it; whether they do.
    pub fn take_back_overruled(&mut self, voxel: VoxelIndex) -> bool {
        self.raise();
        let position = self.hits.position(voxel);
        let passed = (0..LEVELS).rev().find(|level| self.levels[*level].has(&self.fields, voxel));
        let is_overruled = passed.is_some_and(|level| overrules(level as u8 + 1, self.hits.mark(position)));
        if is_overruled {
            self.hits.take_back(position);
        }
        is_overruled
    }

    /// Takes the misses out of the first tile that has any, `from` or behind it. False where there is none. All tiles
    /// have to be taken, in order, and all their bricks.
    #[inline(always)]
    pub fn take_tile(&mut self, from: usize, into: &mut TakenTile) -> bool {
        self.raise();
        into.bricks = 0;
        for tile in from..self.reached.len() {
            if self.reached[tile] {
                self.take(tile, into);
            }
            if into.bricks != 0 {
                return true;
            }
        }
        false
    }

    #[inline(always)]
    fn take(&mut self, tile: usize, into: &mut TakenTile) {
        let [x, y, _] = self.tiles.0;
        into.tile = tile;
        into.first = [tile % x, tile / x % y, tile / (x * y)].map(|tile| (tile * TILE_EDGE) as i32);
        for (level, words) in self.levels.iter_mut().zip(&mut into.words) {
            let marked = level.marked_lines(self.tiles, tile);
            if marked != [0; 3] {
                into.bricks |= level.take_lines(self.tiles, tile, marked, words);
            }
        }
    }

    /// Takes the misses out of a brick of a tile, but for those of voxels that were hit.
    #[inline(always)]
    pub fn take_brick(&self, tile: &mut TakenTile, brick: usize) -> Passed {
        let mut passed = Passed([0; LEVELS]);
        for level in 0..LEVELS {
            passed.0[level] = std::mem::take(&mut tile.words[level][brick]) & !self.hits.protected(tile.tile)[brick];
        }
        passed
    }

    /// All marks were taken; the hits go too.
    pub fn leave(&mut self) {
        self.reached.fill(false);
        self.levels.iter_mut().for_each(Level::leave);
        self.hits.leave();
    }
}
