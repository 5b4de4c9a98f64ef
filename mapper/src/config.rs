//! Section `[mapper]` of the configuration: sizes, evidence, fading, waiting. Ladars come from `[[ladar]]`.
//!
//! In: what a person wrote. Out: a list of all faults. Nothing is repaired here.

use crate::blocks_config::BlocksConfig;
use crate::voxel_sensor::{self, VoxelSensor};
use serde::{Deserialize, Serialize};
use tsense_contract::{BLOCKS_MAX, Checks, Fault};

/// Everything the mapper can be told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Edge of a voxel, metres. A block is 100 x 100 x 40 of them.
    pub voxel_size_m: f64,
    /// The working space around the vehicle, along east, north, up, metres. Beams are cut to it.
    pub working_space_m: [f64; 3],
    /// How far above the vehicle's origin the centre of the working space lies, metres.
    pub center_up_m: f64,
    /// Snapshots a second.
    pub snapshot_hz: f64,
    /// One table a sensor that sends voxels; none as a rule.
    pub voxel_sensor: Vec<VoxelSensor>,
    /// How scans wait for poses and pan-tilt angles.
    pub placing: PlacingConfig,
    /// How beams become evidence.
    pub evidence: EvidenceConfig,
    /// How evidence changes a voxel.
    pub scheme: SchemeConfig,
    /// How confidence fades.
    pub fading: FadingConfig,
    /// What becomes of blocks that the vehicle leaves behind.
    pub blocks: BlocksConfig,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            voxel_size_m: 0.15,
            working_space_m: [30.0, 30.0, 12.0],
            center_up_m: 2.0,
            snapshot_hz: 5.0,
            voxel_sensor: Vec::new(),
            placing: PlacingConfig::default(),
            evidence: EvidenceConfig::default(),
            scheme: SchemeConfig::default(),
            fading: FadingConfig::default(),
            blocks: BlocksConfig::default(),
        }
    }
}

/// How scans wait for poses and pan-tilt angles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlacingConfig {
    /// Longest a scan waits for the pose and the angles of its last beam, seconds.
    pub deadline_s: f64,
    /// Widest gap between two poses that is interpolated across, seconds.
    pub pose_gap_max_s: f64,
    /// Widest gap between two pan-tilt readings that is interpolated across, seconds.
    pub joint_gap_max_s: f64,
    /// Farthest beyond the newest pose or reading that is extrapolated, seconds.
    pub extrapolation_max_s: f64,
}

impl Default for PlacingConfig {
    fn default() -> Self {
        Self { deadline_s: 0.5, pose_gap_max_s: 0.5, joint_gap_max_s: 0.25, extrapolation_max_s: 0.0 }
    }
}

/// What ends a window of evidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WindowRule {
    /// Every scan: the rule that erodes the ground; kept for comparison.
    Scan,
    /// A fixed time.
    Time,
    /// A nod of the head; a fixed time where the head does not nod.
    Sweep,
}

/// How beams become evidence: gathered over a window, in which a hit protects its voxel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvidenceConfig {
    /// What ends a window.
    pub window: WindowRule,
    /// Length of a window by time, seconds.
    pub window_s: f64,
    /// Longest a window by sweep may get, seconds: a head that stands still turns no more.
    pub sweep_max_s: f64,
    /// A beam frees nothing on this length before its hit, voxels.
    pub spare_voxels: f64,
    /// Where nothing stands on the hit voxel, the beam grazes a surface that it sees from above: it frees nothing on
    /// this share of its length before the hit. A beam as wide as a voxel touches the ground well before its middle.
    pub grazing_spare_share: f64,
    /// A beam frees no voxel in which it runs a shorter way than this, voxels: it is as wide as a voxel at 10 m.
    pub chord_min_voxels: f64,
}

impl Default for EvidenceConfig {
    fn default() -> Self {
        Self {
            window: WindowRule::Sweep,
            window_s: 0.3,
            sweep_max_s: 4.0,
            spare_voxels: 2.0,
            grazing_spare_share: 0.1,
            chord_min_voxels: 0.5,
        }
    }
}

/// The occupancy schemes of the thesis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// 1: plus one for a hit, minus one for a miss, clamped to a byte.
    IncrementDecrement,
    /// 2: p = hits / (hits + misses), a byte each, both halved when one saturates. Thesis (2-4).
    HitRatio,
    /// 3: the counter of 1 with its own steps and clamps, and a confidence that fades.
    Confidence,
}

/// How evidence changes a voxel, once a window.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SchemeConfig {
    /// Which scheme.
    pub scheme: Scheme,
    /// Scheme 3: what a window with a hit adds to the occupancy, for a ladar of weight 1.
    pub hit_step: u8,
    /// Scheme 3: what a window with misses only takes from it.
    pub miss_step: u8,
    /// Scheme 3: the occupancy never rises above; divided by `miss_step`: windows until a removed thing is free.
    pub occupancy_max: i8,
    /// Scheme 3: the occupancy never falls below; above `-hit_step`, so that one hit shows a new thing at once.
    pub occupancy_min: i8,
    /// Scheme 3: what a window adds to the confidence; fading takes single units.
    pub confidence_step: u8,
    /// Scheme 2: a voxel is occupied above this share of hits.
    pub hit_ratio_min: f64,
}

impl Default for SchemeConfig {
    fn default() -> Self {
        Self {
            scheme: Scheme::Confidence,
            hit_step: 12,
            miss_step: 4,
            occupancy_max: 8,
            occupancy_min: -8,
            confidence_step: 8,
            hit_ratio_min: 0.3,
        }
    }
}

/// How confidence fades (scheme 3): slowly with time, quickly with the way driven, because pose drift ages a map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FadingConfig {
    /// Units of confidence lost a second.
    pub per_second: f64,
    /// Units of confidence lost a metre driven.
    pub per_metre: f64,
    /// Confidence of occupied voxels never fades below: with 1 or more, only contrary rays delete.
    pub floor_occupied: u8,
    /// Confidence of free voxels never fades below: with 0, free space that nobody looks at is forgotten.
    pub floor_free: u8,
}

impl Default for FadingConfig {
    fn default() -> Self {
        Self { per_second: 0.25, per_metre: 0.5, floor_occupied: 1, floor_free: 0 }
    }
}

impl Config {
    /// All faults, with key, value and what is allowed.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        check.range("voxel_size_m", self.voxel_size_m, 0.02, 2.0, "m");
        check.range("center_up_m", self.center_up_m, -50.0, 50.0, "m");
        check.range("snapshot_hz", self.snapshot_hz, 0.1, 50.0, "Hz");
        check.extend(voxel_sensor::validate(&self.voxel_sensor));
        self.validate_space(&mut check);
        self.placing.validate(&mut check);
        self.evidence.validate(&mut check);
        self.scheme.validate(&mut check);
        self.fading.validate(&mut check);
        check.extend(self.blocks.validate());
        check.into_faults()
    }

    /// Most blocks of the map at once, or nothing where they are beyond all bounds.
    pub fn blocks_max(&self) -> Option<usize> {
        crate::window::blocks_for(self.voxel_size_m, self.working_space_m).map(|count| count.iter().product())
    }

    fn validate_space(&self, check: &mut Checks) {
        for (axis, extent_m) in self.working_space_m.into_iter().enumerate() {
            check.range(&format!("working_space_m.{axis}"), extent_m, 2.0, 400.0, "m");
        }
        let fits = self.blocks_max().is_some_and(|blocks| blocks <= BLOCKS_MAX);
        let allowed = format!("a size that at most {BLOCKS_MAX} blocks of 100 x 100 x 40 voxels cover");
        check.require(fits, "working_space_m", format!("{:?}", self.working_space_m), &allowed);
    }
}

impl PlacingConfig {
    fn validate(&self, check: &mut Checks) {
        check.range("placing.deadline_s", self.deadline_s, 0.01, 10.0, "s");
        check.range("placing.pose_gap_max_s", self.pose_gap_max_s, 0.001, 10.0, "s");
        check.range("placing.joint_gap_max_s", self.joint_gap_max_s, 0.001, 10.0, "s");
        check.range("placing.extrapolation_max_s", self.extrapolation_max_s, 0.0, 0.5, "s");
    }
}

impl EvidenceConfig {
    fn validate(&self, check: &mut Checks) {
        check.range("evidence.window_s", self.window_s, 0.0, 60.0, "s");
        check.range("evidence.sweep_max_s", self.sweep_max_s, 0.0, 60.0, "s");
        check.range("evidence.spare_voxels", self.spare_voxels, 0.0, 10.0, "voxels");
        check.range("evidence.grazing_spare_share", self.grazing_spare_share, 0.0, 0.5, "of the beam's length");
        check.range("evidence.chord_min_voxels", self.chord_min_voxels, 0.0, 1.0, "voxels");
    }
}

impl SchemeConfig {
    fn validate(&self, check: &mut Checks) {
        check.range("scheme.hit_step", self.hit_step, 1.0, 127.0, "units");
        check.range("scheme.miss_step", self.miss_step, 1.0, 127.0, "units");
        check.range("scheme.occupancy_max", self.occupancy_max, 1.0, 127.0, "units");
        check.range("scheme.occupancy_min", self.occupancy_min, -127.0, 0.0, "units");
        check.range("scheme.confidence_step", self.confidence_step, 1.0, 255.0, "units");
        check.range("scheme.hit_ratio_min", self.hit_ratio_min, 0.0, 1.0, "");
    }
}

impl FadingConfig {
    fn validate(&self, check: &mut Checks) {
        check.range("fading.per_second", self.per_second, 0.0, 255.0, "units/s");
        check.range("fading.per_metre", self.per_metre, 0.0, 255.0, "units/m");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_have_no_fault() {
        assert_eq!(Config::default().validate(), vec![]);
    }

    #[test]
    fn all_faults_are_listed_with_key_value_and_what_is_allowed() {
        let mut config = Config { voxel_size_m: f64::NAN, snapshot_hz: 0.0, ..Default::default() };
        config.scheme.occupancy_max = 0;
        config.working_space_m[2] = 1e9;
        let faults = config.validate();
        let keys: Vec<_> = faults.iter().map(|f| f.key.as_str()).collect();
        let expected = ["voxel_size_m", "snapshot_hz", "working_space_m.2", "working_space_m", "scheme.occupancy_max"];
        assert_eq!(keys, expected);
        assert_eq!(faults[1].to_string(), "snapshot_hz = 0: allowed is from 0.1 to 50 Hz");
    }

    #[test]
    fn a_working_space_is_300_m_wide_at_most() {
        let of = |width_m| Config { working_space_m: [width_m, width_m, 12.0], ..Default::default() };
        assert_eq!((of(300.0).blocks_max(), of(300.0).validate()), (Some(BLOCKS_MAX), vec![]));
        let faults = of(310.0).validate();
        assert_eq!((faults.len(), faults[0].key.as_str()), (1, "working_space_m"));
    }
}
