//! How the mapper is: which of its sources are silent, in words.
//!
//! In: when each source was last heard, and now. Out: the state for the heartbeat. A pure function of both.

use crate::ladar_mount::LadarMount;
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
    /// Scans that were placed and traced.
    pub traced: Option<Timestamp>,
}

impl Heard {
    /// Nothing was heard yet.
    pub fn new(ladars: usize) -> Self {
        Self { scans: vec![None; ladars], ..Self::default() }
    }

    /// The state and its reason.
    pub fn condition(&self, mounts: &[LadarMount], now: Timestamp) -> (ProcessState, String) {
        let silent = |heard: &Option<Timestamp>| heard.is_none_or(|then| now.seconds_since(then) > SILENT_S);
        let missing = self.missing(mounts, silent);
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

    fn missing(&self, mounts: &[LadarMount], silent: impl Fn(&Option<Timestamp>) -> bool) -> Vec<String> {
        let mut missing = Vec::new();
        for (mount, scan) in mounts.iter().zip(&self.scans) {
            if silent(scan) {
                missing.push(format!("scans of {}", mount.name));
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

#[cfg(test)]
mod tests {
    use super::*;

    fn check(pose: f64, joint: f64, scan: f64, traced: f64, expected: (ProcessState, &str)) {
        let at = |s: f64| (s > 0.0).then(|| Timestamp::from_seconds(s));
        let heard = Heard { pose: at(pose), joint: at(joint), scans: vec![at(scan)], traced: at(traced) };
        let (state, reason) = heard.condition(&[LadarMount::default()], Timestamp::from_seconds(10.0));
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
}
