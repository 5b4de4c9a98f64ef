//! How a station is, vehicle by vehicle: for people and as JSON.

use super::Station;
use serde::Serialize;
use std::collections::BTreeMap;
use tsense_geometry::Timestamp;

/// One vehicle at a station.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VehicleReport {
    /// Its name.
    pub vehicle: String,
    /// Whether it was heard within the last five seconds.
    pub connected: bool,
    /// Objects that it reports now.
    pub objects: usize,
    /// The cursor in its list of objects.
    pub cursor: u64,
    /// Changes of objects that it told of and that are not here yet; none where that is not known.
    pub lag: Option<u64>,
    /// Blocks of which the newest file is not here.
    pub blocks_wanted: usize,
    /// Bytes that came from it since the station was started.
    pub bytes: u64,
    /// Pages of lists taken since then.
    pub pages: u64,
    /// Objects in them.
    pub objects_taken: u64,
    /// Files of blocks taken since then.
    pub files: u64,
    /// What was dropped since then, by cause.
    pub dropped: BTreeMap<&'static str, u64>,
}

impl Station {
    /// Every vehicle by its name.
    pub fn report(&self, now: Timestamp) -> Vec<VehicleReport> {
        let report = |(name, vehicle): (&tsense_contract::VehicleName, &super::Vehicle)| VehicleReport {
            vehicle: name.to_string(),
            connected: vehicle.peer.is_near(now),
            objects: self.fleet.count_of(vehicle.number).0,
            cursor: vehicle.peer.objects.cursor().after,
            lag: vehicle.peer.objects.lag(),
            blocks_wanted: vehicle.wanted.len(),
            bytes: vehicle.counts.bytes,
            pages: vehicle.counts.pages,
            objects_taken: vehicle.counts.objects,
            files: vehicle.counts.files,
            dropped: vehicle.counts.dropped.clone(),
        };
        self.vehicles.iter().map(report).collect()
    }

    /// Files of blocks that are here, and the bytes they take.
    pub fn block_usage(&self) -> (usize, u64) {
        (self.blocks.values().filter(|row| row.here.is_some()).count(), self.block_bytes)
    }

    /// Messages of vehicles that are not listened to.
    pub fn strangers(&self) -> u64 {
        self.strangers
    }

    /// Whether the store is near its largest size, so that no more objects are asked for.
    pub fn is_full(&self) -> bool {
        self.is_full
    }
}
