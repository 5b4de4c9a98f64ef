//! Points as LAS 1.4 or LAZ: point format 2 (colour), occupancy and confidence as extra bytes, the coordinate system as
//! GeoTIFF keys.
//!
//! Format 2 rather than 7, because LAS 1.4 asks for WKT with the newer formats, and a code is all a map knows. Source:
//! ASPRS LAS 1.4 R15, extra bytes record (record 4 of `LASF_Spec`) and GeoKeyDirectoryTag (record 34735).

use super::points::VoxelPoint;
use crate::survey::output::LasWriter;
use ::las::point::Format;
use ::las::{Builder, Color, Point, Transform, Vector, Vlr};
use std::fs::File;
use tsense_mapper::tsmap::MapFileHeader;

/// Steps of the coordinates, metres: centres of all voxel sizes in millimetres fall on them, and 32 bits reach 200 km.
const STEP_M: f64 = 0.0001;

/// A file that points are put into.
pub struct LasFile(LasWriter);

impl LasFile {
    /// Writes the header. Coordinates are kept relative to `corner_m`, the smallest ones, in whole metres.
    pub fn new(file: File, header: &MapFileHeader, corner_m: [f64; 3], is_laz: bool) -> Result<Self, ::las::Error> {
        let mut builder = Builder::from((1, 4));
        builder.point_format = Format::new(2)?;
        builder.point_format.extra_bytes = 2;
        builder.point_format.is_compressed = is_laz;
        builder.generating_software = format!("tsense {}", env!("CARGO_PKG_VERSION"));
        builder.system_identifier = "voxel map".into();
        let [x, y, z] = corner_m.map(|c| Transform { scale: STEP_M, offset: c.floor() });
        builder.transforms = Vector { x, y, z };
        builder.vlrs.push(extra_bytes());
        builder.vlrs.extend((header.epsg != 0).then(|| geo_keys(header.epsg)));
        Ok(Self(LasWriter::new(file, builder.into_header()?)?))
    }

    /// Puts a point in; colours are widened to 16 bits as the format has it.
    pub fn add(&mut self, point: &VoxelPoint, color: [u8; 3]) -> Result<(), ::las::Error> {
        let [red, green, blue] = color.map(|c| u16::from(c) * 257);
        let [x, y, z] = point.at_m;
        self.0.write_point(Point {
            x,
            y,
            z,
            return_number: 1,
            number_of_returns: 1,
            color: Some(Color { red, green, blue }),
            extra_bytes: vec![point.occupancy as u8, point.confidence],
            ..Point::default()
        })
    }

    /// Ends the file.
    pub fn close(self) -> Result<(), ::las::Error> {
        self.0.close()
    }
}

/// The names and types of the two bytes behind each point.
fn extra_bytes() -> Vlr {
    let mut data = Vec::new();
    // Types of the format: 2 is a signed byte, 1 an unsigned one.
    for (name, kind, words) in
        [("occupancy", 2u8, "above 0 occupied, below free"), ("confidence", 1, "evidence behind it, faded")]
    {
        let mut descriptor = [0u8; 192];
        descriptor[2] = kind;
        descriptor[4..4 + name.len()].copy_from_slice(name.as_bytes());
        descriptor[160..160 + words.len()].copy_from_slice(words.as_bytes());
        data.extend(descriptor);
    }
    Vlr { user_id: "LASF_Spec".into(), record_id: 4, description: "extra bytes".into(), data }
}

/// A projected system by its code: GTModelType projected, ProjectedCRS, metres.
fn geo_keys(epsg: u16) -> Vlr {
    let keys: [[u16; 4]; 4] = [[1, 1, 0, 3], [1024, 0, 1, 1], [3072, 0, 1, epsg], [3076, 0, 1, 9001]];
    let data = keys.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    Vlr { user_id: "LASF_Projection".into(), record_id: 34_735, description: "GeoKeyDirectoryTag".into(), data }
}
