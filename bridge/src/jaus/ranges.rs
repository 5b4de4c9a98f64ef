//! Scans as AS6060 range sensor reports, in the sensor's own frame.
//!
//! In: a scan in device angles (counter-clockwise from above, 0 right, 90 degrees ahead). Out: bearing 0 ahead and positive
//! to the right, inclination 0: the axes of the ladar frame. A beam without echo has no range: it is reported with
//! `range_valid` 0 where the asker wants that field, and left out where not.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use tsense_contract::{Return, ReturnKind, ScanHeader};
use tsense_jaus::message::range::{
    FAILURE, NATIVE, NOT_ACTIVE, QueryRangeSensorCapabilities, QueryRangeSensorConfiguration, QueryRangeSensorData,
    RangeData, RangeError, RangePoint, RangeScan, RangeSensorCapabilities, RangeSensorConfiguration,
    ReportRangeSensorCapabilities, ReportRangeSensorConfiguration, ReportRangeSensorData,
};
use tsense_jaus::message::scaled::{Angle32, Range};
use tsense_jaus::time_stamp;

/// Bits of [`RangePoint`]'s presence vector that we can fill.
const ID: u16 = 1;
const RANGE_VALID: u16 = 2;

/// The newest scan of a ladar. Sensors are numbered from 1 in the order of the configuration.
#[derive(Clone, Debug, Default)]
pub struct Ladar {
    /// Its name.
    pub name: String,
    /// The newest scan.
    pub scan: Option<(ScanHeader, Vec<Return>)>,
}

impl Ladar {
    /// Bearings of the first and the last beam, radians.
    fn bearings(&self) -> Option<[f64; 2]> {
        let (header, returns) = self.scan.as_ref()?;
        Some([bearing_rad(header, 0), bearing_rad(header, returns.len().saturating_sub(1))])
    }
}

/// -pi to pi, positive to the right.
fn bearing_rad(header: &ScanHeader, beam: usize) -> f64 {
    let angle = FRAC_PI_2 - (header.start_rad + beam as f64 * header.step_rad);
    (angle + PI).rem_euclid(TAU) - PI
}

/// The sensors that a query names, each once; all where it names none. Unknown numbers come with no ladar.
fn named<'a, T: Clone>(
    ladars: &'a [Ladar],
    query: &'a [T],
    number: impl Fn(&T) -> u16,
    all: impl Fn(u16) -> T,
) -> Vec<(T, Option<&'a Ladar>)> {
    let everything: Vec<T> = (1..=ladars.len() as u16).map(all).collect();
    let wanted = if query.is_empty() { &everything[..] } else { query };
    let mut answered: Vec<(T, Option<&Ladar>)> = Vec::new();
    for entry in wanted {
        let sensor = number(entry);
        // A query of 65535 entries gets no more answers than there are sensors, and one.
        if answered.iter().all(|(known, _)| number(known) != sensor) && answered.len() <= ladars.len() {
            let ladar = usize::from(sensor).checked_sub(1).and_then(|index| ladars.get(index));
            answered.push((entry.clone(), ladar));
        }
    }
    answered
}

/// What the sensors measured last.
pub fn data(ladars: &[Ladar], query: &QueryRangeSensorData) -> ReportRangeSensorData {
    use tsense_jaus::message::range::RangeDataQuery;
    let all = |sensor| RangeDataQuery { sensor, frame: NATIVE, wanted: RANGE_VALID };
    let answer = |(wanted, ladar): (RangeDataQuery, Option<&Ladar>)| {
        let refuse =
            |code, words: &str| RangeData::Error(RangeError { sensor: wanted.sensor, code, words: words.to_owned() });
        match ladar.map(|ladar| &ladar.scan) {
            None => refuse(FAILURE, "no such sensor"),
            Some(_) if wanted.frame != NATIVE => refuse(FAILURE, "only the native frame is offered"),
            Some(None) => refuse(NOT_ACTIVE, "no scan yet"),
            Some(Some((header, returns))) => RangeData::Scan(scan(wanted.sensor, wanted.wanted, header, returns)),
        }
    };
    let sensors = named(ladars, &query.sensors.0, |entry| entry.sensor, all).into_iter().map(answer);
    ReportRangeSensorData { sensors: sensors.collect::<Vec<_>>().into() }
}

fn scan(sensor: u16, wanted: u16, header: &ScanHeader, returns: &[Return]) -> RangeScan {
    let valid = wanted & RANGE_VALID != 0;
    let point = |(beam, value): (usize, &Return)| {
        let echo = value.kind() == ReturnKind::Echo;
        (echo || valid).then(|| RangePoint {
            id: (wanted & ID != 0).then_some(beam as u32),
            range: Range(f64::from(value.distance_mm) / 1e3),
            range_valid: valid.then_some(u8::from(echo)),
            bearing: Angle32(bearing_rad(header, beam)),
            inclination: Angle32(0.0),
            ..RangePoint::default()
        })
    };
    let points: Vec<RangePoint> = returns.iter().enumerate().filter_map(point).collect();
    RangeScan { sensor, frame: NATIVE, time: time_stamp(header.stamp_ns), points: points.into() }
}

/// What the sensors can do, as far as their scans say it.
pub fn capabilities(ladars: &[Ladar], query: &QueryRangeSensorCapabilities) -> ReportRangeSensorCapabilities {
    use tsense_jaus::message::range::SensorQuery;
    let all = |sensor| SensorQuery { sensor, wanted: u16::MAX };
    let answer = |(wanted, ladar): (SensorQuery, Option<&Ladar>)| {
        let ladar = ladar?;
        let has = |bit: u16| wanted.wanted >> bit & 1 == 1;
        let [start, stop] = ladar.bearings().map_or([None; 2], |both| both.map(|b| Some(Angle32(b))));
        Some(RangeSensorCapabilities {
            sensor: wanted.sensor,
            name: ladar.name.clone(),
            states: has(0).then_some(1),
            horizontal_start: start.filter(|_| has(1)),
            horizontal_stop: stop.filter(|_| has(2)),
            vertical_start: has(3).then_some(Angle32(0.0)),
            vertical_stop: has(4).then_some(Angle32(0.0)),
            compressions: has(9).then_some(1),
            transforms: has(10).then_some(0),
            ..RangeSensorCapabilities::default()
        })
    };
    let sensors = named(ladars, &query.sensors.0, |entry| entry.sensor, all).into_iter().filter_map(answer);
    ReportRangeSensorCapabilities { sensors: sensors.collect::<Vec<_>>().into() }
}

/// How the sensors are set, as far as their scans say it.
pub fn configuration(ladars: &[Ladar], query: &QueryRangeSensorConfiguration) -> ReportRangeSensorConfiguration {
    use tsense_jaus::message::range::SensorQuery;
    let all = |sensor| SensorQuery { sensor, wanted: u16::MAX };
    let answer = |(wanted, ladar): (SensorQuery, Option<&Ladar>)| {
        let has = |bit: u16| wanted.wanted >> bit & 1 == 1;
        let [start, stop] = ladar?.bearings().map_or([None; 2], |both| both.map(|b| Some(Angle32(b))));
        Some(RangeSensorConfiguration {
            sensor: wanted.sensor,
            horizontal_start: start.filter(|_| has(0)),
            horizontal_stop: stop.filter(|_| has(1)),
            vertical_start: has(2).then_some(Angle32(0.0)),
            vertical_stop: has(3).then_some(Angle32(0.0)),
            state: has(7).then_some(if start.is_some() { 0 } else { 2 }),
            ..RangeSensorConfiguration::default()
        })
    };
    let sensors = named(ladars, &query.sensors.0, |entry| entry.sensor, all).into_iter().filter_map(answer);
    ReportRangeSensorConfiguration { sensors: sensors.collect::<Vec<_>>().into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use tsense_jaus::message::range::{RangeDataQuery, VEHICLE};

    fn ladar() -> Ladar {
        let header = ScanHeader { start_rad: -PI / 4.0, step_rad: PI / 4.0, ..ScanHeader::zeroed() };
        let echo = |distance_mm| Return { distance_mm, remission: 0, kind: ReturnKind::Echo.to_wire(), code: 0 };
        let nothing = Return { kind: ReturnKind::NoReturn.to_wire(), ..echo(0) };
        let scan =
            Some((header, vec![echo(1000), echo(2000), nothing, echo(3000), echo(4000), echo(5000), echo(6000)]));
        Ladar { name: "ladar".into(), scan }
    }

    fn ask(frame: u8, wanted: u16, sensor: u16) -> RangeData {
        let query = QueryRangeSensorData { sensors: vec![RangeDataQuery { sensor, frame, wanted }].into() };
        data(&[ladar(), Ladar::default()], &query).sensors.0.remove(0)
    }

    #[test]
    fn bearings_are_positive_to_the_right_and_zero_ahead() {
        let RangeData::Scan(scan) = ask(NATIVE, ID | RANGE_VALID, 1) else { panic!() };
        let degrees: Vec<f64> = scan.points.0.iter().map(|p| p.bearing.0.to_degrees().round()).collect();
        assert_eq!(degrees, [135.0, 90.0, 45.0, 0.0, -45.0, -90.0, -135.0]);
        assert_eq!((scan.points.0[3].range.0, scan.points.0[3].id), (3.0, Some(3)));
        assert_eq!((scan.points.0[2].range_valid, scan.points.0[3].range_valid), (Some(0), Some(1)));
    }

    #[test]
    fn without_the_validity_field_beams_without_echo_are_left_out() {
        let RangeData::Scan(scan) = ask(NATIVE, 0, 1) else { panic!() };
        assert_eq!(scan.points.0.len(), 6);
        assert!(scan.points.0.iter().all(|p| p.id.is_none() && p.range_valid.is_none() && p.range.0 >= 1.0));
    }

    #[test]
    fn what_cannot_be_had_is_said_in_words() {
        let words = |data: RangeData| match data {
            RangeData::Error(error) => (error.code, error.words),
            RangeData::Scan(scan) => panic!("{scan:?}"),
        };
        assert_eq!(words(ask(VEHICLE, 0, 1)), (FAILURE, "only the native frame is offered".into()));
        assert_eq!(words(ask(NATIVE, 0, 2)), (NOT_ACTIVE, "no scan yet".into()));
        assert_eq!(words(ask(NATIVE, 0, 3)), (FAILURE, "no such sensor".into()));
    }

    #[test]
    fn a_query_for_everything_many_times_is_answered_once_a_sensor() {
        let sensors = (0..60_000).map(|i| RangeDataQuery { sensor: i % 7, frame: 0, wanted: 0 }).collect::<Vec<_>>();
        let ladars = [ladar(), Ladar::default()];
        assert_eq!(data(&ladars, &QueryRangeSensorData { sensors: sensors.into() }).sensors.0.len(), 3);
        assert_eq!(data(&ladars, &QueryRangeSensorData::default()).sensors.0.len(), 2);
        let report = capabilities(&ladars, &QueryRangeSensorCapabilities::default());
        assert_eq!(report.sensors.0[0].horizontal_start.map(|a| a.0.to_degrees().round()), Some(135.0));
        assert_eq!((report.sensors.0[1].horizontal_start, report.sensors.0[0].transforms), (None, Some(0)));
    }
}
