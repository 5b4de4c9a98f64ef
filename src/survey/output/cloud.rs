//! `cloud.laz`: every return that lies in the plot, classified: LAS 1.4, point format 6, compressed.
//!
//! In: the returns of one tile after the other, with what was found there. Out: coordinates to a millimetre, GPS time
//! where the input has it, the coordinate system as WKT, two extra attributes: `tree_id` (the id in `trees.csv` of the
//! stem that the return lies on, 0 for none) and `height_above_ground` (metres, -9999 where the ground is unknown).
//! Classes: 1 unclassified (no ground known), 2 ground, 3, 4 and 5 vegetation below 0.5 m, below 2 m and above, stems
//! included, 6 walls and sides of buildings, 7 noise (below the ground), 64 other solid things (rocks, logs).
//! Source: ASPRS LAS 1.4 R15.

use super::{LasWriter, Stems};
use crate::files::{Aside, OutputError};
use crate::survey::Crs;
use crate::survey::input::{Clock, Ray};
use crate::survey::piece::Piece;
use las::point::Format;
use las::{Builder, GpsTimeType, PointDataBuilder, Transform, Vector, Vlr};
use std::path::Path;
use tsense_contract::CellClass;

/// Steps of the coordinates, metres.
const STEP_M: f64 = 0.001;
/// Stands for "not known" among heights.
const NODATA: f32 = -9999.0;
/// Solid things that are no walls, among the classes that LAS leaves to its users.
const SOLID: u8 = 64;
/// Returns are the ground's within two sigma of its height, but at least and at most this, metres.
const GROUND_M: [f64; 2] = [0.06, 0.15];
/// Returns below the ground by three sigma, and at least this, are noise, metres.
const BELOW_M: f64 = 0.3;

/// Bytes of a point of format 6 with `tree_id` and `height_above_ground`.
const RECORD: usize = 38;
/// Points that are handed to the compressor at once: 160 KB.
const BATCH: usize = 4096;

/// The file, not whole yet.
pub struct CloudFile {
    aside: Aside,
    writer: LasWriter,
    clock: Clock,
    /// Records of points that wait for the compressor.
    batch: Vec<u8>,
}

/// What is known of a return's place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    /// Above the ground, metres; NaN where that is unknown.
    height_m: f64,
    /// One sigma of the ground, metres.
    ground_std_m: f64,
    class: CellClass,
    is_wall: bool,
}

impl CloudFile {
    /// Opens the file aside. Coordinates are kept relative to the plot's corner.
    pub fn create(path: &Path, crs: Option<Crs>, clock: Clock, corner_m: [f64; 3]) -> Result<Self, OutputError> {
        let aside = Aside::new(path)?;
        let file = aside.create()?;
        let writer = header(crs, clock, corner_m).and_then(|header| LasWriter::new(file, header));
        let writer = writer.map_err(|e| aside.fault(e))?;
        Ok(Self { aside, writer, clock, batch: Vec::with_capacity(BATCH * RECORD) })
    }

    /// Adds a return; `stems` are the trees near the tile with their ids. Whether it lies on a stem.
    pub fn add(&mut self, ray: &Ray, piece: &Piece, stems: &Stems) -> Result<bool, OutputError> {
        let [x, y, z] = ray.end.to_array();
        let Some(place) = Place::of(piece, [x, y, z]) else { return Ok(false) };
        let tree = if place.height_m > GROUND_M[1] { stems.at([x, y], place.height_m) } else { 0 };
        let height_m = if place.height_m.is_nan() { NODATA } else { place.height_m as f32 };
        let time_s = if self.clock == Clock::Unknown { 0.0 } else { ray.stamp.as_seconds() };
        let point = Point { at_m: [x, y, z], class: place.las_class(), time_s, tree, height_m };
        let record = point.record(self.writer.header().transforms()).map_err(|e| self.aside.fault(e))?;
        self.batch.extend_from_slice(&record);
        if self.batch.len() >= BATCH * RECORD {
            self.pack()?;
        }
        Ok(tree != 0)
    }

    /// Compresses the points that wait.
    fn pack(&mut self) -> Result<(), OutputError> {
        let batch = std::mem::replace(&mut self.batch, Vec::with_capacity(BATCH * RECORD));
        let points = PointDataBuilder::new().for_header(self.writer.header()).build_from_bytes(batch);
        points.and_then(|points| self.writer.write_points(&points)).map_err(|e| self.aside.fault(e))
    }

    /// Ends the file.
    pub fn finish(mut self) -> Result<Aside, OutputError> {
        self.pack()?;
        self.writer.close().map_err(|e| self.aside.fault(e))?;
        Ok(self.aside)
    }
}

/// What is written of a return.
struct Point {
    at_m: [f64; 3],
    class: u8,
    time_s: f64,
    tree: u32,
    height_m: f32,
}

impl Point {
    /// As the format has it: one return of one, no intensity, no angle.
    fn record(&self, transforms: &Vector<Transform>) -> Result<[u8; RECORD], las::Error> {
        let Vector { x, y, z } = transforms;
        let mut record = [0; RECORD];
        for (axis, transform) in [x, y, z].into_iter().enumerate() {
            let steps = (self.at_m[axis] - transform.offset) / transform.scale;
            // Halves go away from zero; a cast is one instruction, `round` is a call. What does not fit is told by the library.
            let steps = match steps.abs() < f64::from(i32::MAX) {
                true => (steps + 0.5_f64.copysign(steps)) as i32,
                false => transform.inverse(self.at_m[axis])?,
            };
            record[4 * axis..4 * axis + 4].copy_from_slice(&steps.to_le_bytes());
        }
        // The number of the return and, four bits higher, of how many.
        record[14] = 0x11;
        record[16] = self.class;
        record[22..30].copy_from_slice(&self.time_s.to_le_bytes());
        record[30..34].copy_from_slice(&self.tree.to_le_bytes());
        record[34..38].copy_from_slice(&self.height_m.to_le_bytes());
        Ok(record)
    }
}

fn header(crs: Option<Crs>, clock: Clock, corner_m: [f64; 3]) -> Result<las::Header, las::Error> {
    let mut builder = Builder::from((1, 4));
    builder.point_format = Format::new(6)?;
    builder.point_format.extra_bytes = 8;
    builder.point_format.is_compressed = true;
    builder.gps_time_type = if clock == Clock::GpsStandard { GpsTimeType::Standard } else { GpsTimeType::Week };
    builder.generating_software = format!("tsense {}", env!("CARGO_PKG_VERSION"));
    builder.system_identifier = "survey".into();
    let [x, y, z] = corner_m.map(|c| Transform { scale: STEP_M, offset: c.floor() });
    builder.transforms = Vector { x, y, z };
    builder.vlrs.push(extra_bytes());
    let mut header = builder.into_header()?;
    if let Some(crs) = crs {
        // The text ends with a zero byte.
        header.set_wkt_crs([crs.wkt().as_bytes(), b"\0"].concat())?;
    }
    Ok(header)
}

/// Names and types of the bytes behind each point: types 5 and 9 of the format are `u32` and `f32`.
fn extra_bytes() -> Vlr {
    let describe = |name: &str, kind: u8, words: &str| {
        let mut record = [0u8; 192];
        record[2] = kind;
        record[4..4 + name.len()].copy_from_slice(name.as_bytes());
        record[160..160 + words.len()].copy_from_slice(words.as_bytes());
        record
    };
    let mut height = describe("height_above_ground", 9, "m, -9999 unknown");
    // Bit 0: there is a value for "no data", which is kept as an f64.
    height[3] = 1;
    height[40..48].copy_from_slice(&f64::from(NODATA).to_le_bytes());
    let data = [describe("tree_id", 5, "id in trees.csv, 0 none"), height].concat();
    Vlr { user_id: "LASF_Spec".into(), record_id: 4, description: "extra bytes".into(), data }
}

impl Place {
    /// Nothing outside of the tile's core.
    fn of(piece: &Piece, [x, y, z]: [f64; 3]) -> Option<Self> {
        let cell = piece.core.cell_at(x, y)?;
        let unknown = Self { height_m: f64::NAN, ground_std_m: f64::NAN, class: CellClass::Unknown, is_wall: false };
        let Some(i) = piece.cell_of(cell) else { return Some(unknown) };
        let ground = &piece.found.ground;
        Some(Self {
            height_m: z - ground.base_m - piece.ground_at(x, y).unwrap_or(f64::from(ground.height_m.cells()[i])),
            ground_std_m: ground.std_m.cells()[i].into(),
            class: piece.found.costs.cells()[i].class,
            is_wall: piece.is_wall(cell),
        })
    }

    fn las_class(&self) -> u8 {
        let ground_m = (2.0 * self.ground_std_m).clamp(GROUND_M[0], GROUND_M[1]);
        match self.height_m {
            height_m if height_m.is_nan() => 1,
            height_m if height_m < -BELOW_M.max(3.0 * self.ground_std_m) => 7,
            height_m if height_m <= ground_m => 2,
            _ if self.is_wall => 6,
            _ if self.class == CellClass::Obstacle => SOLID,
            height_m if height_m < 0.5 => 3,
            height_m if height_m < 2.0 => 4,
            _ => 5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_and_cells_decide_the_class() {
        let place = |height_m, class, is_wall| Place { height_m, ground_std_m: 0.02, class, is_wall };
        let ground = CellClass::Ground;
        let cases = [
            (place(f64::NAN, ground, false), 1),
            (place(-0.5, ground, false), 7),
            (place(-0.1, ground, false), 2),
            (place(0.05, CellClass::Obstacle, true), 2),
            (place(0.3, CellClass::Brush, false), 3),
            (place(1.3, CellClass::Tree, false), 4),
            (place(9.0, ground, false), 5),
            (place(1.0, CellClass::Obstacle, true), 6),
            (place(0.4, CellClass::Obstacle, false), 64),
        ];
        for (place, class) in cases {
            assert_eq!(place.las_class(), class, "{place:?}");
        }
        let unsure = Place { ground_std_m: 0.2, ..place(-0.5, ground, false) };
        assert_eq!(unsure.las_class(), 2, "two sigma and a half below a ground that is not known well");
    }

    #[test]
    fn a_record_is_what_the_library_makes_of_the_point() {
        let header = header(None, Clock::Seconds, [369_000.4, 3_279_000.2, 30.0]).unwrap();
        let point =
            Point { at_m: [369012.3456, 3279001.2344, 31.0005], class: 64, time_s: 12.5, tree: 7, height_m: 0.25 };
        let same = las::Point {
            x: point.at_m[0],
            y: point.at_m[1],
            z: point.at_m[2],
            return_number: 1,
            number_of_returns: 1,
            classification: las::point::Classification::new(point.class).unwrap(),
            gps_time: Some(point.time_s),
            extra_bytes: [point.tree.to_le_bytes(), point.height_m.to_le_bytes()].concat(),
            ..las::Point::default()
        };
        let theirs = PointDataBuilder::new().for_header(&header).build_from_points([same]).unwrap();
        assert_eq!(point.record(header.transforms()).unwrap(), *theirs.raw_bytes());
        let far = Point { at_m: [1e9; 3], ..point };
        assert!(far.record(header.transforms()).is_err(), "it does not fit whole millimetres in 32 bits");
    }
}
