//! Where a graph lives: its name, its private root on tmpfs, its prefix in shared memory, and the files in the root.
//!
//! Everything of a graph is under `/dev/shm/ts-UID-NAME/` or named `/dev/shm/tsUID-NAME_...`, so that two graphs
//! never meet, and removing one is removing these. The root holds the middleware's files, the event sockets, the
//! launcher's lock, the resolved configuration, the list of child processes, and `graph.json` with the clock.
#![allow(clippy::disallowed_methods, reason = "shell: the graph's own small files")]

use crate::clock::Clock;
use crate::error::PortError;
use iceoryx2::prelude::{Config, FileName, FilePath, Path as IoxPath, SemanticString};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Where POSIX shared memory lives on Linux; a tmpfs by convention.
pub const SHARED_MEMORY: &str = "/dev/shm";
/// Longest graph name.
pub const NAME_MAX: usize = 16;
/// Root and prefix together: an event socket's path (108 bytes) also holds a 39-digit number and a suffix.
const ROOT_AND_PREFIX_MAX: usize = 60;

/// Where a graph lives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    name: String,
    root: PathBuf,
    prefix: String,
}

/// What the launcher tells its children, in the root's `graph.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Facts {
    /// Name of the graph.
    pub name: String,
    /// Process id of the launcher.
    pub launcher: u32,
    /// The graph's clock.
    pub clock: Clock,
    /// Where the graph may keep files.
    pub state_dir: PathBuf,
}

impl Domain {
    /// The domain of the graph with this name, of this user. Touches nothing.
    pub fn new(name: &str) -> Result<Self, PortError> {
        check_name(name)?;
        let user = rustix::process::getuid().as_raw();
        let root = PathBuf::from(format!("{SHARED_MEMORY}/ts-{user}-{name}"));
        // No graph name holds an underscore, so no prefix is the start of another graph's.
        let prefix = format!("ts{user}-{name}_");
        let length = root.as_os_str().len() + prefix.len();
        if length > ROOT_AND_PREFIX_MAX {
            let problem = format!("{length} characters with its paths, at most {ROOT_AND_PREFIX_MAX}: shorten it");
            return Err(PortError::BadName { name: name.into(), problem });
        }
        Ok(Self { name: name.into(), root, prefix })
    }

    /// The graphs of this user whose root exists, running or left over, sorted by name.
    pub fn list() -> Vec<Self> {
        let start = format!("ts-{}-", rustix::process::getuid().as_raw());
        let entries = std::fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            entries.filter_map(|e| Some(e.file_name().to_str()?.strip_prefix(&start)?.to_owned())).collect();
        names.sort();
        names.iter().filter_map(|name| Self::new(name).ok()).collect()
    }

    /// The graph's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The folder of the graph's files.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// How the graph's files in shared memory begin.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The configuration as resolved, which the children read.
    pub fn config_file(&self) -> PathBuf {
        self.root.join("config.toml")
    }

    /// The launcher's socket for `status` and `stop`.
    pub fn socket(&self) -> PathBuf {
        self.root.join("control")
    }

    /// The launcher's lock.
    pub fn lock_file(&self) -> PathBuf {
        self.root.join("lock")
    }

    /// Process ids of the children, one a line, with their start times.
    pub fn children_file(&self) -> PathBuf {
        self.root.join("children")
    }

    /// The launcher's facts for its children.
    pub fn facts_file(&self) -> PathBuf {
        self.root.join("graph.json")
    }

    /// The middleware's configuration of this graph.
    pub(crate) fn middleware_file(&self) -> PathBuf {
        self.root.join("iceoryx2.toml")
    }

    /// Reads the launcher's facts.
    pub fn facts(&self) -> Result<Facts, PortError> {
        let missing = |seen: String| PortError::NoGraph { name: self.name.clone(), seen };
        let text = std::fs::read_to_string(self.facts_file()).map_err(|e| missing(format!("graph.json: {e}")))?;
        serde_json::from_str(&text).map_err(|e| missing(format!("graph.json: {e}")))
    }

    /// Writes the launcher's facts, whole or not at all.
    pub(crate) fn write_facts(&self, facts: &Facts) -> Result<(), PortError> {
        let text = serde_json::to_string_pretty(facts).unwrap_or_default();
        self.write(&self.facts_file(), &text)
    }

    /// Writes a file of the root, whole or not at all.
    pub fn write(&self, file: &Path, text: &str) -> Result<(), PortError> {
        let draft = file.with_extension("draft");
        let written = std::fs::write(&draft, text).and_then(|()| std::fs::rename(&draft, file));
        written.map_err(|e| PortError::system(format!("writing {}", file.display()), e))
    }

    /// The middleware's settings of this graph. Nobody cleans up by itself: the launcher does, one node at a time.
    pub(crate) fn middleware_config(&self) -> Result<Config, PortError> {
        let refused = |seen: String| PortError::Middleware { doing: "setting the graph's paths", seen };
        let root = self.root.to_str().unwrap_or_default();
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(|e| refused(format!("{e:?}")))?;
        config.global.set_root_path(&IoxPath::new(root.as_bytes()).map_err(|e| refused(format!("{e:?}")))?);
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Ok(config)
    }

    /// Writes the middleware's settings for the children.
    pub(crate) fn write_middleware_config(&self) -> Result<(), PortError> {
        let config = self.middleware_config()?;
        let text = toml::to_string(&config)
            .map_err(|e| PortError::Middleware { doing: "writing the middleware's settings", seen: e.to_string() })?;
        self.write(&self.middleware_file(), &text)
    }

    /// Makes the graph's settings this process's own. The middleware falls back to them when it cleans up a node
    /// whose own description is missing; with any others it would report success and remove nothing.
    pub(crate) fn adopt_middleware_config(&self) -> Result<Config, PortError> {
        let refused = |seen: String| PortError::Middleware { doing: "reading the graph's iceoryx2.toml", seen };
        let path = self.middleware_file();
        let path =
            FilePath::new(path.to_str().unwrap_or_default().as_bytes()).map_err(|e| refused(format!("{e:?}")))?;
        Config::setup_global_config_from_file(&path).map_err(|e| refused(e.to_string()))?;
        Config::from_file(&path).map_err(|e| refused(e.to_string()))
    }

    /// The files and folders of this graph that exist: nothing after a clean end.
    pub fn leftovers(&self) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        let mut left: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| p == &self.root || self.owns(p)).collect();
        left.sort();
        left
    }

    /// Removes everything of this graph. Only for the holder of its lock, with no process of it alive.
    pub(crate) fn erase(&self) {
        for path in self.leftovers() {
            let _ = if path == self.root { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        }
    }

    fn owns(&self, path: &Path) -> bool {
        path.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.starts_with(&self.prefix))
    }
}

fn check_name(name: &str) -> Result<(), PortError> {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if (1..=NAME_MAX).contains(&name.len()) && name.chars().all(allowed) {
        return Ok(());
    }
    let problem = format!("allowed are 1 to {NAME_MAX} characters out of a-z, 0-9 and -");
    Err(PortError::BadName { name: name.into(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_graph_never_owns_the_files_of_another() {
        let (short, long) = (Domain::new("a").unwrap(), Domain::new("a-b").unwrap());
        assert!(!long.prefix().starts_with(short.prefix()));
        assert!(!short.owns(&PathBuf::from(format!("{SHARED_MEMORY}/{}1", long.prefix()))));
        assert!(!short.owns(long.root()));
    }

    #[test]
    fn names_that_would_escape_the_root_are_refused() {
        for name in ["", "..", "a/b", "a_b", "A", "a b", "x".repeat(17).as_str(), "é"] {
            assert!(matches!(Domain::new(name), Err(PortError::BadName { .. })), "{name}");
        }
    }

    #[test]
    fn the_middlewares_settings_survive_their_trip_to_a_child() {
        let config = Domain::new("trip").unwrap().middleware_config().unwrap();
        let copy: Config = toml::from_str(&toml::to_string(&config).unwrap()).unwrap();
        assert_eq!(copy, config);
        assert!(!copy.global.node.cleanup_dead_nodes_on_creation);
        assert!(!copy.global.service.cleanup_dead_nodes_on_open);
    }
}
