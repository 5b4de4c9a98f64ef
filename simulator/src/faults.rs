//! What may go wrong on a wire, on request. Everything is off by default.
//!
//! Written as `key=value` on the command line (`--fault drop_every=10`), as plain fields in a file. A value of 0
//! switches a fault off. Not every device can have every fault; each device's module says which it takes.

use serde::{Deserialize, Serialize};

/// Faults of one device's link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Faults {
    /// Every n-th telegram is never sent.
    pub drop_every: u32,
    /// Every n-th telegram is sent twice.
    pub duplicate_every: u32,
    /// Telegrams leave in pieces of this many bytes (97 is a good one).
    pub fragment_bytes: u32,
    /// This many telegrams leave in one write.
    pub coalesce: u32,
    /// Before every n-th telegram comes an event nobody asked for.
    pub stray_every: u32,
    /// Every n-th telegram has a wrong checksum (or, without checksums, a broken end).
    pub bad_checksum_every: u32,
    /// A connection is cut this long after it was made, world seconds.
    pub disconnect_after_s: f64,
    /// From here on nothing leaves for `stall_for_s`, world seconds after the start.
    pub stall_at_s: f64,
    /// Length of the stall, world seconds.
    pub stall_for_s: f64,
    /// The device's clock runs this much too fast, parts per million.
    pub clock_drift_ppm: f64,
    /// The device's microsecond counter wraps this long after the start, world seconds.
    pub wrap_after_s: f64,
    /// Contamination from the start: 0 none, 1 warning, 2 error, 3 fatal.
    pub contamination: u32,
}

impl Faults {
    /// Sets one fault from `key=value`.
    pub fn set(&mut self, text: &str) -> Result<(), String> {
        let (key, value) =
            text.split_once('=').ok_or_else(|| format!("'{text}' is not key=value; {}", Self::keys()))?;
        let number: f64 =
            value.parse().ok().filter(|n: &f64| n.is_finite()).ok_or_else(|| format!("{key}={value}: not a number"))?;
        let whole = || {
            let fits = number >= 0.0 && number <= f64::from(u32::MAX) && number.fract() == 0.0;
            if fits { Ok(number as u32) } else { Err(format!("{key}={value}: not a whole number of at least 0")) }
        };
        match key {
            "drop_every" => self.drop_every = whole()?,
            "duplicate_every" => self.duplicate_every = whole()?,
            "fragment_bytes" => self.fragment_bytes = whole()?,
            "coalesce" => self.coalesce = whole()?,
            "stray_every" => self.stray_every = whole()?,
            "bad_checksum_every" => self.bad_checksum_every = whole()?,
            "contamination" => self.contamination = whole()?,
            "disconnect_after_s" => self.disconnect_after_s = number,
            "stall_at_s" => self.stall_at_s = number,
            "stall_for_s" => self.stall_for_s = number,
            "clock_drift_ppm" => self.clock_drift_ppm = number,
            "wrap_after_s" => self.wrap_after_s = number,
            _ => return Err(format!("there is no fault '{key}'; {}", Self::keys())),
        }
        Ok(())
    }

    fn keys() -> &'static str {
        "faults: drop_every, duplicate_every, fragment_bytes, coalesce, stray_every, bad_checksum_every, \
         disconnect_after_s, stall_at_s, stall_for_s, clock_drift_ppm, wrap_after_s, contamination"
    }

    /// True while nothing may leave.
    pub fn stalled(&self, world_s: f64) -> bool {
        self.stall_for_s > 0.0 && world_s >= self.stall_at_s && world_s < self.stall_at_s + self.stall_for_s
    }

    /// True for a connection that has lived long enough.
    pub fn cut(&self, connected_s: f64) -> bool {
        self.disconnect_after_s > 0.0 && connected_s >= self.disconnect_after_s
    }
}

/// True for every n-th of a count that starts at 1; never for n = 0.
pub(crate) fn every(n: u32, count: u64) -> bool {
    n > 0 && count.is_multiple_of(u64::from(n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_read_from_text_and_a_wrong_one_is_told() {
        let mut faults = Faults::default();
        faults.set("drop_every=10").unwrap();
        faults.set("clock_drift_ppm=-7.5").unwrap();
        assert_eq!((faults.drop_every, faults.clock_drift_ppm), (10, -7.5));
        assert!(faults.set("drop_every=-1").unwrap_err().contains("whole number"));
        assert!(faults.set("explode=1").unwrap_err().contains("drop_every"));
        assert!(faults.set("drop_every").is_err() && faults.set("stall_at_s=NaN").is_err());
    }

    #[test]
    fn a_stall_begins_and_ends_and_every_third_is_every_third() {
        let faults = Faults { stall_at_s: 5.0, stall_for_s: 2.0, ..Faults::default() };
        assert_eq!([4.9, 5.0, 6.9, 7.0].map(|t| faults.stalled(t)), [false, true, true, false]);
        assert_eq!([1, 2, 3, 6, 7].map(|n| every(3, n)), [false, false, true, true, false]);
        assert!(!every(0, 5));
    }
}
