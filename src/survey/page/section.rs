//! A section through the plot: where most stems stand in line, with the ground, brush and returns around it.
//!
//! In: the tiles' results, then their returns. Out: the line and what lies within half a metre of it. Of several tiles the
//! one with most stems in line is kept, so memory is that of one section, bounded by [`RETURNS_MAX`].

use crate::survey::piece::Piece;
use std::collections::BTreeMap;
use tsense_contract::Detection;

/// Half the length of a section, metres.
const HALF_M: f64 = 18.0;
/// Stems this close to the line are on it, metres.
const STEM_M: f64 = 1.0;
/// Returns this close to the line are shown, metres.
const RETURN_M: f64 = 0.5;
/// One return is shown for each square of this edge, metres.
const GRAIN_M: f64 = 0.08;
/// Most returns that are shown: more would make the page slow.
const RETURNS_MAX: usize = 20_000;

/// A section and what is on it. Places are metres along the line and metres of height.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// 0 where it runs from west to east, 1 from south to north.
    pub axis: usize,
    /// Where the line lies on the other axis, metres.
    pub at_m: f64,
    /// Both ends along the line, metres.
    pub ends_m: [f64; 2],
    /// Height of the ground along the line, one sigma of it and height of brush above it.
    pub ground: Vec<[f64; 4]>,
    /// Stems near the line.
    pub stems: Vec<Detection>,
    /// Returns near the line, one a grain: whether they lie on a stem.
    pub returns: BTreeMap<[i64; 2], bool>,
}

impl Section {
    /// The best line of a tile; nothing where it is no better than the one there is.
    pub fn of(piece: &Piece, best: Option<&Section>) -> Option<Self> {
        let trees: Vec<&Detection> = piece.trees(0.0).collect();
        let place = |tree: &Detection| [tree.easting_m, tree.northing_m];
        let count = |middle: [f64; 2], axis: usize| {
            let on = |tree: &&&Detection| {
                let at = place(tree);
                (at[axis] - middle[axis]).abs() <= HALF_M && (at[1 - axis] - middle[1 - axis]).abs() <= STEM_M
            };
            trees.iter().filter(on).count()
        };
        let core = piece.core;
        let centre = core.center_of(core.width / 2, core.height / 2);
        let lines = trees.iter().map(|tree| place(tree)).chain([centre]).flat_map(|at| [(at, 0), (at, 1)]);
        // The last of equals wins: the plot's own middle where there is no tree.
        let (middle, axis) = lines.max_by_key(|(at, axis)| count(*at, *axis))?;
        if best.is_some_and(|best| best.stems.len() >= count(middle, axis)) {
            return None;
        }
        let low = f64::from(core.first_cell[axis]) * core.cell_m;
        let high = low + [core.width, core.height][axis] as f64 * core.cell_m;
        // A section near the border is moved inwards, so that it keeps its length.
        let from = (middle[axis] - HALF_M).min(high - 2.0 * HALF_M).max(low);
        let mut section =
            Self { axis, at_m: middle[1 - axis], ends_m: [from, (from + 2.0 * HALF_M).min(high)], ..Self::default() };
        section.stems =
            trees.into_iter().filter(|tree| section.along(place(tree), STEM_M).is_some()).copied().collect();
        section.ground = section.profile(piece);
        Some(section)
    }

    /// Where a place near the line lies along it.
    fn along(&self, at: [f64; 2], aside_m: f64) -> Option<f64> {
        let near = (at[1 - self.axis] - self.at_m).abs() <= aside_m;
        (near && (self.ends_m[0]..=self.ends_m[1]).contains(&at[self.axis])).then(|| at[self.axis])
    }

    fn profile(&self, piece: &Piece) -> Vec<[f64; 4]> {
        let cell_m = piece.core.cell_m;
        let steps = ((self.ends_m[1] - self.ends_m[0]) / cell_m) as usize;
        let at = |i: usize| self.ends_m[0] + (i as f64 + 0.5) * cell_m;
        let found = &piece.found;
        (0..steps)
            .filter_map(|i| {
                let mut place = [at(i), self.at_m];
                place.rotate_left(self.axis);
                let [x, y] = place;
                let value = |raster: &tsense_geometry::Raster<f32>| Some(f64::from(*raster.at(x, y)?));
                let ground_m = found.ground.base_m + value(&found.ground.height_m)?;
                Some([at(i), ground_m, value(&found.ground.std_m)?, value(&found.brush_m)?])
            })
            .collect()
    }

    /// Keeps a return that lies near the line.
    pub fn add(&mut self, [x, y, z]: [f64; 3], is_stem: bool) {
        if let Some(along) = self.along([x, y], RETURN_M) {
            let grain = [along, z].map(|m| (m / GRAIN_M).floor() as i64);
            if self.returns.len() < RETURNS_MAX || self.returns.contains_key(&grain) {
                *self.returns.entry(grain).or_insert(false) |= is_stem;
            }
        }
    }

    /// The place of a grain: along the line and its height, metres.
    pub fn place_of(grain: [i64; 2]) -> [f64; 2] {
        grain.map(|i| (i as f64 + 0.5) * GRAIN_M)
    }
}
