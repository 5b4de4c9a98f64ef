//! `tsense stop`: asks a running graph to end, and waits until it did.
#![allow(clippy::disallowed_methods, reason = "shell: waiting for another process")]

use super::{Failure, Outcome, status, words};
use crate::graph::{Request, ask};
use clap::Args;
use std::time::Duration;
use tsense_ports::machine_seconds;

/// Longest wait, seconds: processes get three to end, then they are killed.
const PATIENCE_S: f64 = 10.0;

/// Ask a running graph to end, and wait until it did.
#[derive(Debug, Args)]
#[command(before_help = "Example: tsense stop --graph field")]
pub struct StopArgs {
    /// Name of the graph; needed only where several are running.
    #[arg(long, value_name = "NAME", value_parser = words::graph)]
    pub graph: Option<String>,
}

/// Runs the command.
pub fn run(args: &StopArgs) -> Outcome {
    let domain = status::find(args.graph.as_deref())?;
    ask(&domain, Request::Stop)?;
    let until_s = machine_seconds() + PATIENCE_S;
    while !domain.leftovers().is_empty() {
        if machine_seconds() > until_s {
            return Err(Failure::new(1, format!("graph `{}` is still there after {PATIENCE_S} s", domain.name())));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(0)
}
