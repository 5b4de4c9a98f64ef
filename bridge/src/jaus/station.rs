//! The sensor as its JAUS peers see it: transport, components and products in one state machine.
//!
//! In: datagrams, topics, the time. Out: datagrams, drops by cause. No socket, no clock; nothing waits for a peer.

use super::component::{Component, Surroundings};
use super::config::Config;
use super::cost_map::Layer;
use super::discovery::{self, Card};
use super::products::Products;
use super::rig::Rig;
use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use tsense_contract::{GridCell, GridHeader, Joint, Object, ObjectsHeader, Return, ScanHeader};
use tsense_geometry::Timestamp;
use tsense_jaus::message::core::ReportHeartbeatPulse;
use tsense_jaus::message::discovery::{NODE, QueryIdentification, RegisterServices, ReportIdentification, SUBSYSTEM};
use tsense_jaus::transport::Options;
use tsense_jaus::{Envelope, Id, Message, Received, Transport, code_of, judp};

/// Time between two questions who is there, until somebody answers, seconds: the standard's slowest.
const ASK_PERIOD_S: f64 = 5.0;
/// Time between two heartbeats, seconds.
const HEARTBEAT_PERIOD_S: f64 = 1.0;
/// Registries that are told of our services: the node's and the subsystem's, and some to spare.
const REGISTRIES_MAX: usize = 8;

/// The sensor as a JAUS subsystem, node or pair of components.
pub struct Station {
    config: Config,
    cards: [Card; 2],
    transport: Transport,
    components: [Component; 2],
    products: Products,
    answered: bool,
    registries: BTreeSet<Id>,
    ask_at: Timestamp,
    heartbeat_at: Timestamp,
    taken: u64,
}

impl Station {
    /// A station that knows nobody yet. `first_sequence` should differ from start to start.
    pub fn new(config: &Config, rig: &Rig, first_sequence: u16) -> Self {
        let options = Options {
            own: vec![config.main_id(), config.brush_id()],
            allowed: config.peers.iter().filter_map(|peer| peer.parse().ok()).collect(),
            group: config.group().map(|group| SocketAddr::from((group, judp::PORT))),
            contacts: config.contacts.iter().filter_map(|contact| contact.parse().ok()).collect(),
            first_sequence,
        };
        Self {
            config: config.clone(),
            cards: discovery::cards(config, rig.head.is_some()),
            transport: Transport::new(options),
            components: [
                Component::new(config.main_id(), Layer::Traversability, config),
                Component::new(config.brush_id(), Layer::Brush, config),
            ],
            products: Products::new(config, rig),
            answered: false,
            registries: BTreeSet::new(),
            ask_at: Timestamp::default(),
            heartbeat_at: Timestamp::default(),
            taken: 0,
        }
    }

    /// Takes a datagram.
    pub fn receive(&mut self, now: Timestamp, from: SocketAddr, datagram: &[u8]) {
        self.transport.receive(now, from, datagram);
        while let Some(message) = self.transport.next_message() {
            self.taken += 1;
            self.note_identification(now, &message);
            for index in 0..self.components.len() {
                if message.destination.reaches(self.components[index].id) {
                    self.give(now, index, &message);
                }
            }
        }
    }

    fn give(&mut self, now: Timestamp, index: usize, message: &Received) {
        let Self { config, cards, products, components, transport, .. } = self;
        let around = Surroundings { config, cards, products, now };
        let component = &mut components[index];
        match component.take(message.source, &message.body, around) {
            Ok(replies) => send(transport, now, component.id, replies),
            // Not every component has to understand what is said to all.
            Err("unsupported message") if !message.destination.is_one() => {}
            Err(cause) => transport.dropped(cause, 1),
        }
    }

    /// A discovery service of our own subsystem is told what we can do.
    fn note_identification(&mut self, now: Timestamp, message: &Received) {
        if code_of(&message.body) != Some(ReportIdentification::CODE) {
            return;
        }
        let Ok(who) = ReportIdentification::from_bytes(&message.body) else {
            return self.transport.dropped("malformed identification", 1);
        };
        self.answered = true;
        let ours = message.source.subsystem() == self.config.subsystem && matches!(who.kind, SUBSYSTEM | NODE);
        if !ours || self.registries.len() >= REGISTRIES_MAX || !self.registries.insert(message.source) {
            return;
        }
        for card in &self.cards {
            let body = RegisterServices { services: card.services.clone().into() }.to_bytes();
            let envelope = Envelope { source: card.id, destination: message.source, acknowledged: true, body };
            self.transport.send(now, &envelope);
        }
    }

    /// Sends what is due; call it a hundred times a second.
    pub fn tick(&mut self, now: Timestamp) {
        let Self { config, cards, products, components, transport, .. } = self;
        let around = Surroundings { config, cards, products, now };
        for component in components {
            let (replies, ended) = component.tick(around);
            send(transport, now, component.id, replies);
            transport.dropped("event not kept", ended);
        }
        self.ask_who_is_there(now);
        self.beat(now);
        self.transport.tick(now);
    }

    fn ask_who_is_there(&mut self, now: Timestamp) {
        if self.answered || now < self.ask_at || !self.transport.can_broadcast() {
            return;
        }
        self.ask_at = now.plus_seconds(ASK_PERIOD_S);
        let body = QueryIdentification { kind: SUBSYSTEM }.to_bytes();
        let source = self.config.main_id();
        self.transport.send(now, &Envelope { source, destination: Id::ALL, acknowledged: false, body });
    }

    fn beat(&mut self, now: Timestamp) {
        if now < self.heartbeat_at {
            return;
        }
        self.heartbeat_at = now.plus_seconds(HEARTBEAT_PERIOD_S);
        for component in &self.components {
            let pulse = |to| (to, ReportHeartbeatPulse {}.to_bytes());
            let pulses = component.listeners().into_iter().map(pulse).collect();
            send(&mut self.transport, now, component.id, pulses);
        }
    }

    /// A new grid.
    pub fn grid(&mut self, header: &GridHeader, cells: &[GridCell]) {
        let taken = self.products.take_grid(header, cells);
        self.count(taken);
    }

    /// New objects.
    pub fn objects(&mut self, header: &ObjectsHeader, objects: &[Object]) {
        let taken = self.products.take_objects(header, objects);
        self.count(taken);
    }

    /// A new scan of the ladar with this index in the configuration.
    pub fn scan(&mut self, ladar: usize, header: &ScanHeader, returns: &[Return]) {
        self.products.take_scan(ladar, header, returns);
    }

    /// New angles of the pan-tilt unit.
    pub fn joint(&mut self, joint: &Joint) {
        self.products.take_joint(joint);
    }

    fn count(&mut self, taken: Result<(), &'static str>) {
        if let Err(cause) = taken {
            self.transport.dropped(cause, 1);
        }
    }

    /// The next datagram and where it goes.
    pub fn next_datagram(&mut self) -> Option<(SocketAddr, Vec<u8>)> {
        self.transport.next_datagram()
    }

    /// Counts something that the shell threw away.
    pub fn dropped(&mut self, cause: &'static str, count: u64) {
        self.transport.dropped(cause, count);
    }

    /// What was thrown away so far, by cause.
    pub fn drops(&self) -> &BTreeMap<&'static str, u64> {
        self.transport.drops()
    }

    /// Messages taken in so far.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Bytes kept for others.
    pub fn kept_bytes(&self) -> usize {
        self.transport.kept_bytes()
    }

    /// How it stands, for people.
    pub fn words(&self) -> String {
        let events: usize = self.components.iter().map(Component::events).sum();
        let plural = |n: usize, word: &str| format!("{n} {word}{}", if n == 1 { "" } else { "s" });
        let controller = self.components.iter().find_map(Component::controller);
        let controller = controller.map_or(String::new(), |id| format!(", controlled by {id}"));
        format!("{}, {}{controller}", plural(self.transport.peers(), "peer"), plural(events, "event"))
    }
}

fn send(transport: &mut Transport, now: Timestamp, source: Id, replies: Vec<(Id, Vec<u8>)>) {
    for (destination, body) in replies {
        transport.send(now, &Envelope { source, destination, acknowledged: false, body });
    }
}

#[cfg(test)]
mod tests;
