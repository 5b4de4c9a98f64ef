//! The ground height raster: seen, interpolated, from the vehicle's plane, extrapolated, each cell with its evidence.
//!
//! In: measured heights and the vehicle's plane. Out: a height, a standard deviation and an evidence per cell.
//! Heights are metres above `base_m`, which is metres above the ellipsoid. Source: thesis, "Finding Ground Surface".

use crate::config::{Config, GroundConfig, GroundMethod};
use crate::distance::nearest;
use crate::interpolation::interpolate;
use crate::plane_fit::PlaneSums;
use crate::tiles::tile_heights;
use crate::vehicle_plane::VehiclePlane;
use tsense_contract::GroundEvidence;
use tsense_geometry::Raster;

/// The ground of a view.
#[derive(Clone, Debug)]
pub struct Ground {
    /// What heights are relative to, metres above the ellipsoid.
    pub base_m: f64,
    /// Height above `base_m`, metres; NaN where unknown.
    pub height_m: Raster<f32>,
    /// One sigma of the height, metres; NaN where unknown.
    pub std_m: Raster<f32>,
    /// How each height is known.
    pub evidence: Raster<GroundEvidence>,
    /// Distance to the nearest measured cell, cells; infinite where nothing was measured.
    pub measured_at_cells: Vec<f32>,
}

/// The ground of a view, and the heights it rests on.
pub struct Found {
    /// The ground.
    pub ground: Ground,
    /// Height of the ground as it was met in each cell, metres above `base_m`; NaN where it was not.
    pub measured_m: Raster<f32>,
}

/// The thesis's ground raster from the cells in which ground was seen.
pub fn ground_raster(measured: &Raster<f32>, plane: Option<&VehiclePlane>, base_m: f64, config: &Config) -> Ground {
    let sums = PlaneSums::of(measured);
    let (measured_at_cells, _) = nearest(measured.cells().iter().map(|z| z.is_finite()), measured.shape().width);
    let mut ground = match config.ground.method {
        GroundMethod::Tiles => tiled(measured, base_m, &config.ground),
        GroundMethod::Interpolation | GroundMethod::Surface => interpolated(measured, &sums, base_m, &config.ground),
    };
    ground.measured_at_cells = measured_at_cells;
    if let Some(plane) = plane {
        ground.fill_from_plane(plane, config);
    }
    ground.extrapolate(&config.ground);
    ground.grow_deviations(&config.ground);
    ground
}

fn interpolated(measured: &Raster<f32>, sums: &PlaneSums, base_m: f64, config: &GroundConfig) -> Ground {
    let (smooth, std_m) = smoothed(measured, sums, config);
    let height_m = interpolate(&smooth, config.gap_max_m);
    Ground { base_m, evidence: evidence_of(measured, &height_m), height_m, std_m, measured_at_cells: Vec::new() }
}

fn tiled(measured: &Raster<f32>, base_m: f64, config: &GroundConfig) -> Ground {
    let (height_m, std_m) = tile_heights(measured, config);
    Ground { base_m, evidence: evidence_of(measured, &height_m), height_m, std_m, measured_at_cells: Vec::new() }
}

fn evidence_of(measured: &Raster<f32>, heights: &Raster<f32>) -> Raster<GroundEvidence> {
    let mut evidence = heights.map(|z| if z.is_nan() { GroundEvidence::Unknown } else { GroundEvidence::Interpolated });
    for ((evidence, seen), known) in evidence.cells_mut().iter_mut().zip(measured.cells()).zip(heights.cells()) {
        if seen.is_finite() && known.is_finite() {
            *evidence = GroundEvidence::Measured;
        }
    }
    evidence
}

/// Measured heights on the plane of their neighbours: voxels quantise heights by their edge, several of them average
/// that out. The deviation is what the plane leaves unexplained, shared by its cells, and never below a floor.
fn smoothed(measured: &Raster<f32>, sums: &PlaneSums, config: &GroundConfig) -> (Raster<f32>, Raster<f32>) {
    let shape = measured.shape();
    let radius = (config.smoothing_radius_m / shape.cell_m).round() as usize;
    let quantisation_m = shape.cell_m / 12f64.sqrt();
    let (mut heights, mut stds) = (measured.clone(), measured.map(|_| f32::NAN));
    for (i, &z) in measured.cells().iter().enumerate().filter(|(_, z)| z.is_finite()) {
        let plane = if radius > 0 { sums.fit(i % shape.width, i / shape.width, radius, 6) } else { None };
        let std_m = match plane {
            Some(plane) => config.std_measured_m.hypot(plane.deviation_m * 0.5),
            None => config.std_measured_m.hypot(quantisation_m),
        };
        heights.cells_mut()[i] = plane.map_or(z, |plane| plane.height_m as f32);
        stds.cells_mut()[i] = std_m as f32;
    }
    (heights, stds)
}

impl Ground {
    fn fill_from_plane(&mut self, plane: &VehiclePlane, config: &Config) {
        let shape = self.height_m.shape();
        let radius = (config.vehicle.plane_radius_m / shape.cell_m).ceil() as usize;
        let Some((column, row)) = shape.cell_at(plane.below.x(), plane.below.y()) else { return };
        for row in row.saturating_sub(radius)..(row + radius + 1).min(shape.height) {
            for column in column.saturating_sub(radius)..(column + radius + 1).min(shape.width) {
                let [easting, northing] = shape.center_of(column, row);
                let distance_m = (easting - plane.below.x()).hypot(northing - plane.below.y());
                let at = (column, row);
                if distance_m <= config.vehicle.plane_radius_m && self.height_m[at].is_nan() {
                    self.height_m[at] = (plane.height_m(easting, northing) - self.base_m) as f32;
                    self.std_m[at] = config.vehicle.plane_std_m as f32;
                    self.evidence[at] = GroundEvidence::VehiclePlane;
                }
            }
        }
    }

    /// Unknown cells continue the plane around the nearest known cell.
    fn extrapolate(&mut self, config: &GroundConfig) {
        let shape = self.height_m.shape();
        let reach = (config.extrapolation_max_m / shape.cell_m) as f32;
        let (distance, source) = nearest(self.height_m.cells().iter().map(|z| z.is_finite()), shape.width);
        if !distance.iter().any(|&d| d > 0.0 && d <= reach) {
            return;
        }
        let sums = PlaneSums::of(&self.height_m);
        for i in 0..distance.len() {
            if distance[i] > 0.0 && distance[i] <= reach {
                let at = (i % shape.width, i / shape.width);
                let from = (source[i] as usize % shape.width, source[i] as usize / shape.width);
                self.height_m[at] = continued(&sums, self.height_m[from], from, at, shape.cell_m);
                self.evidence[at] = GroundEvidence::Extrapolated;
            }
        }
    }

    /// One sigma of every known cell: its source's, grown with the distance to where ground was seen.
    fn grow_deviations(&mut self, config: &GroundConfig) {
        let shape = self.height_m.shape();
        let (distance, source) = nearest(self.std_m.cells().iter().map(|std| std.is_finite()), shape.width);
        for i in 0..distance.len() {
            let z = self.height_m.cells()[i];
            let grown_m = f64::from(distance[i]) * shape.cell_m * config.std_growth;
            let source_m = f64::from(self.std_m.cells()[source[i] as usize]);
            self.std_m.cells_mut()[i] = if z.is_nan() { f32::NAN } else { source_m.hypot(grown_m) as f32 };
        }
    }
}

/// The height at `at` on the plane around the known cell `from`; level where there are too few cells for a plane.
fn continued(sums: &PlaneSums, height_m: f32, from: (usize, usize), at: (usize, usize), cell_m: f64) -> f32 {
    // The plane rests on a circle as wide as what it is continued by, and at least a metre.
    let steps = [at.0 as f64 - from.0 as f64, at.1 as f64 - from.1 as f64];
    let radius = (steps[0].hypot(steps[1]) as usize).max((1.0 / cell_m) as usize);
    let slope = sums.fit(from.0, from.1, radius, 9).map_or([0.0; 2], |plane| plane.slope);
    height_m + ((slope[0] * steps[0] + slope[1] * steps[1]) * cell_m) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::{Attitude, Point, RasterShape, global_from_vehicle};

    /// Ground rising 0.2 to the east, seen only where `seen` says; 60 x 60 cells of 0.15 m.
    fn slope(seen: impl Fn(usize, usize) -> bool) -> Raster<f32> {
        let shape = RasterShape { first_cell: [1000, 2000], width: 60, height: 60, cell_m: 0.15 };
        let cell = |i: usize| if seen(i % 60, i / 60) { 1.0 + 0.03 * (i % 60) as f32 } else { f32::NAN };
        Raster::from_cells(shape, (0..3600).map(cell).collect()).unwrap()
    }

    #[test]
    fn a_slope_is_continued_and_every_cell_says_how_it_is_known() {
        let measured = slope(|column, row| column < 40 && column % 3 == 0 && row % 2 == 0);
        let ground = ground_raster(&measured, None, 40.0, &Config::default());
        let evidence = |c, r| ground.evidence[(c, r)];
        assert_eq!(evidence(3, 2), GroundEvidence::Measured);
        assert_eq!(evidence(4, 3), GroundEvidence::Interpolated);
        assert_eq!(evidence(50, 20), GroundEvidence::Extrapolated);
        for (column, row) in [(3, 2), (4, 3), (50, 20), (59, 59)] {
            let error = ground.height_m[(column, row)] - (1.0 + 0.03 * column as f32);
            assert!(error.abs() < 0.02, "{column} {row}: {error}");
        }
        assert!(ground.std_m[(59, 20)] > ground.std_m[(45, 20)] && ground.std_m[(45, 20)] > ground.std_m[(3, 2)]);
    }

    #[test]
    fn far_from_all_ground_the_height_stays_unknown() {
        let config = Config {
            ground: GroundConfig { extrapolation_max_m: 1.5, ..GroundConfig::default() },
            ..Config::default()
        };
        let ground = ground_raster(&slope(|column, _| column < 20), None, 0.0, &config);
        assert_eq!(ground.evidence[(29, 30)], GroundEvidence::Extrapolated);
        assert_eq!(ground.evidence[(40, 30)], GroundEvidence::Unknown);
        assert!(ground.height_m[(40, 30)].is_nan() && ground.std_m[(40, 30)].is_nan());
        let none = ground_raster(&slope(|_, _| false), None, 0.0, &config);
        assert!(none.height_m.cells().iter().all(|z| z.is_nan()));
    }

    #[test]
    fn the_vehicles_plane_fills_what_no_beam_reaches_around_it() {
        let pose = global_from_vehicle(Attitude::default(), Point::new(1030.0 * 0.15, 2030.0 * 0.15, 42.0));
        let plane = VehiclePlane::below(&pose, 0.5).unwrap();
        let ground = ground_raster(&slope(|column, _| column > 55), Some(&plane), 40.0, &Config::default());
        assert_eq!(ground.evidence[(30, 30)], GroundEvidence::VehiclePlane);
        assert!((ground.height_m[(30, 30)] - 1.5).abs() < 1e-5);
        assert_eq!(ground.evidence[(57, 30)], GroundEvidence::Measured);
    }

    #[test]
    fn the_coarse_tiles_are_selectable() {
        let mut config = Config::default();
        config.ground.method = GroundMethod::Tiles;
        let ground = ground_raster(&slope(|column, row| (column + row) % 3 == 0), None, 0.0, &config);
        assert_eq!(ground.height_m[(0, 0)], ground.height_m[(19, 19)]);
        assert!(ground.height_m[(20, 0)] - ground.height_m[(19, 0)] > 0.5, "the step effect");
    }
}
