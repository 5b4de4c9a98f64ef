//! Deltas of topic `map`: the changed bricks of several blocks in one sample.
//!
//! In and out: the items of a sample, in three parts, each filled up with zeros to whole items: the table
//! ([`DeltaEntry`] records, as many as the header's `version` says); the numbers of the bricks within their blocks (`u16`,
//! entry after entry); the bricks themselves in the same order. What a writer's block is at `version` is what it was at
//! `base` with these bricks replaced. [`Delta::read`] believes nothing: it checks every count and every number before
//! anybody applies a brick. It keeps no block; see `snapshot`.

use crate::map::{BRICKS_PER_BLOCK, BlockKey, Brick};
use crate::message::message;
use crate::{MapHeader, MapSampleKind};

message! {
    /// One line of a delta: a block and how many of its bricks follow.
    DeltaEntry = "tsense.delta.v1" {
        /// Which block.
        key: [i32; 3],
        /// The version the bricks are to be put into; 0: a block of which nothing is known.
        base: u32,
        /// The version it is then.
        version: u32,
        /// Bricks of this block, at least one.
        bricks: u32,
    }
}

/// The version before the first: a block of which nothing is known.
pub const UNKNOWN_VERSION: u32 = 0;

const fn items_for(bytes: usize) -> usize {
    bytes.div_ceil(size_of::<Brick>())
}

/// Items of a delta of so many entries with so many bricks in all.
pub const fn delta_items(entries: usize, bricks: usize) -> usize {
    items_for(entries * size_of::<DeltaEntry>()) + items_for(bricks * size_of::<u16>()) + bricks
}

/// Writes a delta into its items, of which there are [`delta_items`]. `numbers` are the bricks of all entries, in their
/// order; `block` gives the bricks of a block.
pub fn write_delta<'a>(
    items: &mut [Brick],
    entries: &[DeltaEntry],
    numbers: &[u16],
    mut block: impl FnMut(BlockKey) -> &'a [Brick],
) {
    let (table, rest) = items.split_at_mut(items_for(size_of_val(entries)));
    let (list, bricks) = rest.split_at_mut(items_for(size_of_val(numbers)));
    fill(table, bytemuck::cast_slice(entries));
    fill(list, bytemuck::cast_slice(numbers));
    let mut next = 0;
    for entry in entries {
        let (source, count) = (block(entry.key), entry.bricks as usize);
        let places = bricks[next..next + count].iter_mut();
        places.zip(&numbers[next..next + count]).for_each(|(place, number)| *place = source[usize::from(*number)]);
        next += count;
    }
}

/// The bytes, then zeros.
fn fill(items: &mut [Brick], bytes: &[u8]) {
    let room = bytemuck::cast_slice_mut::<Brick, u8>(items);
    room[..bytes.len()].copy_from_slice(bytes);
    room[bytes.len()..].fill(0);
}

/// A delta that was read and found whole.
#[derive(Clone, Copy, Debug)]
pub struct Delta<'a> {
    table: &'a [u8],
    numbers: &'a [u8],
    bricks: &'a [Brick],
}

impl<'a> Delta<'a> {
    /// Reads a sample; nothing where a count does not fit its items or a number is that of no brick.
    pub fn read(header: &MapHeader, items: &'a [Brick]) -> Option<Self> {
        let entries = header.version as usize;
        let table_items = items_for(entries.checked_mul(size_of::<DeltaEntry>())?);
        let (table, rest) = items.split_at_checked(table_items)?;
        let table = &bytemuck::cast_slice(table)[..entries * size_of::<DeltaEntry>()];
        let counts = read_table(table).map(|entry| entry.bricks as usize);
        let count = counts.map(|n| (1..=BRICKS_PER_BLOCK).contains(&n).then_some(n)).sum::<Option<usize>>()?;
        let (list, bricks) = rest.split_at_checked(items_for(count * size_of::<u16>()))?;
        let numbers = &bytemuck::cast_slice(list)[..count * size_of::<u16>()];
        let known = read_numbers(numbers).all(|number| number < BRICKS_PER_BLOCK);
        (header.kind() == MapSampleKind::Delta && bricks.len() == count && known).then_some(Self {
            table,
            numbers,
            bricks,
        })
    }

    /// Each block with the numbers of its changed bricks and the bricks.
    pub fn blocks(&self) -> impl Iterator<Item = (DeltaEntry, Changes<'a>)> + use<'a> {
        let Self { table, mut numbers, mut bricks } = *self;
        read_table(table).map(move |entry| {
            let count = entry.bricks as usize;
            let (own_numbers, own_bricks);
            (own_numbers, numbers) = numbers.split_at(count * size_of::<u16>());
            (own_bricks, bricks) = bricks.split_at(count);
            (entry, Changes { numbers: own_numbers, bricks: own_bricks })
        })
    }
}

/// The changed bricks of one block.
#[derive(Clone, Copy, Debug)]
pub struct Changes<'a> {
    numbers: &'a [u8],
    bricks: &'a [Brick],
}

impl Changes<'_> {
    /// Puts the bricks into a block of [`BRICKS_PER_BLOCK`].
    pub fn apply(&self, block: &mut [Brick]) {
        for (number, brick) in read_numbers(self.numbers).zip(self.bricks) {
            block[number] = *brick;
        }
    }
}

fn read_table(bytes: &[u8]) -> impl Iterator<Item = DeltaEntry> + use<'_> {
    bytes.chunks_exact(size_of::<DeltaEntry>()).map(bytemuck::pod_read_unaligned)
}

fn read_numbers(bytes: &[u8]) -> impl Iterator<Item = usize> + use<'_> {
    bytes.chunks_exact(size_of::<u16>()).map(|two| usize::from(u16::from_ne_bytes([two[0], two[1]])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn header(entries: u32) -> MapHeader {
        MapHeader { version: entries, kind: MapSampleKind::Delta.to_wire(), ..MapHeader::zeroed() }
    }

    fn brick(value: u8) -> Brick {
        Brick { occupancy: [value as i8; 64], confidence: [value; 64] }
    }

    fn entry(x: i32, bricks: u32) -> DeltaEntry {
        DeltaEntry { key: [x, 0, 0], base: 3, version: 4, bricks }
    }

    /// Three bricks of block 1, one of block 2, 70 of block 3: brick `n` of block `x` holds `x + n`.
    fn sample() -> Vec<Brick> {
        let entries = [entry(1, 3), entry(2, 1), entry(3, 70)];
        let numbers: Vec<u16> = [0, 17, 6249, 2].into_iter().chain(100..170).collect();
        let blocks: Vec<Vec<Brick>> =
            (0..4u8).map(|x| (0..BRICKS_PER_BLOCK).map(|n| brick(x.wrapping_add(n as u8))).collect()).collect();
        let mut items = vec![brick(0xaa); delta_items(3, 74)];
        write_delta(&mut items, &entries, &numbers, |key| &blocks[key[0] as usize]);
        items
    }

    #[test]
    fn a_delta_takes_one_item_for_five_blocks_and_one_for_64_numbers() {
        assert_eq!(delta_items(1, 0), 1);
        assert_eq!(delta_items(5, 64), 1 + 1 + 64);
        assert_eq!(delta_items(6, 65), 2 + 2 + 65);
        assert_eq!(sample().len(), 1 + 2 + 74);
    }

    #[test]
    fn what_was_written_is_put_where_it_belongs() {
        let items = sample();
        let delta = Delta::read(&header(3), &items).unwrap();
        let mut blocks = vec![vec![Brick::UNKNOWN; BRICKS_PER_BLOCK]; 4];
        let entries: Vec<_> = delta.blocks().map(|(entry, _)| (entry.key[0], entry.bricks)).collect();
        assert_eq!(entries, [(1, 3), (2, 1), (3, 70)]);
        delta.blocks().for_each(|(entry, changes)| changes.apply(&mut blocks[entry.key[0] as usize]));
        assert_eq!([blocks[1][0], blocks[1][17], blocks[1][6249]], [brick(1), brick(18), brick(106)]);
        assert_eq!([blocks[3][100], blocks[3][169]], [brick(103), brick(172)]);
        let known = blocks.iter().map(|b| b.iter().filter(|b| **b != Brick::UNKNOWN).count()).collect::<Vec<_>>();
        assert_eq!(known, [0, 3, 1, 70]);
    }

    #[test]
    fn a_delta_of_nonsense_is_refused_as_a_whole() {
        let good = sample();
        assert!(Delta::read(&header(3), &good).is_some());
        assert!(Delta::read(&MapHeader { kind: 0, ..header(3) }, &good).is_none(), "a block");
        for entries in [0, 2, 4, 5, 6, 1000, u32::MAX] {
            assert!(Delta::read(&header(entries), &good).is_none(), "{entries} entries");
        }
        assert!(Delta::read(&header(3), &good[..good.len() - 1]).is_none(), "too short");
        assert!(Delta::read(&header(3), &[]).is_none());
        // The count of the first entry, then the first number.
        for (item, byte, value) in [(0, 20, 4), (0, 23, 0xff), (1, 1, 0x7f)] {
            let mut bad = good.clone();
            bytemuck::bytes_of_mut(&mut bad[item])[byte] = value;
            assert!(Delta::read(&header(3), &bad).is_none(), "item {item}, byte {byte}");
        }
        assert!(Delta::read(&header(0), &[]).is_some_and(|delta| delta.blocks().count() == 0));
    }
}
