//! Configuration section `[classifier.moving]`: what is taken to move, and how long it is shown.

use serde::{Deserialize, Serialize};
use tsense_contract::Checks;

/// Section `[classifier.moving]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MovingConfig {
    /// Fewest returns in space that was free before, within a second, and fewest voxels that something left; fewer are insects,
    /// leaves and errors.
    pub returns_min: usize,
    /// Least height from the lowest to the highest of them, metres: what one snapshot shows of a body.
    pub height_min_m: f64,
    /// Cells in which something that moves was met must not be driven for so long, seconds: about until the head has looked
    /// there again.
    pub hold_s: f64,
    /// Its returns count for nothing else for so long, seconds: as long as returns are kept.
    pub keep_s: f64,
}

impl Default for MovingConfig {
    fn default() -> Self {
        Self { returns_min: 6, height_min_m: 0.3, hold_s: 2.5, keep_s: 30.0 }
    }
}

impl MovingConfig {
    /// All faults of this section.
    pub(crate) fn check(&self, check: &mut Checks) {
        check.count("moving.returns_min", self.returns_min, 3, 10_000, "returns");
        check.range("moving.height_min_m", self.height_min_m, 0.1, 5.0, "m");
        check.range("moving.hold_s", self.hold_s, 0.0, 60.0, "s");
        check.range("moving.keep_s", self.keep_s, self.hold_s.max(0.1), 3600.0, "s");
    }
}
