//! Section `[bridge.jaus]` of the configuration.

use serde::{Deserialize, Serialize};
use std::net::{Ipv4Addr, SocketAddr};
use tsense_contract::{Checks, Fault};
use tsense_jaus::message::cost_map::{QueryCostMap2D, ReportCostMap2D};
use tsense_jaus::message::objects::{QueryVectorObjects, ReportVectorObjects};
use tsense_jaus::transport::Network;
use tsense_jaus::{Id, Message, judp};

/// As what the sensor answers when somebody asks who is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As a subsystem of its own, its node and its components.
    #[default]
    Subsystem,
    /// As a node of a subsystem that somebody else speaks for.
    Node,
    /// As components of a node that somebody else speaks for.
    Component,
}

/// Values of the experimental grid's traversability layer, 0 to 15.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GridValues {
    /// Nothing is known.
    pub unknown: u8,
    /// Must not be driven.
    pub impassable: u8,
    /// Costs nothing.
    pub free: u8,
    /// Costs as much as a cell can that may be driven.
    pub worst: u8,
}

impl Default for GridValues {
    fn default() -> Self {
        Self { unknown: 14, impassable: 2, free: 12, worst: 3 }
    }
}

/// Whom the sensor serves over JAUS, as whom, and what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Whether there is a process `jaus` at all. Without it no socket is opened.
    pub enabled: bool,
    /// Address and port of the UDP socket. Anything but loopback opens the sensor to the network.
    pub listen: String,
    /// Whose datagrams are read: addresses and networks. All others are counted and thrown away.
    pub peers: Vec<String>,
    /// Addresses and ports that are told at the start that the sensor is there: peers out of reach of multicast.
    pub contacts: Vec<String>,
    /// Whether to join the multicast group, and to ask it for peers whose address is unknown.
    pub multicast: bool,
    /// The multicast group.
    pub multicast_group: String,
    /// Networks that a multicast may cross.
    pub multicast_ttl: u32,
    /// Number of the subsystem, 1 to 65534.
    pub subsystem: u16,
    /// Number of the node, 1 to 254.
    pub node: u8,
    /// Number of the component that serves traversability, scans, and what is experimental, 1 to 254.
    pub component: u8,
    /// Number of the component that serves brush heights as a cost map, 1 to 254.
    pub brush_component: u8,
    /// The name given to whoever asks.
    pub name: String,
    /// As what the sensor answers when somebody asks who is there: `subsystem`, `node` or `component`.
    pub level: Level,
    /// Whether a peer may take control and send management commands. They change what is served, never what is sensed.
    pub allow_control: bool,
    /// Least authority that may take control.
    pub authority: u8,
    /// Control ends without a new request after this, seconds; 0 never.
    pub control_timeout_s: u8,
    /// Highest rate of an event, hertz.
    pub event_rate_max_hz: f64,
    /// Events end that nobody keeps for this long, minutes; 0 never.
    pub event_timeout_min: u8,
    /// Height of brush that one unit of cost stands for, metres: 254 units are the highest.
    pub brush_step_m: f64,
    /// Largest difference between a cost map's extent and the steps of 0.153 m it is sent in, metres; a map is made
    /// smaller until it fits. 0.08 takes every map as it is.
    pub extent_error_max_m: f64,
    /// Whether objects (Vector Knowledge Store of RA 3.x) and the Smart Sensor Grid are served: EXPERIMENTAL messages.
    pub experimental: bool,
    /// Code of the experimental query for objects: that of RA 3.x (2A23h), or one of the user's own.
    pub objects_query_code: u16,
    /// Code of the experimental report of objects: that of RA 3.x (4A23h), or one of the user's own.
    pub objects_report_code: u16,
    /// Code of the experimental query for the Smart Sensor Grid.
    pub grid_query_code: u16,
    /// Code of the experimental report of the Smart Sensor Grid.
    pub grid_report_code: u16,
    /// Values of the experimental grid's traversability layer.
    pub grid_values: GridValues,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            enabled: false,
            listen: format!("127.0.0.1:{}", judp::PORT),
            peers: vec!["127.0.0.1".into()],
            contacts: Vec::new(),
            multicast: false,
            multicast_group: judp::GROUP.to_string(),
            multicast_ttl: 16,
            subsystem: 1,
            node: 1,
            component: 20,
            brush_component: 21,
            name: "terrain smart sensor".into(),
            level: Level::Subsystem,
            allow_control: false,
            authority: 0,
            control_timeout_s: 5,
            event_rate_max_hz: 25.0,
            event_timeout_min: 1,
            brush_step_m: 0.02,
            extent_error_max_m: 0.08,
            experimental: false,
            objects_query_code: QueryVectorObjects::CODE,
            objects_report_code: ReportVectorObjects::CODE,
            grid_query_code: 0xD800,
            grid_report_code: 0xD801,
            grid_values: GridValues::default(),
        }
    }
}

impl Config {
    /// The component that serves most.
    pub fn main_id(&self) -> Id {
        Id::new(self.subsystem, self.node, self.component)
    }

    /// The component that serves brush heights.
    pub fn brush_id(&self) -> Id {
        Id::new(self.subsystem, self.node, self.brush_component)
    }

    /// Where the socket is bound.
    pub fn address(&self) -> Option<SocketAddr> {
        self.listen.parse().ok()
    }

    /// The multicast group, where one is used.
    pub fn group(&self) -> Option<Ipv4Addr> {
        self.multicast_group.parse().ok().filter(|group: &Ipv4Addr| self.multicast && group.is_multicast())
    }

    /// All faults; keys as the section `[bridge]` sees them.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::below("jaus");
        self.check_addresses(&mut check);
        check.range("subsystem", self.subsystem, 1.0, 65_534.0, "");
        check.range("node", self.node, 1.0, 254.0, "");
        check.range("component", self.component, 1.0, 254.0, "");
        check.range("brush_component", self.brush_component, 1.0, 254.0, "");
        check.range("event_rate_max_hz", self.event_rate_max_hz, 0.1, 100.0, "Hz");
        check.range("brush_step_m", self.brush_step_m, 0.001, 1.0, "m");
        check.range("extent_error_max_m", self.extent_error_max_m, 0.005, 1.0, "m");
        self.check_codes(&mut check);
        let values = &self.grid_values;
        for (key, value) in [
            ("unknown", values.unknown),
            ("impassable", values.impassable),
            ("free", values.free),
            ("worst", values.worst),
        ] {
            check.range(&format!("grid_values.{key}"), value, 0.0, 15.0, "");
        }
        let differ = self.component != self.brush_component;
        check.require(differ, "brush_component", self.brush_component, "another number than component");
        let fits = (1..=255).contains(&self.name.len());
        check.require(fits, "name", &self.name, "1 to 255 bytes");
        check.into_faults()
    }

    /// Codes of experimental messages: those that the standard leaves to users, each once.
    fn check_codes(&self, check: &mut Checks) {
        let mut taken = Vec::new();
        for (key, code, usual) in [
            ("objects_query_code", self.objects_query_code, Some(QueryVectorObjects::CODE)),
            ("objects_report_code", self.objects_report_code, Some(ReportVectorObjects::CODE)),
            ("grid_query_code", self.grid_query_code, None),
            ("grid_report_code", self.grid_report_code, None),
        ] {
            let is_free = code >= 0xD000 && ![QueryCostMap2D::CODE, ReportCostMap2D::CODE].contains(&code);
            let allowed = "53248 to 65535 (D000h to FFFFh), none of the cost map's, each once";
            check.require((is_free || usual == Some(code)) && !taken.contains(&code), key, code, allowed);
            taken.push(code);
        }
    }

    fn check_addresses(&self, check: &mut Checks) {
        let address = self.address();
        check.require(address.is_some(), "listen", &self.listen, "an address and a port: 127.0.0.1:3794");
        for peer in &self.peers {
            let allowed = "an address or a network: 192.168.1.7, 192.168.1.0/24";
            check.require(peer.parse::<Network>().is_ok(), "peers", peer, allowed);
        }
        for contact in &self.contacts {
            check.address("contacts", contact, "192.168.1.7:3794");
        }
        let is_group = self.multicast_group.parse().is_ok_and(|group: Ipv4Addr| group.is_multicast());
        check.require(is_group, "multicast_group", &self.multicast_group, "a multicast address: 239.255.0.1");
        let fits = !self.multicast || address.is_some_and(|address| address.is_ipv4());
        check.require(fits, "multicast", self.multicast, "false where listen is no IPv4 address");
        check.range("multicast_ttl", self.multicast_ttl, 0.0, 255.0, "");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_without_fault_and_open_nothing() {
        let config = Config::default();
        assert_eq!(config.validate(), []);
        assert!(!config.enabled && !config.allow_control && !config.multicast && !config.experimental);
        assert!(config.address().unwrap().ip().is_loopback());
    }

    #[test]
    fn all_faults_are_listed() {
        let config = Config {
            listen: "localhost".into(),
            peers: vec!["10.0.0.0/40".into()],
            contacts: vec!["10.0.0.1".into()],
            multicast_group: "10.0.0.1".into(),
            node: 255,
            brush_component: 20,
            brush_step_m: 0.0,
            objects_query_code: 0x2A24,
            objects_report_code: 0xD742,
            grid_report_code: 0xD800,
            ..Config::default()
        };
        let keys: Vec<_> =
            config.validate().into_iter().map(|f| f.key.trim_start_matches("jaus.").to_owned()).collect();
        let expected = [
            "listen",
            "peers",
            "contacts",
            "multicast_group",
            "node",
            "brush_step_m",
            "objects_query_code",
            "objects_report_code",
            "grid_report_code",
            "brush_component",
        ];
        assert_eq!(keys, expected);
    }
}
