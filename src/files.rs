//! Files that commands write, and their folders: aside, under their names with `.part` behind, and renamed when whole.
//!
//! What ends before that, by an error or by a kill, leaves nothing under the final name. Devices and pipes are refused.
#![allow(clippy::disallowed_methods, reason = "shell: the commands' output files")]

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
    is_usage: bool,
}

impl OutputError {
    /// A fault of the system that more room or other permissions would mend.
    pub fn new(path: &Path, cause: impl std::fmt::Display) -> Self {
        let remedy = "check the folder's permissions and the space left";
        Self { path: path.into(), cause: cause.to_string(), remedy, is_usage: false }
    }

    /// A fault of the command: it names what cannot be written to.
    pub fn of_usage(path: &Path, cause: impl std::fmt::Display, remedy: &'static str) -> Self {
        Self { remedy, is_usage: true, ..Self::new(path, cause) }
    }

    /// The same, with what else is to be done.
    pub fn with_remedy(self, remedy: &'static str) -> Self {
        Self { remedy, ..self }
    }

    /// The exit code it ends a command with.
    pub fn exit_code(&self) -> u8 {
        if self.is_usage { 2 } else { 1 }
    }
}

/// Refuses a name under which no file can be made: also before the work that would fill it.
pub fn can_be_written(path: &Path) -> Result<(), OutputError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let (cause, remedy) = match folder {
        _ if path.is_dir() => ("this is a folder".into(), "give the name of a file"),
        // A device would be gone once the file had its name.
        _ if path.exists() && !path.is_file() => ("this is no plain file".into(), "give the name of a file"),
        Some(folder) if !folder.is_dir() => (format!("there is no folder {}", folder.display()), "make it first"),
        _ => return Ok(()),
    };
    Err(OutputError::of_usage(path, cause, remedy))
}

/// Makes a folder, unless something else has its name.
pub fn make_folder(path: &Path) -> Result<(), OutputError> {
    if path.exists() && !path.is_dir() {
        return Err(OutputError::of_usage(path, "this is no folder", "give the name of one"));
    }
    std::fs::create_dir_all(path).map_err(|e| OutputError::new(path, e))
}

/// Fills a file aside; it has its name only after [`Aside::commit`].
pub fn write_aside<E: std::fmt::Display>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<Aside, OutputError> {
    let aside = Aside::new(path)?;
    let mut writer = BufWriter::new(aside.create()?);
    fill(&mut writer).map_err(|e| aside.fault(e))?;
    writer.flush().map_err(|e| aside.fault(e))?;
    Ok(aside)
}

/// The same, and gives it its name.
pub fn write_whole<E: std::fmt::Display>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), OutputError> {
    write_aside(path, fill)?.commit()
}

/// Writes bytes that are there already.
pub fn write_bytes(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
    write_whole(path, |writer| writer.write_all(bytes.as_ref()))
}

/// A file that is not whole yet; it is removed where it is dropped.
#[derive(Debug)]
pub struct Aside {
    path: PathBuf,
    aside: PathBuf,
    is_done: bool,
}

impl Aside {
    /// A file that will be at `path`. Remains of one that was killed are removed.
    pub fn new(path: &Path) -> Result<Self, OutputError> {
        can_be_written(path)?;
        let mut name = path.as_os_str().to_owned();
        name.push(".part");
        let aside = PathBuf::from(name);
        // There are none, as a rule.
        let _ = std::fs::remove_file(&aside);
        Ok(Self { path: path.into(), aside, is_done: false })
    }

    /// Where it is written.
    pub fn part(&self) -> &Path {
        &self.aside
    }

    /// Makes it.
    pub fn create(&self) -> Result<File, OutputError> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_remains() {
        let folder = std::env::temp_dir().join(format!("tsense-files-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.csv");
        write_bytes(&path, b"old").unwrap();
        let failed = write_whole(&path, |w| {
            w.write_all(b"half").unwrap();
            Err("out of ideas")
        });
        assert!(failed.unwrap_err().to_string().contains("out of ideas"));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_is_no_name_of_a_file_is_refused_and_stays() {
        let folder = std::env::temp_dir().join(format!("tsense-files-no-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let socket = folder.join("socket");
        let _reader = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let nowhere = folder.join("nowhere/a.csv");
        for (path, told) in [(&socket, "no plain file"), (&folder, "a folder"), (&nowhere, "no folder")] {
            let refused = write_bytes(path, b"new").unwrap_err();
            assert!(refused.to_string().contains(told) && refused.exit_code() == 2, "{refused}");
        }
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
