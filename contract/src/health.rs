//! Topics `heartbeat` and `processes`: how each process is, by itself and as the launcher sees it.

use crate::message::{Text, message, wire_enum};
use crate::none::Nothing;
use crate::topic::{Qos, Topic};

wire_enum! {
    /// How a process is.
    ProcessState, unknown = Failed {
        /// Coming up: connecting, opening, waiting for its first data.
        Starting = 0 "starting",
        /// Doing all of its work.
        Running = 1 "running",
        /// Doing part of its work; the reason says which part is missing.
        Degraded = 2 "degraded",
        /// Its data is old; the reason says since when.
        Stale = 3 "stale",
        /// Not running, or cannot work.
        Failed = 4 "failed",
    }
}

/// Kinds of drops a process counts apart.
pub const DROP_CAUSES_MAX: usize = 8;

message! {
    /// A count of things dropped for one cause.
    DropCount = "tsense.drop_count.v1" {
        /// The cause in a few words; empty where unused.
        cause: Text<32>,
        /// How many since the process started.
        count: u64,
    }
}

message! {
    /// What a process says of itself, several times a second.
    Heartbeat = "tsense.heartbeat.v1" {
        /// Instant of this heartbeat, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// Stamp of the newest data it put out; 0 before any.
        newest_ns: i64,
        /// Samples taken in since it started.
        taken: u64,
        /// Samples put out since it started.
        sent: u64,
        /// Name of the process, unique in the graph.
        name: Text<32>,
        /// The state's reason in words.
        reason: Text<128>,
        /// Drops by cause since it started.
        drops: [DropCount; 8],
        /// Process id.
        pid: u32,
        /// A [`ProcessState`].
        state: u8,
        /// Zero.
        reserved: [u8; 3],
    }
}

/// The topic `heartbeat`: every process writes, the launcher reads.
pub struct Heartbeats;

impl Topic for Heartbeats {
    type Header = Heartbeat;
    type Item = Nothing;
    const NAME: &'static str = "heartbeat";
    const QOS: Qos = Qos { publishers: 24, subscribers: 4, history: 1, buffer: 64, borrow: 4, loans: 2, event: false };
    const ITEMS_MAX: usize = 1;
}

message! {
    /// One process as the launcher sees it.
    ProcessStatus = "tsense.process.v1" {
        /// Name of the process.
        name: Text<32>,
        /// The state's reason in words.
        reason: Text<128>,
        /// Drops by cause since it started.
        drops: [DropCount; 8],
        /// Restarts since the graph started.
        restarts: u64,
        /// Samples in a second.
        in_hz: f32,
        /// Samples out a second.
        out_hz: f32,
        /// Age of its newest data, milliseconds; NaN before any.
        age_ms: f32,
        /// Share of one core, 0 to 1 and above for several threads.
        cpu: f32,
        /// Resident memory, bytes.
        rss_bytes: u64,
        /// Process id, 0 where not running.
        pid: u32,
        /// A [`ProcessState`].
        state: u8,
        /// Zero.
        reserved: [u8; 3],
    }
}

message! {
    /// Header of the launcher's process table.
    ProcessesHeader = "tsense.processes.v1" {
        /// Instant of this table, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// Name of the graph.
        graph: Text<32>,
    }
}

/// The topic `processes`: the launcher writes, the bridge reads.
pub struct Processes;

impl Topic for Processes {
    type Header = ProcessesHeader;
    type Item = ProcessStatus;
    const NAME: &'static str = "processes";
    const QOS: Qos = Qos { publishers: 1, subscribers: 4, history: 1, buffer: 4, borrow: 2, loans: 2, event: false };
    const ITEMS_MAX: usize = 24;
}
