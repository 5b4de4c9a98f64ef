//! The rasters of a survey: which there are, what their values mean, how they are rounded.
//!
//! | file | values | nodata |
//! |---|---|---|
//! | `dtm.tif`, `dtm_sd.tif` | height of the ground and one sigma of it, metres, to 1 mm | -9999 |
//! | `chm.tif`, `brush.tif` | height above ground of the highest thing and of brush, metres, to 1 mm | -9999 |
//! | `slope.tif`, `brush_density.tif` | degrees, a share of 1, to 0.01 | -9999 |
//! | `evidence.tif` | how the ground is known: the codes of `GroundEvidence` | 0 |
//! | `traversability.tif` | cost (0 to 253, 254 not to be driven), the code of its reason (`CostReason`) | 255 |

use super::bands::Band;
use super::cog::{Cog, Samples};
use crate::files::{Aside, OutputError};
use crate::survey::Crs;
use crate::survey::piece::Piece;
use crate::survey::plan::Plan;
use geotiff_writer::{Predictor, Resampling};
use std::path::Path;
use tsense_contract::COST_UNKNOWN;

/// Stands for "not known" among numbers.
const NODATA: f32 = -9999.0;

/// A raster of numbers: its file, its band, steps a unit that values are rounded to, what it shows.
type Layer = (&'static str, [Band; 1], f32, fn(&Piece, usize) -> f32);

const fn band(name: &'static str, unit: &'static str) -> [Band; 1] {
    [Band { name, unit }]
}

static LAYERS: [Layer; 6] = [
    ("dtm.tif", band("height of the ground", "m"), 1000.0, |piece, i| {
        piece.found.ground.base_m as f32 + piece.found.ground.height_m.cells()[i]
    }),
    ("dtm_sd.tif", band("one sigma of the ground's height", "m"), 1000.0, |piece, i| {
        piece.found.ground.std_m.cells()[i]
    }),
    ("chm.tif", band("height of the canopy above ground", "m"), 1000.0, Piece::canopy_m),
    ("slope.tif", band("slope of the ground", "degree"), 100.0, |piece, i| piece.slope_deg.cells()[i]),
    ("brush.tif", band("height of brush above ground", "m"), 1000.0, |piece, i| piece.found.brush_m.cells()[i]),
    ("brush_density.tif", band("density of brush", "1"), 100.0, |piece, i| piece.found.brush_density.cells()[i]),
];
static EVIDENCE: [Band; 1] = band("evidence of the ground (code)", "1");
static COSTS: [Band; 2] = [
    Band { name: "cost (0 to 253, 254 not to be driven)", unit: "1" },
    Band { name: "reason of the cost (code)", unit: "1" },
];

/// The raster files of a survey, not whole yet.
pub struct Rasters {
    layers: Vec<(&'static Layer, Cog<f32>)>,
    evidence: Cog<u8>,
    costs: Cog<u8>,
}

impl Rasters {
    /// Opens all of them aside.
    pub fn create(folder: &Path, plan: &Plan, crs: Option<Crs>) -> Result<Self, OutputError> {
        let numbers = |bands| Samples {
            bands,
            nodata: NODATA,
            predictor: Predictor::FloatingPoint,
            resampling: Resampling::Average,
        };
        let codes = |bands, nodata| Samples {
            bands,
            nodata,
            predictor: Predictor::None,
            resampling: Resampling::NearestNeighbor,
        };
        let layers: Result<_, _> = LAYERS
            .iter()
            .map(|layer| Ok((layer, Cog::create(&folder.join(layer.0), plan, crs, numbers(&layer.1))?)))
            .collect();
        Ok(Self {
            layers: layers?,
            evidence: Cog::create(&folder.join("evidence.tif"), plan, crs, codes(&EVIDENCE, 0))?,
            costs: Cog::create(&folder.join("traversability.tif"), plan, crs, codes(&COSTS, COST_UNKNOWN))?,
        })
    }

    /// Writes a tile's cells.
    pub fn add(&mut self, piece: &Piece) -> Result<(), OutputError> {
        for ((_, _, steps, value), file) in &mut self.layers {
            file.add(piece.core, |i, _| rounded(piece.cell(i).map_or(f32::NAN, |i| value(piece, i)), *steps))?;
        }
        let evidence = piece.found.ground.evidence.cells();
        self.evidence.add(piece.core, |i, _| piece.cell(i).map_or(0, |i| evidence[i].to_wire()))?;
        self.costs.add(piece.core, |i, band| {
            let cost = piece.cell(i).map(|i| piece.found.costs.cells()[i]).filter(|cost| cost.cost != COST_UNKNOWN);
            cost.map_or(COST_UNKNOWN, |cost| [cost.cost, cost.reason.to_wire()][band])
        })
    }

    /// Writes the files; they have their names only when they are committed.
    pub fn finish(self) -> Result<Vec<Aside>, OutputError> {
        let layers = self.layers.into_iter().map(|(_, file)| file.finish());
        layers.chain([self.evidence.finish(), self.costs.finish()]).collect()
    }
}

/// NaN becomes nodata; rounding lets deflate do its work.
fn rounded(value: f32, steps: f32) -> f32 {
    if value.is_nan() { NODATA } else { ((f64::from(value) * f64::from(steps)).round() / f64::from(steps)) as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_whole_millimetres_and_what_is_not_known_is_nodata() {
        assert_eq!(
            [rounded(30.1234, 1000.0), rounded(12.349, 100.0), rounded(f32::NAN, 1000.0)],
            [30.123, 12.35, NODATA]
        );
    }
}
