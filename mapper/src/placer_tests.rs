//! Placing by short spans against placing every beam with its own pose.

use crate::beams::{PlacedScan, beam_stamp};
use crate::config::PlacingConfig;
use crate::ladar_mount::LadarMount;
use crate::placer::Placer;
use crate::testing::{Random, long_scan_at, pose_at};
use tsense_contract::{Joint, Pose, Return};
use tsense_geometry::{Mounting, Point, Timestamp, beam_direction};

/// Figures of a vehicle and a head, drawn at random: how far and how fast they roll, pitch, yaw, pan, tilt and drive.
struct Ride {
    swings_rad: [f64; 5],
    rates_rad_s: [f64; 5],
    speed_m_s: f64,
    pose_hz: f64,
    joint_hz: f64,
}

impl Ride {
    fn random(random: &mut Random) -> Self {
        // From a quiet drive to a head that is slewed with 300 degrees a second on a vehicle that is shaken.
        let violence = random.unit().powi(2);
        Self {
            swings_rad: std::array::from_fn(|_| random.between(0.0, 1.0)),
            rates_rad_s: std::array::from_fn(|_| random.between(0.2, 1.0 + 9.0 * violence)),
            speed_m_s: random.between(0.0, 20.0),
            pose_hz: random.between(5.0, 200.0),
            joint_hz: random.between(10.0, 100.0),
        }
    }

    fn angle(&self, i: usize, s: f64) -> f64 {
        self.swings_rad[i] * (self.rates_rad_s[i] * s + i as f64).sin()
    }

    fn pose(&self, s: f64) -> Pose {
        Pose {
            roll_rad: self.angle(0, s),
            pitch_rad: self.angle(1, s),
            // Several turns: the shorter way between two samples counts.
            yaw_rad: 3.0 * self.angle(2, s) + s,
            ..pose_at(1000.0 + s, [500_000.0 + self.speed_m_s * s, 9.9e6, 100.0])
        }
    }

    fn joint(&self, s: f64) -> Joint {
        let stamp_ns = Timestamp::from_seconds(1000.0 + s).ns;
        Joint { stamp_ns, pan_rad: self.angle(3, s), tilt_rad: self.angle(4, s), ..bytemuck::Zeroable::zeroed() }
    }
}

fn mount() -> LadarMount {
    LadarMount {
        vehicle_from_base: Mounting { x_m: 1.6, z_m: -2.7, yaw_deg: 10.0, ..Mounting::default() },
        tilt_from_ladar: Mounting { x_m: 0.3, y_m: -0.2, z_m: -0.1, pitch_deg: 3.0, ..Mounting::default() },
        range_max_m: 200.0,
        no_return_range_m: 200.0,
        ..LadarMount::default()
    }
}

/// The largest distance between a beam's two ends as placed and as its own pose says, metres; and how many beams.
fn error_m(ride: &Ride) -> (f64, usize) {
    let mut placer = Placer::new(&PlacingConfig::default(), vec![mount()]);
    for i in 0..(0.3 * ride.pose_hz).ceil() as usize + 2 {
        assert!(placer.add_pose(&ride.pose(i as f64 / ride.pose_hz)));
    }
    for i in 0..(0.3 * ride.joint_hz).ceil() as usize + 2 {
        assert!(placer.add_joint(&ride.joint(i as f64 / ride.joint_hz)));
    }
    let (header, mut returns) = long_scan_at(1000.1);
    returns.iter_mut().for_each(|item| item.distance_mm = 199_999);
    assert!(placer.add_scan(0, &header, &returns, Timestamp::from_seconds(1000.2)));
    let mut scan = PlacedScan::default();
    assert!(placer.next_placed(Timestamp::from_seconds(1000.2), &mut scan));
    let extrinsics = mount().extrinsics();
    let mut worst_m = 0.0f64;
    for (i, beam) in scan.beams.iter().enumerate() {
        let here = placer.motion().global_from_ladar(&extrinsics, beam_stamp(&header, i)).unwrap();
        let end =
            here.origin() + (here * beam_direction(header.start_rad + header.step_rad * i as f64)).scaled(199.999);
        worst_m = worst_m.max((beam.origin - here.origin()).length()).max((beam.end - end).length());
        let base_m = scan.points_header.origin_m;
        let point = Point::new(base_m[0], base_m[1], base_m[2]);
        let sent = scan.points[i].xyz_m.map(f64::from);
        // Relative to their origin, f32 keeps 200 m to 0.008 mm.
        assert!((0..3).all(|axis| ((beam.end - point).xyz[axis] - sent[axis]).abs() < 1e-5));
    }
    (worst_m, scan.beams.len())
}

#[test]
fn no_beam_errs_by_a_tenth_of_a_millimetre_at_200_m_however_wild_the_ride() {
    let (mut random, mut beams, mut worst_m) = (Random(2), 0, 0.0f64);
    for _ in 0..200 {
        let (error_m, placed) = error_m(&Ride::random(&mut random));
        (beams, worst_m) = (beams + placed, worst_m.max(error_m));
    }
    eprintln!("{beams} beams, the worst errs by {:.1} um", worst_m * 1e6);
    assert_eq!(beams, 200 * 1081);
    assert!(worst_m < 1e-4, "{worst_m} m");
    assert!(worst_m > 1e-6, "{worst_m} m: nothing was interpolated");
}

#[test]
fn a_scan_after_a_longer_one_has_its_own_beams_only() {
    let mut placer = Placer::new(&PlacingConfig::default(), vec![LadarMount { on_pan_tilt: false, ..mount() }]);
    for i in 0..10 {
        placer.add_pose(&pose_at(1000.0 + f64::from(i) * 0.1, [0.0; 3]));
    }
    let mut scan = PlacedScan::default();
    for (i, beams) in [1081, 3, 541].into_iter().enumerate() {
        let (header, returns) = long_scan_at(1000.1 + i as f64 * 0.1);
        let now = Timestamp::from_seconds(1000.5);
        // The second scan has other angles.
        let header = tsense_contract::ScanHeader { start_rad: i as f64 * 0.5, ..header };
        assert!(placer.add_scan(0, &header, &returns[..beams], now));
        assert!(placer.next_placed(now, &mut scan));
        assert_eq!((scan.beams.len(), scan.points.len()), (beams, beams));
        let ahead = scan.points.iter().zip(&returns[..beams]).map(|(point, Return { distance_mm, .. })| {
            let [x, y, z] = std::array::from_fn(|axis| f64::from(point.xyz_m[axis] - scan.points_header.ladar_m[axis]));
            ((x * x + y * y + z * z).sqrt() - f64::from(*distance_mm) / 1e3).abs()
        });
        assert!(ahead.fold(0.0, f64::max) < 1e-4);
    }
}
