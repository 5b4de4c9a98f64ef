//! Instants as numbers: nanoseconds since the Unix epoch on the graph's clock.
//!
//! There is no `now()` here: time is an argument. The clock lives in `ports`, which anchors a monotonic
//! clock to the epoch once a graph, so stamps of all processes agree and never step backwards.

use serde::{Deserialize, Serialize};

/// Nanoseconds in a second.
pub const NS_PER_S: i64 = 1_000_000_000;

/// An instant, nanoseconds since 1970-01-01 UTC on the graph's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Timestamp {
    /// Nanoseconds since the epoch.
    pub ns: i64,
}

impl Timestamp {
    /// An instant from nanoseconds since the epoch.
    pub const fn from_ns(ns: i64) -> Self {
        Self { ns }
    }
    /// An instant from seconds since the epoch; saturates far outside, NaN becomes the epoch.
    pub fn from_seconds(seconds: f64) -> Self {
        Self::from_ns((seconds * NS_PER_S as f64).round() as i64)
    }
    /// Seconds since the epoch (a double keeps about 0.2 microseconds here: differences first, seconds last).
    pub fn as_seconds(self) -> f64 {
        self.ns as f64 / NS_PER_S as f64
    }
    /// Seconds from `earlier` to this instant, negative where it is the later one.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.ns.saturating_sub(earlier.ns) as f64 / NS_PER_S as f64
    }
    /// This instant moved by `seconds`, saturating.
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self::from_ns(self.ns.saturating_add((seconds * NS_PER_S as f64).round() as i64))
    }
    /// This instant moved by `ns` nanoseconds, saturating.
    pub fn plus_ns(self, ns: i64) -> Self {
        Self::from_ns(self.ns.saturating_add(ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_exact_and_ends_of_time_saturate() {
        let t = Timestamp::from_ns(1_700_000_000_123_456_789);
        assert_eq!(t.plus_ns(250).seconds_since(t), 250e-9);
        assert_eq!(t.plus_seconds(-1.0).ns, 1_699_999_999_123_456_789);
        assert_eq!(Timestamp::from_ns(i64::MAX).plus_seconds(9e9), Timestamp::from_ns(i64::MAX));
    }
}
