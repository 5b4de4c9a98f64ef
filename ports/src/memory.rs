//! How much shared memory a graph can need, checked before it starts: too little ends in SIGBUS, not in an error.

use crate::domain::SHARED_MEMORY;
use crate::error::PortError;
use tsense_contract::{Service as Request, Topic};

const MEGABYTE: u64 = 1_000_000;

/// What a graph's configuration can need of a topic, where that is less than the topic's own bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Most {
    /// Samples in use at once.
    pub samples: usize,
    /// Items of a sample.
    pub items: usize,
}

impl Most {
    /// As much as the topic allows.
    pub const ALL: Self = Self { samples: usize::MAX, items: usize::MAX };
}

/// Bytes a topic can hold in use at once.
///
/// The middleware reserves address space for every reader holding different samples; memory is used only where
/// samples are. Readers share samples: what waits for them is among the newest `buffer`, and what they hold is
/// `borrow` at most, so this is the working figure for readers that keep about the same samples.
pub(crate) fn topic_bytes<T: Topic>(most: Most) -> u64 {
    let samples = T::QOS.buffer + T::QOS.borrow + T::QOS.history + T::QOS.loans;
    let sample = size_of::<T::Header>() + size_of::<T::Item>() * most.items.min(T::ITEMS_MAX);
    (T::QOS.publishers * samples.min(most.samples) * sample) as u64
}

/// Bytes of the answers a service can hold in use at once.
pub(crate) fn request_bytes<S: Request>() -> u64 {
    (2 * S::CLIENTS * (size_of::<S::Header>() + size_of::<S::Item>() * S::ITEMS_MAX)) as u64
}

/// Fails where shared memory has less than `needed` bytes free.
pub(crate) fn check(needed: u64) -> Result<(), PortError> {
    let space = rustix::fs::statvfs(SHARED_MEMORY)
        .map_err(|e| PortError::system(format!("asking {SHARED_MEMORY} for its free space"), e))?;
    let free = space.f_bavail.saturating_mul(space.f_frsize);
    compare(free, needed)
}

fn compare(free: u64, needed: u64) -> Result<(), PortError> {
    if free >= needed {
        return Ok(());
    }
    let (free_mb, needed_mb) = (free / MEGABYTE, needed.div_ceil(MEGABYTE));
    Err(PortError::NoMemory { path: SHARED_MEMORY.into(), free_mb, needed_mb })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_containers_64_megabytes_are_refused_before_the_map_needs_more() {
        let map = topic_bytes::<tsense_contract::Map>(Most::ALL);
        // (1325 buffered + 1324 held + 2 loaned) x (176 + 6250 x 128) bytes.
        assert_eq!(map, 2651 * 800_176);
        let error = compare(64 * 1024 * 1024, map).unwrap_err();
        assert!(error.to_string().contains("67 MB free, but this graph can need 2122 MB"), "{error}");
        assert!(compare(map, map).is_ok());
    }

    #[test]
    fn a_small_map_needs_little() {
        let small = Most { samples: 10, items: 100 };
        assert_eq!(topic_bytes::<tsense_contract::Map>(small), 10 * (176 + 100 * 128));
    }
}
