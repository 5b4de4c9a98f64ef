//! The thesis's alternative ground: the average height of coarse tiles, sparse and uneven ones rejected.
//!
//! In: measured heights, NaN where unknown. Out: the tile's mean in every cell of an accepted tile, NaN elsewhere,
//! and the tile's standard deviation. It steps on slopes; that is why it is the alternative (figure 2-12).

use crate::config::GroundConfig;
use tsense_geometry::Raster;

/// Mean and standard deviation of the accepted tiles, cell by cell.
pub fn tile_heights(heights: &Raster<f32>, config: &GroundConfig) -> (Raster<f32>, Raster<f32>) {
    let shape = heights.shape();
    let edge = ((config.tile_m / shape.cell_m).round() as usize).max(1);
    let (mut means, mut stds) = (heights.map(|_| f32::NAN), heights.map(|_| f32::NAN));
    for y in (0..shape.height).step_by(edge) {
        for x in (0..shape.width).step_by(edge) {
            let (x_end, y_end) = ((x + edge).min(shape.width), (y + edge).min(shape.height));
            let cells = || (y..y_end).flat_map(move |row| (x..x_end).map(move |column| (column, row)));
            let Some((mean, std)) = accepted(cells().map(|at| heights[at]), config) else { continue };
            for at in cells() {
                (means[at], stds[at]) = (mean, std);
            }
        }
    }
    (means, stds)
}

/// Mean and deviation of a tile's known heights, or nothing where they are too few or too uneven.
fn accepted(heights: impl Iterator<Item = f32>, config: &GroundConfig) -> Option<(f32, f32)> {
    let known: Vec<f64> = heights.filter(|z| z.is_finite()).map(f64::from).collect();
    if known.len() < config.tile_cells_min {
        return None;
    }
    let n = known.len() as f64;
    let mean = known.iter().sum::<f64>() / n;
    let std = (known.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / n).sqrt();
    (std <= config.tile_std_max_m).then_some((mean as f32, std as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::RasterShape;

    #[test]
    fn an_even_tile_gets_its_mean_and_sparse_or_uneven_ones_nothing() {
        let shape = RasterShape { first_cell: [0, 0], width: 6, height: 2, cell_m: 0.5 };
        let nan = f32::NAN;
        let cells = vec![1.0, 1.2, nan, 5.0, 0.0, 9.0, 1.4, nan, nan, nan, 3.0, 4.0];
        let heights = Raster::from_cells(shape, cells).unwrap();
        let config = GroundConfig { tile_m: 1.0, tile_cells_min: 3, tile_std_max_m: 0.5, ..GroundConfig::default() };
        let (means, stds) = tile_heights(&heights, &config);
        assert!((means[(1, 1)] - 1.2).abs() < 1e-6 && (stds[(1, 1)] - 0.163_299).abs() < 1e-4);
        assert!(means[(2, 0)].is_nan(), "one cell of three wanted");
        assert!(means[(4, 0)].is_nan(), "0, 9, 3, 4 are uneven");
    }
}
