//! `tsense score`: a survey's results, a demo's scorecard or two surveys' stems against what is there, and the report.
#![allow(clippy::disallowed_methods, reason = "shell: reads truth and results, writes the report")]

use super::imaging::moving;
use super::{Failure, Outcome, print, tell, words};
use crate::files::{can_be_written, write_bytes};
use crate::score::found::{Found, trees};
use crate::score::goals::{Check, Goals};
use crate::score::live::{LiveRow, text as live_text};
use crate::score::pairs::{Agreement, agreement};
use crate::score::plot::{PlotScore, score};
use crate::score::report::{Clouds, PlotRow, Report, said};
use crate::score::runs::{Chain, Runs};
use crate::score::scene;
use crate::score::truth::Truth;
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tsense_simulator::{RayCase, SceneName};

/// Score results against the truth, or make the report of all scores.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    before_help = "Example:\n  tsense survey A/rays.ply --out results --crs EPSG:32617 && tsense score A results --limits\n  \
        tsense score forest:7 results           (rays of tsense simulate --scene forest --seed 7 --write-rays)\n  \
        tsense score ditch:7:oval results       (the same with --case oval)\n  \
        tsense score ditch card.json            (of tsense demo --scene ditch --headless --json)\n  \
        tsense score --match tls/trees.csv mls/trees.csv\n  \
        tsense score --report docs/results.md --plots scenes --live 30s",
    after_help = "Exit codes: 8 with --limits where a goal is missed."
)]
pub struct ScoreArgs {
    /// The truth: a folder (docs/survey.md, Scoring), or a scene of the simulator: NAME, NAME:SEED or NAME:SEED:CASE
    #[arg(requires = "results")]
    truth: Option<String>,
    /// What was found: a survey's folder, or a demo's scorecard (.json)
    results: Option<PathBuf>,
    /// End with exit code 8 where a plot misses a goal
    #[arg(long)]
    limits: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Two tables of trees of one place, in whatever coordinates: which stems are the same
    #[arg(long = "match", value_name = "TREES.csv", num_args = 2)]
    tables: Option<Vec<PathBuf>>,
    /// With --match: how near two stems have to be after the motion, metres
    #[arg(long, value_name = "M", default_value_t = 0.5, value_parser = words::within(0.01, 5.0), requires = "tables")]
    within: f64,
    /// Write the report of all plots to this file; its kept sections stay
    #[arg(long, value_name = "FILE.md", conflicts_with = "truth")]
    report: Option<PathBuf>,
    /// With --report: a plot, or a folder of plots; may be repeated
    #[arg(long, value_name = "DIR", requires = "report")]
    plots: Vec<PathBuf>,
    /// With --report: run every scene of the simulator live for this long (s, m or h), and survey those with drops, rocks, walls
    #[arg(long, value_name = "TIME", value_parser = words::seconds, requires = "report")]
    live: Option<f64>,
    /// Seed of a scene that names none; with --report of the live scenes and of the moving person
    #[arg(long, value_name = "N", default_value_t = 7)]
    seed: u64,
    /// With --report: keep the runs' results here, and take those that are here instead of running again
    #[arg(long, value_name = "DIR", requires = "report")]
    keep: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &ScoreArgs) -> Outcome {
    match (&args.report, &args.tables, &args.truth, &args.results) {
        (Some(file), ..) => write_report(args, file),
        (_, Some(tables), ..) => compare(args, tables),
        (_, _, Some(truth), Some(results)) if is_json(results) => score_card(args, scene::parse(truth)?.0, results),
        (_, _, Some(truth), Some(results)) if Path::new(truth).is_dir() => score_plot(args, Path::new(truth), results),
        (_, _, Some(truth), Some(results)) => score_scene(args, scene::parse(truth)?, results),
        _ => Err(Failure::new(2, "give a truth and results, --match with two tables, or --report")),
    }
}

fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "json")
}

fn score_plot(args: &ScoreArgs, truth: &Path, results: &Path) -> Outcome {
    let truth = Truth::read(truth)?;
    let score = score(&truth, &Found::read(results)?);
    let checks = Goals::of(&truth.name).checks(&score, None);
    if args.json {
        print(&format!("{}\n", json!({ "plot": truth.name, "seed": truth.seed, "score": score, "goals": checks })))?;
    } else {
        print(&plot_text(&truth.name, &score, &checks)?)?;
    }
    verdict(args, &checks)
}

/// Refuses to hold against goals what has none.
fn without_goals(args: &ScoreArgs) -> Result<(), Failure> {
    match args.limits {
        true => Err(Failure::new(2, "--limits: only plots have goals, no scenes and no tables")),
        false => Ok(()),
    }
}

/// The exit code: 8 where a goal was wanted and missed.
fn verdict(args: &ScoreArgs, checks: &[Check]) -> Outcome {
    Ok(if args.limits && checks.iter().any(|check| !check.is_met) { 8 } else { 0 })
}

fn plot_text(name: &str, score: &PlotScore, checks: &[Check]) -> Result<String, Failure> {
    let mut text = format!("plot {name}\n{}", figures("", &json!(score)));
    let missed: Vec<String> = checks.iter().filter(|check| !check.is_met).map(said).collect();
    text += &format!("{} of {} goals met\n", checks.len() - missed.len(), checks.len());
    Ok(missed.iter().fold(text, |text, line| text + "  missed: " + line + "\n"))
}

/// A line a figure; those of a part of the score begin with its name.
fn figures(part: &str, score: &Value) -> String {
    let line = |(key, value): (&String, &Value)| {
        let name = format!("{part}{key}");
        match value {
            Value::Object(_) => figures(&(name + "_"), value),
            Value::Number(number) if number.is_f64() => {
                format!("  {name:24} {:.4}\n", number.as_f64().unwrap_or(f64::NAN))
            }
            Value::Null => format!("  {name:24} -\n"),
            Value::String(word) => format!("  {name:24} {word}\n"),
            _ => format!("  {name:24} {value}\n"),
        }
    };
    score.as_object().into_iter().flatten().map(line).collect()
}

fn score_scene(args: &ScoreArgs, (name, seed, case): (SceneName, Option<u64>, RayCase), results: &Path) -> Outcome {
    without_goals(args)?;
    let score = scene::score(name, seed.unwrap_or(args.seed), case, &Found::read(results)?);
    print(&if args.json { format!("{}\n", json!(score)) } else { figures("", &json!(score)) })
}

fn score_card(args: &ScoreArgs, name: SceneName, card: &Path) -> Outcome {
    without_goals(args)?;
    let card = serde_json::from_slice(&crate::score::read(card)?)
        .map_err(|e| Failure::new(6, format!("{}: {e}", card.display())))?;
    let row = LiveRow::of(name, &card)?;
    if args.json {
        return print(&format!("{}\n", json!(row)));
    }
    print(&live_text(&[row]))
}

fn compare(args: &ScoreArgs, tables: &[PathBuf]) -> Outcome {
    without_goals(args)?;
    let found = agree(tables, args.within)?;
    if args.json {
        return print(&format!("{}\n", json!(found)));
    }
    let Some(found) = found else {
        return print("no two stems of the one table stand as two of the other do\n");
    };
    let metres = |m: Option<f64>| m.map_or("-".to_owned(), |m| format!("{m:.3}"));
    let turn_deg = found.motion.turn_rad.to_degrees().rem_euclid(360.0);
    let mut text = format!(
        "{} and {} stems, turned by {turn_deg:.1} degrees\n{} pairs within {} m, {} by another motion\n\
         distance rms {} m; DBH second minus first: mean {} m, rms {} m\n first second  apart m  DBH m  DBH m\n",
        found.stems[0],
        found.stems[1],
        found.pairs.len(),
        args.within,
        found.pairs_by_chance,
        metres(found.distance_rms_m),
        metres(found.dbh_difference_m[0]),
        metres(found.dbh_difference_m[1]),
    );
    for pair in &found.pairs {
        let [a, b] = pair.dbh_m.map(metres);
        text += &format!("{:6} {:6} {:8.2} {a:>6} {b:>6}\n", pair.a, pair.b, pair.distance_m);
    }
    print(&text)
}

fn agree(tables: &[PathBuf], within_m: f64) -> Result<Option<Agreement>, Failure> {
    match tables {
        [a, b] => Ok(agreement(&trees(a)?, &trees(b)?, within_m)),
        _ => Err(Failure::new(2, "--match takes two tables")),
    }
}

fn write_report(args: &ScoreArgs, file: &Path) -> Outcome {
    if args.plots.is_empty() && args.live.is_none() && args.tables.is_none() {
        // What is in the file now would give way to nothing.
        return Err(Failure::new(2, "--report of what? Give --plots, --live or --match"));
    }
    can_be_written(file)?;
    let runs = Runs::new(args.keep.as_deref())?;
    let mut report = Report { command: command_line(args), ..Report::default() };
    for plot in plots(&args.plots)? {
        report.plots.push(plot_row(&runs, &plot)?);
    }
    report.plots.sort_by_key(|row| (row.name.clone(), row.order()));
    if let Some(for_s) = args.live {
        for scene in SceneName::ALL {
            report.live.push(LiveRow::of(scene, &runs.demo(scene, args.seed, for_s)?)?);
        }
        for name in scene::SURVEYED {
            let found = Found::read(&runs.scene(name, args.seed)?)?;
            report.scenes.push(scene::score(name, args.seed, RayCase::Oval, &found));
        }
        for scene in [SceneName::Person, SceneName::Forest, SceneName::Grass] {
            report.moving.push(moving(scene, args.seed)?);
        }
    }
    if let Some(tables) = &args.tables {
        let name = |file: &PathBuf| file.parent().and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned());
        let names = [0, 1].map(|i| tables.get(i).and_then(name).unwrap_or_default());
        report.clouds.push(Clouds { names, agreement: agree(tables, args.within)?, within_m: args.within });
    }
    // A report that is not there yet has no kept sections.
    let old = std::fs::read_to_string(file).unwrap_or_default();
    let text = report.text(&old);
    write_bytes(file, text)?;
    tell(format_args!("tsense: {} plots, {} live scenes in {}", report.plots.len(), report.live.len(), file.display()));
    let checks: Vec<Check> = report.plots.iter().flat_map(PlotRow::checks).collect();
    verdict(args, &checks)
}

/// The command as a reader would write it: folders by their names only.
fn command_line(args: &ScoreArgs) -> String {
    let name = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut line = "tsense score --report docs/results.md".to_owned();
    line += &args.plots.iter().map(|plot| format!(" --plots {}", name(plot))).collect::<String>();
    line += &args.live.map(|for_s| format!(" --live {for_s}s --seed {}", args.seed)).unwrap_or_default();
    let table =
        |path: &PathBuf| format!(" {}/{}", path.parent().map(|p| name(&p.to_owned())).unwrap_or_default(), name(path));
    line + &args
        .tables
        .iter()
        .map(|tables| " --match".to_owned() + &tables.iter().map(table).collect::<String>())
        .collect::<String>()
}

/// Folders that are plots, and the plots in the others.
fn plots(folders: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut plots = Vec::new();
    for folder in folders {
        if Truth::is_in(folder) {
            plots.push(folder.clone());
            continue;
        }
        let entries = std::fs::read_dir(folder).map_err(|e| Failure::new(1, format!("{}: {e}", folder.display())))?;
        let mut inside: Vec<PathBuf> =
            entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| Truth::is_in(p)).collect();
        if inside.is_empty() {
            let files = "rays.ply, trees.csv, ground.npz";
            return Err(Failure::new(2, format!("{}: no plot in it ({files})", folder.display())));
        }
        inside.sort();
        plots.append(&mut inside);
    }
    Ok(plots)
}

fn plot_row(runs: &Runs, plot: &Path) -> Result<PlotRow, Failure> {
    let truth = Truth::read(plot)?;
    let name = format!("{}-{}", truth.name, truth.seed.unwrap_or(0));
    let scored = |chain| -> Result<(PlotScore, f64), Failure> {
        let (folder, seconds) = runs.survey(&name, &truth.rays, chain)?;
        Ok((score(&truth, &Found::read(&folder)?), seconds * 1e5 / truth.ray_count.max(1) as f64))
    };
    let ((default, fast), (thesis, slow)) = (scored(Chain::Default)?, scored(Chain::Thesis)?);
    Ok(PlotRow { name: truth.name.clone(), seed: truth.seed, default, thesis, seconds: [fast, slow] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_score_reads_as_a_line_a_figure() {
        let score = json!({ "scene": "forest", "trees": { "true": 4, "precision": 0.5, "dbh_bias_m": null } });
        let lines: Vec<Vec<String>> =
            figures("", &score).lines().map(|line| line.split_whitespace().map(str::to_owned).collect()).collect();
        let wanted =
            [["scene", "forest"], ["trees_dbh_bias_m", "-"], ["trees_precision", "0.5000"], ["trees_true", "4"]];
        assert_eq!(lines, wanted);
    }
}
