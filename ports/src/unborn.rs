//! Shared memory that was created and never got a size, because its creator was killed in between.
//!
//! The middleware (0.10.0) waits for such memory to grow without any time limit, in whoever opens it: a reader, or the
//! launcher that cleans up. Found with 1,500 kills in a minute: the launcher hung for good. So it is removed: at once
//! where its name holds a port of a dead node, otherwise by a watching thread once it has been without a size for
//! [`UNBORN_S`] seconds, which unsticks whoever waits for it. A creator needs microseconds for this step.
#![allow(clippy::disallowed_methods, reason = "shell: the middleware's own files")]

use crate::domain::{Domain, SHARED_MEMORY};
use crate::error::PortError;
use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// How long memory may be without a size, seconds: far more than a creator on a busy machine needs.
const UNBORN_S: f64 = 1.0;
/// Time between two looks.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Removes memory without a size that belongs to a port of a dead node, by the port tags in the node's folder.
pub(crate) fn remove_of_dead(domain: &Domain, node_dir: &Path) {
    let entries = std::fs::read_dir(node_dir).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let ports: Vec<String> = names.filter_map(|name| port_of_tag(&name).map(str::to_owned)).collect();
    for (path, _) in without_size(domain) {
        let name = path.file_stem().and_then(|n| n.to_str()).unwrap_or_default();
        if name.split('_').any(|part| ports.iter().any(|port| port == part)) {
            tracing::debug!(path = %path.display(), "removing memory that a dead process never gave a size");
            let _ = std::fs::remove_file(&path);
        }
    }
}

/// `PREFIX_NUMBER.port_tag`: the number.
fn port_of_tag(name: &str) -> Option<&str> {
    name.strip_suffix(".port_tag")?.rsplit('_').next()
}

/// The graph's memory without a size, with its inode.
fn without_size(domain: &Domain) -> Vec<(PathBuf, u64)> {
    let entries = std::fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    let ours = entries.filter(|e| e.file_name().to_str().is_some_and(|n| n.starts_with(domain.prefix())));
    let unborn = ours.filter_map(|e| Some((e.path(), e.metadata().ok()?)));
    unborn.filter(|(_, meta)| meta.is_file() && meta.len() == 0).map(|(path, meta)| (path, meta.ino())).collect()
}

/// The watching thread; ends when dropped.
pub(crate) struct Watch {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    pub(crate) fn start(domain: Domain) -> Result<Self, PortError> {
        let stop = Arc::new(AtomicBool::new(false));
        let told = stop.clone();
        let body = move || {
            let mut seen = BTreeMap::new();
            while !told.load(Ordering::Relaxed) {
                look(&domain, &mut seen, crate::clock::machine_seconds());
                std::thread::park_timeout(LOOK_EVERY);
            }
        };
        let thread = std::thread::Builder::new().name("unborn".into()).spawn(body);
        let thread = thread.map_err(|e| PortError::system("starting the watch over shared memory", e))?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

/// One look: remembers since when each is without a size, and removes what has been so for too long.
fn look(domain: &Domain, seen: &mut BTreeMap<(PathBuf, u64), f64>, now_s: f64) {
    let unborn = without_size(domain);
    seen.retain(|key, _| unborn.contains(key));
    for key in unborn {
        let since_s = *seen.entry(key.clone()).or_insert(now_s);
        if now_s - since_s >= UNBORN_S {
            tracing::warn!(path = %key.0.display(), "removing shared memory that its creator never gave a size");
            let _ = std::fs::remove_file(&key.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn domain(name: &str) -> Domain {
        Domain::new(&format!("{name}{}", std::process::id() % 1_000_000)).unwrap()
    }

    fn memory(domain: &Domain, name: &str, text: &str) -> PathBuf {
        let path = PathBuf::from(format!("{SHARED_MEMORY}/{}{name}", domain.prefix()));
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn memory_of_a_dead_port_without_a_size_is_removed_and_no_other() {
        let domain = domain("unborn");
        let folder = std::env::temp_dir().join(format!("tsense-unborn-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("ts0-x_123.port_tag"), "").unwrap();
        let sent = memory(&domain, "abc_123_77.connection", "");
        let received = memory(&domain, "abc_77_123.connection", "");
        let living = memory(&domain, "abc_77_1234.connection", "");
        let grown = memory(&domain, "abc_123.data", "x");
        remove_of_dead(&domain, &folder);
        assert!(!sent.exists() && !received.exists() && living.exists() && grown.exists());
        std::fs::remove_dir_all(folder).unwrap();
        std::fs::remove_file(living).unwrap();
        std::fs::remove_file(grown).unwrap();
    }

    #[test]
    fn memory_is_removed_only_after_a_second_without_a_size() {
        let domain = domain("slow");
        let path = memory(&domain, "abc_1.data", "");
        let mut seen = BTreeMap::new();
        look(&domain, &mut seen, 10.0);
        look(&domain, &mut seen, 10.9);
        assert!(path.exists());
        std::fs::write(&path, "grown").unwrap();
        look(&domain, &mut seen, 20.0);
        assert!(path.exists());
        std::fs::write(&path, "").unwrap();
        look(&domain, &mut seen, 30.0);
        look(&domain, &mut seen, 31.0);
        assert!(!path.exists());
    }
}
