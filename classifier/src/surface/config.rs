//! Configuration section `[classifier.ground.surface]`: the robust surface below all that was seen.

use serde::{Deserialize, Serialize};
use tsense_contract::Checks;

/// Most rasters of a surface.
pub const SHIFTS_MAX: usize = 6;

/// Section `[classifier.ground.surface]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceConfig {
    /// Distance between the nodes of the finest level, metres.
    pub node_m: f64,
    /// Distance between the nodes of the coarsest level, metres; each level halves it.
    pub coarsest_m: f64,
    /// How strongly ground bends: one sigma of the second difference of heights, metres per metre between nodes.
    pub bend: f64,
    /// Thickness of the layer above the lowest foot of a tile whose feet make the onset, metres.
    pub onset_m: f64,
    /// Feet in the onset from which a tile certainly shows ground; brush and grass have few feet at one height.
    pub onset_strong: usize,
    /// Feet in the onset from which a tile probably shows ground.
    pub onset_weak: usize,
    /// Least sine of the angle between the surface and the beams to the feet that make a tile certain: flatter ones all end in
    /// the top of grass, within the thickness of an onset.
    pub facing_min: f64,
    /// How a tile that shows no certain ground is distrusted: metres of one sigma per square metre of what such tiles
    /// deviate where ground is known beside them.
    pub distrust: f64,
    /// One sigma of how low a tile that shows no certain ground lies, where it lies below the surface, metres: the lowest foot of
    /// a few strays downwards as well, and would pull all ground beside it down with it.
    pub cover_std_m: f64,
    /// Height above the surface at which a certain tile loses half its weight, metres per metre between nodes.
    pub above: f64,
    /// Passes of weighing and solving, each level.
    pub passes: usize,
    /// Steps of the solver, each pass: gaps wider than these steps keep the coarser level's shape.
    pub steps: usize,
    /// Farthest from a cell that showed ground that the surface is still given, metres.
    pub reach_m: f64,
    /// Distance over which ground that was not seen returns to the plane of the ground that was, metres; 0: it does not.
    pub trend_m: f64,
    /// Growth of one sigma with the distance from certain ground, in bendings of the ground (metres per metre).
    pub growth: f64,
    /// Shifted rasters of tiles whose surfaces are averaged; each costs as much time as the first.
    pub shifts: usize,
    /// One sigma of a range, metres (LMS-151: 12 mm).
    pub range_std_m: f64,
    /// Full angle of a beam, radians (LMS-151: 15 mrad).
    pub beam_rad: f64,
    /// Depth within which the echoes of one beam melt into one, metres.
    pub echo_depth_m: f64,
}

impl Default for SurfaceConfig {
    fn default() -> Self {
        Self {
            node_m: 0.3,
            coarsest_m: 4.8,
            bend: 0.06,
            onset_m: 0.06,
            onset_strong: 8,
            onset_weak: 5,
            facing_min: 0.12,
            distrust: 75.0,
            cover_std_m: 0.0,
            above: 0.1,
            passes: 3,
            steps: 20,
            reach_m: 20.0,
            trend_m: 3.0,
            growth: 1.5,
            shifts: 1,
            range_std_m: 0.012,
            beam_rad: 0.015,
            echo_depth_m: 0.6,
        }
    }
}

impl SurfaceConfig {
    /// For a whole plot at leisure: it was seen from all sides, and there is time for several rasters. What shows no certain
    /// ground was chosen for no bias on 16 plots with truth.
    pub fn for_survey() -> Self {
        Self { facing_min: 0.0, shifts: 4, distrust: 50.0, cover_std_m: 0.02, growth: 0.78, ..Self::default() }
    }

    /// All faults of this section.
    pub(crate) fn check(&self, check: &mut Checks) {
        check.range("ground.surface.node_m", self.node_m, 0.05, 2.0, "m");
        check.range("ground.surface.coarsest_m", self.coarsest_m, self.node_m.max(0.05), 40.0, "m");
        check.range("ground.surface.bend", self.bend, 0.001, 5.0, "m per m");
        check.range("ground.surface.onset_m", self.onset_m, 0.01, 0.5, "m");
        check.count("ground.surface.onset_strong", self.onset_strong, 1, 1000, "feet");
        check.count("ground.surface.onset_weak", self.onset_weak, 1, self.onset_strong, "feet");
        check.range("ground.surface.facing_min", self.facing_min, 0.0, 1.0, "(sine)");
        check.range("ground.surface.distrust", self.distrust, 0.0, 1e4, "1 / m");
        check.range("ground.surface.cover_std_m", self.cover_std_m, 0.0, 1.0, "m");
        check.range("ground.surface.above", self.above, 0.001, 5.0, "m per m");
        check.count("ground.surface.passes", self.passes, 1, 20, "passes");
        check.count("ground.surface.steps", self.steps, 1, 1000, "steps");
        check.range("ground.surface.reach_m", self.reach_m, 0.0, 100.0, "m");
        check.range("ground.surface.trend_m", self.trend_m, 0.0, 100.0, "m");
        check.range("ground.surface.growth", self.growth, 0.0, 10.0, "bendings");
        check.count("ground.surface.shifts", self.shifts, 1, SHIFTS_MAX, "rasters");
        check.range("ground.surface.range_std_m", self.range_std_m, 0.001, 0.5, "m");
        check.range("ground.surface.beam_rad", self.beam_rad, 0.0, 0.1, "rad");
        check.range("ground.surface.echo_depth_m", self.echo_depth_m, 0.01, 5.0, "m");
    }
}
