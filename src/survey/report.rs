//! The survey's report: what was read, what was found, how sure, and what could not be said.

use super::plan::Plan;
use super::timeline::Counts;
use super::totals::Totals;
use super::{Crs, Options};
use serde::Serialize;
use std::collections::BTreeMap;
use tsense_classifier::{Detector, Reason, ReturnDrops};
use tsense_contract::GroundEvidence;

/// What `report.json` holds and `--json` prints. Lengths in metres.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The input as given.
    pub input: String,
    /// The command that made it.
    pub command: String,
    /// Version of the program.
    pub version: &'static str,
    /// EPSG code of all coordinates; null where neither the file nor the caller said.
    pub epsg: Option<u16>,
    /// Name of the coordinate system.
    pub crs: Option<String>,
    /// EPSG code of the heights; null where their datum was not said.
    pub epsg_heights: Option<u16>,
    /// Edge of a voxel.
    pub voxel_size_m: f64,
    /// Rays read.
    pub rays: u64,
    /// Rays with a return.
    pub returns: u64,
    /// Time between the first and the last ray, seconds.
    pub duration_s: f64,
    /// Tiles that the plot was surveyed in.
    pub tiles: usize,
    /// Edge of a tile.
    pub tile_m: f64,
    /// Blocks of 15 x 15 x 6 m (at 0.15 m) that rays reached.
    pub blocks: usize,
    /// Voxels that rays crossed, each crossing counted.
    pub voxel_visits: u64,
    /// What stems were fitted to: `beams`, `points` where no sensor position is known, `columns` of voxels by the thesis.
    pub stems_from: &'static str,
    /// Trees found.
    pub trees: usize,
    /// Mean DBH of the trees.
    pub dbh_mean_m: Option<f64>,
    /// Drops, rocks, walls and brush patches; one that reaches over the border of tiles counts once.
    pub things: BTreeMap<&'static str, u64>,
    /// Candidates that are no trees, by reason.
    pub rejected: BTreeMap<&'static str, usize>,
    /// Cells of the ground raster by how their height is known.
    pub ground_cells: BTreeMap<&'static str, u64>,
    /// What was read and not used, by cause.
    pub dropped: BTreeMap<&'static str, u64>,
    /// Voxels occupied and free over time.
    pub occupancy: Vec<Counts>,
    /// Things a user should know before relying on the result.
    pub notes: Vec<String>,
}

impl Report {
    /// The report of a survey, with its coordinate system and what the file said instead.
    pub fn of(totals: &Totals, plan: &Plan, (crs, file): (Option<Crs>, Option<String>), options: &Options) -> Self {
        let dbh: Vec<f64> = totals.trees.iter().map(|t| f64::from(t.dbh_m)).filter(|d| d.is_finite()).collect();
        let mut rejected: BTreeMap<_, _> = Reason::ALL.iter().map(|reason| (reason.as_str(), 0)).collect();
        totals.rejected.iter().for_each(|r| *rejected.entry(r.reason.as_str()).or_insert(0) += 1);
        let extent = &totals.extent;
        Self {
            input: options.input.display().to_string(),
            command: options.command.clone(),
            version: env!("CARGO_PKG_VERSION"),
            epsg: crs.map(|crs| crs.horizontal),
            crs: crs.map(|crs| crs.name()),
            epsg_heights: crs.and_then(|crs| crs.vertical),
            voxel_size_m: options.voxel_size_m,
            rays: extent.rays,
            returns: extent.returns,
            duration_s: extent.times.map_or(0.0, |(first, last)| last.seconds_since(first)),
            tiles: totals.tiles,
            tile_m: plan.tile_cells as f64 * options.voxel_size_m,
            blocks: totals.blocks,
            voxel_visits: totals.voxel_visits,
            stems_from: match options.classifier.detector {
                Detector::Thesis => "columns",
                Detector::Stems if extent.has_points_only() => "points",
                Detector::Stems => "beams",
            },
            trees: totals.trees.len(),
            dbh_mean_m: (!dbh.is_empty()).then(|| dbh.iter().sum::<f64>() / dbh.len() as f64),
            things: totals.things.iter().map(|(kind, n)| (kind.as_str(), *n)).collect(),
            rejected,
            ground_cells: totals.ground_cells.iter().map(|(evidence, n)| (evidence.as_str(), *n)).collect(),
            dropped: dropped(totals),
            occupancy: totals.timeline.counts().to_vec(),
            notes: notes(totals, crs, file),
        }
    }
}

/// Everything that was read and not used, by cause.
fn dropped(totals: &Totals) -> BTreeMap<&'static str, u64> {
    let ReturnDrops { bad, thinned, full, left } = totals.drops;
    BTreeMap::from([
        ("beams without a length, or one origin too many for their station", bad),
        ("beams thinned where many had one direction", thinned),
        ("beams of the oldest stations when the store was full", full),
        ("beams of stations left behind", left),
        ("groups of cells too small to be a drop, a rock, a wall or a brush patch", totals.too_small),
    ])
}

fn notes(totals: &Totals, crs: Option<Crs>, file: Option<String>) -> Vec<String> {
    let mut notes = Vec::new();
    if let (Some(crs), Some(file)) = (crs, file) {
        notes.push(format!("the file says {file}, the command {crs}: that was taken, and nothing reprojected"));
    }
    match crs {
        None => notes.push("the coordinate system is unknown: the files carry none; give --crs EPSG:n".to_owned()),
        Some(Crs { vertical: None, .. }) => {
            notes.push("the datum of the heights is unknown; give --crs EPSG:n+m where it is known".to_owned());
        }
        Some(_) => {}
    }
    if totals.extent.points > 0 {
        notes.push(format!(
            "{} of {} returns do not say where their beams came from: no space is known to be free by them; {}; give \
             --origin or --trajectory where they are known",
            totals.extent.points,
            totals.extent.returns,
            match totals.extent.has_points_only() {
                true => "stems are fitted to points alone, as if beams had no width, and are too thick where these were wide",
                false => "stems are fitted to the others",
            }
        ));
    } else if totals.extent.returns == totals.extent.rays {
        notes.push("the input has no rays without return: space where nothing came back is unknown, not free".into());
    }
    if !totals.ground_cells.contains_key(&GroundEvidence::Measured) {
        notes.push("no ground was seen: heights, trees and brush are not to be relied on".to_owned());
    }
    if totals.drops.full > 0 {
        notes.push(format!(
            "{} beams were not kept for fits, because a tile holds more than the bound; smaller tiles (--tile) keep them",
            totals.drops.full
        ));
    }
    notes
}
