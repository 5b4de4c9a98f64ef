//! Solid things: what stands on the ground and does not give way, told from brush of the same height.
//!
//! In: what stands on each cell, and the returns of the columns; where no returns were kept, the voxels. Out: whether it is
//! solid. Rock, wall and bark send beams back from one sheet, as thick as the noise of a range and the curve of the thing
//! over less than half a metre; leaves and blades send them back from anywhere. So the returns of a column and the eight
//! around it, or of the column alone, are solid where their smallest deviation, across the plane that fits them best, is
//! that of a sheet. Where too few came back to say so, what is tall is solid if its voxels are occupied one above the other.
//! Source: ours; which deviations was measured, see docs/tried.md.

use crate::columns::View;
use crate::ground::Ground;
use crate::returns::ReturnColumns;
use tsense_geometry::Raster;

/// Least height of something that voxels show to be solid, metres.
pub const TALL_MIN_M: f64 = 0.45;
/// Height above ground below which returns are the ground's own, metres.
const OWN_MIN_M: f32 = 0.08;
/// Returns up to this height above ground stand with what is around, where nothing higher does, metres.
const LOW_M: f32 = 0.2;
/// A sheet over three by three columns.
const AROUND: Sheet = Sheet { returns_min: 8.0, std_max_m: 0.028, along_min_m: 0.03 };
/// The same of one column, in which a thin stem is a sheet, too; of few returns in a narrow column the deviation says little.
const ALONE: Sheet = Sheet { returns_min: 10.0, std_max_m: 0.018, along_min_m: 0.022 };

/// What solid things are looked for in.
pub struct Ground3d<'a> {
    /// The voxels.
    pub view: &'a View,
    /// The returns, where they were kept.
    pub returns: Option<&'a ReturnColumns>,
    /// The ground.
    pub ground: &'a Ground,
    /// Height of what stands on each cell, metres; 0 or NaN where nothing does.
    pub height_m: &'a Raster<f32>,
}

/// What makes returns a sheet.
struct Sheet {
    /// Fewest of them.
    returns_min: f64,
    /// Largest deviation across it, one sigma, metres.
    std_max_m: f64,
    /// Least deviation along its shorter side, one sigma, metres: a row of returns is no sheet.
    along_min_m: f64,
}

impl Ground3d<'_> {
    /// Whether what stands on each cell is solid; `density` is the share of occupied voxels from which tall things are.
    pub fn solid(&self, density: f64) -> Raster<bool> {
        let shape = self.view.shape;
        let mut spreads = Spreads { of: self, slots: vec![0; shape.len()], spreads: vec![Spread::default()] };
        let mut solid = Raster::filled(shape, false);
        for i in (0..shape.len()).filter(|i| self.height_m.cells()[*i] > 0.0) {
            let (alone, around) = (spreads.at(i), spreads.around(i));
            solid.cells_mut()[i] = match around.is_told_by(&AROUND) {
                true => around.is_sheet(&AROUND) || alone.is_sheet(&ALONE),
                false => self.is_filled(i, density),
            };
        }
        solid
    }

    /// Whether enough voxels are occupied from above the ground's own up to the height of a tall thing.
    fn is_filled(&self, column: usize, density: f64) -> bool {
        let level = |z_m: f64| (z_m / self.view.shape.cell_m).floor().max(0.0) as usize;
        let ground_m = f64::from(self.ground.height_m.cells()[column]);
        let height_m = f64::from(self.height_m.cells()[column]);
        let (from, to) = (level(ground_m) + 2, level(ground_m + height_m) + 1);
        let occupied = self.view.occupied.count(column, from, to) as f64;
        height_m >= TALL_MIN_M && occupied >= density * to.saturating_sub(from).max(1) as f64
    }

    /// The returns of what stands on a column.
    fn spread_of(&self, column: usize) -> Spread {
        let mut spread = Spread::default();
        let Some(returns) = self.returns else { return spread };
        let ground_m = self.ground.height_m.cells()[column];
        // NaN is not the larger one.
        let top_m = LOW_M.max(self.height_m.cells()[column]);
        for item in returns.column(column) {
            if (OWN_MIN_M..=top_m).contains(&(item.at_m[2] - ground_m)) {
                spread.add(item.at_m.map(f64::from));
            }
        }
        spread
    }
}

/// Sums of each column, worked out where they are asked for.
struct Spreads<'a> {
    of: &'a Ground3d<'a>,
    /// Where a column's sums lie among `spreads`; 0 where they were not asked for yet.
    slots: Vec<u32>,
    spreads: Vec<Spread>,
}

impl Spreads<'_> {
    fn at(&mut self, column: usize) -> Spread {
        if self.slots[column] == 0 {
            self.slots[column] = self.spreads.len() as u32;
            self.spreads.push(self.of.spread_of(column));
        }
        self.spreads[self.slots[column] as usize]
    }

    fn around(&mut self, column: usize) -> Spread {
        let shape = self.of.view.shape;
        let (x, y) = (column % shape.width, column / shape.width);
        let mut sum = Spread::default();
        for row in y.saturating_sub(1)..(y + 2).min(shape.height) {
            for other in x.saturating_sub(1)..(x + 2).min(shape.width) {
                sum.join(&self.at(row * shape.width + other));
            }
        }
        sum
    }
}

/// How some places spread: their number, the sums of their coordinates, and of the products of these: xx, yy, zz, xy, xz, yz.
#[derive(Clone, Copy, Default)]
struct Spread {
    count: f64,
    sum: [f64; 3],
    products: [f64; 6],
}

impl Spread {
    fn add(&mut self, [x, y, z]: [f64; 3]) {
        self.join(&Self { count: 1.0, sum: [x, y, z], products: [x * x, y * y, z * z, x * y, x * z, y * z] });
    }

    fn join(&mut self, other: &Self) {
        self.count += other.count;
        self.sum.iter_mut().zip(&other.sum).for_each(|(sum, more)| *sum += more);
        self.products.iter_mut().zip(&other.products).for_each(|(sum, more)| *sum += more);
    }

    fn is_told_by(&self, sheet: &Sheet) -> bool {
        self.count >= sheet.returns_min
    }

    fn is_sheet(&self, sheet: &Sheet) -> bool {
        self.is_told_by(sheet)
            && self.narrow_directions(sheet.std_max_m) == 1
            && self.narrow_directions(sheet.along_min_m) == 1
    }

    /// How many of the three deviations, along the axes of the ellipsoid of the places, are below one: the number of negative
    /// eigenvalues of the covariance less its square, by the signs of the pivots (Sylvester's law of inertia).
    fn narrow_directions(&self, std_m: f64) -> usize {
        let mean = self.sum.map(|sum| sum / self.count);
        let of = |k: usize, a: usize, b: usize| self.products[k] / self.count - mean[a] * mean[b];
        let square = std_m * std_m;
        let (xx, yy, zz) = (of(0, 0, 0) - square, of(1, 1, 1) - square, of(2, 2, 2) - square);
        let (xy, xz, yz) = (of(3, 0, 1), of(4, 0, 2), of(5, 1, 2));
        let (yy, yz, zz) = (yy - xy * xy / xx, yz - xy * xz / xx, zz - xz * xz / xx);
        let pivots = [xx, yy, zz - yz * yz / yy];
        pivots.iter().filter(|pivot| **pivot < 0.0).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(places: impl Iterator<Item = [f64; 3]>) -> Spread {
        let mut spread = Spread::default();
        places.for_each(|at_m| spread.add(at_m));
        spread
    }

    /// Sixteen places on 0.45 x 0.45 m, far from the corner of the view.
    fn places(z: impl Fn(f64, f64, usize) -> f64) -> impl Iterator<Item = [f64; 3]> {
        (0..16).map(move |i| {
            let (x, y) = (0.15 * (i % 4) as f64, 0.15 * (i / 4) as f64);
            [25.0 + x, 12.0 + y, z(x, y, i)]
        })
    }

    #[test]
    fn the_face_of_a_rock_is_a_sheet_however_it_leans_and_grass_is_none() {
        let is_sheet = |places: &mut dyn Iterator<Item = [f64; 3]>| spread(places).is_sheet(&AROUND);
        assert!(is_sheet(&mut places(|x, y, _| 0.4 + 0.5 * x - 0.2 * y)));
        assert!(is_sheet(&mut places(|x, y, _| 0.5 - ((x - 0.22).powi(2) + (y - 0.22).powi(2)) / 1.6)));
        let wall = places(|_, _, i| 0.3 * (i / 4) as f64).map(|[x, _, z]| [x, 12.0, z]);
        assert!(is_sheet(&mut { wall }), "a plane that is no height over places");
        assert!(!is_sheet(&mut places(|_, _, i| 0.2 + 0.4 * ((i * 7) % 16) as f64 / 16.0)));
    }

    #[test]
    fn few_returns_and_a_row_of_them_show_nothing() {
        assert!(!spread(places(|_, _, _| 0.4).take(7)).is_sheet(&AROUND));
        assert!(!spread((0..20).map(|i| [25.0 + 0.02 * i as f64, 12.0, 0.4])).is_sheet(&AROUND));
    }

    #[test]
    fn the_deviations_below_a_bound_are_counted_whatever_the_axes() {
        // 0.2 m along (1, 1, 0), 0.1 m along (1, -1, 1), 0.02 m along (1, -1, -2), to both sides.
        let axes = [([1.0, 1.0, 0.0], 0.2), ([1.0, -1.0, 1.0], 0.1), ([1.0, -1.0, -2.0], 0.02)];
        let ends = axes.iter().flat_map(|(axis, off_m)| {
            let norm = axis.iter().map(|c| c * c).sum::<f64>().sqrt();
            [-1.0, 1.0].map(|side| [0, 1, 2].map(|k| 10.0 + side * off_m * axis[k] / norm))
        });
        // One sigma is the distance over the square root of three: 0.115, 0.058, 0.0115 m.
        let spread = spread(ends);
        assert_eq!([0.01, 0.02, 0.06, 0.12].map(|std_m| spread.narrow_directions(std_m)), [0, 1, 2, 3]);
    }
}
