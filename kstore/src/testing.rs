//! Small nouns for this crate's tests: instants, sightings and objects at a place.

use crate::decay::View;
use crate::object::{Known, Sighting};
use crate::records::Snapshot;
use crate::zone::Zone;
use tsense_contract::{Class, Detection};
use tsense_geometry::Timestamp;

/// `seconds` after an arbitrary instant.
pub fn at(seconds: f64) -> Timestamp {
    Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds)
}

/// A tree seen with confidence one half and 5 cm deviation.
pub fn sighting(east_m: f64, north_m: f64) -> Sighting {
    Sighting {
        class: Class::Tree,
        place_m: [east_m, north_m],
        ground_m: 100.0,
        position_std_m: 0.05,
        dbh: None,
        height_m: None,
        confidence: 0.5,
        stamp: None,
    }
}

/// A tree seen once, at instant 0.
pub fn known(id: u64, east_m: f64, north_m: f64) -> Known {
    Known::first(id, &sighting(east_m, north_m), at(0.0))
}

/// The detection of a tree, as the classifier sends it.
pub fn detection(east_m: f64, north_m: f64) -> Detection {
    Detection {
        easting_m: east_m,
        northing_m: north_m,
        ground_m: 100.0,
        position_std_m: 0.05,
        dbh_m: 0.3,
        dbh_std_m: 0.02,
        height_m: 12.0,
        confidence: 0.6,
        arc_coverage: 0.4,
        lean_rad: [0.0; 2],
        class: Class::Tree.to_wire(),
        stamp_ns: 0,
        reserved: [0; 7],
    }
}

/// A snapshot `seconds` after instant 0, the vehicle at the origin of these tests.
pub fn snapshot(seconds: f64) -> Snapshot {
    Snapshot { stamp: at(seconds), vehicle_m: [0.0, 0.0], zone: zone(), epoch: 1 }
}

/// Zone 17 north.
pub fn zone() -> Zone {
    Zone::from_epsg(32_617).unwrap()
}

/// Nothing was seen anywhere.
pub fn blind(_place_m: [f64; 2]) -> View {
    View::Unseen
}
