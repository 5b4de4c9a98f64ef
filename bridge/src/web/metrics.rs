//! The bridge's counters in Prometheus' text format.

use serde_json::Value;
use std::fmt::Write;

/// One line a number: top-level numbers as they are called, one level deeper with the key as a label.
pub fn metrics_text(report: &Value, clients: usize) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "tsense_bridge_clients {clients}");
    let counters = report["counters"].as_object().into_iter().flatten();
    for (name, value) in counters.filter(|(name, _)| *name != "clients") {
        if value.is_number() {
            let _ = writeln!(text, "tsense_bridge_{name} {value}");
        }
        let labelled = value.as_object().into_iter().flatten();
        for (key, value) in labelled.filter(|(_, value)| value.is_number()) {
            let _ = writeln!(text, "tsense_bridge_{name}{{of=\"{}\"}} {value}", key.replace(['"', '\\', '\n'], "_"));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_lines_and_words_do_not() {
        let report = serde_json::json!({"state": "running", "counters":
            {"beams_per_s": 13525.0, "clients": 9, "age_ms": {"map": 180.0, "grid": null}}});
        let expected =
            "tsense_bridge_clients 2\ntsense_bridge_age_ms{of=\"map\"} 180.0\ntsense_bridge_beams_per_s 13525.0\n";
        assert_eq!(metrics_text(&report, 2), expected);
        assert_eq!(metrics_text(&Value::Null, 0), "tsense_bridge_clients 0\n");
    }
}
