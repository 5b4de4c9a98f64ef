//! The transport of AS5669A as a state machine: who is where, parts, acknowledgements, repetitions.
//!
//! In: datagrams with their source and instant, messages to send, the time. Out: messages for our components, datagrams
//! with their destination, drops by cause. A datagram that is refused changes nothing but a counter; everything kept
//! is bounded, and nothing waits for a peer.

mod assembly;
mod network;
mod peers;
mod pending;
#[cfg(test)]
mod tests;

pub use network::Network;

use crate::id::Id;
use crate::judp::{self, Ack, BODY_MAX, Broadcast, Packet, Part, Priority};
use assembly::Assembly;
use peers::Peers;
use pending::Pending;
use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;
use tsense_geometry::Timestamp;

/// Bytes that wait to be sent, at most: a cost map, a smart sensor grid and scans for a dozen peers at once.
const OUT_BYTES_MAX: usize = 4 << 20;
/// Messages that wait for our components at most; they are taken after every datagram.
const IN_MESSAGES_MAX: usize = 256;

/// Who we are and with whom we talk.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Our components.
    pub own: Vec<Id>,
    /// Whose datagrams are read.
    pub allowed: Vec<Network>,
    /// The multicast group, where multicast is used.
    pub group: Option<SocketAddr>,
    /// Addresses that are sent what is meant for everybody: peers out of reach of multicast.
    pub contacts: Vec<SocketAddr>,
    /// Where our sequence numbers begin: after a restart they should not repeat those from before.
    pub first_sequence: u16,
}

/// A message to be sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Envelope {
    /// Which of our components sends it.
    pub source: Id,
    /// To whom; wildcards make it a broadcast.
    pub destination: Id,
    /// Whether it is repeated until acknowledged.
    pub acknowledged: bool,
    /// Message code and fields.
    pub body: Vec<u8>,
}

/// A message for our components.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// Who sent it.
    pub source: Id,
    /// To whom, maybe with wildcards.
    pub destination: Id,
    /// Message code and fields.
    pub body: Vec<u8>,
}

/// The transport.
pub struct Transport {
    options: Options,
    sequences: BTreeMap<Id, u16>,
    peers: Peers,
    assembly: Assembly,
    pending: Pending,
    incoming: VecDeque<Received>,
    outgoing: VecDeque<(SocketAddr, Vec<u8>)>,
    outgoing_bytes: usize,
    drops: BTreeMap<&'static str, u64>,
}

impl Transport {
    /// A transport that knows nobody.
    pub fn new(options: Options) -> Self {
        Self {
            options,
            sequences: BTreeMap::new(),
            peers: Peers::default(),
            assembly: Assembly::default(),
            pending: Pending::default(),
            incoming: VecDeque::new(),
            outgoing: VecDeque::new(),
            outgoing_bytes: 0,
            drops: BTreeMap::new(),
        }
    }

    /// Takes a datagram.
    pub fn receive(&mut self, now: Timestamp, from: SocketAddr, datagram: &[u8]) {
        if !self.options.allowed.iter().any(|network| network.contains(from.ip())) {
            return self.dropped("peer not allowed", 1);
        }
        match judp::parse(datagram) {
            Err(fault) => self.dropped(fault.as_str(), 1),
            Ok(packets) => {
                for packet in &packets {
                    if let Err(cause) = self.take(now, from, packet) {
                        self.dropped(cause, 1);
                    }
                }
            }
        }
        self.count_given_up();
    }

    fn take(&mut self, now: Timestamp, from: SocketAddr, packet: &Packet<'_>) -> Result<(), &'static str> {
        let Packet { source, destination, sequence, .. } = *packet;
        if !source.is_one() {
            return Err("impossible source id");
        }
        if self.options.own.contains(&source) {
            return Err("our own id from elsewhere");
        }
        if !self.options.own.iter().any(|own| destination.reaches(*own)) {
            return Err("not for us");
        }
        self.peers.hear(source, from, now)?;
        match packet.ack {
            Ack::Positive if self.pending.acknowledged(destination, source, sequence) => return Ok(()),
            Ack::Positive => return Err("acknowledgement of nothing"),
            Ack::Negative => {
                self.pending.refused(destination, source, sequence, now);
                return Ok(());
            }
            Ack::None | Ack::Wanted => {}
        }
        if self.peers.is_repeated(source, destination, sequence, now) {
            // Our acknowledgement may be what got lost.
            self.acknowledge(from, packet);
            return Err("repeated packet");
        }
        let whole = match packet.part {
            Part::Whole => Some(packet.body.to_vec()),
            _ => self.assembly.take(packet, now)?,
        };
        if let Some(body) = whole {
            self.deliver(Received { source, destination, body })?;
        }
        self.peers.took(source, destination, sequence, now);
        self.acknowledge(from, packet);
        Ok(())
    }

    fn deliver(&mut self, message: Received) -> Result<(), &'static str> {
        if message.body.len() < 2 {
            return Err("message without a code");
        }
        if self.incoming.len() >= IN_MESSAGES_MAX {
            return Err("too many messages at once");
        }
        self.incoming.push_back(message);
        Ok(())
    }

    /// Answers for the one component that was named; a broadcast would be answered by everybody at once.
    fn acknowledge(&mut self, to: SocketAddr, packet: &Packet<'_>) {
        if packet.ack != Ack::Wanted || !self.options.own.contains(&packet.destination) {
            return;
        }
        let ack = Packet {
            ack: Ack::Positive,
            broadcast: Broadcast::None,
            part: Part::Whole,
            destination: packet.source,
            source: packet.destination,
            body: &[],
            ..*packet
        };
        if !self.push(to, ack.datagram()) {
            self.dropped("send queue full", 1);
        }
    }

    /// Sends a message. It is sent whole or, where there is no room or no way, not at all.
    pub fn send(&mut self, now: Timestamp, envelope: &Envelope) {
        let known = self.peers.address(envelope.destination);
        let everybody = || self.options.group.into_iter().chain(self.options.contacts.iter().copied()).collect();
        let to: Vec<SocketAddr> = known.map_or_else(everybody, |address| vec![address]);
        // Who must be looked for is asked for a sign; a wildcard is looked for in vain.
        let acknowledged = envelope.destination.is_one() && (envelope.acknowledged || known.is_none());
        let packets = envelope.body.len().div_ceil(BODY_MAX);
        let bytes = (envelope.body.len() + packets * 15) * to.len();
        if to.is_empty() || (known.is_none() && packets > 1) {
            return self.dropped("address unknown", 1);
        }
        if self.outgoing_bytes + bytes > OUT_BYTES_MAX {
            return self.dropped("send queue full", 1);
        }
        if acknowledged && !self.pending.has_room(packets * to.len()) {
            return self.dropped("too many unacknowledged", 1);
        }
        let broadcast = if known.is_none() { Broadcast::Global } else { Broadcast::None };
        let ack = if acknowledged { Ack::Wanted } else { Ack::None };
        for (i, body) in envelope.body.chunks(BODY_MAX).enumerate() {
            let packet = Packet {
                priority: Priority::Standard,
                broadcast,
                ack,
                part: part_of(i, packets),
                destination: envelope.destination,
                source: envelope.source,
                body,
                sequence: self.next_sequence(envelope.source),
            };
            self.send_packet(now, &packet, &to);
        }
    }

    fn send_packet(&mut self, now: Timestamp, packet: &Packet<'_>, to: &[SocketAddr]) {
        let datagram = packet.datagram();
        for address in to {
            if packet.ack == Ack::Wanted {
                self.pending.sent((packet.source, packet.destination), packet.sequence, *address, &datagram, now);
            }
            self.push(*address, datagram.clone());
        }
    }

    fn next_sequence(&mut self, source: Id) -> u16 {
        let next = self.sequences.entry(source).or_insert(self.options.first_sequence);
        std::mem::replace(next, next.wrapping_add(1))
    }

    fn push(&mut self, to: SocketAddr, datagram: Vec<u8>) -> bool {
        let room = self.outgoing_bytes + datagram.len() <= OUT_BYTES_MAX;
        if room {
            self.outgoing_bytes += datagram.len();
            self.outgoing.push_back((to, datagram));
        }
        room
    }

    /// Repeats what was not acknowledged and forgets what waited too long; call it a few times a second, at least.
    pub fn tick(&mut self, now: Timestamp) {
        for (to, datagram) in self.pending.due(now) {
            if !self.push(to, datagram) {
                self.dropped("send queue full", 1);
            }
        }
        self.assembly.tick(now);
        self.count_given_up();
    }

    fn count_given_up(&mut self) {
        for (cause, count) in [
            ("message never whole", self.assembly.take_given_up()),
            ("never acknowledged", self.pending.take_given_up()),
        ] {
            self.dropped(cause, count);
        }
    }

    /// The next message for our components.
    pub fn next_message(&mut self) -> Option<Received> {
        self.incoming.pop_front()
    }

    /// The next datagram and where it goes.
    pub fn next_datagram(&mut self) -> Option<(SocketAddr, Vec<u8>)> {
        let (to, datagram) = self.outgoing.pop_front()?;
        self.outgoing_bytes -= datagram.len();
        Some((to, datagram))
    }

    /// Whether there are ways to everybody: a group or contacts.
    pub fn can_broadcast(&self) -> bool {
        self.options.group.is_some() || !self.options.contacts.is_empty()
    }

    /// Peers whose address is known.
    pub fn peers(&self) -> usize {
        self.peers.len()
    }

    /// Bytes kept for others: unfinished messages and what waits to be sent.
    pub fn kept_bytes(&self) -> usize {
        self.assembly.bytes() + self.outgoing_bytes
    }

    /// Counts something that was thrown away.
    pub fn dropped(&mut self, cause: &'static str, count: u64) {
        if count > 0 {
            *self.drops.entry(cause).or_default() += count;
        }
    }

    /// What was thrown away so far, by cause.
    pub fn drops(&self) -> &BTreeMap<&'static str, u64> {
        &self.drops
    }
}

fn part_of(index: usize, count: usize) -> Part {
    match (index, count) {
        (_, 1) => Part::Whole,
        (0, _) => Part::First,
        (i, n) if i + 1 == n => Part::Last,
        _ => Part::Middle,
    }
}
