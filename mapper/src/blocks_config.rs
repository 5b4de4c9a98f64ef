//! Section `[mapper.blocks]`: what becomes of blocks that the vehicle leaves behind.

use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};

/// The thesis's two modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BlockMode {
    /// Forget them: the pose drifts, and old data comes back in the wrong place.
    Discard,
    /// Write them down, and read them back when the vehicle returns: for poses that do not drift.
    Store,
}

/// What becomes of blocks that the vehicle leaves behind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BlocksConfig {
    /// Whether blocks are forgotten or stored.
    pub mode: BlockMode,
    /// Folder of the stored blocks, within the graph's state folder.
    pub folder: String,
    /// Most disk the stored blocks may take, megabytes; beyond it the oldest are removed. A block of a wood takes about
    /// 0.1 MB, so that a thousand are some 10,000 blocks: 2 km^2 one layer high.
    pub disk_max_mb: f64,
    /// Whether stored confidence fades as if the block had stayed in the map; else it comes back as it left.
    pub fade_stored: bool,
    /// Whether the blocks around the vehicle are stored as well when the graph is stopped.
    pub store_at_stop: bool,
}

impl Default for BlocksConfig {
    fn default() -> Self {
        Self {
            mode: BlockMode::Discard,
            folder: "blocks".into(),
            disk_max_mb: 1000.0,
            fade_stored: true,
            store_at_stop: true,
        }
    }
}

impl BlocksConfig {
    /// All faults.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        let is_plain = !self.folder.is_empty() && !self.folder.starts_with('.') && self.folder.chars().all(plain);
        let allowed = "a plain name of letters, digits, -, _ and ., not starting with a dot";
        check.require(is_plain, "blocks.folder", &self.folder, allowed);
        check.range("blocks.disk_max_mb", self.disk_max_mb, 2.0, 10_000_000.0, "MB");
        check.into_faults()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_leads_elsewhere_and_no_disk_at_all_are_faults() {
        assert_eq!(BlocksConfig::default().validate(), vec![]);
        for folder in ["", "..", "/tmp", "a/b", ".hidden", "a b"] {
            let config = BlocksConfig { folder: folder.into(), disk_max_mb: f64::NAN, ..BlocksConfig::default() };
            let keys: Vec<_> = config.validate().into_iter().map(|fault| fault.key).collect();
            assert_eq!(keys, ["blocks.folder", "blocks.disk_max_mb"], "{folder:?}");
        }
    }
}
