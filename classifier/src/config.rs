//! Configuration section `[classifier]`: every tunable the thesis names, and what we added, with defaults beside.

use crate::moving::MovingConfig;
use crate::returns::ReturnsConfig;
use crate::stems::config::StemsConfig;
use crate::surface::SurfaceConfig;
use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};

/// Section `[classifier]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Which trunk detector works: `stems` fits stems to beams, `thesis` is the convolution of the column density (2-16).
    pub detector: Detector,
    /// Size of the classified space around the vehicle along east, north, up, metres.
    pub window_m: [f64; 3],
    /// Least confidence of a voxel that counts as known.
    pub voxel_confidence_min: u8,
    /// Store of returns, for fits finer than a voxel.
    pub returns: ReturnsConfig,
    /// Ground surface.
    pub ground: GroundConfig,
    /// The vehicle, for the plane it stands on (2-11) to (2-15) and what it must clear.
    pub vehicle: VehicleConfig,
    /// Column density above ground.
    pub density: DensityConfig,
    /// Trunks as in the thesis.
    pub trunk: TrunkConfig,
    /// Stems.
    pub stems: StemsConfig,
    /// Brush.
    pub brush: BrushConfig,
    /// Things that move.
    pub moving: MovingConfig,
    /// Traversability.
    pub traversability: TraversabilityConfig,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            detector: Detector::Stems,
            window_m: [30.0, 30.0, 12.0],
            voxel_confidence_min: 1,
            returns: ReturnsConfig::default(),
            ground: GroundConfig::default(),
            vehicle: VehicleConfig::default(),
            density: DensityConfig::default(),
            trunk: TrunkConfig::default(),
            stems: StemsConfig::default(),
            brush: BrushConfig::default(),
            moving: MovingConfig::default(),
            traversability: TraversabilityConfig::default(),
        }
    }
}

/// A trunk detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Detector {
    /// Stems fitted to the beams themselves; where no returns were kept, as `thesis`.
    Stems,
    /// Column density, convolution, threshold, clustering, as in the thesis.
    Thesis,
}

/// How ground heights become a raster.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundMethod {
    /// A smooth surface below all that was seen, finer than voxels where the returns were kept.
    Surface,
    /// Linear interpolation along x then y and y then x, averaged, then extrapolation.
    Interpolation,
    /// The average of coarse tiles.
    Tiles,
}

/// Section `[classifier.ground]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GroundConfig {
    /// Depth below a ground voxel that the pyramid test leaves out, metres: range noise reaches a little below a surface.
    pub pyramid_start_m: f64,
    /// Depth of the inverted pyramid below a ground voxel, metres.
    pub pyramid_depth_m: f64,
    /// Steepness of the pyramid's faces, rise over run: ground steeper than this is not found.
    pub pyramid_slope: f64,
    /// `surface`, or the thesis's `interpolation` and its alternative `tiles`.
    pub method: GroundMethod,
    /// The method `surface`.
    pub surface: SurfaceConfig,
    /// Steepest ground that is believed between two cells, rise over run.
    pub slope_max: f64,
    /// How far a cell may stand above what its neighbourhood allows, metres.
    pub tolerance_m: f64,
    /// Steepest ground that is believed against the local trend of the surface, rise over run.
    pub detail_slope_max: f64,
    /// Edges of the tiles whose lowest cells make the local trend, one pass each, metres; none leaves these passes out.
    pub trend_tiles_m: Vec<f64>,
    /// Other ground cells nearby that a cell needs to be believed.
    pub support_min: usize,
    /// Radius over which measured heights are smoothed by a plane, metres; 0 leaves them quantised by the voxel.
    pub smoothing_radius_m: f64,
    /// Height of the surface above a ground voxel's lower face, as a share of the voxel.
    pub surface_in_voxel: f64,
    /// Widest gap that is interpolated across along a row or a column, metres.
    pub gap_max_m: f64,
    /// Farthest from known ground that is extrapolated to, metres.
    pub extrapolation_max_m: f64,
    /// Edge of a coarse tile, metres; the thesis tried 1 to 5 m (1 to 25 m^2).
    pub tile_m: f64,
    /// Fewest ground cells of a tile; below it the tile is rejected as sparse.
    pub tile_cells_min: usize,
    /// Largest standard deviation of heights in a tile, metres; above it the tile is rejected as uneven.
    pub tile_std_max_m: f64,
    /// One sigma of a smoothed, measured cell on even ground, metres.
    pub std_measured_m: f64,
    /// How one sigma grows with the distance to the nearest measured cell, metres per metre.
    pub std_growth: f64,
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self {
            pyramid_start_m: 0.15,
            pyramid_depth_m: 1.5,
            pyramid_slope: 1.0,
            method: GroundMethod::Surface,
            surface: SurfaceConfig::default(),
            slope_max: 0.9,
            tolerance_m: 0.2,
            detail_slope_max: 0.2,
            trend_tiles_m: vec![8.0, 4.0, 2.0, 1.0],
            support_min: 2,
            smoothing_radius_m: 0.45,
            surface_in_voxel: 0.5,
            gap_max_m: 3.0,
            extrapolation_max_m: 5.0,
            tile_m: 3.0,
            tile_cells_min: 8,
            tile_std_max_m: 0.5,
            std_measured_m: 0.03,
            std_growth: 0.05,
        }
    }
}

/// Section `[classifier.vehicle]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleConfig {
    /// Whether the vehicle's attitude gives the ground below it (2-11).
    pub plane: bool,
    /// Height of the vehicle frame's origin above the ground it stands on, along the vehicle's z, metres (r1 of 2-14).
    pub origin_height_m: f64,
    /// Radius around the vehicle's origin in which the plane is used where no ground was seen, metres.
    pub plane_radius_m: f64,
    /// Room the vehicle needs above ground, metres.
    pub clearance_m: f64,
    /// One sigma of the plane's height below the vehicle, metres.
    pub plane_std_m: f64,
}

impl Default for VehicleConfig {
    fn default() -> Self {
        Self { plane: true, origin_height_m: 0.0, plane_radius_m: 2.5, clearance_m: 2.2, plane_std_m: 0.08 }
    }
}

/// Section `[classifier.density]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DensityConfig {
    /// Height above ground at which counting starts, metres.
    pub start_m: f64,
    /// Height above ground up to which it counts, metres: an object that tall can reach density 1.
    pub top_m: f64,
    /// What a free voxel costs, in occupied voxels (the tree variant's penalty).
    pub free_penalty: f64,
}

impl Default for DensityConfig {
    fn default() -> Self {
        Self { start_m: 0.3, top_m: 2.5, free_penalty: 1.0 }
    }
}

/// Section `[classifier.trunk]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrunkConfig {
    /// Edge of the convolution kernel, cells, odd (2-16).
    pub kernel_cells: usize,
    /// Radius of the kernel's large centre, metres.
    pub kernel_center_m: f64,
    /// Radius up to which the kernel is neutral around its centre, metres.
    pub kernel_neutral_m: f64,
    /// Sum of the kernel's negative outside, in sums of its centre.
    pub kernel_outside: f64,
    /// Fall-off: width over which the kernel goes from one value to the next, metres.
    pub kernel_falloff_m: f64,
    /// Least response that is kept.
    pub threshold: f64,
    /// Range of heights above ground that decides whether a candidate is a trunk, metres.
    pub proof_m: [f64; 2],
    /// Least share of those heights at which the candidate is occupied.
    pub fill_min: f64,
    /// Largest share of free among the known voxels of the candidate's core: rays that pass veto a trunk.
    pub free_share_max: f64,
    /// Largest extent of a candidate, metres; walls and big objects are no trees.
    pub extent_max_m: f64,
    /// Largest ratio of a candidate's long to its short side.
    pub elongation_max: f64,
    /// Largest share of occupied voxels in a ring around the candidate: brush and walls go on, trunks stand alone.
    pub surround_max: f64,
    /// Least height of a tree above ground, metres.
    pub height_min_m: f64,
    /// Most of a ladar beam's widening of a trunk, metres: taken off its diameter.
    pub beam_width_m: f64,
    /// Least share of the circumference beside which free space was seen.
    pub arc_min: f64,
}

impl Default for TrunkConfig {
    fn default() -> Self {
        Self {
            kernel_cells: 11,
            kernel_center_m: 0.2,
            kernel_neutral_m: 0.45,
            kernel_outside: 1.0,
            kernel_falloff_m: 0.1,
            threshold: 0.12,
            proof_m: [0.3, 2.5],
            fill_min: 0.7,
            free_share_max: 0.35,
            extent_max_m: 1.5,
            elongation_max: 3.0,
            surround_max: 0.3,
            height_min_m: 2.0,
            beam_width_m: 0.0,
            arc_min: 0.25,
        }
    }
}

/// Section `[classifier.brush]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BrushConfig {
    /// Height above ground below which nothing counts as brush, metres: the ground's own voxels and their noise.
    pub start_m: f64,
    /// Height above which vegetation is canopy, metres.
    pub top_m: f64,
    /// Narrowest vertical gap that ends brush, metres: what hangs above a wider one is canopy.
    pub gap_max_m: f64,
    /// Narrowest vertical gap below canopy, which goes on above the tallest brush, metres.
    pub canopy_gap_m: f64,
    /// Columns this near share a profile, metres: one column is met too rarely to show its own gaps.
    pub around_m: f64,
    /// Half the width of the widest hole in brush that is filled, metres; 0 fills none.
    pub fill_m: f64,
}

impl Default for BrushConfig {
    fn default() -> Self {
        Self { start_m: 0.2, top_m: 3.0, gap_max_m: 0.8, canopy_gap_m: 0.2, around_m: 0.45, fill_m: 0.45 }
    }
}

/// Section `[classifier.traversability]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TraversabilityConfig {
    /// Radius of the plane that gives slope and roughness, metres.
    pub radius_m: f64,
    /// Slope that must not be driven, rise over run.
    pub slope_max: f64,
    /// Deviation from the local plane that must not be driven, one sigma, metres.
    pub roughness_max_m: f64,
    /// Step between neighbouring cells that must not be driven, metres.
    pub step_max_m: f64,
    /// Brush of this height costs as much as is possible without being lethal, metres.
    pub brush_max_m: f64,
    /// Share of occupied voxels above ground, up to the vehicle's clearance, from which something is solid.
    pub solid_density: f64,
    /// Depth below the expected ground from which a hole is a drop, metres.
    pub drop_depth_m: f64,
    /// Shortest stretch without ground behind an edge that is a drop, metres.
    pub drop_gap_min_m: f64,
    /// Largest step between the angles of beams, radians: ground farther apart than this explains is expected to be seen.
    pub beam_step_rad: f64,
    /// Widest ditch or hole that is told from a valley by its depth, metres.
    pub drop_width_max_m: f64,
    /// Height of the ladar above ground, metres, where no return says from where it came.
    pub ladar_height_m: f64,
}

impl Default for TraversabilityConfig {
    fn default() -> Self {
        Self {
            radius_m: 0.45,
            slope_max: 0.6,
            roughness_max_m: 0.15,
            step_max_m: 0.3,
            brush_max_m: 1.5,
            solid_density: 0.6,
            drop_depth_m: 0.4,
            drop_gap_min_m: 0.6,
            beam_step_rad: 0.02,
            drop_width_max_m: 2.5,
            ladar_height_m: 1.8,
        }
    }
}

impl Config {
    /// For a survey: the whole plot at once, and time to spare.
    pub fn for_survey() -> Self {
        let ground = GroundConfig { surface: SurfaceConfig::for_survey(), ..GroundConfig::default() };
        // Seen from all sides, brush has no holes but its own.
        let brush = BrushConfig { fill_m: 0.0, ..BrushConfig::default() };
        Self { returns: ReturnsConfig::for_survey(), ground, brush, ..Self::default() }
    }

    /// All faults of this section.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        for (axis, size) in ["0", "1", "2"].iter().zip(self.window_m) {
            check.range(&format!("window_m.{axis}"), size, 2.0, 300.0, "m");
        }
        self.returns.check(&mut check);
        self.ground.check(&mut check);
        self.vehicle.check(&mut check);
        self.density.check(&mut check);
        self.trunk.check(&mut check);
        self.stems.check(&mut check);
        self.brush.check(&mut check);
        self.moving.check(&mut check);
        self.traversability.check(&mut check);
        check.into_faults()
    }
}

impl GroundConfig {
    fn check(&self, check: &mut Checks) {
        check.range("ground.pyramid_start_m", self.pyramid_start_m, 0.0, 1.0, "m");
        check.range("ground.pyramid_depth_m", self.pyramid_depth_m, 0.1, 5.0, "m");
        check.range("ground.pyramid_slope", self.pyramid_slope, 0.3, 10.0, "(rise over run)");
        check.range("ground.slope_max", self.slope_max, 0.1, 5.0, "(rise over run)");
        check.range("ground.tolerance_m", self.tolerance_m, 0.05, 2.0, "m");
        check.range("ground.detail_slope_max", self.detail_slope_max, 0.05, 5.0, "(rise over run)");
        check.count("ground.trend_tiles_m", self.trend_tiles_m.len(), 0, 8, "tile edges");
        for (i, tile_m) in self.trend_tiles_m.iter().enumerate() {
            check.range(&format!("ground.trend_tiles_m.{i}"), *tile_m, 0.3, 20.0, "m");
        }
        check.count("ground.support_min", self.support_min, 0, 50, "cells");
        check.range("ground.smoothing_radius_m", self.smoothing_radius_m, 0.0, 3.0, "m");
        check.range("ground.surface_in_voxel", self.surface_in_voxel, 0.0, 1.5, "voxels");
        check.range("ground.gap_max_m", self.gap_max_m, 0.0, 50.0, "m");
        check.range("ground.extrapolation_max_m", self.extrapolation_max_m, 0.0, 50.0, "m");
        check.range("ground.tile_m", self.tile_m, 0.5, 10.0, "m");
        check.count("ground.tile_cells_min", self.tile_cells_min, 1, 10_000, "cells");
        check.range("ground.tile_std_max_m", self.tile_std_max_m, 0.01, 10.0, "m");
        check.range("ground.std_measured_m", self.std_measured_m, 0.001, 1.0, "m");
        check.range("ground.std_growth", self.std_growth, 0.0, 5.0, "m per m");
        self.surface.check(check);
    }
}

impl VehicleConfig {
    fn check(&self, check: &mut Checks) {
        check.range("vehicle.origin_height_m", self.origin_height_m, -5.0, 10.0, "m");
        check.range("vehicle.plane_radius_m", self.plane_radius_m, 0.0, 10.0, "m");
        check.range("vehicle.clearance_m", self.clearance_m, 0.3, 10.0, "m");
        check.range("vehicle.plane_std_m", self.plane_std_m, 0.001, 2.0, "m");
    }
}

impl DensityConfig {
    fn check(&self, check: &mut Checks) {
        check.range("density.start_m", self.start_m, 0.0, 5.0, "m");
        check.range("density.top_m", self.top_m, 0.3, 20.0, "m");
        check.ordered("density.top_m", self.top_m, self.start_m, "density.start_m");
        check.range("density.free_penalty", self.free_penalty, 0.0, 10.0, "occupied voxels");
    }
}

impl TrunkConfig {
    fn check(&self, check: &mut Checks) {
        check.count("trunk.kernel_cells", self.kernel_cells, 3, 41, "cells, odd");
        let is_odd = !self.kernel_cells.is_multiple_of(2);
        check.require(is_odd, "trunk.kernel_cells", self.kernel_cells, "an odd number from 3 to 41");
        check.range("trunk.kernel_center_m", self.kernel_center_m, 0.05, 2.0, "m");
        check.range("trunk.kernel_neutral_m", self.kernel_neutral_m, 0.05, 3.0, "m");
        check.ordered("trunk.kernel_neutral_m", self.kernel_neutral_m, self.kernel_center_m, "trunk.kernel_center_m");
        check.range("trunk.kernel_outside", self.kernel_outside, 0.0, 10.0, "centre sums");
        check.range("trunk.kernel_falloff_m", self.kernel_falloff_m, 0.001, 2.0, "m");
        check.range("trunk.threshold", self.threshold, 0.0, 1.0, "(density)");
        check.range("trunk.proof_m.0", self.proof_m[0], 0.0, 5.0, "m");
        check.range("trunk.proof_m.1", self.proof_m[1], 0.3, 20.0, "m");
        check.ordered("trunk.proof_m.1", self.proof_m[1], self.proof_m[0], "trunk.proof_m.0");
        check.range("trunk.fill_min", self.fill_min, 0.0, 1.0, "(share)");
        check.range("trunk.free_share_max", self.free_share_max, 0.0, 1.0, "(share)");
        check.range("trunk.extent_max_m", self.extent_max_m, 0.1, 10.0, "m");
        check.range("trunk.elongation_max", self.elongation_max, 1.0, 100.0, "(ratio)");
        check.range("trunk.surround_max", self.surround_max, 0.0, 1.0, "(share)");
        check.range("trunk.height_min_m", self.height_min_m, 0.0, 20.0, "m");
        check.range("trunk.beam_width_m", self.beam_width_m, 0.0, 1.0, "m");
        check.range("trunk.arc_min", self.arc_min, 0.0, 1.0, "(share)");
    }
}

impl BrushConfig {
    fn check(&self, check: &mut Checks) {
        check.range("brush.start_m", self.start_m, 0.0, 2.0, "m");
        check.range("brush.top_m", self.top_m, 0.2, 5.0, "m");
        check.ordered("brush.top_m", self.top_m, self.start_m, "brush.start_m");
        check.range("brush.gap_max_m", self.gap_max_m, 0.0, 10.0, "m");
        check.range("brush.canopy_gap_m", self.canopy_gap_m, 0.0, 10.0, "m");
        check.range("brush.around_m", self.around_m, 0.0, 3.0, "m");
        check.range("brush.fill_m", self.fill_m, 0.0, 2.0, "m");
    }
}

impl TraversabilityConfig {
    fn check(&self, check: &mut Checks) {
        check.range("traversability.radius_m", self.radius_m, 0.1, 3.0, "m");
        check.range("traversability.slope_max", self.slope_max, 0.05, 5.0, "(rise over run)");
        check.range("traversability.roughness_max_m", self.roughness_max_m, 0.01, 2.0, "m");
        check.range("traversability.step_max_m", self.step_max_m, 0.01, 5.0, "m");
        check.range("traversability.brush_max_m", self.brush_max_m, 0.1, 10.0, "m");
        check.range("traversability.solid_density", self.solid_density, 0.0, 1.0, "(share)");
        check.range("traversability.drop_depth_m", self.drop_depth_m, 0.1, 10.0, "m");
        check.range("traversability.drop_gap_min_m", self.drop_gap_min_m, 0.1, 10.0, "m");
        check.range("traversability.drop_width_max_m", self.drop_width_max_m, 0.2, 10.0, "m");
        check.range("traversability.beam_step_rad", self.beam_step_rad, 0.0001, 0.5, "rad");
        check.range("traversability.ladar_height_m", self.ladar_height_m, 0.1, 20.0, "m");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_have_no_fault() {
        assert_eq!(Config::default().validate(), []);
    }

    #[test]
    fn every_fault_is_listed_with_its_key_and_range() {
        let mut config = Config::default();
        config.window_m[2] = f64::NAN;
        config.trunk.kernel_cells = 10;
        config.density.top_m = 0.3;
        config.ground.gap_max_m = -1.0;
        let keys: Vec<_> = config.validate().iter().map(|fault| fault.key.clone()).collect();
        assert_eq!(keys, ["window_m.2", "ground.gap_max_m", "density.top_m", "trunk.kernel_cells"]);
    }
}
