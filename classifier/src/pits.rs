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
    let shape = ground_m.shape();
    let cells = |step: &[isize; 2]| {
        let length_m = (step[0] as f64).hypot(step[1] as f64) * shape.cell_m;
        (width_m / 2.0 / length_m).ceil() as usize
    };
    let reaches = DIRECTIONS.map(|step| cells(&step));
    let depth = |i: usize| {
        let (at, z) = ([i % shape.width, i / shape.width], ground_m.cells()[i]);
        let below = |(step, reach): (&[isize; 2], &usize)| {
            let back = [-step[0], -step[1]];
            rim(ground_m, at, *step, *reach, z).min(rim(ground_m, at, back, *reach, z)) - z
        };
        let level = if z.is_nan() { f32::NAN } else { 0.0 };
        DIRECTIONS.iter().zip(&reaches).map(below).fold(level, f32::max)
    };
    Raster::from_cells(shape, (0..shape.len()).map(depth).collect()).expect("a depth a cell")
}

/// The highest ground from a cell along a direction, itself included.
fn rim(ground_m: &Raster<f32>, at: [usize; 2], step: [isize; 2], reach: usize, z: f32) -> f32 {
    let shape = ground_m.shape();
    let (mut column, mut row, mut highest) = (at[0], at[1], z);
    for _ in 0..reach {
        let next = column.checked_add_signed(step[0]).zip(row.checked_add_signed(step[1]));
        let Some(next) = next.filter(|(column, row)| *column < shape.width && *row < shape.height) else { break };
        (column, row) = next;
        // `max` passes over NaN.
        highest = highest.max(ground_m.cells()[row * shape.width + column]);
    }
    highest
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
