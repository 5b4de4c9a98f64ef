//! What can go wrong with the store's file, each with what was seen, what it means and what to do.

use std::path::{Path, PathBuf};

/// A fault of the store's file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FileFault {
    /// The disk or the quota is full.
    #[error("{path}: the disk is full ({seen}); nothing is lost yet, objects wait in memory: free some space")]
    DiskFull {
        /// The file.
        path: PathBuf,
        /// What SQLite said.
        seen: String,
    },
    /// The file or its folder cannot be read, written or made.
    #[error(
        "{path}: cannot be used ({seen}); give this user read and write access to the file and its folder, or set kstore.file"
    )]
    NotWritable {
        /// The file.
        path: PathBuf,
        /// What the operating system or SQLite said.
        seen: String,
    },
    /// Another process writes to it.
    #[error(
        "{path}: another process has it open for writing ({seen}); end that process, or give each graph its own state folder"
    )]
    Busy {
        /// The file.
        path: PathBuf,
        /// What was seen.
        seen: String,
    },
    /// It is not a store, or a damaged one.
    #[error("{path}: damaged or no knowledge store ({seen}); `sqlite3 FILE .recover` may get something out of it")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was seen.
        seen: String,
    },
    /// A newer program wrote it.
    #[error(
        "{path}: written by a newer tsense (layout {found}, this one knows {known}); use that one, or set kstore.file"
    )]
    TooNew {
        /// The file.
        path: PathBuf,
        /// Its layout.
        found: String,
        /// Ours.
        known: u32,
    },
    /// The operating system failed in another way.
    #[error("{path}: {seen}; look at the disk with dmesg and df")]
    Other {
        /// The file.
        path: PathBuf,
        /// What was seen.
        seen: String,
    },
}

impl FileFault {
    /// What an error of SQLite on this file means.
    pub fn of_sqlite(path: &Path, error: &rusqlite::Error) -> Self {
        use rusqlite::ErrorCode as Code;
        let (path, seen) = (path.to_path_buf(), error.to_string());
        match error.sqlite_error_code() {
            Some(Code::DiskFull) => Self::DiskFull { path, seen },
            Some(Code::ReadOnly | Code::CannotOpen | Code::PermissionDenied) => Self::NotWritable { path, seen },
            Some(Code::DatabaseBusy | Code::DatabaseLocked) => Self::Busy { path, seen },
            Some(Code::DatabaseCorrupt | Code::NotADatabase) => Self::Damaged { path, seen },
            // No code: a value of the wrong type. Unknown: a table or a column is missing.
            None | Some(Code::Unknown | Code::TypeMismatch | Code::ConstraintViolation) => Self::Damaged { path, seen },
            Some(_) => Self::Other { path, seen },
        }
    }

    /// What an error of the GeoPackage layer on this file means.
    pub fn of_geopackage(path: &Path, error: &geopackage::Error) -> Self {
        match error {
            geopackage::Error::Sqlite(error) => Self::of_sqlite(path, error),
            other => Self::Damaged { path: path.to_path_buf(), seen: other.to_string() },
        }
    }

    /// What an error of the operating system on this file means.
    pub fn of_io(path: &Path, error: &std::io::Error) -> Self {
        use std::io::ErrorKind as Kind;
        let (path, seen) = (path.to_path_buf(), error.to_string());
        match error.kind() {
            Kind::StorageFull | Kind::QuotaExceeded | Kind::FileTooLarge => Self::DiskFull { path, seen },
            Kind::PermissionDenied | Kind::ReadOnlyFilesystem | Kind::NotFound | Kind::NotADirectory => {
                Self::NotWritable { path, seen }
            }
            _ => Self::Other { path, seen },
        }
    }

    /// True where the file's content is at fault, not the disk: it is set aside.
    pub fn is_damage(&self) -> bool {
        matches!(self, Self::Damaged { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(code: i32) -> String {
        let error = rusqlite::Error::SqliteFailure(rusqlite::ffi::Error::new(code), None);
        FileFault::of_sqlite(Path::new("/data/objects.gpkg"), &error).to_string()
    }

    #[test]
    fn every_fault_names_the_file_and_the_remedy() {
        use rusqlite::ffi;
        let cases = [
            (ffi::SQLITE_FULL, "free some space"),
            (ffi::SQLITE_READONLY, "write access"),
            (ffi::SQLITE_CANTOPEN, "write access"),
            (ffi::SQLITE_BUSY, "another process"),
            (ffi::SQLITE_CORRUPT, "damaged"),
            (ffi::SQLITE_NOTADB, "damaged"),
            (ffi::SQLITE_IOERR, "dmesg"),
        ];
        for (code, remedy) in cases {
            let said = said(code);
            assert!(said.starts_with("/data/objects.gpkg: ") && said.contains(remedy), "{said}");
        }
    }
}
