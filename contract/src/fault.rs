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
