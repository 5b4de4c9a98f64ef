//! Tests of the table of processes.

use super::*;
use tsense_contract::Message;

fn beat(stamp_ns: i64, taken: u64) -> Heartbeat {
    let mut drops = [DropCount { cause: Text::new(""), count: 0 }; DROP_CAUSES_MAX];
    drops[0] = DropCount { cause: Text::new("no pose"), count: 3 };
    Heartbeat {
        stamp_ns,
        newest_ns: stamp_ns - 40_000_000,
        taken,
        sent: taken / 2,
        name: Text::new("mapper"),
        reason: Text::new("all well"),
        drops,
        pid: 42,
        state: ProcessState::Running.to_wire(),
        reserved: [0; 3],
    }
}

fn table() -> Table {
    Table::new(&["mapper".to_owned()])
}

fn only_row(table: &Table, now_ns: i64) -> ProcessRow {
    table.status("g", Timestamp::from_ns(now_ns)).processes.remove(0)
}

#[test]
fn rates_and_age_are_in_graph_time() {
    let mut table = table();
    table.started("mapper", 42, 1);
    for i in 0..20 {
        table.beat("mapper", &beat(1_000_000_000 + i * 200_000_000, 10 * i as u64));
    }
    let row = only_row(&table, 4_810_000_000);
    assert_eq!((row.in_hz, row.out_hz, row.restarts, row.pid), (50.0, 25.0, 1, 42));
    assert_eq!((row.state, row.reason.as_str()), (ProcessState::Running, "all well"));
    assert!((row.age_ms.unwrap() - 50.0).abs() < 1e-3);
    assert_eq!(row.dropped, BTreeMap::from([("no pose".to_owned(), 3)]));
}

#[test]
fn the_silent_are_stale_and_the_dead_have_failed_whatever_they_said_last() {
    let mut table = table();
    table.started("mapper", 42, 0);
    assert_eq!(only_row(&table, 0).state, ProcessState::Starting);
    table.rows[0].started_s -= 6.0;
    assert_eq!(only_row(&table, 0).state, ProcessState::Stale);
    table.beat("mapper", &beat(1, 0));
    assert_eq!(only_row(&table, 0).state, ProcessState::Running);
    table.rows[0].beat_s -= 2.0;
    let row = only_row(&table, 0);
    assert_eq!(row.state, ProcessState::Stale);
    assert!(row.reason.starts_with("no heartbeat for 2."), "{}", row.reason);
    table.died("mapper", "was killed by signal 9 after 1.0 s");
    let row = only_row(&table, 0);
    assert_eq!((row.state, row.pid), (ProcessState::Failed, 0));
    assert_eq!(row.reason, "was killed by signal 9 after 1.0 s");
}

#[test]
fn json_and_the_topic_say_the_same_as_the_table() {
    let mut table = table();
    table.started("mapper", 42, 2);
    table.beat("mapper", &beat(1_000, 4));
    let status = table.status("field", Timestamp::from_ns(1_000));
    let json = serde_json::to_value(&status).unwrap();
    assert_eq!(json["processes"][0]["state"], "running");
    assert_eq!(json["processes"][0]["dropped"]["no pose"], 3);
    let keys: Vec<&str> = json["processes"][0].as_object().unwrap().keys().map(String::as_str).collect();
    for key in
        ["name", "pid", "state", "reason", "restarts", "in_hz", "out_hz", "dropped", "age_ms", "cpu", "rss_bytes"]
    {
        assert!(keys.contains(&key), "{key}");
    }
    assert_eq!(serde_json::from_value::<Status>(json).unwrap(), status);
    let (header, rows) = status.message(Timestamp::from_ns(5));
    assert_eq!((header.graph.to_text().into_owned(), header.stamp_ns), ("field".to_owned(), 5));
    assert_eq!((rows[0].restarts, rows[0].drops[0].count), (2, 3));
    assert_eq!(ProcessStatus::TYPE_NAME, "tsense.process.v1");
}
