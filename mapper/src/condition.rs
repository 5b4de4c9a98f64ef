//! How the mapper is: which of its sources are silent, in words.
//!
//! In: when each source was last heard, and now. Out: the state for the heartbeat. A pure function of both.

use crate::ladar_mount::LadarMount;
use crate::voxel_sensor::VoxelSensor;
use tsense_contract::ProcessState;
use tsense_geometry::Timestamp;

/// A source that was not heard for this long is missing, seconds: five poses of the slowest device (5 Hz).
const SILENT_S: f64 = 1.0;

/// When each source was last heard with something usable.
#[derive(Clone, Debug, Default)]
pub struct Heard {
    /// Poses.
    pub pose: Option<Timestamp>,
    /// Pan-tilt readings.
    pub joint: Option<Timestamp>,
    /// Scans, a ladar each.
    pub scans: Vec<Option<Timestamp>>,
    /// Voxels, a sensor each.
    pub voxels: Vec<Option<Timestamp>>,
    /// Scans that were placed and traced, and voxels that were measured and fused.
    pub traced: Option<Timestamp>,
}

/// What is to be heard.
#[derive(Clone, Copy, Debug)]
pub struct Sources<'a> {
    /// The ladars.
    pub mounts: &'a [LadarMount],
    /// Who else says what is occupied.
    pub voxel_sensors: &'a [VoxelSensor],
}

impl Heard {
    /// Nothing was heard yet.
    pub fn new(ladars: usize, voxel_sensors: usize) -> Self {
        Self { scans: vec![None; ladars], voxels: vec![None; voxel_sensors], ..Self::default() }
    }

    /// The state and its reason.
    pub fn condition(&self, sources: &Sources<'_>, now: Timestamp) -> (ProcessState, String) {
        let silent = |heard: &Option<Timestamp>| is_silent(heard, SILENT_S, now);
        let missing = self.missing(sources, now);
        if !silent(&self.traced) {
            return match missing.is_empty() {
                true => (ProcessState::Running, "placing and tracing scans".into()),
                false => (ProcessState::Degraded, format!("missing: {}", missing.join(", "))),
            };
        }
        let wanted = if missing.is_empty() { "scans that poses cover".into() } else { missing.join(", ") };
        match self.traced {
            None => (ProcessState::Starting, format!("waiting for {wanted}")),
            Some(_) if self.scans.iter().all(silent) => {
                (ProcessState::Stale, format!("the map ages; missing: {wanted}"))
            }
            Some(_) => (ProcessState::Degraded, format!("scans cannot be placed; missing: {wanted}")),
        }
    }

    fn missing(&self, &Sources { mounts, voxel_sensors }: &Sources<'_>, now: Timestamp) -> Vec<String> {
        let silent = |heard: &Option<Timestamp>| is_silent(heard, SILENT_S, now);
        let mut missing = Vec::new();
        for (mount, scan) in mounts.iter().zip(&self.scans) {
            if silent(scan) {
                missing.push(format!("scans of {}", mount.name));
            }
        }
        for (sensor, heard) in voxel_sensors.iter().zip(&self.voxels) {
            if sensor.silence_max_s > 0.0 && is_silent(heard, sensor.silence_max_s, now) {
                missing.push(format!("voxels of {}", sensor.name));
            }
        }
        if silent(&self.pose) {
            missing.push("poses".into());
        }
        if mounts.iter().any(|mount| mount.on_pan_tilt) && silent(&self.joint) {
            missing.push("pan-tilt readings".into());
        }
        missing
    }
}

fn is_silent(heard: &Option<Timestamp>, silent_s: f64, now: Timestamp) -> bool {
    heard.is_none_or(|then| now.seconds_since(then) > silent_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(pose: f64, joint: f64, scan: f64, traced: f64, expected: (ProcessState, &str)) {
        let at = |s: f64| (s > 0.0).then(|| Timestamp::from_seconds(s));
        let heard = Heard { pose: at(pose), joint: at(joint), traced: at(traced), ..Heard::new(1, 0) };
        let heard = Heard { scans: vec![at(scan)], ..heard };
        let sources = Sources { mounts: &[LadarMount::default()], voxel_sensors: &[] };
        let (state, reason) = heard.condition(&sources, Timestamp::from_seconds(10.0));
        assert_eq!((state, reason.as_str()), expected);
    }

    #[test]
    fn the_state_names_what_is_missing() {
        use ProcessState::{Degraded, Running, Stale, Starting};
        check(0.0, 0.0, 0.0, 0.0, (Starting, "waiting for scans of ladar, poses, pan-tilt readings"));
        check(9.9, 9.9, 9.9, 0.0, (Starting, "waiting for scans that poses cover"));
        check(9.9, 9.9, 9.9, 9.9, (Running, "placing and tracing scans"));
        check(8.0, 9.9, 9.9, 9.9, (Degraded, "missing: poses"));
        check(8.0, 9.9, 9.9, 8.5, (Degraded, "scans cannot be placed; missing: poses"));
        check(9.9, 9.9, 8.5, 8.5, (Stale, "the map ages; missing: scans of ladar"));
    }

    #[test]
    fn a_sensor_of_voxels_that_stops_is_told_after_its_own_time_and_carries_on_without_ladars() {
        let sensor = |name: &str, silence_max_s| VoxelSensor { name: name.into(), silence_max_s, ..Default::default() };
        let sensors = [sensor("stereo", 1.0), sensor("radar", 5.0), sensor("yesterday", 0.0)];
        let check = |scan_s: f64, stereo_s: f64, expected: (ProcessState, &str)| {
            let at = |s: f64| Some(Timestamp::from_seconds(s));
            let (scans, voxels) = (vec![at(scan_s)], vec![at(stereo_s), at(6.0), None]);
            let heard = Heard { pose: at(9.9), joint: at(9.9), scans, voxels, traced: at(scan_s.max(stereo_s)) };
            let sources = Sources { mounts: &[LadarMount::default()], voxel_sensors: &sensors };
            let (state, reason) = heard.condition(&sources, Timestamp::from_seconds(10.0));
            assert_eq!((state, reason.as_str()), expected);
        };
        check(9.9, 9.5, (ProcessState::Running, "placing and tracing scans"));
        check(9.9, 8.5, (ProcessState::Degraded, "missing: voxels of stereo"));
        check(8.5, 9.5, (ProcessState::Degraded, "missing: scans of ladar"));
        check(8.5, 8.5, (ProcessState::Stale, "the map ages; missing: scans of ladar, voxels of stereo"));
    }
}
