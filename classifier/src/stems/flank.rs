//! Whether a fitted stem is a piece of something flat: a wall goes on beside it, as upright as the stem itself.
//!
//! In: the returns by column, and where a stem's front is. Out: in how many directions something upright leads away from
//! it without a gap. A stem stands alone or has neighbours with gaps between; a wall leads away to one or two sides; leaves lead
//! away to all sides, and are told by other tests.

use crate::returns::ReturnColumns;
use std::f64::consts::TAU;

/// Directions that are told apart, and steps along each of them, metres.
const DIRECTIONS: usize = 24;
const STEP_M: f64 = 0.15;
/// Steps without a gap that are a wall: three quarters of a metre beside the stem.
const STEPS: usize = 5;
/// Heights above ground that are looked at, metres: above rocks and most brush, below most branches.
const HEIGHTS_M: std::ops::Range<f64> = 0.5..2.3;
/// Slices of those heights, and how many of them must hold a return.
const SLICES: usize = 4;
const SLICES_MIN: u32 = 3;
/// What leads away to more directions than these is no wall, and what does so to more of them side by side is too thick
/// for one: leaves, or echoes of wide beams behind a stem.
const WALL_DIRECTIONS: std::ops::RangeInclusive<usize> = 1..=8;
const SIDE_BY_SIDE_MAX: usize = 3;

/// The front of a stem: where beams meet it, east and north of the view's corner, the ground there, and its diameter.
#[derive(Clone, Copy, Debug)]
pub struct Front {
    pub at_m: [f64; 2],
    pub ground_m: f64,
    pub diameter_m: f64,
}

/// Whether a wall leads away from the front of a stem.
pub fn is_flat(columns: &ReturnColumns, front: Front) -> bool {
    let from_m = front.diameter_m + 0.1;
    let mut slices = [[0u32; STEPS]; DIRECTIONS];
    for item in columns.around(front.at_m, from_m + STEPS as f64 * STEP_M) {
        let [x, y, z] = item.at_m.map(f64::from);
        let height_m = z - front.ground_m;
        let (east_m, north_m) = (x - front.at_m[0], y - front.at_m[1]);
        let step = (east_m.hypot(north_m) - from_m) / STEP_M;
        if step >= 0.0 && HEIGHTS_M.contains(&height_m) {
            let turn = north_m.atan2(east_m).rem_euclid(TAU) / TAU;
            let slice = (height_m - HEIGHTS_M.start) / (HEIGHTS_M.end - HEIGHTS_M.start) * SLICES as f64;
            let direction = (turn * DIRECTIONS as f64) as usize % DIRECTIONS;
            slices[direction][(step as usize).min(STEPS - 1)] |= 1 << slice as u32;
        }
    }
    // A direction and its neighbour: a wall lies on their border as often as not.
    let leads_away: [bool; DIRECTIONS] = std::array::from_fn(|d| {
        let beside = &slices[(d + 1) % DIRECTIONS];
        slices[d].iter().zip(beside).all(|(a, b)| (a | b).count_ones() >= SLICES_MIN)
    });
    let is_thick = |d: usize| (0..=SIDE_BY_SIDE_MAX).all(|next| leads_away[(d + next) % DIRECTIONS]);
    WALL_DIRECTIONS.contains(&leads_away.iter().filter(|leads| **leads).count()) && !(0..DIRECTIONS).any(is_thick)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::{View, Window};
    use crate::returns::{PlacedBeam, Returns, ReturnsConfig};
    use tsense_geometry::{Point, Timestamp, VoxelGrid};

    /// Whether returns at these places, all heights from 0.4 to 2.6 m, make the front at (5, 5) a part of a wall.
    fn is_wall(places: impl Iterator<Item = [f64; 2]>) -> bool {
        let view = View::unknown(Window { first: [0; 3], size: [80, 80, 40] }, VoxelGrid::new(0.15).unwrap());
        let mut returns = Returns::new(&ReturnsConfig::for_survey());
        for ([x, y], level) in places.flat_map(|at| (0..12).map(move |level| (at, level))) {
            let (origin, end) = (Point::new(1.0, 1.0, 2.0), Point::new(x, y, 1.4 + 0.2 * f64::from(level)));
            returns.insert(&PlacedBeam { ladar: 0, stamp: Timestamp::default(), origin, end, is_return: true });
        }
        returns.settle();
        let columns = ReturnColumns::of(&returns, &view);
        is_flat(&columns, Front { at_m: [5.0, 5.0], ground_m: 1.0, diameter_m: 0.3 })
    }

    fn line(from: i32, to: i32, along: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
        (from..to).map(move |i| [0, 1].map(|axis| 5.0 + 0.1 * f64::from(i) * along[axis]))
    }

    #[test]
    fn the_middle_and_the_end_of_a_wall_and_a_corner_are_flat() {
        assert!(is_wall(line(-20, 20, [0.8, 0.6])));
        assert!(is_wall(line(0, 20, [-0.28, 0.96])));
        assert!(is_wall(line(0, 20, [1.0, 0.0]).chain(line(0, 20, [0.0, 1.0]))));
    }

    #[test]
    fn echoes_of_wide_beams_behind_a_stem_are_not() {
        let behind = (-12..=12).map(|i| f64::from(i) / 24.0).map(|a| [a.cos(), a.sin()]);
        assert!(!is_wall(behind.flat_map(|along| line(2, 14, along))));
    }

    #[test]
    fn a_stem_alone_with_neighbours_or_within_leaves_is_not() {
        assert!(!is_wall(line(0, 2, [1.0, 0.0])));
        assert!(!is_wall(line(0, 2, [1.0, 0.0]).chain(line(7, 9, [1.0, 0.0])).chain(line(8, 10, [0.0, 1.0]))));
        let around = (0..48).map(|i| f64::from(i) / 48.0 * TAU).map(|a| [a.cos(), a.sin()]);
        assert!(!is_wall(around.flat_map(|along| line(0, 14, along))));
    }
}
