//! The convolution that isolates point-like density: an odd square kernel with a large centre, a neutral ring and a
//! negative outside. Thesis (2-16), figure 2-19.
//!
//! In: a raster of densities. Out: the response of every cell; beyond the raster's rim densities count as 0. The
//! kernel's centre sums to 1 and its outside to minus `kernel_outside`, so a response reads as a density: the mean of
//! the centre less that of what surrounds it.

use crate::config::TrunkConfig;
use tsense_geometry::Raster;

/// A square kernel, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    /// Cells along each side, odd.
    pub edge: usize,
    /// Weights, row by row.
    pub weights: Vec<f32>,
}

/// The trunk kernel: 1 in the centre, 0 around it, -1 further out, each part then scaled to its sum. The fall-off is
/// the width over which one value goes over into the next.
pub fn trunk_kernel(config: &TrunkConfig, cell_m: f64) -> Kernel {
    let edge = config.kernel_cells | 1;
    let half = (edge / 2) as f64;
    let within = |radius_m: f64, r_m: f64| ((radius_m - r_m) / config.kernel_falloff_m + 0.5).clamp(0.0, 1.0);
    let radii = (0..edge * edge).map(|i| ((i % edge) as f64 - half).hypot((i / edge) as f64 - half) * cell_m);
    let parts: Vec<_> =
        radii.map(|r_m| (within(config.kernel_center_m, r_m), 1.0 - within(config.kernel_neutral_m, r_m))).collect();
    let center: f64 = parts.iter().map(|(center, _)| center).sum::<f64>().max(1e-9);
    let outside: f64 = parts.iter().map(|(_, outside)| outside).sum::<f64>().max(1e-9);
    let weight = |(c, o): &(f64, f64)| (c / center - config.kernel_outside * o / outside) as f32;
    Kernel { edge, weights: parts.iter().map(weight).collect() }
}

/// The sum of weight times value around every cell (2-16).
pub fn convolve(values: &Raster<f32>, kernel: &Kernel) -> Raster<f32> {
    let shape = values.shape();
    let half = kernel.edge / 2;
    let mut response = values.map(|_| 0.0);
    for row in 0..shape.height {
        let out = &mut response.cells_mut()[row * shape.width..(row + 1) * shape.width];
        for ky in 0..kernel.edge {
            let Some(from) = (row + ky).checked_sub(half).filter(|from| *from < shape.height) else { continue };
            let line = &values.cells()[from * shape.width..(from + 1) * shape.width];
            // Most rows of a forest have gaps, but hardly one is empty: no test for zeros pays.
            for kx in 0..kernel.edge {
                add_shifted(out, line, kx as isize - half as isize, kernel.weights[ky * kernel.edge + kx]);
            }
        }
    }
    response
}

/// `out[i] += weight * line[i + shift]` wherever both exist.
fn add_shifted(out: &mut [f32], line: &[f32], shift: isize, weight: f32) {
    let (skip_out, skip_line) = ((-shift).max(0) as usize, shift.max(0) as usize);
    if skip_out >= out.len() || skip_line >= line.len() {
        return;
    }
    for (out, value) in out[skip_out..].iter_mut().zip(&line[skip_line..]) {
        *out += weight * value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::RasterShape;

    fn random(width: usize, height: usize) -> Raster<f32> {
        let mut seed = 5u64;
        let shape = RasterShape { first_cell: [0, 0], width, height, cell_m: 0.15 };
        let mut next = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 40) as f32 / 16_777_216.0
        };
        Raster::from_cells(shape, (0..shape.len()).map(|_| next()).collect()).unwrap()
    }

    #[test]
    fn the_convolution_equals_the_plain_double_sum() {
        let values = random(23, 9);
        let kernel = trunk_kernel(&TrunkConfig::default(), 0.15);
        let response = convolve(&values, &kernel);
        for (column, row) in (0..23i32).flat_map(|c| (0..9i32).map(move |r| (c, r))) {
            let mut plain = 0.0;
            for (i, weight) in kernel.weights.iter().enumerate() {
                let at = (column + (i % 11) as i32 - 5, row + (i / 11) as i32 - 5);
                if (0..23).contains(&at.0) && (0..9).contains(&at.1) {
                    plain += weight * values[(at.0 as usize, at.1 as usize)];
                }
            }
            assert!((response[(column as usize, row as usize)] - plain).abs() < 1e-5);
        }
    }

    #[test]
    fn the_kernel_is_large_in_the_centre_neutral_around_and_negative_outside() {
        let kernel = trunk_kernel(&TrunkConfig::default(), 0.15);
        assert_eq!((kernel.edge, kernel.weights.len()), (11, 121));
        assert!(kernel.weights[60] > 0.1);
        assert_eq!(kernel.weights[60 + 2], 0.0, "0.3 m out");
        assert!(kernel.weights[55] < 0.0 && kernel.weights[0] < 0.0);
        assert!(kernel.weights.iter().sum::<f32>().abs() < 1e-5, "an even field gives no response");
    }
}
