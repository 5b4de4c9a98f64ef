//! Section `[bridge.ros2]` of the configuration.

use serde::{Deserialize, Serialize};
use std::net::Ipv4Addr;
use tsense_contract::{Checks, Fault};

/// The ROS 2 process: off until enabled, on this machine alone until given other addresses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Whether the process `ros2` is started. While it is not, there is no socket.
    pub enabled: bool,
    /// What carries the messages.
    pub transport: Transport,
    /// The Zenoh router to connect to, where Zenoh is the transport.
    pub zenoh_endpoint: String,
    /// What ROS calls `ROS_DOMAIN_ID`.
    pub domain_id: u16,
    /// Addresses of this machine's interfaces to use for DDS. Loopback alone binds every socket to the loopback device.
    pub addresses: Vec<Ipv4Addr>,
    /// Put before topic names that do not begin with a slash.
    pub namespace: String,
    /// UTM easting, northing and ellipsoidal height of the origin of the frame `map`, metres. All zero: the first pose,
    /// down to whole metres, so that it differs from run to run.
    pub map_origin_m: [f64; 3],
    /// Most points of the cloud of voxels; of more, every n-th is sent and the rest counted.
    pub cloud_points_max: usize,
    /// Names of the frames.
    pub frames: Frames,
    /// What is published, and how.
    pub topics: Topics,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            enabled: false,
            transport: Transport::Dds,
            zenoh_endpoint: "tcp/127.0.0.1:7447".into(),
            domain_id: 0,
            addresses: vec![Ipv4Addr::LOCALHOST],
            namespace: "/tsense".into(),
            map_origin_m: [0.0; 3],
            // 0.8 MB: with one in the queue and one in the transport's history well below the 8 MB a bridge may cost.
            cloud_points_max: 50_000,
            frames: Frames::default(),
            topics: Topics::default(),
        }
    }
}

/// What carries the messages; the bytes are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transport {
    /// DDS, which every stock ROS 2 understands.
    Dds,
    /// Zenoh, for a ROS 2 whose middleware is rmw_zenoh.
    Zenoh,
}

/// Names of the frames, REP-105 where it has one. A ladar's frame is its name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Frames {
    /// The UTM zone's own origin; parent of `map`.
    pub utm: String,
    /// Fixed to the ground near the vehicle, x east, y north, z up.
    pub map: String,
    /// Fixed to the ground, without the jumps of the position system.
    pub odom: String,
    /// The vehicle, x forward, y left, z up, where the position system reports.
    pub base: String,
    /// The pan-tilt unit's base.
    pub ptu_base: String,
    /// The part that pans.
    pub ptu_pan: String,
    /// The part that tilts, which carries the ladar.
    pub ptu_tilt: String,
}

impl Default for Frames {
    fn default() -> Self {
        Self {
            utm: "utm".into(),
            map: "map".into(),
            odom: "odom".into(),
            base: "base_link".into(),
            ptu_base: "ptu_base".into(),
            ptu_pan: "ptu_pan".into(),
            ptu_tilt: "ptu_tilt".into(),
        }
    }
}

/// One topic.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TopicConfig {
    /// Its name; without a slash in front the namespace is put there.
    pub name: String,
    /// Most messages a second; 0 publishes nothing, and nothing is read for it.
    pub hz: f64,
    /// Reliable, or else best effort. A subscriber that asks for more than is offered hears nothing.
    pub reliable: bool,
    /// Whether who joins late gets the newest message.
    pub transient_local: bool,
    /// Messages kept for a slow subscriber, and in our own queue; the oldest go first.
    pub depth: usize,
}

/// What the text says of a topic; the rest stays as it is by default.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct PartialTopic {
    name: Option<String>,
    hz: Option<f64>,
    reliable: Option<bool>,
    transient_local: Option<bool>,
    depth: Option<usize>,
}

impl PartialTopic {
    fn over(self, base: TopicConfig) -> TopicConfig {
        TopicConfig {
            name: self.name.unwrap_or(base.name),
            hz: self.hz.unwrap_or(base.hz),
            reliable: self.reliable.unwrap_or(base.reliable),
            transient_local: self.transient_local.unwrap_or(base.transient_local),
            depth: self.depth.unwrap_or(base.depth),
        }
    }
}

macro_rules! topics {
    ($($(#[$doc:meta])* $field:ident: $name:literal, $hz:literal Hz, $reliable:literal, $latched:literal, $depth:literal;)+) => {
        /// The topics.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(from = "PartialTopics")]
        pub struct Topics {
            $($(#[$doc])* pub $field: TopicConfig,)+
        }

        #[derive(Deserialize, Default)]
        #[serde(deny_unknown_fields, default)]
        struct PartialTopics {
            $($field: PartialTopic,)+
        }

        impl From<PartialTopics> for Topics {
            fn from(given: PartialTopics) -> Self {
                Self { $($field: given.$field.over(TopicConfig {
                    name: $name.into(),
                    hz: $hz,
                    reliable: $reliable,
                    transient_local: $latched,
                    depth: $depth,
                }),)+ }
            }
        }

        impl Topics {
            /// Each with its key.
            pub fn all(&self) -> Vec<(&'static str, &TopicConfig)> {
                vec![$((stringify!($field), &self.$field),)+]
            }
        }
    };
}

// Columns: name, rate, reliable, transient local, depth.
topics! {
    /// nav_msgs/OccupancyGrid: cost, for Nav2.
    traversability: "traversability", 5.0 Hz, true, true, 1;
    /// grid_map_msgs/GridMap: ground, its deviation, brush, traversability, trees.
    grid_map: "grid_map", 1.0 Hz, true, true, 1;
    /// sensor_msgs/LaserScan, one topic a ladar: its name follows.
    scan: "scan", 50.0 Hz, false, false, 5;
    /// sensor_msgs/PointCloud2: occupied voxels with class.
    voxels: "voxels", 2.0 Hz, true, false, 1;
    /// vision_msgs/Detection3DArray: what the knowledge store believes.
    objects: "objects", 5.0 Hz, true, true, 1;
    /// tf2_msgs/TFMessage: what moves.
    tf: "/tf", 50.0 Hz, true, false, 100;
    /// tf2_msgs/TFMessage: what does not.
    tf_static: "/tf_static", 0.2 Hz, true, true, 1;
    /// nav_msgs/Odometry.
    odometry: "odom", 50.0 Hz, true, false, 5;
    /// diagnostic_msgs/DiagnosticArray: every process.
    diagnostics: "/diagnostics", 1.0 Hz, true, false, 5;
}

impl Default for Topics {
    fn default() -> Self {
        PartialTopics::default().into()
    }
}

impl Config {
    /// All faults, with keys below `ros2`.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::below("ros2");
        // Above 232 the well-known ports leave the range of ports.
        check.range("domain_id", self.domain_id, 0.0, 232.0, "");
        check.require(!self.addresses.is_empty(), "addresses", "[]", "at least one address of this machine: 127.0.0.1");
        let router = self.zenoh_endpoint.strip_prefix("tcp/").and_then(|address| address.rsplit_once(':'));
        let is_router = router.is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
        let allowed = "a Zenoh router by TCP: tcp/127.0.0.1:7447";
        check.require(is_router, "zenoh_endpoint", &self.zenoh_endpoint, allowed);
        let is_namespace = self.namespace.is_empty() || is_absolute(&self.namespace);
        check.require(is_namespace, "namespace", &self.namespace, "empty, or a name like /tsense");
        let on_earth = self.map_origin_m.iter().all(|c| c.abs() <= tsense_geometry::COORDINATE_MAX_M);
        check.require(on_earth, "map_origin_m", format!("{:?}", self.map_origin_m), "three coordinates in metres");
        check.count("cloud_points_max", self.cloud_points_max, 100, 1_000_000, "points");
        for (key, name) in self.frames.all() {
            let allowed = "letters, digits, _ and /, no slash in front";
            check.require(is_relative(name), &format!("frames.{key}"), name, allowed);
        }
        for (key, topic) in self.topics.all() {
            let is_name = is_relative(&topic.name) || is_absolute(&topic.name);
            let allowed = "a ROS topic name: letters, digits, _ and /";
            check.require(is_name, &format!("topics.{key}.name"), &topic.name, allowed);
            check.range(&format!("topics.{key}.hz"), topic.hz, 0.0, 100.0, "Hz");
            check.count(&format!("topics.{key}.depth"), topic.depth, 1, 100, "");
        }
        check.into_faults()
    }

    /// A topic's name with its slash in front.
    pub fn absolute(&self, name: &str) -> String {
        if name.starts_with('/') { name.into() } else { format!("{}/{name}", self.namespace) }
    }
}

impl Frames {
    fn all(&self) -> [(&'static str, &str); 7] {
        [
            ("utm", &self.utm),
            ("map", &self.map),
            ("odom", &self.odom),
            ("base", &self.base),
            ("ptu_base", &self.ptu_base),
            ("ptu_pan", &self.ptu_pan),
            ("ptu_tilt", &self.ptu_tilt),
        ]
    }
}

/// Parts between slashes are of letters, digits and underscores and do not begin with a digit.
fn is_relative(name: &str) -> bool {
    name.split('/').all(|part| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    })
}

fn is_absolute(name: &str) -> bool {
    name.strip_prefix('/').is_some_and(is_relative)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_off_on_loopback_and_without_fault() {
        let config = Config::default();
        assert_eq!(config.validate(), []);
        assert!(!config.enabled && config.addresses.iter().all(Ipv4Addr::is_loopback));
    }

    #[test]
    fn what_is_not_said_of_a_topic_stays_as_it_is_for_that_topic() {
        let given: Config = serde_json::from_str(r#"{"topics": {"voxels": {"hz": 0.5}}}"#).unwrap();
        let expected = TopicConfig { hz: 0.5, ..Topics::default().voxels };
        assert_eq!(given.topics, Topics { voxels: expected, ..Topics::default() });
        assert!(serde_json::from_str::<Config>(r#"{"topics": {"voxels": {"rate": 1}}}"#).is_err());
        assert!(serde_json::from_str::<Config>(r#"{"topics": {"clouds": {}}}"#).is_err());
    }

    #[test]
    fn all_faults_are_listed() {
        let mut config = Config {
            domain_id: 233,
            zenoh_endpoint: "udp/127.0.0.1:7447".into(),
            addresses: vec![],
            namespace: "tsense".into(),
            map_origin_m: [f64::NAN, 0.0, 0.0],
            cloud_points_max: 0,
            ..Config::default()
        };
        config.frames.map = "/map".into();
        config.topics.tf.hz = f64::NAN;
        config.topics.scan.name = "scan-1".into();
        let keys: Vec<_> = config.validate().into_iter().map(|f| f.key).collect();
        let expected = "domain_id addresses zenoh_endpoint namespace map_origin_m cloud_points_max frames.map \
                        topics.scan.name topics.tf.hz";
        assert_eq!(keys, expected.split_whitespace().map(|k| format!("ros2.{k}")).collect::<Vec<_>>());
    }

    #[test]
    fn names_get_the_namespace_unless_they_are_absolute() {
        let config = Config::default();
        assert_eq!(config.absolute("voxels"), "/tsense/voxels");
        assert_eq!(config.absolute("/tf"), "/tf");
    }
}
