//! A block's bricks as few bytes: which bricks are known, then their values plane by plane, deflated.
//!
//! In: a [`StoredBlock`], or packed bytes and how many bricks and planes they must hold. Planes lie apart because
//! occupancies are nearly all alike, and confidences follow the beams.

use super::records::{BlockHead, PLANES, PLANES_WITH_COUNTERS, SET_BYTES};
use super::stored_block::StoredBlock;
use crate::block::BrickSet;
use crate::ratio::Counters;
use flate2::Compression;
use flate2::read::{DeflateDecoder, DeflateEncoder};
use std::io::Read;
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK, Brick};
use tsense_geometry::Timestamp;

/// The packed bricks of a block.
pub fn pack(block: &StoredBlock) -> Vec<u8> {
    let mut raw = Vec::with_capacity(SET_BYTES + block.bricks.len() * BRICK_VOXELS * PLANES_WITH_COUNTERS);
    block.known.words().iter().for_each(|word| raw.extend(word.to_le_bytes()));
    block.bricks.iter().for_each(|brick| raw.extend(bytemuck::cast_slice::<i8, u8>(&brick.occupancy)));
    block.bricks.iter().for_each(|brick| raw.extend(brick.confidence));
    block.counters.iter().for_each(|counters| raw.extend(counters.hits));
    block.counters.iter().for_each(|counters| raw.extend(counters.misses));
    let mut packed = Vec::new();
    // Reading from a slice into a vector cannot fail; nothing packed would be refused by every reader.
    let _ = DeflateEncoder::new(raw.as_slice(), Compression::fast()).read_to_end(&mut packed);
    packed
}

/// The block whose head was read; or what is wrong with the bytes. Grows with what the bytes really hold, up to what
/// the head promises and no further.
pub fn unpack(head: &BlockHead, packed: &[u8]) -> Result<StoredBlock, String> {
    let (bricks, planes) = (head.bricks as usize, head.planes as usize);
    let promised = SET_BYTES + bricks * BRICK_VOXELS * planes;
    let (mut raw, mut decoder) = (Vec::new(), DeflateDecoder::new(packed));
    let read = decoder.by_ref().take(promised as u64 + 1).read_to_end(&mut raw);
    let read = read.map_err(|e| format!("the packed bricks do not unpack ({e})"))?;
    if read != promised || decoder.total_in() != packed.len() as u64 {
        return Err(format!("the packed bricks hold other than the promised {promised} bytes"));
    }
    let (set, values) = raw.split_at(SET_BYTES);
    let known = known_bricks(set, bricks)?;
    let plane = |n: usize| values[n * bricks * BRICK_VOXELS..(n + 1) * bricks * BRICK_VOXELS].as_chunks().0;
    let joined = |a: usize, b: usize| plane(a).iter().zip(plane(b));
    let brick = |(o, c): (&[u8; 64], &[u8; 64])| Brick { occupancy: bytemuck::cast(*o), confidence: *c };
    let counters = |(h, m): (&[u8; 64], &[u8; 64])| Counters { hits: *h, misses: *m };
    Ok(StoredBlock {
        key: head.key,
        stamp: Timestamp::from_ns(head.stamp_ns),
        epoch: head.epoch,
        faded: head.faded,
        known: Box::new(known),
        bricks: joined(0, 1).map(brick).collect(),
        counters: if planes == PLANES { Vec::new() } else { joined(2, 3).map(counters).collect() },
    })
}

fn known_bricks(set: &[u8], bricks: usize) -> Result<BrickSet, String> {
    let words = set.as_chunks().0.iter().map(|bytes| u64::from_le_bytes(*bytes));
    let known = BrickSet::from_words(words);
    let beyond = known.iter().any(|brick| brick >= BRICKS_PER_BLOCK);
    if beyond || known.len() != bricks {
        return Err(format!("the set of known bricks holds {} of the promised {bricks}", known.len()));
    }
    Ok(known)
}
