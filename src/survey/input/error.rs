//! What is wrong with an input: which file, where in it, what was seen, and what to do.

use std::path::{Path, PathBuf};

/// A fault of an input file.
#[derive(Debug, thiserror::Error)]
#[error("{path}{place}: {seen}; {remedy}", path = .path.display())]
pub struct InputError {
    path: PathBuf,
    /// ` line 12` or ` byte 340`, or nothing.
    place: String,
    seen: String,
    remedy: String,
}

impl InputError {
    /// A fault of the file as a whole.
    pub fn new(path: &Path, seen: &str, remedy: &str) -> Self {
        Self { path: path.into(), place: String::new(), seen: seen.into(), remedy: remedy.into() }
    }

    /// The same fault at a line, counted from 1.
    pub fn at_line(mut self, line: usize) -> Self {
        self.place = format!(" line {line}");
        self
    }

    /// The same fault at a byte, counted from 0.
    pub fn at_byte(mut self, byte: u64) -> Self {
        self.place = format!(" byte {byte}");
        self
    }

    /// A fault of reading.
    pub fn io(path: &Path, error: &std::io::Error) -> Self {
        Self::new(path, &error.to_string(), "check that the file is readable and complete")
    }
}
