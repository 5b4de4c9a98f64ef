//! The shapes of `objects.gpkg` as the cells of a lattice that they cover.
//!
//! In: a survey's file; of its layers those of drops, rocks and walls. Out: cells, counted in [`STEP_M`] from the origin of the
//! coordinates. A cell is covered where its middle lies inside. Source: OGC 12-128r19, OGC 06-103r4 (WKB).

use crate::commands::Failure;
use geopackage::GeoPackage;
use geopackage::core::gpb::body_offset;
use std::collections::BTreeSet;
use std::path::Path;
use tsense_simulator::ThingKind;

/// Edge of a cell, metres: a voxel's.
pub const STEP_M: f64 = 0.15;

/// The layers.
const LAYERS: [(&str, ThingKind); 3] =
    [("drops", ThingKind::Drop), ("rocks", ThingKind::Rock), ("walls", ThingKind::Wall)];

/// Most cells of a shape, and most rows that it spans: 90,000 square metres, 100 km. What is larger is no drop, rock or wall.
const CELLS_MAX: i64 = 4_000_000;
const ROWS_MAX: f64 = 100e3 / STEP_M;

/// A ring of corners, easting and northing, metres.
type Ring = Vec<[f64; 2]>;

/// A drop, a rock or a wall.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// What it is.
    pub kind: ThingKind,
    /// Columns and rows of the cells it covers.
    pub cells: BTreeSet<[i64; 2]>,
}

/// The middle of a cell, metres.
pub fn middle_m(cell: [i64; 2]) -> [f64; 2] {
    cell.map(|i| (i as f64 + 0.5) * STEP_M)
}

impl Shape {
    /// Nothing where it is larger than any of its kind, or not finite.
    fn new(kind: ThingKind, rings: &[Ring]) -> Option<Self> {
        Some(Self { kind, cells: covered(rings)?.into_iter().collect() })
    }

    /// The mean of its cells, metres; nothing where it covers none.
    pub fn middle_m(&self) -> Option<[f64; 2]> {
        let mean =
            |axis: usize| self.cells.iter().map(|cell| middle_m(*cell)[axis]).sum::<f64>() / self.cells.len() as f64;
        (!self.cells.is_empty()).then(|| [0, 1].map(mean))
    }
}

/// The shapes of a file.
pub fn read(path: &Path) -> Result<Vec<Shape>, Failure> {
    let corrupt = |fault: String| Failure::new(6, format!("{}: {fault}", path.display()));
    let failed = |e: geopackage::Error| corrupt(e.to_string());
    let file = GeoPackage::open_read_only(path).map_err(failed)?;
    let mut shapes = Vec::new();
    for (name, kind) in LAYERS {
        for feature in file.layer(name).and_then(|layer| layer.features()).map_err(failed)? {
            let feature = feature.map_err(failed)?;
            let blob = feature.geometry_bytes().unwrap_or_default();
            let wkb = body_offset(blob).ok().and_then(|at| blob.get(at..));
            let rings = wkb.and_then(rings).ok_or_else(|| corrupt(format!("one of the {name} without an outline")))?;
            let shape = Shape::new(kind, &rings);
            shapes.push(shape.ok_or_else(|| {
                corrupt(format!("one of the {name} is not finite, or larger than 90,000 m² or 100 km"))
            })?);
        }
    }
    Ok(shapes)
}

/// The rings of polygons, little-endian WKB; nothing where it is anything else.
fn rings(wkb: &[u8]) -> Option<Vec<Ring>> {
    let mut rest = wkb;
    let mut take = |count: usize| {
        let (taken, left) = rest.split_at_checked(count)?;
        rest = left;
        Some(taken)
    };
    let head = |bytes: &[u8], kind: u32| (bytes[0] == 1 && bytes[1..5] == kind.to_le_bytes()).then_some(());
    let number = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let mut rings = Vec::new();
    head(take(5)?, 6)?;
    for _ in 0..number(take(4)?) {
        head(take(5)?, 3)?;
        for _ in 0..number(take(4)?) {
            let count = number(take(4)?) as usize;
            let corners = take(count.checked_mul(16)?)?;
            let (numbers, _) = corners.as_chunks::<8>();
            let numbers: Vec<f64> = numbers.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
            rings.push(numbers.chunks_exact(2).map(|at| [at[0], at[1]]).collect());
        }
    }
    Some(rings)
}

/// Cells whose middle lies inside of the rings, row by row: between every other crossing of an edge. Nothing where they are
/// too many.
fn covered(rings: &[Ring]) -> Option<Vec<[i64; 2]>> {
    let edges = || rings.iter().flat_map(|ring| ring.windows(2));
    let northings = || edges().flatten().map(|corner| corner[1] / STEP_M);
    let [south, north] = [northings().fold(f64::INFINITY, f64::min), northings().fold(f64::NEG_INFINITY, f64::max)];
    let is_finite = rings.iter().flatten().flatten().all(|c| c.is_finite());
    if !is_finite || north - south > ROWS_MAX {
        return None;
    }
    let mut cells = Vec::new();
    for row in south.floor() as i64..north.ceil() as i64 {
        let y = middle_m([0, row])[1];
        let crossing = |edge: &[[f64; 2]]| {
            let [[x0, y0], [x1, y1]] = [edge[0], edge[1]];
            ((y0 > y) != (y1 > y)).then(|| x0 + (x1 - x0) * (y - y0) / (y1 - y0))
        };
        let mut crossings: Vec<f64> = edges().filter_map(crossing).collect();
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let [from, to] = [pair[0], pair[1]].map(|x| (x / STEP_M - 0.5).ceil() as i64);
            if to.saturating_sub(from).saturating_add(cells.len() as i64) > CELLS_MAX {
                return None;
            }
            cells.extend((from..to).map(|column| [column, row]));
        }
    }
    Some(cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(from: f64, to: f64) -> Ring {
        [[from, from], [to, from], [to, to], [from, to], [from, from]].map(|at| at.map(|i| i * STEP_M)).to_vec()
    }

    #[test]
    fn a_shape_covers_its_cells_and_not_its_holes() {
        let shape = Shape::new(ThingKind::Drop, &[square(10.0, 15.0), square(12.0, 13.0)]).unwrap();
        assert_eq!((shape.cells.len(), shape.cells.contains(&[12, 12])), (24, false));
        assert!(shape.cells.contains(&[10, 14]) && !shape.cells.contains(&[15, 14]));
        assert!(shape.middle_m().unwrap().iter().all(|m| (m - 12.5 * STEP_M).abs() < 1e-9));
    }

    #[test]
    fn a_shape_without_end_is_none() {
        let far = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, 1e7, 3e3];
        assert!(far.iter().all(|far| Shape::new(ThingKind::Rock, &[square(0.0, *far)]).is_none()));
        let wide = vec![[0.0, 0.0], [1e300, 0.0], [1e300, 1.0], [0.0, 1.0], [0.0, 0.0]];
        assert!(Shape::new(ThingKind::Rock, &[wide]).is_none());
    }

    #[test]
    fn outlines_read_from_their_bytes_and_a_cut_one_does_not() {
        let (outer, hole) = (square(0.0, 4.0), square(1.0, 2.0));
        let ring = |ring: &Ring| {
            [&[5, 0, 0, 0][..], &ring.concat().iter().flat_map(|m| m.to_le_bytes()).collect::<Vec<_>>()].concat()
        };
        let polygon = [&[1, 3, 0, 0, 0, 2, 0, 0, 0][..], &ring(&outer), &ring(&hole)].concat();
        let wkb = [&[1, 6, 0, 0, 0, 1, 0, 0, 0][..], &polygon].concat();
        assert_eq!(rings(&wkb), Some(vec![outer, hole]));
        assert_eq!((rings(&wkb[..wkb.len() - 1]), rings(&polygon), rings(&[])), (None, None, None));
    }
}
