//! What is written is read back bit for bit; what is damaged, foreign or hostile is an error that says where.

use super::records::{BlockHead, HEAD_BYTES};
use super::*;
use crate::ratio::Counters;
use crate::testing::Random;
use proptest::prelude::*;
use std::cell::Cell;
use tsense_contract::{BRICKS_PER_BLOCK, BlockKey, Brick};
use tsense_geometry::Timestamp;

fn header() -> MapFileHeader {
    MapFileHeader::in_zone(0.15, Timestamp::from_ns(1_700_000_000_123_456_789), 32, false)
}

/// A block with a share of its bricks known; `plain` values are like those of a real map, others are noise.
fn block(seed: u64, key: BlockKey, share: f64, plain: bool, counted: bool) -> StoredBlock {
    let mut random = Random(seed);
    let (mut bricks, mut counters) = (vec![Brick::UNKNOWN; BRICKS_PER_BLOCK], Vec::new());
    for brick in &mut bricks {
        if random.unit() < share {
            let free = Brick { occupancy: [-8; 64], confidence: [(random.bits() % 4) as u8 * 8 + 8; 64] };
            let noise = |_| random.bits() as u8;
            *brick = if plain { free } else { bytemuck::cast::<[u8; 128], Brick>(std::array::from_fn(noise)) };
        }
        if counted {
            counters.push(Counters { hits: [random.bits() as u8; 64], misses: [random.bits() as u8; 64] });
        }
    }
    let stamp = Timestamp::from_ns(random.bits() as i64);
    StoredBlock { stamp, epoch: random.bits(), faded: 77, ..StoredBlock::of(key, &bricks, &counters) }
}

fn small_file() -> Vec<u8> {
    encode(&header(), &[block(1, [3, -4, 0], 0.002, false, false), block(2, [-3, 4, 1], 0.001, true, true)])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn decoding_is_the_inverse_of_encoding(
        seed in any::<u64>(), share in 0.0..1.0f64, plain in any::<bool>(), counted in any::<bool>(),
        key in prop::array::uniform3(-1_000_000i32..1_000_000), zone in 0u8..=60, south in any::<bool>(),
    ) {
        let written = block(seed, key, share, plain, counted);
        let header = MapFileHeader::in_zone(0.15, Timestamp::from_ns(seed as i64), zone, zone > 0 && south);
        let bytes = encode(&header, std::slice::from_ref(&written));
        prop_assert!(decode(&bytes) == Ok((header, vec![written])));
    }

    #[test]
    fn any_changed_byte_is_an_error(at in any::<prop::sample::Index>(), flip in 1u8..=255) {
        let mut bytes = small_file();
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        prop_assert!(decode(&bytes).is_err(), "byte {}", at);
    }

    #[test]
    fn noise_is_an_error_and_never_a_panic(noise in prop::collection::vec(any::<u8>(), 0..400), keep in 0usize..200) {
        let mut bytes = small_file();
        bytes.truncate(keep);
        bytes.extend(noise);
        prop_assert!(decode(&bytes).is_err());
    }
}

#[test]
fn every_truncation_and_every_flipped_bit_of_a_small_file_is_an_error() {
    let bytes = small_file();
    let cases = Cell::new(0);
    let bad = |bytes: &[u8], what: &str| {
        cases.set(cases.get() + 1);
        assert!(decode(bytes).is_err(), "{what}");
    };
    for length in 0..bytes.len() {
        bad(&bytes[..length], &format!("{length} bytes"));
    }
    for bit in 0..bytes.len() * 8 {
        let mut bytes = bytes.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        bad(&bytes, &format!("bit {bit}"));
    }
    assert_eq!(cases.get(), bytes.len() * 9);
    assert!(bytes.len() > 1000, "{}", bytes.len());
}

#[test]
fn unknown_bricks_cost_a_bit_and_free_space_little_more() {
    let empty = encode(&header(), &[block(1, [0; 3], 0.0, true, false)]);
    assert!(empty.len() < 120, "{}", empty.len());
    let free = encode(&header(), &[block(1, [0; 3], 1.0, true, false)]);
    assert!(free.len() < 20_000, "{} of 800,000 bytes", free.len());
}

/// Blocks of pure noise with counters are the longest there are.
#[test]
fn the_longest_block_stays_within_the_bound_that_readers_believe() {
    let mut longest = block(5, [0; 3], 1.0, false, true);
    let mut random = Random(6);
    for counters in &mut longest.counters {
        *counters = bytemuck::cast::<[u8; 128], Counters>(std::array::from_fn(|_| random.bits() as u8));
    }
    let (_, read) = decode(&encode(&header(), std::slice::from_ref(&longest))).unwrap();
    assert!(read == [longest], "the same block comes back");
}

/// Puts a head in place of the first block's, under a good checksum.
fn with_head(change: impl FnOnce(&mut BlockHead)) -> Result<(MapFileHeader, Vec<StoredBlock>), TsmapFault> {
    let block = block(1, [0; 3], 0.001, true, false);
    let mut bytes = encode(&header(), std::slice::from_ref(&block));
    let end = bytes.len() - CHECKSUM_BYTES;
    let mut head = BlockHead::of(&block, end - PREAMBLE_BYTES - HEAD_BYTES);
    change(&mut head);
    bytes[PREAMBLE_BYTES..PREAMBLE_BYTES + HEAD_BYTES].copy_from_slice(&head.to_bytes());
    let checksum = crc32fast::hash(&bytes[PREAMBLE_BYTES..end]);
    bytes[end..].copy_from_slice(&checksum.to_le_bytes());
    decode(&bytes)
}

#[test]
fn hostile_lengths_are_refused_before_anything_is_made_for_them() {
    assert!(with_head(|_| {}).is_ok());
    let refused = [
        with_head(|head| head.packed_bytes = u32::MAX),
        with_head(|head| head.packed_bytes += 1),
        with_head(|head| head.packed_bytes -= 1),
        with_head(|head| head.bricks = u32::MAX),
        with_head(|head| head.bricks = BRICKS_PER_BLOCK as u32),
        with_head(|head| head.bricks -= 1),
        with_head(|head| head.planes = 3),
        with_head(|head| head.planes = u32::MAX),
        with_head(|head| head.key[1] = i32::MIN),
        with_head(|head| head.key[2] = i32::MAX / 40),
    ];
    for (i, refused) in refused.into_iter().enumerate() {
        assert!(refused.is_err(), "case {i}");
    }
    let mut many = encode(&header(), &[]);
    let blocks_at = 12 + 16;
    many[blocks_at..blocks_at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    let checksum = crc32fast::hash(&many[..36]);
    many[36..40].copy_from_slice(&checksum.to_le_bytes());
    let said = decode(&many).unwrap_err().to_string();
    assert!(said.starts_with("byte 12: the header: 4294967295 blocks; at most 4096 are possible"), "{said}");
}

#[test]
fn faults_say_what_was_seen_where_and_what_to_do() {
    let said = |bytes: &[u8]| decode(bytes).unwrap_err().to_string();
    let good = small_file();
    assert!(said(b"ply\nformat").starts_with("byte 0: [70, 6c, 79, 0a, 66, 6f, 72, 6d] instead of [89, 54,"));
    assert!(said(b"").starts_with("byte 0: [] instead of"));
    let mut newer = good.clone();
    newer[8] = 2;
    assert_eq!(
        said(&newer),
        "byte 8: format version 2, flags 0; this program knows version 1, flags 0: use a newer one"
    );
    let cut = said(&good[..good.len() - 5]);
    assert!(cut.contains("the file ends, 5 bytes are missing for block 1 (key -3, 4, 1)"), "{cut}");
    let mut damaged = good.clone();
    damaged[200] ^= 1;
    assert!(said(&damaged).starts_with("byte 40: checksum "), "{}", said(&damaged));
    assert!(said(&damaged).contains("stands behind block 0 (key 3, -4, 0)"));
    let mut joined = good.clone();
    joined.extend(&good);
    assert!(said(&joined).contains(&format!("{} bytes follow the last block", good.len())));
}

#[test]
fn a_damaged_block_does_not_hide_the_others_from_a_check() {
    let blocks: Vec<_> = (0..3).map(|i| block(i, [i as i32, 0, 0], 0.01, true, false)).collect();
    let mut bytes = encode(&header(), &blocks);
    let second = PREAMBLE_BYTES + (bytes.len() - PREAMBLE_BYTES) / 2;
    bytes[second] ^= 4;
    let mut states = Vec::new();
    Reader::new(&bytes).unwrap().check(|check, block| states.push((check.key, check.fault.is_some(), block.is_some())));
    let expected = [(Some([0; 3]), false, true), (Some([1, 0, 0]), true, false), (Some([2, 0, 0]), false, true)];
    assert_eq!(states, expected);
}

/// Figures by hand from the layout in `docs/map-files.md`.
#[test]
fn the_layout_is_what_the_document_says() {
    let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
    (bricks[65].occupancy[3], bricks[65].confidence[3]) = (8, 16);
    let stored =
        StoredBlock { stamp: Timestamp::from_ns(258), epoch: 9, faded: 7, ..StoredBlock::of([-1, 2, 3], &bricks, &[]) };
    let bytes = encode(&header(), &[stored]);
    assert_eq!(bytes[..12], *b"\x89TSMAP\r\n\x01\0\0\0");
    assert_eq!(bytes[12..20], 0.15f64.to_le_bytes());
    assert_eq!(bytes[20..28], 1_700_000_000_123_456_789i64.to_le_bytes());
    assert_eq!(bytes[28..36], [1, 0, 0, 0, 0x78, 0x7f, 32, 0], "one block, EPSG:32632, zone 32 north");
    assert_eq!(bytes[36..40], crc32fast::hash(&bytes[..36]).to_le_bytes());
    assert_eq!(bytes[40..52], [255, 255, 255, 255, 2, 0, 0, 0, 3, 0, 0, 0]);
    assert_eq!(bytes[52..68], [2, 1, 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bytes[68..80], [7, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    let packed = u32::from_le_bytes(*bytes[80..].first_chunk().unwrap()) as usize;
    assert_eq!(bytes.len(), 84 + packed + 4);
    let mut raw = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::DeflateDecoder::new(&bytes[84..84 + packed]), &mut raw).unwrap();
    assert_eq!((raw.len(), raw[8], raw[784 + 3], raw[784 + 64 + 3]), (784 + 128, 2, 8, 16));
}
