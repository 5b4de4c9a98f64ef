//! Topic `voxels`, one instance per sensor: what a sensor that is no ladar knows, as voxels of its own.
//!
//! A stereo camera, a radar or a saved map says which places are occupied or free. It need not know the map's grid: each item
//! is the middle of a cube in the map's coordinates, all cubes of a sample have the same edge, and the mapper finds the voxels
//! of its own that are meant. How much a sensor counts is the mapper's configuration, not the sensor's word.

use crate::message::{message, wire_enum};
use crate::topic::{Qos, Topic};

wire_enum! {
    /// What is known of a voxel.
    VoxelState, unknown = Unknown {
        /// Never measured, or faded.
        Unknown = 0 "unknown",
        /// Beams pass.
        Free = 1 "free",
        /// Beams end here.
        Occupied = 2 "occupied",
    }
}

wire_enum! {
    /// How voxels came to be known. Whoever says something else is not believed to have just measured.
    VoxelsKind, unknown = Prior {
        /// Measured at the header's instant: evidence, once a window.
        Measured = 0 "measured",
        /// Known from earlier, such as a saved map: it fills what the map does not know, and changes nothing else.
        Prior = 1 "prior",
    }
}

message! {
    /// Header of a sample of voxels. A measurement of more voxels than a sample holds is several samples with one stamp.
    VoxelsHeader = "tsense.voxels.v1" {
        /// Instant of the measurement, nanoseconds since the epoch, graph clock. Of a prior: of sending.
        stamp_ns: i64,
        /// Counts samples of this sender by one; a gap shows what was overtaken in the queue.
        sequence: u64,
        /// Easting, northing, ellipsoidal height that the items are relative to, metres: near them, whole metres do.
        origin_m: [f64; 3],
        /// Edge of the sender's voxels, metres.
        voxel_size_m: f64,
        /// UTM zone, 1 to 60: that of the poses by which the sender placed its voxels.
        zone: u8,
        /// 0 north, 1 south.
        south: u8,
        /// A [`VoxelsKind`].
        kind: u8,
        /// Zero.
        reserved: [u8; 5],
    }
}

impl VoxelsHeader {
    /// The kind, parsed.
    pub fn kind(&self) -> VoxelsKind {
        VoxelsKind::from_wire(self.kind)
    }
}

message! {
    /// One voxel of a sensor.
    SensedVoxel = "tsense.sensed_voxel.v1" {
        /// Its middle relative to the header's origin: east, north, up, metres.
        xyz_m: [f32; 3],
        /// A [`VoxelState`].
        state: u8,
        /// Zero.
        reserved: [u8; 3],
    }
}

impl SensedVoxel {
    /// A voxel in a state.
    pub fn new(xyz_m: [f32; 3], state: VoxelState) -> Self {
        Self { xyz_m, state: state.to_wire(), reserved: [0; 3] }
    }
}

/// The topic `voxels/<sensor name>`.
pub struct Voxels;

impl Topic for Voxels {
    type Header = VoxelsHeader;
    type Item = SensedVoxel;
    const NAME: &'static str = "voxels";
    /// The mapper looks ten times a second and copies; the others look on. 13 MB a sensor at most.
    const QOS: Qos = Qos { publishers: 1, subscribers: 3, history: 0, buffer: 8, borrow: 2, loans: 2, event: false };
    /// 1 MB: 220 m^3 of voxels of 0.15 m, where all of it is known.
    const ITEMS_MAX: usize = 1 << 16;
}
