//! Where each peer lives, learnt from what it sends, and which of its packets came before.
//!
//! An id belongs to the first address that used it, until that has been silent for [`HOLD_S`]: a datagram that claims
//! the id from elsewhere changes nothing.

use crate::id::Id;
use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;
use tsense_geometry::Timestamp;

/// Most peers at a time: a few vehicles and consoles with some components each.
pub(super) const PEERS_MAX: usize = 64;
/// Silence after which an id may move to another address, seconds.
const HOLD_S: f64 = 10.0;
/// Packets of one peer that are remembered, and for how long: what JuniorRTE remembers.
const RECENT_MAX: usize = 50;
const RECENT_S: f64 = 3.0;

struct Peer {
    address: SocketAddr,
    heard: Timestamp,
    recent: VecDeque<(Timestamp, Id, u16)>,
}

/// All peers.
#[derive(Default)]
pub(super) struct Peers {
    known: BTreeMap<Id, Peer>,
}

impl Peers {
    /// Takes note that `id` spoke from `address`.
    pub(super) fn hear(&mut self, id: Id, address: SocketAddr, now: Timestamp) -> Result<(), &'static str> {
        if let Some(peer) = self.known.get_mut(&id) {
            if peer.address != address && now.seconds_since(peer.heard) < HOLD_S {
                return Err("id of another address");
            }
            (peer.address, peer.heard) = (address, now);
            return Ok(());
        }
        if self.known.len() >= PEERS_MAX {
            let silent = |peer: &Peer| now.seconds_since(peer.heard) >= HOLD_S;
            let oldest = self.known.iter().filter(|(_, p)| silent(p)).min_by_key(|(_, p)| p.heard).map(|(id, _)| *id);
            self.known.remove(&oldest.ok_or("too many peers")?);
        }
        self.known.insert(id, Peer { address, heard: now, recent: VecDeque::new() });
        Ok(())
    }

    /// Whether this packet came before.
    pub(super) fn is_repeated(&mut self, source: Id, destination: Id, sequence: u16, now: Timestamp) -> bool {
        let Some(peer) = self.known.get_mut(&source) else { return false };
        while peer.recent.front().is_some_and(|(at, ..)| now.seconds_since(*at) > RECENT_S) {
            peer.recent.pop_front();
        }
        peer.recent.iter().any(|(_, to, number)| (*to, *number) == (destination, sequence))
    }

    /// Takes note of a packet that was taken.
    pub(super) fn took(&mut self, source: Id, destination: Id, sequence: u16, now: Timestamp) {
        let Some(peer) = self.known.get_mut(&source) else { return };
        if peer.recent.len() >= RECENT_MAX {
            peer.recent.pop_front();
        }
        peer.recent.push_back((now, destination, sequence));
    }

    pub(super) fn address(&self, id: Id) -> Option<SocketAddr> {
        self.known.get(&id).map(|peer| peer.address)
    }

    pub(super) fn len(&self) -> usize {
        self.known.len()
    }
}
