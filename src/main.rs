//! `tsense`: the command line and the launcher of the Terrain Smart Sensor.
//!
//! In: arguments. Out: data on standard output, everything else on standard error, and an exit code. Each command is
//! a file in `commands/`; a child of the launcher comes in here too, as `tsense process NAME`.

#![warn(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "these end the program where nobody listens: `commands::print` and `tell`"
)]

mod bench;
mod commands;
mod config;
mod files;
mod graph;
mod mapfile;
mod processes;
mod score;
mod survey;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use commands::{Outcome, tell};
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
    let outcome = dispatch(&arguments().command);
    ExitCode::from(outcome.unwrap_or_else(|failure| {
        tell(format_args!("tsense: {}", failure.message));
        failure.code
    }))
}

/// What was typed. Negative numbers are values, so that what is wrong with them is told by the option they are for.
fn arguments() -> Arguments {
    fn with_negative_numbers(command: clap::Command) -> clap::Command {
        command
            .mut_args(|arg| if arg.get_action().takes_values() { arg.allow_negative_numbers(true) } else { arg })
            .mut_subcommands(with_negative_numbers)
    }
    let command = with_negative_numbers(Arguments::command());
    Arguments::from_arg_matches(&command.get_matches()).unwrap_or_else(|error| error.exit())
}

fn dispatch(command: &Command) -> Outcome {
    match command {
        Command::Demo(args) => commands::demo::run(args),
        Command::Run(args) => commands::run::run(args),
        Command::Status(args) => commands::status::run(args),
        Command::Stop(args) => commands::stop::run(args),
        Command::Config(args) => commands::config::run(args),
        Command::Device(args) => commands::device::run(args),
        Command::Objects(args) => commands::objects::run(args),
        Command::Station(args) => commands::station::run(args),
        Command::Map(args) => commands::map::run(args),
        Command::Imaging(args) => commands::imaging::run(args),
        Command::Simulate(args) => commands::simulate::run(args),
        Command::Survey(args) => commands::survey::run(args),
        Command::Score(args) => commands::score::run(args),
        Command::Bench(args) => commands::bench::run(args),
        Command::Process(args) => commands::process::run(args),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The commands that a person may type, with all above them; `check` is given the words and the command.
    fn each(words: &str, command: &clap::Command, check: &mut dyn FnMut(&str, &clap::Command)) {
        check(words, command);
        for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
            each(&format!("{words} {}", below.get_name()), below, check);
        }
    }

    #[test]
    fn help_begins_with_an_example_of_the_command_itself_and_says_what_every_argument_is() {
        let mut commands = 0;
        each("tsense", &Arguments::command(), &mut |words, command| {
            commands += 1;
            let help = command.get_before_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.starts_with("Example:") && help.contains(words), "{words}: {help}");
            for argument in command.get_arguments() {
                assert!(argument.get_help().is_some(), "{words}: {}", argument.get_id());
            }
        });
        assert!(commands > 25, "{commands}");
    }
}
