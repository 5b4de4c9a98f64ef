//! Map files: blocks of a voxel map as bytes, one block or many, with a version and checksums.
//!
//! In: a header and blocks, or bytes. Out: bytes, or the same header and blocks bit for bit, or a [`TsmapFault`] that
//! says what was seen and where. Pure: who reads and writes files is somebody else. The layout stands byte by byte in
//! `docs/map-files.md`. Bricks without a bit of knowledge cost one bit; the rest is deflated.
//!
//! A damaged byte anywhere is an error, never a panic, and no length is believed before it is held against its bound
//! and against the bytes that are there.

mod fault;
mod packing;
mod reader;
mod records;
mod stored_block;
#[cfg(test)]
mod tests;

pub use fault::TsmapFault;
pub use reader::{BlockCheck, Reader};
pub use records::MapFileHeader;
pub use stored_block::StoredBlock;

use records::{BlockHead, VERSION};

/// First bytes of every map file. The high bit and the line end show a file that went through a text transfer.
pub const MAGIC: [u8; 8] = *b"\x89TSMAP\r\n";

/// Ending of a map file's name, and of a block file's.
pub const EXTENSION: &str = "tsmap";

/// Most blocks of one file: the most that one map can hold.
pub const FILE_BLOCKS_MAX: usize = 4096;

/// Bytes before the first block: magic, version, flags, header, checksum.
const PREAMBLE_BYTES: usize = MAGIC.len() + 4 + records::HEADER_BYTES + CHECKSUM_BYTES;

const CHECKSUM_BYTES: usize = 4;

/// Writes a map: the header's number of blocks is that of `blocks`, which are put in the order of their keys.
pub fn encode(header: &MapFileHeader, blocks: &[StoredBlock]) -> Vec<u8> {
    let mut writer = Writer::new(header, blocks.len());
    let mut order: Vec<&StoredBlock> = blocks.iter().collect();
    order.sort_by_key(|block| order_of(block.key));
    order.into_iter().for_each(|block| writer.add(block));
    writer.bytes
}

/// Reads a map whole.
pub fn decode(bytes: &[u8]) -> Result<(MapFileHeader, Vec<StoredBlock>), TsmapFault> {
    let reader = Reader::new(bytes)?;
    let header = reader.header();
    let blocks = reader.collect::<Result<Vec<_>, _>>()?;
    Ok((header, blocks))
}

/// Blocks lie in a file by z, then y, then x.
fn order_of(key: tsense_contract::BlockKey) -> [i32; 3] {
    [key[2], key[1], key[0]]
}

struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    fn new(header: &MapFileHeader, blocks: usize) -> Self {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend([0; 2]);
        bytes.extend(header.to_bytes(blocks as u32));
        let checksum = crc32fast::hash(&bytes);
        bytes.extend(checksum.to_le_bytes());
        Self { bytes }
    }

    fn add(&mut self, block: &StoredBlock) {
        let start = self.bytes.len();
        let packed = packing::pack(block);
        self.bytes.extend(BlockHead::of(block, packed.len()).to_bytes());
        self.bytes.extend(packed);
        let checksum = crc32fast::hash(&self.bytes[start..]);
        self.bytes.extend(checksum.to_le_bytes());
    }
}
