//! The launcher's process table as diagnostic_msgs/DiagnosticArray. Pure.

use super::messages::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};
use tsense_contract::{ProcessState, ProcessStatus, ProcessesHeader};

/// One status a process, named `tsense/<process>`.
pub fn diagnostics(header: &ProcessesHeader, processes: &[ProcessStatus]) -> DiagnosticArray {
    let graph = header.graph.to_text();
    let status = processes.iter().map(|process| status(process, &graph)).collect();
    DiagnosticArray { header: Header::new(header.stamp_ns, ""), status }
}

fn status(process: &ProcessStatus, graph: &str) -> DiagnosticStatus {
    let state = ProcessState::from_wire(process.state);
    let mut values = vec![
        value("state", state),
        value("pid", process.pid),
        value("restarts", process.restarts),
        value("in_hz", process.in_hz),
        value("out_hz", process.out_hz),
        value("age_ms", process.age_ms),
        value("cpu", process.cpu),
        value("rss_bytes", process.rss_bytes),
    ];
    let drops = process.drops.iter().filter(|drop| drop.count > 0);
    values.extend(drops.map(|drop| value(&format!("dropped: {}", drop.cause.to_text()), drop.count)));
    DiagnosticStatus {
        level: level(state),
        name: format!("tsense/{}", process.name.to_text()),
        message: process.reason.to_text().into_owned(),
        hardware_id: graph.into(),
        values,
    }
}

/// OK, WARN, ERROR, STALE.
fn level(state: ProcessState) -> u8 {
    match state {
        ProcessState::Running => 0,
        ProcessState::Starting | ProcessState::Degraded => 1,
        ProcessState::Failed => 2,
        ProcessState::Stale => 3,
    }
}

fn value(key: &str, value: impl std::fmt::Display) -> KeyValue {
    KeyValue { key: key.into(), value: value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use tsense_contract::{DropCount, Text};

    #[test]
    fn a_degraded_process_warns_and_tells_its_drops() {
        let mut process = ProcessStatus::zeroed();
        (process.name, process.reason) = (Text::new("mapper"), Text::new("no pose"));
        process.state = ProcessState::Degraded.to_wire();
        process.drops[0] = DropCount { cause: Text::new("too old"), count: 3 };
        let list = diagnostics(&ProcessesHeader { stamp_ns: 5, graph: Text::new("demo") }, &[process]);
        let status = &list.status[0];
        assert_eq!((status.level, status.name.as_str(), status.message.as_str()), (1, "tsense/mapper", "no pose"));
        assert_eq!(status.hardware_id, "demo");
        assert_eq!(status.values.last().unwrap(), &value("dropped: too old", 3));
    }
}
