//! `tsense process NAME --config FILE`: one process of a graph, started by the launcher.

use super::{Failure, Outcome, config};
use crate::processes;
use clap::Args;
use std::path::PathBuf;
use tsense_ports::{Domain, Process, logging};

/// One process of a running graph. The launcher starts these; by hand it refuses.
#[derive(Debug, Args)]
pub struct ProcessArgs {
    /// Name of the process: a ladar's name, pan-tilt, gpos, mapper, classifier, kstore, bridge, jaus, ros2,
    /// foxglove or fleet.
    pub name: String,
    /// The graph's resolved configuration.
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
}

/// Runs the command.
pub fn run(args: &ProcessArgs) -> Outcome {
    let config = config::load(&args.config)?;
    if !config.process_names().contains(&args.name) {
        let names = config.process_names().join(", ");
        return Err(Failure::new(
            2,
            format!("no process `{}` in {}: there are {names}", args.name, args.config.display()),
        ));
    }
    logging::start(&args.name, &config.graph.log, config.graph.log_format);
    let process = Process::join(&Domain::new(&config.graph.name)?, &args.name)?;
    processes::run(process, &config).map(|()| 0).map_err(|e| {
        // Into the log as well: standard error may be a file that only the log's format fits.
        tracing::error!("{e}");
        Failure::new(1, format!("process {}: {e}", args.name))
    })
}
