//! The records of a map file with fixed layouts: the header, and the head of each block.
//!
//! The one place of this crate that uses bincode, and only its `legacy` configuration: integers and floats of fixed
//! size, little-endian, in the order of the fields, without padding. Lengths of records do not depend on values.

use super::stored_block::StoredBlock;
use crate::block::WORDS;
use bincode::config::{Configuration, Fixint, Limit, LittleEndian};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK, BlockKey, is_block_on_earth};
use tsense_geometry::{Timestamp, VoxelGrid};

/// Version of the format. Another layout gets another number; older ones stay readable.
pub const VERSION: u16 = 1;
/// Bytes of the header record.
pub const HEADER_BYTES: usize = 24;
/// Bytes of a block's head.
pub const HEAD_BYTES: usize = 44;
/// Occupancies and confidences.
pub const PLANES: usize = 2;
/// And the hit-ratio scheme's hits and misses.
pub const PLANES_WITH_COUNTERS: usize = 4;

/// Bytes that say which bricks are known.
pub const SET_BYTES: usize = WORDS * 8;

/// Deflate makes noise longer. The best encoders store it, others write 9 bits a byte at worst (RFC 1951, 3.2.6), and
/// which encoder is built in depends on what else is: the worst is believed.
pub const PACKED_BYTES_MAX: usize = {
    let raw = SET_BYTES + BRICKS_PER_BLOCK * BRICK_VOXELS * PLANES_WITH_COUNTERS;
    raw + raw / 8 + 64
};

/// No record is longer than this; bincode takes no more from its input.
const RECORD_BYTES_MAX: usize = 64;

fn layout() -> Configuration<LittleEndian, Fixint, Limit<RECORD_BYTES_MAX>> {
    bincode::config::legacy().with_limit()
}

/// Plain records of numbers always encode; an empty one would not be read back.
fn write(record: &impl Serialize) -> Vec<u8> {
    bincode::serde::encode_to_vec(record, layout()).unwrap_or_default()
}

fn read<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let (record, used) = bincode::serde::decode_from_slice(bytes, layout()).map_err(|e| e.to_string())?;
    if used == bytes.len() { Ok(record) } else { Err(format!("{used} of {} bytes used", bytes.len())) }
}

/// What a map file says of all its blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapFileHeader {
    /// Edge of a voxel, metres.
    pub voxel_size_m: f64,
    /// Instant of the newest beam in it.
    pub stamp: Timestamp,
    /// UTM zone, 1 to 60; 0 where the coordinates are in no UTM zone, or nobody knows.
    pub zone: u8,
    /// South of the equator.
    pub south: bool,
    /// EPSG code of the coordinates; 0 where nobody knows.
    pub epsg: u16,
}

#[derive(Serialize, Deserialize)]
struct HeaderRecord {
    voxel_size_m: f64,
    stamp_ns: i64,
    blocks: u32,
    epsg: u16,
    zone: u8,
    south: u8,
}

impl MapFileHeader {
    /// The header of a map in a UTM zone of WGS 84; zone 0 is no zone.
    pub fn in_zone(voxel_size_m: f64, stamp: Timestamp, zone: u8, south: bool) -> Self {
        Self { voxel_size_m, stamp, zone, south, epsg: epsg_of(zone, south) }
    }

    /// The header of a map in any projected system; zone and hemisphere follow from the code where it is one of UTM.
    pub fn in_epsg(voxel_size_m: f64, stamp: Timestamp, epsg: u16) -> Self {
        let zones = (1..=60).flat_map(|zone| [(zone, false), (zone, true)]);
        let (zone, south) = zones.into_iter().find(|(z, s)| epsg_of(*z, *s) == epsg).unwrap_or((0, false));
        Self { voxel_size_m, stamp, zone, south, epsg }
    }

    pub(super) fn to_bytes(self, blocks: u32) -> Vec<u8> {
        write(&HeaderRecord {
            voxel_size_m: self.voxel_size_m,
            stamp_ns: self.stamp.ns,
            blocks,
            epsg: self.epsg,
            zone: self.zone,
            south: self.south.into(),
        })
    }

    /// The header and the number of blocks, or what is wrong with them.
    pub(super) fn from_bytes(bytes: &[u8]) -> Result<(Self, usize), String> {
        let record: HeaderRecord = read(bytes)?;
        if VoxelGrid::new(record.voxel_size_m).is_none() {
            return Err(format!("voxels of {} m; 0.01 to 10 m are possible", record.voxel_size_m));
        }
        let header = Self {
            voxel_size_m: record.voxel_size_m,
            stamp: Timestamp::from_ns(record.stamp_ns),
            zone: record.zone,
            south: record.south == 1,
            epsg: record.epsg,
        };
        let zone_is_good = record.zone <= 60 && record.south <= 1;
        if !zone_is_good || (header.zone != 0 && header.epsg != epsg_of(header.zone, header.south)) {
            let HeaderRecord { zone, south, epsg, .. } = record;
            return Err(format!("zone {zone}, south {south}, EPSG:{epsg} do not go together"));
        }
        if record.blocks as usize > super::FILE_BLOCKS_MAX {
            return Err(format!("{} blocks; at most {} are possible", record.blocks, super::FILE_BLOCKS_MAX));
        }
        Ok((header, record.blocks as usize))
    }
}

/// The code of a UTM zone on WGS 84; 0 for none.
fn epsg_of(zone: u8, south: bool) -> u16 {
    match zone {
        0 => 0,
        zone => u16::from(zone) + if south { 32_700 } else { 32_600 },
    }
}

/// What stands before a block's packed bricks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BlockHead {
    pub key: BlockKey,
    pub stamp_ns: i64,
    pub epoch: u64,
    pub faded: u32,
    pub bricks: u32,
    pub planes: u32,
    pub packed_bytes: u32,
}

impl BlockHead {
    pub fn of(block: &StoredBlock, packed_bytes: usize) -> Self {
        Self {
            key: block.key,
            stamp_ns: block.stamp.ns,
            epoch: block.epoch,
            faded: block.faded,
            bricks: block.bricks.len() as u32,
            planes: if block.counters.is_empty() { PLANES } else { PLANES_WITH_COUNTERS } as u32,
            packed_bytes: packed_bytes as u32,
        }
    }

    pub fn to_bytes(self) -> Vec<u8> {
        write(&self)
    }

    /// The head, every length held against its bound; or what is wrong with it.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let head: Self = read(bytes)?;
        // Indices of voxels stay within 32 bits, with a block to spare.
        match head {
            _ if !is_block_on_earth(head.key) => Err(format!("key {:?} lies beyond the grid", head.key)),
            _ if head.bricks as usize > BRICKS_PER_BLOCK => {
                Err(format!("{} bricks; a block has {BRICKS_PER_BLOCK}", head.bricks))
            }
            _ if ![PLANES, PLANES_WITH_COUNTERS].contains(&(head.planes as usize)) => {
                Err(format!("{} planes; {PLANES} or {PLANES_WITH_COUNTERS} are possible", head.planes))
            }
            _ if head.packed_bytes as usize > PACKED_BYTES_MAX => {
                Err(format!("{} packed bytes; at most {PACKED_BYTES_MAX} are possible", head.packed_bytes))
            }
            head => Ok(head),
        }
    }
}
