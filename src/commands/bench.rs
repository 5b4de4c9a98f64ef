//! `tsense bench`: what the mapper's inner job costs on this machine.

use super::studies::{CloudsArgs, GroundArgs, SharesArgs, run_clouds, run_ground, run_shares};
use super::{Failure, Outcome, print, tell, words};
use crate::bench::{Figures, Options, Recording, measure};
use clap::{Args, Subcommand};
use serde_json::json;
use std::path::PathBuf;
use tsense_simulator::RayCase;

/// Measure a stage on this machine.
#[derive(Debug, Args)]
#[command(before_help = "Example: tsense bench mapper --repeat 5    (or: tsense bench mapper --rays plot.ply --json)")]
pub struct BenchArgs {
    #[command(subcommand)]
    stage: Stage,
}

#[derive(Debug, Subcommand)]
enum Stage {
    Mapper(MapperArgs),
    Clouds(CloudsArgs),
    Shares(SharesArgs),
    Ground(GroundArgs),
}

/// Every beam of a recording through the voxel map: nanoseconds a beam, snapshots, eroded surfaces.
#[derive(Debug, Args)]
#[command(before_help = "Example: tsense bench mapper --rays plot.ply --voxel 0.15 --json")]
struct MapperArgs {
    /// Ray cloud to measure on, instead of the built-in cases
    #[arg(long, value_name = "FILE.ply", conflicts_with = "cases")]
    rays: Option<PathBuf>,
    /// A built-in case: static (tripod), clipped (to 30 x 30 x 12 m), drive (40 m); may be repeated; all by default
    #[arg(long = "case", value_name = "NAME")]
    cases: Vec<RayCase>,
    /// Edge of a voxel, metres
    #[arg(long, value_name = "M", default_value_t = 0.05, value_parser = words::within(0.01, 10.0))]
    voxel: f64,
    /// Where longer rays are cut, metres
    #[arg(long, value_name = "M", default_value_t = 20.0, value_parser = words::within(0.1, 1e6))]
    range: f64,
    /// Length of a window of evidence, seconds; one nod of the built-in cases
    #[arg(long, value_name = "S", default_value_t = 2.5, value_parser = words::within(0.001, 1e6))]
    window: f64,
    /// Passes for each instruction set; the median counts
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    repeat: u16,
    /// Print JSON on stdout
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &BenchArgs) -> Outcome {
    if cfg!(debug_assertions) {
        tell("bench: this tsense was built without --release; its times say nothing about the real one");
    }
    match &args.stage {
        Stage::Mapper(args) => run_mapper(args),
        Stage::Clouds(args) => run_clouds(args),
        Stage::Shares(args) => run_shares(args),
        Stage::Ground(args) => run_ground(args),
    }
}

fn run_mapper(args: &MapperArgs) -> Outcome {
    let options = Options { voxel_m: args.voxel, window_s: args.window, repeat: args.repeat.into() };
    let mut cases = Vec::new();
    for recording in recordings(args) {
        let figures = measure(&recording?, &options).map_err(|e| Failure::new(2, e))?;
        if !args.json {
            print(&text(&figures))?;
        }
        cases.push(figures);
    }
    if args.json { print(&format!("{}\n", json!({ "cases": cases }))) } else { Ok(0) }
}

fn recordings(args: &MapperArgs) -> impl Iterator<Item = Result<Recording, Failure>> {
    let all = [RayCase::Static, RayCase::Clipped, RayCase::Drive];
    let cases = if args.cases.is_empty() { all.to_vec() } else { args.cases.clone() };
    let file = args.rays.iter().map(|path| Recording::open(path, args.range));
    let simulated = cases.into_iter().filter(|_| args.rays.is_none());
    file.chain(simulated.map(|case| Recording::simulated(case, args.range)))
        .map(|recording| recording.map_err(|e| Failure::new(e.exit_code(), e)))
}

fn text(f: &Figures) -> String {
    let sets = f.ns_per_beam_by_instruction_set.iter().map(|(set, ns)| format!("{set} {ns:.0}"));
    format!(
        "{}: {} beams in {} m voxels, {:.1} voxels a beam\n  \
           every voxel updated: {:.0} ns a beam ({}); default rules: {:.0} ns a beam\n  \
           instruction sets: {}\n  \
           snapshot of three scans: p50 {:.0}, p99 {:.0} us; all {} blocks, {} bricks known: {:.0} us\n  \
           eroded: {:.2} % of {} surface voxels\n",
        f.case,
        f.beams,
        f.voxel_m,
        f.voxel_visits as f64 / f.beams.max(1) as f64,
        f.ns_per_beam,
        f.instruction_set,
        f.ns_per_beam_default_rules,
        sets.collect::<Vec<_>>().join(", "),
        f.snapshot_us.p50,
        f.snapshot_us.p99,
        f.keyframe.blocks,
        f.keyframe.bricks,
        f.keyframe.us,
        f.eroded_share * 100.0,
        f.surface_voxels
    )
}
