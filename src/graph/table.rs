//! The table of processes: what each says in its heartbeats, and what the launcher sees of it.
//!
//! In: heartbeats (graph time), starts, deaths, `/proc`. Out: [`Status`], which becomes JSON, a table for people, and
//! the topic `processes`. Rates are per graph second, over the last second of heartbeats.

use super::usage::Usage;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, VecDeque};
use tsense_contract::{
    DROP_CAUSES_MAX, DropCount, Heartbeat, ProcessState, ProcessStatus, Processes, ProcessesHeader, Text, Topic,
};
use tsense_geometry::Timestamp;
use tsense_ports::machine_seconds;

/// A process whose last heartbeat is older is stale, seconds: five heartbeats are missing.
const STALE_S: f64 = 1.0;
/// A process that was started and never beat is stale after this, seconds: a debug build under load needs its time.
const STARTING_MAX_S: f64 = 5.0;
/// Heartbeats that rates are taken over: a second's worth.
const BEATS: usize = 6;

/// The table of one graph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Name of the graph.
    pub graph: String,
    /// One row a process, in their order of start.
    pub processes: Vec<ProcessRow>,
}

/// One process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProcessRow {
    /// Its name.
    pub name: String,
    /// Process id, 0 where not running.
    pub pid: u32,
    /// How it is.
    #[serde(with = "state_as_text")]
    pub state: ProcessState,
    /// Why, in words.
    pub reason: String,
    /// Restarts since the graph started.
    pub restarts: u64,
    /// Samples in a graph second.
    pub in_hz: f32,
    /// Samples out a graph second.
    pub out_hz: f32,
    /// What was dropped since it started, by cause.
    pub dropped: BTreeMap<String, u64>,
    /// Age of its newest data, milliseconds of graph time; none before any.
    pub age_ms: Option<f32>,
    /// Share of one core.
    pub cpu: f32,
    /// Resident memory, bytes.
    pub rss_bytes: u64,
}

mod state_as_text {
    use serde::{Deserialize, Deserializer, Serializer};
    use tsense_contract::ProcessState;

    pub(super) fn serialize<S: Serializer>(state: &ProcessState, out: S) -> Result<S::Ok, S::Error> {
        out.serialize_str(state.as_str())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<ProcessState, D::Error> {
        let text = String::deserialize(from)?;
        let known = ProcessState::ALL.iter().find(|state| state.as_str() == text);
        known.copied().ok_or_else(|| serde::de::Error::custom(format!("unknown state `{text}`")))
    }
}

#[allow(dead_code, reason = "`demo` uses what `run` does not")]
impl Status {
    /// The row of a process.
    pub fn process(&self, name: &str) -> Option<&ProcessRow> {
        self.processes.iter().find(|row| row.name == name)
    }

    /// Whether every process is up: running or degraded.
    pub fn is_up(&self) -> bool {
        let up = |row: &ProcessRow| matches!(row.state, ProcessState::Running | ProcessState::Degraded);
        !self.processes.is_empty() && self.processes.iter().all(up)
    }

    /// The table as the topic `processes` carries it.
    pub(super) fn message(&self, now: Timestamp) -> (ProcessesHeader, Vec<ProcessStatus>) {
        let header = ProcessesHeader { stamp_ns: now.ns, graph: Text::new(&self.graph) };
        (header, self.processes.iter().take(Processes::ITEMS_MAX).map(ProcessRow::message).collect())
    }
}

impl ProcessRow {
    fn message(&self) -> ProcessStatus {
        let mut drops = [DropCount { cause: Text::new(""), count: 0 }; DROP_CAUSES_MAX];
        for (slot, (cause, count)) in drops.iter_mut().zip(&self.dropped) {
            *slot = DropCount { cause: Text::new(cause), count: *count };
        }
        ProcessStatus {
            name: Text::new(&self.name),
            reason: Text::new(&self.reason),
            drops,
            restarts: self.restarts,
            in_hz: self.in_hz,
            out_hz: self.out_hz,
            age_ms: self.age_ms.unwrap_or(f32::NAN),
            cpu: self.cpu,
            rss_bytes: self.rss_bytes,
            pid: self.pid,
            state: self.state.to_wire(),
            reserved: [0; 3],
        }
    }
}

/// What the launcher knows of its processes.
pub(super) struct Table {
    rows: Vec<Known>,
}

struct Known {
    name: String,
    pid: u32,
    restarts: u64,
    started_s: f64,
    death: Option<String>,
    beat_s: f64,
    beats: VecDeque<Heartbeat>,
    usage: Usage,
}

impl Table {
    pub(super) fn new(names: &[String]) -> Self {
        Self { rows: names.iter().map(|name| Known::new(name)).collect() }
    }

    pub(super) fn started(&mut self, name: &str, pid: u32, restarts: u64) {
        if let Some(row) = self.row(name) {
            *row = Known { pid, restarts, started_s: machine_seconds(), death: None, ..Known::new(name) };
        }
    }

    pub(super) fn died(&mut self, name: &str, words: &str) {
        if let Some(row) = self.row(name) {
            *row = Known { death: Some(words.into()), restarts: row.restarts, ..Known::new(name) };
        }
    }

    pub(super) fn beat(&mut self, name: &str, beat: &Heartbeat) {
        if let Some(row) = self.row(name) {
            row.beat_s = machine_seconds();
            row.beats.push_back(*beat);
            if row.beats.len() > BEATS {
                row.beats.pop_front();
            }
        }
    }

    pub(super) fn measure(&mut self, now_s: f64) {
        for row in self.rows.iter_mut().filter(|row| row.pid != 0) {
            row.usage.measure(row.pid, now_s);
        }
    }

    pub(super) fn status(&self, graph: &str, now: Timestamp) -> Status {
        let now_s = machine_seconds();
        Status { graph: graph.into(), processes: self.rows.iter().map(|row| row.show(now, now_s)).collect() }
    }

    fn row(&mut self, name: &str) -> Option<&mut Known> {
        self.rows.iter_mut().find(|row| row.name == name)
    }
}

impl Known {
    fn new(name: &str) -> Self {
        Self {
            name: name.into(),
            pid: 0,
            restarts: 0,
            started_s: 0.0,
            death: None,
            beat_s: 0.0,
            beats: VecDeque::new(),
            usage: Usage::default(),
        }
    }

    fn show(&self, now: Timestamp, now_s: f64) -> ProcessRow {
        let (state, reason) = self.state(now_s);
        let newest = self.beats.back();
        let age = newest.filter(|b| b.newest_ns != 0).map(|b| now.seconds_since(Timestamp::from_ns(b.newest_ns)) * 1e3);
        let drops = newest.iter().flat_map(|b| b.drops.iter()).filter(|d| d.count > 0);
        ProcessRow {
            name: self.name.clone(),
            pid: self.pid,
            state,
            reason,
            restarts: self.restarts,
            in_hz: self.rate(|beat| beat.taken),
            out_hz: self.rate(|beat| beat.sent),
            dropped: drops.map(|d| (d.cause.to_text().into_owned(), d.count)).collect(),
            age_ms: age.map(|ms| ms as f32),
            cpu: self.usage.cpu,
            rss_bytes: self.usage.rss_bytes,
        }
    }

    /// The process's own word, unless it is dead or silent.
    fn state(&self, now_s: f64) -> (ProcessState, String) {
        if let Some(words) = &self.death {
            return (ProcessState::Failed, words.clone());
        }
        let Some(beat) = self.beats.back() else {
            let waited_s = now_s - self.started_s;
            let words = format!("no heartbeat since it was started {waited_s:.1} s ago");
            let state = if waited_s > STARTING_MAX_S { ProcessState::Stale } else { ProcessState::Starting };
            return (state, words);
        };
        let silent_s = now_s - self.beat_s;
        if silent_s > STALE_S {
            return (ProcessState::Stale, format!("no heartbeat for {silent_s:.1} s"));
        }
        (ProcessState::from_wire(beat.state), beat.reason.to_text().into_owned())
    }

    /// How fast a counter grows, per graph second.
    fn rate(&self, counter: impl Fn(&Heartbeat) -> u64) -> f32 {
        let (Some(first), Some(last)) = (self.beats.front(), self.beats.back()) else { return 0.0 };
        let seconds = Timestamp::from_ns(last.stamp_ns).seconds_since(Timestamp::from_ns(first.stamp_ns));
        if seconds <= 0.0 {
            return 0.0;
        }
        (counter(last).saturating_sub(counter(first)) as f64 / seconds) as f32
    }
}

#[cfg(test)]
mod tests;
