//! What became of an object, change by change, with the reason of each.
//!
//! In: changes of the store as it works. Out: events, to be written down with the objects. Kept in memory only until
//! then; the file keeps the newest of each object.

use crate::object::Known;
use crate::zone::Zone;
use std::collections::VecDeque;
use tsense_geometry::Timestamp;

/// Events that wait to be written, at most: 4 MB while the disk fails. The oldest go first and are counted.
const PENDING_MAX: usize = 50_000;

/// Why an object changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// It was seen for the first time.
    FirstSeen,
    /// It was seen often and surely enough to be told to others.
    Reported,
    /// It is not believed enough any more to be told to others.
    Doubted,
    /// Its place has wandered by more than the gate since the last entry.
    Moved,
    /// It was stored while the pose was in doubt, and moved to where the stored trees say.
    Registered,
    /// Another object turned out to be this one.
    United(u64),
    /// It turned out to be another object, under whose id it lives on.
    PartOf(u64),
    /// Its confidence fell below the threshold of removal.
    Faded,
    /// The store was full and it was among the least confident.
    StoreFull,
    /// The file was near its largest size and it was among the least confident.
    FileFull,
    /// The vehicle works in a UTM zone too far from it.
    OutOfZone,
    /// At a station: no vehicle reports it any more.
    Withdrawn,
}

impl Reason {
    /// In a few words.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::FirstSeen => "first seen",
            Self::Reported => "reported",
            Self::Doubted => "no longer reported",
            Self::Moved => "moved",
            Self::Registered => "registered",
            Self::United(_) => "united with",
            Self::PartOf(_) => "became part of",
            Self::Faded => "faded",
            Self::StoreFull => "store full",
            Self::FileFull => "file full",
            Self::OutOfZone => "out of zone",
            Self::Withdrawn => "withdrawn",
        }
    }

    /// The other object, where there is one.
    pub fn other(self) -> Option<u64> {
        match self {
            Self::United(id) | Self::PartOf(id) => Some(id),
            _ => None,
        }
    }
}

/// One change of one object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// The object.
    pub id: u64,
    /// When.
    pub stamp: Timestamp,
    /// Why.
    pub reason: Reason,
    /// The zone of the place.
    pub zone: Option<Zone>,
    /// Where it was afterwards, metres.
    pub place_m: [f64; 2],
    /// What was believed of it afterwards.
    pub confidence: f64,
    /// How often it had been seen.
    pub sightings: u32,
}

impl Event {
    /// A change of an object as it is now.
    pub fn of(known: &Known, reason: Reason, stamp: Timestamp, zone: Option<Zone>, confidence: f64) -> Self {
        let (id, place_m, sightings) = (known.id, known.place_m, known.sightings);
        Self { id, stamp, reason, zone, place_m, confidence, sightings }
    }
}

/// Events that wait to be written.
#[derive(Clone, Debug, Default)]
pub struct Pending {
    events: VecDeque<Event>,
    lost: u64,
}

impl Pending {
    /// Adds an event.
    pub fn push(&mut self, event: Event) {
        self.events.push_back(event);
        self.bound();
    }
    /// Takes all of them.
    pub fn take(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events).into()
    }
    /// Puts events back that could not be written: they are the oldest.
    pub fn give_back(&mut self, events: &[Event]) {
        events.iter().rev().for_each(|e| self.events.push_front(*e));
        self.bound();
    }
    /// Events that found no room.
    pub fn lost(&self) -> u64 {
        self.lost
    }
    fn bound(&mut self) {
        while self.events.len() > PENDING_MAX {
            self.events.pop_front();
            self.lost += 1;
        }
    }
}
