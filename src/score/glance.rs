//! The report's first lines: every goal once, with what all plots reached; and the live scenes in a sentence.
//!
//! In: checks of plots, rows of live runs. Out: Markdown.

use super::goals::Check;
use super::live::LiveRow;
use super::markdown::{TableText, two};

/// Every goal once: on how many plots it is met, and the least, middle and largest figure.
pub fn table(plots: &[Vec<Check>]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for check in plots.iter().flatten() {
        if !names.contains(&check.what) {
            names.push(check.what);
        }
    }
    let mut table = TableText::new(&["figure", "goal", "met on", "least", "middle", "largest"]);
    for name in names {
        let of_name: Vec<&Check> = plots.iter().flatten().filter(|check| check.what == name).collect();
        let met = of_name.iter().filter(|check| check.is_met).count();
        let mut values: Vec<f64> = of_name.iter().filter_map(|check| check.value).collect();
        values.sort_by(f64::total_cmp);
        let at = |place: Option<usize>| place.and_then(|i| values.get(i)).map_or("-".into(), |v| figure(*v));
        table.row(&[
            name.to_owned(),
            goal(&of_name),
            format!("{met} of {}", of_name.len()),
            at(Some(0)),
            at(Some(values.len() / 2)),
            at(values.len().checked_sub(1)),
        ]);
    }
    table.end()
}

/// The bounds of one goal; those that differ from plot to plot as the range they span.
fn goal(checks: &[&Check]) -> String {
    let spanned = |bound: usize| {
        let bounds = || checks.iter().filter_map(|check| check.range[bound]);
        let (least, most) = (bounds().reduce(f64::min)?, bounds().reduce(f64::max)?);
        Some(if least == most { least.to_string() } else { format!("{least} to {most}, by plot") })
    };
    match [spanned(0), spanned(1)] {
        [Some(least), Some(most)] => format!("{least} to {most}"),
        [Some(least), None] => format!("at least {least}"),
        [None, Some(most)] => format!("at most {most}"),
        [None, None] => "-".into(),
    }
}

fn figure(value: f64) -> String {
    let text = format!("{value:.3}");
    if text == "-0.000" { "0.000".into() } else { text }
}

/// The live scenes in a sentence.
pub fn live(rows: &[LiveRow]) -> String {
    let least = |of: fn(&LiveRow) -> Option<f64>| two(rows.iter().filter_map(of).reduce(f64::min));
    let oldest_ms = rows.iter().filter_map(|row| row.age_ms[1]).reduce(f64::max);
    let told = |i: usize| rows.iter().flat_map(|row| row.things).filter_map(|thing| thing[i]).sum::<u64>();
    format!(
        "Live, {} scenes: in the worst of them tree precision is {} and recall {}; of {} rocks, pieces of walls and of drops told, {} \
         are there; detections are {} ms old at p99 at most.\n\n",
        rows.len(),
        least(|row| row.trees[0]),
        least(|row| row.trees[1]),
        told(1),
        told(0),
        oldest_ms.map_or("-".into(), |ms| format!("{ms:.0}")),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::goals::Goals;
    use crate::score::plot::PlotScore;
    use tsense_simulator::SceneName;

    #[test]
    fn a_goal_stands_once_with_what_all_plots_reached() {
        let plot = |name: &str, f1: f64| Goals::of(name).checks(&PlotScore { f1, ..PlotScore::default() }, None);
        let text = table(&[plot("A_flat", 0.98), plot("B_slope", 1.0), plot("C_young", 0.95)]);
        assert!(
            text.contains("| tree F1 | at least 0.93 to 0.99, by plot | 2 of 3 | 0.950 | 0.980 | 1.000 |"),
            "{text}"
        );
        assert!(text.contains("| DBH within 1 sigma | 0.6 to 0.76 | 0 of 3 | - | - | - |"), "{text}");
        assert_eq!(text.matches("tree F1").count(), 1);
    }

    #[test]
    fn live_scenes_are_told_by_their_worst() {
        let row = |recall: f64, right: u64, p99: f64| {
            let card = serde_json::json!({ "trees": { "precision": 1.0, "recall": recall },
                "things": { "rocks": { "right": right, "reported": 3 } }, "detection_age_ms": { "p99": p99 } });
            LiveRow::of(SceneName::Rocks, &card).unwrap()
        };
        let text = live(&[row(1.0, 3, 90.0), row(0.5, 2, 110.0)]);
        assert!(text.contains("recall 0.50; of 6 rocks"), "{text}");
        assert!(text.contains("told, 5 are there; detections are 110 ms old"), "{text}");
    }
}
