//! Which ground voxels are the ground: the surface that everything else stands on.
//!
//! In: a view and its voxels that passed the pyramid test. Out: a height per column where ground was seen, relative
//! to the view's base, NaN elsewhere. Canopy and brush over unknown space pass the pyramid test, too; they are
//! rejected here because ground cannot rise steeper than a stated slope from any other ground: first against an
//! absolute slope, then, with the terrain's trend taken off, against a gentler one and against the trend's own
//! deviation, from coarse to fine (in tall grass only few cells of a wide tile are ground, but its lowest is).
//! Lone cells are not believed.

use crate::column_bits::ColumnBits;
use crate::columns::View;
use crate::config::GroundConfig;
use crate::distance::lower_envelope;
use crate::plane_fit::{Plane, PlaneSums};
use tsense_geometry::Raster;

/// Radius within which other ground supports a cell, metres: neighbouring beams of 0.5 degrees are nearer up to 85 m.
const SUPPORT_RADIUS_M: f64 = 0.75;
/// Deviations of the trend by which ground may stand above it.
const TREND_DEVIATIONS: f64 = 2.5;

/// Heights of the columns in which ground was seen, metres above the view's base.
pub fn measured_heights(view: &View, ground: &ColumnBits, config: &GroundConfig) -> Raster<f32> {
    let mut heights = lowest_heights(view, ground, config.surface_in_voxel);
    reject_lone(&mut heights, config);
    let levels = heights.clone();
    reject_above(&mut heights, &levels, config.slope_max, config.tolerance_m);
    for tile_m in &config.trend_tiles_m {
        let (detail, limit) = above_trend(&heights, *tile_m, config);
        reject_above(&mut heights, &detail, config.detail_slope_max, config.tolerance_m);
        reject_beyond(&mut heights, &detail, &limit);
    }
    heights
}

/// The lowest ground voxel of each column; where the one above is ground, too, the surface lies between the two.
pub(crate) fn lowest_heights(view: &View, ground: &ColumnBits, surface_in_voxel: f64) -> Raster<f32> {
    let height_of = |column| match ground.lowest(column, 0, view.levels) {
        Some(level) => {
            let above = if ground.contains(column, level + 1) { 0.5 } else { 0.0 };
            ((level as f64 + surface_in_voxel + above) * view.shape.cell_m) as f32
        }
        None => f32::NAN,
    };
    let cells = (0..view.shape.len()).map(height_of).collect();
    Raster::from_cells(view.shape, cells).expect("a height a column")
}

/// Drops cells without `support_min` others nearby that one surface could connect them with.
pub(crate) fn reject_lone(heights: &mut Raster<f32>, config: &GroundConfig) {
    let shape = heights.shape();
    let offsets = offsets_by_distance((SUPPORT_RADIUS_M / shape.cell_m).round() as i32);
    let supports = |column: usize, row: usize, z: f32, (dx, dy): (i32, i32)| {
        let at = column.checked_add_signed(dx as isize).zip(row.checked_add_signed(dy as isize));
        let other = at.and_then(|(column, row)| heights.get(column, row)).copied().unwrap_or(f32::NAN);
        let reach = config.slope_max * f64::from(dx).hypot(f64::from(dy)) * shape.cell_m + config.tolerance_m;
        f64::from((other - z).abs()) <= reach
    };
    let mut lone = Vec::new();
    for (i, &z) in heights.cells().iter().enumerate().filter(|(_, z)| z.is_finite()) {
        let (column, row) = (i % shape.width, i / shape.width);
        let found = offsets.iter().filter(|&&offset| supports(column, row, z, offset)).take(config.support_min).count();
        if found < config.support_min {
            lone.push(i);
        }
    }
    for i in lone {
        heights.cells_mut()[i] = f32::NAN;
    }
}

/// All offsets within a square but its centre, the nearest first: support is usually next door.
fn offsets_by_distance(radius: i32) -> Vec<(i32, i32)> {
    let mut offsets: Vec<_> = (-radius..=radius).flat_map(|y| (-radius..=radius).map(move |x| (x, y))).collect();
    offsets.retain(|&offset| offset != (0, 0));
    offsets.sort_by_key(|&(x, y)| (x * x + y * y, y, x));
    offsets
}

/// Drops heights whose level is more than the tolerance above the lower envelope of all levels.
fn reject_above(heights: &mut Raster<f32>, levels: &Raster<f32>, slope: f64, tolerance_m: f64) {
    let shape = heights.shape();
    let known_or_high = |z: &f32| if z.is_finite() { *z } else { f32::INFINITY };
    let mut envelope: Vec<f32> = levels.cells().iter().map(known_or_high).collect();
    lower_envelope(&mut envelope, shape.width, (slope * shape.cell_m) as f32);
    for ((z, level), limit) in heights.cells_mut().iter_mut().zip(levels.cells()).zip(&envelope) {
        if level - limit > tolerance_m as f32 {
            *z = f32::NAN;
        }
    }
}

/// Drops heights whose level is above its own limit.
fn reject_beyond(heights: &mut Raster<f32>, levels: &Raster<f32>, limits: &Raster<f32>) {
    for ((z, level), limit) in heights.cells_mut().iter_mut().zip(levels.cells()).zip(limits.cells()) {
        if level > limit {
            *z = f32::NAN;
        }
    }
}

/// Heights above the trend of the lowest cells of tiles, and how far above it ground may stand: rough ground strays
/// from its trend, even ground does not. Where there is no trend, both are unknown and nothing is dropped.
fn above_trend(heights: &Raster<f32>, tile_m: f64, config: &GroundConfig) -> (Raster<f32>, Raster<f32>) {
    let shape = heights.shape();
    let trend = PlaneSums::of(&tile_minima(heights, tile_m));
    let radius = (2.0 * tile_m / shape.cell_m).round() as usize;
    let (mut detail, mut limits) = (heights.clone(), heights.map(|_| f32::NAN));
    for (i, z) in heights.cells().iter().enumerate().filter(|(_, z)| z.is_finite()) {
        let plane = trend.fit(i % shape.width, i / shape.width, radius, 6);
        detail.cells_mut()[i] = plane.map_or(f32::NAN, |plane| z - plane.height_m as f32);
        let limit = |plane: Plane| config.tolerance_m + TREND_DEVIATIONS * plane.deviation_m;
        limits.cells_mut()[i] = plane.map_or(f32::NAN, |plane| limit(plane) as f32);
    }
    (detail, limits)
}

/// Only the lowest cell of each tile, NaN elsewhere.
fn tile_minima(heights: &Raster<f32>, tile_m: f64) -> Raster<f32> {
    let shape = heights.shape();
    let edge = ((tile_m / shape.cell_m).round() as usize).max(1);
    let mut lowest = heights.map(|_| f32::NAN);
    for y in (0..shape.height).step_by(edge) {
        for x in (0..shape.width).step_by(edge) {
            let rows = y..(y + edge).min(shape.height);
            let cells = rows.flat_map(|row| (x..(x + edge).min(shape.width)).map(move |column| (column, row)));
            let known = cells.filter(|&at| heights[at].is_finite());
            if let Some(at) = known.min_by(|&a, &b| heights[a].total_cmp(&heights[b])) {
                lowest[at] = heights[at];
            }
        }
    }
    lowest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_geometry::VoxelGrid;

    /// Ground on a slope of 1 level in 3 columns, 40 x 40 columns, with changes by hand.
    fn kept(change: impl Fn(&mut ColumnBits)) -> Raster<f32> {
        let view = View::unknown(Window { first: [0; 3], size: [40, 40, 80] }, VoxelGrid::new(0.15).unwrap());
        let mut ground = ColumnBits::empty(1600, 80);
        for column in 0..1600 {
            ground.insert(column, 10 + (column % 40) / 3);
        }
        change(&mut ground);
        measured_heights(&view, &ground, &GroundConfig::default())
    }

    fn replace(ground: &mut ColumnBits, column: usize, level: Option<usize>) {
        *ground = {
            let mut other = ColumnBits::empty(1600, 80);
            for (i, l) in (0..1600).flat_map(|i| (0..80).map(move |l| (i, l))) {
                if i != column && ground.contains(i, l) {
                    other.insert(i, l);
                }
            }
            level.into_iter().for_each(|level| other.insert(column, level));
            other
        };
    }

    #[test]
    fn a_slope_is_kept_at_the_centres_of_its_voxels() {
        let heights = kept(|_| {});
        assert!(heights.cells().iter().all(|z| z.is_finite()));
        assert!((heights[(0, 0)] - 10.5 * 0.15).abs() < 1e-6);
    }

    #[test]
    fn canopy_without_ground_below_is_rejected_and_a_lone_pit_is_not_believed() {
        let heights = kept(|ground| {
            for row in 18..22 {
                for column in 18..22 {
                    replace(ground, row * 40 + column, Some(40));
                }
            }
            replace(ground, 5 * 40 + 5, Some(0));
        });
        assert!((18..22).all(|i| heights[(i, i)].is_nan()));
        assert!(heights[(5, 5)].is_nan(), "1.6 m below everything around");
        assert_eq!(heights.cells().iter().filter(|z| z.is_nan()).count(), 17);
    }

    #[test]
    fn knee_high_brush_on_a_slope_is_told_from_the_slope_itself() {
        let heights = kept(|ground| replace(ground, 20 * 40 + 20, Some(10 + 6 + 4)));
        assert!(heights[(20, 20)].is_nan(), "0.6 m above the slope");
        assert!(heights[(21, 20)].is_finite());
    }
}
