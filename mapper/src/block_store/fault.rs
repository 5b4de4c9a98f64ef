//! What can go wrong with stored blocks, each with what was seen, what it means and what to do.

use std::path::PathBuf;

/// A fault of the folder of stored blocks, or of a file in it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreFault {
    /// The operating system refuses.
    #[error("{path}: {seen}; blocks are not stored: check the folder's permissions and the space left", path = .path.display())]
    Disk {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system said.
        seen: String,
    },
    /// A file is damaged, or is no block of this map.
    #[error("{path}: {seen}; the file is set aside as {aside}, the block starts unknown", path = .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        seen: String,
        /// Where it went, or why it could not.
        aside: String,
    },
    /// One block alone is larger than all blocks may be.
    #[error("a block of {bytes} bytes, but all blocks together may take {limit}: raise mapper.blocks.disk_max_mb")]
    Limit {
        /// Its bytes.
        bytes: u64,
        /// The limit, bytes.
        limit: u64,
    },
}
