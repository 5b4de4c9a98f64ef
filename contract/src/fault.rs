//! A fault in a configuration: what was given, and what is allowed.

/// One faulty value. Every stage's `Config::validate` lists all of its faults; nothing is repaired silently.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The key within its section, dots between levels: `ground.slope_max`.
    pub key: String,
    /// The value as given.
    pub value: String,
    /// What would be allowed, unit included: `from 0.05 to 1.0 m`.
    pub allowed: String,
}

impl Fault {
    /// A fault of one key.
    pub fn new(key: &str, value: impl std::fmt::Display, allowed: &str) -> Self {
        Self { key: key.into(), value: value.to_string(), allowed: allowed.into() }
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} = {}: allowed is {}", self.key, self.value, self.allowed)
    }
}

/// Checks the values of a section one by one, and keeps what is wrong with them.
#[derive(Debug, Default)]
pub struct Checks {
    prefix: String,
    faults: Vec<Fault>,
}

impl Checks {
    /// Of a section below the one that the reader knows: keys begin with its name and a dot.
    pub fn below(section: &str) -> Self {
        Self { prefix: format!("{section}."), faults: Vec::new() }
    }

    /// What must be true of a value.
    pub fn require(&mut self, is_right: bool, key: &str, value: impl std::fmt::Display, allowed: &str) {
        if !is_right {
            self.faults.push(Fault::new(&format!("{}{key}", self.prefix), value, allowed));
        }
    }

    /// A value between two others, these included; NaN is in no range.
    pub fn range(&mut self, key: &str, value: impl Into<f64> + Copy, low: f64, high: f64, unit: &str) {
        let value = value.into();
        self.require((low..=high).contains(&value), key, value, format!("from {low} to {high} {unit}").trim_end());
    }

    /// A whole number between two others, these included.
    pub fn count(&mut self, key: &str, value: usize, low: usize, high: usize, unit: &str) {
        self.require((low..=high).contains(&value), key, value, format!("from {low} to {high} {unit}").trim_end());
    }

    /// A value that must lie above that of another key; NaN lies above nothing.
    pub fn ordered(&mut self, key: &str, value: f64, low: f64, low_key: &str) {
        self.require(value > low, key, value, &format!("above {low_key} = {low}"));
    }

    /// An IP address with a port; `example` is one that fits.
    pub fn address(&mut self, key: &str, value: &str, example: &str) {
        let is_address = value.parse::<std::net::SocketAddr>().is_ok();
        self.require(is_address, key, value, &format!("an address and a port: {example}"));
    }

    /// Faults that were found elsewhere.
    pub fn extend(&mut self, faults: impl IntoIterator<Item = Fault>) {
        self.faults.extend(faults);
    }

    /// All faults, in the order of the checks.
    pub fn into_faults(self) -> Vec<Fault> {
        self.faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_outside_of_its_range_is_told_with_key_value_and_range() {
        let mut check = Checks::below("tree");
        check.range("inside", 1.0, 1.0, 2.0, "m");
        check.range("gate_m", 0.5, 1.0, 2.0, "m");
        check.range("share", f64::NAN, 0.0, 1.0, "");
        check.count("cells", 7, 1, 6, "cells");
        check.ordered("top_m", 1.0, 1.0, "start_m");
        check.address("listen", "nowhere", "127.0.0.1:8151");
        check.address("listen", "[::1]:0", "127.0.0.1:8151");
        check.require(false, "mode", "off", "on");
        let told: Vec<String> = check.into_faults().iter().map(Fault::to_string).collect();
        let expected = [
            "tree.gate_m = 0.5: allowed is from 1 to 2 m",
            "tree.share = NaN: allowed is from 0 to 1",
            "tree.cells = 7: allowed is from 1 to 6 cells",
            "tree.top_m = 1: allowed is above start_m = 1",
            "tree.listen = nowhere: allowed is an address and a port: 127.0.0.1:8151",
            "tree.mode = off: allowed is on",
        ];
        assert_eq!(told, expected);
    }
}
