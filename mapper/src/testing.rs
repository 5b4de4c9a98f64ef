//! Small messages for the tests of this crate.

use bytemuck::Zeroable;
use tsense_contract::{
    Joint, Pose, PoseQuality, Return, ReturnKind, ScanHeader, SensedVoxel, VoxelState, VoxelsHeader, VoxelsKind,
};
use tsense_geometry::Timestamp;

/// A level vehicle facing north, in zone 32 north.
pub fn pose_at(seconds: f64, [easting_m, northing_m, altitude_m]: [f64; 3]) -> Pose {
    Pose {
        stamp_ns: Timestamp::from_seconds(seconds).ns,
        easting_m,
        northing_m,
        altitude_m,
        zone: 32,
        quality: PoseQuality::RtkFixed.to_wire(),
        ..Pose::zeroed()
    }
}

/// A head at rest.
pub fn joint_at(seconds: f64, tilt_rad: f64, sweep: u32) -> Joint {
    Joint { stamp_ns: Timestamp::from_seconds(seconds).ns, tilt_rad, sweep, ..Joint::zeroed() }
}

/// Three echoes at 3 m: right, ahead, left, 0.1 ms apart.
pub fn scan_at(seconds: f64) -> (ScanHeader, Vec<Return>) {
    let header = ScanHeader {
        stamp_ns: Timestamp::from_seconds(seconds).ns,
        beam_interval_ns: 1e5,
        step_rad: std::f64::consts::FRAC_PI_2,
        ..ScanHeader::zeroed()
    };
    (header, vec![Return { distance_mm: 3000, remission: 0, kind: ReturnKind::Echo.to_wire(), code: 0 }; 3])
}

/// One voxel of 0.15 m, measured at a place of zone 32 north.
pub fn voxel_at(seconds: f64, origin_m: [f64; 3], state: VoxelState) -> (VoxelsHeader, Vec<SensedVoxel>) {
    let header = VoxelsHeader {
        stamp_ns: Timestamp::from_seconds(seconds).ns,
        origin_m,
        voxel_size_m: 0.15,
        zone: 32,
        kind: VoxelsKind::Measured.to_wire(),
        ..VoxelsHeader::zeroed()
    };
    (header, vec![SensedVoxel::new([0.0; 3], state)])
}

/// A whole scan of an LMS-151: 1081 echoes at 3 to 18 m.
pub fn long_scan_at(seconds: f64) -> (ScanHeader, Vec<Return>) {
    let (header, returns) = scan_at(seconds);
    let header = ScanHeader {
        beam_interval_ns: 4e7 / 1440.0,
        start_rad: -std::f64::consts::FRAC_PI_4,
        step_rad: 0.25f64.to_radians(),
        ..header
    };
    (header, (0..1081).map(|i| Return { distance_mm: 3000 + i * 7919 % 15_000, ..returns[0] }).collect())
}

/// A small generator of our own: the same numbers on every machine and for ever (splitmix64).
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    /// Gaussian with a standard deviation of 1 (Box and Muller).
    pub fn gauss(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }
}

/// Segments in voxel units, inside a cube of 100: by turns random, axis-parallel, between grid corners, diagonal
/// through edges and corners, of no length, along faces, and a hair off a diagonal.
pub fn segments(count: usize) -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
    let mut random = Random(2026);
    (0..count).map(move |i| segment(&mut random, i % 8))
}

fn segment(random: &mut Random, kind: usize) -> ([f64; 3], [f64; 3]) {
    let mut point = || std::array::from_fn(|_| random.between(0.0, 100.0));
    let (start, mut end): ([f64; 3], [f64; 3]) = (point(), point());
    let whole = |p: [f64; 3]| p.map(f64::floor);
    let diagonal = |start: [f64; 3], end: [f64; 3]| {
        let reach = (end[0] - start[0]).min(99.0 - start[1].max(start[2])).max(-start[1].min(start[2]));
        [start[0] + reach.min(99.0 - start[0]).max(-start[0]), start[1] + reach, start[2] + reach]
    };
    match kind {
        0..=2 => (start, end),
        3 => {
            let keep = random.bits() as usize % 3;
            end = std::array::from_fn(|axis| if axis == keep { end[axis] } else { start[axis] });
            (start, end)
        }
        4 => (whole(start), whole(end)),
        5 => (whole(start), diagonal(whole(start), whole(end))),
        6 => {
            let flat = random.bits() as usize % 3;
            let mut face = start;
            face[flat] = face[flat].floor();
            end[flat] = face[flat];
            (face, if random.bits() & 1 == 0 { end } else { face })
        }
        _ => {
            let near = diagonal(start, end);
            (start, near.map(|c| (c + random.between(-1e-9, 1e-9)).max(0.0)))
        }
    }
}
