//! A survey of rays that the simulator recorded, against the simulator's own truth.
//!
//! In: a scene's name and seed, which recording it was (`tsense simulate --write-rays --case`), and a survey's results.
//! Out: trees, ground and brush by the rules of the demo's scorecard, but that every true tree within reach of where the
//! ladar was counts, hidden or not; drops, rocks and walls. A tripod (cases static and clipped) stands at the eastern end of
//! the oval.

use super::found::Found;
use super::markdown::{TableText, cm, percent};
use super::runs::SCENE_TIME;
use super::shapes::{STEP_M, middle_m};
use super::things::{self, LongScore, ShapeScore};
use crate::commands::Failure;
use serde::Serialize;
use tsense_simulator::{
    BrushScore, HeightScore, ORIGIN_M, Path, RayCase, ReportedTree, Scene, SceneName, TreeScore, Way, score_brush,
    score_ground, score_trees,
};

/// Where the tripod stands, east and north of the scene's origin, metres.
const TRIPOD_M: [f64; 2] = [10.0, 0.0];
/// Trees and cells within this distance count, metres.
const REACH_M: f64 = 12.0;

/// Scenes whose drops, rocks and walls a report tells of; where there are none, none must be told.
pub const SURVEYED: [SceneName; 6] =
    [SceneName::Ditch, SceneName::Rocks, SceneName::Wall, SceneName::Forest, SceneName::Slope, SceneName::Grass];

/// A survey's score in a scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneScore {
    /// The scene's name.
    pub scene: &'static str,
    /// Its seed.
    pub seed: u64,
    trees: TreeScore,
    ground: HeightScore,
    brush: BrushScore,
    /// Drops, rocks and walls; null where the survey has no `objects.gpkg`.
    pub things: Option<ShapeScore>,
}

/// What a scene's rays are called: `NAME`, `NAME:SEED` or `NAME:SEED:CASE`.
pub fn parse(text: &str) -> Result<(SceneName, Option<u64>, RayCase), Failure> {
    let mut words = text.splitn(3, ':');
    let name = words.next().unwrap_or_default();
    let name = name.parse().map_err(|e: String| Failure::new(2, format!("no folder {text}, and {e}")))?;
    let seed = words.next().map(|seed| seed.parse().map_err(|_| Failure::new(2, format!("'{seed}' is no seed"))));
    let case = words.next().map(|case| case.parse().map_err(|e: String| Failure::new(2, e)));
    Ok((name, seed.transpose()?, case.transpose()?.unwrap_or_default()))
}

/// Where the ladar was, metres in UTM.
fn stops_m(case: RayCase) -> Vec<[f64; 2]> {
    let way = match case {
        RayCase::Static | RayCase::Clipped => return vec![[0, 1].map(|axis| ORIGIN_M[axis] + TRIPOD_M[axis])],
        RayCase::Drive => Way::Line,
        RayCase::Oval => Way::Oval,
    };
    Path::new(way).places(0.5).iter().map(|place| [ORIGIN_M[0] + place.x_m, ORIGIN_M[1] + place.y_m]).collect()
}

/// Scores what a survey of a scene's rays found.
pub fn score(name: SceneName, seed: u64, case: RayCase, found: &Found) -> SceneScore {
    let (scene, stops_m) = (Scene::new(name, seed), stops_m(case));
    let is_near = |at_m: [f64; 2]| stops_m.iter().any(|stop| (at_m[0] - stop[0]).hypot(at_m[1] - stop[1]) <= REACH_M);
    let truth = scene.true_trees();
    let counted: Vec<bool> = truth.iter().map(|tree| is_near([tree.easting_m, tree.northing_m])).collect();
    let reported: Vec<ReportedTree> = found
        .trees
        .iter()
        .filter(|tree| is_near(tree.at_m))
        .map(|tree| ReportedTree { easting_m: tree.at_m[0], northing_m: tree.at_m[1], dbh_m: tree.dbh_m })
        .collect();
    let range = |axis: usize| {
        let along = || stops_m.iter().map(|stop| stop[axis] / STEP_M);
        let reach = REACH_M / STEP_M;
        (along().fold(f64::INFINITY, f64::min) - reach) as i64..(along().fold(0.0, f64::max) + reach) as i64 + 1
    };
    let places: Vec<[i64; 2]> = range(1)
        .flat_map(|row| range(0).map(move |column| [column, row]))
        .filter(|cell| is_near(middle_m(*cell)))
        .collect();
    let heights = |raster: &super::raster::GeoRaster| -> Vec<[f64; 3]> {
        places.iter().map(|cell| middle_m(*cell)).map(|[e, n]| [e, n, raster.at(e, n)]).collect()
    };
    SceneScore {
        scene: name.as_str(),
        seed,
        trees: score_trees(&truth, &counted, &reported),
        ground: score_ground(&scene, heights(&found.ground)),
        brush: found.brush.as_ref().map(|brush| score_brush(&scene, heights(brush))).unwrap_or_default(),
        things: found.shapes.as_ref().map(|shapes| things::score(&scene, shapes, &places, is_near)),
    }
}

/// The table of surveyed scenes.
pub fn text(scores: &[SceneScore]) -> String {
    let mut table = TableText::new(&[
        "scene, seed",
        "rocks found, of those higher than 0.3 m",
        "rocks told, right of all",
        "position rms, cm",
        "drops: area, m²; found",
        "told, m²; right",
        "off across, cm",
        "walls: area, m²; found",
        "told, m²; right",
        "off across, cm",
    ]);
    for score in scores {
        let Some(ShapeScore { rocks, drops, walls }) = score.things else { continue };
        let area = |m2: f64, share: Option<f64>| match m2 {
            0.0 => "-".to_owned(),
            m2 => format!("{m2:.1}; {}", percent(share)),
        };
        let long = |of: LongScore| [area(of.true_m2, of.found), area(of.told_m2, of.right), cm(of.off_m)];
        let rocks = [
            format!("{} of {}", rocks.found, rocks.truth),
            format!("{} of {}", rocks.right, rocks.told),
            cm(rocks.position_rmse_m),
        ];
        let name = format!("{}, {}", score.scene, score.seed);
        table.row(&[&[name][..], &rocks, &long(drops), &long(walls)].concat());
    }
    format!(
        "## The simulator's scenes, surveyed: drops, rocks and walls\n\n`tsense simulate --case oval --for {SCENE_TIME} \
         --write-rays`, `tsense survey`, `tsense score SCENE:SEED:oval`: the vehicle drives once round, 51 m. What is within \
         {REACH_M} m of its way is to be found, hidden or not; what is told counts wherever it lies. Found is an area with a told cell at \
         most one cell of {STEP_M} m beside; right is what lies within 0.3 m of a true one.\n\n{}",
        table.end()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_called_by_its_name_its_seed_and_its_recording() {
        let parsed = |text: &str| parse(text).map_err(|failure| failure.code);
        assert_eq!(parsed("ditch"), Ok((SceneName::Ditch, None, RayCase::Static)));
        assert_eq!(parsed("ditch:8:oval"), Ok((SceneName::Ditch, Some(8), RayCase::Oval)));
        assert_eq!([parsed("moon"), parsed("ditch:x"), parsed("ditch:8:moon")], [Err(2), Err(2), Err(2)]);
    }

    #[test]
    fn places_around_the_whole_way_count() {
        let far_m = |case| {
            let stops = stops_m(case);
            stops.iter().map(|stop| (stop[0] - stops[0][0]).hypot(stop[1] - stops[0][1])).fold(0.0, f64::max)
        };
        assert_eq!(far_m(RayCase::Static), 0.0);
        assert!(far_m(RayCase::Oval) > 19.0 && far_m(RayCase::Drive) > 38.0);
    }

    #[test]
    fn a_scene_is_a_row_of_rocks_drops_and_walls() {
        let drops = LongScore { true_m2: 37.6, found: Some(0.54), told_m2: 24.2, right: Some(0.93), off_m: Some(0.19) };
        let things = Some(ShapeScore { drops, ..ShapeScore::default() });
        let (trees, ground, brush) = Default::default();
        let text = text(&[SceneScore { scene: "ditch", seed: 7, trees, ground, brush, things }]);
        let row = "| ditch, 7 | 0 of 0 | 0 of 0 | - | 37.6; 54 % | 24.2; 93 % | 19.0 | - | - | - |";
        assert!(text.contains(row), "{text}");
    }
}
