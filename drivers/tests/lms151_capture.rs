//! The LMS-151 driver against a real LMS111's own bytes: every frame of a recorded exchange, and a server that replays it.
//!
//! The capture is not part of this repository; where it is absent the tests say so and pass.
#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    reason = "tests: a server on loopback, and what was skipped"
)]

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc;
use std::time::{Duration, Instant};
use tsense_contract::ReturnKind;
use tsense_drivers::lms151::assemble::{AssembledScan, Assembler, Dropped};
use tsense_drivers::lms151::config::{Config, DialectChoice};
use tsense_drivers::lms151::fields::latin1;
use tsense_drivers::lms151::scan_data::{self, ScanData};
use tsense_drivers::lms151::session::{Session, Settings, State};
use tsense_drivers::lms151::shell::link::{Happened, Link};
use tsense_drivers::lms151::telegram::{Dialect, Packet, StreamFramer, Verb, payload};
use tsense_drivers::lms151::{cola_b, shell};
use tsense_geometry::Timestamp;

const SHARED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");

/// One TCP payload of the capture and when it passed, seconds.
struct Piece {
    at_s: f64,
    bytes: Vec<u8>,
}

/// The capture's pieces in order. The file is JSON with one key a line, so two keys are all that has to be read.
fn capture() -> Option<Vec<Piece>> {
    let path = format!("{SHARED}/captures/lms111_cola_b.pcapng.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("SKIPPED: {path} not found");
        return None;
    };
    let value = |line: &str| line.split('"').nth(3).map(str::to_string);
    let mut pieces = Vec::new();
    let mut at_s = 0.0;
    for line in text.lines() {
        if line.contains("\"tcp.time_relative\"") {
            at_s = value(line).unwrap().parse().unwrap();
        } else if line.contains("\"tcp.payload\"") {
            let bytes = value(line).unwrap().split(':').map(|b| u8::from_str_radix(b, 16).unwrap()).collect();
            pieces.push(Piece { at_s, bytes });
        }
    }
    Some(pieces)
}

/// The payloads of a stream, and nothing may be left, skipped or bad.
fn payloads(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut framer = StreamFramer::new(Some(Dialect::B));
    let payloads = framer.feed(bytes);
    let counts = framer.counts();
    assert_eq!((counts.frames, counts.bad_frames, counts.bytes_skipped), (payloads.len() as u64, 0, 0));
    assert_eq!(framer.held(), 0);
    payloads
}

fn scan_of(payload: &[u8]) -> Option<ScanData> {
    let packet = Packet::parse(Dialect::B, payload).unwrap();
    if packet.verb != Verb::Event || packet.name != scan_data::NAME {
        return None;
    }
    let mut fields = packet.fields();
    let scan = ScanData::parse(&mut fields).unwrap();
    fields.finish().expect("no byte left behind the last field");
    Some(scan)
}

#[test]
fn all_frames_of_the_capture_decode_with_no_byte_left_and_go_back_to_the_same_bytes() {
    let Some(pieces) = capture() else { return };
    let stream: Vec<u8> = pieces.iter().flat_map(|p| p.bytes.clone()).collect();
    let payloads = payloads(&stream);
    assert_eq!((pieces.len(), payloads.len()), (277, 277));
    let mut scans = 0;
    for (payload, piece) in payloads.iter().zip(&pieces) {
        assert_eq!(cola_b::encode(payload), piece.bytes);
        let Some(scan) = scan_of(payload) else { continue };
        scans += 1;
        let again =
            tsense_drivers::lms151::telegram::payload(Dialect::B, Verb::Event, scan_data::NAME, |w| scan.emit(w));
        assert!(again == *payload, "scan {scans} is not written as it was read");
    }
    assert_eq!(scans, 175);
}

#[test]
fn the_scans_are_what_the_device_measured() {
    let Some(pieces) = capture() else { return };
    let mut assembler = Assembler::new(&Config::default());
    let (mut scans, mut late_s) = (Vec::new(), Vec::new());
    for piece in &pieces {
        let Some(data) = scan_of(&payloads(&piece.bytes)[0]) else { continue };
        let received = Timestamp::from_seconds(piece.at_s);
        match assembler.take(&data, received, 0) {
            Ok(scan) => {
                late_s.push(received.seconds_since(Timestamp::from_ns(scan.header.stamp_ns)));
                scans.push((data, scan));
            }
            Err(why) => assert_eq!(why, Dropped::Duplicate),
        }
    }
    let totals = assembler.totals();
    assert_eq!((totals.telegrams, totals.duplicates, totals.lost, totals.restarts), (172, 3, 0, 0));
    let (first, scan) = &scans[0];
    assert_eq!(
        (first.serial, first.scan_frequency_centihz, first.channels_16[0].step_e4_deg),
        (18_090_362, 5000, 5000)
    );
    assert_eq!(scan.returns.len(), 541);
    assert!(scans.iter().all(|(_, s)| s.returns.iter().all(|r| r.kind() != ReturnKind::Reserved)));
    let nearest = scans.iter().flat_map(|(_, s)| &s.returns).filter(|r| r.kind() == ReturnKind::Echo);
    assert_eq!(nearest.map(|r| r.distance_mm).min(), Some(62));
    assert_eq!(scans.iter().filter(|(d, _)| d.status == [1, 0]).count(), 7);
    // Protocol notes 1.5: mean period 20114.5 us, rates some ppm apart. The median of this capture is near the mean.
    let (period_s, clock) = (assembler.period_s().unwrap(), assembler.clock().unwrap());
    println!(
        "period {:.1} us, clock {:+.1} ppm, sigma {:.3} ms",
        period_s * 1e6,
        clock.rate_error * 1e6,
        clock.std_s * 1e3
    );
    assert!((period_s - 20_114.5e-6).abs() < 60e-6, "{period_s}");
    assert!(clock.rate_error.abs() < 60e-6 && clock.std_s < 0.5e-3, "{clock:?}");
    check_stamps(&scans);
}

/// Stamps advance with the device's own clock, whatever the network did.
fn check_stamps(scans: &[(ScanData, AssembledScan)]) {
    for pair in scans.windows(2) {
        let [(a, scan_a), (b, scan_b)] = pair else { continue };
        let device_s = f64::from(b.transmission_time_us.wrapping_sub(a.transmission_time_us)) / 1e6;
        let stamps_s = (scan_b.header.stamp_ns - scan_a.header.stamp_ns) as f64 / 1e9;
        assert!((stamps_s - device_s).abs() < 0.5e-3, "{device_s} s on the device, {stamps_s} s in stamps");
    }
}

#[test]
fn a_real_ascii_telegram_reads_up_to_where_the_sample_was_cut() {
    let path = format!("{SHARED}/captures/lms1xx_ascii_sample.txt");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("SKIPPED: {path} not found");
        return;
    };
    let parse = |text: &str| {
        let packet = Packet::parse(Dialect::A, text.as_bytes()).unwrap();
        let mut fields = packet.fields();
        ScanData::parse(&mut fields).map(|scan| (scan, fields.finish()))
    };
    let fault = parse(text.trim_end()).unwrap_err();
    assert_eq!(fault.field, "data", "541 values are announced and 359 are there");
    // The same bytes with the count put right and the blocks that follow, all absent.
    let whole = format!("{} 0 0 0 0 0 0", text.trim_end().replace(" 21D ", " 167 "));
    let (scan, end) = parse(&whole).unwrap();
    end.unwrap();
    assert_eq!((scan.serial, scan.telegram_counter, scan.scan_counter), (0x153_D067, 0x1FA7, 0x1FAA));
    assert_eq!((scan.outputs, scan.transmission_time_us - scan.scan_time_us), ([7, 0], 0xA3AC));
    let raw = &scan.channels_16[0].raw;
    assert_eq!((raw.len(), raw[0], raw.iter().filter(|r| **r == 3).count()), (359, 0x55, 8));
}

/// What the replaying server does with a request: the recorded answer, or what a device says to what it does not know.
fn recorded_answers(pieces: &[Piece]) -> BTreeMap<Vec<u8>, Vec<u8>> {
    let mut answers = BTreeMap::new();
    let all: Vec<Vec<u8>> = pieces.iter().flat_map(|p| payloads(&p.bytes)).collect();
    for (i, request) in all.iter().enumerate() {
        let packet = Packet::parse(Dialect::B, request).unwrap();
        let wanted = match packet.verb {
            Verb::Read => Verb::ReadAnswer,
            Verb::Write => Verb::WriteAnswer,
            Verb::Method => Verb::MethodAnswer,
            Verb::Subscribe => Verb::SubscribeAnswer,
            _ => continue,
        };
        let is_answer = |p: &&Vec<u8>| {
            let answer = Packet::parse(Dialect::B, p).unwrap();
            answer.verb == wanted && answer.name == packet.name
        };
        if let Some(answer) = all[i..].iter().find(is_answer) {
            answers.insert(request.clone(), answer.clone());
        }
    }
    answers
}

fn answer_to(request: &[u8], recorded: &BTreeMap<Vec<u8>, Vec<u8>>) -> Vec<u8> {
    let packet = Packet::parse(Dialect::B, request).unwrap();
    // The range as the protocol's table has it is answered as the recorded one, three ten-thousandths away.
    let by_name = || recorded.iter().find(|(r, _)| r.starts_with(&request[..3]) && latin1(r).contains(packet.name));
    match (recorded.get(request), packet.verb) {
        (Some(answer), _) => answer.clone(),
        (None, Verb::Subscribe) => payload(Dialect::B, Verb::SubscribeAnswer, packet.name, |w| {
            w.u8(0);
        }),
        (None, Verb::Write) => by_name().map_or(b"sFA\x00\x03".to_vec(), |(_, answer)| answer.clone()),
        (None, Verb::Method) => b"sFA\x00\x02".to_vec(),
        (None, _) => b"sFA\x00\x03".to_vec(),
    }
}

/// Serves one connection: answers, and after a subscription streams the recorded events at their recorded times.
fn serve(mut stream: TcpStream, pieces: &[Piece], asked: &mpsc::Sender<String>) {
    let recorded = recorded_answers(pieces);
    let (mut framer, mut buffer) = (StreamFramer::new(Some(Dialect::B)), [0; 4096]);
    let events: Vec<&Piece> = pieces.iter().filter(|p| p.bytes[8..].starts_with(b"sSN")).collect();
    let mut next_event = events.len();
    // The first event came 78 ms after the subscription; socket time-outs are too coarse for the rest.
    let mut subscribed = Instant::now();
    let due_s = |n: usize| 0.078 + events[n].at_s - events[0].at_s;
    stream.set_nodelay(true).unwrap();
    stream.set_nonblocking(true).unwrap();
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => {
                for request in framer.feed(&buffer[..count]) {
                    asked.send(latin1(&request)).unwrap();
                    stream.write_all(&cola_b::encode(&answer_to(&request, &recorded))).unwrap();
                    if request == b"sEN LMDscandata \x01" {
                        (next_event, subscribed) = (0, Instant::now());
                    } else if request == b"sEN LMDscandata \x00" {
                        next_event = events.len();
                    }
                }
            }
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            Err(_) => return,
        }
        if next_event < events.len() && subscribed.elapsed().as_secs_f64() >= due_s(next_event) {
            stream.write_all(&events[next_event].bytes).unwrap();
            next_event += 1;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
}

fn start_server(pieces: Vec<Piece>) -> (String, mpsc::Receiver<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (sender, asked) = mpsc::channel();
    std::thread::spawn(move || {
        while let Ok((stream, _)) = listener.accept() {
            serve(stream, &pieces, &sender);
        }
    });
    (address, asked)
}

fn clock() -> impl Fn() -> Timestamp {
    let clock = tsense_ports::Clock::start(1.0);
    move || clock.now()
}

#[test]
fn the_driver_runs_against_a_server_that_replays_the_real_device() {
    let Some(pieces) = capture() else { return };
    let (address, asked) = start_server(pieces);
    let config = Config { address: address.clone(), ..Config::default() };
    let mut link = Link::new(&address, Session::new(Settings::of(&config)));
    let mut assembler = Assembler::new(&config);
    let now = clock();
    let (started, mut states, mut scans) = (now(), Vec::new(), Vec::new());
    while now().seconds_since(started) < 20.0 && assembler.totals().telegrams < 172 {
        for happened in link.turn(&now) {
            match happened {
                Happened::Entered(state, _) => states.push(state),
                Happened::Scan(data, received) => {
                    scans.extend(assembler.take(&data, received, 0).ok().map(|scan| (*data, scan)));
                }
            }
        }
    }
    states.dedup();
    assert_eq!((scans.len(), assembler.totals().duplicates), (172, 3));
    let first = [State::Connecting, State::LoggingIn, State::Configuring, State::SpinningUp];
    assert!(states.windows(4).any(|w| w == first), "{states:?}");
    // The first seven scans carry a status that is not good, as recorded.
    assert_eq!(states[states.len() - 2..], [State::Degraded, State::Measuring], "{states:?}");
    let counts = link.session.counts();
    assert_eq!((counts.frames.bad_frames, counts.frames.bytes_skipped, counts.malformed), (0, 0, 0));
    assert!(counts.events_ignored >= 1, "LIDoutputstate came in between");
    link.shut_down(&now);
    drop(link);
    let asked: Vec<String> = asked.try_iter().collect();
    assert_eq!(asked.last().unwrap(), "sEN LMDscandata \u{0}");
    assert!(asked.iter().any(|a| a.starts_with("sMN SetAccessMode")), "{asked:?}");
    let clock = assembler.clock().unwrap();
    // This machine may be busy: the recorded device stayed below 0.1 ms.
    assert!(clock.std_s < 20e-3, "{clock:?}");
    println!("replayed: clock {:+.1} ppm, sigma {:.3} ms", clock.rate_error * 1e6, clock.std_s * 1e3);
}

#[test]
fn the_command_line_reads_scans_and_probes_a_replayed_device() {
    let Some(pieces) = capture() else { return };
    let (address, _asked) = start_server(pieces);
    let mut records = Vec::new();
    shell::device::scan(&address, DialectChoice::Auto, 5, |record| {
        records.push(record.clone());
        true
    })
    .unwrap();
    assert_eq!(records.len(), 5);
    assert_eq!((records[0].telegram_counter, records[0].scan_counter), (0xF768, 4));
    assert_eq!((records[0].start_deg, records[0].step_deg, records[0].distances_mm.len()), (-45.0, 0.5, 541));
    let probe = shell::device::probe(&address, DialectChoice::Auto).unwrap();
    assert_eq!((&probe.dialect[..], probe.firmware.as_deref()), ("CoLa-B", Some("V1.80.2")));
    assert_eq!(
        (probe.location.as_deref(), probe.operating_hours, probe.power_ons),
        (Some("not defined"), Some(111.0), Some(63))
    );
    assert_eq!((probe.identity, probe.streaming), (None, false));
}

#[test]
fn an_address_where_nobody_listens_is_said_to_be_unreachable() {
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let error = shell::device::scan(&address, DialectChoice::Auto, 1, |_| true).unwrap_err();
    assert!(matches!(error, shell::device::DeviceError::Unreachable { .. }), "{error}");
    let error = shell::device::probe(&address, DialectChoice::Auto).unwrap_err();
    assert!(error.to_string().starts_with(&format!("no device answers at {address}: ")), "{error}");
}
