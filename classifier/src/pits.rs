//! Pits: places that lie deep below the ground on both sides of them, whatever that ground's slope.
//!
//! In: ground heights, metres, NaN where unknown. Out: how far below its rims each cell lies. A rim is the highest known
//! ground within a stated distance on one side of the cell; a pit lies below the lower of two opposite rims, in the
//! direction where that is most. A slope, a step and a hump have no rim on one side; nor has the edge of what is known.
//! Source: the closing by line segments of grey-scale morphology (Serra 1982).

use tsense_geometry::Raster;

/// East, north and the two diagonals.
const DIRECTIONS: [[isize; 2]; 4] = [[1, 0], [0, 1], [1, 1], [1, -1]];

/// Depth of each cell below its rims, metres, NaN where unknown; rims are at most `width_m` apart.
pub fn pit_depths(ground_m: &Raster<f32>, width_m: f64) -> Raster<f32> {
    let cell_m = ground_m.shape().cell_m;
    let mut depths = ground_m.map(|z| if z.is_nan() { f32::NAN } else { 0.0 });
    for [east, north] in DIRECTIONS {
        let step_m = (east as f64).hypot(north as f64) * cell_m;
        let reach = (width_m / 2.0 / step_m).ceil() as isize;
        let ahead = rims(ground_m, [east, north], reach);
        let back = rims(ground_m, [-east, -north], reach);
        for (depth, (z, (a, b))) in
            depths.cells_mut().iter_mut().zip(ground_m.cells().iter().zip(ahead.iter().zip(&back)))
        {
            *depth = depth.max(a.min(*b) - z);
        }
    }
    depths
}

/// The highest ground from each cell along a direction, itself included: the raster is moved step by step, row by row.
fn rims(ground_m: &Raster<f32>, [east, north]: [isize; 2], reach: isize) -> Vec<f32> {
    let (shape, z) = (ground_m.shape(), ground_m.cells());
    let mut rims = z.to_vec();
    for k in 1..=reach {
        let (columns, rows) = (moved(shape.width, k * east), moved(shape.height, k * north));
        for row in rows {
            let other = row.wrapping_add_signed(k * north) * shape.width;
            let from = columns.start.wrapping_add_signed(k * east);
            let others = &z[other + from..][..columns.len()];
            for (rim, z) in rims[row * shape.width..][columns.clone()].iter_mut().zip(others) {
                // NaN is not higher than anything.
                *rim = if *z > *rim { *z } else { *rim };
            }
        }
    }
    rims
}

/// The cells along an axis that have one so many steps on.
fn moved(count: usize, steps: isize) -> std::ops::Range<usize> {
    let cut = steps.unsigned_abs().min(count);
    if steps < 0 { cut..count } else { 0..count - cut }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::RasterShape;

    /// Depths on 40 x 40 cells of 0.15 m, pits up to 2 m wide.
    fn depths(height: impl Fn(f32, f32) -> f32) -> Raster<f32> {
        let shape = RasterShape { first_cell: [0, 0], width: 40, height: 40, cell_m: 0.15 };
        let cell = |i: usize| height((i % 40) as f32 * 0.15, (i / 40) as f32 * 0.15);
        pit_depths(&Raster::from_cells(shape, (0..1600).map(cell).collect()).unwrap(), 2.0)
    }

    #[test]
    fn a_ditch_across_a_slope_is_as_deep_as_it_is_and_its_banks_are_not() {
        let depth = depths(|x, y| 0.3 * y - if (2.0..3.5).contains(&x) { 0.9 } else { 0.0 });
        assert!((depth[(18, 20)] - 0.9).abs() < 1e-5);
        assert!(depth[(10, 20)].abs() < 1e-5 && depth[(30, 20)].abs() < 1e-5);
    }

    #[test]
    fn a_slope_a_hump_a_step_and_a_wide_valley_are_no_pits() {
        let even: [fn(f32, f32) -> f32; 4] = [
            |x, y| 0.4 * x - 0.2 * y,
            |x, y| if (x - 3.0).hypot(y - 3.0) < 0.8 { 0.7 } else { 0.0 },
            |x, _| if x > 3.0 { 1.0 } else { 0.0 },
            |x, _| 0.1 * (x - 3.0).abs(),
        ];
        for height in even {
            let worst = depths(height).cells().iter().copied().fold(0.0, f32::max);
            assert!(worst < 0.12, "{worst}");
        }
    }

    #[test]
    fn unknown_cells_are_passed_over_and_stay_unknown() {
        let depth = depths(|x, _| {
            if (1.0..1.3).contains(&x) {
                f32::NAN
            } else if (2.0..3.0).contains(&x) {
                -0.6
            } else {
                0.0
            }
        });
        assert!(depth[(7, 5)].is_nan() && (depth[(16, 5)] - 0.6).abs() < 1e-6);
    }
}
