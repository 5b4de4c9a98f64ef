//! Scans in both frames, what is refused and with which words, and who is answered how often.

use super::*;
use crate::jaus::rig::tests::{joint, place, rig};
use bytemuck::Zeroable;

const MS: i64 = 1_000_000;

fn scan(stamp_ns: i64) -> (ScanHeader, Vec<Return>) {
    let header = ScanHeader {
        stamp_ns,
        beam_interval_ns: 2.0 * MS as f64,
        start_rad: -PI / 4.0,
        step_rad: PI / 4.0,
        ..ScanHeader::zeroed()
    };
    let echo = |distance_mm| Return { distance_mm, remission: 0, kind: ReturnKind::Echo.to_wire(), code: 0 };
    let nothing = Return { kind: ReturnKind::NoReturn.to_wire(), ..echo(0) };
    (header, vec![echo(1000), echo(2000), nothing, echo(3000), echo(4000), echo(5000), echo(6000)])
}

/// One with a scan, one without.
fn ladars() -> [Ladar; 2] {
    let mount = rig().ladars.remove(0);
    let mut ladars = [Ladar::new(mount.clone()), Ladar::new(mount)];
    let (header, returns) = scan(0);
    ladars[0].take(&header, &returns);
    ladars
}

fn asked(ladars: &[Ladar], head: Option<&PanTilt>, [frame, sensor]: [u8; 2], wanted: u16) -> RangeData {
    let query = RangeDataQuery { sensor: sensor.into(), frame, wanted };
    data(ladars, head, &QueryRangeSensorData { sensors: vec![query].into() }).sensors.0.remove(0)
}

fn ask(frame: u8, wanted: u16, sensor: u8) -> RangeData {
    asked(&ladars(), None, [frame, sensor], wanted)
}

fn points(data: RangeData) -> Vec<RangePoint> {
    match data {
        RangeData::Scan(scan) => scan.points.0,
        RangeData::Error(error) => panic!("{error:?}"),
    }
}

fn words(data: RangeData) -> (u8, String) {
    match data {
        RangeData::Error(error) => (error.code, error.words),
        RangeData::Scan(scan) => panic!("{scan:?}"),
    }
}

#[test]
fn bearings_are_positive_to_the_right_and_zero_ahead() {
    let points = points(ask(NATIVE, ID | RANGE_VALID, 1));
    let degrees: Vec<f64> = points.iter().map(|p| p.bearing.0.to_degrees().round()).collect();
    assert_eq!(degrees, [135.0, 90.0, 45.0, 0.0, -45.0, -90.0, -135.0]);
    assert_eq!((points[3].range.0, points[3].id), (3.0, Some(3)));
    assert_eq!((points[2].range_valid, points[3].range_valid), (Some(0), Some(1)));
}

#[test]
fn without_the_validity_field_beams_without_echo_are_left_out() {
    let points = points(ask(NATIVE, 0, 1));
    assert_eq!(points.len(), 6);
    assert!(points.iter().all(|p| p.id.is_none() && p.range_valid.is_none() && p.range.0 >= 1.0));
}

#[test]
fn what_cannot_be_had_is_said_in_words() {
    assert_eq!(words(ask(2, 0, 1)), (FAILURE, "no such frame".into()));
    assert_eq!(words(ask(NATIVE, 0, 2)), (NOT_ACTIVE, "no scan yet".into()));
    assert_eq!(words(ask(VEHICLE, 0, 3)), (FAILURE, "no such sensor".into()));
    let query = CompressedDataQuery { sensor: 1, frame: NATIVE, compression: 1, wanted: 0 };
    let query = QueryRangeSensorCompressedData { sensors: vec![query].into() };
    let CompressedData::Error(error) = compressed_data(&ladars(), None, &query).sensors.0.remove(0) else { panic!() };
    assert_eq!((error.sensor, error.code), (1, BAD_COMPRESSION));
}

#[test]
fn points_as_bytes_are_the_points() {
    let query = CompressedDataQuery { sensor: 1, frame: NATIVE, compression: UNCOMPRESSED, wanted: ID };
    let query = QueryRangeSensorCompressedData { sensors: vec![query].into() };
    let CompressedData::Scan(scan) = compressed_data(&ladars(), None, &query).sensors.0.remove(0) else { panic!() };
    let mut whole = Writer::default();
    RangeData::Scan(RangeScan { sensor: 1, frame: NATIVE, time: scan.time, points: points(ask(NATIVE, ID, 1)).into() })
        .write(&mut whole);
    // The tag, the number, the frame and the stamp stand before the points there.
    assert_eq!(scan.points, whole.into_bytes()[8..]);
}

/// By hand: the tilting part turned up by `tilt` about the axis 1 m ahead and 2 m up.
fn by_hand(tilt: f64, x: f64, y: f64, z: f64) -> [f64; 3] {
    [1.0 + x * tilt.cos() + z * tilt.sin(), y, -2.0 - x * tilt.sin() + z * tilt.cos()]
}

#[test]
fn in_the_vehicles_frame_each_beam_has_the_heads_angle_at_its_own_instant() {
    let mut head = PanTilt::new(rig().head.unwrap());
    // 0.01 rad a millisecond.
    assert!(head.take(&joint(-10 * MS, 0.0, -0.1)) && head.take(&joint(20 * MS, 0.0, 0.2)));
    let points = points(asked(&ladars(), Some(&head), [VEHICLE, 1], ID | RANGE_VALID));
    let beams: Vec<_> = points.iter().map(|p| p.id.unwrap()).collect();
    assert_eq!(beams, [0, 1, 3, 4, 5, 6], "a beam without echo has no place");
    // Beam 1 looks to the right, 2 ms after the first; beam 3 ahead, 6 ms; beam 5 to the left, 10 ms.
    for (i, expected) in
        [(1, by_hand(0.02, 0.2, 2.0, -0.1)), (2, by_hand(0.06, 3.2, 0.0, -0.1)), (4, by_hand(0.10, 0.2, -5.0, -0.1))]
    {
        let got = place(&points[i]);
        let off_m = (0..3).map(|axis| (got[axis] - expected[axis]).abs()).fold(0.0, f64::max);
        assert!(off_m < 1e-9, "{got:?} is not {expected:?}");
    }
    assert!(points[2].inclination.0 > 0.0, "above the vehicle's origin");
}

#[test]
fn in_the_vehicles_frame_the_newest_scan_is_given_at_which_the_angles_are_known() {
    let (mut ladars, mut head) = (ladars(), PanTilt::new(rig().head.unwrap()));
    let time = |ladars: &[Ladar], head: &PanTilt| match asked(ladars, Some(head), [VEHICLE, 1], 0) {
        RangeData::Scan(scan) => Ok(scan.time),
        RangeData::Error(error) => Err(error.code),
    };
    assert_eq!(time(&ladars, &head), Err(FAILURE), "no angle at all");
    head.take(&joint(-MS, 0.0, 0.1));
    head.take(&joint(13 * MS, 0.0, 0.1));
    assert_eq!(time(&ladars, &head), Ok(time_stamp(0)));
    let (header, returns) = scan(20 * MS);
    ladars[0].take(&header, &returns);
    assert_eq!(time(&ladars, &head), Ok(time_stamp(0)), "the newer scan waits for its angles");
    head.take(&joint(33 * MS, 0.0, 0.1));
    assert_eq!(time(&ladars, &head), Ok(time_stamp(20 * MS)));
    // Scans go on and angles do not: soon there is nothing to say, and no memory grows.
    for i in 2..200 {
        let (header, returns) = scan(i * 20 * MS);
        ladars[0].take(&header, &returns);
    }
    assert_eq!((time(&ladars, &head), ladars[0].scans.len()), (Err(FAILURE), SCANS_MAX));
}

#[test]
fn without_a_head_ladars_are_fixed_to_the_vehicle() {
    let ahead = &points(ask(VEHICLE, 0, 1))[2];
    let got = place(ahead);
    assert!((got[0] - 3.2).abs() < 1e-9 && got[1].abs() < 1e-9 && (got[2] + 0.1).abs() < 1e-9, "{got:?}");
}

#[test]
fn a_query_for_everything_many_times_is_answered_once_a_sensor() {
    let sensors = (0..60_000).map(|i| RangeDataQuery { sensor: i % 7, frame: 0, wanted: 0 }).collect::<Vec<_>>();
    let ladars = ladars();
    assert_eq!(data(&ladars, None, &QueryRangeSensorData { sensors: sensors.into() }).sensors.0.len(), 3);
    assert_eq!(data(&ladars, None, &QueryRangeSensorData::default()).sensors.0.len(), 2);
    let all = geometry(&ladars, None, Id::new(1, 1, 20), &QuerySensorGeometricProperties { sensors: vec![0].into() });
    assert_eq!(all.sensors.0.iter().map(|s| s.sensor).collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn capabilities_and_configuration_say_what_is_known() {
    let report = capabilities(&ladars(), &QueryRangeSensorCapabilities::default());
    let [with, without] = &report.sensors.0[..] else { panic!() };
    assert_eq!(with.horizontal_start.map(|a| a.0.to_degrees().round()), Some(135.0));
    assert_eq!((without.horizontal_start, without.rate_max), (None, None));
    assert_eq!((with.transforms, with.range_min, with.range_max), (Some(1), Some(Range(0.5)), Some(Range(50.0))));
    // Eight beams a turn, 2 ms apart.
    assert!((with.rate_max.unwrap().0 - 62.5).abs() < 1e-9 && with.rate_min == with.rate_max);
    let report = configuration(&ladars(), &QueryRangeSensorConfiguration::default());
    let states: Vec<_> = report.sensors.0.iter().map(|s| (s.state, s.rate.is_some())).collect();
    assert_eq!(states, [(Some(0), true), (Some(2), false)]);
}

#[test]
fn settings_are_refused_with_the_standards_reason() {
    let ask = |sensor| RangeSensorConfiguration { sensor, ..RangeSensorConfiguration::default() };
    let answer = |ask| {
        let wanted = SetRangeSensorConfiguration { request: 7, sensors: vec![ask].into() };
        let mut confirm = set(&ladars(), &wanted);
        assert_eq!(confirm.request, 7);
        match confirm.sensors.0.remove(0) {
            Setting::Done(sensor) => Ok(sensor),
            Setting::Refused(error) => Err(error.code),
        }
    };
    let angle = Some(Angle32(0.0));
    assert_eq!(answer(RangeSensorConfiguration { horizontal_stop: angle, ..ask(1) }), Err(1));
    assert_eq!(answer(RangeSensorConfiguration { vertical_start: angle, ..ask(1) }), Err(2));
    assert_eq!(answer(RangeSensorConfiguration { rate: Some(ScanRate(5.0)), ..ask(1) }), Err(3));
    assert_eq!(answer(RangeSensorConfiguration { range_max: Some(Range(9.0)), ..ask(1) }), Err(4));
    assert_eq!(answer(RangeSensorConfiguration { state: Some(2), ..ask(1) }), Err(5));
    assert_eq!(answer(RangeSensorConfiguration { state: Some(2), vertical_stop: angle, ..ask(1) }), Err(MANY_FAULTS));
    assert_eq!(answer(RangeSensorConfiguration { state: Some(0), ..ask(1) }), Ok(1), "active it is");
    assert_eq!(answer(ask(9)), Err(UNKNOWN_SENSOR));
    let none = SetRangeSensorConfiguration::default();
    assert!(set(&ladars(), &none).sensors.0.is_empty());
}
