//! The launcher's process table as JSON, with the keys of `tsense status --json`.

use super::{Frame, Kind, json_frame};
use serde_json::{Value, json};
use tsense_contract::{ProcessState, ProcessStatus, ProcessesHeader};

/// `{graph, processes: [{name, pid, state, reason, restarts, in_hz, out_hz, dropped, age_ms, cpu, rss_bytes}]}`.
pub fn processes_frame(head: &ProcessesHeader, processes: &[ProcessStatus]) -> Frame {
    let list: Vec<Value> = processes.iter().map(process_json).collect();
    json_frame(Kind::Processes, head.stamp_ns, &json!({"graph": head.graph.to_text(), "processes": list}))
}

fn process_json(process: &ProcessStatus) -> Value {
    let dropped: serde_json::Map<String, Value> = process
        .drops
        .iter()
        .filter(|drop| drop.count > 0)
        .map(|drop| (drop.cause.to_text().into_owned(), json!(drop.count)))
        .collect();
    json!({
        "name": process.name.to_text(),
        "pid": process.pid,
        "state": ProcessState::from_wire(process.state).as_str(),
        "reason": process.reason.to_text(),
        "restarts": process.restarts,
        "in_hz": process.in_hz,
        "out_hz": process.out_hz,
        "dropped": dropped,
        "age_ms": process.age_ms,
        "cpu": process.cpu,
        "rss_bytes": process.rss_bytes,
    })
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;
    use bytemuck::Zeroable;
    use tsense_contract::Text;

    #[test]
    fn a_process_is_told_with_its_reason_and_nan_is_null() {
        let mut mapper = ProcessStatus::zeroed();
        (mapper.name, mapper.reason) = (Text::new("mapper"), Text::new("no pose for 2 s"));
        (mapper.state, mapper.age_ms, mapper.restarts) = (2, f32::NAN, 3);
        (mapper.drops[1].cause, mapper.drops[1].count) = (Text::new("no pose"), 17);
        let frame = processes_frame(&ProcessesHeader { stamp_ns: 1, graph: Text::new("demo") }, &[mapper]);
        let json: Value = serde_json::from_slice(parse(&frame).unwrap().1).unwrap();
        let process = &json["processes"][0];
        assert_eq!((&json["graph"], &process["state"]), (&json!("demo"), &json!("degraded")));
        assert_eq!((&process["reason"], &process["restarts"]), (&json!("no pose for 2 s"), &json!(3)));
        assert_eq!((&process["dropped"], &process["age_ms"]), (&json!({"no pose": 17}), &Value::Null));
    }
}
