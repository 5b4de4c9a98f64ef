//! Crowns that hang down among brush: a crown surrounds the places below it on nearly all sides, a bush beside a place
//! stands to one side of it.
//!
//! In: the profile of each column, trunks' columns among them. Out: the layer in which the lowest crown over a column
//! begins. Whether it goes on above the tallest brush, as no bush does, is for the caller to see. No stem is asked for:
//! the thin trees that hang so low are those that are missed. Source: ours.

use crate::profile::{LAYER_M, LAYERS, Profile};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;
use tsense_geometry::{Raster, RasterShape};

/// Directions that are told apart; one of them may be empty, for a crown's far side is seldom seen.
const SIDES: usize = 8;
/// The ring around a place in which crowns are looked for, metres: farther out than the bark of a stem in its middle.
const RING_M: RangeInclusive<f64> = 0.2..=0.6;
/// What counts as a crown begins higher than this above ground, metres: bushes seldom do.
const CLEARANCE_M: f32 = 1.0;

/// The layer in which the lowest crown over each column begins, [`LAYERS`] where there is none. `base` tells where what
/// surrounds a place begins, if it is canopy. Places nearer to the border than a ring's radius are not looked at.
pub fn crown_bases(
    profiles: &[Profile],
    shape: RasterShape,
    base: impl Fn(&Profile) -> Option<usize>,
) -> Raster<usize> {
    let ring = Ring::of(shape);
    let clearance = (CLEARANCE_M / LAYER_M) as usize;
    let mut bases = Raster::filled(shape, LAYERS);
    for y in ring.reach..shape.height.saturating_sub(ring.reach) {
        for x in ring.reach..shape.width.saturating_sub(ring.reach) {
            let column = y * shape.width + x;
            let around = ring.surrounding(profiles, column, !0 << clearance);
            if let Some(layer) = base(&Profile::of_layers(around)).filter(|layer| *layer > clearance) {
                for offset in ring.disc.iter().copied() {
                    let below = &mut bases.cells_mut()[column.wrapping_add_signed(offset)];
                    *below = layer.min(*below);
                }
            }
        }
    }
    bases
}

/// Columns around a place, as distances in the raster.
struct Ring {
    reach: usize,
    sides: [Vec<isize>; SIDES],
    disc: Vec<isize>,
}

impl Ring {
    fn of(shape: RasterShape) -> Self {
        let reach = (RING_M.end() / shape.cell_m) as usize;
        let mut ring = Self { reach, sides: Default::default(), disc: Vec::new() };
        let along = -(reach as isize)..=reach as isize;
        for (x, y) in along.clone().flat_map(|y| along.clone().map(move |x| (x, y))) {
            let offset = y * shape.width as isize + x;
            let away_m = (x as f64).hypot(y as f64) * shape.cell_m;
            if RING_M.contains(&away_m) {
                let turn = (y as f64).atan2(x as f64).rem_euclid(TAU) / TAU;
                ring.sides[(turn * SIDES as f64) as usize % SIDES].push(offset);
            }
            if away_m <= *RING_M.end() {
                ring.disc.push(offset);
            }
        }
        ring
    }

    /// The layers of `wanted` in which all sides of a place but one hold something, there or in the two layers below: one
    /// layer alone of a crown that few beams reach has empty sides.
    fn surrounding(&self, profiles: &[Profile], column: usize, wanted: u64) -> u64 {
        let (mut all, mut all_but_one) = (wanted, wanted);
        for side in &self.sides {
            let held =
                side.iter().fold(0, |held, offset| held | profiles[column.wrapping_add_signed(*offset)].layers());
            let held = held | held << 1 | held << 2;
            all_but_one = all | all_but_one & held;
            all &= held;
            // Most places have nothing above them: the other sides need no look.
            if all_but_one == 0 {
                break;
            }
        }
        all_but_one
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: RasterShape = RasterShape { first_cell: [0; 2], width: 25, height: 25, cell_m: 0.15 };

    /// Columns that hold the layers from 15 to 39 where something `hangs`, metres from the middle, and the lowest three
    /// everywhere.
    fn profiles(hangs: impl Fn(f64, f64) -> bool) -> Vec<Profile> {
        let profile = |i: usize| {
            let [x, y] = [i % 25, i / 25].map(|cell| 0.15 * (cell as f64 - 12.0));
            Profile::of_layers(if hangs(x, y) { 0b111 | ((1 << 40) - (1 << 15)) } else { 0b111 })
        };
        (0..SHAPE.len()).map(profile).collect()
    }

    fn bases(hangs: impl Fn(f64, f64) -> bool) -> Raster<usize> {
        crown_bases(&profiles(hangs), SHAPE, |around| (0..LAYERS).find(|layer| around.holds(*layer, 1)))
    }

    #[test]
    fn a_crown_begins_over_the_places_that_it_surrounds_and_near_its_rim() {
        let bases = bases(|x, y| x.hypot(y) < 0.8);
        assert!(bases[(12, 12)] == 15 && bases[(12 + 5, 12)] == 15);
        assert_eq!(bases[(12 + 10, 12)], LAYERS, "0.7 m beside it");
    }

    #[test]
    fn a_row_of_bushes_surrounds_no_place() {
        assert!(bases(|_, y| y.abs() < 0.2).cells().iter().all(|layer| *layer == LAYERS));
    }

    #[test]
    fn one_side_of_a_crown_may_be_hidden_but_not_two() {
        let surrounded = |hidden: fn(f64, f64) -> bool| {
            let profiles = profiles(|x, y| (0.2..0.7).contains(&x.hypot(y)) && !hidden(x, y));
            Ring::of(SHAPE).surrounding(&profiles, SHAPE.len() / 2, !0 << 10) != 0
        };
        assert!(surrounded(|_, _| false) && surrounded(|x, y| (0.0..x).contains(&y)));
        assert!(!surrounded(|x, y| x > 0.0 && y >= 0.0));
    }
}
