//! `cloud.laz`: every return that lies in the plot, classified: LAS 1.4, point format 6, compressed.
//!
//! In: the returns of one tile after the other, with what was found there. Out: coordinates to a millimetre, GPS time
//! where the input has it, the coordinate system as WKT, two extra attributes: `tree_id` (the id in `trees.csv` of the
//! stem that the return lies on, 0 for none) and `height_above_ground` (metres, -9999 where the ground is unknown).
//! Classes: 1 unclassified (no ground known), 2 ground, 3, 4 and 5 vegetation below 0.5 m, below 2 m and above, stems
//! included, 6 walls and sides of buildings, 7 noise (below the ground), 64 other solid things (rocks, logs).
//! Source: ASPRS LAS 1.4 R15.

use super::{Aside, OutputError};
use crate::survey::Crs;
use crate::survey::input::{Clock, Ray};
use crate::survey::piece::Piece;
use las::point::{Classification, Format};
use las::{Builder, GpsTimeType, Point, Transform, Vector, Vlr, Writer};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use tsense_contract::{CellClass, Detection};

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
/// Returns are a stem's up to this far off its surface, metres.
const BARK_M: f64 = 0.08;

/// The file, not whole yet.
pub struct CloudFile {
    aside: Aside,
    writer: Writer<BufWriter<File>>,
    clock: Clock,
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
        let aside = Aside::new(path);
        let file = BufWriter::new(aside.create()?);
        let writer = header(crs, clock, corner_m).and_then(|header| Writer::new(file, header));
        let writer = writer.map_err(|e| aside.fault(e))?;
        Ok(Self { aside, writer, clock })
    }

    /// Adds a return; `stems` are the trees near the tile with their ids. Whether it lies on a stem.
    pub fn add(&mut self, ray: &Ray, piece: &Piece, stems: &Stems) -> Result<bool, OutputError> {
        let [x, y, z] = ray.end.to_array();
        let Some(place) = Place::of(piece, [x, y, z]) else { return Ok(false) };
        let tree = if place.height_m > GROUND_M[1] { stems.at([x, y], place.height_m) } else { 0 };
        let height_m = if place.height_m.is_nan() { NODATA } else { place.height_m as f32 };
        let point = Point {
            x,
            y,
            z,
            return_number: 1,
            number_of_returns: 1,
            classification: Classification::new(place.las_class()).unwrap_or_default(),
            gps_time: Some(if self.clock == Clock::Unknown { 0.0 } else { ray.stamp.as_seconds() }),
            extra_bytes: [tree.to_le_bytes(), height_m.to_le_bytes()].concat(),
            ..Point::default()
        };
        self.writer.write_point(point).map_err(|e| self.aside.fault(e))?;
        Ok(tree != 0)
    }

    /// Ends the file.
    pub fn finish(mut self) -> Result<Aside, OutputError> {
        self.writer.close().map_err(|e| self.aside.fault(e))?;
        Ok(self.aside)
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
        let (column, row) = piece.core.cell_at(x, y)?;
        let own = row * piece.core.width + column;
        let unknown = Self { height_m: f64::NAN, ground_std_m: f64::NAN, class: CellClass::Unknown, is_wall: false };
        let Some(i) = piece.cell(own) else { return Some(unknown) };
        let ground = &piece.found.ground;
        Some(Self {
            height_m: z - ground.base_m - piece.ground_at(x, y).unwrap_or(f64::from(ground.height_m.cells()[i])),
            ground_std_m: ground.std_m.cells()[i].into(),
            class: piece.found.costs.cells()[i].class,
            is_wall: piece.is_wall(own),
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

/// The stems around a tile, by which returns find their tree.
pub struct Stems(Vec<(u32, Detection)>);

impl Stems {
    /// The trees around a tile; ids count from 1.
    pub fn around(trees: &[Detection], [west, south, east, north]: [f64; 4]) -> Self {
        let near =
            |tree: &Detection| (west..=east).contains(&tree.easting_m) && (south..=north).contains(&tree.northing_m);
        let mut stems: Vec<_> = (1..).zip(trees.iter().copied()).filter(|(_, tree)| near(tree)).collect();
        stems.sort_by(|a, b| a.1.easting_m.total_cmp(&b.1.easting_m));
        Self(stems)
    }

    /// The id of the stem whose surface a place lies on, at a height above ground; 0 for none.
    fn at(&self, [x, y]: [f64; 2], height_m: f64) -> u32 {
        // No stem is thicker, or leans farther, than this.
        const REACH_M: f64 = 3.0;
        let from = self.0.partition_point(|(_, tree)| tree.easting_m < x - REACH_M);
        let near = self.0[from..].iter().take_while(|(_, tree)| tree.easting_m <= x + REACH_M);
        let off = |tree: &Detection| {
            let up_m = height_m - tsense_classifier::BREAST_HEIGHT_M;
            let axis = |at: f64, lean: f32| at + up_m * f64::from(lean).tan();
            let away_m =
                (x - axis(tree.easting_m, tree.lean_rad[0])).hypot(y - axis(tree.northing_m, tree.lean_rad[1]));
            away_m - f64::from(tree.dbh_m) / 2.0
        };
        let stands = |tree: &Detection| tree.height_m.is_nan() || height_m <= f64::from(tree.height_m);
        let offs = near.filter(|(_, tree)| stands(tree)).map(|(id, tree)| (off(tree), *id));
        // NaN where no diameter was measured: it is on nothing.
        let nearest = offs.filter(|(off, _)| *off <= BARK_M).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map_or(0, |(_, id)| id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

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
