//! Rates, ages and drops as the bridge sees them. Time is an argument.

use serde_json::{Value, json};
use std::collections::BTreeMap;
use tsense_geometry::Timestamp;

/// Time over which a rate is averaged, seconds.
const RATE_WINDOW_S: f64 = 2.0;

/// Counts things and knows how many came a second.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rate {
    window_start: Option<Timestamp>,
    in_window: u64,
    per_s: f64,
}

impl Rate {
    /// Counts `n` things at `now`.
    pub fn count(&mut self, n: u64, now: Timestamp) {
        self.roll(now);
        self.in_window += n;
    }

    /// Things a second over the last full window; 0 when nothing came for two windows.
    pub fn per_second(&mut self, now: Timestamp) -> f64 {
        self.roll(now);
        self.per_s
    }

    fn roll(&mut self, now: Timestamp) {
        let elapsed_s = now.seconds_since(*self.window_start.get_or_insert(now));
        if elapsed_s >= RATE_WINDOW_S {
            self.per_s = self.in_window as f64 / elapsed_s;
            (self.window_start, self.in_window) = (Some(now), 0);
        }
    }
}

/// What the bridge counts.
#[derive(Clone, Debug, Default)]
pub struct Counters {
    /// Beams of all ladars.
    pub beams: Rate,
    /// Scans of all ladars.
    pub scans: Rate,
    /// Complete snapshots.
    pub snapshots: Rate,
    /// Number of the newest complete snapshot, its blocks and visible voxels.
    pub map: (u64, usize, usize),
    /// Stamps of the newest data by layer.
    pub newest: BTreeMap<&'static str, Timestamp>,
    /// Drops by cause.
    pub drops: BTreeMap<&'static str, u64>,
}

impl Counters {
    /// Counts a drop.
    pub fn dropped(&mut self, cause: &'static str, n: usize) {
        if n > 0 {
            *self.drops.entry(cause).or_default() += n as u64;
        }
    }

    /// Age of a layer's newest data, milliseconds.
    pub fn age_ms(&self, layer: &str, now: Timestamp) -> Option<f64> {
        self.newest.get(layer).map(|stamp| (now.seconds_since(*stamp) * 1e3).round())
    }

    /// As the viewer and `/health` read them.
    pub fn to_json(&mut self, now: Timestamp, clients: usize) -> Value {
        let ages: serde_json::Map<String, Value> =
            self.newest.keys().map(|layer| ((*layer).to_owned(), json!(self.age_ms(layer, now)))).collect();
        let (snapshot, blocks, voxels) = self.map;
        json!({
            "beams_per_s": self.beams.per_second(now).round(),
            "scans_per_s": (self.scans.per_second(now) * 10.0).round() / 10.0,
            "snapshots_per_s": (self.snapshots.per_second(now) * 10.0).round() / 10.0,
            "snapshot": snapshot,
            "blocks": blocks,
            "voxels": voxels,
            "age_ms": ages,
            "clients": clients,
            "dropped": self.drops,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(1000.0 + seconds)
    }

    #[test]
    fn a_rate_is_what_came_in_the_last_window_and_fades_to_zero() {
        let mut rate = Rate::default();
        for i in 0..=40 {
            rate.count(541, at(f64::from(i) * 0.05));
        }
        assert_eq!(rate.per_second(at(2.0)), 40.0 * 541.0 / 2.0);
        rate.per_second(at(4.5));
        assert_eq!(rate.per_second(at(7.0)), 0.0);
    }

    #[test]
    fn ages_and_drops_are_told() {
        let mut counters = Counters::default();
        counters.newest.insert("grid", at(0.0));
        counters.dropped("zone", 2);
        counters.dropped("shape", 0);
        let json = counters.to_json(at(0.25), 3);
        assert_eq!(json["age_ms"]["grid"], 250.0);
        assert_eq!(json["dropped"], serde_json::json!({"zone": 2}));
        assert_eq!(json["clients"], 3);
    }
}
