//! A file that is written aside, under its name with `.part` behind it, and renamed when it is whole.
//!
//! What ends before that, by an error or by a kill, leaves nothing under the final name.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's output files")]

use super::OutputError;
use std::fs::File;
use std::path::{Path, PathBuf};

/// A file that is not whole yet; it is removed where it is dropped.
#[derive(Debug)]
pub struct Aside {
    path: PathBuf,
    aside: PathBuf,
    is_done: bool,
}

impl Aside {
    /// A file that will be at `path`. Remains of one that was killed are removed.
    pub fn new(path: &Path) -> Self {
        let mut name = path.as_os_str().to_owned();
        name.push(".part");
        let aside = PathBuf::from(name);
        // There are none, as a rule.
        let _ = std::fs::remove_file(&aside);
        Self { path: path.into(), aside, is_done: false }
    }

    /// Where it is written.
    pub fn part(&self) -> &Path {
        &self.aside
    }

    /// Makes it. What is no plain file is not replaced: a device would be gone.
    pub fn create(&self) -> Result<File, OutputError> {
        if self.path.exists() && !self.path.is_file() {
            return Err(OutputError { remedy: "give the name of a file", ..self.fault("this is no plain file") });
        }
        File::create(&self.aside).map_err(|e| self.fault(e))
    }

    /// Flushes it to the disk and gives it its name.
    pub fn commit(mut self) -> Result<(), OutputError> {
        let whole = File::open(&self.aside).and_then(|file| file.sync_all());
        whole.and_then(|()| std::fs::rename(&self.aside, &self.path)).map_err(|e| self.fault(e))?;
        self.is_done = true;
        Ok(())
    }

    /// An error of this file, by its final name.
    pub fn fault(&self, cause: impl std::fmt::Display) -> OutputError {
        OutputError::new(&self.path, cause)
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if !self.is_done {
            // The fault that ended the writing is the one to report.
            let _ = std::fs::remove_file(&self.aside);
        }
    }
}
