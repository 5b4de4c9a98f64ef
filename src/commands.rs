//! The commands of `tsense`, one file each.

pub mod bench;
pub mod config;
pub mod demo;
pub mod device;
pub mod imaging;
pub mod map;
pub mod objects;
pub mod process;
pub mod run;
pub mod score;
pub mod simulate;
pub mod station;
pub mod status;
pub mod stop;
mod studies;
pub mod survey;
mod words;

use std::io::Write;

/// Why a command failed: what is said on standard error, and the exit code.
#[derive(Debug)]
pub struct Failure {
    /// For people.
    pub message: String,
    /// 1 failed, 2 usage, 3 configuration, 4 device, 5 a process kept dying, 6 corrupt data, 7 replay differs (kept for a
    /// command that is to come), 8 self-check below its limits, 130 interrupted.
    pub code: u8,
}

impl Failure {
    /// A failure with its code.
    pub fn new(code: u8, message: impl std::fmt::Display) -> Self {
        Self { message: message.to_string(), code }
    }
}

impl From<tsense_ports::PortError> for Failure {
    fn from(error: tsense_ports::PortError) -> Self {
        Self::new(1, error)
    }
}

impl From<crate::graph::GraphError> for Failure {
    fn from(error: crate::graph::GraphError) -> Self {
        Self::new(error.exit_code(), error)
    }
}

impl From<crate::files::OutputError> for Failure {
    fn from(error: crate::files::OutputError) -> Self {
        Self::new(error.exit_code(), error)
    }
}

/// What a command returns: the exit code of a success that is not plain (130), or a failure.
pub type Outcome = Result<u8, Failure>;

/// Writes data to standard output. A reader that went away is no failure.
pub fn print(text: &str) -> Outcome {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::new(1, format!("standard output: {e}"))),
        _ => Ok(0),
    }
}

/// A file that the command line names and that cannot be read: of usage where there is none.
pub fn unreadable(path: &std::path::Path, error: &std::io::Error) -> Failure {
    use std::io::ErrorKind::{IsADirectory, NotADirectory, NotFound};
    match error.kind() {
        NotFound | NotADirectory => Failure::new(2, format!("{}: no such file; check the path", path.display())),
        IsADirectory => Failure::new(2, format!("{}: a folder; give the name of a file", path.display())),
        _ => Failure::new(1, format!("{}: {error}; check that it is readable", path.display())),
    }
}

/// Says something to people, a line on standard error. That nobody can be told is no failure.
pub fn tell(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}
