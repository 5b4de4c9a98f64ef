//! The two ways in which a device writes telegrams, and what framing them counts.

use std::fmt;

/// Largest payload believed, bytes. A scan of 1081 beams with four 16-bit channels takes 9 kB in CoLa-B and 22 kB in CoLa-A.
pub const PAYLOAD_MAX: usize = 64 * 1024;

/// How a device writes its telegrams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// CoLa-A: text.
    A,
    /// CoLa-B: binary.
    B,
}

impl Dialect {
    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

impl fmt::Display for Dialect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::A => "CoLa-A",
            Self::B => "CoLa-B",
        })
    }
}

/// What framing found and what it had to skip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Whole frames.
    pub frames: u64,
    /// Frames dropped for their length, checksum or a forbidden byte.
    pub bad_frames: u64,
    /// Bytes outside of any whole frame.
    pub bytes_skipped: u64,
}
