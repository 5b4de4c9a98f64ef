//! The block files of a station: `FOLDER/VEHICLE/ZONE-SIZE/x_y_z.tsmap`, as each vehicle sent them.
//!
//! In: bytes that were checked. Out: a file under its name only when it is whole: written aside, flushed, renamed. All
//! of them together take no more than a limit; what does not fit is refused, nothing is removed: it is an archive.
#![allow(clippy::disallowed_methods, reason = "shell: this module owns the station's block files")]

use crate::persist::FileFault;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use tsense_contract::{BlockPlace, VehicleName, block_path};

/// The folder.
#[derive(Debug)]
pub struct BlockFiles {
    root: PathBuf,
    limit_bytes: u64,
}

impl BlockFiles {
    /// A folder that is made with its first file.
    pub fn new(root: &Path, limit_bytes: u64) -> Self {
        Self { root: root.into(), limit_bytes }
    }

    /// Whether files of so many bytes in all are within the limit.
    pub fn has_room(&self, total_bytes: u64) -> bool {
        total_bytes <= self.limit_bytes
    }

    /// Where a block of a vehicle lies.
    pub fn path(&self, vehicle: &VehicleName, place: BlockPlace) -> PathBuf {
        self.root.join(vehicle.as_str()).join(block_path(place))
    }

    /// Removes all files of a vehicle.
    pub fn forget(&self, vehicle: &VehicleName) -> Result<(), FileFault> {
        let path = self.root.join(vehicle.as_str());
        match fs::remove_dir_all(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(FileFault::Other {
                path,
                seen: format!("not removed ({e}); the store has forgotten it: remove it by hand"),
            }),
            _ => Ok(()),
        }
    }

    /// Writes a file, whole or not at all.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> std::io::Result<()> {
        let aside = path.with_extension("part");
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        let mut file = File::create(&aside)?;
        let written = file.write_all(bytes).and_then(|()| file.sync_all());
        written.and_then(|()| fs::rename(&aside, path)).inspect_err(|_| {
            // The fault of writing is the one to report.
            let _ = fs::remove_file(&aside);
        })
    }
}
