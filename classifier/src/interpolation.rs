//! Ground between the cells where it was seen: linear along rows and columns, in both orders, averaged.
//!
//! In: heights, NaN where unknown, and the widest gap that is bridged. Out: the same raster with gaps filled; cells
//! that no line reaches stay NaN. It never changes a known height and never extrapolates.
//! Source: thesis, "Finding Ground Surface", figure 2-13.

use tsense_geometry::Raster;

/// Fills gaps of at most `gap_max_m` between known cells.
pub fn interpolate(heights: &Raster<f32>, gap_max_m: f64) -> Raster<f32> {
    let gap_max = (gap_max_m / heights.shape().cell_m + 1e-9).floor() as usize;
    let x_then_y = along_columns(along_rows(heights.clone(), gap_max), gap_max);
    let y_then_x = along_rows(along_columns(heights.clone(), gap_max), gap_max);
    let mut both = x_then_y;
    for (a, b) in both.cells_mut().iter_mut().zip(y_then_x.cells()) {
        *a = match (a.is_nan(), b.is_nan()) {
            (false, false) => (*a + b) / 2.0,
            (true, _) => *b,
            (false, true) => *a,
        };
    }
    both
}

fn along_rows(mut heights: Raster<f32>, gap_max: usize) -> Raster<f32> {
    let shape = heights.shape();
    for row in heights.cells_mut().chunks_exact_mut(shape.width.max(1)) {
        let mut last = None;
        for here in 0..row.len() {
            if row[here].is_finite() {
                if let Some(last) = last {
                    bridge(row, 0, 1, last, here, gap_max);
                }
                last = Some(here);
            }
        }
    }
    heights
}

/// Row after row with the last known cell of every column remembered: memory is walked in its own order.
fn along_columns(mut heights: Raster<f32>, gap_max: usize) -> Raster<f32> {
    let shape = heights.shape();
    let mut last: Vec<Option<usize>> = vec![None; shape.width];
    for row in 0..shape.height {
        for (column, last) in last.iter_mut().enumerate() {
            if heights.cells()[row * shape.width + column].is_finite() {
                if let Some(last) = *last {
                    bridge(heights.cells_mut(), column, shape.width, last, row, gap_max);
                }
                *last = Some(row);
            }
        }
    }
    heights
}

/// Fills the cells between two known ones on a line (`first + i * stride`) where they are near enough.
fn bridge(cells: &mut [f32], first: usize, stride: usize, from: usize, to: usize, gap_max: usize) {
    let gap = to - from;
    if gap > gap_max {
        return;
    }
    let (a, b) = (cells[first + from * stride], cells[first + to * stride]);
    for i in 1..gap {
        cells[first + (from + i) * stride] = a + (b - a) * i as f32 / gap as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::RasterShape;

    const N: f32 = f32::NAN;

    fn raster(width: usize, cells: &[f32]) -> Raster<f32> {
        let shape = RasterShape { first_cell: [0, 0], width, height: cells.len() / width, cell_m: 1.0 };
        Raster::from_cells(shape, cells.to_vec()).unwrap()
    }

    #[test]
    fn a_row_is_bridged_up_to_the_gap_limit_and_not_beyond() {
        let row = raster(9, &[0.0, N, N, 3.0, N, N, N, 7.0, N]);
        let filled = interpolate(&row, 3.0);
        assert_eq!(filled.cells()[..4], [0.0, 1.0, 2.0, 3.0]);
        assert!(filled.cells()[4..7].iter().all(|z| z.is_nan()), "a gap of 4");
        assert!(filled.cells()[8].is_nan(), "nothing is extrapolated");
        assert_eq!(interpolate(&row, 4.0).cells()[5], 5.0);
    }

    #[test]
    fn the_two_orders_are_averaged_and_known_cells_stay() {
        // x then y: rows give (1,0) = 2, (1,2) = 6, so the centre is 4. y then x: columns give (0,1) = 2, nothing
        // in column 1, (2,1) = 5, so the centre is 3.5.
        let corners = raster(3, &[0.0, N, 4.0, N, N, N, 4.0, 8.0, 6.0]);
        let filled = interpolate(&corners, 2.0);
        assert_eq!(filled.cells()[1], 2.0);
        assert_eq!(filled.cells()[4], ((2.0 + 8.0) / 2.0 + (2.0 + 5.0) / 2.0) / 2.0);
        assert_eq!(filled.cells()[7], 8.0);
    }
}
