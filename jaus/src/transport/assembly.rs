//! Messages that come in parts: kept until whole, within bounds of number, size and time.
//!
//! Parts of one message have consecutive sequence numbers; they may come in any order. Each pair of source and
//! destination has one unfinished message at a time.

use crate::id::Id;
use crate::judp::{Packet, Part};
use std::collections::BTreeMap;
use tsense_geometry::Timestamp;

/// Unfinished messages at a time.
const UNFINISHED_MAX: usize = 16;
/// Longest message that is put together: what we receive is commands, queries, poses and configurations of peers.
const MESSAGE_BYTES_MAX: usize = 64 * 1024;
/// Parts of one message: as many as the longest needs when its parts are small.
const PARTS_MAX: usize = 256;
/// How long the next part may take, seconds.
const PATIENCE_S: f64 = 2.0;

struct Unfinished {
    touched: Timestamp,
    /// Parts by their distance from the first one that came.
    parts: BTreeMap<i16, (Part, Vec<u8>)>,
    anchor: u16,
    bytes: usize,
}

/// All unfinished messages.
#[derive(Default)]
pub(super) struct Assembly {
    unfinished: BTreeMap<(Id, Id), Unfinished>,
    given_up: u64,
}

impl Assembly {
    /// Takes a part; the body once it is whole.
    pub(super) fn take(&mut self, packet: &Packet<'_>, now: Timestamp) -> Result<Option<Vec<u8>>, &'static str> {
        self.tick(now);
        let key = (packet.source, packet.destination);
        if packet.part == Part::First && self.unfinished.get(&key).is_some_and(Unfinished::has_first) {
            // A new message begins: the old one will never be whole.
            self.unfinished.remove(&key);
            self.given_up += 1;
        }
        if !self.unfinished.contains_key(&key) && self.unfinished.len() >= UNFINISHED_MAX {
            return Err("too many unfinished messages");
        }
        let new = || Unfinished { touched: now, parts: BTreeMap::new(), anchor: packet.sequence, bytes: 0 };
        let message = self.unfinished.entry(key).or_insert_with(new);
        if message.bytes + packet.body.len() > MESSAGE_BYTES_MAX || message.parts.len() >= PARTS_MAX {
            self.unfinished.remove(&key);
            return Err("message in parts too long");
        }
        message.add(packet, now);
        if !message.is_whole() {
            return Ok(None);
        }
        Ok(self.unfinished.remove(&key).map(Unfinished::body))
    }

    /// Forgets what waited too long.
    pub(super) fn tick(&mut self, now: Timestamp) {
        let before = self.unfinished.len();
        self.unfinished.retain(|_, message| now.seconds_since(message.touched) <= PATIENCE_S);
        self.given_up += (before - self.unfinished.len()) as u64;
    }

    /// Messages that never became whole, since this was asked last.
    pub(super) fn take_given_up(&mut self) -> u64 {
        std::mem::take(&mut self.given_up)
    }

    /// Bytes kept.
    pub(super) fn bytes(&self) -> usize {
        self.unfinished.values().map(|message| message.bytes).sum()
    }
}

impl Unfinished {
    fn add(&mut self, packet: &Packet<'_>, now: Timestamp) {
        self.touched = now;
        let distance = packet.sequence.wrapping_sub(self.anchor) as i16;
        self.bytes += packet.body.len();
        if let Some((_, old)) = self.parts.insert(distance, (packet.part, packet.body.to_vec())) {
            self.bytes -= old.len();
        }
    }

    fn has_first(&self) -> bool {
        self.parts.values().any(|(part, _)| *part == Part::First)
    }

    fn is_whole(&self) -> bool {
        let (Some((first, (head, _))), Some((last, (tail, _)))) =
            (self.parts.first_key_value(), self.parts.last_key_value())
        else {
            return false;
        };
        let between = self.parts.len() as i32 == i32::from(*last) - i32::from(*first) + 1;
        between && *head == Part::First && *tail == Part::Last
    }

    fn body(self) -> Vec<u8> {
        self.parts.into_values().flat_map(|(_, bytes)| bytes).collect()
    }
}
