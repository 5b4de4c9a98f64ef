//! `tsense status`: the table of a running graph.

use super::{Failure, Outcome, print, words};
use crate::graph::{Request, Status, ask};
use clap::Args;
use tsense_ports::Domain;

/// Show every process of a running graph: state with its reason, rates, drops, age of data, load.
#[derive(Debug, Args)]
#[command(before_help = "Example: tsense status    (or, for programs: tsense status --json)")]
pub struct StatusArgs {
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Name of the graph; needed only where several are running.
    #[arg(long, value_name = "NAME", value_parser = words::graph)]
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

/// Columns for people. What is longest comes last, so that a narrow terminal breaks nothing else: the reason, and what was
/// dropped.
fn table(status: &Status) -> String {
    let head = ["process", "pid", "state", "restarts", "in/s", "out/s", "age ms", "cpu %", "MB", "reason"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(status.processes.iter().map(|row| {
        let dropped: Vec<String> = row.dropped.iter().map(|(cause, count)| format!("{count} {cause}")).collect();
        let dropped = if dropped.is_empty() { String::new() } else { format!("; dropped: {}", dropped.join(", ")) };
        [
            row.name.clone(),
            if row.pid == 0 { "-".into() } else { row.pid.to_string() },
            row.state.to_string(),
            row.restarts.to_string(),
            format!("{:.1}", row.in_hz),
            format!("{:.1}", row.out_hz),
            row.age_ms.map_or_else(|| "-".into(), |ms| format!("{ms:.0}")),
            format!("{:.1}", row.cpu * 100.0),
            format!("{:.1}", row.rss_bytes as f64 / 1e6),
            format!("{}{dropped}", row.reason),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::ProcessRow;
    use std::collections::BTreeMap;
    use tsense_contract::ProcessState;

    #[test]
    fn what_is_long_stands_behind_the_columns_and_they_fit_a_narrow_terminal() {
        let row = ProcessRow {
            name: "pan-tilt".into(),
            pid: 1_234_567,
            state: ProcessState::Running,
            reason: "nodding".into(),
            restarts: 0,
            in_hz: 31.8,
            out_hz: 31.8,
            dropped: BTreeMap::from([("answer timeout".into(), 2), ("answer out of step".into(), 1)]),
            age_ms: Some(83.0),
            cpu: 0.02,
            rss_bytes: 18_400_000,
        };
        let text = table(&Status { graph: "field".into(), processes: vec![row] });
        let line = text.lines().nth(2).unwrap();
        assert!(line.ends_with("  nodding; dropped: 1 answer out of step, 2 answer timeout"), "{line}");
        assert!(line.find("nodding").unwrap() <= 80, "{line}");
    }
}
