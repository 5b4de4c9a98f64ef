//! `tsense status`: the table of a running graph.

use super::{Failure, Outcome, print};
use crate::graph::{Request, Status, ask};
use clap::Args;
use tsense_ports::Domain;

/// Show every process of a running graph: state with its reason, rates, drops, age of data, load.
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Name of the graph; needed only where several are running.
    #[arg(long, value_name = "NAME")]
    pub graph: Option<String>,
}

/// Runs the command.
pub fn run(args: &StatusArgs) -> Outcome {
    let status = ask(&find(args.graph.as_deref())?, Request::Status)?;
    if args.json {
        let json = serde_json::to_string_pretty(&status).map_err(|e| Failure::new(1, e))?;
        return print(&format!("{json}\n"));
    }
    print(&table(&status))
}

/// The graph with this name, or the only one that is running.
pub fn find(name: Option<&str>) -> Result<Domain, Failure> {
    if let Some(name) = name {
        return Domain::new(name).map_err(|e| Failure::new(2, e));
    }
    let mut running: Vec<Domain> = Domain::list().into_iter().filter(|d| ask(d, Request::Status).is_ok()).collect();
    match running.len() {
        1 => Ok(running.remove(0)),
        0 => Err(Failure::new(1, "no graph is running; start one with `tsense run CONFIG` or `tsense demo`")),
        _ => {
            let names: Vec<&str> = running.iter().map(Domain::name).collect();
            Err(Failure::new(2, format!("several graphs are running: say --graph with one of {}", names.join(", "))))
        }
    }
}

/// Columns for people; the reason comes last because it is the longest.
fn table(status: &Status) -> String {
    let head = ["process", "pid", "state", "restarts", "in/s", "out/s", "age ms", "dropped", "cpu %", "MB", "reason"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(status.processes.iter().map(|row| {
        let dropped = row.dropped.iter().map(|(cause, count)| format!("{count} {cause}"));
        [
            row.name.clone(),
            if row.pid == 0 { "-".into() } else { row.pid.to_string() },
            row.state.to_string(),
            row.restarts.to_string(),
            format!("{:.1}", row.in_hz),
            format!("{:.1}", row.out_hz),
            row.age_ms.map_or_else(|| "-".into(), |ms| format!("{ms:.0}")),
            dropped.collect::<Vec<_>>().join(", "),
            format!("{:.1}", row.cpu * 100.0),
            format!("{:.1}", row.rss_bytes as f64 / 1e6),
            row.reason.clone(),
        ]
    }));
    let widths: Vec<usize> =
        (0..head.len()).map(|i| rows.iter().map(|row| row[i].chars().count()).max().unwrap_or(0)).collect();
    let mut text = format!("graph {}\n", status.graph);
    for row in rows {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}"));
        text.push_str(cells.collect::<Vec<_>>().join("  ").trim_end());
        text.push('\n');
    }
    text
}
