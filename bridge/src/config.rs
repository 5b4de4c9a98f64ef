//! Section `[bridge]` of the configuration.

use crate::allowed;
use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};

/// What the bridge shows, where, and to whom.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Whether the page is served by the process `bridge`. JAUS, ROS 2, Foxglove and the fleet are switched in their own
    /// sections.
    pub enabled: bool,
    /// Address and port of the page; port 0 takes any free one. Anything but loopback opens the page to the network.
    pub listen: String,
    /// Host names, without port, under which the page may be asked for besides this machine's loopback names.
    pub allowed_hosts: Vec<String>,
    /// Origins (`https://name:port`) of other pages that may read the stream.
    pub allowed_origins: Vec<String>,
    /// Most viewers at a time.
    pub max_clients: usize,
    /// Scans and poses shown a second, at most.
    pub update_hz: f64,
    /// Length of the vehicle as drawn, metres.
    pub vehicle_length_m: f64,
    /// Width of the vehicle as drawn, metres.
    pub vehicle_width_m: f64,
    /// Height of the vehicle as drawn, without its mast, metres.
    pub vehicle_height_m: f64,
    /// Height of the vehicle's origin above the ground it stands on, metres.
    pub vehicle_origin_m: f64,
    /// The process `jaus`: the sensor as its JAUS peers see it.
    pub jaus: crate::jaus::Config,
    /// ROS 2, a process of its own.
    pub ros2: crate::ros2::Config,
    /// Foxglove and Lichtblick, a process of its own.
    pub foxglove: crate::foxglove::Config,
    /// Control stations, a process of its own.
    pub fleet: crate::fleet::Config,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            enabled: true,
            listen: "127.0.0.1:8151".into(),
            allowed_hosts: Vec::new(),
            allowed_origins: Vec::new(),
            max_clients: 8,
            update_hz: 10.0,
            vehicle_length_m: 3.2,
            vehicle_width_m: 1.7,
            vehicle_height_m: 1.1,
            vehicle_origin_m: 0.0,
            jaus: crate::jaus::Config::default(),
            ros2: crate::ros2::Config::default(),
            foxglove: crate::foxglove::Config::default(),
            fleet: crate::fleet::Config::default(),
        }
    }
}

impl Config {
    /// All faults.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        check.address("listen", &self.listen, "127.0.0.1:8151");
        allowed::check(&mut check, &self.allowed_hosts, &self.allowed_origins, "https://fleet.example:8443");
        check.count("max_clients", self.max_clients, 1, 64, "");
        check.range("update_hz", self.update_hz, 0.5, 60.0, "Hz");
        check.range("vehicle_length_m", self.vehicle_length_m, 0.2, 20.0, "m");
        check.range("vehicle_width_m", self.vehicle_width_m, 0.2, 10.0, "m");
        check.range("vehicle_height_m", self.vehicle_height_m, 0.1, 10.0, "m");
        check.range("vehicle_origin_m", self.vehicle_origin_m, -1.0, 10.0, "m");
        check.extend(self.jaus.validate());
        check.extend(self.ros2.validate());
        check.extend(self.foxglove.validate());
        check.extend(self.fleet.validate());
        check.into_faults()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_without_fault() {
        assert_eq!(Config::default().validate(), []);
    }

    #[test]
    fn all_faults_are_listed() {
        let config = Config {
            listen: "localhost".into(),
            allowed_hosts: vec!["http://x".into()],
            allowed_origins: vec!["https://ok:1".into(), "*".into(), "https://x/".into()],
            max_clients: 0,
            update_hz: f64::NAN,
            ..Config::default()
        };
        let keys: Vec<_> = config.validate().into_iter().map(|f| f.key).collect();
        assert_eq!(keys, ["listen", "allowed_hosts", "allowed_origins", "allowed_origins", "max_clients", "update_hz"]);
    }
}
