//! `tsense demo`: the simulated world, the whole graph on it, and a scorecard against the truth at the end.
//!
//! The world runs in this process and is reached only through its devices' wires; the graph is the real one, with a
//! name, a store and shared memory of its own, all removed at the end.
#![allow(clippy::disallowed_methods, reason = "shell: a folder for the demo's store and log")]

mod ages;
mod scorecard;
mod setup;
mod watch;

use super::{Failure, Outcome, print, words};
use crate::graph::{Graph, GraphOptions};
use clap::Args;
use scorecard::Scorecard;
use std::path::PathBuf;
use tsense_simulator::{Motion, SceneName, World, WorldClock};
use watch::Watch;

/// See the whole system work: a simulated forest, every process, and a scorecard against the truth.
#[derive(Debug, Args)]
#[command(
    before_help = "Example: tsense demo --for 60s    (then open the page whose address it prints)",
    after_help = "Runs until Ctrl-C without --for. Exit codes: 0 ok, 1 failed, 5 a process kept dying, 130 interrupted."
)]
pub struct DemoArgs {
    /// Seed of the scene: the same seed is the same world.
    #[arg(long, value_name = "N", default_value_t = 7)]
    pub seed: u64,
    /// Which scene: forest, flat, slope, grass, ditch, wall, person, young, rocks, bumps, drift.
    #[arg(long, value_name = "NAME", default_value = "forest")]
    pub scene: SceneName,
    /// Whether the vehicle stands or drives its way, at 0.7 m/s (bumps: 2.2 m/s).
    #[arg(long, value_name = "HOW", default_value = "drive", value_parser = motion)]
    pub vehicle: Motion,
    /// How many ladars nod on the head, 1 to 4: `ladar`, `ladar-left`, `ladar-right`, `ladar-top`.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=4))]
    pub ladars: u8,
    /// End by itself after this time of the world (s, m or h); without it, at Ctrl-C.
    #[arg(long = "for", value_name = "TIME", value_parser = words::seconds)]
    pub duration_s: Option<f64>,
    /// Speed of the world against real time, 0.1x to 20x.
    #[arg(long, value_name = "X", default_value = "1x", value_parser = words::speed)]
    pub speed: f64,
    /// No page: the bridge takes any free port and nobody needs to look.
    #[arg(long)]
    pub headless: bool,
    /// Print the scorecard as JSON on standard output.
    #[arg(long)]
    pub json: bool,
    /// Nothing on standard error but faults.
    #[arg(short, long)]
    pub quiet: bool,
    /// Keep the store and the log in this folder instead of a temporary one.
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
}

fn motion(text: &str) -> Result<Motion, String> {
    match text {
        "stand" => Ok(Motion::Stand),
        "drive" => Ok(Motion::Drive),
        other => Err(format!("'{other}' is neither stand nor drive")),
    }
}

/// Runs the command.
pub fn run(args: &DemoArgs) -> Outcome {
    let folder = setup::Folder::new(args.keep.as_deref())?;
    let world_options = setup::world(args, folder.path());
    let world = World::start(&world_options, WorldClock::starting_now(args.speed)).map_err(|e| Failure::new(4, e))?;
    let config = setup::config(args, &world_options, world.addresses(), folder.path())?;
    let ladars: Vec<String> = config.ladars.iter().map(|ladar| ladar.name.clone()).collect();
    let log_file = Some(folder.path().join("log.txt"));
    let mut graph = Graph::start(GraphOptions { config, speed: args.speed, log_file })?;
    let mut watch = Watch::new(&graph, args, &ladars)?;
    let asked = graph.run_until(|graph| watch.look(graph, &world))?;
    let card = watch.scorecard(&graph, &world, &world_options.rig);
    drop(watch);
    graph.stop();
    world.stop();
    report(&card, args)?;
    Ok(asked.map_or(0, |asked| asked.exit_code()))
}

fn report(card: &Scorecard, args: &DemoArgs) -> Outcome {
    if args.json {
        let text = serde_json::to_string(card).map_err(|e| Failure::new(1, e))?;
        return print(&format!("{text}\n"));
    }
    print(&card.to_text())
}
