//! A stem's disc at breast height: the columns that it touches, and which of two discs in one place stays.
//!
//! In: discs in metres from the view's corner. Out: cells, and the discs that are left. It does not judge stems.

use super::StemScene;
use crate::cluster::Cell;
use crate::columns::View;
use crate::trunk::{Reason, Rejected};

/// Discs closer than this are one stem, metres.
const APART_M: f64 = 0.1;

/// A start this near to a stem and of no other size leads to it again: metres, and ratio of the radii.
const SAME_M: f64 = 0.05;
const SAME_RATIO: f64 = 1.6;

/// Where a stem stands at breast height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Its axis, east and north of the view's corner, metres.
    pub at_m: [f64; 2],
    /// Its radius, metres.
    pub radius_m: f64,
}

impl Disc {
    /// The columns that it touches.
    pub fn cells(&self, view: &View) -> Vec<Cell> {
        let (shape, [x, y]) = (view.shape, self.at_m);
        let (cell_m, radius_m) = (shape.cell_m, self.radius_m);
        let span = |at: f64, count: usize| {
            let from = ((at - radius_m) / cell_m).floor().max(0.0) as usize;
            from..(((at + radius_m) / cell_m).floor() + 1.0).clamp(0.0, count as f64) as usize
        };
        let gap = |at: f64, i: usize| at.clamp(i as f64 * cell_m, (i + 1) as f64 * cell_m) - at;
        let touches = |&(column, row): &Cell| gap(x, column).hypot(gap(y, row)) <= radius_m;
        let columns = span(x, shape.width);
        span(y, shape.height).flat_map(|row| columns.clone().map(move |column| (column, row))).filter(touches).collect()
    }

    /// Whether a place lies on it.
    pub fn holds(&self, [x, y]: [f64; 2]) -> bool {
        (x - self.at_m[0]).hypot(y - self.at_m[1]) < self.radius_m + APART_M
    }

    /// Whether they are one stem as far as a start can tell.
    pub fn agrees(&self, other: &Self) -> bool {
        let away_m = (self.at_m[0] - other.at_m[0]).hypot(self.at_m[1] - other.at_m[1]);
        let ratio = self.radius_m / other.radius_m;
        away_m < SAME_M && ratio < SAME_RATIO && ratio > 1.0 / SAME_RATIO
    }

    fn overlaps(&self, other: &Self) -> bool {
        Self { radius_m: self.radius_m + other.radius_m, ..*self }.holds(other.at_m)
    }
}

/// Stems whose discs overlap are one stem seen twice: the one with the most weight stays. From south to north.
pub fn best_of_overlapping<T>(
    found: Vec<T>,
    disc: impl Fn(&T) -> Disc,
    weight: impl Fn(&T) -> f64,
    scene: &StemScene,
    rejected: &mut Vec<Rejected>,
) -> Vec<T> {
    let mut weighed: Vec<(f64, T)> = found.into_iter().map(|stem| (weight(&stem), stem)).collect();
    weighed.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<T> = Vec::new();
    for (_, stem) in weighed {
        let own = disc(&stem);
        match kept.iter().find(|other| own.overlaps(&disc(other))) {
            Some(better) => {
                let value = weight(better);
                rejected.push(Rejected { at_m: scene.utm_m(own.at_m), reason: Reason::Double, value });
            }
            None => kept.push(stem),
        }
    }
    kept.sort_by(|a, b| disc(a).at_m[1].total_cmp(&disc(b).at_m[1]));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_agrees_with_a_stem_in_its_place_and_of_its_size() {
        let stem = Disc { at_m: [5.0, 5.0], radius_m: 0.1 };
        let start = |east_m, radius_m| stem.agrees(&Disc { at_m: [east_m, 5.0], radius_m });
        assert!(start(5.04, 0.15) && start(4.96, 0.065));
        assert!(!start(5.06, 0.1) && !start(5.0, 0.17) && !start(5.0, 0.06));
    }
}
