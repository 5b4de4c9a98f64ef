//! Subsection `[gpos.jaus]`: used where the driver's `address` is `jaus`.

use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};
use tsense_jaus::Id;
use tsense_jaus::transport::Network;

/// Where a GlobalPoseSensor is looked for, and as whom.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Address and port of our UDP socket. Another than that of `[bridge.jaus]`: these are two processes.
    pub listen: String,
    /// Whose datagrams are read: addresses and networks.
    pub peers: Vec<String>,
    /// Addresses and ports where the sensor is looked for, where multicast does not reach it.
    pub contacts: Vec<String>,
    /// Whether it is looked for in the multicast group as well.
    pub multicast: bool,
    /// Our own id, subsystem.node.component.
    pub id: String,
    /// The sensor's id; empty takes the first that says it is a GlobalPoseSensor.
    pub sensor: String,
    /// Poses a second that are asked for.
    pub rate_hz: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            listen: "127.0.0.1:3795".into(),
            peers: vec!["127.0.0.1".into()],
            contacts: vec!["127.0.0.1:3794".into()],
            multicast: false,
            id: "1.1.40".into(),
            sensor: String::new(),
            rate_hz: 20.0,
        }
    }
}

impl Config {
    /// All faults; keys as the section `[gpos]` sees them.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::below("jaus");
        check.address("listen", &self.listen, "127.0.0.1:3795");
        for peer in &self.peers {
            let allowed = "an address or a network: 192.168.1.7, 192.168.1.0/24";
            check.require(peer.parse::<Network>().is_ok(), "peers", peer, allowed);
        }
        for contact in &self.contacts {
            check.address("contacts", contact, "192.168.1.7:3794");
        }
        let is_one = |text: &str| text.parse::<Id>().is_ok_and(Id::is_one);
        check.require(is_one(&self.id), "id", &self.id, "subsystem.node.component: 1.1.40");
        let is_sensor = self.sensor.is_empty() || is_one(&self.sensor);
        check.require(is_sensor, "sensor", &self.sensor, "empty, or subsystem.node.component: 1.1.30");
        check.range("rate_hz", self.rate_hz, 1.0, 200.0, "Hz");
        check.into_faults()
    }
}
