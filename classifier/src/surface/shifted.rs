//! The surface as several rasters of tiles see it, each shifted against the others.
//!
//! Where little ground shows, it depends on where the borders of tiles fall whether enough feet meet in one of them: one
//! plot's error changes by a factor of two. In: feet. Out: the mean of the surfaces at every node of the first raster, and
//! one sigma that holds how much they differ. Shifts are whole nodes of the finest level, so that its nodes coincide; no
//! two are alike in any coarser level.

use super::config::SHIFTS_MAX;
use super::{Foot, Heights, Level, Surface, SurfaceConfig, surface_of};
use tsense_geometry::RasterShape;

/// Shifts east and north, nodes of the finest level.
const SHIFTS: [[usize; 2]; SHIFTS_MAX] = [[0, 0], [10, 6], [7, 13], [13, 3], [4, 9], [2, 15]];
/// Share of the variance between the rasters that their mean has.
const BETWEEN_SHARE: f32 = 0.5;

/// The surface below the feet, or nothing where there is no foot.
pub fn mean_surface(feet: &[Foot], shape: RasterShape, config: &SurfaceConfig) -> Option<Surface> {
    let mut mean = surface_of(feet, shape, config)?;
    let level = mean.heights.level;
    let others = SHIFTS.iter().take(config.shifts).skip(1).map(|shift| shifted(feet, shape, level, *shift, config));
    let others = others.collect::<Option<Vec<Surface>>>()?;
    let count = 1.0 + others.len() as f32;
    for node in 0..level.len() {
        // Relative to the first: squares of heights far above the base would lose their digits.
        let first_m = mean.heights.height_m[node];
        let (mut off_m, mut square, mut variance) = (0.0, 0.0, mean.std_m[node].powi(2));
        for other in &others {
            let apart_m = other.heights.height_m[node] - first_m;
            (off_m, square) = (off_m + apart_m / count, square + apart_m * apart_m / count);
            variance += other.std_m[node].powi(2);
        }
        let between = (square - off_m * off_m).max(0.0) * count / (count - 1.0).max(1.0);
        mean.heights.height_m[node] = first_m + off_m;
        mean.std_m[node] = (variance / count + BETWEEN_SHARE * between).sqrt();
    }
    Some(mean)
}

/// The surface of a shifted raster, at the nodes of a level of the unshifted one.
fn shifted(
    feet: &[Foot],
    shape: RasterShape,
    level: Level,
    [east, north]: [usize; 2],
    config: &SurfaceConfig,
) -> Option<Surface> {
    let by_m = [east, north].map(|nodes| nodes as f32 * level.node_m);
    let moved = |foot: &Foot| Foot { at_m: [foot.at_m[0] + by_m[0], foot.at_m[1] + by_m[1], foot.at_m[2]], ..*foot };
    let feet: Vec<Foot> = feet.iter().map(moved).collect();
    let cells = (f64::from(level.node_m) / shape.cell_m).round() as usize;
    let first_cell = [shape.first_cell[0] - (east * cells) as i32, shape.first_cell[1] - (north * cells) as i32];
    let (width, height) = (shape.width + east * cells, shape.height + north * cells);
    let surface = surface_of(&feet, RasterShape { first_cell, width, height, ..shape }, config)?;
    let across = surface.heights.level.nodes.width;
    let at = |node: usize| (node / level.nodes.width + north) * across + node % level.nodes.width + east;
    Some(Surface {
        heights: Heights { level, height_m: (0..level.len()).map(|node| surface.heights.height_m[at(node)]).collect() },
        sight: (0..level.len()).map(|node| surface.sight[at(node)]).collect(),
        std_m: (0..level.len()).map(|node| surface.std_m[at(node)]).collect(),
    })
}
