//! `tsense bench clouds`, `shares` and `ground`: what the voxel map is worth, as tables, JSON and plots.

use super::{Failure, Outcome, print, words};
use crate::bench::Recording;
use crate::bench::clouds::{self, Row};
use crate::bench::ground::{GroundRow, PersonRow, ground, person};
use crate::bench::shares::{Shares, SharesError, shares};
use crate::bench::svg::{Axis, Chart, Series, svg};
use crate::files::{OutputError, can_be_written, write_bytes};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use tsense_mapper::Config;
use tsense_simulator::{RayCase, SceneName};

/// Voxels against point clouds: to insert a beam, to fetch a neighbourhood, memory, as data grows.
#[derive(Debug, Args)]
#[command(before_help = "Example: tsense bench clouds --plot clouds.svg")]
pub struct CloudsArgs {
    /// Numbers of returns at which the stores are measured, ascending
    #[arg(long, value_name = "N,N,...", value_delimiter = ',', default_value = "10000,100000,300000,1000000,3000000")]
    returns: Vec<usize>,
    /// Write a plot
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Print JSON on stdout
    #[arg(long)]
    json: bool,
}

/// Occupied and free shares of the map over time, for a tripod and a drive in the simulator's forest.
#[derive(Debug, Args)]
#[command(before_help = "Example: tsense bench shares --plot shares.svg")]
pub struct SharesArgs {
    /// Write a plot
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Print JSON on stdout
    #[arg(long)]
    json: bool,
}

/// Does the ground stay, and does a person who left go: on the simulator's scenes.
#[derive(Debug, Args)]
#[command(before_help = "Example: tsense bench ground --scene forest --json")]
pub struct GroundArgs {
    /// A scene; may be repeated; flat, slope, forest, grass and ditch by default
    #[arg(long = "scene", value_name = "NAME")]
    scenes: Vec<SceneName>,
    /// Seed of the scenes
    #[arg(long, value_name = "N", default_value_t = 7)]
    seed: u64,
    /// Share of its length that a beam spares before the ground, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = Config::default().evidence.grazing_spare_share, value_parser = words::within(0.0, 1.0))]
    grazing: f64,
    /// Print JSON on stdout
    #[arg(long)]
    json: bool,
}

/// Runs `tsense bench clouds`.
pub fn run_clouds(args: &CloudsArgs) -> Outcome {
    args.plot.iter().try_for_each(|file| can_be_written(file))?;
    if !args.returns.is_sorted_by(|a, b| a < b) || args.returns.first() == Some(&0) {
        return Err(Failure::new(2, "--returns: numbers above 0 in ascending order are wanted"));
    }
    // 20 m is the ladar's usable range.
    let recording = Recording::simulated(RayCase::Clipped, 20.0).map_err(|e| Failure::new(6, e))?;
    let rows = clouds::compare(&recording, &args.returns).map_err(|e| Failure::new(2, e))?;
    write_plot(args.plot.as_deref(), || clouds_charts(&rows))?;
    if args.json {
        return print(&format!("{}\n", json!({ "near_m": clouds::NEAR_M, "rows": rows })));
    }
    let mut text = String::from("store                    returns  insert us  fetch us     found  memory MB\n");
    for r in &rows {
        let times = format!("{:10.2} {:9.2} {:9.1} {:10.1}", r.insert_us, r.fetch_us, r.found, r.memory_mb);
        text.push_str(&format!("{:22} {:9} {times}\n", r.store, r.returns));
    }
    print(&text)
}

fn clouds_charts(rows: &[Row]) -> Vec<Chart> {
    let x = Axis { label: "returns stored", is_log: true };
    let mut names: Vec<&'static str> = rows.iter().map(|row| row.store).collect();
    names.dedup();
    let chart = |title, label, value: fn(&Row) -> f64| {
        let points = |name| rows.iter().filter(|r| r.store == name).map(|r| [r.returns as f64, value(r)]).collect();
        let series = names.iter().map(|name| Series { name, points: points(*name) }).collect();
        Chart { title, x, y: Axis { label, is_log: true }, series }
    };
    vec![
        chart("Insert a beam", "time a beam, µs", |row| row.insert_us),
        chart("Fetch all within 0.5 m", "time a place, µs", |row| row.fetch_us),
        chart("Memory", "memory, MB", |row| row.memory_mb),
    ]
}

/// Runs `tsense bench shares`.
pub fn run_shares(args: &SharesArgs) -> Outcome {
    args.plot.iter().try_for_each(|file| can_be_written(file))?;
    let [still, drive] = [RayCase::Static, RayCase::Drive].map(shares).map(|list| list.map_err(failure));
    let (still, drive) = (still?, drive?);
    write_plot(args.plot.as_deref(), || shares_charts(&still, &drive))?;
    if args.json {
        return print(&format!("{}\n", json!({ "static": still, "drive": drive })));
    }
    let mut text = String::from("case    time s  occupied %  free %  occupied of known %     known\n");
    for (case, list) in [("static", &still), ("drive", &drive)] {
        for s in list {
            let shares = [s.occupied_of_all(), s.free_of_all(), s.occupied_of_known()].map(|share| share * 100.0);
            let [occupied, free, of_known] = shares;
            let known = s.known();
            text.push_str(&format!("{case:7} {:6.1} {occupied:11.3} {free:7.2} {of_known:20.2} {known:9}\n", s.at_s));
        }
    }
    print(&text)
}

fn shares_charts(still: &[Shares], drive: &[Shares]) -> Vec<Chart> {
    let x = Axis { label: "time, s", is_log: false };
    let series = |name, list: &[Shares], value: fn(&Shares) -> f64| Series {
        name,
        points: list.iter().map(|s| [s.at_s, value(s)]).collect(),
    };
    let of_known: fn(&Shares) -> f64 = |s| s.occupied_of_known() * 100.0;
    let known: fn(&Shares) -> f64 = |s| s.known() as f64;
    let all = vec![
        series("tripod, free", still, |s| s.free_of_all() * 100.0),
        series("drive, free", drive, |s| s.free_of_all() * 100.0),
        series("tripod, occupied", still, |s| s.occupied_of_all() * 100.0),
        series("drive, occupied", drive, |s| s.occupied_of_all() * 100.0),
    ];
    // Free space is known from the end of the first window on.
    let two = |value| {
        [("tripod", still), ("drive", drive)].map(|(name, list)| series(name, from_first_window(list), value)).to_vec()
    };
    let linear = |label| Axis { label, is_log: false };
    vec![
        Chart {
            title: "Shares of the working space",
            x,
            y: Axis { label: "share of all voxels, %", is_log: true },
            series: all,
        },
        Chart { title: "Occupied among the known", x, y: linear("share of known voxels, %"), series: two(of_known) },
        Chart { title: "Known voxels", x, y: linear("voxels"), series: two(known) },
    ]
}

fn from_first_window(list: &[Shares]) -> &[Shares] {
    let first = list.iter().position(|shares| shares.free > 0).unwrap_or(0);
    &list[first..]
}

/// Runs `tsense bench ground`.
pub fn run_ground(args: &GroundArgs) -> Outcome {
    use SceneName::{Ditch, Flat, Forest, Grass, Slope};
    let scenes = if args.scenes.is_empty() { vec![Flat, Slope, Forest, Grass, Ditch] } else { args.scenes.clone() };
    let mut config = Config::default();
    config.evidence.grazing_spare_share = args.grazing;
    let (mut rows, mut persons) = (Vec::new(), Vec::new());
    for scene in scenes {
        for case in [RayCase::Static, RayCase::Drive] {
            let row = ground(scene, args.seed, case, &config).map_err(failure)?;
            if !args.json {
                print(&ground_text(&row))?;
            }
            rows.push(row);
        }
        let row = person(scene, args.seed, &config).map_err(failure)?;
        if !args.json {
            let text = format!("{}, a person left: occupied voxels {:?}", row.scene, row.occupied);
            let (again, through) = (row.hit_again, row.seen_through);
            print(&format!("{text}; of the last {again} hit again, {through} others seen through three times\n"))?;
        }
        persons.push(row);
    }
    if args.json { print(&ground_json(&rows, &persons)) } else { Ok(0) }
}

fn ground_text(row: &GroundRow) -> String {
    let (all, bare) = (row.eroded_share * 100.0, row.bare_eroded_share * 100.0);
    format!(
        "{}, {}: eroded {all:.2} % of {} ground voxels; {bare:.2} % of {} bare ones\n",
        row.scene, row.case, row.ground, row.bare
    )
}

fn ground_json(rows: &[GroundRow], persons: &[PersonRow]) -> String {
    format!("{}\n", json!({ "ground": rows, "persons": persons }))
}

fn failure(error: SharesError) -> Failure {
    Failure::new(if matches!(error, SharesError::Map(_)) { 2 } else { 6 }, error)
}

fn write_plot(file: Option<&Path>, charts: impl FnOnce() -> Vec<Chart>) -> Result<(), OutputError> {
    file.map_or(Ok(()), |file| write_bytes(file, svg(&charts())))
}
