//! `tsense`: the command line and the launcher of the Terrain Smart Sensor.
//!
//! In: arguments. Out: data on standard output, everything else on standard error, and an exit code. Each command is
//! a file in `commands/`; a child of the launcher comes in here too, as `tsense process NAME`.

mod bench;
mod commands;
mod config;
mod graph;
mod mapfile;
mod processes;
mod score;
mod survey;

use clap::{Parser, Subcommand};
use commands::Outcome;
use std::process::ExitCode;

/// Ladar terrain perception: ground, brush, trunks, drops, and a store of objects one can trust.
#[derive(Debug, Parser)]
#[command(
    name = "tsense",
    version,
    before_help = "Example: tsense run config/tsense.toml    (then, elsewhere: tsense status)",
    after_help = "Exit codes: 0 ok, 1 failed, 2 usage, 3 configuration, 4 device, 5 a process kept dying, \
        6 corrupt data, 7 replay differs, 8 self-check below its limits, 130 interrupted."
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(commands::demo::DemoArgs),
    Run(commands::run::RunArgs),
    Status(commands::status::StatusArgs),
    Stop(commands::stop::StopArgs),
    Config(commands::config::ConfigArgs),
    Device(commands::device::Args),
    Objects(commands::objects::ObjectsArgs),
    Station(commands::station::StationArgs),
    Map(commands::map::MapArgs),
    Imaging(commands::imaging::ImagingArgs),
    Simulate(commands::simulate::Args),
    Survey(commands::survey::Args),
    Score(commands::score::ScoreArgs),
    Bench(commands::bench::BenchArgs),
    #[command(hide = true)]
    Process(commands::process::ProcessArgs),
}

fn main() -> ExitCode {
    let outcome = dispatch(&Arguments::parse().command);
    ExitCode::from(outcome.unwrap_or_else(|failure| {
        eprintln!("tsense: {}", failure.message);
        failure.code
    }))
}

fn dispatch(command: &Command) -> Outcome {
    match command {
        Command::Demo(args) => commands::demo::run(args),
        Command::Run(args) => commands::run::run(args),
        Command::Status(args) => commands::status::run(args),
        Command::Stop(args) => commands::stop::run(args),
        Command::Config(args) => commands::config::run(args),
        Command::Device(args) => Ok(commands::device::run(args)),
        Command::Objects(args) => commands::objects::run(args),
        Command::Station(args) => commands::station::run(args),
        Command::Map(args) => commands::map::run(args),
        Command::Imaging(args) => commands::imaging::run(args),
        Command::Simulate(args) => commands::simulate::run(args),
        Command::Survey(args) => Ok(commands::survey::run(args)),
        Command::Score(args) => commands::score::run(args),
        Command::Bench(args) => commands::bench::run(args),
        Command::Process(args) => commands::process::run(args),
    }
}
