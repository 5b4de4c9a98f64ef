//! What is kept about a block beside its voxels: which one it is, what changed, what still waits.

use tsense_contract::{BRICKS_PER_BLOCK, BlockKey};

/// Words of the set.
pub const WORDS: usize = BRICKS_PER_BLOCK.div_ceil(64);

/// A bit for each brick of a block. It knows how many it has: most blocks of a large window have none to tell of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BrickSet {
    words: [u64; WORDS],
    len: u32,
}

impl Default for BrickSet {
    fn default() -> Self {
        Self { words: [0; WORDS], len: 0 }
    }
}

impl BrickSet {
    /// Adds a brick.
    #[inline(always)]
    pub fn insert(&mut self, brick: usize) {
        let word = &mut self.words[brick / 64];
        self.len += u32::from(*word >> (brick % 64) & 1 == 0);
        *word |= 1 << (brick % 64);
    }
    /// Whether a brick is in it.
    pub fn contains(&self, brick: usize) -> bool {
        self.words[brick / 64] & (1 << (brick % 64)) != 0
    }
    /// Takes all bricks out.
    pub fn clear(&mut self) {
        if self.len > 0 {
            *self = Self::default();
        }
    }
    /// True where no brick is in it.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
    /// The bits, 64 bricks a word, the lowest first.
    pub fn words(&self) -> &[u64; WORDS] {
        &self.words
    }
    /// The set with these bits; words beyond the last are ignored.
    pub fn from_words(words: impl IntoIterator<Item = u64>) -> Self {
        let mut set = Self::default();
        set.words.iter_mut().zip(words).for_each(|(word, given)| *word = given);
        set.recount();
        set
    }
    /// Adds all bricks of another set.
    pub fn extend(&mut self, other: &Self) {
        self.words.iter_mut().zip(&other.words).for_each(|(word, more)| *word |= more);
        self.recount();
    }
    fn recount(&mut self) {
        self.len = self.words.iter().map(|word| word.count_ones()).sum();
    }
    /// How many bricks are in it.
    pub fn len(&self) -> usize {
        self.len as usize
    }
    /// The bricks in it, ascending.
    pub fn iter(&self) -> impl Iterator<Item = usize> {
        self.words.iter().enumerate().flat_map(|(w, word)| {
            let mut left = *word;
            std::iter::from_fn(move || {
                let bit = left.trailing_zeros() as usize;
                (left != 0).then(|| {
                    left &= left - 1;
                    w * 64 + bit
                })
            })
        })
    }
}

/// One slot of the arena.
#[derive(Clone, Debug, Default)]
pub struct BlockState {
    /// The block that lives in the slot; nothing before the first beam reaches it.
    pub key: Option<BlockKey>,
    /// Number of its last published change, unique in the life of the map.
    pub version: u32,
    /// Bricks that changed since the last snapshot.
    pub dirty: BrickSet,
    /// Bricks that a snapshot told of since the block entered: all others are unknown.
    pub told: BrickSet,
    /// It holds marks of the open window.
    pub marked: bool,
    /// Units of fading that were taken from it already.
    pub faded: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_brick_set_lists_what_was_put_in_in_order() {
        let mut set = BrickSet::default();
        assert!(set.is_empty());
        for brick in [6249, 0, 63, 64, 64] {
            set.insert(brick);
        }
        assert_eq!(set.iter().collect::<Vec<_>>(), vec![0, 63, 64, 6249]);
        assert_eq!(set.len(), 4);
        assert!(set.contains(6249) && !set.contains(1));
        let mut more = BrickSet::from_words([6]);
        more.extend(&set);
        assert_eq!((more.len(), more.iter().collect::<Vec<_>>()), (6, vec![0, 1, 2, 63, 64, 6249]));
        set.clear();
        assert!(set.is_empty() && set == BrickSet::default());
    }
}
