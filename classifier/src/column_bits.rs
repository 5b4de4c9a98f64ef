//! A set of voxels as bits, so that one step looks at 64 levels of a column.
//!
//! The bits of one word of levels lie together for all columns (`word` major): steps over neighbouring columns run along
//! memory.

/// A set of voxels: one bit each, in words of 64 levels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColumnBits {
    columns: usize,
    words: usize,
    bits: Vec<u64>,
}

impl ColumnBits {
    /// The empty set.
    pub fn empty(columns: usize, levels: usize) -> Self {
        let words = levels.div_ceil(64).max(1);
        Self { columns, words, bits: vec![0; columns * words] }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Words of 64 levels a column.
    pub fn words(&self) -> usize {
        self.words
    }

    /// Word `word` (levels `64 * word` and up) of every column.
    pub fn plane(&self, word: usize) -> &[u64] {
        &self.bits[word * self.columns..(word + 1) * self.columns]
    }

    /// Word `word` of every column, to be changed.
    pub fn plane_mut(&mut self, word: usize) -> &mut [u64] {
        &mut self.bits[word * self.columns..(word + 1) * self.columns]
    }

    /// All words.
    pub fn bits_mut(&mut self) -> &mut [u64] {
        &mut self.bits
    }

    /// All words, plane after plane.
    pub fn bits(&self) -> &[u64] {
        &self.bits
    }

    /// Puts a voxel into the set; levels outside are ignored.
    pub fn insert(&mut self, column: usize, level: usize) {
        if level < self.words * 64 {
            self.bits[(level / 64) * self.columns + column] |= 1 << (level % 64);
        }
    }

    /// Puts four levels from `level` up into the set, as the lowest bits of `four`; they may reach over the border of two
    /// words.
    pub(crate) fn insert_four(&mut self, column: usize, level: usize, four: u64) {
        let (word, shift) = (level / 64, level % 64);
        self.bits[word * self.columns + column] |= four << shift;
        if shift > 60 && word + 1 < self.words {
            self.bits[(word + 1) * self.columns + column] |= four >> (64 - shift);
        }
    }

    /// Takes a voxel out of the set.
    pub fn remove(&mut self, column: usize, level: usize) {
        if level < self.words * 64 {
            self.bits[(level / 64) * self.columns + column] &= !(1 << (level % 64));
        }
    }

    /// Whether a voxel is in the set; levels outside are not.
    pub fn contains(&self, column: usize, level: usize) -> bool {
        level < self.words * 64 && self.bits[(level / 64) * self.columns + column] >> (level % 64) & 1 == 1
    }

    /// How many voxels of a column are in the set from level `from` up to below `to`.
    pub fn count(&self, column: usize, from: usize, to: usize) -> usize {
        self.masked(column, from, to).map(|(_, bits)| bits.count_ones() as usize).sum()
    }

    /// The lowest voxel of the set from level `from` up to below `to`.
    pub fn lowest(&self, column: usize, from: usize, to: usize) -> Option<usize> {
        let (word, bits) = self.masked(column, from, to).find(|(_, bits)| *bits != 0)?;
        Some(word * 64 + bits.trailing_zeros() as usize)
    }

    /// The highest voxel of the set from level `from` up to below `to`.
    pub fn highest(&self, column: usize, from: usize, to: usize) -> Option<usize> {
        let (word, bits) = self.masked(column, from, to).filter(|(_, bits)| *bits != 0).last()?;
        Some(word * 64 + 63 - bits.leading_zeros() as usize)
    }

    /// The words that hold levels `from..to`, other levels masked out.
    #[inline]
    fn masked(&self, column: usize, from: usize, to: usize) -> impl Iterator<Item = (usize, u64)> + '_ {
        let to = to.min(self.words * 64);
        let words = if from < to { from / 64..to.div_ceil(64) } else { 0..0 };
        words.map(move |word| {
            let above = if from > word * 64 { u64::MAX << (from - word * 64) } else { u64::MAX };
            let left = to - word * 64;
            let below = if left < 64 { (1 << left) - 1 } else { u64::MAX };
            (word, self.bits[word * self.columns + column] & above & below)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_ends_respect_ranges_across_words() {
        let mut bits = ColumnBits::empty(2, 130);
        for level in [0, 63, 64, 100, 129] {
            bits.insert(1, level);
        }
        assert_eq!(bits.count(1, 0, 130), 5);
        assert_eq!(bits.count(1, 1, 100), 2);
        assert_eq!(bits.count(0, 0, 130), 0);
        assert_eq!((bits.lowest(1, 1, 130), bits.highest(1, 0, 129)), (Some(63), Some(100)));
        assert_eq!((bits.lowest(1, 65, 100), bits.count(1, 50, 20), bits.highest(1, 500, 900)), (None, 0, None));
    }
}
