//! What goes with a snapshot into the store, and what the store says about it afterwards.

use crate::object::{Known, Refusal};
use crate::zone::Zone;
use tsense_geometry::Timestamp;

/// Which snapshot detections come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snapshot {
    /// Instant of its newest beam.
    pub stamp: Timestamp,
    /// Easting, northing of the vehicle, metres.
    pub vehicle_m: [f64; 2],
    /// Zone of all positions.
    pub zone: Zone,
}

/// What was dropped, counted since the store was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Detections with a place, deviation or confidence that is no number.
    pub not_finite: u64,
    /// Detections off the map, or with impossible sizes.
    pub out_of_range: u64,
    /// Detections of no known class.
    pub unknown_class: u64,
    /// Detections of snapshots older than one already taken.
    pub late: u64,
    /// Objects forgotten because the vehicle works in a UTM zone too far from theirs.
    pub out_of_zone: u64,
    /// Objects forgotten because the store was full.
    pub store_full: u64,
}

impl Dropped {
    /// Each cause in a few words with its count.
    pub fn by_cause(&self) -> [(&'static str, u64); 6] {
        [
            ("not finite", self.not_finite),
            ("out of range", self.out_of_range),
            ("unknown class", self.unknown_class),
            ("late snapshot", self.late),
            ("out of utm zone", self.out_of_zone),
            ("store full", self.store_full),
        ]
    }

    pub(crate) fn count(&mut self, refusal: Refusal) {
        match refusal {
            Refusal::NotFinite => self.not_finite += 1,
            Refusal::OutOfRange => self.out_of_range += 1,
            Refusal::UnknownClass => self.unknown_class += 1,
        }
    }
}

/// What a snapshot did to the store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Detections that passed the edge.
    pub taken: usize,
    /// Of these, absorbed by an object already stored.
    pub absorbed: usize,
    /// Objects made of the others.
    pub created: usize,
    /// Objects nearby that lost confidence because the snapshot spoke against them.
    pub contradicted: usize,
    /// Objects that turned out to be another one and were united with it.
    pub united: usize,
}

/// What must be written down: objects as they are now, and ids that are gone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    /// New and changed objects, by id.
    pub changed: Vec<Known>,
    /// Ids that no longer exist.
    pub removed: Vec<u64>,
    /// The next id to be given: ids below it may have been used.
    pub next_id: u64,
}

impl Changes {
    /// True where there is nothing to write.
    pub fn is_empty(&self) -> bool {
        self.changed.is_empty() && self.removed.is_empty()
    }
}
