//! GeoTIFFs as a survey writes them: one band of numbers, sampled at places.
//!
//! In: a file with a pixel size and a corner (ModelPixelScale, ModelTiepoint), north up. Out: values; NaN outside of the
//! image and where there is no data. The first image counts, overviews and further bands do not. Source: OGC 19-008r4.

use crate::commands::Failure;
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// An image on the ground.
pub struct GeoRaster {
    width: usize,
    height: usize,
    /// Easting of its western, northing of its northern edge, metres.
    corner_m: [f64; 2],
    /// Width and height of a pixel, metres.
    pixel_m: [f64; 2],
    /// From the north-west, row by row; NaN where there is no data.
    values: Vec<f64>,
}

/// GDAL's way to say which value stands for no data, as text.
const GDAL_NODATA: u16 = 42113;

impl GeoRaster {
    /// Reads a file; nothing where there is none.
    pub fn read_if_there(path: &Path) -> Result<Option<Self>, Failure> {
        if path.exists() { Self::read(path).map(Some) } else { Ok(None) }
    }

    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let bytes = super::read(path)?;
        Self::parse(bytes).map_err(|fault| Failure::new(6, format!("{}: {fault}", path.display())))
    }

    fn parse(bytes: Vec<u8>) -> Result<Self, String> {
        let said = |e: tiff::TiffError| e.to_string();
        let mut decoder = Decoder::new(std::io::Cursor::new(bytes)).map_err(said)?;
        let (width, height) = decoder.dimensions().map_err(said)?;
        let (width, height) = (width as usize, height as usize);
        let scale = decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).map_err(said)?;
        let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).map_err(said)?;
        let (&[sx, sy, ..], &[i, j, _, x, y, ..]) = (scale.as_slice(), tie.as_slice()) else {
            return Err("no place on the ground (ModelPixelScale, ModelTiepoint)".into());
        };
        let nodata = decoder.get_tag_ascii_string(Tag::Unknown(GDAL_NODATA)).ok();
        let nodata: Option<f64> = nodata.and_then(|text| text.trim_matches(['\0', ' ']).parse().ok());
        let values: Vec<f64> = match decoder.read_image().map_err(said)? {
            DecodingResult::F32(values) => values.into_iter().map(f64::from).collect(),
            DecodingResult::F64(values) => values,
            DecodingResult::U8(values) => values.into_iter().map(f64::from).collect(),
            _ => return Err("samples that are neither bytes nor floating-point numbers".into()),
        };
        let bands = values.len() / (width * height).max(1);
        let known = |value: f64| if Some(value) == nodata { f64::NAN } else { value };
        let values = values.into_iter().step_by(bands.max(1)).map(known).collect();
        Ok(Self { width, height, corner_m: [x - i * sx, y + j * sy], pixel_m: [sx, sy], values })
    }

    /// The value of the pixel at a place, metres; NaN where none is known.
    pub fn at(&self, easting_m: f64, northing_m: f64) -> f64 {
        let column = ((easting_m - self.corner_m[0]) / self.pixel_m[0]).floor();
        let row = ((self.corner_m[1] - northing_m) / self.pixel_m[1]).floor();
        let inside = column >= 0.0 && row >= 0.0 && column < self.width as f64 && row < self.height as f64;
        let place = (row * self.width as f64 + column) as usize;
        if inside { self.values.get(place).copied().unwrap_or(f64::NAN) } else { f64::NAN }
    }
}
