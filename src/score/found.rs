//! What a survey wrote into its folder, as far as it is scored.

use super::raster::GeoRaster;
use super::shapes::{self, Shape};
use super::table::Table;
use crate::commands::Failure;
use std::path::Path;

/// A tree as reported; NaN where a figure was not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundTree {
    /// Easting and northing at 1.3 m, metres.
    pub at_m: [f64; 2],
    /// Diameter there, metres.
    pub dbh_m: f64,
    /// One sigma of it, metres.
    pub dbh_std_m: f64,
    /// Height, metres.
    pub height_m: f64,
}

/// A survey's results.
pub struct Found {
    /// `trees.csv`.
    pub trees: Vec<FoundTree>,
    /// `dtm.tif`: ground height, metres.
    pub ground: GeoRaster,
    /// `dtm_sd.tif`: one sigma of it, metres, where it was written.
    pub ground_std: Option<GeoRaster>,
    /// `brush.tif`: height of brush, metres, where it was written.
    pub brush: Option<GeoRaster>,
    /// `objects.gpkg`: drops, rocks and walls, where it was written.
    pub shapes: Option<Vec<Shape>>,
}

impl Found {
    /// Reads a survey's folder.
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        let objects = folder.join("objects.gpkg");
        Ok(Self {
            trees: trees(&folder.join("trees.csv"))?,
            ground: GeoRaster::read(&folder.join("dtm.tif"))?,
            ground_std: GeoRaster::read_if_there(&folder.join("dtm_sd.tif"))?,
            brush: GeoRaster::read_if_there(&folder.join("brush.tif"))?,
            shapes: objects.exists().then(|| shapes::read(&objects)).transpose()?,
        })
    }
}

/// The table of trees.
pub fn trees(file: &Path) -> Result<Vec<FoundTree>, Failure> {
    let rows = Table::read(file)?.columns(file, ["easting", "northing", "dbh_m", "?dbh_std_m", "?height_m"])?;
    let tree = |[east, north, dbh_m, dbh_std_m, height_m]: [f64; 5]| FoundTree {
        at_m: [east, north],
        dbh_m,
        dbh_std_m,
        height_m,
    };
    Ok(rows.into_iter().map(tree).collect())
}
