//! Section `[bridge.fleet]` of the configuration.

use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault, VehicleName};

/// What a control station may know, and where it is: off until enabled, on this machine alone until given another
/// address.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Whether the process `fleet` is started. While it is not, there is no socket and no file.
    pub enabled: bool,
    /// Name of this vehicle, unlike that of any other: 1 to 32 ASCII letters, digits, - and _.
    pub vehicle: String,
    /// Addresses and ports of the stations; each gets a connection of its own, made anew when it was lost.
    pub connect: Vec<String>,
    /// Time between two looks at the store, seconds: each takes up to 4096 objects.
    pub objects_period_s: f64,
    /// Whether blocks of the map are offered, too.
    pub blocks: bool,
    /// A block in view is written down at most this often, seconds, and once more when it leaves the map.
    pub block_period_s: f64,
    /// Blocks kept for stations take no more of the disk than this, megabytes; then those written longest ago go.
    pub blocks_max_mb: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            enabled: false,
            vehicle: "vehicle".into(),
            connect: vec!["127.0.0.1:7447".into()],
            objects_period_s: 1.0,
            blocks: true,
            block_period_s: 30.0,
            blocks_max_mb: 512.0,
        }
    }
}

/// Stations of one vehicle, at most: each has threads and a connection of its own.
const STATIONS_MAX: usize = 4;

impl Config {
    /// All faults, with keys below `fleet`.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::below("fleet");
        check.require(VehicleName::new(&self.vehicle).is_some(), "vehicle", &self.vehicle, VehicleName::ALLOWED);
        for address in &self.connect {
            check.address("connect", address, "127.0.0.1:7447");
        }
        check.count("connect", self.connect.len(), 1, STATIONS_MAX, "addresses");
        check.range("objects_period_s", self.objects_period_s, 0.1, 3600.0, "s");
        check.range("block_period_s", self.block_period_s, 1.0, 86_400.0, "s");
        check.range("blocks_max_mb", self.blocks_max_mb, 10.0, 1e6, "MB");
        check.into_faults()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_off_on_loopback_and_without_fault() {
        let config = Config::default();
        assert_eq!(config.validate(), []);
        assert!(!config.enabled && config.connect.iter().all(|address| address.starts_with("127.")));
    }

    #[test]
    fn all_faults_are_listed() {
        let config = Config {
            vehicle: "a/b".into(),
            connect: vec!["localhost".into(); 5],
            objects_period_s: 0.0,
            block_period_s: f64::NAN,
            blocks_max_mb: 0.0,
            ..Config::default()
        };
        let keys: Vec<_> = config.validate().into_iter().map(|f| f.key).collect();
        let expected = ["vehicle"].into_iter().chain(["connect"; 6]);
        let expected = expected.chain(["objects_period_s", "block_period_s", "blocks_max_mb"]);
        assert_eq!(keys, expected.map(|k| format!("fleet.{k}")).collect::<Vec<_>>());
    }
}
