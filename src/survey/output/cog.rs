//! One raster as a cloud-optimised GeoTIFF: north up, in blocks with overviews, deflate, the coordinate system as keys.
//!
//! In: the plan of the plot, then the cells of one tile after the other. Out: a file that QGIS and GDAL open by ranges.
//! Blocks wait in an unlinked temporary file until the overviews are made: memory does not grow with the plot.
//! Blocks that no tile wrote take no room. Source: OGC 21-026 (COG), OGC 19-008r4 (GeoTIFF keys).

use super::bands::{Band, name_bands};
use crate::files::{Aside, OutputError};
use crate::survey::Crs;
use crate::survey::plan::{BLOCK_CELLS, Plan};
use geotiff_writer::{CogBuilder, CogTileWriter, Compression, GeoTiffBuilder, NumericSample, Predictor, Resampling};
use ndarray::Array3;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use tsense_geometry::RasterShape;

/// How the samples of a raster are kept.
#[derive(Clone, Copy, Debug)]
pub struct Samples<T> {
    /// What the values of a cell are.
    pub bands: &'static [Band],
    /// Stands for "not known".
    pub nodata: T,
    /// What deflate is given.
    pub predictor: Predictor,
    /// How overviews are made: means of heights, but no means of codes.
    pub resampling: Resampling,
}

/// A raster file that is not whole yet.
pub struct Cog<T: NumericSample> {
    aside: Aside,
    writer: CogTileWriter<T, BufWriter<File>>,
    plan: Plan,
    bands: &'static [Band],
}

impl<T: NumericSample + std::fmt::Display> Cog<T> {
    /// Opens the file aside.
    pub fn create(path: &Path, plan: &Plan, crs: Option<Crs>, samples: Samples<T>) -> Result<Self, OutputError> {
        let aside = Aside::new(path)?;
        let shape = plan.shape;
        let west = f64::from(shape.first_cell[0]) * shape.cell_m;
        let north = (f64::from(shape.first_cell[1]) + shape.height as f64) * shape.cell_m;
        let mut builder = GeoTiffBuilder::new(shape.width as u32, shape.height as u32)
            .bands(samples.bands.len() as u32)
            .tile_size(BLOCK_CELLS as u32, BLOCK_CELLS as u32)
            .pixel_scale(shape.cell_m, shape.cell_m)
            .origin(west, north)
            .nodata(&samples.nodata.to_string())
            .compression(Compression::Deflate)
            .predictor(samples.predictor)
            .sparse(true);
        if let Some(crs) = crs {
            builder = builder.projected_epsg(crs.horizontal);
            if let Some(code) = crs.vertical {
                builder = builder.vertical_epsg(code);
            }
        }
        let cog = CogBuilder::new(builder).overview_levels(overviews(shape)).resampling(samples.resampling);
        let writer = cog.tile_writer(BufWriter::new(aside.create()?)).map_err(|e| aside.fault(e))?;
        Ok(Self { aside, writer, plan: plan.clone(), bands: samples.bands })
    }

    /// Writes the cells of a tile's core; `value` gives a band of the cell with an index in the core, row by row from
    /// the south-west.
    pub fn add(&mut self, core: RasterShape, value: impl Fn(usize, usize) -> T) -> Result<(), OutputError> {
        let all = self.plan.shape;
        // Rows of rasters go north, rows of images go south.
        let left = (core.first_cell[0] - all.first_cell[0]) as usize;
        let top = all.height - (core.first_cell[1] - all.first_cell[1]) as usize - core.height;
        for y in (0..core.height).step_by(BLOCK_CELLS) {
            for x in (0..core.width).step_by(BLOCK_CELLS) {
                let size = (BLOCK_CELLS.min(core.height - y), BLOCK_CELLS.min(core.width - x), self.bands.len());
                let block = Array3::from_shape_fn(size, |(row, column, band)| {
                    value((core.height - 1 - y - row) * core.width + x + column, band)
                });
                self.writer.write_tile_3d(left + x, top + y, &block.view()).map_err(|e| self.aside.fault(e))?;
            }
        }
        Ok(())
    }

    /// Makes the overviews, writes the file and names its bands; it has its name only after [`Aside::commit`].
    pub fn finish(self) -> Result<Aside, OutputError> {
        let written = self.writer.finish().map_err(|e| self.aside.fault(e))?.flush();
        written.and_then(|()| name_bands(self.aside.part(), self.bands)).map_err(|e| self.aside.fault(e))?;
        Ok(self.aside)
    }
}

/// Halvings until the whole plot fits a block.
fn overviews(shape: RasterShape) -> Vec<u32> {
    let longest = shape.width.max(shape.height);
    (1..16).map(|i| 1u32 << i).take_while(|level| longest * 2 / *level as usize > BLOCK_CELLS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overviews_go_down_to_one_block() {
        let shape = |width| RasterShape { first_cell: [0; 2], width, height: 10, cell_m: 0.15 };
        assert!(overviews(shape(256)).is_empty());
        assert_eq!(overviews(shape(257)), [2]);
        assert_eq!(overviews(shape(2000)), [2, 4, 8]);
    }
}
