//! The plane z = a x + b y + c nearest to points in height: what a Hough plane is compared with.
//!
//! In: points, metres, near their origin. Out: a, b and c (metres), or nothing where the points do not span a plane.

use nalgebra::{Matrix3, Vector3};

/// The coefficients of the plane; heights count, not distances, as for ground.
pub fn plane_of_heights(points: &[[f64; 3]]) -> Option<[f64; 3]> {
    linear(points.iter().map(|[x, y, z]| ([*x, *y], *z)))
}

/// The a, b and c that bring a x + b y + c nearest to the values at (x, y).
pub(super) fn linear(values: impl Iterator<Item = ([f64; 2], f64)>) -> Option<[f64; 3]> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ([x, y], value) in values {
        let row = Vector3::new(x, y, 1.0);
        normal += row * row.transpose();
        right += row * value;
    }
    let solved = normal.try_inverse()? * right;
    solved.iter().all(|c| c.is_finite()).then(|| solved.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_plane_give_it_back_and_a_line_gives_none() {
        let points: Vec<_> = (0..30)
            .map(|i| (f64::from(i % 6), f64::from(i / 6)))
            .map(|(x, y)| [x, y, 0.2 * x - 0.1 * y + 3.0])
            .collect();
        let [a, b, c] = plane_of_heights(&points).unwrap();
        assert!((a - 0.2).abs() < 1e-9 && (b + 0.1).abs() < 1e-9 && (c - 3.0).abs() < 1e-9);
        assert_eq!(plane_of_heights(&[[0.0; 3], [1.0, 0.0, 0.0]]), None);
    }
}
