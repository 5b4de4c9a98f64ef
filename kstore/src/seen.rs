//! What the Smart Sensor Grid of a snapshot says of a place where an object is believed to stand.
//!
//! In: the grid's header and cells, places in UTM metres. Out: a [`View`]. Only a cell whose ground was measured is
//! evidence: behind a trunk, out of the sensor's turn or faded from the map, nothing is held against an object.

use crate::decay::View;
use crate::zone::Zone;
use tsense_contract::{CellClass, GridCell, GridHeader, GroundEvidence};
use tsense_geometry::RasterShape;

/// Vegetation lower than this is bare ground to a trunk, metres.
const BARE_VEGETATION_M: f32 = 0.2;

/// A grid that can be looked at.
pub struct Seen<'a> {
    shape: RasterShape,
    cells: &'a [GridCell],
}

impl<'a> Seen<'a> {
    /// A grid of a zone; nothing where its header does not fit its cells, or it is of another zone.
    pub fn new(header: &GridHeader, cells: &'a [GridCell], zone: Zone) -> Option<Self> {
        let (width, height) = (usize::try_from(header.width).ok()?, usize::try_from(header.height).ok()?);
        let shape = RasterShape { first_cell: header.first_cell, width, height, cell_m: header.cell_m };
        let fits = width.checked_mul(height) == Some(cells.len()) && header.cell_m.is_finite() && header.cell_m > 0.0;
        let same_zone = Zone::from_wire(header.zone, header.south) == Some(zone);
        (fits && same_zone).then_some(Self { shape, cells })
    }

    /// The place's own cell and its eight neighbours: a place is known to about a cell.
    pub fn view(&self, [east_m, north_m]: [f64; 2]) -> View {
        let around = [-1.0, 0.0, 1.0].map(|step| step * self.shape.cell_m);
        let places = around.iter().flat_map(|north| around.iter().map(move |east| (east_m + east, north_m + north)));
        let cells: Vec<Option<&GridCell>> = places.map(|(east, north)| self.cell(east, north)).collect();
        if !cells.iter().flatten().any(|c| is_measured(c)) {
            return View::Unseen;
        }
        let middle_is_measured = cells[4].is_some_and(is_measured);
        let all_bare = cells.iter().flatten().all(|c| is_bare(c));
        if middle_is_measured && all_bare {
            return View::BareGround;
        }
        let lies_there = |kind: &CellClass| cells.iter().flatten().any(|c| CellClass::from_wire(c.class) == *kind);
        let kinds = [CellClass::Obstacle, CellClass::Brush];
        kinds.into_iter().find(lies_there).map_or(View::Unconfirmed, View::Holds)
    }

    fn cell(&self, east_m: f64, north_m: f64) -> Option<&GridCell> {
        let (column, row) = self.shape.cell_at(east_m, north_m)?;
        self.cells.get(row * self.shape.width + column)
    }
}

fn is_measured(cell: &GridCell) -> bool {
    GroundEvidence::from_wire(cell.evidence) == GroundEvidence::Measured
}

/// Nothing stands on it that is known of.
fn is_bare(cell: &GridCell) -> bool {
    matches!(CellClass::from_wire(cell.class), CellClass::Ground | CellClass::Unknown)
        && (cell.vegetation_m.is_nan() || cell.vegetation_m < BARE_VEGETATION_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_contract::CostReason;

    const SIDE: u32 = 8;

    fn cell(evidence: GroundEvidence, class: CellClass, vegetation_m: f32) -> GridCell {
        let (evidence, class) = (evidence.to_wire(), class.to_wire());
        let reason = CostReason::Clear.to_wire();
        GridCell { vegetation_m, reason, evidence, class, ..bytemuck::Zeroable::zeroed() }
    }

    fn header() -> GridHeader {
        GridHeader {
            stamp_ns: 0,
            classified_ns: 0,
            snapshot: 1,
            cell_m: 0.5,
            base_m: 0.0,
            first_cell: [0, 0],
            width: SIDE,
            height: SIDE,
            zone: 17,
            south: 0,
            reserved: [0; 6],
        }
    }

    /// A grid of one kind of cell with another in the middle of cell (4, 4); looked at there.
    fn check(all: GridCell, middle: GridCell, expected: View) {
        let mut cells = vec![all; (SIDE * SIDE) as usize];
        cells[(4 * SIDE + 4) as usize] = middle;
        let zone = Zone::from_wire(17, 0).unwrap();
        assert_eq!(Seen::new(&header(), &cells, zone).unwrap().view([2.25, 2.25]), expected);
    }

    #[test]
    fn only_measured_ground_speaks_against_an_object() {
        let bare = cell(GroundEvidence::Measured, CellClass::Ground, 0.0);
        let unknown = cell(GroundEvidence::Unknown, CellClass::Unknown, 0.0);
        let interpolated = cell(GroundEvidence::Interpolated, CellClass::Ground, 0.0);
        check(bare, bare, View::BareGround);
        check(unknown, unknown, View::Unseen);
        check(interpolated, interpolated, View::Unseen);
        check(bare, interpolated, View::Unconfirmed); // Something hides the ground in the middle.
        check(bare, cell(GroundEvidence::Measured, CellClass::Tree, 0.0), View::Unconfirmed);
    }

    #[test]
    fn what_lies_there_is_told_solid_things_first() {
        let [bare, brush, drop, solid] = [CellClass::Ground, CellClass::Brush, CellClass::Drop, CellClass::Obstacle]
            .map(|class| cell(GroundEvidence::Measured, class, 0.0));
        check(bare, brush, View::Holds(CellClass::Brush));
        check(brush, bare, View::Holds(CellClass::Brush));
        check(bare, drop, View::Unconfirmed);
        check(brush, solid, View::Holds(CellClass::Obstacle));
        let unseen = cell(GroundEvidence::Interpolated, CellClass::Obstacle, 0.0);
        check(unseen, unseen, View::Unseen);
    }

    #[test]
    fn outside_the_grid_nothing_is_seen_and_a_grid_that_does_not_fit_is_none() {
        let cells = vec![cell(GroundEvidence::Measured, CellClass::Ground, 0.0); (SIDE * SIDE) as usize];
        let zone = Zone::from_wire(17, 0).unwrap();
        let seen = Seen::new(&header(), &cells, zone).unwrap();
        assert_eq!(seen.view([100.0, 2.0]), View::Unseen);
        assert_eq!(seen.view([f64::NAN, 2.0]), View::Unseen);
        assert!(Seen::new(&header(), &cells[1..], zone).is_none());
        assert!(Seen::new(&GridHeader { cell_m: f64::NAN, ..header() }, &cells, zone).is_none());
        assert!(Seen::new(&header(), &cells, Zone::from_wire(18, 0).unwrap()).is_none());
    }
}
