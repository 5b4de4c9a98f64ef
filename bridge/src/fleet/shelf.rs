//! Shell: the files of a vehicle's blocks, kept for stations: `FOLDER/ZONE-SIZE/x_y_z.tsmap`, the newest of each block.
//!
//! In: bytes of a map file. Out: the same, also after a restart. Under its name a file is whole: written aside, flushed,
//! renamed. What is in a file is not looked at here; whoever receives it checks it.
#![allow(clippy::disallowed_methods, reason = "shell: this module owns the files of a vehicle's blocks")]

use std::fs::{self, File};
use std::io::{Result, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};
use tsense_contract::{BLOCK_EXTENSION, BlockKey, BlockPlace, FleetBlock, block_path};

/// The folder.
#[derive(Clone, Debug)]
pub struct Shelf {
    root: PathBuf,
}

impl Shelf {
    /// Opens the folder, and says which blocks are there, those written longest ago first.
    pub fn open(root: &Path) -> Result<(Self, Vec<FleetBlock>)> {
        fs::create_dir_all(root)?;
        let mut found = Vec::new();
        for map in fs::read_dir(root)?.flatten() {
            let Some(place) = map.file_name().to_str().and_then(map_of) else { continue };
            for file in fs::read_dir(map.path())?.flatten() {
                match file.file_name().to_str().and_then(key_of) {
                    Some(key) => found.extend(described(&file.path(), place, key)),
                    // What was half written when a process died.
                    None => drop(fs::remove_file(file.path())),
                }
            }
        }
        found.sort_by_key(|block| (block.stamp_ns, block.place()));
        Ok((Self { root: root.into() }, found))
    }

    /// Writes a block; as it is to be told.
    pub fn write(&self, block: FleetBlock, bytes: &[u8]) -> Result<FleetBlock> {
        let path = self.path(block.place());
        let aside = path.with_extension("part");
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        let mut file = File::create(&aside)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&aside, &path)?;
        Ok(FleetBlock { bytes: bytes.len() as u32, crc: crc32fast::hash(bytes), ..block })
    }

    /// A block's file.
    pub fn read(&self, place: BlockPlace) -> Result<Vec<u8>> {
        fs::read(self.path(place))
    }

    /// Removes a block's file.
    pub fn remove(&self, place: BlockPlace) {
        // One that cannot be removed is found again at the next start.
        let _ = fs::remove_file(self.path(place));
    }

    fn path(&self, place: BlockPlace) -> PathBuf {
        self.root.join(block_path(place))
    }
}

/// Zone, hemisphere and size of voxels of a folder's name, such as `17N-0.15m`.
fn map_of(name: &str) -> Option<(u8, u8, f64)> {
    let (zone, size) = name.strip_suffix('m')?.split_once('-')?;
    let (number, side) = zone.split_at_checked(zone.len().checked_sub(1)?)?;
    let south = ["N", "S"].iter().position(|s| *s == side)? as u8;
    Some((number.parse().ok()?, south, size.parse().ok()?))
}

/// The key of a file's name, such as `24600_218600_-7.tsmap`.
fn key_of(name: &str) -> Option<BlockKey> {
    let numbers = name.strip_suffix(BLOCK_EXTENSION)?.strip_suffix('.')?;
    let numbers: Vec<i32> = numbers.split('_').map(|n| n.parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}

fn described(path: &Path, (zone, south, voxel_size_m): (u8, u8, f64), key: BlockKey) -> Option<FleetBlock> {
    let bytes = fs::read(path).ok()?;
    let written = fs::metadata(path).ok()?.modified().unwrap_or(SystemTime::UNIX_EPOCH);
    let stamp_ns = written.duration_since(UNIX_EPOCH).map_or(0, |span| span.as_nanos() as i64);
    let (length, crc) = (bytes.len() as u32, crc32fast::hash(&bytes));
    Some(FleetBlock { number: 0, stamp_ns, voxel_size_m, key, bytes: length, crc, zone, south, reserved: [0; 2] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn blocks_are_found_again_after_a_restart_and_halves_are_not() {
        let root = std::env::temp_dir().join(format!("tsense-shelf-{}", std::process::id()));
        let (shelf, found) = Shelf::open(&root).unwrap();
        assert!(found.is_empty());
        let block = FleetBlock { zone: 17, south: 1, voxel_size_m: 0.15, key: [24_600, -3, -7], ..Zeroable::zeroed() };
        let told = shelf.write(block, b"bytes").unwrap();
        fs::write(root.join("17S-0.15m/1_2_3.part"), b"half").unwrap();
        let (shelf, found) = Shelf::open(&root).unwrap();
        assert_eq!(
            found.iter().map(|b| (b.place(), b.bytes, b.crc)).collect::<Vec<_>>(),
            [(told.place(), 5, told.crc)]
        );
        assert_eq!(shelf.read(told.place()).unwrap(), b"bytes");
        shelf.remove(told.place());
        assert!(Shelf::open(&root).unwrap().1.is_empty() && !root.join("17S-0.15m/1_2_3.part").exists());
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn foreign_names_are_no_blocks() {
        assert_eq!(["17N-0.15m", "60S-1m"].map(map_of), [Some((17, 0, 0.15)), Some((60, 1, 1.0))]);
        assert_eq!(["", "m", "-m", "17-0.15m", "17E-1m", "ö-1m"].map(map_of), [None; 6]);
        assert_eq!(
            ["1_2_3.tsmap", "1_2.tsmap", "1_2_3_4.tsmap", "a_b_c.tsmap"].map(key_of),
            [Some([1, 2, 3]), None, None, None]
        );
    }
}
