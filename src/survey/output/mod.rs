//! What a survey writes: georeferenced rasters, objects, a classified cloud, tables and the report.
//!
//! Files are written under a temporary name in the output folder and renamed when all are complete, so that nothing
//! half-written is left under its final name.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's output files")]

mod bands;
mod cloud;
mod cog;
mod gpkg;
mod las_writer;
mod products;
mod rasters;
mod rejected_csv;
mod stems;
mod trees_csv;

pub use las_writer::LasWriter;
pub use products::Products;
pub use stems::Stems;

use crate::files::{OutputError, make_folder};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;
use std::fs::File;
use std::path::Path;

/// Makes the output folder, and keeps other surveys out of it as long as what it returns is held: files that are not
/// whole yet have the same names in both.
pub fn take_folder(folder: &Path) -> Result<File, OutputError> {
    make_folder(folder)?;
    let held = File::open(folder).map_err(|e| OutputError::new(folder, e))?;
    match flock(&held, FlockOperation::NonBlockingLockExclusive) {
        Err(Errno::WOULDBLOCK) => {
            let cause = "another survey is writing into this folder";
            Err(OutputError::new(folder, cause).with_remedy("wait for its end, or give another --out"))
        }
        // A file system that knows no locks keeps nobody out.
        _ => Ok(held),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_one_surveys_at_a_time() {
        let folder = std::env::temp_dir().join(format!("tsense-output-{}", std::process::id()));
        let held = take_folder(&folder).unwrap();
        assert!(take_folder(&folder).unwrap_err().to_string().contains("another survey"));
        drop(held);
        assert!(take_folder(&folder).is_ok());
        let file = folder.join("a.csv");
        std::fs::write(&file, "old").unwrap();
        let refused = take_folder(&file).unwrap_err();
        assert!(refused.to_string().contains("no folder") && refused.exit_code() == 2, "{refused}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
