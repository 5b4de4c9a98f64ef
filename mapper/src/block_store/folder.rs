//! The folder of stored blocks: one file a block, in a folder for each zone and voxel size, bounded in total.
//!
//! In: stored blocks, keys. Out: the same blocks, or a [`StoreFault`]. A file is written aside, flushed to the disk, and
//! renamed: under its name it is whole. The folder itself is not flushed: after a loss of power a rename may be
//! forgotten, and then the older block is there, or none. Files that do not check are renamed to `.damaged`. When the
//! limit is reached, the files written longest ago go first, whatever zone they are of.
#![allow(clippy::disallowed_methods, reason = "shell: this module owns the files of stored blocks")]

use super::fault::StoreFault;
use crate::tsmap::{self, EXTENSION, MapFileHeader, StoredBlock};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use tsense_contract::BlockKey;

/// What follows the name of a file that did not check.
const DAMAGED: &str = "damaged";
/// What follows the name of a file that is being written.
const PART: &str = "part";

/// Stored blocks on disk.
#[derive(Debug)]
pub struct Folder {
    root: PathBuf,
    limit_bytes: u64,
    files: BTreeMap<PathBuf, Entry>,
    total_bytes: u64,
    next_age: u64,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    bytes: u64,
    /// Counts writes: the smallest is the oldest.
    age: u64,
}

impl Folder {
    /// Opens the folder, made where it does not exist, and looks what is there. Files that were half written when a
    /// process died are removed.
    pub fn open(root: &Path, limit_bytes: u64) -> Result<Self, StoreFault> {
        let failed = |e: std::io::Error| StoreFault::Disk { path: root.into(), seen: e.to_string() };
        fs::create_dir_all(root).map_err(failed)?;
        let mut found: Vec<(SystemTime, PathBuf, u64)> = Vec::new();
        for zone in fs::read_dir(root).map_err(failed)?.flatten().filter(|e| e.path().is_dir()) {
            for file in fs::read_dir(zone.path()).map_err(failed)?.flatten() {
                let (path, meta) = (file.path(), file.metadata().map_err(failed)?);
                if is_ours(&path, PART) {
                    let _ = fs::remove_file(&path);
                } else if is_ours(&path, "") || is_ours(&path, DAMAGED) {
                    found.push((meta.modified().unwrap_or(SystemTime::UNIX_EPOCH), path, meta.len()));
                }
            }
        }
        found.sort();
        let mut folder = Self { root: root.into(), limit_bytes, files: BTreeMap::new(), total_bytes: 0, next_age: 0 };
        found.into_iter().for_each(|(_, path, bytes)| folder.note(path, bytes));
        Ok(folder)
    }

    /// Where a block of a map lies.
    pub fn path_of(&self, header: &MapFileHeader, key: BlockKey) -> PathBuf {
        self.root.join(zone_folder(header)).join(file_name(key))
    }

    /// Files there, and the bytes they take.
    pub fn usage(&self) -> (usize, u64) {
        (self.files.len(), self.total_bytes)
    }

    /// Reads a block; nothing where none is stored. A file that does not check is set aside.
    pub fn load(&mut self, header: &MapFileHeader, key: BlockKey) -> Result<Option<StoredBlock>, StoreFault> {
        let path = self.path_of(header, key);
        let bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(StoreFault::Disk { path, seen: e.to_string() }),
        };
        match the_block(&bytes, header, key) {
            Ok(block) => Ok(Some(block)),
            Err(seen) => Err(self.set_aside(path, seen)),
        }
    }

    /// Writes a block; how many older files had to go for it.
    pub fn save(&mut self, header: &MapFileHeader, block: &StoredBlock) -> Result<usize, StoreFault> {
        let path = self.path_of(header, block.key);
        let bytes = tsmap::encode(header, std::slice::from_ref(block));
        let removed = self.make_room(&path, bytes.len() as u64)?;
        let aside = with_ending(&path, PART);
        let written = write_synced(&aside, &bytes).and_then(|()| fs::rename(&aside, &path));
        written.map_err(|e| {
            // The fault of writing is the one to report; that the remains cannot be removed either adds nothing.
            let _ = fs::remove_file(&aside);
            StoreFault::Disk { path: path.clone(), seen: e.to_string() }
        })?;
        self.note(path, bytes.len() as u64);
        Ok(removed)
    }

    /// Removes the oldest files until `bytes` more fit in place of the file at `path`.
    fn make_room(&mut self, path: &Path, bytes: u64) -> Result<usize, StoreFault> {
        if bytes > self.limit_bytes {
            return Err(StoreFault::Limit { bytes, limit: self.limit_bytes });
        }
        let mut removed = 0;
        loop {
            let replaced = self.files.get(path).map_or(0, |entry| entry.bytes);
            let others = self.files.iter().filter(|(other, _)| *other != path);
            let oldest = others.min_by_key(|(_, entry)| entry.age).map(|(other, _)| other.clone());
            match oldest {
                Some(oldest) if self.total_bytes - replaced + bytes > self.limit_bytes => {
                    self.remove(&oldest)?;
                    removed += 1;
                }
                _ => return Ok(removed),
            }
        }
    }

    fn remove(&mut self, path: &Path) -> Result<(), StoreFault> {
        match fs::remove_file(path) {
            Err(e) if e.kind() != ErrorKind::NotFound => {
                Err(StoreFault::Disk { path: path.into(), seen: e.to_string() })
            }
            _ => {
                self.forget(path);
                Ok(())
            }
        }
    }

    fn set_aside(&mut self, path: PathBuf, seen: String) -> StoreFault {
        let to = with_ending(&path, DAMAGED);
        let bytes = self.files.get(&path).map_or(0, |entry| entry.bytes);
        let aside = match fs::rename(&path, &to) {
            Ok(()) => {
                self.forget(&path);
                let name = to.file_name().unwrap_or_default().to_string_lossy().into_owned();
                self.note(to, bytes);
                name
            }
            Err(e) => format!("nothing ({e})"),
        };
        StoreFault::Damaged { path, seen, aside }
    }

    fn note(&mut self, path: PathBuf, bytes: u64) {
        self.forget(&path);
        self.total_bytes += bytes;
        self.files.insert(path, Entry { bytes, age: self.next_age });
        self.next_age += 1;
    }

    fn forget(&mut self, path: &Path) {
        self.total_bytes -= self.files.remove(path).map_or(0, |entry| entry.bytes);
    }
}

/// Folder of a zone and a voxel size, for example `32N-0.15m`: maps of two never mix.
fn zone_folder(header: &MapFileHeader) -> String {
    let side = if header.south { 'S' } else { 'N' };
    format!("{}{side}-{}m", header.zone, header.voxel_size_m)
}

fn file_name([x, y, z]: BlockKey) -> String {
    format!("{x}_{y}_{z}.{EXTENSION}")
}

/// Whether a file's name is a block's, with this ending behind it.
fn is_ours(path: &Path, ending: &str) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let name = if ending.is_empty() { Some(name) } else { name.strip_suffix(ending).and_then(|n| n.strip_suffix('.')) };
    let numbers = name.and_then(|name| name.strip_suffix(EXTENSION)).and_then(|name| name.strip_suffix('.'));
    numbers.is_some_and(|numbers| numbers.split('_').filter(|n| n.parse::<i32>().is_ok()).count() == 3)
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

fn write_synced(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// The one block a file must hold.
fn the_block(bytes: &[u8], wanted: &MapFileHeader, key: BlockKey) -> Result<StoredBlock, String> {
    let (header, blocks) = tsmap::decode(bytes).map_err(|fault| fault.to_string())?;
    let place = |h: &MapFileHeader| (h.zone, h.south, h.voxel_size_m.to_bits());
    if place(&header) != place(wanted) {
        let MapFileHeader { voxel_size_m, zone, .. } = header;
        return Err(format!("it holds voxels of {voxel_size_m} m in zone {zone}, which this map does not have"));
    }
    match <[StoredBlock; 1]>::try_from(blocks) {
        Ok([block]) if block.key == key => Ok(block),
        Ok([block]) => Err(format!("it holds block {:?} under another block's name", block.key)),
        Err(blocks) => Err(format!("it holds {} blocks instead of one", blocks.len())),
    }
}
