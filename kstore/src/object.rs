//! A sighting that passed the edge, and the object the store keeps.
//!
//! In: detections as they came off the topic (UTM metres, one sigma, NaN for "not measured"). Out: sightings with
//! nothing left to check, or the reason why not. Stored objects become messages here too.
//! Does not decide what belongs together (`merge`) or what is believed (`decay`).

use crate::config::Config;
use crate::correction::distance_m;
use crate::index::Found;
use tsense_contract::{Class, Detection, Object};
use tsense_geometry::{COORDINATE_MAX_M, Timestamp};

/// A value with one sigma.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// One sigma of it, above zero.
    pub std: f64,
}

/// Why a detection was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refusal {
    /// A place, size, deviation or confidence that is NaN or infinite.
    NotFinite,
    /// A place outside UTM, or as high or low as no ground is.
    OffMap,
    /// Farther from the vehicle than any sensor sees.
    FarAway,
    /// A deviation below zero or without meaning, a confidence outside 0 to 1.
    Unsure,
    /// Larger than any such thing, or smaller than nothing.
    AbsurdSize,
    /// No class, or one this program does not know.
    UnknownClass,
}

/// Farthest a thing on the ground can be below or above the ellipsoid, metres: well beyond any mountain or trench.
pub(crate) const GROUND_MAX_M: f64 = 20_000.0;
/// A thing whose place is less sure than this says nothing, metres.
pub(crate) const POSITION_STD_MAX_M: f64 = 100.0;
/// Largest tree, wall or rock height that is believed, metres: the tallest tree measures 116.
pub(crate) const HEIGHT_MAX_M: f64 = 200.0;
/// Largest trunk that is believed, metres: the thickest tree measures 14.
pub(crate) const TRUNK_MAX_M: f64 = 20.0;
/// Largest reach of anything else that is believed, metres: a snapshot is not wider.
pub(crate) const REACH_MAX_M: f64 = 100.0;

/// One thing seen in one snapshot, checked: all numbers are finite and in range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// What it is; never unknown.
    pub class: Class,
    /// Easting, northing, metres.
    pub place_m: [f64; 2],
    /// Ground height there, metres.
    pub ground_m: f64,
    /// One sigma of the place on each axis, metres, at least the configured floor.
    pub position_std_m: f64,
    /// Diameter of a trunk, or how far anything else reaches across, metres.
    pub dbh: Option<Estimate>,
    /// Height above ground, metres.
    pub height_m: Option<f64>,
    /// From this snapshot alone, above 0, at most 1.
    pub confidence: f64,
    /// Instant of the newest beam that it rests on; nothing where that of the snapshot counts.
    pub stamp: Option<Timestamp>,
}

impl Sighting {
    /// When it was seen, in a snapshot of an instant. What nobody looked at since is no new sighting.
    pub fn seen(&self, snapshot: Timestamp) -> Timestamp {
        self.stamp.map_or(snapshot, |own| own.min(snapshot))
    }

    /// Checks a detection once, so that nothing behind this has to.
    pub fn parse(d: &Detection, vehicle_m: [f64; 2], config: &Config) -> Result<Self, Refusal> {
        let std = f64::from(d.position_std_m);
        let confidence = f64::from(d.confidence);
        let place_m = [d.easting_m, d.northing_m];
        let class = Class::from_wire(d.class);
        let reach_max_m = if class == Class::Tree { TRUNK_MAX_M } else { REACH_MAX_M };
        let (dbh, height_m) = (measured(d.dbh_m, reach_max_m), measured(d.height_m, HEIGHT_MAX_M));
        let refusals = [
            (!place_m.iter().chain(&[d.ground_m, std, confidence]).all(|x| x.is_finite()), Refusal::NotFinite),
            (place_m.iter().any(|x| x.abs() > COORDINATE_MAX_M) || d.ground_m.abs() > GROUND_MAX_M, Refusal::OffMap),
            (distance_m(place_m, vehicle_m) > config.detection_range_max_m, Refusal::FarAway),
            (!(0.0..=POSITION_STD_MAX_M).contains(&std) || confidence <= 0.0 || confidence > 1.0, Refusal::Unsure),
            (class == Class::Unknown, Refusal::UnknownClass),
        ];
        if let Some((_, refusal)) = refusals.into_iter().find(|(applies, _)| *applies) {
            return Err(refusal);
        }
        Ok(Self {
            class,
            place_m,
            ground_m: d.ground_m,
            position_std_m: std.max(config.position_std_floor_m),
            dbh: dbh?.map(|value| Estimate { value, std: dbh_std(d, config) }),
            height_m: height_m?,
            confidence,
            stamp: (d.stamp_ns != 0).then(|| Timestamp::from_ns(d.stamp_ns)),
        })
    }
}

/// A size that may be missing (NaN); anything else must be a size.
pub(crate) fn measured(value: f32, max: f64) -> Result<Option<f64>, Refusal> {
    let value = f64::from(value);
    match value {
        v if v.is_nan() => Ok(None),
        v if v.is_infinite() => Err(Refusal::NotFinite),
        v if v < 0.0 || v > max => Err(Refusal::AbsurdSize),
        v => Ok(Some(v)),
    }
}

fn dbh_std(d: &Detection, config: &Config) -> f64 {
    let std = f64::from(d.dbh_std_m);
    if std.is_finite() && std >= 0.0 { std.max(config.dbh_std_floor_m) } else { config.dbh_std_unknown_m }
}

/// What the store keeps of one object.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// Stays the same for the life of the store, never reused.
    pub id: u64,
    /// What it is.
    pub class: Class,
    /// First sighting.
    pub first_seen: Timestamp,
    /// Newest sighting.
    pub last_seen: Timestamp,
    /// Instant `confidence` is true for; evidence up to here has been weighed.
    pub weighed: Timestamp,
    /// Summed confidence at `weighed`; it decays from there.
    pub confidence: f64,
    /// Detections merged into it.
    pub sightings: u32,
    /// Sightings at least the independence time apart.
    pub independent: u32,
    /// Newest independent sighting.
    pub independent_at: Timestamp,
    /// Easting, northing, metres.
    pub place_m: [f64; 2],
    /// Ground height there, metres.
    pub ground_m: f64,
    /// One sigma of the place on each axis, metres.
    pub position_std_m: f64,
    /// Diameter of a trunk, or how far anything else reaches across, metres.
    pub dbh: Option<Estimate>,
    /// Height above ground, metres.
    pub height_m: Option<f64>,
    /// Objects that were seen beside this one, within its gate, in one and the same snapshot: they are two things
    /// and are never merged. Sorted; at most `COMPANIONS_MAX`.
    pub companions: Vec<u64>,
    /// Whether it was reported when that was last looked at: the history tells when this changes.
    pub reported: bool,
    /// Where it was when the history last told its place, metres.
    pub noted_m: [f64; 2],
}

/// More stems than fit into a gate of 0.3 m around another.
pub const COMPANIONS_MAX: usize = 8;

impl Known {
    /// An object as its first sighting makes it.
    pub fn first(id: u64, s: &Sighting, stamp: Timestamp) -> Self {
        Self {
            id,
            class: s.class,
            first_seen: stamp,
            last_seen: stamp,
            weighed: stamp,
            confidence: s.confidence,
            sightings: 1,
            independent: 1,
            independent_at: stamp,
            place_m: s.place_m,
            ground_m: s.ground_m,
            position_std_m: s.position_std_m / s.confidence.sqrt(),
            dbh: s.dbh.map(|d| Estimate { std: d.std / s.confidence.sqrt(), ..d }),
            height_m: s.height_m,
            companions: Vec::new(),
            reported: false,
            noted_m: s.place_m,
        }
    }

    /// As the index knows it.
    pub(crate) fn indexed(&self) -> (Class, Found) {
        (self.class, Found { id: self.id, place_m: self.place_m })
    }

    /// True where it was seen often enough, and over a long enough time, not to be a fault of single classifications.
    pub fn is_established(&self, config: &Config) -> bool {
        let newest = self.last_seen.max(self.independent_at);
        self.independent >= config.sightings_of(self.class)
            && newest.seconds_since(self.first_seen) >= config.report_span_s
    }

    /// True where it is believed enough at `now` to tell others.
    pub fn is_reported(&self, now: Timestamp, config: &Config) -> bool {
        self.is_established(config) && self.confidence_at(now, config) >= config.report_confidence
    }

    /// The message others receive at `now`.
    pub fn to_message(&self, now: Timestamp, config: &Config) -> Object {
        let std = |e: Option<Estimate>| e.map_or(f32::NAN, |e| e.std as f32);
        let confidence = self.confidence_at(now, config);
        let is_reported = self.is_established(config) && confidence >= config.report_confidence;
        Object {
            id: self.id,
            first_seen_ns: self.first_seen.ns,
            last_seen_ns: self.last_seen.ns,
            easting_m: self.place_m[0],
            northing_m: self.place_m[1],
            ground_m: self.ground_m,
            position_std_m: self.position_std_m as f32,
            dbh_m: self.dbh.map_or(f32::NAN, |e| e.value as f32),
            dbh_std_m: std(self.dbh),
            height_m: self.height_m.map_or(f32::NAN, |h| h as f32),
            confidence: confidence as f32,
            sightings: self.sightings,
            class: self.class.to_wire(),
            reported: u8::from(is_reported),
            reserved: [0; 6],
        }
    }
}

impl Sighting {
    /// An order by content, so that results do not depend on the order detections came in.
    pub fn order(&self, other: &Self) -> std::cmp::Ordering {
        let key = |s: &Self| {
            let dbh = s.dbh.map_or([-1.0; 2], |d| [d.value, d.std]);
            let [east, north] = s.place_m;
            [east, north, s.position_std_m, s.confidence, s.ground_m, s.height_m.unwrap_or(-1.0), dbh[0], dbh[1]]
        };
        let (a, b) = (key(self), key(other));
        let by_number = a.iter().zip(&b).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne());
        let by_number = by_number.unwrap_or(std::cmp::Ordering::Equal);
        self.class.cmp(&other.class).then(by_number).then(self.stamp.cmp(&other.stamp))
    }
}
