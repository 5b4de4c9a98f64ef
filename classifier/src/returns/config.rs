//! Configuration section `[classifier.returns]`: what is kept of the beams, and how much of it.

use serde::{Deserialize, Serialize};
use tsense_contract::Checks;

/// Section `[classifier.returns]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReturnsConfig {
    /// Beams whose origins lie in one cube with this edge share a station, metres.
    pub station_m: f64,
    /// Longest that a station gathers beams, seconds: a vehicle that stands opens a new one, and the old ones age.
    pub station_s: f64,
    /// Whether a ladar sends one echo a beam, the strongest, as the LMS-151 does; else it is read off the beams.
    pub single_echo: bool,
    /// Edge of the cells of direction in which a station's beams are counted, radians.
    pub cell_rad: f64,
    /// Most beams of a station in one cell of direction; the newest stay.
    pub per_cell_max: usize,
    /// Most beams of all stations, 20 bytes each; the oldest station goes first.
    pub beams_max: usize,
    /// Most stations; the oldest goes first.
    pub stations_max: usize,
    /// Stations whose newest beam is older than this are forgotten, seconds: the pose drifts.
    pub age_max_s: f64,
}

impl Default for ReturnsConfig {
    fn default() -> Self {
        Self {
            station_m: 0.25,
            station_s: 8.0,
            single_echo: true,
            // A quarter of a degree: the finest step of the LMS-151, a third of its beam's width.
            cell_rad: 0.00436,
            per_cell_max: 4,
            // 8 MB: what one ladar sends in 15 s, which is twenty sweeps.
            beams_max: 400_000,
            stations_max: 512,
            age_max_s: 30.0,
        }
    }
}

impl ReturnsConfig {
    /// For recorded rays: they do not age, and the whole plot is wanted. 24 million beams are 480 MB.
    pub fn for_survey() -> Self {
        Self {
            station_s: 1e9,
            single_echo: false,
            age_max_s: 1e9,
            beams_max: 24_000_000,
            stations_max: 65_536,
            per_cell_max: 8,
            ..Self::default()
        }
    }

    /// All faults of this section.
    pub(crate) fn check(&self, check: &mut Checks) {
        check.range("returns.station_m", self.station_m, 0.02, 2.0, "m");
        check.range("returns.station_s", self.station_s, 0.1, 1e9, "s");
        check.range("returns.cell_rad", self.cell_rad, 0.001, 0.1, "rad");
        check.count("returns.per_cell_max", self.per_cell_max, 1, 1000, "beams");
        check.count("returns.beams_max", self.beams_max, 1000, 100_000_000, "beams");
        check.count("returns.stations_max", self.stations_max, 1, 65_536, "stations");
        check.range("returns.age_max_s", self.age_max_s, 0.1, 1e9, "s");
    }
}
