//! What the launcher cleans up: dead nodes, one at a time, and what a kill left half made.
//!
//! A process killed while it creates or removes something leaves files the middleware cannot judge. Finished files
//! of its static storage have mode 0400, finished shared memory is not 0200, a living node has a monitor of mode
//! 0600. Whatever is younger than [`SETTLED_S`] may still be in the making and is never touched.
#![allow(clippy::disallowed_methods, reason = "shell: the middleware's own files")]

use crate::domain::{Domain, SHARED_MEMORY};
use crate::service::CLEAN_TIMEOUT;
use crate::unborn;
use iceoryx2::node::{DeadNodeView, NodeCleanupFailure, NodeView};
use iceoryx2::prelude::*;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Age below which a half-made file may still be in the making, seconds.
const SETTLED_S: i64 = 5;
/// Mode of a finished file of the static storage.
const FINISHED: u32 = 0o400;
/// Mode of shared memory in the making.
const SHARED_IN_THE_MAKING: u32 = 0o200;
/// Mode of the monitor of a node.
const MONITOR: u32 = 0o600;
/// Tries to clean one node: the first may stumble over a half-made tag, the second does not.
const TRIES: usize = 3;

/// Removes what dead nodes left; returns how many nodes. Call it only after the dead were waited for.
pub(crate) fn clean_dead(domain: &Domain, config: &Config) -> usize {
    let mut dead = Vec::new();
    let listed = Node::<ipc::Service>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            dead.push(node);
        }
        CallbackProgression::Continue
    });
    if let Err(e) = listed {
        tracing::warn!(error = ?e, "the nodes of the graph could not be listed, tried again after the next death");
    }
    dead.into_iter().filter(|node| clean_node(domain, node)).count()
}

fn clean_node(domain: &Domain, node: &DeadNodeView<ipc::Service>) -> bool {
    // Or the cleaning below would wait for it for ever.
    unborn::remove_of_dead(domain, &node_dir(domain, node));
    for _ in 0..TRIES {
        match node.clone().blocking_remove_stale_resources(CLEAN_TIMEOUT) {
            Ok(()) => return true,
            Err(NodeCleanupFailure::InternalError) => remove_half_made_tags(&node_dir(domain, node)),
            Err(e) => tracing::debug!(error = %e, "cleaning up after a dead process"),
        }
    }
    tracing::warn!(node = ?node.id(), "a dead process could not be cleaned up, tried again by the janitor");
    false
}

fn node_dir(domain: &Domain, node: &DeadNodeView<ipc::Service>) -> PathBuf {
    domain.root().join("nodes").join(node.id().value().to_string())
}

/// The node is dead, so nothing in its folder is in the making any more.
fn remove_half_made_tags(folder: &Path) {
    for (path, meta) in files(folder) {
        if meta.mode() & 0o777 != FINISHED {
            remove(&path, "a half-made tag of a dead process");
        }
    }
}

/// Removes what nobody will finish: half-made services, nodes without a monitor, half-made shared memory.
pub(crate) fn sweep(domain: &Domain) {
    let now_s = rustix::time::clock_gettime(rustix::time::ClockId::Realtime).tv_sec;
    let settled = |meta: &std::fs::Metadata| now_s - meta.ctime() > SETTLED_S;
    for (path, meta) in files(&domain.root().join("services")) {
        let service = path.extension().is_some_and(|e| e == "service");
        if service && settled(&meta) && meta.mode() & 0o777 != FINISHED {
            remove(&path, "a half-made service");
        }
    }
    for (path, meta) in files(Path::new(SHARED_MEMORY)) {
        let ours = path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with(domain.prefix()));
        if ours && settled(&meta) && meta.mode() & 0o777 == SHARED_IN_THE_MAKING {
            remove(&path, "half-made shared memory");
        }
    }
    sweep_nodes(domain, settled);
}

fn sweep_nodes(domain: &Domain, settled: impl Fn(&std::fs::Metadata) -> bool) {
    let nodes = domain.root().join("nodes");
    for (folder, meta) in entries(&nodes).filter(|(_, meta)| meta.is_dir()) {
        let Some(id) = folder.file_name().and_then(|n| n.to_str()) else { continue };
        let monitor = nodes.join(format!("{}{id}.node_monitor", domain.prefix()));
        let alive = std::fs::metadata(&monitor).is_ok_and(|m| m.mode() & 0o777 == MONITOR);
        if !alive && settled(&meta) {
            tracing::debug!(folder = %folder.display(), "removing a node without a monitor");
            let _ = std::fs::remove_dir_all(&folder);
            let _ = std::fs::remove_file(&monitor);
        }
    }
}

fn entries(folder: &Path) -> impl Iterator<Item = (PathBuf, std::fs::Metadata)> {
    let read = std::fs::read_dir(folder).into_iter().flatten().flatten();
    read.filter_map(|entry| Some((entry.path(), entry.metadata().ok()?)))
}

fn files(folder: &Path) -> impl Iterator<Item = (PathBuf, std::fs::Metadata)> {
    entries(folder).filter(|(_, meta)| meta.is_file())
}

fn remove(path: &Path, what: &str) {
    tracing::debug!(path = %path.display(), "removing {what}");
    let _ = std::fs::remove_file(path);
}
