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
    cause: Cause,
}

/// Whose fault it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cause {
    /// The file's: it is damaged, or no such file.
    Data,
    /// The command's: it names no such file, or does not say what the file does not.
    Usage,
    /// The system's: the file cannot be read.
    System,
}

impl InputError {
    /// A fault of the file as a whole.
    pub fn new(path: &Path, seen: &str, remedy: &str) -> Self {
        let (place, cause) = (String::new(), Cause::Data);
        Self { path: path.into(), place, seen: seen.into(), remedy: remedy.into(), cause }
    }

    /// The same, where the command is to be changed, not the file.
    pub fn of_usage(self) -> Self {
        Self { cause: Cause::Usage, ..self }
    }

    /// The exit code it ends a command with.
    pub fn exit_code(&self) -> u8 {
        match self.cause {
            Cause::System => 1,
            Cause::Usage => 2,
            Cause::Data => 6,
        }
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
        let fault = Self::new(path, &error.to_string(), "check that the file is readable and complete");
        match error.kind() {
            std::io::ErrorKind::NotFound => Self::new(path, "no such file", "check the path").of_usage(),
            std::io::ErrorKind::UnexpectedEof | std::io::ErrorKind::InvalidData => fault,
            _ => Self { cause: Cause::System, ..fault },
        }
    }
}
