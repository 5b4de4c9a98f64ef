//! `tsense run CONFIG`: the whole graph, until it is asked to end.

use super::{Outcome, config, words};
use crate::graph::{Graph, GraphOptions};
use clap::Args;
use std::path::PathBuf;
use tsense_ports::logging::{self, LogFormat};

/// Start every process of a configuration, watch them, and end them together.
#[derive(Debug, Args)]
#[command(
    before_help = "Example: tsense run config/simulator.toml    (after: tsense simulate --vehicle drive)",
    after_help = "Ends with Ctrl-C (exit code 130), SIGTERM or `tsense stop` (exit code 0). \
        Look at it with `tsense status`. TSENSE_LOG=debug says more."
)]
pub struct RunArgs {
    /// The configuration, TOML; `tsense config show` prints one with every key.
    pub config: PathBuf,
    /// Name of the graph instead of the configured one.
    #[arg(long, value_name = "NAME", value_parser = words::graph)]
    pub graph: Option<String>,
    /// Where the graph keeps files, such as the store, instead of the configured folder.
    #[arg(long, value_name = "DIR")]
    pub state_dir: Option<PathBuf>,
    /// How log lines look.
    #[arg(long, value_name = "FORMAT", value_enum, default_value_t = Format::Configured)]
    pub log_format: Format,
    /// Log errors only.
    #[arg(short, long)]
    pub quiet: bool,
}

/// How log lines look.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// As the configuration says.
    Configured,
    /// Lines of text.
    Human,
    /// One JSON object a line.
    Json,
}

/// Runs the command.
pub fn run(args: &RunArgs) -> Outcome {
    let mut config = config::load_graph(&args.config)?;
    if let Some(name) = &args.graph {
        config.graph.name.clone_from(name);
    }
    if let Some(folder) = &args.state_dir {
        config.graph.state_dir.clone_from(folder);
    }
    match args.log_format {
        Format::Configured => {}
        Format::Human => config.graph.log_format = LogFormat::Human,
        Format::Json => config.graph.log_format = LogFormat::Json,
    }
    if args.quiet {
        config.graph.log = "error".into();
    }
    logging::start("launcher", &config.graph.log, config.graph.log_format);
    let mut graph = Graph::start(GraphOptions::new(config))?;
    let asked = graph.run_until(|_| false)?;
    graph.stop();
    Ok(asked.map_or(0, |asked| asked.exit_code()))
}
