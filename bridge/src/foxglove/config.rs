//! Section `[bridge.foxglove]` of the configuration.

use crate::allowed;
use crate::ros2;
use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};

/// The Foxglove process: off until enabled, on this machine alone until given another address.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Whether the process `foxglove` is started. While it is not, there is no socket.
    pub enabled: bool,
    /// Address and port to connect to; port 0 takes any free one.
    pub listen: String,
    /// Host names, without port, under which it may be asked for besides this machine's loopback names.
    pub allowed_hosts: Vec<String>,
    /// Origins of web applications that may read the stream: `https://app.foxglove.dev`. Programs send none.
    pub allowed_origins: Vec<String>,
    /// Most clients at a time.
    pub max_clients: usize,
    /// Clouds of voxels, grids and lists of objects a second, at most, each.
    pub update_hz: f64,
    /// Transforms and scans a second, at most, each.
    pub motion_hz: f64,
    /// Most points of the cloud; of more, every n-th is sent.
    pub cloud_points_max: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            enabled: false,
            listen: "127.0.0.1:8765".into(),
            allowed_hosts: Vec::new(),
            allowed_origins: Vec::new(),
            max_clients: 4,
            update_hz: 2.0,
            motion_hz: 20.0,
            // 18 bytes a point and 32 messages waiting for a client that does not read: 7 MB.
            cloud_points_max: 12_000,
        }
    }
}

impl Config {
    /// All faults, with keys below `foxglove`.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::below("foxglove");
        check.address("listen", &self.listen, "127.0.0.1:8765");
        allowed::check(&mut check, &self.allowed_hosts, &self.allowed_origins, "https://app.foxglove.dev");
        check.count("max_clients", self.max_clients, 1, 64, "");
        check.range("update_hz", self.update_hz, 0.1, 10.0, "Hz");
        check.range("motion_hz", self.motion_hz, 0.1, 50.0, "Hz");
        check.count("cloud_points_max", self.cloud_points_max, 100, 1_000_000, "points");
        check.into_faults()
    }

    /// What the translator is asked for: frames and names as in ROS, where the same origin is configured.
    pub fn translator(&self, ros2: &ros2::Config) -> ros2::Config {
        let mut config = ros2::Config {
            cloud_points_max: self.cloud_points_max,
            frames: ros2.frames.clone(),
            map_origin_m: ros2.map_origin_m,
            ..ros2::Config::default()
        };
        let topics = &mut config.topics;
        for topic in [&mut topics.traversability, &mut topics.grid_map, &mut topics.voxels, &mut topics.objects] {
            topic.hz = self.update_hz;
        }
        for topic in [&mut topics.tf, &mut topics.scan] {
            topic.hz = self.motion_hz;
        }
        // The protocol repeats nothing for who joins late.
        topics.tf_static.hz = self.update_hz;
        for topic in [&mut topics.odometry, &mut topics.diagnostics] {
            topic.hz = 0.0;
        }
        config
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_off_on_loopback_and_without_fault() {
        let config = Config::default();
        assert_eq!(config.validate(), []);
        assert!(!config.enabled && config.listen.starts_with("127."));
        assert_eq!(config.translator(&ros2::Config::default()).validate(), []);
    }

    #[test]
    fn all_faults_are_listed() {
        let config = Config {
            listen: "8765".into(),
            allowed_hosts: vec!["http://x".into()],
            allowed_origins: vec!["*".into()],
            max_clients: 0,
            update_hz: f64::NAN,
            motion_hz: 0.0,
            cloud_points_max: 1,
            ..Config::default()
        };
        let keys: Vec<_> = config.validate().into_iter().map(|f| f.key).collect();
        let expected = "listen allowed_hosts allowed_origins max_clients update_hz motion_hz cloud_points_max";
        assert_eq!(keys, expected.split(' ').map(|k| format!("foxglove.{k}")).collect::<Vec<_>>());
    }
}
