//! The misses of one weight: three fields of rows, one for each axis along which beams may run.

use super::layout::{IN_TILE, RowStride, TILE_BRICKS, TILE_EDGE, TILE_LINES, TILE_ROWS, Tiles};
use super::rows::{Line, add_line};
use super::taken::take_lowest;
use crate::untouched::Untouched;
use tsense_geometry::VoxelIndex;

/// Where rows lie: the field of an axis behind that of the axis before.
pub struct Fields {
    tiles: Tiles,
    strides: [[RowStride; 3]; 3],
}

impl Fields {
    /// The fields of a window.
    pub fn new(tiles: Tiles) -> Self {
        Self { tiles, strides: [0, 1, 2].map(|main| tiles.row_strides(main)) }
    }

    /// The strides of x, y, z in the field of an axis.
    #[inline(always)]
    pub fn strides(&self, main: usize) -> [RowStride; 3] {
        self.strides[main]
    }

    /// Position of the first row in the field of an axis.
    #[inline(always)]
    pub fn first(&self, main: usize) -> i32 {
        (main * self.tiles.count() * TILE_ROWS) as i32
    }

    /// Position of a voxel's row in the field of an axis.
    #[inline(always)]
    pub fn row(&self, main: usize, voxel: VoxelIndex) -> usize {
        let strides = self.strides[main];
        (self.first(main) + (0..3).map(|axis| strides[axis].at(voxel[axis])).sum::<i32>()) as usize
    }
}

/// The misses of one weight.
pub struct Level {
    lines: Untouched<Line>,
    /// Fields that have any.
    used: [bool; 3],
}

impl Level {
    /// None.
    pub fn new(tiles: Tiles) -> Self {
        Self { lines: Untouched::zeroed(3 * tiles.count() * TILE_LINES), used: [false; 3] }
    }

    /// All rows.
    #[inline(always)]
    pub fn rows(&mut self) -> &mut [u32] {
        bytemuck::cast_slice_mut(&mut self.lines)
    }

    /// Notes that beams ran along an axis.
    #[inline(always)]
    pub fn run_along(&mut self, main: usize) {
        self.used[main] = true;
    }

    /// Marks one voxel.
    pub fn miss(&mut self, fields: &Fields, voxel: VoxelIndex) {
        self.run_along(0);
        self.rows()[fields.row(0, voxel)] |= 1 << (voxel[0] & IN_TILE);
    }

    /// Whether a beam passed a voxel: by a bit of its own row, or by one that ran on from the tile before.
    pub fn has(&mut self, fields: &Fields, voxel: VoxelIndex) -> bool {
        let used = self.used;
        let rows = self.rows();
        (0..3).filter(|main| used[*main]).any(|main| {
            let bit = voxel[main] & IN_TILE;
            let mut before = voxel;
            before[main] -= TILE_EDGE as i32;
            let ran_on = before[main] >= 0 && rows[fields.row(main, before)] >> (bit + TILE_EDGE as i32) & 1 == 1;
            ran_on || rows[fields.row(main, voxel)] >> bit & 1 == 1
        })
    }

    /// A bit for each line of a tile that has marks, in the field of each axis.
    #[inline(always)]
    pub fn marked_lines(&self, tiles: Tiles, tile: usize) -> [u16; 3] {
        let mut marked = [0; 3];
        for (main, marked) in marked.iter_mut().enumerate() {
            if self.used[main] {
                let first = line_of(tiles, main, tile);
                for (line, rows) in self.lines[first..first + TILE_LINES].iter().enumerate() {
                    *marked |= u16::from(!rows.is_empty()) << line;
                }
            }
        }
        marked
    }

    /// Takes out lines of a tile: adds them to the words of its bricks; a bit for each brick that has any. Tiles have
    /// to be taken in order, for what runs on into the next one is handed on.
    #[inline(always)]
    pub fn take_lines(&mut self, tiles: Tiles, tile: usize, marked: [u16; 3], bricks: &mut [u64; TILE_BRICKS]) -> u64 {
        let mut with_any = 0;
        for main in 0..3 {
            let first = line_of(tiles, main, tile);
            let next = first + tiles.steps()[main] * TILE_LINES;
            let mut marked = u64::from(marked[main]);
            while let Some(line) = take_lowest(&mut marked) {
                let rows = std::mem::take(&mut self.lines[first + line]);
                with_any |= add_line(&rows, main, line, bricks);
                let beyond = rows.beyond();
                if !beyond.is_empty() {
                    self.lines[next + line].add(&beyond);
                }
            }
        }
        with_any
    }

    /// All marks were taken.
    pub fn leave(&mut self) {
        self.used = [false; 3];
    }
}

/// The first line of a tile in the field of an axis.
#[inline(always)]
fn line_of(tiles: Tiles, main: usize, tile: usize) -> usize {
    (main * tiles.count() + tile) * TILE_LINES
}
