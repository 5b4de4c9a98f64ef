//! From bytes to poses: whole streams through the receiver, in simulated time.

use super::config::{Config, Format};
use super::frame::tests::sentence;
use super::receiver::{Event, Receiver};
use proptest::prelude::*;
use tsense_contract::{POSE_JUMPED, Pose, PoseQuality, ProcessState};
use tsense_geometry::Timestamp;

/// The graph's clock is this far from UTC in these tests, seconds.
const OFFSET_S: f64 = 3.25;
const DAY_S: f64 = 86_400.0;

struct Bench {
    receiver: Receiver,
    poses: Vec<Pose>,
    events: Vec<Event>,
}

impl Bench {
    fn new(config: &Config) -> Self {
        let mut receiver = Receiver::new(config);
        receiver.opened();
        Self { receiver, poses: vec![], events: vec![] }
    }

    /// UTC seconds since the epoch that bytes arrive at, on the graph's clock.
    fn send(&mut self, utc_s: f64, bytes: &[u8]) {
        let now = Timestamp::from_seconds(utc_s + OFFSET_S);
        self.receiver.receive(now, bytes);
        self.receiver.tick(now.plus_seconds(0.05));
        while let Some(event) = self.receiver.event() {
            if let Event::Pose(pose) = event {
                self.poses.push(pose);
            }
            self.events.push(event);
        }
    }

    fn dropped(&self, cause: &str) -> u64 {
        let count = |event: &Event| if let Event::Dropped(c, n) = event { u64::from(*c == cause) * n } else { 0 };
        self.events.iter().map(count).sum()
    }
}

fn hhmmss(utc_s: f64) -> String {
    let s = utc_s.rem_euclid(DAY_S);
    format!("{:02}{:02}{:05.2}", (s / 3600.0) as u32, (s / 60.0) as u32 % 60, s % 60.0)
}

fn burst(time: &str, longitude_minutes: f64) -> String {
    sentence(&format!("GNGGA,{time},3000.0000,N,082{longitude_minutes:09.6},W,4,17,0.7,42.0,M,-28.5,M,1.0,0001"))
        + &sentence(&format!("PASHR,{time},90.00,T,1.0,-2.0,0.0,0.01,0.01,0.05,2,1"))
        + &sentence("GNVTG,90.0,T,,M,,N,18.0,K,D")
}

const START_S: f64 = 1_795_314_400.0;

#[test]
fn poses_are_stamped_with_their_own_instant_whatever_their_way_took() {
    let mut bench = Bench::new(&Config::default());
    for i in 0..200 {
        let utc_s = START_S + f64::from(i) * 0.1;
        let delay_s = if i % 5 == 0 { 0.002 } else { 0.002 + f64::from(i % 7) * 0.01 };
        bench.send(utc_s + delay_s, burst(&hhmmss(utc_s), 21.0 - f64::from(i) * 0.0003).as_bytes());
    }
    assert_eq!(bench.poses.len(), 200);
    for (i, pose) in bench.poses.iter().enumerate() {
        let late_s = pose.stamp_ns as f64 / 1e9 - (START_S + i as f64 * 0.1 + OFFSET_S);
        assert!((late_s - 0.002).abs() < 2e-6, "{late_s} s late, not the least delay of 2 ms");
    }
    let pose = bench.poses[100];
    assert_eq!((pose.zone, pose.south, pose.quality(), pose.flags), (17, 0, PoseQuality::RtkFixed, 0));
    assert!((pose.altitude_m - 13.5).abs() < 1e-9);
    // West of the central meridian in the north: convergence is negative, grid yaw beyond true heading.
    assert!(pose.convergence_rad < 0.0 && pose.yaw_rad > 90_f64.to_radians());
    assert!((f64::from(pose.velocity_m_s[0].hypot(pose.velocity_m_s[1])) - 5.0).abs() < 0.01);
    let (state, reason) = bench.receiver.condition(Timestamp::from_seconds(START_S + 19.95 + OFFSET_S));
    assert_eq!((state, reason.as_str()), (ProcessState::Running, "rtk fixed, zone 17N"));
    let later = Timestamp::from_seconds(START_S + 25.0 + OFFSET_S);
    assert_eq!(bench.receiver.condition(later).0, ProcessState::Stale);
}

#[test]
fn the_time_a_serial_line_takes_for_a_sentence_is_no_delay_of_the_source() {
    let mut bench = Bench::new(&Config { address: "/dev/ttyUSB1".into(), baud: 9600, ..Config::default() });
    for i in 0..5 {
        let utc_s = START_S + f64::from(i);
        let text = burst(&hhmmss(utc_s), 21.0);
        // The first bit leaves 2 ms after the fix was true; the whole burst is read at its end.
        bench.send(utc_s + 0.002 + text.len() as f64 * 10.0 / 9600.0, text.as_bytes());
    }
    assert_eq!(bench.poses.len(), 5);
    let late_s = bench.poses[4].stamp_ns as f64 / 1e9 - (START_S + 4.0 + OFFSET_S);
    assert!((late_s - 0.002).abs() < 1e-5, "{late_s}");
}

#[test]
fn poses_go_on_over_midnight_and_through_a_leap_second() {
    let midnight_s = (START_S / DAY_S).ceil() * DAY_S;
    let mut bench = Bench::new(&Config::default());
    for i in -20..20 {
        // At midnight the source counts second 60 before it counts 0.
        let second = f64::from(i) * 0.1;
        let time = match i {
            0..10 => format!("235960.{i}0"),
            10.. => hhmmss(midnight_s + second - 1.0),
            _ => hhmmss(midnight_s + second),
        };
        bench.send(midnight_s + second + 0.001, burst(&time, 21.0).as_bytes());
    }
    let steps: Vec<i64> = bench.poses.windows(2).map(|p| p[1].stamp_ns - p[0].stamp_ns).collect();
    assert_eq!(steps.len(), 39);
    assert!(steps.iter().all(|step| (step - 100_000_000).abs() < 1000), "{steps:?}");
}

#[test]
fn bad_fixes_are_counted_by_cause_and_give_no_pose() {
    let mut bench = Bench::new(&Config::default());
    let gga = |fields: &str| sentence(&format!("GPGGA,120000.00,{fields},M,47.5,M,,"));
    bench.send(START_S, gga("9100.0,N,00700.0,E,4,12,0.7,100.0").as_bytes());
    bench.send(START_S + 1.0, gga("4560.0,N,00700.0,E,4,12,0.7,100.0").as_bytes());
    bench.send(START_S + 2.0, gga("4500.0,N,00700.0,E,0,12,0.7,100.0").as_bytes());
    bench.send(START_S + 3.0, b"$GPGGA,120000.00,4500.0,N,00700.0,E,4,12,0.7,100.0,M,47.5,M,,*00\r\n");
    for cause in ["latitude beyond 90 degrees", "minutes of 60 or more", "no fix (quality 0)", "bad checksum"] {
        assert_eq!(bench.dropped(cause), 1, "{cause}: {:?}", bench.events);
    }
    assert!(bench.poses.is_empty());
}

#[test]
fn repeated_frozen_and_jumping_poses_are_told() {
    let mut bench = Bench::new(&Config::default());
    for i in 0..20 {
        let utc_s = START_S + f64::from(i) * 0.1;
        let minutes = if i < 10 { 21.0 } else { 21.5 };
        bench.send(utc_s, burst(&hhmmss(utc_s), minutes).as_bytes());
    }
    bench.send(START_S + 2.0, burst(&hhmmss(START_S + 1.9), 21.5).as_bytes());
    assert_eq!(bench.poses.len(), 20);
    assert_eq!(bench.dropped("flagged jumped"), 1);
    assert_eq!(bench.poses[10].flags, POSE_JUMPED);
    assert!(bench.dropped("flagged frozen") > 5);
    assert_eq!(bench.dropped("sentence after its epoch"), 2);
}

#[test]
#[allow(clippy::disallowed_methods, reason = "a test reads its golden file")]
fn the_golden_inspvax_becomes_a_pose_in_its_zone() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/captures/inspvax_golden.bin");
    let Ok(bytes) = std::fs::read(path) else {
        eprintln!("SKIPPED: {path} not found");
        return;
    };
    let mut bench = Bench::new(&Config::default());
    bench.send(START_S, &bytes);
    let [pose] = bench.poses[..] else { panic!("{:?}", bench.events) };
    // 114.0383 W lies 2.9617 degrees east of zone 11's central meridian of 117 W.
    assert_eq!((pose.zone, pose.south, pose.quality()), (11, 0, PoseQuality::Single));
    assert!((pose.altitude_m - 1046.7093).abs() < 1e-4);
    let gamma = (2.961_748_85_f64.to_radians().tan() * 51.116_378_7_f64.to_radians().sin()).atan();
    assert!((pose.convergence_rad - gamma).abs() < 1e-4, "{} {gamma}", pose.convergence_rad);
    assert!((pose.yaw_rad - (90.000_923_268_f64.to_radians() - pose.convergence_rad)).abs() < 1e-12);
    assert!((f64::from(pose.position_std_m[0]) - 0.6688).abs() < 1e-6);
}

#[test]
fn nmea_beside_inertial_logs_and_formats_that_are_not_wanted_are_left_alone() {
    let nmea = |i: f64| burst(&hhmmss(START_S + i), 21.0);
    let mut bench = Bench::new(&Config { format: Format::Novatel, ..Config::default() });
    bench.send(START_S, nmea(0.0).as_bytes());
    assert!(bench.poses.is_empty());
    assert_eq!(bench.receiver.seen().frames["GNGGA"], 1);
}

proptest! {
    #[test]
    fn random_bytes_among_good_sentences_never_panic_and_never_stop_the_poses(
        noise in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..60), 30),
    ) {
        let mut bench = Bench::new(&Config::default());
        for (i, noise) in noise.iter().enumerate() {
            let utc_s = START_S + i as f64 * 0.1;
            bench.send(utc_s, noise);
            bench.send(utc_s + 0.01, burst(&hhmmss(utc_s), 21.0).as_bytes());
        }
        // A noise that ends like a frame may cost the sentence behind it, never the rest.
        prop_assert!(bench.poses.len() > 15, "{}", bench.poses.len());
    }
}
