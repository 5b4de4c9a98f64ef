//! Why bytes are no map: what was seen, at which byte, what it means, what to do.

use super::MAGIC;
use super::records::VERSION;
use tsense_contract::BlockKey;

/// What is wrong with a map file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TsmapFault {
    /// Some other kind of file.
    #[error("byte 0: {seen:02x?} instead of {MAGIC:02x?}: this is no map file; give one that tsense wrote")]
    Foreign {
        /// The first bytes.
        seen: Vec<u8>,
    },
    /// Written by a newer program.
    #[error(
        "byte 8: format version {seen}, flags {flags}; this program knows version {VERSION}, flags 0: use a newer one"
    )]
    Version {
        /// The version in the file.
        seen: u16,
        /// The flags in the file.
        flags: u16,
    },
    /// The file ends early.
    #[error("byte {at}: the file ends, {missing} bytes are missing for {what}: it is truncated; copy or save it again")]
    Truncated {
        /// Where the bytes end.
        at: usize,
        /// How many more there should be, at least.
        missing: usize,
        /// What they should hold.
        what: String,
    },
    /// Bytes changed after they were written.
    #[error(
        "byte {at}: checksum {stored:08x} stands behind {what}, its bytes give {computed:08x}: the file is damaged; \
         copy or save it again"
    )]
    Checksum {
        /// Where the checked bytes start.
        at: usize,
        /// What they hold.
        what: String,
        /// As in the file.
        stored: u32,
        /// As it should be.
        computed: u32,
    },
    /// A value that no map has, under a good checksum.
    #[error("byte {at}: {what}: {seen}: no program of this version wrote this; use another file")]
    Value {
        /// Where it stands.
        at: usize,
        /// What it is part of.
        what: String,
        /// The value and what is allowed.
        seen: String,
    },
    /// Something follows the last block.
    #[error("byte {at}: {extra} bytes follow the last block: the file is damaged or two were joined; copy it again")]
    Trailing {
        /// Where it starts.
        at: usize,
        /// How many bytes.
        extra: usize,
    },
}

/// How a block is called in messages.
pub fn block_name(number: usize, key: BlockKey) -> String {
    format!("block {number} (key {}, {}, {})", key[0], key[1], key[2])
}
