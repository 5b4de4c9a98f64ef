//! Scans as AS6060 range sensor reports, in the sensor's own frame or in the vehicle's.
//!
//! In: scans in device angles (counter-clockwise from above, 0 right, 90 degrees ahead). Out: bearing 0 ahead and positive
//! to the right, inclination positive up. In the sensor's frame, whose axes are those of the ladar, inclination is 0. A beam
//! without echo has no range: there it is reported with `range_valid` 0 where the asker wants that field, and left out
//! where not. In the vehicle's frame it has no place, and is left out always.

use super::rig::{PanTilt, ladar_at, sensor_mount};
use crate::ros2::Mount;
use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use tsense_contract::{Return, ReturnKind, ScanHeader};
use tsense_geometry::{Point, Timestamp, Vehicle, beam_direction};
use tsense_jaus::message::Field;
use tsense_jaus::message::range::{
    ALL_SENSORS, BAD_COMPRESSION, CompressedData, CompressedDataQuery, CompressedScan, ConfirmSensorConfiguration,
    FAILURE, MANY_FAULTS, NATIVE, NOT_ACTIVE, QueryRangeSensorCapabilities, QueryRangeSensorCompressedData,
    QueryRangeSensorConfiguration, QueryRangeSensorData, QuerySensorGeometricProperties, RangeData, RangeDataQuery,
    RangeError, RangePoint, RangeScan, RangeSensorCapabilities, RangeSensorConfiguration,
    ReportRangeSensorCapabilities, ReportRangeSensorCompressedData, ReportRangeSensorConfiguration,
    ReportRangeSensorData, ReportSensorGeometricProperties, SensorGeometry, SensorQuery, SetRangeSensorConfiguration,
    Setting, UNCOMPRESSED, UNKNOWN_SENSOR, VEHICLE,
};
use tsense_jaus::message::scaled::{Angle32, Range, ScanRate};
use tsense_jaus::{Id, Writer, time_stamp};

/// Bits of [`RangePoint`]'s presence vector that we can fill.
const ID: u16 = 1;
const RANGE_VALID: u16 = 2;
/// Scans kept of a ladar: the head's angles of the newest come later than it does. A third of a second at 50 Hz.
const SCANS_MAX: usize = 16;

/// The newest scans of a ladar. Sensors are numbered from 1 in the order of the configuration.
#[derive(Clone, Debug)]
pub struct Ladar {
    /// Its name and place.
    pub mount: Mount,
    scans: VecDeque<(ScanHeader, Vec<Return>)>,
}

impl Ladar {
    /// Before its first scan.
    pub fn new(mount: Mount) -> Self {
        Self { mount, scans: VecDeque::new() }
    }

    /// A new scan.
    pub fn take(&mut self, header: &ScanHeader, returns: &[Return]) {
        self.scans.truncate(SCANS_MAX - 1);
        self.scans.push_front((*header, returns.to_vec()));
    }

    fn newest(&self) -> Option<&(ScanHeader, Vec<Return>)> {
        self.scans.front()
    }

    /// Bearings of the first and the last beam, radians.
    fn bearings(&self) -> Option<[f64; 2]> {
        let (header, returns) = self.newest()?;
        Some([bearing_rad(header, 0), bearing_rad(header, returns.len().saturating_sub(1))])
    }

    /// Turns of the mirror a second, as measured.
    fn rate(&self) -> Option<ScanRate> {
        let (header, _) = self.newest()?;
        let hz = header.step_rad / TAU / (header.beam_interval_ns * 1e-9);
        (hz.is_finite() && hz > 0.0).then_some(ScanRate(hz))
    }
}

fn angle_rad(header: &ScanHeader, beam: usize) -> f64 {
    header.start_rad + beam as f64 * header.step_rad
}

/// -pi to pi, positive to the right.
fn bearing_rad(header: &ScanHeader, beam: usize) -> f64 {
    (FRAC_PI_2 - angle_rad(header, beam) + PI).rem_euclid(TAU) - PI
}

/// What asks for a sensor by its number.
trait Ask: Clone {
    fn sensor(&mut self) -> &mut u16;
}

macro_rules! asks {
    ($($kind:ty)+) => {$(
        impl Ask for $kind {
            fn sensor(&mut self) -> &mut u16 {
                &mut self.sensor
            }
        }
    )+};
}

asks! { SensorQuery RangeDataQuery CompressedDataQuery RangeSensorConfiguration }

impl Ask for u16 {
    fn sensor(&mut self) -> &mut u16 {
        self
    }
}

/// The sensors that a query names, each once: the number 0 is all of them, as is a query that names none, for which
/// `everything` stands. Unknown numbers come with no ladar.
fn named<'a, T: Ask>(ladars: &'a [Ladar], query: &[T], everything: T) -> Vec<(u16, T, Option<&'a Ladar>)> {
    let everything = [everything];
    let mut answered: Vec<(u16, T, Option<&Ladar>)> = Vec::new();
    for ask in if query.is_empty() { &everything[..] } else { query } {
        let mut ask = ask.clone();
        let number = *ask.sensor();
        let numbers = if number == ALL_SENSORS { 1..=ladars.len() as u16 } else { number..=number };
        for number in numbers {
            // A query of 65535 entries gets no more answers than there are sensors, and one.
            if answered.len() <= ladars.len() && answered.iter().all(|(known, ..)| *known != number) {
                *ask.sensor() = number;
                answered.push((number, ask.clone(), ladars.get(usize::from(number) - 1)));
            }
        }
    }
    answered
}

/// What the sensors measured last.
pub fn data(ladars: &[Ladar], head: Option<&PanTilt>, query: &QueryRangeSensorData) -> ReportRangeSensorData {
    let everything = RangeDataQuery { sensor: ALL_SENSORS, frame: NATIVE, wanted: RANGE_VALID };
    let sensors = named(ladars, &query.sensors.0, everything).into_iter();
    ReportRangeSensorData {
        sensors: sensors.map(|(_, ask, ladar)| measured(&ask, ladar, head)).collect::<Vec<_>>().into(),
    }
}

/// The same in the message for compressed data, of which we offer the form without compression.
pub fn compressed_data(
    ladars: &[Ladar],
    head: Option<&PanTilt>,
    query: &QueryRangeSensorCompressedData,
) -> ReportRangeSensorCompressedData {
    let everything =
        CompressedDataQuery { sensor: ALL_SENSORS, frame: NATIVE, compression: UNCOMPRESSED, wanted: RANGE_VALID };
    let answer = |(sensor, ask, ladar): (u16, CompressedDataQuery, Option<&Ladar>)| {
        if ladar.is_some() && ask.compression != UNCOMPRESSED {
            return CompressedData::Error(error(sensor, BAD_COMPRESSION, "only uncompressed data is offered"));
        }
        match measured(&RangeDataQuery { sensor, frame: ask.frame, wanted: ask.wanted }, ladar, head) {
            RangeData::Error(error) => CompressedData::Error(error),
            RangeData::Scan(RangeScan { sensor, frame, time, points }) => {
                let mut bytes = Writer::default();
                points.write(&mut bytes);
                let points = bytes.into_bytes();
                CompressedData::Scan(CompressedScan { sensor, frame, time, compression: UNCOMPRESSED, points })
            }
        }
    };
    let sensors = named(ladars, &query.sensors.0, everything).into_iter().map(answer);
    ReportRangeSensorCompressedData { sensors: sensors.collect::<Vec<_>>().into() }
}

fn error(sensor: u16, code: u8, words: &str) -> RangeError {
    RangeError { sensor, code, words: words.to_owned() }
}

fn measured(ask: &RangeDataQuery, ladar: Option<&Ladar>, head: Option<&PanTilt>) -> RangeData {
    let refuse = |code, words| RangeData::Error(error(ask.sensor, code, words));
    let Some(ladar) = ladar else { return refuse(FAILURE, "no such sensor") };
    let Some((newest, returns)) = ladar.newest() else { return refuse(NOT_ACTIVE, "no scan yet") };
    let (header, echoes) = match ask.frame {
        NATIVE => (newest, native(newest, returns, ask.wanted & RANGE_VALID != 0)),
        VEHICLE => match ladar
            .scans
            .iter()
            .find_map(|(header, returns)| Some((header, in_vehicle(header, returns, head, &ladar.mount)?)))
        {
            Some(placed) => placed,
            None => return refuse(FAILURE, "the angles of the pan-tilt unit are not known at the newest scans"),
        },
        _ => return refuse(FAILURE, "no such frame"),
    };
    let point = |echo: Echo| RangePoint {
        id: (ask.wanted & ID != 0).then_some(echo.beam as u32),
        range: Range(echo.range_m),
        range_valid: (ask.wanted & RANGE_VALID != 0).then_some(u8::from(echo.valid)),
        bearing: Angle32(echo.bearing_rad),
        inclination: Angle32(echo.inclination_rad),
        ..RangePoint::default()
    };
    let points: Vec<RangePoint> = echoes.into_iter().map(point).collect();
    let time = time_stamp(header.stamp_ns);
    RangeData::Scan(RangeScan { sensor: ask.sensor, frame: ask.frame, time, points: points.into() })
}

/// What a beam met, seen from the origin of a frame.
struct Echo {
    beam: usize,
    valid: bool,
    range_m: f64,
    bearing_rad: f64,
    inclination_rad: f64,
}

fn range_m(value: &Return) -> f64 {
    f64::from(value.distance_mm) / 1e3
}

fn native(header: &ScanHeader, returns: &[Return], all: bool) -> Vec<Echo> {
    let echo = |(beam, value): (usize, &Return)| {
        let valid = value.kind() == ReturnKind::Echo;
        let bearing_rad = bearing_rad(header, beam);
        (valid || all).then(|| Echo { beam, valid, range_m: range_m(value), bearing_rad, inclination_rad: 0.0 })
    };
    returns.iter().enumerate().filter_map(echo).collect()
}

/// Every echo where its beam met it, by the head's angles at that beam's own instant; none where one is not known.
fn in_vehicle(header: &ScanHeader, returns: &[Return], head: Option<&PanTilt>, mount: &Mount) -> Option<Vec<Echo>> {
    let echoes = returns.iter().enumerate().filter(|(_, value)| value.kind() == ReturnKind::Echo);
    echoes
        .map(|(beam, value)| {
            let stamp = Timestamp::from_ns(header.stamp_ns).plus_ns((beam as f64 * header.beam_interval_ns) as i64);
            let end = Point::new(0.0, 0.0, 0.0) + beam_direction(angle_rad(header, beam)).scaled(range_m(value));
            Some(seen_from_vehicle(beam, ladar_at(head, mount, stamp)? * end))
        })
        .collect()
}

fn seen_from_vehicle(beam: usize, at: Point<Vehicle>) -> Echo {
    let level_m = at.x().hypot(at.y());
    Echo {
        beam,
        valid: true,
        range_m: level_m.hypot(at.z()),
        bearing_rad: at.y().atan2(at.x()),
        inclination_rad: (-at.z()).atan2(level_m),
    }
}

/// What the sensors can do.
pub fn capabilities(ladars: &[Ladar], query: &QueryRangeSensorCapabilities) -> ReportRangeSensorCapabilities {
    let answer = |(sensor, ask, ladar): (u16, SensorQuery, Option<&Ladar>)| {
        let ladar = ladar?;
        let has = |bit: u16| ask.wanted >> bit & 1 == 1;
        let [start, stop] = ladar.bearings().map_or([None; 2], |both| both.map(|b| Some(Angle32(b))));
        Some(RangeSensorCapabilities {
            sensor,
            name: ladar.mount.name.clone(),
            states: has(0).then_some(1),
            horizontal_start: start.filter(|_| has(1)),
            horizontal_stop: stop.filter(|_| has(2)),
            vertical_start: has(3).then_some(Angle32(0.0)),
            vertical_stop: has(4).then_some(Angle32(0.0)),
            rate_min: ladar.rate().filter(|_| has(5)),
            rate_max: ladar.rate().filter(|_| has(6)),
            range_min: has(7).then_some(Range(ladar.mount.range_min_m)),
            range_max: has(8).then_some(Range(ladar.mount.range_max_m)),
            compressions: has(9).then_some(1),
            transforms: has(10).then_some(1),
        })
    };
    let everything = SensorQuery { sensor: ALL_SENSORS, wanted: u16::MAX };
    let sensors = named(ladars, &query.sensors.0, everything).into_iter().filter_map(answer);
    ReportRangeSensorCapabilities { sensors: sensors.collect::<Vec<_>>().into() }
}

/// How the sensors are set.
pub fn configuration(ladars: &[Ladar], query: &QueryRangeSensorConfiguration) -> ReportRangeSensorConfiguration {
    let answer = |(sensor, ask, ladar): (u16, SensorQuery, Option<&Ladar>)| {
        let ladar = ladar?;
        let has = |bit: u16| ask.wanted >> bit & 1 == 1;
        let [start, stop] = ladar.bearings().map_or([None; 2], |both| both.map(|b| Some(Angle32(b))));
        Some(RangeSensorConfiguration {
            sensor,
            horizontal_start: start.filter(|_| has(0)),
            horizontal_stop: stop.filter(|_| has(1)),
            vertical_start: has(2).then_some(Angle32(0.0)),
            vertical_stop: has(3).then_some(Angle32(0.0)),
            rate: ladar.rate().filter(|_| has(4)),
            range_min: has(5).then_some(Range(ladar.mount.range_min_m)),
            range_max: has(6).then_some(Range(ladar.mount.range_max_m)),
            state: has(7).then_some(if start.is_some() { 0 } else { 2 }),
        })
    };
    let everything = SensorQuery { sensor: ALL_SENSORS, wanted: u16::MAX };
    let sensors = named(ladars, &query.sensors.0, everything).into_iter().filter_map(answer);
    ReportRangeSensorConfiguration { sensors: sensors.collect::<Vec<_>>().into() }
}

/// Where the sensors sit; `id` is the component that reports the pan-tilt unit.
pub fn geometry(
    ladars: &[Ladar],
    head: Option<&PanTilt>,
    id: Id,
    query: &QuerySensorGeometricProperties,
) -> ReportSensorGeometricProperties {
    let answer = |(sensor, _, ladar): (u16, u16, Option<&Ladar>)| {
        Some(SensorGeometry { sensor, mount: sensor_mount(head, &ladar?.mount, id) })
    };
    let sensors = named(ladars, &query.sensors.0, ALL_SENSORS).into_iter().filter_map(answer);
    ReportSensorGeometricProperties { sensors: sensors.collect::<Vec<_>>().into() }
}

/// The answer to who would set sensors: nothing is set over JAUS, so all but what asks for no change is refused.
pub fn set(ladars: &[Ladar], wanted: &SetRangeSensorConfiguration) -> ConfirmSensorConfiguration {
    let answer = |(sensor, ask, ladar): (u16, RangeSensorConfiguration, Option<&Ladar>)| match (ladar, fault(&ask)) {
        (None, _) => Setting::Refused(error(sensor, UNKNOWN_SENSOR, "no such sensor")),
        (Some(_), Some(code)) => Setting::Refused(error(sensor, code, "ladars are set on the vehicle alone")),
        (Some(_), None) => Setting::Done(sensor),
    };
    let sensors = match &wanted.sensors.0[..] {
        [] => Vec::new(),
        asks => named(ladars, asks, RangeSensorConfiguration::default()).into_iter().map(answer).collect(),
    };
    ConfirmSensorConfiguration { request: wanted.request, sensors: sensors.into() }
}

/// The standard's code for what a setting would change, 1 to 5, or that for several.
fn fault(ask: &RangeSensorConfiguration) -> Option<u8> {
    let changes = [
        ask.horizontal_start.is_some() || ask.horizontal_stop.is_some(),
        ask.vertical_start.is_some() || ask.vertical_stop.is_some(),
        ask.rate.is_some(),
        ask.range_min.is_some() || ask.range_max.is_some(),
        ask.state.is_some_and(|state| state != 0),
    ];
    let mut codes = (1..).zip(changes).filter_map(|(code, change)| change.then_some(code));
    let first = codes.next()?;
    Some(codes.next().map_or(first, |_| MANY_FAULTS))
}

#[cfg(test)]
mod tests;
