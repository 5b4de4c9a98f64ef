//! Brush: how high the vegetation stands that is no trunk and no canopy.
//!
//! In: the view, the columns above ground, the trunks' columns. Out: metres above ground per cell, 0 where no brush
//! was seen, NaN where the ground is unknown. Brush is followed upwards from the ground; a gap of free space wider
//! than stated ends it, and what hangs above is canopy. Source: thesis, "Estimating the Height of Above Ground Objects".

use crate::columns::View;
use crate::config::BrushConfig;
use crate::density::Columns;
use crate::ground::Ground;
use tsense_geometry::Raster;

/// Height of brush per cell.
pub fn brush_heights(
    view: &View,
    ground: &Ground,
    columns: &Columns,
    trunks: &Raster<bool>,
    config: &BrushConfig,
) -> Raster<f32> {
    let mut heights = ground.height_m.map(|z| if z.is_nan() { f32::NAN } else { 0.0 });
    for (i, height) in heights.cells_mut().iter_mut().enumerate().filter(|(_, height)| !height.is_nan()) {
        if !trunks.cells()[i] && columns.ground_level[i] >= 0 {
            *height = column_height_m(view, i, f64::from(ground.height_m.cells()[i]), config) as f32;
        }
    }
    heights
}

fn column_height_m(view: &View, column: usize, ground_m: f64, config: &BrushConfig) -> f64 {
    let cell_m = view.shape.cell_m;
    let gap_max = (config.gap_max_m / cell_m).round() as usize;
    let level = |height_m: f64| ((ground_m + height_m) / cell_m).ceil().max(0.0) as usize;
    let (start, end) = (level(config.start_m), level(config.top_m));
    let (mut at, mut top, mut voxels) = (start, None, 0);
    while let Some(next) = view.touched.lowest(column, at, end) {
        // Unknown space inside brush is brush that was not seen; only space that beams passed is a gap.
        if view.free.count(column, at, next) > gap_max {
            break;
        }
        (at, top, voxels) = (next + 1, Some(next), voxels + 1);
    }
    match top {
        Some(top) if voxels >= config.voxels_min => (top as f64 + 0.5) * cell_m - ground_m,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_geometry::VoxelGrid;

    /// One column drawn from the ground up: `#` occupied, `.` free, `?` unknown; 0.1 m a voxel.
    fn height_of(drawing: &str) -> f64 {
        let mut view = View::unknown(Window { first: [0; 3], size: [4, 4, 40] }, VoxelGrid::new(0.1).unwrap());
        for (level, voxel) in drawing.chars().enumerate() {
            match voxel {
                '#' => view.touched.insert(0, level),
                '.' => view.free.insert(0, level),
                _ => {}
            }
        }
        let config = BrushConfig { start_m: 0.2, top_m: 3.0, gap_max_m: 0.3, voxels_min: 1 };
        column_height_m(&view, 0, 0.0, &config)
    }

    #[test]
    fn brush_grows_from_the_ground_through_small_gaps_and_ends_below_what_hangs() {
        assert!((height_of("####") - 0.35).abs() < 1e-9);
        assert!((height_of("##.#..#") - 0.65).abs() < 1e-9);
        assert!((height_of("####.....####") - 0.35).abs() < 1e-9, "canopy above a clearance");
        assert!((height_of("####?????##") - 1.05).abs() < 1e-9, "unseen inside is brush");
        assert_eq!(height_of("##......##"), 0.0, "nothing but ground and canopy");
        assert_eq!(height_of("##"), 0.0, "the ground's own voxels are no brush");
    }
}
