//! The truth of a plot: trees, ground, brush, and where the scanner stood; the layout is that of docs/survey.md.
//!
//! In: a folder with `rays.ply`, `trees.csv`, `ground.npz`, `labels.npy`, `scans.csv` and `meta.json`. Out: metres, UTM.
//! Brush is what the scanner met of the understorey: the highest return of that class in a cell of 0.3 m, above the
//! true ground, below 3 m, where at least three such returns lie.

use super::numbers::{Array, read_npy, read_npz};
use super::table::Table;
use crate::commands::Failure;
use crate::survey::input::{self, InputOptions};
use std::path::{Path, PathBuf};

/// The label of understorey.
const UNDERSTOREY: f64 = 5.0;
/// Cells of the ground and of brush, metres.
pub const GROUND_CELL_M: f64 = 0.15;
pub const BRUSH_CELL_M: f64 = 0.3;
/// Brush is lower than this, metres.
const BRUSH_BELOW_M: f64 = 3.0;

/// A tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueTree {
    /// Easting and northing of its axis at 1.3 m, metres.
    pub at_m: [f64; 2],
    /// Diameter there, metres.
    pub dbh_m: f64,
    /// Height, metres.
    pub height_m: f64,
}

/// A cell of brush.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrueBrush {
    /// Highest understorey return above ground, metres.
    pub height_m: f64,
    /// Such returns.
    pub returns: u32,
}

/// A plot.
pub struct Truth {
    /// The folder's name.
    pub name: String,
    /// The seed it was made from, where meta.json says.
    pub seed: Option<u64>,
    /// Its rays.
    pub rays: PathBuf,
    /// Number of rays.
    pub ray_count: usize,
    /// South-western corner and edge, metres.
    pub corner_m: [f64; 2],
    /// Edge, metres.
    pub size_m: f64,
    /// All trees.
    pub trees: Vec<TrueTree>,
    /// Ground heights, row by row from the south-west, `ground_width` a row.
    pub ground_m: Vec<f64>,
    /// Ground returns a cell.
    pub ground_hits: Vec<f64>,
    /// Cells a row.
    pub ground_width: usize,
    /// Brush, row by row from the south-west, `brush_width` a row and as many rows.
    pub brush: Vec<TrueBrush>,
    /// Cells a row.
    pub brush_width: usize,
    /// Where the scanner stood: easting, northing, metres.
    pub stops_m: Vec<[f64; 2]>,
}

impl Truth {
    /// Whether a folder holds a plot.
    pub fn is_in(folder: &Path) -> bool {
        ["rays.ply", "trees.csv", "ground.npz"].iter().all(|file| folder.join(file).is_file())
    }

    /// Reads a plot.
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        let corrupt = |file: &Path, fault: String| Failure::new(6, format!("{}: {fault}", file.display()));
        let file = folder.join("ground.npz");
        let arrays = read_npz(&super::read(&file)?).map_err(|fault| corrupt(&file, fault))?;
        let array = |name: &str| arrays.get(name).ok_or_else(|| corrupt(&file, format!("no array '{name}'")));
        let number = |name: &str| {
            let array: &Array = array(name)?;
            array.values.first().copied().ok_or_else(|| corrupt(&file, format!("'{name}' holds no number")))
        };
        let (z, hits) = (array("z")?, array("hits")?);
        let &[_, ground_width] = z.shape.as_slice() else {
            return Err(corrupt(&file, format!("'z' of shape {:?}; rows and columns are wanted", z.shape)));
        };
        if hits.values.len() != z.values.len() || ground_width == 0 {
            return Err(corrupt(&file, "'z' and 'hits' of different shapes".into()));
        }
        let mut truth = Self {
            name: folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(),
            seed: seed_of(folder),
            rays: folder.join("rays.ply"),
            ray_count: 0,
            corner_m: [number("x0")?, number("y0")?],
            size_m: number("size")?,
            trees: trees(&folder.join("trees.csv"))?,
            ground_m: z.values.clone(),
            ground_hits: hits.values.clone(),
            ground_width,
            brush: Vec::new(),
            brush_width: 0,
            stops_m: Table::read(&folder.join("scans.csv"))?.columns(&folder.join("scans.csv"), ["x", "y"])?,
        };
        truth.see_brush(&folder.join("labels.npy"))?;
        Ok(truth)
    }

    /// Height of the true ground in the cell at a place that lies inside.
    fn ground_at_m(&self, [east_m, north_m]: [f64; 2]) -> f64 {
        let rows = self.ground_m.len() / self.ground_width;
        let cell = |along_m: f64, cells: usize| ((along_m / GROUND_CELL_M) as usize).min(cells - 1);
        let (column, row) = (cell(east_m, self.ground_width), cell(north_m, rows));
        self.ground_m[row * self.ground_width + column]
    }

    /// Goes through the rays and keeps the highest understorey of each cell.
    fn see_brush(&mut self, labels: &Path) -> Result<(), Failure> {
        let fault = |fault: String| Failure::new(6, format!("{}: {fault}", labels.display()));
        let labels = read_npy(&super::read(labels)?).map_err(fault)?.values;
        self.ray_count = labels.len();
        self.brush_width = (self.size_m / BRUSH_CELL_M) as usize;
        self.brush = vec![TrueBrush::default(); self.brush_width * self.brush_width];
        let rays = input::open(&self.rays, &InputOptions::default()).map_err(|e| Failure::new(6, e))?;
        for (ray, label) in rays.zip(labels) {
            let end = ray.map_err(|e| Failure::new(6, e))?.end.to_array();
            let [east_m, north_m] = [0, 1].map(|axis| end[axis] - self.corner_m[axis]);
            if label != UNDERSTOREY || east_m <= 0.0 || north_m <= 0.0 {
                continue;
            }
            let (column, row) = ((east_m / BRUSH_CELL_M) as usize, (north_m / BRUSH_CELL_M) as usize);
            let height_m = end[2] - self.ground_at_m([east_m, north_m]);
            if column < self.brush_width && row < self.brush_width && height_m < BRUSH_BELOW_M {
                let cell = &mut self.brush[row * self.brush_width + column];
                (cell.height_m, cell.returns) = (cell.height_m.max(height_m), cell.returns + 1);
            }
        }
        Ok(())
    }
}

fn trees(file: &Path) -> Result<Vec<TrueTree>, Failure> {
    let rows = Table::read(file)?.columns(file, ["x_bh", "y_bh", "dbh", "height"])?;
    Ok(rows.into_iter().map(|[x, y, dbh_m, height_m]| TrueTree { at_m: [x, y], dbh_m, height_m }).collect())
}

fn seed_of(folder: &Path) -> Option<u64> {
    let meta: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join("meta.json")).ok()?).ok()?;
    meta["config"]["seed"].as_u64()
}
