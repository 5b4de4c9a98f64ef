//! Rows of bits become words of bricks.
//!
//! A row has a bit for each of a tile's sixteen voxels along the axis of its field, and as many again for what a run
//! goes on into the next tile. The sixteen rows of a line pass through the same four bricks. A brick's word has a bit
//! for each of its voxels, x fastest, as bricks have everywhere.

use super::layout::{TILE_BRICKS, TILE_EDGE};
use tsense_contract::BRICK_EDGE;

/// Rows of a cache line: those of four bricks that follow each other along the rows.
pub const LINE_ROWS: usize = BRICK_EDGE * BRICK_EDGE;

/// A cache line of rows; the first of the two other axes is the faster one.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Line(pub [u32; LINE_ROWS]);

impl Line {
    /// Whether no row has a bit.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.0 == [0; LINE_ROWS]
    }

    /// What runs on into the next tile, as rows of that.
    #[inline(always)]
    pub fn beyond(&self) -> Self {
        let mut beyond = *self;
        for row in &mut beyond.0 {
            *row >>= TILE_EDGE;
        }
        beyond
    }

    /// Adds the bits of another line.
    #[inline(always)]
    pub fn add(&mut self, other: &Self) {
        for (row, other) in self.0.iter_mut().zip(&other.0) {
            *row |= other;
        }
    }

    /// The words of the four bricks, along `axis`. No closures: they would not be compiled for the instruction set.
    #[inline(always)]
    pub fn words(&self, axis: usize) -> [u64; BRICK_EDGE] {
        // Digits of a bit's place, in fours: rows as they come are (slow, fast, brick, along).
        let mut rows = [0; LINE_ROWS];
        for (row, both) in rows.iter_mut().zip(&self.0) {
            *row = (*both as u16).to_le();
        }
        let mut words: [u64; BRICK_EDGE] = bytemuck::cast(rows);
        // Now (slow, brick, fast, along), then by bricks (slow, fast, along).
        for word in &mut words {
            *word = transpose_nibbles(u64::from_le(*word));
        }
        words = transpose_sixteens(words);
        for word in &mut words {
            *word = match axis {
                0 => *word,
                1 => transpose_bits(*word),
                _ => transpose_nibbles(transpose_bits(*word)),
            };
        }
        words
    }
}

/// The brick of a tile in which a line of the rows along `axis` begins, and the way to the next of its four.
pub const fn bricks_of(axis: usize, line: usize) -> (usize, usize) {
    let (fast, slow) = (line % BRICK_EDGE, line / BRICK_EDGE);
    match axis {
        0 => (BRICK_EDGE * line, 1),
        1 => (fast + BRICK_EDGE * BRICK_EDGE * slow, BRICK_EDGE),
        _ => (line, BRICK_EDGE * BRICK_EDGE),
    }
}

/// Adds the words of a line to those of a tile's bricks; a bit for each that has any now.
#[inline(always)]
pub fn add_line(rows: &Line, axis: usize, line: usize, bricks: &mut [u64; TILE_BRICKS]) -> u64 {
    let ((first, step), words) = (bricks_of(axis, line), rows.words(axis));
    let mut marked = 0;
    for brick in 0..BRICK_EDGE {
        bricks[first + step * brick] |= words[brick];
        marked |= u64::from(words[brick] != 0) << (first + step * brick);
    }
    marked
}

/// Sixteen bits `b` of word `a` and sixteen bits `a` of word `b` change places.
#[inline(always)]
fn transpose_sixteens([a, b, c, d]: [u64; 4]) -> [u64; 4] {
    let ((a, b), (c, d)) = (exchanged(a, b, 16, 0x0000_ffff_0000_ffff), exchanged(c, d, 16, 0x0000_ffff_0000_ffff));
    let ((a, c), (b, d)) = (exchanged(a, c, 32, 0xffff_ffff), exchanged(b, d, 32, 0xffff_ffff));
    [a, b, c, d]
}

/// The bits of `mask` in the second word and those `by` above them in the first change places.
#[inline(always)]
fn exchanged(first: u64, second: u64, by: u32, mask: u64) -> (u64, u64) {
    let differ = ((first >> by) ^ second) & mask;
    (first ^ (differ << by), second ^ differ)
}

/// Swaps the two upper digits of a bit's place in fours: nibble `b` of sixteen bits `a` and nibble `a` of sixteen
/// bits `b`.
#[inline(always)]
fn transpose_nibbles(word: u64) -> u64 {
    let word = swapped(word, 12, 0x0000_f0f0_0000_f0f0);
    swapped(word, 24, 0x0000_0000_ff00_ff00)
}

/// Swaps the two lower digits: bit `b` of nibble `a` and bit `a` of nibble `b`, in each sixteen bits.
#[inline(always)]
fn transpose_bits(word: u64) -> u64 {
    let word = swapped(word, 3, 0x0a0a_0a0a_0a0a_0a0a);
    swapped(word, 6, 0x00cc_00cc_00cc_00cc)
}

/// Swaps the bits of `mask` with those `by` above them.
#[inline(always)]
fn swapped(word: u64, by: u32, mask: u64) -> u64 {
    let differ = (word ^ (word >> by)) & mask;
    word ^ differ ^ (differ << by)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::marks::layout::{IN_TILE, TILE_LINES, Tiles};
    use crate::testing::Random;

    #[test]
    fn each_voxel_of_a_row_comes_to_its_bit_of_its_brick() {
        let mut random = Random(7);
        for axis in 0..3 {
            let strides = Tiles([1; 3]).row_strides(axis);
            let mut lines = [Line::default(); TILE_LINES];
            let mut expected = [0u64; TILE_BRICKS];
            for _ in 0..700 {
                let voxel: [i32; 3] = std::array::from_fn(|_| random.bits() as i32 & IN_TILE);
                let row = (0..3).map(|of| strides[of].at(voxel[of])).sum::<i32>() as usize;
                lines[row / LINE_ROWS].0[row % LINE_ROWS] |= 1 << voxel[axis];
                let place = |divide: fn(i32) -> i32| voxel.iter().rev().fold(0, |place, i| 4 * place + divide(*i));
                expected[place(|i| i / 4) as usize] |= 1 << place(|i| i % 4);
            }
            let (mut bricks, mut marked) = ([0; TILE_BRICKS], 0);
            for (line, rows) in lines.iter().enumerate() {
                marked |= add_line(rows, axis, line, &mut bricks);
            }
            assert_eq!(bricks, expected, "axis {axis}");
            assert!((0..TILE_BRICKS).all(|brick| (marked >> brick & 1 == 1) == (bricks[brick] != 0)));
        }
    }

    #[test]
    fn what_runs_on_into_the_next_tile_is_its_rows() {
        let mut line = Line([0x0003_8001; 16]);
        assert_eq!(line.beyond(), Line([3; 16]));
        assert!(!line.is_empty() && line.beyond().beyond().is_empty());
        line.add(&Line([4; 16]));
        assert_eq!(line, Line([0x0003_8005; 16]));
        assert_eq!(Line([0xffff_0000; 16]).words(2), [0; 4]);
    }
}
