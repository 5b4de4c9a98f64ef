//! A ladar that nods over open ground with a few trunks, as messages: what the mapper's process would be sent.
//!
//! LMS-151 at 50 Hz: 541 beams of half a degree, 1.8 m above flat ground, a nod of 20 degrees a second from -40 to +20
//! degrees, poses at 100 Hz and readings of the head at 40 Hz. It is no simulator: flat ground and cylinders.
#![allow(dead_code, reason = "each test binary uses a part")]

use bytemuck::Zeroable;
use tsense_contract::{Brick, Joint, Map, Pose, PoseQuality, Return, ReturnKind, ScanHeader, Topic};
use tsense_geometry::{Mounting, Timestamp};
use tsense_mapper::{Config, LadarMount, Mapper};

pub const SCAN_S: f64 = 0.02;
pub const BEAMS: usize = 541;
const BEAM_S: f64 = SCAN_S / 720.0;
const HEIGHT_M: f64 = 1.8;
const NOD_RAD_S: f64 = 20.0 * std::f64::consts::PI / 180.0;
const TILTS_RAD: [f64; 2] = [-40.0 * std::f64::consts::PI / 180.0, 20.0 * std::f64::consts::PI / 180.0];
/// East, north, radius, metres from the start.
const TRUNKS_M: [[f64; 3]; 6] =
    [[2.0, 5.0, 0.2], [-3.0, 7.0, 0.3], [5.0, 9.0, 0.15], [-6.0, 4.0, 0.25], [0.5, 11.0, 0.4], [8.0, 3.0, 0.2]];
/// A corner of blocks: a working space of 2 x 2 x 2 blocks around it is held in exactly 8.
pub const AT_M: [f64; 3] = [500_010.0, 5_412_000.0, 210.0];

/// What the messages of a ride have reached.
pub struct Ride {
    pub mapper: Mapper,
    speed_m_s: f64,
    scans: u32,
    poses: u32,
    joints: u32,
    returns: Vec<Return>,
}

impl Ride {
    /// A mapper in its first second; the working space of the default configuration lies in 8 blocks.
    pub fn new(speed_m_s: f64) -> Self {
        let mount = LadarMount {
            tilt_from_ladar: Mounting { x_m: 0.05, z_m: -0.1, ..Mounting::default() },
            ..LadarMount::default()
        };
        let config = Config { center_up_m: 0.0, ..Config::default() };
        let mapper = Mapper::new(&config, vec![mount], 1).unwrap();
        Self { mapper, speed_m_s, scans: 0, poses: 0, joints: 0, returns: Vec::new() }
    }

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(1000.0 + s)
    }

    fn sweep_s() -> f64 {
        (TILTS_RAD[1] - TILTS_RAD[0]) / NOD_RAD_S
    }

    fn tilt_rad(s: f64) -> f64 {
        let phase = (s / Self::sweep_s()).rem_euclid(2.0);
        TILTS_RAD[0] + phase.min(2.0 - phase) * (TILTS_RAD[1] - TILTS_RAD[0])
    }

    fn pose(&self, s: f64) -> Pose {
        Pose {
            stamp_ns: Self::at(s).ns,
            easting_m: AT_M[0],
            northing_m: AT_M[1] + self.speed_m_s * s,
            altitude_m: AT_M[2],
            velocity_m_s: [0.0, self.speed_m_s as f32, 0.0],
            zone: 32,
            quality: PoseQuality::RtkFixed.to_wire(),
            ..Pose::zeroed()
        }
    }

    /// Metres to the ground or a trunk, and what kind of return that is.
    fn range(&self, s: f64, angle_rad: f64) -> Return {
        // x right, y ahead in the scan plane, which is turned up by the tilt; the vehicle faces north.
        let (right, ahead) = (angle_rad.cos(), angle_rad.sin());
        let (sin, cos) = Self::tilt_rad(s).sin_cos();
        let way = [right, ahead * cos, ahead * sin];
        let mut range_m = if way[2] < 0.0 { -HEIGHT_M / way[2] } else { f64::INFINITY };
        for [east, north, radius] in TRUNKS_M {
            let (x, y) = (-east, self.speed_m_s * s - north);
            let (a, b) = (way[0].hypot(way[1]).powi(2), x * way[0] + y * way[1]);
            let root = b * b - a * (x * x + y * y - radius * radius);
            if root > 0.0 && b < 0.0 {
                range_m = range_m.min((-b - root.sqrt()) / a);
            }
        }
        let kind = if range_m < 50.0 { ReturnKind::Echo } else { ReturnKind::NoReturn };
        Return { distance_mm: (range_m.min(50.0) * 1e3) as u32, remission: 0, kind: kind.to_wire(), code: 0 }
    }

    /// Makes the messages of the next scan; gives them to the mapper with what covers them.
    pub fn next_scan(&mut self) -> Timestamp {
        let s = f64::from(self.scans) * SCAN_S;
        self.scans += 1;
        let header = ScanHeader {
            stamp_ns: Self::at(s).ns,
            beam_interval_ns: BEAM_S * 1e9,
            start_rad: -std::f64::consts::FRAC_PI_4,
            step_rad: 0.5f64.to_radians(),
            ..ScanHeader::zeroed()
        };
        let mut returns = std::mem::take(&mut self.returns);
        returns.clear();
        returns.extend(
            (0..BEAMS).map(|i| self.range(s + i as f64 * BEAM_S, header.start_rad + header.step_rad * i as f64)),
        );
        self.cover(s + SCAN_S);
        let now = Self::at(s + SCAN_S);
        assert!(self.mapper.add_scan(0, &header, &returns, now));
        self.returns = returns;
        now
    }

    /// Poses and readings up to the first that is not before `s`.
    fn cover(&mut self, s: f64) {
        while self.poses == 0 || f64::from(self.poses - 1) * 0.01 < s {
            assert!(self.mapper.add_pose(&self.pose(f64::from(self.poses) * 0.01)));
            self.poses += 1;
        }
        while self.joints == 0 || f64::from(self.joints - 1) * 0.025 < s {
            let s = f64::from(self.joints) * 0.025;
            let (stamp_ns, sweep) = (Self::at(s).ns, (s / Self::sweep_s()) as u32);
            let joint = Joint { stamp_ns, tilt_rad: Self::tilt_rad(s), sweep, ..Joint::zeroed() };
            assert!(self.mapper.add_joint(&joint));
            self.joints += 1;
        }
    }

    /// Places and traces what waits; the number of beams.
    pub fn trace(&mut self, now: Timestamp) -> usize {
        let mut beams = 0;
        while let Some(scan) = self.mapper.trace_next(now) {
            beams += scan.points.len();
        }
        beams
    }
}

/// Memory for the samples of one snapshot, used again for the next.
pub struct Room(Vec<Brick>);

impl Room {
    pub fn new() -> Self {
        Self(vec![Brick::UNKNOWN; Map::ITEMS_MAX])
    }

    /// Takes a snapshot and writes its samples one over the other: how many samples and items.
    pub fn publish(&mut self, mapper: &mut Mapper, keyframe: bool, now: Timestamp) -> (u64, usize) {
        let context = mapper.take_snapshot(keyframe, now).expect("a scan was traced");
        let mut items = 0;
        let sent = mapper.snapshot().publish(&context, mapper.map(), |_, len, fill| {
            items += len;
            fill(&mut self.0[..len]);
            Ok::<(), ()>(())
        });
        (sent.unwrap(), items)
    }
}
