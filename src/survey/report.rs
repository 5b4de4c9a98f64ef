//! The survey's report: what was read, what was found, how sure, and what could not be said.

use super::{Options, Survey};
use serde::Serialize;
use std::collections::BTreeMap;
use tsense_classifier::Cost;
use tsense_contract::{COST_UNKNOWN, GroundEvidence};

/// What `report.json` holds and `--json` prints. Lengths in metres.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The input as given.
    pub input: String,
    /// Version of the program.
    pub version: &'static str,
    /// EPSG code of all coordinates; null where neither the file nor the caller said.
    pub epsg: Option<u16>,
    /// Edge of a voxel.
    pub voxel_size_m: f64,
    /// Rays read.
    pub rays: u64,
    /// Rays with a return.
    pub returns: u64,
    /// Time between the first and the last ray, seconds.
    pub duration_s: f64,
    /// Blocks of 15 x 15 x 6 m (at 0.15 m) that rays reached.
    pub blocks: usize,
    /// Voxels that rays crossed, each crossing counted.
    pub voxel_visits: u64,
    /// Trees found.
    pub trees: usize,
    /// Mean DBH of the trees.
    pub dbh_mean_m: Option<f64>,
    /// Candidates that are no trees, by reason.
    pub rejected: BTreeMap<&'static str, usize>,
    /// Cells of the ground raster by how their height is known.
    pub ground_cells: BTreeMap<&'static str, usize>,
    /// Things a user should know before relying on the result.
    pub notes: Vec<String>,
}

impl Report {
    /// The report of a survey.
    pub fn of(survey: &Survey, options: &Options) -> Self {
        let found = &survey.classification;
        let dbh: Vec<f64> = found.trees.iter().map(|t| f64::from(t.dbh_m)).filter(|d| d.is_finite()).collect();
        let mut ground_cells = BTreeMap::new();
        for evidence in found.ground.evidence.cells() {
            *ground_cells.entry(evidence.as_str()).or_insert(0) += 1;
        }
        Self {
            input: options.input.display().to_string(),
            version: env!("CARGO_PKG_VERSION"),
            epsg: survey.epsg,
            voxel_size_m: options.voxel_size_m,
            rays: survey.extent.rays,
            returns: survey.extent.returns,
            duration_s: survey.extent.times.map_or(0.0, |(first, last)| last.seconds_since(first)),
            blocks: survey.blocks,
            voxel_visits: survey.voxel_visits,
            trees: found.trees.len(),
            dbh_mean_m: (!dbh.is_empty()).then(|| dbh.iter().sum::<f64>() / dbh.len() as f64),
            rejected: found.rejections().iter().map(|(reason, count)| (reason.as_str(), *count)).collect(),
            notes: notes(survey, &ground_cells),
            ground_cells,
        }
    }
}

fn notes(survey: &Survey, ground_cells: &BTreeMap<&'static str, usize>) -> Vec<String> {
    let mut notes = Vec::new();
    if survey.epsg.is_none() {
        notes.push("the coordinate system is unknown: the rasters carry none; give --crs EPSG:n".to_owned());
    }
    if survey.extent.returns == survey.extent.rays {
        notes.push("the input has no rays without return: space where nothing came back is unknown, not free".into());
    }
    let measured = ground_cells.get(GroundEvidence::Measured.as_str()).copied().unwrap_or(0);
    if measured == 0 {
        notes.push("no ground was seen: heights, trees and brush are not to be relied on".to_owned());
    }
    notes
}

/// The value of a cell in `traversability.tif`: 0 free to 1 not to be driven, NaN unknown.
pub fn traversability_value(cost: &Cost) -> f32 {
    match cost.cost {
        COST_UNKNOWN => f32::NAN,
        cost => f32::from(cost) / f32::from(tsense_contract::COST_LETHAL),
    }
}
