//! Configuration section `[classifier.stems]`: the beam's width, where stems are looked for, what proves one.

use serde::{Deserialize, Serialize};
use tsense_contract::Checks;

/// Section `[classifier.stems]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StemsConfig {
    /// How much wider a beam gets with its way, radians: 15 mrad for the LMS-151.
    pub beam_divergence_rad: f64,
    /// Diameter of a beam where it leaves the ladar, metres.
    pub beam_exit_m: f64,
    /// Share of a beam's width that sees edges where the ladar sends several echoes: the rim carries too little energy. Read
    /// off beams beside stems of known diameter; nearness to what is right makes millimetres of every diameter.
    pub beam_seen_share: f64,
    /// How far what beams meet first lies outside the surface whose area the diameter tells, metres: bark has ridges. It
    /// is taken off where the ladar sends several echoes, for then edges are known as well.
    pub bark_m: f64,
    /// One sigma of a beam's light across it, as a share of half its width: where a ladar sends one echo, the strongest, how
    /// far beside a stem it sees it depends on that and on what is behind.
    pub beam_sigma_share: f64,
    /// Range at which a stem that fills a beam is just seen, metres: bark sends a third of what a white wall does.
    pub beam_reach_m: f64,
    /// One sigma of a range, metres.
    pub range_std_m: f64,
    /// Range of heights above ground from which stems are fitted, metres.
    pub fit_m: [f64; 2],
    /// Farthest that a stem is fitted from, metres.
    pub range_max_m: f64,
    /// Smallest radius of a stem, metres.
    pub radius_min_m: f64,
    /// Largest radius of a stem, metres.
    pub radius_max_m: f64,
    /// Height of the slices in which a stem must show itself, metres.
    pub slice_m: f64,
    /// Fewest slices with returns that make a candidate.
    pub candidate_slices_min: usize,
    /// Most beams that a stem is fitted to; the work is bounded by leaving out every second, third ... one.
    pub beams_max: usize,
    /// Most candidates that one snapshot of the live system judges; the others wait for the next one.
    pub judged_max: usize,
    /// Fewest beams that hit a stem.
    pub hits_min: usize,
    /// Fewest slices in which it is solid.
    pub solid_slices_min: usize,
    /// Largest share of beams that pass where it should stand: rays that pass veto a stem.
    pub passed_share_max: f64,
    /// Least share of the beams that end near a stem that end at its surface: those in brush end everywhere.
    pub solid_share_min: f64,
    /// Largest mean distance of echoes from the surface, metres: leaves return at any depth.
    pub roughness_max_m: f64,
    /// Least difference between the shares of beams that end in it and beside it: brush ends beams everywhere.
    pub contrast_min: f64,
    /// Largest lean from vertical, radians.
    pub lean_max_rad: f64,
    /// Least height of a tree above ground, metres.
    pub height_min_m: f64,
}

impl Default for StemsConfig {
    fn default() -> Self {
        Self {
            beam_divergence_rad: 0.015,
            beam_exit_m: 0.008,
            beam_seen_share: 0.77,
            bark_m: 0.003,
            // 0.5 is a disc of even light; the simulator's beam has 0.41.
            beam_sigma_share: 0.4,
            beam_reach_m: 30.0,
            range_std_m: 0.015,
            fit_m: [0.4, 4.4],
            range_max_m: 20.0,
            radius_min_m: 0.0175,
            radius_max_m: 0.6,
            slice_m: 0.25,
            candidate_slices_min: 4,
            beams_max: 1500,
            judged_max: 16,
            hits_min: 6,
            solid_slices_min: 4,
            passed_share_max: 0.25,
            solid_share_min: 0.4,
            roughness_max_m: 0.028,
            contrast_min: 0.2,
            lean_max_rad: 0.35,
            height_min_m: 2.5,
        }
    }
}

impl StemsConfig {
    /// All faults of this section.
    pub(crate) fn check(&self, check: &mut Checks) {
        check.range("stems.beam_divergence_rad", self.beam_divergence_rad, 0.0, 0.1, "rad");
        check.range("stems.beam_exit_m", self.beam_exit_m, 0.0, 0.5, "m");
        check.range("stems.beam_seen_share", self.beam_seen_share, 0.0, 1.0, "(share)");
        check.range("stems.bark_m", self.bark_m, 0.0, 0.1, "m");
        check.range("stems.beam_sigma_share", self.beam_sigma_share, 0.0, 1.0, "(share)");
        check.range("stems.beam_reach_m", self.beam_reach_m, 1.0, 200.0, "m");
        check.range("stems.range_std_m", self.range_std_m, 0.001, 0.5, "m");
        check.range("stems.fit_m.0", self.fit_m[0], 0.0, 5.0, "m");
        check.range("stems.fit_m.1", self.fit_m[1], 0.5, 20.0, "m");
        check.ordered("stems.fit_m.1", self.fit_m[1], self.fit_m[0], "stems.fit_m.0");
        check.range("stems.range_max_m", self.range_max_m, 1.0, 100.0, "m");
        check.range("stems.radius_min_m", self.radius_min_m, 0.0, 1.0, "m");
        check.range("stems.radius_max_m", self.radius_max_m, 0.05, 3.0, "m");
        check.range("stems.slice_m", self.slice_m, 0.05, 1.0, "m");
        check.count("stems.candidate_slices_min", self.candidate_slices_min, 1, 32, "slices");
        check.count("stems.beams_max", self.beams_max, 50, 100_000, "beams");
        check.count("stems.judged_max", self.judged_max, 1, 100_000, "candidates");
        check.count("stems.hits_min", self.hits_min, 3, 1000, "beams");
        check.count("stems.solid_slices_min", self.solid_slices_min, 1, 32, "slices");
        check.range("stems.passed_share_max", self.passed_share_max, 0.0, 1.0, "(share)");
        check.range("stems.solid_share_min", self.solid_share_min, 0.0, 1.0, "(share)");
        check.range("stems.roughness_max_m", self.roughness_max_m, 0.0, 1.0, "m");
        check.range("stems.contrast_min", self.contrast_min, 0.0, 1.0, "(share)");
        check.range("stems.lean_max_rad", self.lean_max_rad, 0.0, 1.5, "rad");
        check.range("stems.height_min_m", self.height_min_m, 0.0, 20.0, "m");
    }
}
