//! Topic `scan`, one instance per ladar: one mirror turn as the device measured it.

use crate::message::{message, wire_enum};
use crate::topic::{Qos, Topic};

wire_enum! {
    /// What came back of a beam.
    ReturnKind, unknown = Reserved {
        /// An echo at a distance.
        Echo = 0 "echo",
        /// No echo within range.
        NoReturn = 1 "no return",
        /// The receiver was dazzled.
        Dazzled = 2 "dazzled",
        /// Something came back, too weak or at an edge: no distance.
        TooWeak = 3 "too weak",
        /// A code the maker keeps for itself.
        Reserved = 4 "reserved",
    }
}

message! {
    /// One beam's measurement.
    Return = "tsense.return.v1" {
        /// Distance along the beam, millimetres, scaled; 0 unless `kind` is an echo.
        distance_mm: u32,
        /// Echo strength as the device sent it (8 or 16 bit), 0 where it sent none.
        remission: u16,
        /// A [`ReturnKind`].
        kind: u8,
        /// The device's own value where it is a code below 16, else 0.
        code: u8,
    }
}

impl Return {
    /// The kind, parsed.
    pub fn kind(&self) -> ReturnKind {
        ReturnKind::from_wire(self.kind)
    }
}

message! {
    /// When and where a scan was taken.
    ScanHeader = "tsense.scan.v1" {
        /// Instant of the first beam, nanoseconds since the epoch, graph clock.
        stamp_ns: i64,
        /// One sigma of that instant, nanoseconds (clock fit residual).
        stamp_std_ns: i64,
        /// Time from a beam to the next, nanoseconds, from the measured rotation.
        beam_interval_ns: f64,
        /// Device angle of the first beam, radians: counter-clockwise from above, 0 right, pi/2 ahead.
        start_rad: f64,
        /// Device angle from a beam to the next, radians.
        step_rad: f64,
        /// Counts scans of this driver process, from 0.
        sequence: u64,
        /// The device's telegram counter.
        telegram_counter: u16,
        /// The device's mirror-turn counter.
        scan_counter: u16,
        /// The device's two status bytes; 0, 0 is good.
        device_status: [u8; 2],
        /// Contamination: 0 none, 1 warning, 2 error, 3 fatal, 255 unknown.
        contamination: u8,
        /// 1 where each return carries a remission.
        has_remission: u8,
        /// Zero.
        reserved: [u8; 8],
    }
}

/// The topic `scan/<ladar name>`.
pub struct Scan;

impl Topic for Scan {
    type Header = ScanHeader;
    type Item = Return;
    const NAME: &'static str = "scan";
    const QOS: Qos = Qos { publishers: 1, subscribers: 8, history: 0, buffer: 16, borrow: 4, loans: 2, event: true };
    /// 270 degrees at 0.25 degrees, both ends included.
    const ITEMS_MAX: usize = 1081;
}
