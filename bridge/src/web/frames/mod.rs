//! Frames of the viewer's WebSocket: small binary messages that carry state, never history.
//!
//! In: values in the system's own units and frames. Out: bytes, little-endian. Each frame is a header of
//! [`HEADER_BYTES`] and a payload; coordinates in payloads are `f32` metres east, north, up of the header's origin,
//! which is `f64` UTM: a browser never sees a world coordinate in single precision. The protocol is written out in
//! `docs/viewer-protocol.md`; the viewer's side of it is `viewer/protocol.js`. No frame depends on an earlier one.

mod grid;
mod map;
mod objects;
mod points;
mod processes;
mod vehicle;

pub use grid::grid_frame;
pub use map::{block_frame, commit_frame};
pub use objects::{detections_frame, objects_frame};
pub use points::points_frame;
pub use processes::processes_frame;
pub use vehicle::vehicle_frame;

/// An encoded frame: reference-counted bytes, so that any number of clients share one copy.
pub type Frame = axum::body::Bytes;

/// Version of the protocol; a viewer refuses another one and asks to be reloaded.
pub const PROTOCOL_VERSION: u8 = 2;
/// Bytes of a header: a multiple of 8, so that payloads of `f64` stay aligned in the browser.
pub const HEADER_BYTES: usize = 40;
/// Largest payload that is ever sent: the largest grid (672 x 672 cells of 7 bytes) and some room.
pub const PAYLOAD_MAX: usize = 4 << 20;

/// What a frame carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Kind {
    /// Names and sizes that do not change while the bridge runs (JSON).
    Hello = 0,
    /// The visible voxels of one block.
    Block = 1,
    /// End of a snapshot: which blocks make up the map. Blocks that are not listed are gone.
    Commit = 2,
    /// The newest scan of one ladar.
    Points = 3,
    /// The Smart Sensor Grid.
    Grid = 4,
    /// What the knowledge store reports.
    Objects = 5,
    /// The vehicle and its head.
    Vehicle = 6,
    /// Every process with its state (JSON).
    Processes = 7,
    /// Rates, ages and drops as the bridge sees them (JSON).
    Counters = 8,
    /// What the newest snapshot alone showed.
    Detections = 9,
}

impl Kind {
    /// All kinds, in the order of their bytes.
    pub const ALL: [Self; 10] = [
        Self::Hello,
        Self::Block,
        Self::Commit,
        Self::Points,
        Self::Grid,
        Self::Objects,
        Self::Vehicle,
        Self::Processes,
        Self::Counters,
        Self::Detections,
    ];

    /// The layer a client subscribes to for frames of this kind.
    pub fn layer(self) -> &'static str {
        match self {
            Self::Hello => "hello",
            Self::Block | Self::Commit => "map",
            Self::Points => "points",
            Self::Grid => "grid",
            Self::Objects => "objects",
            Self::Vehicle => "vehicle",
            Self::Processes => "processes",
            Self::Counters => "counters",
            Self::Detections => "detections",
        }
    }
}

/// The start of every frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    /// What the payload is.
    pub kind: Kind,
    /// UTM zone of the origin, 0 where the frame has no place.
    pub zone: u8,
    /// 0 north, 1 south.
    pub south: u8,
    /// Instant of the data, nanoseconds since the epoch, graph clock.
    pub stamp_ns: i64,
    /// UTM easting, northing, ellipsoidal height that coordinates in the payload are relative to, metres.
    pub origin_m: [f64; 3],
}

impl Header {
    /// A header of a frame that has no place on Earth.
    pub fn placeless(kind: Kind, stamp_ns: i64) -> Self {
        Self { kind, zone: 0, south: 0, stamp_ns, origin_m: [0.0; 3] }
    }

    /// Coordinates relative to the origin, as they travel.
    pub(super) fn relative(&self, xyz_m: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| (xyz_m[axis] - self.origin_m[axis]) as f32)
    }
}

/// Why bytes are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Fewer bytes than a header.
    #[error("{0} bytes are no frame: a header alone has 40")]
    Short(usize),
    /// A kind this version does not know.
    #[error("frame kind {0} is unknown")]
    Kind(u8),
    /// Another protocol version.
    #[error("protocol version {0}, this side speaks 1: reload the page")]
    Version(u8),
    /// The header's length is not that of the payload.
    #[error("the header says {said} payload bytes, {found} are there")]
    Length {
        /// From the header.
        said: usize,
        /// What follows the header.
        found: usize,
    },
}

/// Splits a frame into its header and its payload.
pub fn parse(bytes: &[u8]) -> Result<(Header, &[u8]), FrameError> {
    let (head, payload) = bytes.split_at_checked(HEADER_BYTES).ok_or(FrameError::Short(bytes.len()))?;
    let kind = *Kind::ALL.get(usize::from(head[0])).ok_or(FrameError::Kind(head[0]))?;
    if head[1] != PROTOCOL_VERSION {
        return Err(FrameError::Version(head[1]));
    }
    let said = u32::from_le_bytes(bytes_at(head, 4)) as usize;
    if said != payload.len() {
        return Err(FrameError::Length { said, found: payload.len() });
    }
    let stamp_ns = i64::from_le_bytes(bytes_at(head, 8));
    let origin_m = std::array::from_fn(|axis| f64::from_le_bytes(bytes_at(head, 16 + 8 * axis)));
    Ok((Header { kind, zone: head[2], south: head[3], stamp_ns, origin_m }, payload))
}

fn bytes_at<const N: usize>(head: &[u8], at: usize) -> [u8; N] {
    std::array::from_fn(|i| head[at + i])
}

/// A frame whose payload is JSON text.
pub fn json_frame(kind: Kind, stamp_ns: i64, value: &serde_json::Value) -> Frame {
    let mut writer = Writer::new(&Header::placeless(kind, stamp_ns), 1024);
    writer.bytes(value.to_string().as_bytes());
    writer.finish()
}

/// Appends little-endian values behind a header.
struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    fn new(header: &Header, payload_bytes: usize) -> Self {
        let mut bytes = Vec::with_capacity(HEADER_BYTES + payload_bytes);
        bytes.extend([header.kind as u8, PROTOCOL_VERSION, header.zone, header.south]);
        bytes.extend([0; 4]);
        bytes.extend(header.stamp_ns.to_le_bytes());
        header.origin_m.iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        Self { bytes }
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    fn i32s(&mut self, values: &[i32]) {
        values.iter().for_each(|v| self.bytes(&v.to_le_bytes()));
    }

    fn f32s(&mut self, values: &[f32]) {
        values.iter().for_each(|v| self.bytes(&v.to_le_bytes()));
    }

    /// Fills in the length.
    fn finish(mut self) -> Frame {
        let length = (self.bytes.len() - HEADER_BYTES) as u32;
        self.bytes[4..8].copy_from_slice(&length.to_le_bytes());
        Frame::from(self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn a_header_lies_in_its_bytes_as_the_document_says() {
        let header = Header { kind: Kind::Grid, zone: 17, south: 1, stamp_ns: 0x0102, origin_m: [1.0, -2.0, 0.5] };
        let mut writer = Writer::new(&header, 0);
        writer.u32(7);
        let frame = writer.finish();
        assert_eq!(frame[..8], [4, PROTOCOL_VERSION, 17, 1, 4, 0, 0, 0]);
        assert_eq!(frame[8..16], [2, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(frame[16..24], 1.0f64.to_le_bytes());
        assert_eq!(frame[32..40], 0.5f64.to_le_bytes());
        assert_eq!(frame[40..], [7, 0, 0, 0]);
    }

    #[test]
    fn what_is_no_frame_is_refused_with_what_was_seen() {
        assert_eq!(parse(&[0; 39]), Err(FrameError::Short(39)));
        let good = json_frame(Kind::Hello, 0, &serde_json::json!({"a": 1})).to_vec();
        let change = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            parse(&bytes).map(|_| ())
        };
        assert_eq!(change(0, 10), Err(FrameError::Kind(10)));
        assert_eq!(change(1, 9), Err(FrameError::Version(9)));
        assert_eq!(change(4, 9), Err(FrameError::Length { said: 9, found: 7 }));
        assert_eq!(parse(&good).unwrap().1, br#"{"a":1}"#);
    }

    #[test]
    fn kinds_are_their_own_index() {
        for (byte, kind) in Kind::ALL.iter().enumerate() {
            assert_eq!(*kind as usize, byte);
        }
    }

    #[test]
    fn every_header_survives_and_no_bytes_panic() {
        let cases = AtomicUsize::new(0);
        proptest!(|(
            kind in 0usize..10, zone: u8, south in 0u8..2, stamp_ns: i64,
            origin_m in prop::array::uniform3(-2e7..2e7f64), noise in prop::collection::vec(any::<u8>(), 0..80),
        )| {
            cases.fetch_add(1, Ordering::Relaxed);
            let header = Header { kind: Kind::ALL[kind], zone, south, stamp_ns, origin_m };
            let mut writer = Writer::new(&header, 0);
            writer.bytes(&noise);
            let frame = writer.finish();
            prop_assert_eq!(parse(&frame), Ok((header, &noise[..])));
            let _ = parse(&noise);
        });
        assert!(cases.load(Ordering::Relaxed) >= 256);
    }
}
