//! Solid things: what stands on the ground and does not give way, told from brush of the same height.
//!
//! In: voxels and, where they were kept, the returns of the columns; the ground. Out: whether what stands on a cell is
//! solid. Tall things are solid where their voxels are occupied one above the other. Low ones, a rock or a log, are one
//! or two voxels; their returns lie on one smooth surface, while those of grass and bushes are scattered in depth.

use crate::columns::View;
use crate::ground::Ground;
use crate::returns::{ColumnReturn, ReturnColumns};
use nalgebra::{Matrix3, Vector3};

/// Least height of something that voxels show to be solid, metres.
pub const TALL_MIN_M: f64 = 0.45;
/// Height above ground below which returns are the ground's own, metres.
const OWN_MIN_M: f32 = 0.12;
/// Fewest returns that show a smooth surface.
const RETURNS_MIN: usize = 8;
/// Largest deviation of returns from a plane that is smooth, one sigma, metres: range noise and the curve of a rock.
const SMOOTH_M: f32 = 0.06;
/// Most returns of a column that are looked at, and the highest thing that is looked at this way, metres: taller ones
/// show in their voxels.
const RETURNS_MAX: usize = 12;
const LOW_MAX_M: f64 = 1.2;
/// Least distance between the first and the last return across the smaller extent, metres: a row is no surface.
const SPAN_MIN_M: f32 = 0.12;

/// What solid things are looked for in.
pub struct Ground3d<'a> {
    /// The voxels.
    pub view: &'a View,
    /// The returns, where they were kept.
    pub returns: Option<&'a ReturnColumns>,
    /// The ground.
    pub ground: &'a Ground,
}

impl Ground3d<'_> {
    /// Whether what stands on a column up to a height above its ground is solid.
    pub fn is_solid(&self, column: usize, height_m: f64, density: f64) -> bool {
        let is_tall = height_m >= TALL_MIN_M && self.occupied_share(column, height_m) >= density;
        is_tall
            || height_m < LOW_MAX_M
                && self.returns.is_some_and(|returns| self.is_smooth(returns, column, height_m as f32))
    }

    /// Share of occupied among all voxels of a column from above the ground's own up to a height.
    fn occupied_share(&self, column: usize, height_m: f64) -> f64 {
        let level = |z_m: f64| (z_m / self.view.shape.cell_m).floor().max(0.0) as usize;
        let ground_m = f64::from(self.ground.height_m.cells()[column]);
        let (from, to) = (level(ground_m) + 2, level(ground_m + height_m) + 1);
        self.view.occupied.count(column, from, to) as f64 / to.saturating_sub(from).max(1) as f64
    }

    /// Whether the returns above the ground of a column and the eight around it lie on one plane.
    fn is_smooth(&self, returns: &ReturnColumns, column: usize, height_m: f32) -> bool {
        let shape = self.view.shape;
        let (x, y) = (column % shape.width, column / shape.width);
        let mut plane = PlaneOf::default();
        for row in y.saturating_sub(1)..(y + 2).min(shape.height) {
            for other in x.saturating_sub(1)..(x + 2).min(shape.width) {
                let i = row * shape.width + other;
                let ground_m = self.ground.height_m.cells()[i];
                let stands = |item: &&ColumnReturn| (OWN_MIN_M..height_m + 0.3).contains(&(item.at_m[2] - ground_m));
                returns.column(i).iter().filter(stands).take(RETURNS_MAX).for_each(|item| plane.add(item.at_m));
            }
        }
        plane.is_smooth()
    }
}

/// Sums for a least-squares plane z = a + b x + c y.
#[derive(Default)]
struct PlaneOf {
    first: Option<[f32; 3]>,
    count: usize,
    normal: Matrix3<f32>,
    right: Vector3<f32>,
    squares: f32,
    low: [f32; 2],
    high: [f32; 2],
}

impl PlaneOf {
    fn add(&mut self, at_m: [f32; 3]) {
        // Relative to the first return, so that single precision does.
        let first = *self.first.get_or_insert(at_m);
        let [x, y, z] = [0, 1, 2].map(|axis| at_m[axis] - first[axis]);
        let place = Vector3::new(1.0, x, y);
        self.count += 1;
        self.normal += place * place.transpose();
        self.right += place * z;
        self.squares += z * z;
        (self.low, self.high) = ([self.low[0].min(x), self.low[1].min(y)], [self.high[0].max(x), self.high[1].max(y)]);
    }

    fn is_smooth(&self) -> bool {
        let span_m = (self.high[0] - self.low[0]).min(self.high[1] - self.low[1]);
        if self.count < RETURNS_MIN || span_m < SPAN_MIN_M {
            return false;
        }
        let Some(inverse) = self.normal.try_inverse() else { return false };
        let left = self.squares - self.right.dot(&(inverse * self.right));
        (left / self.count as f32).max(0.0).sqrt() <= SMOOTH_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smooth(places: impl Iterator<Item = [f32; 3]>) -> bool {
        let mut plane = PlaneOf::default();
        places.for_each(|at_m| plane.add(at_m));
        plane.is_smooth()
    }

    /// Sixteen places on 0.45 x 0.45 m, far from the corner of the view.
    fn places(z: impl Fn(f32, f32, usize) -> f32) -> impl Iterator<Item = [f32; 3]> {
        (0..16).map(move |i| {
            let (x, y) = (0.15 * (i % 4) as f32, 0.15 * (i / 4) as f32);
            [25.0 + x, 12.0 + y, z(x, y, i)]
        })
    }

    #[test]
    fn the_top_of_a_rock_is_smooth_and_grass_is_not() {
        assert!(smooth(places(|x, y, _| 0.4 + 0.5 * x - 0.2 * y)));
        assert!(smooth(places(|x, y, _| 0.5 - ((x - 0.22).powi(2) + (y - 0.22).powi(2)) / 1.2)));
        assert!(!smooth(places(|_, _, i| 0.2 + 0.4 * ((i * 7) % 16) as f32 / 16.0)));
    }

    #[test]
    fn few_returns_and_a_row_of_them_show_nothing() {
        assert!(!smooth(places(|_, _, _| 0.4).take(7)));
        assert!(!smooth((0..20).map(|i| [25.0 + 0.02 * i as f32, 12.0, 0.4])));
    }
}
