//! A survey of rays that the simulator recorded, against the simulator's own truth.
//!
//! In: a scene's name and seed, and a survey's results. Out: trees, ground and brush by the rules of the demo's
//! scorecard, but that every true tree within reach of the tripod counts, hidden or not: rays of `tsense simulate
//! --write-rays` come from a tripod (cases static and clipped) at the eastern end of the oval.

use super::found::Found;
use crate::commands::Failure;
use serde::Serialize;
use tsense_simulator::{
    BrushScore, HeightScore, ORIGIN_M, ReportedTree, Scene, SceneName, TreeScore, score_brush, score_ground,
    score_trees,
};

/// Where the tripod stands, east and north of the scene's origin, metres.
const TRIPOD_M: [f64; 2] = [10.0, 0.0];
/// Trees and cells within this distance count, metres.
const REACH_M: f64 = 12.0;
/// Cells are compared at this distance from each other, metres: a voxel's.
const STEP_M: f64 = 0.15;

/// A survey's score in a scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneScore {
    scene: &'static str,
    seed: u64,
    trees: TreeScore,
    ground: HeightScore,
    brush: BrushScore,
}

/// `NAME` or `NAME:SEED`.
pub fn parse(text: &str) -> Result<(SceneName, Option<u64>), Failure> {
    let (name, seed) = text.split_once(':').map_or((text, None), |(name, seed)| (name, Some(seed)));
    let name = name.parse().map_err(|e: String| Failure::new(2, format!("no folder {text}, and {e}")))?;
    let seed = seed.map(|seed| seed.parse().map_err(|_| Failure::new(2, format!("'{seed}' is no seed"))));
    Ok((name, seed.transpose()?))
}

/// Scores what a survey of a tripod's rays found.
pub fn score(name: SceneName, seed: u64, found: &Found) -> SceneScore {
    let scene = Scene::new(name, seed);
    let tripod_m = [0, 1].map(|axis| ORIGIN_M[axis] + TRIPOD_M[axis]);
    let is_near = |at_m: [f64; 2]| (at_m[0] - tripod_m[0]).hypot(at_m[1] - tripod_m[1]) <= REACH_M;
    let truth = scene.true_trees();
    let counted: Vec<bool> = truth.iter().map(|tree| is_near([tree.easting_m, tree.northing_m])).collect();
    let reported: Vec<ReportedTree> = found
        .trees
        .iter()
        .filter(|tree| is_near(tree.at_m))
        .map(|tree| ReportedTree { easting_m: tree.at_m[0], northing_m: tree.at_m[1], dbh_m: tree.dbh_m })
        .collect();
    let steps = (REACH_M / STEP_M) as i32;
    let first = tripod_m.map(|m| (m / STEP_M).floor());
    let cells: Vec<[f64; 2]> = (-steps..=steps)
        .flat_map(|row| (-steps..=steps).map(move |column| [f64::from(column), f64::from(row)]))
        .map(|cell| [0, 1].map(|axis| (first[axis] + cell[axis] + 0.5) * STEP_M))
        .filter(|at_m| is_near(*at_m))
        .collect();
    let heights = |raster: &super::raster::GeoRaster| -> Vec<[f64; 3]> {
        cells.iter().map(|[e, n]| [*e, *n, raster.at(*e, *n)]).collect()
    };
    SceneScore {
        scene: name.as_str(),
        seed,
        trees: score_trees(&truth, &counted, &reported),
        ground: score_ground(&scene, heights(&found.ground)),
        brush: found.brush.as_ref().map(|brush| score_brush(&scene, heights(brush))).unwrap_or_default(),
    }
}
