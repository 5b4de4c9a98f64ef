//! Properties of the LMS-151's wire formats: what is written is read, pieces do not matter, and no bytes do harm.
//!
//! Seeded: each run tries the same cases, and each property says how many it tried.

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::cell::Cell;
use tsense_drivers::lms151::commands::{DataConfig, Request, ScanConfig, Variable};
use tsense_drivers::lms151::config::Config as LadarConfig;
use tsense_drivers::lms151::scan_data::{self, Channel, DeviceEvent, DeviceTime, Encoder, Position, ScanData};
use tsense_drivers::lms151::session::{Action, Session, Settings};
use tsense_drivers::lms151::telegram::{Dialect, PAYLOAD_MAX, Packet, StreamFramer, Verb, payload};
use tsense_geometry::Timestamp;

/// Runs a property on `cases` cases from a fixed seed, and checks that it did.
fn check<S: Strategy>(cases: u32, strategy: S, property: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let tried = Cell::new(0);
    runner
        .run(&strategy, |value| {
            tried.set(tried.get() + 1);
            property(value)
        })
        .unwrap();
    assert_eq!(tried.get(), cases);
}

fn dialects() -> impl Strategy<Value = Dialect> {
    prop_oneof![Just(Dialect::A), Just(Dialect::B)]
}

/// Characters both dialects can carry.
fn texts() -> impl Strategy<Value = Option<String>> {
    prop::option::of("[ -~\u{a1}-\u{ff}]{0,40}")
}

fn finite() -> impl Strategy<Value = f32> {
    any::<u32>().prop_map(f32::from_bits).prop_filter("comparable", |f| !f.is_nan())
}

fn channels(largest: u16) -> impl Strategy<Value = Vec<Channel>> {
    let names = prop_oneof![Just(*b"DIST1"), Just(*b"DIST2"), Just(*b"RSSI1"), Just(*b"RSSI2")];
    let values = prop::collection::vec(0..=largest, 0..60);
    let one = (names, finite(), finite(), any::<i32>(), any::<u16>(), values).prop_map(
        |(name, scale, offset, start_e4_deg, step_e4_deg, raw)| Channel {
            name,
            scale,
            offset,
            start_e4_deg,
            step_e4_deg,
            raw,
        },
    );
    prop::collection::vec(one, 0..4)
}

fn scans() -> impl Strategy<Value = ScanData> {
    let head = (any::<[u16; 4]>(), any::<[u32; 5]>(), any::<[u8; 6]>(), any::<i16>());
    let encoder = any::<(u32, u16)>().prop_map(|(position, speed)| Encoder { position, speed });
    let position = (prop::array::uniform6(finite()), any::<u8>())
        .prop_map(|(xyz_rotations, rotation_kind)| Position { xyz_rotations, rotation_kind });
    let time = any::<(u16, [u8; 5], u32)>().prop_map(|(year, [month, day, hour, minute, second], microsecond)| {
        DeviceTime { year, month, day, hour, minute, second, microsecond }
    });
    let event = ("[A-Z0-9]{4}", any::<(u32, u32, i32)>()).prop_map(|(kind, (position, time_us, angle_e4_deg))| {
        let kind = kind.as_bytes().try_into().unwrap();
        DeviceEvent { kind, position, time_us, angle_e4_deg }
    });
    let blocks = (prop::option::of(position), texts(), texts(), prop::option::of(time), prop::option::of(event));
    let many = (prop::collection::vec(encoder, 0..3), channels(u16::MAX), channels(255));
    (head, many, blocks).prop_map(|((w, l, b, layer_angle), (encoders, channels_16, channels_8), blocks)| ScanData {
        version: w[0],
        device_number: w[1],
        serial: l[0],
        status: [b[0], b[1]],
        telegram_counter: w[2],
        scan_counter: w[3],
        scan_time_us: l[1],
        transmission_time_us: l[2],
        inputs: [b[2], b[3]],
        outputs: [b[4], b[5]],
        layer_angle,
        scan_frequency_centihz: l[3],
        measurement_frequency_100hz: l[4],
        encoders,
        channels_16,
        channels_8,
        position: blocks.0,
        name: blocks.1,
        comment: blocks.2,
        time: blocks.3,
        event: blocks.4,
    })
}

fn scan_payload(dialect: Dialect, scan: &ScanData) -> Vec<u8> {
    payload(dialect, Verb::Event, scan_data::NAME, |w| scan.emit(w))
}

#[test]
fn a_scan_that_was_written_is_read_as_it_was() {
    check(1000, (dialects(), scans()), |(dialect, scan)| {
        let bytes = scan_payload(dialect, &scan);
        let packet = Packet::parse(dialect, &bytes).unwrap();
        let mut fields = packet.fields();
        prop_assert_eq!(ScanData::parse(&mut fields).unwrap(), scan);
        fields.finish().unwrap();
        Ok(())
    });
}

/// Cuts bytes at the given places (taken modulo the length).
fn pieces<'a>(bytes: &'a [u8], cuts: &[usize]) -> Vec<&'a [u8]> {
    let mut places: Vec<usize> = cuts.iter().map(|c| c % (bytes.len() + 1)).collect();
    places.sort_unstable();
    let mut out = Vec::new();
    let mut from = 0;
    for place in places.into_iter().chain([bytes.len()]) {
        out.push(&bytes[from..place]);
        from = place;
    }
    out
}

#[test]
fn any_fragmentation_gives_the_same_telegrams_even_of_a_damaged_stream() {
    let damage = prop::collection::vec((any::<usize>(), any::<u8>()), 0..4);
    let cuts = prop::collection::vec(any::<usize>(), 0..40);
    let strategy = (dialects(), prop::collection::vec(scans(), 1..4), any::<Vec<u8>>(), damage, cuts);
    check(500, strategy, |(dialect, scans, noise, damage, cuts)| {
        let whole_damaged = damage.is_empty();
        let mut bytes: Vec<u8> = noise.iter().copied().filter(|b| *b != 2).collect();
        bytes.extend(scans.iter().flat_map(|s| dialect.frame(&scan_payload(dialect, s))));
        for (place, byte) in damage {
            let place = place % bytes.len();
            bytes[place] ^= byte;
        }
        let mut whole = StreamFramer::new(Some(dialect));
        let expected = whole.feed(&bytes);
        if whole_damaged {
            prop_assert_eq!(expected.len(), scans.len());
        }
        let mut pieced = StreamFramer::new(Some(dialect));
        let found: Vec<Vec<u8>> = pieces(&bytes, &cuts).into_iter().flat_map(|p| pieced.feed(p)).collect();
        prop_assert_eq!(found, expected);
        prop_assert_eq!(pieced.counts(), whole.counts());
        prop_assert_eq!(pieced.held(), whole.held());
        Ok(())
    });
}

fn requests() -> Vec<Request> {
    use Variable as V;
    let variables = [
        V::DeviceIdent,
        V::FirmwareVersion,
        V::DeviceState,
        V::LocationName,
        V::OperatingHours,
        V::PowerOns,
        V::ScanConfig,
        V::Status,
        V::Contamination,
    ];
    let scan = ScanConfig { frequency_centihz: 5000, step_e4_deg: 5000, range_e4_deg: [-450_000, 2_250_000] };
    let data = DataConfig { both_echoes: true, remission_bits: Some(8), output_interval: 1 };
    let mut all: Vec<Request> = variables.map(Request::Read).to_vec();
    all.extend([Request::LogIn, Request::SetScanConfig(scan), Request::SetDataConfig(data), Request::Run]);
    all.extend([Request::SetOutputRange { step_e4_deg: 5000 }, Request::StartMeasuring, Request::Stream(true)]);
    all
}

/// Any bytes, and good telegrams with some bytes changed and the end cut off.
fn hostile_payloads(dialect: Dialect) -> impl Strategy<Value = Vec<u8>> {
    let changed = (scans(), prop::collection::vec((any::<usize>(), any::<u8>()), 0..6), any::<usize>());
    let changed = changed.prop_map(move |(scan, changes, cut)| {
        let mut bytes = scan_payload(dialect, &scan);
        for (place, byte) in changes {
            let place = place % bytes.len();
            bytes[place] = byte;
        }
        let keep = if cut % 3 == 0 { cut % bytes.len() } else { bytes.len() };
        bytes.truncate(keep);
        bytes
    });
    let worded = ("s[RWMEAFS][ANF] [A-Za-z]{1,12} ", any::<Vec<u8>>());
    let worded = worded.prop_map(|(word, body)| [word.as_bytes(), &body].concat());
    prop_oneof![2 => changed, 1 => worded, 1 => any::<Vec<u8>>()]
}

#[test]
fn no_payload_makes_a_reader_panic() {
    for dialect in [Dialect::A, Dialect::B] {
        check(1000, hostile_payloads(dialect), |bytes| {
            let Ok(packet) = Packet::parse(dialect, &bytes) else { return Ok(()) };
            let _ = ScanData::parse(&mut packet.fields());
            for request in requests() {
                let _ = request.parse_reply(&packet);
            }
            Ok(())
        });
    }
}

/// Most bytes a framer that does not know its dialect holds: an unfinished frame of each, and one piece.
const HELD_MAX: usize = 2 * (PAYLOAD_MAX + 16) + 4096;

#[test]
fn no_stream_makes_a_session_panic_hang_or_grow() {
    let frames = |d: Dialect| hostile_payloads(d).prop_map(move |p| d.frame(&p)).boxed();
    let lying_start = any::<[u8; 4]>().prop_map(|l| [&[2, 2, 2, 2, 0][..], &l[1..], b"s"].concat());
    let chunk = prop_oneof![frames(Dialect::A), frames(Dialect::B), lying_start, any::<Vec<u8>>()];
    let steps = prop::collection::vec((chunk, 0.0..2.0f64), 1..30);
    check(300, steps, |steps| {
        let mut session = Session::new(Settings::of(&LadarConfig::default()));
        let mut now = Timestamp::from_ns(0);
        for (bytes, seconds) in steps {
            now = now.plus_seconds(seconds);
            session.on_time(now);
            let mut actions = 0;
            while let Some(action) = session.poll() {
                actions += 1;
                prop_assert!(actions < 100, "the session asks without end");
                if action == Action::Connect {
                    session.connected(now);
                }
            }
            session.received(now, &bytes);
            prop_assert!(session.bytes_held() <= HELD_MAX);
        }
        Ok(())
    });
}

#[test]
fn a_framer_fed_with_two_megabytes_that_never_end_stays_small() {
    for start in [&b"\x02"[..], b"\x02\x02\x02\x02\x00\x00\xff\xffs", b"\x02\x02\x02\x02\xff\xff\xff\xff"] {
        let mut framer = StreamFramer::new(None);
        framer.feed(start);
        for _ in 0..500 {
            framer.feed(&[b's'; 4096]);
            assert!(framer.held() <= HELD_MAX, "{}", framer.held());
        }
    }
}
