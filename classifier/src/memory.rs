//! What the classifier remembers from one snapshot to the next, all of it of places in the window: what it leaves behind is
//! forgotten.
//!
//! Candidates of stems that were judged (see `stems`); for every column when something was last met in it, so that a thing
//! can say how old what it rests on is; what moves; drops that several snapshots proved, which stay until ground is met there; and
//! the things of the snapshot before, which go out with the trees of the next one.

use crate::cluster::Cell;
use crate::drops::Drops;
use crate::moving::Moving;
use crate::returns::ReturnColumns;
use crate::stems;
use crate::traversability::Planes;
use tsense_contract::Detection;
use tsense_geometry::{Raster, RasterShape, Timestamp};

/// Snapshots that must have proven a drop in a cell until it is remembered: one second at 5 Hz.
const PROVEN_MIN: u8 = 5;

/// What is remembered.
pub struct Memory {
    pub(crate) stems: stems::Memory,
    pub(crate) moving: Moving,
    pub(crate) met_ns: Raster<i64>,
    drops_proven: Raster<u8>,
    drops_shown: Raster<u8>,
    things: Vec<Detection>,
    /// Of the snapshot before, for their memory alone: to have several megabytes anew costs as much as to fill them.
    pub(crate) by_column: Option<ReturnColumns>,
    pub(crate) planes: Planes,
}

impl Memory {
    /// Nothing is remembered; a snapshot judges at most `judged_max` candidates of stems.
    pub fn new(judged_max: usize) -> Self {
        let nowhere = RasterShape { first_cell: [0; 2], width: 0, height: 0, cell_m: 1.0 };
        Self {
            stems: stems::Memory::new(judged_max),
            moving: Moving::default(),
            met_ns: Raster::filled(nowhere, 0),
            drops_proven: Raster::filled(nowhere, 0),
            drops_shown: Raster::filled(nowhere, 0),
            things: Vec::new(),
            by_column: None,
            planes: Planes::default(),
        }
    }

    /// Follows the window, and takes down which columns fresh returns lie in.
    pub(crate) fn look(&mut self, shape: RasterShape, columns: Option<&ReturnColumns>, stamp: Timestamp) {
        if self.met_ns.shape() != shape {
            self.met_ns = moved(&self.met_ns, shape);
            self.drops_proven = moved(&self.drops_proven, shape);
            self.drops_shown = moved(&self.drops_shown, shape);
        }
        let fresh = columns.iter().flat_map(|columns| columns.fresh());
        for (met_ns, _) in self.met_ns.cells_mut().iter_mut().zip(fresh).filter(|(_, fresh)| **fresh > 0) {
            *met_ns = stamp.ns;
        }
    }

    /// Drops of this snapshot, and those proven before in cells where no ground was met since.
    pub(crate) fn with_drops(&mut self, mut drops: Drops, met_m: &Raster<f32>) -> Drops {
        remember(&mut drops.cells, &mut self.drops_proven, met_m);
        remember(&mut drops.shown, &mut self.drops_shown, met_m);
        drops
    }

    /// When something was last met in the box around some cells, widened by a margin.
    pub(crate) fn met_ns(&self, cells: &[Cell], margin: usize) -> i64 {
        let shape = self.met_ns.shape();
        let span = |along: fn(&Cell) -> usize, count: usize| {
            let (low, high) = (cells.iter().map(along).min(), cells.iter().map(along).max());
            low.unwrap_or(0).saturating_sub(margin)..high.map_or(0, |high| (high + margin + 1).min(count))
        };
        let (columns, rows) = (span(|cell| cell.0, shape.width), span(|cell| cell.1, shape.height));
        rows.flat_map(|row| columns.clone().map(move |column| (column, row)))
            .map(|at| self.met_ns[at])
            .max()
            .unwrap_or(0)
    }

    /// The things of the snapshot that was finished last.
    pub fn things(&self) -> &[Detection] {
        &self.things
    }

    /// Takes the things of a snapshot.
    pub fn keep_things(&mut self, things: Vec<Detection>) {
        self.things = things;
    }
}

/// Adds the cells that enough snapshots proved, and counts those of this one.
fn remember(drops: &mut Raster<bool>, proven: &mut Raster<u8>, met_m: &Raster<f32>) {
    for ((drop, proven), met_m) in drops.cells_mut().iter_mut().zip(proven.cells_mut()).zip(met_m.cells()) {
        *proven = match (*drop, met_m.is_finite()) {
            (true, _) => proven.saturating_add(1),
            (false, true) => 0,
            (false, false) => *proven,
        };
        *drop |= *proven >= PROVEN_MIN;
    }
}

/// What a raster of the world holds in another window; nothing where it reached not.
fn moved<T: Copy + Default>(old: &Raster<T>, shape: RasterShape) -> Raster<T> {
    let mut new = Raster::filled(shape, T::default());
    let was = old.shape();
    if was.cell_m == shape.cell_m {
        let shift = [0, 1].map(|axis| i64::from(shape.first_cell[axis]) - i64::from(was.first_cell[axis]));
        for row in 0..shape.height {
            for column in 0..shape.width {
                let (x, y) = (column as i64 + shift[0], row as i64 + shift[1]);
                if (0..was.width as i64).contains(&x) && (0..was.height as i64).contains(&y) {
                    new[(column, row)] = old[(x as usize, y as usize)];
                }
            }
        }
    }
    new
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(first_cell: [i32; 2]) -> RasterShape {
        RasterShape { first_cell, width: 4, height: 3, cell_m: 0.15 }
    }

    #[test]
    fn a_raster_of_the_world_keeps_its_places_when_the_window_moves() {
        let old = Raster::from_cells(shape([10, 20]), (1..=12).collect::<Vec<i64>>()).unwrap();
        let new = moved(&old, shape([12, 19]));
        assert_eq!(new.cells(), [0, 0, 0, 0, 3, 4, 0, 0, 7, 8, 0, 0]);
        let coarser = RasterShape { cell_m: 0.3, ..shape([10, 20]) };
        assert!(moved(&old, coarser).cells().iter().all(|cell| *cell == 0));
    }

    #[test]
    fn a_drop_is_remembered_once_proven_until_ground_is_met_there() {
        let mut proven = Raster::filled(shape([0, 0]), 0);
        let mut remembered = |drops: &Raster<bool>, met_m: &Raster<f32>| {
            let mut drops = drops.clone();
            remember(&mut drops, &mut proven, met_m);
            drops.cells()[5]
        };
        let only = |cell: usize| Raster::from_cells(shape([0, 0]), (0..12).map(|i| i == cell).collect()).unwrap();
        let (unmet, none) = (Raster::filled(shape([0, 0]), f32::NAN), Raster::filled(shape([0, 0]), false));
        for _ in 1..PROVEN_MIN {
            remembered(&only(5), &unmet);
        }
        assert!(!remembered(&none, &unmet), "once too few");
        remembered(&only(5), &unmet);
        assert!(remembered(&none, &unmet));
        let mut met_m = unmet.clone();
        met_m.cells_mut()[5] = 1.0;
        assert!(!remembered(&none, &met_m) && !remembered(&none, &unmet));
    }
}
