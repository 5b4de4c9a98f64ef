//! Which stem a return lies on: the trees around a tile as leaning cylinders, found by place.
//!
//! In: trees, metres in the plot's system. Out: for a place and its height above ground the id of the tree whose bark it
//! lies on. Stems are sorted into squares, for most squares hold none.

use tsense_classifier::BREAST_HEIGHT_M;
use tsense_contract::Detection;

/// Returns are a stem's up to this far off its surface, metres.
const BARK_M: f64 = 0.08;
/// Edge of the squares, metres.
const SQUARE_M: f64 = 1.0;
/// No stem is thicker, or leans farther to a side, than this, metres.
const ASIDE_M: f64 = 3.0;

/// The stems around a tile, by which returns find their tree.
pub struct Stems {
    stems: Vec<Stem>,
    /// South-west corner of the squares, metres, and how many there are in a row.
    corner_m: [f64; 2],
    width: usize,
    /// The stems that may stand or lean into each square, from west to east.
    squares: Vec<Vec<u32>>,
}

/// A stem as returns ask for it. Metres.
struct Stem {
    id: u32,
    at_m: [f64; 2],
    /// East and north a metre up.
    slope: [f64; 2],
    /// NaN where no diameter was measured: then nothing lies on it.
    radius_m: f64,
    /// Infinite where it was not measured.
    height_m: f64,
}

impl Stem {
    fn of(id: u32, tree: &Detection) -> Self {
        Self {
            id,
            at_m: [tree.easting_m, tree.northing_m],
            slope: tree.lean_rad.map(|lean| f64::from(lean).tan()),
            radius_m: f64::from(tree.dbh_m) / 2.0,
            height_m: if tree.height_m.is_nan() { f64::INFINITY } else { tree.height_m.into() },
        }
    }

    /// Where some of its bark may lie along an axis, metres.
    fn span_m(&self, axis: usize) -> [f64; 2] {
        let around_m = self.radius_m + BARK_M;
        let top_m = (self.slope[axis] * (self.height_m - BREAST_HEIGHT_M)).clamp(-ASIDE_M, ASIDE_M);
        let foot_m = -self.slope[axis] * BREAST_HEIGHT_M;
        [top_m.min(foot_m) - around_m, top_m.max(foot_m) + around_m].map(|off_m| self.at_m[axis] + off_m)
    }

    /// How far off its surface a place lies at a height above ground, where it lies on its bark.
    fn off_m(&self, at_m: [f64; 2], height_m: f64) -> Option<f64> {
        let up_m = height_m - BREAST_HEIGHT_M;
        let dx = at_m[0] - (self.at_m[0] + up_m * self.slope[0]);
        let dy = at_m[1] - (self.at_m[1] + up_m * self.slope[1]);
        // Most stems are far away: no root is needed to see it.
        let reach_m = self.radius_m + BARK_M;
        let is_near = dx * dx + dy * dy <= reach_m * reach_m * (1.0 + 1e-9);
        let off_m = || dx.hypot(dy) - self.radius_m;
        (is_near && height_m <= self.height_m).then(off_m).filter(|off_m| *off_m <= BARK_M)
    }
}

impl Stems {
    /// The trees around a tile; ids count from 1.
    pub fn around(trees: &[Detection], [west, south, east, north]: [f64; 4]) -> Self {
        let near =
            |tree: &&Detection| (west..=east).contains(&tree.easting_m) && (south..=north).contains(&tree.northing_m);
        let mut stems: Vec<_> =
            (1..).zip(trees).filter(|(_, tree)| near(tree)).map(|(id, tree)| Stem::of(id, tree)).collect();
        stems.sort_by(|a, b| a.at_m[0].total_cmp(&b.at_m[0]));
        let [width, height] = [east - west, north - south].map(|edge_m| (edge_m / SQUARE_M) as usize + 1);
        let mut squares = vec![Vec::new(); width * height];
        for (i, stem) in (0..).zip(&stems) {
            let [columns, rows] = [(0, west, width), (1, south, height)].map(|(axis, from_m, count)| {
                let square = |at_m: f64| ((at_m - from_m) / SQUARE_M).clamp(0.0, count as f64 - 1.0) as usize;
                let [low_m, high_m] = stem.span_m(axis);
                square(low_m)..=square(high_m)
            });
            rows.for_each(|row| columns.clone().for_each(|column| squares[row * width + column].push(i)));
        }
        Self { stems, corner_m: [west, south], width, squares }
    }

    /// The id of the stem whose surface a place lies on, at a height above ground; 0 for none.
    pub fn at(&self, [x, y]: [f64; 2], height_m: f64) -> u32 {
        let [column, row] = [(x, 0), (y, 1)].map(|(at, axis)| ((at - self.corner_m[axis]) / SQUARE_M) as usize);
        let Some(near) = self.squares.get(row * self.width + column.min(self.width - 1)) else { return 0 };
        let near = near.iter().map(|i| &self.stems[*i as usize]);
        let offs = near.filter_map(|stem| Some((stem.off_m([x, y], height_m)?, stem.id)));
        offs.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, id)| id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_return_on_the_bark_of_a_leaning_stem_has_its_id() {
        let tree = |x, lean| Detection {
            easting_m: x,
            northing_m: 5.0,
            dbh_m: 0.4,
            height_m: 12.0,
            lean_rad: [lean, 0.0],
            ..Detection::zeroed()
        };
        let trees = [tree(10.0, 0.0), tree(11.0, 0.1), tree(50.0, 0.0)];
        let stems = Stems::around(&trees, [0.0, 0.0, 20.0, 20.0]);
        assert_eq!([stems.at([10.2, 5.0], 1.3), stems.at([10.35, 5.0], 1.3), stems.at([50.2, 5.0], 1.3)], [1, 0, 0]);
        // 5 m above breast height the axis of the second one lies 0.5 m farther east.
        assert_eq!([stems.at([11.7, 5.0], 6.3), stems.at([11.2, 5.0], 6.3), stems.at([10.0, 5.0], 13.0)], [2, 0, 0]);
    }
}
