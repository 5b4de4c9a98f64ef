//! What goes with a snapshot into the store, and what the store says about it afterwards.

use crate::history::Event;
use crate::object::{Known, Refusal};
use crate::zone::Zone;
use tsense_contract::DetectionsHeader;
use tsense_geometry::{COORDINATE_MAX_M, Timestamp};

/// A stamp this far from now is not of this graph's clock, seconds: a snapshot is classified within one.
const STAMP_OFF_MAX_S: f64 = 60.0;

/// Which snapshot detections come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snapshot {
    /// Instant of its newest beam.
    pub stamp: Timestamp,
    /// Easting, northing of the vehicle, metres.
    pub vehicle_m: [f64; 2],
    /// Zone of all positions.
    pub zone: Zone,
    /// Changes when the mapper starts anew; the pose may have jumped meanwhile.
    pub epoch: u64,
}

impl Snapshot {
    /// Checks a header that came at `now`; nothing where its zone, its place or its instant makes no sense.
    pub fn parse(header: &DetectionsHeader, now: Timestamp) -> Option<Self> {
        let stamp = Timestamp::from_ns(header.stamp_ns);
        let vehicle_m = header.vehicle_m;
        let on_map = vehicle_m.iter().all(|x| x.abs() <= COORDINATE_MAX_M);
        let zone = Zone::from_wire(header.zone, header.south)?;
        let of_now = now.seconds_since(stamp).abs() <= STAMP_OFF_MAX_S;
        (on_map && of_now).then_some(Self { stamp, vehicle_m, zone, epoch: header.epoch })
    }
}

/// What was dropped, counted since the store was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Detections with a place, size, deviation or confidence that is no number.
    pub not_finite: u64,
    /// Detections off the map.
    pub off_map: u64,
    /// Detections farther from the vehicle than any sensor sees.
    pub far_away: u64,
    /// Detections with a deviation or a confidence without meaning.
    pub unsure: u64,
    /// Detections of an impossible size.
    pub absurd_size: u64,
    /// Detections of no known class.
    pub unknown_class: u64,
    /// Detections of snapshots without a zone, of no place, or of another time.
    pub senseless_snapshot: u64,
    /// Detections of snapshots older than one already taken.
    pub late: u64,
    /// Objects forgotten because the vehicle works in a UTM zone too far from theirs.
    pub out_of_zone: u64,
    /// Objects forgotten because the store was full.
    pub store_full: u64,
    /// Objects forgotten because the file was near its largest size.
    pub file_full: u64,
    /// Entries of the history that found no room while the disk failed.
    pub history: u64,
}

impl Dropped {
    /// Each cause in a few words with its count.
    pub fn by_cause(&self) -> [(&'static str, u64); 12] {
        [
            ("not finite", self.not_finite),
            ("off the map", self.off_map),
            ("too far from the vehicle", self.far_away),
            ("senseless deviation", self.unsure),
            ("absurd size", self.absurd_size),
            ("unknown class", self.unknown_class),
            ("senseless snapshot", self.senseless_snapshot),
            ("late snapshot", self.late),
            ("out of utm zone", self.out_of_zone),
            ("store full", self.store_full),
            ("file full", self.file_full),
            ("history", self.history),
        ]
    }

    pub(crate) fn count(&mut self, refusal: Refusal) {
        let count = match refusal {
            Refusal::NotFinite => &mut self.not_finite,
            Refusal::OffMap => &mut self.off_map,
            Refusal::FarAway => &mut self.far_away,
            Refusal::Unsure => &mut self.unsure,
            Refusal::AbsurdSize => &mut self.absurd_size,
            Refusal::UnknownClass => &mut self.unknown_class,
        };
        *count += 1;
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
    /// What happened to which object, oldest first.
    pub events: Vec<Event>,
    /// The next id to be given: ids below it may have been used.
    pub next_id: u64,
}

impl Changes {
    /// True where there is nothing to write.
    pub fn is_empty(&self) -> bool {
        self.changed.is_empty() && self.removed.is_empty() && self.events.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::at;

    fn header() -> DetectionsHeader {
        DetectionsHeader {
            stamp_ns: at(0.0).ns,
            classified_ns: at(0.0).ns,
            epoch: 1,
            snapshot: 1,
            vehicle_m: [5e5, 4e6],
            zone: 17,
            south: 0,
            reserved: [0; 6],
        }
    }

    #[test]
    fn a_header_without_a_zone_of_no_place_or_of_another_time_is_no_snapshot() {
        let now = at(1.0);
        assert!(Snapshot::parse(&header(), now).is_some());
        let bad = [
            DetectionsHeader { zone: 61, ..header() },
            DetectionsHeader { vehicle_m: [f64::NAN, 0.0], ..header() },
            DetectionsHeader { vehicle_m: [0.0, f64::INFINITY], ..header() },
            DetectionsHeader { stamp_ns: i64::MAX, ..header() },
            DetectionsHeader { stamp_ns: i64::MIN, ..header() },
            DetectionsHeader { stamp_ns: at(62.0).ns, ..header() },
        ];
        assert_eq!(bad.map(|h| Snapshot::parse(&h, now)), [None; 6]);
    }
}
