//! Steepness of the ground: a plane through the heights around each cell.
//!
//! In: heights, metres, NaN where unknown. Out: degrees from level, NaN where the cell is unknown or too few pairs of
//! neighbours are known. Cells count in pairs that lie opposite each other, so that the plane's height drops out of the
//! least squares: `d = z(+v) - z(-v) = 2 g . v`.

use tsense_geometry::Raster;

/// Half the edge of the square of cells that a plane is fitted to: 1.05 m across at 0.15 m.
const RADIUS: isize = 3;
/// Fewest pairs.
const PAIRS_MIN: usize = 4;

/// Steepness of every cell, degrees.
pub fn slope_deg(height_m: &Raster<f32>) -> Raster<f32> {
    let shape = height_m.shape();
    let (width, height) = (shape.width as isize, shape.height as isize);
    let z = height_m.cells();
    let ways = (0..=RADIUS).flat_map(|y| (-RADIUS..=RADIUS).map(move |x| [x, y])).filter(|[x, y]| *y > 0 || *x > 0);
    let ways: Vec<([isize; 2], isize)> = ways.map(|[x, y]| ([x, y], y * width + x)).collect();
    let holds = |[x, y]: [isize; 2]| (0..width).contains(&x) && (0..height).contains(&y);
    let slope = |i: usize| {
        if z[i].is_nan() {
            return f32::NAN;
        }
        let (at, i) = ([i as isize % width, i as isize / width], i as isize);
        let is_inner = [-RADIUS, RADIUS].iter().all(|r| holds([at[0] + r, at[1] + r]));
        let (mut pairs, mut xx, mut xy, mut yy, mut xd, mut yd) = (0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for ([x, y], step) in &ways {
            if !(is_inner || holds([at[0] + x, at[1] + y]) && holds([at[0] - x, at[1] - y])) {
                continue;
            }
            let d = f64::from(z[(i + step) as usize] - z[(i - step) as usize]);
            if d.is_finite() {
                let (x, y) = (*x as f64, *y as f64);
                (pairs, xx, xy, yy) = (pairs + 1, xx + x * x, xy + x * y, yy + y * y);
                (xd, yd) = (xd + x * d, yd + y * d);
            }
        }
        let determinant: f64 = xx * yy - xy * xy;
        if pairs < PAIRS_MIN || determinant < 1e-9 {
            return f32::NAN;
        }
        let east = (yy * xd - xy * yd) / determinant / (2.0 * shape.cell_m);
        let north = (xx * yd - xy * xd) / determinant / (2.0 * shape.cell_m);
        east.hypot(north).atan().to_degrees() as f32
    };
    Raster::from_cells(shape, (0..shape.len()).map(slope).collect()).expect("a slope a cell")
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::RasterShape;

    #[test]
    fn a_plane_has_its_own_slope_with_holes_in_it_too() {
        let shape = RasterShape { first_cell: [0; 2], width: 20, height: 20, cell_m: 0.5 };
        // 3 in 4 towards north-east by 3-4-5: rise 0.75 over run 1.
        let z = |i: usize| 0.45 * 0.5 * (i % 20) as f32 + 0.6 * 0.5 * (i / 20) as f32;
        let mut heights = Raster::from_cells(shape, (0..400).map(z).collect()).unwrap();
        heights[(10, 11)] = f32::NAN;
        let slope = slope_deg(&heights);
        for at in [(10, 10), (1, 1), (18, 2)] {
            assert!((slope[at] - 36.8699).abs() < 0.01, "{at:?}: {}", slope[at]);
        }
        assert!(slope[(10, 11)].is_nan());
        assert!(slope_deg(&heights.map(|_| f32::NAN)).cells().iter().all(|s| s.is_nan()));
    }
}
