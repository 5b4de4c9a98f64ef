//! Rasters as GeoTIFF: north up, deflate, values that are not known as nodata.

use super::{OutputError, write_whole};
use geotiff_writer::{Compression, GeoTiffBuilder, Predictor};
use ndarray::Array2;
use std::path::Path;
use tsense_geometry::Raster;

/// Stands for "not known" in the files.
const NODATA: f32 = -9999.0;

/// Writes a raster; NaN becomes nodata. Heights are rounded to a millimetre, which lets deflate do its work.
pub fn write_geotiff(path: &Path, raster: &Raster<f32>, epsg: Option<u16>) -> Result<(), OutputError> {
    let shape = raster.shape();
    // Raster rows go north, image rows go south.
    let image = Array2::from_shape_fn((shape.height, shape.width), |(row, column)| {
        let value = raster[(column, shape.height - 1 - row)];
        if value.is_nan() { NODATA } else { (value * 1000.0).round() / 1000.0 }
    });
    let west = f64::from(shape.first_cell[0]) * shape.cell_m;
    let north = (f64::from(shape.first_cell[1]) + shape.height as f64) * shape.cell_m;
    let mut builder = GeoTiffBuilder::new(shape.width as u32, shape.height as u32)
        .pixel_scale(shape.cell_m, shape.cell_m)
        .origin(west, north)
        .nodata(&NODATA.to_string())
        .compression(Compression::Deflate)
        .predictor(Predictor::FloatingPoint);
    if let Some(code) = epsg {
        builder = builder.projected_epsg(code);
    }
    write_whole(path, |writer| builder.write_2d_to(writer, image.view()))
}
