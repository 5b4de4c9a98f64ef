//! Normal equations of a stem: gradient and Fisher information from derivatives by axis and radius at a beam's height.
//!
//! A derivative by the six unknowns is (v, u v): v by east, north and radius at the beam's height, u that height above
//! breast height, because lean and taper act by it. So the sums of v v^T, u v v^T and u^2 v v^T are the whole matrix, and
//! eighteen additions a beam do instead of thirty-six.

use super::model::UNKNOWNS;
use nalgebra::{SMatrix, SVector};

/// A symmetric matrix over the unknowns.
pub type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
/// A vector over the unknowns.
pub type Column = SVector<f64, UNKNOWNS>;

/// Sums over beams.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// Of v and of u v.
    gradient: [[f64; 3]; 2],
    /// Upper triangles of v v^T, u v v^T and u^2 v v^T, row by row.
    fisher: [[f64; 6]; 3],
}

impl Sums {
    /// Adds information `weight` along `v` at a height, and a pull along it.
    pub fn add(&mut self, v: [f64; 3], up_m: f64, pull: f64, weight: f64) {
        let products = [v[0] * v[0], v[0] * v[1], v[0] * v[2], v[1] * v[1], v[1] * v[2], v[2] * v[2]];
        for (sums, weight) in self.fisher.iter_mut().zip([weight, weight * up_m, weight * up_m * up_m]) {
            sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
        }
        for (sums, pull) in self.gradient.iter_mut().zip([pull, pull * up_m]) {
            sums.iter_mut().zip(v).for_each(|(sum, v)| *sum += pull * v);
        }
    }

    /// The gradient.
    pub fn gradient(&self) -> Column {
        let [v, uv] = self.gradient;
        Column::from([v[0], v[1], v[2], uv[0], uv[1], uv[2]])
    }

    /// The information.
    pub fn fisher(&self) -> Matrix {
        Matrix::from_fn(|row, column| {
            let (i, j) = ((row % 3).min(column % 3), (row % 3).max(column % 3));
            // Where row i of an upper triangle begins, less i.
            self.fisher[row / 3 + column / 3][[0, 2, 3][i] + j]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The plain version: outer products of the whole vectors.
    #[test]
    fn the_sums_are_those_of_outer_products() {
        let (mut sums, mut gradient, mut fisher) = (Sums::default(), Column::zeros(), Matrix::zeros());
        for k in 0..20 {
            let [a, b, c, up, weight] = [1.3, 2.1, 3.7, 0.9, 5.3].map(|f: f64| (f * f64::from(k + 1)).sin());
            sums.add([a, b, c], up, 0.5 * weight, weight);
            let whole = Column::from([a, b, c, a * up, b * up, c * up]);
            gradient += whole * (0.5 * weight);
            fisher += whole * whole.transpose() * weight;
        }
        assert!((sums.gradient() - gradient).norm() < 1e-12 && (sums.fisher() - fisher).norm() < 1e-12);
    }
}
