//! Packets that wait for their acknowledgement, and are sent again until it comes or patience ends.

use crate::id::Id;
use std::net::SocketAddr;
use tsense_geometry::Timestamp;

/// Packets that wait at a time; each is at most one datagram, so this is a quarter of a megabyte.
const WAITING_MAX: usize = 64;
/// Times a packet is sent, and the wait between: what JuniorRTE does.
const ATTEMPTS: u32 = 3;
const WAIT_S: f64 = 0.1;

struct Waiting {
    source: Id,
    destination: Id,
    sequence: u16,
    to: SocketAddr,
    datagram: Vec<u8>,
    attempts_left: u32,
    again_at: Timestamp,
}

/// All packets that wait.
#[derive(Default)]
pub(super) struct Pending {
    waiting: Vec<Waiting>,
    given_up: u64,
}

impl Pending {
    pub(super) fn has_room(&self, packets: usize) -> bool {
        self.waiting.len() + packets <= WAITING_MAX
    }

    /// A packet was sent for the first time.
    pub(super) fn sent(&mut self, ids: (Id, Id), sequence: u16, to: SocketAddr, datagram: &[u8], now: Timestamp) {
        self.waiting.push(Waiting {
            source: ids.0,
            destination: ids.1,
            sequence,
            to,
            datagram: datagram.to_vec(),
            attempts_left: ATTEMPTS - 1,
            again_at: now.plus_seconds(WAIT_S),
        });
    }

    /// An acknowledgement from `peer` to `own`: true where something waited for it.
    pub(super) fn acknowledged(&mut self, own: Id, peer: Id, sequence: u16) -> bool {
        let before = self.waiting.len();
        self.waiting.retain(|w| (w.source, w.destination, w.sequence) != (own, peer, sequence));
        self.waiting.len() != before
    }

    /// The peer says that a packet did not arrive well: it is due at once.
    pub(super) fn refused(&mut self, own: Id, peer: Id, sequence: u16, now: Timestamp) {
        for w in &mut self.waiting {
            if (w.source, w.destination, w.sequence) == (own, peer, sequence) {
                w.again_at = now;
            }
        }
    }

    /// What is to be sent again now.
    pub(super) fn due(&mut self, now: Timestamp) -> Vec<(SocketAddr, Vec<u8>)> {
        let before = self.waiting.len();
        self.waiting.retain(|w| w.again_at > now || w.attempts_left > 0);
        self.given_up += (before - self.waiting.len()) as u64;
        let due = self.waiting.iter_mut().filter(|w| w.again_at <= now);
        due.map(|w| {
            w.attempts_left -= 1;
            w.again_at = now.plus_seconds(WAIT_S);
            (w.to, w.datagram.clone())
        })
        .collect()
    }

    /// Packets that nobody acknowledged, since this was asked last.
    pub(super) fn take_given_up(&mut self) -> u64 {
        std::mem::take(&mut self.given_up)
    }
}
