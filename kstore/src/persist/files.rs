//! The files around the store: its lock, its bound on ids, making it whole or not at all, setting it aside.
#![allow(clippy::disallowed_methods, reason = "shell: this module owns the store's files")]

use super::fault::FileFault;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Damaged files that may lie beside the store; a disk that damages more has to be looked at.
const SET_ASIDE_MAX: u32 = 1000;

/// The paths of a store, held by this process alone.
#[derive(Debug)]
pub struct Files {
    /// The store itself.
    pub path: PathBuf,
    /// The kernel frees it when this process ends, however it ends.
    _lock: File,
}

impl Files {
    /// Makes the folder, and locks the store against another writer.
    pub fn lock(path: &Path) -> Result<Self, FileFault> {
        let failed = |e: &std::io::Error| FileFault::of_io(path, e);
        if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(|e| failed(&e))?;
        }
        let lock_path = beside(path, ".lock");
        let lock = OpenOptions::new().create(true).truncate(false).write(true).open(&lock_path);
        let lock = lock.map_err(|e| failed(&e))?;
        match lock.try_lock() {
            Ok(()) => Ok(Self { path: path.to_path_buf(), _lock: lock }),
            Err(TryLockError::WouldBlock) => {
                Err(FileFault::Busy { path: path.to_path_buf(), seen: format!("{} is locked", lock_path.display()) })
            }
            Err(TryLockError::Error(e)) => Err(failed(&e)),
        }
    }

    /// A store that was killed while it was made holds nothing yet.
    pub fn remove_unfinished(&self) {
        for end in [".new", ".new-journal", ".new-wal", ".new-shm"] {
            let _ = fs::remove_file(beside(&self.path, end));
        }
    }

    /// Makes the file under another name, then renames it: it is there whole, or not at all.
    pub fn create(&self, make: impl FnOnce(&Path) -> Result<(), FileFault>) -> Result<(), FileFault> {
        self.remove_unfinished();
        let new = beside(&self.path, ".new");
        make(&new)?;
        self.put_in_place(&new, &self.path)
    }

    /// Moves the store out of the way, with its log: `objects.gpkg` becomes `objects.damaged-1.gpkg`.
    pub fn set_aside(&self) -> Result<PathBuf, FileFault> {
        for number in 1..=SET_ASIDE_MAX {
            let to = self.path.with_extension(format!("damaged-{number}.gpkg"));
            if to.exists() {
                continue;
            }
            for end in ["-wal", "-journal"] {
                let _ = fs::rename(beside(&self.path, end), beside(&to, end));
            }
            // The index of the log is made anew from the log.
            let _ = fs::remove_file(beside(&self.path, "-shm"));
            self.put_in_place(&self.path, &to)?;
            return Ok(to);
        }
        let seen = format!("{SET_ASIDE_MAX} damaged files lie beside it already");
        Err(FileFault::Other { path: self.path.clone(), seen })
    }

    /// Remembers a bound on the ids given.
    pub fn write_ids_below(&self, below: u64) -> Result<(), FileFault> {
        let (new, to) = (beside(&self.path, ".ids.new"), beside(&self.path, ".ids"));
        let write = || {
            let mut file = File::create(&new)?;
            writeln!(file, "{below}")?;
            file.sync_all()
        };
        write().map_err(|e| FileFault::of_io(&to, &e))?;
        self.put_in_place(&new, &to)
    }

    /// Renames, and makes the folder remember it.
    fn put_in_place(&self, from: &Path, to: &Path) -> Result<(), FileFault> {
        let rename = || {
            fs::rename(from, to)?;
            let folder = to.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
            File::open(folder)?.sync_all()
        };
        rename().map_err(|e| FileFault::of_io(to, &e))
    }
}

/// A copy of a store and its log in the folder for temporary files, removed at the end.
pub struct Copy {
    folder: PathBuf,
    /// The store.
    pub file: PathBuf,
}

impl Copy {
    /// Copies the store at `path`.
    pub fn of(path: &Path) -> Result<Self, FileFault> {
        let failed = |e: std::io::Error| FileFault::of_io(path, &e);
        let folder = std::env::temp_dir().join(format!("tsense-objects-{}", std::process::id()));
        fs::create_dir_all(&folder).map_err(failed)?;
        let copy = Self { file: folder.join("objects.gpkg"), folder };
        fs::copy(path, &copy.file).map_err(failed)?;
        for end in ["-wal", "-journal"] {
            let from = beside(path, end);
            if from.exists() {
                fs::copy(from, beside(&copy.file, end)).map_err(failed)?;
            }
        }
        Ok(copy)
    }
}

impl Drop for Copy {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Ids below this may have been given; 1 where nothing is known.
pub fn ids_below(path: &Path) -> u64 {
    let text = fs::read_to_string(beside(path, ".ids")).unwrap_or_default();
    text.trim().parse().unwrap_or(1)
}

/// The path with something after its name.
fn beside(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    name.into()
}
