//! The live system on every scene of the simulator: what each scene is for, and what was measured there.
//!
//! In: scorecards of `tsense demo --json`. Out: rows and a table. Figures are null where a scene does not have the thing.

use super::markdown::{TableText, cm, percent, two};
use crate::commands::Failure;
use serde::Serialize;
use serde_json::Value;
use tsense_simulator::SceneName;

/// One scene, live.
#[derive(Clone, Debug, Serialize)]
pub struct LiveRow {
    /// The scene.
    pub scene: &'static str,
    /// What it is for.
    pub claim: &'static str,
    /// Trees: precision, recall, position and DBH rms, metres.
    pub trees: [Option<f64>; 4],
    /// Ground rms over measured and interpolated cells, metres.
    pub ground_rmse_m: Option<f64>,
    /// Brush: height rms, metres; precision, recall.
    pub brush: [Option<f64>; 3],
    /// Shares found: ditch cells not to be driven, called a drop; rocks; walls.
    pub found: [Option<f64>; 4],
    /// Things told by the store, as right and reported: rocks, walls, drops.
    pub things: [[Option<u64>; 2]; 3],
    /// Share of clear ground that is not to be driven, and that is called a drop.
    pub false_alarms: [Option<f64>; 2],
    /// Age of a detection: median and 99th percentile, milliseconds.
    pub age_ms: [Option<f64>; 2],
    /// Dropped samples of all processes.
    pub dropped: Option<u64>,
}

/// What a scene is for.
pub fn claim(scene: SceneName) -> &'static str {
    match scene {
        SceneName::Forest => "the whole chain: trees, brush, ditch, rocks",
        SceneName::Flat => "level ground stays free",
        SceneName::Slope => "a slope of one in four is ground",
        SceneName::Grass => "ground below tall grass",
        SceneName::Ditch => "a ditch is a drop, not unknown",
        SceneName::Wall => "the side of a building: no trees, not to be driven",
        SceneName::Person => "a moving person is no tree",
        SceneName::Young => "1500 stems a hectare, each by itself",
        SceneName::Rocks => "rocks are not to be driven over",
        SceneName::Bumps => "bumps at 2.2 m/s (5 mph)",
        SceneName::Drift => "a drifting pose: no tree twice",
    }
}

impl LiveRow {
    /// The row of a scorecard.
    pub fn of(scene: SceneName, card: &Value) -> Result<Self, Failure> {
        if !card["trees"].is_object() {
            return Err(Failure::new(6, "this is no scorecard of tsense demo: it has no trees"));
        }
        let at = |path: &str| card.pointer(path).and_then(Value::as_f64);
        Ok(Self {
            scene: scene.as_str(),
            claim: claim(scene),
            trees: ["precision", "recall", "position_rmse_m", "dbh_rmse_m"].map(|name| at(&format!("/trees/{name}"))),
            ground_rmse_m: at("/ground/rmse_m"),
            brush: ["height_rmse_m", "precision", "recall"].map(|name| at(&format!("/brush/{name}"))),
            found: ["drops", "drops_by_name", "rocks", "walls"].map(|name| at(&format!("/hazards/{name}/share"))),
            things: ["rocks", "walls", "drops"].map(|kind| {
                ["right", "reported"]
                    .map(|what| card.pointer(&format!("/things/{kind}/{what}")).and_then(Value::as_u64))
            }),
            false_alarms: ["false_lethal", "false_drops"].map(|name| at(&format!("/hazards/{name}/share"))),
            age_ms: ["p50", "p99"].map(|name| at(&format!("/detection_age_ms/{name}"))),
            dropped: card["dropped"].as_u64(),
        })
    }
}

fn told(things: [Option<u64>; 2]) -> String {
    match things {
        [Some(right), Some(reported)] => format!("{right} of {reported}"),
        _ => "-".into(),
    }
}

/// The table of all scenes.
pub fn text(rows: &[LiveRow]) -> String {
    let mut table = TableText::new(&[
        "scene",
        "what it is for",
        "tree precision / recall",
        "position, DBH rms, cm",
        "ground rms, cm",
        "brush height rms, m; P / R",
        "ditch found / named",
        "rocks",
        "walls",
        "rocks, walls, drops told: right of reported",
        "false on clear ground / drops",
        "age p50 / p99, ms",
        "dropped",
    ]);
    for row in rows {
        let join = |figures: &[Option<f64>], show: fn(Option<f64>) -> String| {
            figures.iter().map(|figure| show(*figure)).collect::<Vec<_>>().join(" / ")
        };
        let brush = match row.brush[0] {
            Some(_) => format!("{}; {}", two(row.brush[0]), join(&row.brush[1..], two)),
            None => "-".into(),
        };
        table.row(&[
            row.scene.into(),
            row.claim.into(),
            join(&row.trees[..2], two),
            join(&row.trees[2..], cm),
            cm(row.ground_rmse_m),
            brush,
            join(&row.found[..2], percent),
            percent(row.found[2]),
            percent(row.found[3]),
            row.things.map(told).join(", "),
            join(&row.false_alarms, percent),
            join(&row.age_ms, |ms| ms.map_or("-".into(), |ms| format!("{ms:.0}"))),
            row.dropped.map_or("-".into(), |count| count.to_string()),
        ]);
    }
    let head = "## The simulator's scenes, live\n\n`tsense demo --headless --json --scene NAME`: real processes, the devices' own wires, the vehicle \
                drives. Trees count when the sensor could see them; ground over measured and interpolated cells.\n\n";
    head.to_owned() + &table.end()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_scorecard_becomes_a_row_and_what_is_not_there_a_dash() {
        let card = json!({ "trees": { "precision": 1.0, "recall": 0.5 }, "ground": { "rmse_m": 0.123 },
            "hazards": { "drops": { "cells": 3, "share": 0.28 } }, "dropped": 6 });
        let row = LiveRow::of(SceneName::Ditch, &card).unwrap();
        assert_eq!((row.trees[1], row.found[0], row.found[2], row.dropped), (Some(0.5), Some(0.28), None, Some(6)));
        let text = text(&[row]);
        assert!(
            text.contains("| ditch | a ditch is a drop, not unknown | 1.00 / 0.50 | - / - | 12.3 | - | 28 % / - |"),
            "{text}"
        );
        assert!(LiveRow::of(SceneName::Flat, &json!([1])).is_err());
    }
}
