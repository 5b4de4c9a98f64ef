//! What can be seen now: takes the system's messages in and keeps the hub's frames up to date.
//!
//! In: headers and items as they lie in shared memory. Samples of the map are kept until a delta or a newer one
//! replaces them (see the assembler in `contract`); nothing is kept of all others but encoded frames, so a borrowed sample
//! can be given back at once. Out: frames in the [`Hub`]. Time is an argument. Nothing here panics on what a
//! message says: what does not fit is dropped and counted by cause.

use super::counters::Counters;
use super::frames::{self, Frame, Kind};
use super::hub::Hub;
use super::slots::Slot;
use super::surface::surface_of;
use crate::config::Config;
use std::collections::BTreeMap;
use std::sync::Arc;
use tsense_contract::{
    BLOCK_VOXELS, BLOCKS_MAX, BlockKey, Brick, Detection, DetectionsHeader, GridCell, GridHeader, Joint, MapHeader,
    Object, ObjectsHeader, PlacedReturn, PointsHeader, Pose, ProcessStatus, ProcessesHeader, SnapshotAssembler, Taken,
};
use tsense_geometry::Timestamp;

/// Farthest the vehicle goes from the origin of small coordinates before a new one is chosen, metres: `f32` still
/// resolves 0.06 mm there.
const ORIGIN_RANGE_M: f64 = 1000.0;

/// A block as the screen has it.
#[derive(Clone, Copy, Debug)]
struct Shown {
    epoch: u64,
    version: u32,
    /// Visible ones.
    voxels: usize,
}

/// The UTM zone in force and the origin of small coordinates in it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    zone: (u8, u8),
    origin_m: [f64; 3],
}

/// Messages in, frames out. `S` is what the items of a map sample lie in.
#[derive(Debug)]
pub struct Scene<S = Vec<Brick>> {
    hub: Arc<Hub>,
    period_s: f64,
    place: Option<Place>,
    assembler: SnapshotAssembler<S>,
    shown: BTreeMap<BlockKey, Shown>,
    joint: Option<Joint>,
    sent: BTreeMap<Slot, Timestamp>,
    counters: Counters,
}

impl<S: AsRef<[Brick]>> Scene<S> {
    /// An empty scene that says hello to every client.
    pub fn new(hub: Arc<Hub>, config: &Config) -> Self {
        hub.put(Slot::Only(Kind::Hello), hello_frame(config));
        Self {
            hub,
            period_s: 1.0 / config.update_hz,
            place: None,
            assembler: SnapshotAssembler::new(BLOCKS_MAX),
            shown: BTreeMap::new(),
            joint: None,
            sent: BTreeMap::new(),
            counters: Counters::default(),
        }
    }

    /// A sample of topic `map`. The map changes on screen when a commit is complete.
    pub fn map(&mut self, header: &MapHeader, sample: S, now: Timestamp) {
        if self.place.is_none() {
            // The map may come before the first pose of ours: its header has one.
            self.pose(&header.pose, now);
        }
        if !self.zone_fits((header.pose.zone, header.pose.south)) {
            return;
        }
        match self.assembler.take(header, sample) {
            Taken::Part => {}
            Taken::Complete => self.show_snapshot(now),
            Taken::Incomplete { .. } => self.counters.dropped("incomplete snapshot", 1),
            Taken::Refused(why) => self.counters.dropped(why.as_str(), 1),
        }
    }

    /// True where the mapper should be asked for every block anew.
    pub fn keyframe_needed(&self) -> bool {
        self.assembler.keyframe_needed()
    }

    /// Encodes and puts what changed, then the table: clients drop what the table does not list.
    fn show_snapshot(&mut self, now: Timestamp) {
        let Some(snapshot) = self.assembler.complete() else {
            return;
        };
        let header = snapshot.header;
        let mut shown = BTreeMap::new();
        let (mut voxels, mut cut) = (0, 0);
        for (key, version, bricks) in snapshot.versioned_blocks() {
            let before = self.shown.get(&key).filter(|shown| (shown.epoch, shown.version) == (header.epoch, version));
            let block = before.copied().unwrap_or_else(|| {
                // Never nothing: the assembler holds blocks of the right size only.
                let surface = surface_of(bricks).unwrap_or_default();
                cut += surface.cut;
                self.hub.put(Slot::Block(key), frames::block_frame(&MapHeader { key, version, ..header }, &surface));
                Shown { epoch: header.epoch, version, voxels: surface.words.len() }
            });
            voxels += block.voxels;
            shown.insert(key, block);
        }
        self.shown = shown;
        self.counters.dropped("surface voxels beyond the bound", cut);
        self.hub.remove(|slot| matches!(slot, Slot::Block(key) if !self.shown.contains_key(&key)));
        let table: Vec<_> = self.shown.iter().map(|(key, shown)| (*key, shown.version)).collect();
        self.hub.put(Slot::Only(Kind::Commit), frames::commit_frame(&header, &table, voxels));
        self.counters.snapshots.count(1, now);
        self.counters.map = (header.snapshot, table.len(), voxels);
        self.newest("map", header.stamp_ns);
    }

    /// A sample of topic `points`.
    pub fn points(&mut self, header: &PointsHeader, beams: &[PlacedReturn], now: Timestamp) {
        self.counters.beams.count(beams.len() as u64, now);
        self.counters.scans.count(1, now);
        self.newest("points", header.stamp_ns);
        let slot = Slot::Points(header.ladar);
        if self.zone_fits((header.zone, header.south)) && self.due(slot, now) {
            self.hub.put(slot, frames::points_frame(header, beams));
        }
    }

    /// A sample of topic `grid`.
    pub fn grid(&mut self, header: &GridHeader, cells: &[GridCell]) {
        if !self.zone_fits((header.zone, header.south)) {
            return;
        }
        match frames::grid_frame(header, cells) {
            Some(frame) => {
                self.newest("grid", header.stamp_ns);
                self.hub.put(Slot::Only(Kind::Grid), frame);
            }
            None => self.counters.dropped("grid of another shape", 1),
        }
    }

    /// A sample of topic `objects`.
    pub fn objects(&mut self, header: &ObjectsHeader, objects: &[Object]) {
        self.newest("objects", header.stamp_ns);
        if self.zone_fits((header.zone, header.south))
            && let Some(place) = self.place
        {
            self.hub.put(Slot::Only(Kind::Objects), frames::objects_frame(header, objects, place.origin_m));
        }
    }

    /// A sample of topic `detections`.
    pub fn detections(&mut self, header: &DetectionsHeader, detections: &[Detection]) {
        self.newest("detections", header.stamp_ns);
        if self.zone_fits((header.zone, header.south))
            && let Some(place) = self.place
        {
            self.hub.put(Slot::Only(Kind::Detections), frames::detections_frame(header, detections, place.origin_m));
        }
    }

    /// A sample of topic `joint`: shown with the next pose.
    pub fn joint(&mut self, joint: &Joint) {
        self.joint = Some(*joint);
    }

    /// A sample of topic `pose`: decides the zone and the origin of small coordinates.
    pub fn pose(&mut self, pose: &Pose, now: Timestamp) {
        self.newest("pose", pose.stamp_ns);
        let position_m = [pose.easting_m, pose.northing_m, pose.altitude_m];
        if pose.zone == 0 || position_m.iter().any(|c| !c.is_finite()) {
            return self.counters.dropped("pose without a position", 1);
        }
        let place = self.enter((pose.zone, pose.south), position_m);
        if self.due(Slot::Only(Kind::Vehicle), now) {
            let frame = frames::vehicle_frame(pose, self.joint.as_ref(), place.origin_m);
            self.hub.put(Slot::Only(Kind::Vehicle), frame);
        }
    }

    /// A sample of topic `processes`.
    pub fn processes(&self, header: &ProcessesHeader, processes: &[ProcessStatus]) {
        let frame = frames::processes_frame(header, processes);
        self.hub.put(Slot::Only(Kind::Processes), frame);
    }

    /// Puts the counters, and returns them for `/health`.
    pub fn publish_counters(&mut self, now: Timestamp) -> serde_json::Value {
        let json = self.counters.to_json(now, self.hub.clients());
        self.hub.put(Slot::Only(Kind::Counters), frames::json_frame(Kind::Counters, now.ns, &json));
        json
    }

    /// Drops by cause since the start.
    pub fn drops(&self) -> &BTreeMap<&'static str, u64> {
        &self.counters.drops
    }

    /// Stamp of the newest data shown of a layer.
    fn newest(&mut self, layer: &'static str, stamp_ns: i64) {
        self.counters.newest.insert(layer, Timestamp::from_ns(stamp_ns));
    }

    /// True where the slot was not filled within the configured period.
    fn due(&mut self, slot: Slot, now: Timestamp) -> bool {
        // A tenth of slack: data at just the configured rate must not be halved by jitter.
        let due = self.sent.get(&slot).is_none_or(|sent| now.seconds_since(*sent) >= 0.9 * self.period_s);
        if due {
            self.sent.insert(slot, now);
        }
        due
    }

    /// The zone of the vehicle is the zone of the screen: crossing into another one empties it.
    fn enter(&mut self, zone: (u8, u8), position_m: [f64; 3]) -> Place {
        let near = |place: &Place| (0..3).all(|i| (place.origin_m[i] - position_m[i]).abs() <= ORIGIN_RANGE_M);
        if let Some(place) = self.place.filter(|place| place.zone == zone && near(place)) {
            return place;
        }
        if self.place.is_some_and(|place| place.zone != zone) {
            let keeps = [Kind::Hello, Kind::Processes, Kind::Counters];
            self.hub.remove(|slot| !keeps.contains(&slot.kind()));
            self.assembler = SnapshotAssembler::new(BLOCKS_MAX);
            self.shown.clear();
        }
        *self.place.insert(Place { zone, origin_m: position_m.map(f64::floor) })
    }

    /// Data of another zone has coordinates that mean another place: it is not shown.
    fn zone_fits(&mut self, zone: (u8, u8)) -> bool {
        let fits = self.place.is_some_and(|place| place.zone == zone);
        let cause = if self.place.is_none() { "before the first pose" } else { "another zone" };
        self.counters.dropped(cause, usize::from(!fits));
        fits
    }
}

/// What does not change while the bridge runs.
fn hello_frame(config: &Config) -> Frame {
    let json = serde_json::json!({
        "protocol": frames::PROTOCOL_VERSION,
        "software": concat!("tsense ", env!("CARGO_PKG_VERSION")),
        "block_voxels": BLOCK_VOXELS,
        "vehicle": {
            "length_m": config.vehicle_length_m,
            "width_m": config.vehicle_width_m,
            "height_m": config.vehicle_height_m,
            "origin_m": config.vehicle_origin_m,
        },
    });
    frames::json_frame(Kind::Hello, 0, &json)
}

#[cfg(test)]
mod tests;
