//! Least-squares planes over square neighbourhoods of a height raster, each in constant time.
//!
//! In: heights, NaN where unknown. Out: for any cell and radius the plane z = height + slope . (x, y) around the
//! cell's centre, its deviation and how many cells it rests on. Running sums over the raster (integral images) make
//! the cost independent of the radius. Heights in metres, slopes as rise over run; the raster's own frame (east, north).

use tsense_geometry::Raster;

/// Sums that a least-squares plane needs: n, x, y, z, xx, xy, yy, xz, yz, zz.
type Sums = [f64; 10];

/// A plane around a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Height at the cell's centre, metres.
    pub height_m: f64,
    /// Rise over run to the east and to the north.
    pub slope: [f64; 2],
    /// Root of the mean squared deviation of the cells, metres.
    pub deviation_m: f64,
    /// Cells that carry it.
    pub cells: usize,
}

impl Plane {
    /// Rise over run along the steepest line.
    pub fn steepness(&self) -> f64 {
        self.slope[0].hypot(self.slope[1])
    }
}

/// Integral images of a height raster.
#[derive(Default)]
pub struct PlaneSums {
    width: usize,
    height: usize,
    cell_m: f64,
    /// One row and one column of zeros ahead of the cells.
    sums: Vec<Sums>,
}

impl PlaneSums {
    /// Sums over the known cells.
    pub fn of(heights: &Raster<f32>) -> Self {
        Self::default().again(heights)
    }

    /// The same, in the memory of what was made of another raster: at 80 bytes a cell new memory costs more than the sums.
    pub fn again(mut self, heights: &Raster<f32>) -> Self {
        let shape = heights.shape();
        let stride = shape.width + 1;
        (self.width, self.height, self.cell_m) = (shape.width, shape.height, shape.cell_m);
        // Only the row and the column ahead of the cells are not written below.
        self.sums.resize(stride * (shape.height + 1), [0.0; 10]);
        self.sums[..stride].fill([0.0; 10]);
        self.sums.iter_mut().step_by(stride).for_each(|ahead| *ahead = [0.0; 10]);
        for row in 0..shape.height {
            let mut along = [0.0; 10];
            for column in 0..shape.width {
                let z = f64::from(heights.cells()[row * shape.width + column]);
                if z.is_finite() {
                    let (x, y) = (column as f64, row as f64);
                    add(&mut along, &[1.0, x, y, z, x * x, x * y, y * y, x * z, y * z, z * z]);
                }
                let mut here = self.sums[row * stride + column + 1];
                add(&mut here, &along);
                self.sums[(row + 1) * stride + column + 1] = here;
            }
        }
        self
    }

    /// The plane through the known cells within `radius` cells, or nothing where they are fewer than `cells_min` or
    /// lie on a line.
    pub fn fit(&self, column: usize, row: usize, radius: usize, cells_min: usize) -> Option<Plane> {
        let [n, sx, sy, sz, sxx, sxy, syy, sxz, syz, szz] = self.square(column, row, radius);
        if n < cells_min.max(3) as f64 {
            return None;
        }
        let (mx, my, mz) = (sx / n, sy / n, sz / n);
        let (cxx, cxy, cyy) = (sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my);
        let (cxz, cyz, czz) = (sxz / n - mx * mz, syz / n - my * mz, szz / n - mz * mz);
        let determinant = cxx * cyy - cxy * cxy;
        // Cells on a line (or nearly so, within a third of a cell) say nothing of the slope across it.
        if determinant < 0.01 * (cxx + cyy) || determinant <= 0.0 {
            return None;
        }
        let a = (cxz * cyy - cyz * cxy) / determinant;
        let b = (cyz * cxx - cxz * cxy) / determinant;
        let height_m = mz + a * (column as f64 - mx) + b * (row as f64 - my);
        let deviation_m = (czz - a * cxz - b * cyz).max(0.0).sqrt();
        Some(Plane { height_m, slope: [a / self.cell_m, b / self.cell_m], deviation_m, cells: n as usize })
    }

    fn square(&self, column: usize, row: usize, radius: usize) -> Sums {
        let stride = self.width + 1;
        let (x0, x1) = (column.saturating_sub(radius), (column + radius + 1).min(self.width));
        let (y0, y1) = (row.saturating_sub(radius), (row + radius + 1).min(self.height));
        let [a, b, c, d] = [(x1, y1), (x0, y1), (x1, y0), (x0, y0)].map(|(x, y)| &self.sums[y * stride + x]);
        std::array::from_fn(|i| a[i] - b[i] - c[i] + d[i])
    }
}

fn add(to: &mut Sums, what: &Sums) {
    for (to, what) in to.iter_mut().zip(what) {
        *to += what;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::RasterShape;

    fn tilted(width: usize, height: usize) -> Raster<f32> {
        let shape = RasterShape { first_cell: [0, 0], width, height, cell_m: 0.5 };
        let cells = (0..shape.len()).map(|i| 3.0 + 0.1 * (i % width) as f32 - 0.05 * (i / width) as f32).collect();
        Raster::from_cells(shape, cells).unwrap()
    }

    #[test]
    fn a_tilted_plane_is_found_with_its_slope_also_at_the_rim_and_through_holes() {
        let mut heights = tilted(30, 20);
        for i in (0..600).step_by(3) {
            heights.cells_mut()[i] = f32::NAN;
        }
        let sums = PlaneSums::of(&heights);
        for (column, row) in [(10, 10), (0, 0), (29, 19)] {
            let plane = sums.fit(column, row, 3, 5).unwrap();
            assert!((plane.height_m - (3.0 + 0.1 * column as f64 - 0.05 * row as f64)).abs() < 1e-5);
            assert!((plane.slope[0] - 0.2).abs() < 1e-5 && (plane.slope[1] + 0.1).abs() < 1e-5);
            assert!(plane.deviation_m < 1e-3);
        }
    }

    #[test]
    fn sums_in_the_memory_of_others_are_those_made_anew() {
        let mut sums = PlaneSums::of(&tilted(30, 20));
        for (width, height) in [(9, 40), (31, 19)] {
            sums = sums.again(&tilted(width, height));
            assert_eq!(sums.sums, PlaneSums::of(&tilted(width, height)).sums);
        }
    }

    #[test]
    fn too_few_cells_or_cells_on_a_line_give_no_plane() {
        let mut heights = tilted(9, 9).map(|_| f32::NAN);
        for column in 0..9 {
            heights[(column, 4)] = 1.0;
        }
        let sums = PlaneSums::of(&heights);
        assert_eq!(sums.fit(4, 4, 4, 3), None);
    }
}
