//! Map files as the commands see them: taken from a running graph, looked at, compared, fused, turned into points, put into
//! a store of blocks, told to a running graph.
//!
//! In: paths and options. Out: files written aside and renamed, and values to print. The format itself is in
//! `tsense_mapper::tsmap`; everything here is a shell around it.
#![allow(clippy::disallowed_methods, reason = "shell: reads map files")]

pub mod block;
pub mod capture;
pub mod diff;
pub mod export;
pub mod fuse;
pub mod info;
pub mod las;
pub mod load;
pub mod ply;
pub mod points;
pub mod publish;

use crate::commands::{Failure, unreadable};
use crate::files::write_bytes;
use std::io::Read;
use std::path::Path;
use tsense_geometry::Timestamp;
use tsense_mapper::VoxelMap;
use tsense_mapper::tsmap::{self, MapFileHeader, Reader, StoredBlock, TsmapFault};

/// A file's bytes, where it starts as a map file does: no other file is read whole.
pub fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let failed = |e: std::io::Error| unreadable(path, &e);
    let mut file = std::fs::File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    Read::by_ref(&mut file).take(tsmap::MAGIC.len() as u64).read_to_end(&mut bytes).map_err(failed)?;
    if bytes == tsmap::MAGIC {
        file.read_to_end(&mut bytes).map_err(failed)?;
    }
    Ok(bytes)
}

/// The blocks in a file's bytes.
pub fn blocks_of<'b>(path: &Path, bytes: &'b [u8]) -> Result<Reader<'b>, Failure> {
    Reader::new(bytes).map_err(|fault| damaged(path, &fault))
}

/// A file that does not check.
pub fn damaged(path: &Path, fault: &TsmapFault) -> Failure {
    Failure::new(6, format!("{}: {fault}", path.display()))
}

/// Writes a map file aside and renames it; how many bytes it has.
pub fn write(path: &Path, header: &MapFileHeader, blocks: &[StoredBlock]) -> Result<usize, Failure> {
    let bytes = tsmap::encode(header, blocks);
    write_bytes(path, &bytes)?;
    Ok(bytes.len())
}

/// What a map of our own holds at an instant, as blocks for a file.
pub fn blocks_in(map: &VoxelMap, stamp: Timestamp) -> Vec<StoredBlock> {
    let blocks = map.blocks().map(|(key, bricks)| StoredBlock { stamp, ..StoredBlock::of(key, bricks, &[]) });
    blocks.filter(|block| !block.is_empty()).collect()
}

/// The coordinate system in words.
pub fn system_of(header: &MapFileHeader) -> String {
    match (header.zone, header.epsg) {
        (0, 0) => "unknown coordinate system".into(),
        (0, epsg) => format!("EPSG:{epsg}"),
        (zone, epsg) => format!("UTM zone {zone}{}, EPSG:{epsg}", if header.south { 'S' } else { 'N' }),
    }
}
