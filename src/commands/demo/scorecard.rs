//! The demo's scorecard: what the system reported against what the simulator knows.
//!
//! In: reports as they arrive on the topics. Out: figures with units in their names; `None` where nothing could be
//! measured, which JSON shows as null.

use serde::Serialize;
use std::collections::BTreeMap;
use tsense_contract::{GridCell, GridHeader, GroundEvidence};

/// Most cells remembered: a drive of 4 km with a 30 m wide grid of 0.15 m cells would fill it.
const CELLS_MAX: usize = 5_000_000;
/// Most ages remembered: four hours at 20 detections a second.
const AGES_MAX: usize = 288_000;

/// Trees against the truth.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Trees {
    /// Trees that the sensor could see, by the simulator's rule.
    #[serde(rename = "true")]
    pub true_count: usize,
    /// Trees that the knowledge store reported.
    pub reported: usize,
    /// Reported trees that stand within 0.3 m of a true one, one to one.
    pub matched: usize,
    /// matched / reported.
    pub precision: Option<f64>,
    /// matched / true.
    pub recall: Option<f64>,
    /// Root mean square distance of the matched, metres.
    pub position_rmse_m: Option<f64>,
    /// Root mean square error of the matched ones' diameters, metres.
    pub dbh_rmse_m: Option<f64>,
}

/// Heights against the truth.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Ground {
    /// Over all measured and interpolated cells, metres.
    pub rmse_m: Option<f64>,
    /// Mean error, metres.
    pub bias_m: Option<f64>,
    /// Cells compared.
    pub cells: usize,
}

/// Brush heights against the truth.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Brush {
    /// Over cells where both see brush, metres.
    pub height_rmse_m: Option<f64>,
    /// Cells compared.
    pub cells: usize,
}

/// Age of a detection when a reader gets it, counted from the newest beam it rests on.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Ages {
    /// Median, milliseconds.
    pub p50: Option<f64>,
    /// 99th percentile, milliseconds.
    pub p99: Option<f64>,
}

/// Mean and root mean square of a list of errors.
pub fn mean_and_rms(errors: &[f64]) -> (Option<f64>, Option<f64>) {
    if errors.is_empty() {
        return (None, None);
    }
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let square = errors.iter().map(|e| e * e).sum::<f64>() / n;
    (Some(mean), Some(square.sqrt()))
}

/// Collects ages.
#[derive(Debug, Default)]
pub struct AgeLog {
    ages_ms: Vec<f64>,
}

impl AgeLog {
    /// Adds an age, milliseconds.
    pub fn add(&mut self, age_ms: f64) {
        if self.ages_ms.len() < AGES_MAX {
            self.ages_ms.push(age_ms);
        }
    }

    /// The percentiles so far.
    pub fn ages(&self) -> Ages {
        let mut sorted = self.ages_ms.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = sorted.len().checked_sub(1)?;
            sorted.get((share * last as f64).round() as usize).copied()
        };
        Ages { p50: at(0.5), p99: at(0.99) }
    }
}

/// What the grid last said of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellReport {
    /// Ground height above the ellipsoid, metres.
    pub ground_m: f64,
    /// Vegetation height above ground, metres.
    pub vegetation_m: f64,
}

/// The newest report of every cell whose ground was measured or interpolated.
#[derive(Debug, Default)]
pub struct GridLog {
    cells: BTreeMap<[i32; 2], CellReport>,
    cell_m: f64,
}

impl GridLog {
    /// Takes in a grid; its known cells replace what was reported of them before.
    pub fn add(&mut self, header: &GridHeader, cells: &[GridCell]) {
        self.cell_m = header.cell_m;
        let width = header.width.max(1) as usize;
        for (index, cell) in cells.iter().enumerate() {
            let evidence = GroundEvidence::from_wire(cell.evidence);
            let is_known = matches!(evidence, GroundEvidence::Measured | GroundEvidence::Interpolated);
            if !is_known || cell.ground_m.is_nan() {
                continue;
            }
            let key =
                [header.first_cell[0] + (index % width) as i32, header.first_cell[1] + (index / width) as i32];
            if self.cells.len() < CELLS_MAX || self.cells.contains_key(&key) {
                let ground_m = header.base_m + f64::from(cell.ground_m);
                self.cells.insert(key, CellReport { ground_m, vegetation_m: f64::from(cell.vegetation_m) });
            }
        }
    }

    /// Easting, northing of each cell's centre, metres, with its report.
    pub fn cells(&self) -> impl Iterator<Item = ([f64; 2], CellReport)> + '_ {
        self.cells.iter().map(|(key, report)| (key.map(|i| (f64::from(i) + 0.5) * self.cell_m), *report))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn percentiles_of_a_hundred_ages() {
        let mut log = AgeLog::default();
        assert_eq!(log.ages(), Ages::default());
        (0..=100).rev().for_each(|age| log.add(f64::from(age)));
        assert_eq!(log.ages(), Ages { p50: Some(50.0), p99: Some(99.0) });
    }

    #[test]
    fn mean_and_rms_by_hand() {
        assert_eq!(mean_and_rms(&[3.0, -4.0]), (Some(-0.5), Some(12.5f64.sqrt())));
        assert_eq!(mean_and_rms(&[]), (None, None));
    }

    #[test]
    fn a_later_grid_replaces_a_cell_and_unknown_cells_stay_out() {
        let mut header = GridHeader::zeroed();
        (header.cell_m, header.base_m, header.width, header.height) = (0.5, 10.0, 2, 1);
        header.first_cell = [4, -2];
        let mut cells = [GridCell::zeroed(); 2];
        (cells[1].ground_m, cells[1].evidence) = (0.25, GroundEvidence::Measured.to_wire());
        let mut log = GridLog::default();
        log.add(&header, &cells);
        cells[1].ground_m = 0.5;
        log.add(&header, &cells);
        let all: Vec<_> = log.cells().collect();
        assert_eq!(all, vec![([2.75, -0.75], CellReport { ground_m: 10.5, vegetation_m: 0.0 })]);
    }
}
