//! The section `[kstore]` of the configuration: gates, growth and decay of confidence, thresholds, bounds.
//!
//! In: what the person wrote. Out: faults with key, value and allowed range. Nothing is repaired here.
//! Source: thesis, local knowledge store (0.3 m gate, summed confidence, exponential decay, two thresholds); the
//! covariance gate, the independence time and contrary evidence are this project's additions.

use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Class, Fault};

/// How detections become objects, and how long objects are believed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Detections farther than this from the vehicle are refused, metres: no ladar on a vehicle tells a trunk there.
    pub detection_range_max_m: f64,
    /// Poses that jumped or drifted by up to this are put right by the stored trees, metres; 0 takes every pose as it is.
    pub registration_reach_m: f64,
    /// Time constant with which the correction of the pose follows the trees in sight, seconds.
    pub registration_follow_s: f64,
    /// Time constant with which the correction fades where no stored tree is in sight, seconds.
    pub registration_fade_s: f64,
    /// Least distance within which an object absorbs a detection of its class, metres (thesis: 0.3 m).
    pub gate_m: f64,
    /// The gate grows to this many standard deviations of the distance between object and detection.
    pub gate_sigma: f64,
    /// The gate of anything but a tree grows to this share of how far it reaches across.
    pub gate_reach_share: f64,
    /// The gate grows no farther than this, metres: stems stand closer than a very unsure position reaches.
    pub gate_max_m: f64,
    /// Sightings this far apart in time are independent, seconds: about one half nod. Sightings closer together come
    /// of the same sweep and count by the share of this time that has passed.
    pub independence_s: f64,
    /// A sighting this long after the one before is independent, too, seconds: longer than one sweep needs to pass a thing,
    /// and than a thing is missed by chance. Sightings bear the instant of the newest beam, so it is time in which nobody looked.
    pub pause_s: f64,
    /// Least standard deviation of a stored position, metres: errors that repeat do not average out, and a store that
    /// is never quite sure keeps following.
    pub position_std_floor_m: f64,
    /// Least standard deviation of a stored diameter, metres.
    pub dbh_std_floor_m: f64,
    /// Standard deviation taken for a diameter that came without one, metres.
    pub dbh_std_unknown_m: f64,
    /// Confidence is not summed beyond this.
    pub confidence_max: f64,
    /// An object is reported at this confidence and above, if it was also seen often and long enough.
    pub report_confidence: f64,
    /// Independent sightings an object needs before it is reported.
    pub report_sightings: u32,
    /// The same of a tree: beams that ended at the stem, and beams that passed beside it, proved each of its sightings.
    pub report_tree_sightings: u32,
    /// Time from its first to its newest sighting that an object needs before it is reported, seconds: longer than a half
    /// nod, so that no single sweep makes an object.
    pub report_span_s: f64,
    /// An object is forgotten below this confidence.
    pub remove_confidence: f64,
    /// Time constants of the exponential decay of confidence.
    pub time_constant: TimeConstants,
    /// Without a grid to say what was seen where, everything this near the vehicle counts as well seen, metres.
    /// With a grid, nothing farther than this is judged missing.
    pub well_seen_m: f64,
    /// Time constant of confidence while an object stands where the snapshot sees well and is not detected, seconds.
    pub unconfirmed_s: f64,
    /// Time constant of confidence while the snapshot shows bare ground in the place of an object, seconds.
    pub bare_ground_s: f64,
    /// Most objects kept; the least confident are forgotten first.
    pub objects_max: usize,
    /// Newest entries of the history that are kept of one object.
    pub history_per_object_max: u32,
    /// Newest entries of the history that are kept in all.
    pub history_max: u32,
    /// The file grows no larger than this, megabytes; near it the oldest half of the history and then the least
    /// confident objects are forgotten.
    pub file_max_mb: u32,
    /// Objects this near the vehicle are published, metres.
    pub publish_radius_m: f64,
    /// Objects are published at least this often, seconds.
    pub publish_interval_s: f64,
    /// Changes are committed to disk this often, seconds. A commit costs one flush of the disk.
    pub commit_interval_s: f64,
    /// The store's file, a GeoPackage; a relative path starts at the graph's state folder.
    pub file: String,
}

/// Time constants of confidence, seconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TimeConstants {
    /// Trees.
    pub tree_s: f64,
    /// Rocks.
    pub rock_s: f64,
    /// Edges that fall away.
    pub drop_s: f64,
    /// Walls.
    pub wall_s: f64,
    /// Patches of brush.
    pub brush_s: f64,
    /// Anything not yet seen often and long enough to be reported.
    pub candidate_s: f64,
}

const DAY_S: f64 = 86_400.0;

impl Default for TimeConstants {
    fn default() -> Self {
        Self {
            tree_s: 30.0 * DAY_S,
            rock_s: 30.0 * DAY_S,
            drop_s: 30.0 * DAY_S,
            wall_s: 30.0 * DAY_S,
            brush_s: 7.0 * DAY_S,
            candidate_s: 600.0,
        }
    }
}

impl TimeConstants {
    /// The constant of a class whose existence is settled, seconds.
    pub fn of(&self, class: Class) -> f64 {
        match class {
            Class::Tree => self.tree_s,
            Class::Rock => self.rock_s,
            Class::Drop => self.drop_s,
            Class::Wall => self.wall_s,
            Class::Brush => self.brush_s,
            Class::Unknown => self.candidate_s,
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            detection_range_max_m: 150.0,
            registration_reach_m: 3.0,
            registration_follow_s: 2.0,
            registration_fade_s: 600.0,
            gate_m: 0.3,
            gate_sigma: 3.0,
            gate_reach_share: 0.25,
            gate_max_m: 1.0,
            independence_s: 2.0,
            pause_s: 1.0,
            position_std_floor_m: 0.02,
            dbh_std_floor_m: 0.005,
            dbh_std_unknown_m: 0.1,
            confidence_max: 10.0,
            report_confidence: 1.5,
            report_sightings: 3,
            report_tree_sightings: 2,
            report_span_s: 2.5,
            remove_confidence: 0.1,
            time_constant: TimeConstants::default(),
            well_seen_m: 10.0,
            unconfirmed_s: 8.0,
            bare_ground_s: 3.0,
            objects_max: 100_000,
            history_per_object_max: 64,
            history_max: 500_000,
            file_max_mb: 512,
            publish_radius_m: 100.0,
            publish_interval_s: 1.0,
            commit_interval_s: 0.1,
            file: "objects.gpkg".into(),
        }
    }
}

impl Config {
    /// Independent sightings that an object of a class needs before it is reported.
    pub fn sightings_of(&self, class: Class) -> u32 {
        if class == Class::Tree { self.report_tree_sightings } else { self.report_sightings }
    }

    /// Every fault of the section; nothing where all is well.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        self.check_ranges(&mut check);
        self.check_order(&mut check);
        let allowed = "2 or more: what was seen only once is never reported";
        check.require(self.report_sightings >= 2, "report_sightings", self.report_sightings, allowed);
        check.require(self.report_tree_sightings >= 2, "report_tree_sightings", self.report_tree_sightings, allowed);
        self.check_bounds(&mut check);
        let is_file = !self.file.is_empty() && !self.file.ends_with('/');
        check.require(is_file, "file", format!("{:?}", self.file), "the name of a file");
        check.into_faults()
    }

    fn check_ranges(&self, check: &mut Checks) {
        check.range("detection_range_max_m", self.detection_range_max_m, 1.0, 1e6, "m");
        check.range("registration_reach_m", self.registration_reach_m, 0.0, 20.0, "m");
        check.range("registration_follow_s", self.registration_follow_s, 0.1, 3600.0, "s");
        check.range("registration_fade_s", self.registration_fade_s, 1.0, 3.2e9, "s");
        check.range("gate_m", self.gate_m, 0.01, 10.0, "m");
        check.range("gate_sigma", self.gate_sigma, 0.0, 10.0, "");
        check.range("gate_reach_share", self.gate_reach_share, 0.0, 1.0, "");
        check.range("gate_max_m", self.gate_max_m, 0.01, 100.0, "m");
        check.range("independence_s", self.independence_s, 0.1, 3600.0, "s");
        check.range("pause_s", self.pause_s, 0.1, 3600.0, "s");
        check.range("position_std_floor_m", self.position_std_floor_m, 0.001, 1.0, "m");
        check.range("dbh_std_floor_m", self.dbh_std_floor_m, 0.0001, 1.0, "m");
        check.range("dbh_std_unknown_m", self.dbh_std_unknown_m, 0.001, 10.0, "m");
        check.range("confidence_max", self.confidence_max, 0.1, 1e6, "");
        check.range("report_confidence", self.report_confidence, 0.01, 1e6, "");
        check.range("report_span_s", self.report_span_s, 0.0, 86_400.0, "s");
        check.range("remove_confidence", self.remove_confidence, 1e-6, 1e6, "");
        check.range("well_seen_m", self.well_seen_m, 0.0, 1000.0, "m");
        check.range("unconfirmed_s", self.unconfirmed_s, 0.1, 3.2e9, "s");
        check.range("bare_ground_s", self.bare_ground_s, 0.1, 3.2e9, "s");
        check.range("publish_radius_m", self.publish_radius_m, 1.0, 100_000.0, "m");
        check.range("publish_interval_s", self.publish_interval_s, 0.05, 60.0, "s");
        check.range("commit_interval_s", self.commit_interval_s, 0.01, 60.0, "s");
        let t = &self.time_constant;
        for (key, value) in [
            ("tree_s", t.tree_s),
            ("rock_s", t.rock_s),
            ("drop_s", t.drop_s),
            ("wall_s", t.wall_s),
            ("brush_s", t.brush_s),
            ("candidate_s", t.candidate_s),
        ] {
            check.range(&format!("time_constant.{key}"), value, 1.0, 3.2e9, "s");
        }
    }

    fn check_bounds(&self, check: &mut Checks) {
        check.count("objects_max", self.objects_max, 1, 1_000_000, "");
        check.range("history_per_object_max", self.history_per_object_max, 1.0, 10_000.0, "");
        check.range("history_max", self.history_max, 1.0, 100_000_000.0, "");
        check.range("file_max_mb", self.file_max_mb, 1.0, 1_000_000.0, "MB");
    }

    fn check_order(&self, check: &mut Checks) {
        check.require(self.gate_max_m >= self.gate_m, "gate_max_m", self.gate_max_m, "at least gate_m");
        let (report, remove) = (self.report_confidence, self.remove_confidence);
        check.require(remove < report, "remove_confidence", remove, "below report_confidence");
        check.require(report <= self.confidence_max, "report_confidence", report, "at most confidence_max");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_without_fault() {
        assert_eq!(Config::default().validate(), vec![]);
    }

    #[test]
    fn every_fault_is_listed_by_its_key() {
        let config = Config {
            gate_m: f64::NAN,
            gate_max_m: -1.0,
            report_sightings: 1,
            report_tree_sightings: 1,
            remove_confidence: 2.0,
            objects_max: 0,
            file: String::new(),
            time_constant: TimeConstants { brush_s: 0.0, ..TimeConstants::default() },
            ..Config::default()
        };
        let keys: Vec<_> = config.validate().into_iter().map(|f| f.key).collect();
        let expected = ["gate_m", "gate_max_m", "time_constant.brush_s", "remove_confidence", "report_sightings"];
        for key in expected.iter().chain(&["report_tree_sightings", "objects_max", "file"]) {
            assert!(keys.iter().any(|k| k == key), "{key} missing in {keys:?}");
        }
    }
}
