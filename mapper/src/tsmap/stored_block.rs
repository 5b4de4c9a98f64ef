//! A block outside of any map: what a map hands out, and what a file holds.

use crate::block::BrickSet;
use crate::ratio::Counters;
use tsense_contract::{BRICKS_PER_BLOCK, BlockKey, Brick};
use tsense_geometry::Timestamp;

/// A block's knowledge: only bricks that hold any.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredBlock {
    /// Which block.
    pub key: BlockKey,
    /// Instant of the newest beam in the map when the block was taken from it: its age counts from here.
    pub stamp: Timestamp,
    /// The life of the mapper that it was taken from; 0 for none.
    pub epoch: u64,
    /// Units of fading that every block of that map had to lose by then: within one life the difference is what fell
    /// due while the block lay.
    pub faded: u32,
    /// Which bricks follow.
    pub known: Box<BrickSet>,
    /// The known bricks, ascending.
    pub bricks: Vec<Brick>,
    /// The hit-ratio scheme's counters of the known bricks; empty for the other schemes.
    pub counters: Vec<Counters>,
}

impl StoredBlock {
    /// The bricks of a block that hold anything. `counters` is empty, or as long as `bricks`.
    pub fn of(key: BlockKey, bricks: &[Brick], counters: &[Counters]) -> Self {
        let mut block = Self {
            key,
            stamp: Timestamp::default(),
            epoch: 0,
            faded: 0,
            known: Box::default(),
            bricks: Vec::new(),
            counters: Vec::new(),
        };
        for (i, brick) in bricks.iter().enumerate().take(BRICKS_PER_BLOCK) {
            if *brick != Brick::UNKNOWN {
                block.known.insert(i);
                block.bricks.push(*brick);
                block.counters.extend(counters.get(i).copied());
            }
        }
        block
    }

    /// The known bricks with their places in the block, ascending.
    pub fn known_bricks(&self) -> impl Iterator<Item = (usize, &Brick)> {
        self.known.iter().zip(&self.bricks)
    }

    /// One brick.
    pub fn brick(&self, place: usize) -> &Brick {
        const UNKNOWN: Brick = Brick::UNKNOWN;
        self.known_bricks().find(|(i, _)| *i == place).map_or(&UNKNOWN, |(_, brick)| brick)
    }

    /// All bricks of the block, unknown ones too, as in the `map` topic.
    pub fn to_bricks(&self) -> Vec<Brick> {
        let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
        self.known_bricks().for_each(|(i, brick)| bricks[i] = *brick);
        bricks
    }

    /// All counters of the block; empty where there are none.
    pub fn to_counters(&self) -> Vec<Counters> {
        if self.counters.is_empty() {
            return Vec::new();
        }
        let mut counters = vec![bytemuck::Zeroable::zeroed(); BRICKS_PER_BLOCK];
        self.known.iter().zip(&self.counters).for_each(|(i, known)| counters[i] = *known);
        counters
    }

    /// True where nothing is known.
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }
}
