//! `tsense config check FILE` and `tsense config show [FILE]`.
#![allow(clippy::disallowed_methods, reason = "shell: the configuration file")]

use super::{Failure, Outcome, print};
use crate::config::parse::{Sections, Validate, parse};
use crate::config::{Config, report::render, survey::SurveyConfig};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

/// Look at a configuration without starting anything.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    before_help = "Example: tsense config show > tsense.toml    (then, edited: tsense config check tsense.toml)"
)]
pub struct ConfigArgs {
    #[command(subcommand)]
    command: ConfigCommand,
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    /// List all faults of a file with line, value and allowed range; exit code 3 if there are any.
    #[command(before_help = "Example: tsense config check tsense.toml")]
    Check {
        /// The configuration, TOML.
        file: PathBuf,
    },
    /// Print the configuration with every key written out.
    #[command(before_help = "Example: tsense config show > tsense.toml")]
    Show {
        /// The configuration, TOML; without it, the defaults of all stages.
        file: Option<PathBuf>,
        /// Print the settings of a survey instead, for `tsense survey --settings`
        #[arg(long, conflicts_with = "file")]
        survey: bool,
    },
}

/// Runs the command.
pub fn run(args: &ConfigArgs) -> Outcome {
    match &args.command {
        ConfigCommand::Check { file } => load_graph(file).map(|_| 0),
        ConfigCommand::Show { survey: true, .. } => print(&SurveyConfig::default().to_toml()),
        ConfigCommand::Show { file: Some(file), .. } => print(&load(file)?.to_toml()),
        ConfigCommand::Show { file: None, .. } => print(&Config::full().to_toml()),
    }
}

/// Reads the configuration of a graph: one without a process starts nothing.
pub fn load_graph(file: &Path) -> Result<Config, Failure> {
    let config = load(file)?;
    match config.process_names().is_empty() {
        true => Err(Failure::new(3, format!("{}: no process is configured: write a section for each", file.display()))),
        false => Ok(config),
    }
}

/// Reads a configuration; its faults are a failure with exit code 3.
pub fn load(file: &Path) -> Result<Config, Failure> {
    read(file)
}

/// Reads a file of settings of one kind or another.
pub fn read<C: Sections + Validate>(file: &Path) -> Result<C, Failure> {
    let shown = file.display().to_string();
    let text = std::fs::read_to_string(file).map_err(|e| {
        Failure::new(3, format!("{shown}: {e}; a text file (UTF-8) is wanted, as `tsense config show` prints it"))
    })?;
    parse(&text).map_err(|reports| Failure::new(3, render(&shown, &text, &reports).trim_end()))
}
