//! What a survey writes: georeferenced rasters, objects, a classified cloud, tables and the report.
//!
//! Files are written under a temporary name in the output folder and renamed when complete, so that nothing
//! half-written is left under its final name.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's output files")]

mod aside;
mod cloud;
mod cog;
mod gpkg;
mod las_writer;
mod products;
mod rasters;
mod rejected_csv;
mod trees_csv;

pub use aside::Aside;
pub use cloud::Stems;
pub use las_writer::LasWriter;
pub use products::Products;

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Why an output could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {cause}; {remedy}", path = .path.display())]
pub struct OutputError {
    path: PathBuf,
    cause: String,
    remedy: &'static str,
}

impl OutputError {
    fn new(path: &Path, cause: impl std::fmt::Display) -> Self {
        let remedy = "check the folder's permissions and the space left";
        Self { path: path.into(), cause: cause.to_string(), remedy }
    }
}

/// Makes the output folder, and keeps other surveys out of it as long as what it returns is held: files that are not
/// whole yet have the same names in both.
pub fn take_folder(folder: &Path) -> Result<File, OutputError> {
    if folder.exists() && !folder.is_dir() {
        return Err(OutputError { remedy: "give another --out", ..OutputError::new(folder, "this is no folder") });
    }
    std::fs::create_dir_all(folder).map_err(|e| OutputError::new(folder, e))?;
    let held = File::open(folder).map_err(|e| OutputError::new(folder, e))?;
    match flock(&held, FlockOperation::NonBlockingLockExclusive) {
        Err(Errno::WOULDBLOCK) => {
            let cause = "another survey is writing into this folder";
            Err(OutputError { remedy: "wait for its end, or give another --out", ..OutputError::new(folder, cause) })
        }
        // A file system that knows no locks keeps nobody out.
        _ => Ok(held),
    }
}

/// Writes a file aside with `fill`, flushes it to the disk and renames it to its final name.
pub fn write_whole<E: std::fmt::Display>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), OutputError> {
    let aside = Aside::new(path);
    let mut writer = BufWriter::new(aside.create()?);
    fill(&mut writer).map_err(|e| aside.fault(e))?;
    writer.flush().map_err(|e| aside.fault(e))?;
    aside.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_remains() {
        let folder = std::env::temp_dir().join(format!("tsense-output-{}", std::process::id()));
        let held = take_folder(&folder).unwrap();
        assert!(take_folder(&folder).unwrap_err().to_string().contains("another survey"));
        drop(held);
        assert!(take_folder(&folder).is_ok());
        let path = folder.join("a.csv");
        write_whole(&path, |w| w.write_all(b"old")).unwrap();
        assert!(take_folder(&path).unwrap_err().to_string().contains("no folder"));
        let pipe = folder.join("pipe");
        let _reader = std::os::unix::net::UnixListener::bind(&pipe).unwrap();
        let replaced = write_whole(&pipe, |w| w.write_all(b"new"));
        assert!(replaced.unwrap_err().to_string().contains("no plain file") && !pipe.is_file());
        std::fs::remove_file(&pipe).unwrap();
        let failed = write_whole(&path, |w| {
            w.write_all(b"half").unwrap();
            Err("out of ideas")
        });
        assert!(failed.unwrap_err().to_string().contains("out of ideas"));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
