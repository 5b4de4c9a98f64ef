//! A world started on free ports, spoken to as a foreign client would: every wire, byte by byte.
#![allow(clippy::disallowed_methods, reason = "a test is a client with sockets")]

use rustix::fs::{Mode, OFlags};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;
use tsense_simulator::{
    Faults, GposOptions, Lms151Options, Motion, ORIGIN_M, PanTiltOptions, SceneName, VehicleOptions, World, WorldClock,
    WorldOptions,
};

fn options(name: &str) -> WorldOptions {
    let any = "127.0.0.1:0".to_owned();
    let link = std::env::temp_dir().join(format!("tsense-simulator-test-{}-{name}", std::process::id()));
    WorldOptions {
        scene: SceneName::Flat,
        vehicle: VehicleOptions { motion: Motion::Stand, ..VehicleOptions::default() },
        lms151: Some(Lms151Options { address: any.clone(), spin_up_s: 0.3, ..Lms151Options::default() }),
        pan_tilt: Some(PanTiltOptions { link: link.display().to_string(), ..PanTiltOptions::default() }),
        gpos: Some(GposOptions { address: any, ..GposOptions::default() }),
        ..WorldOptions::default()
    }
}

fn start(options: &WorldOptions, speed: f64) -> World {
    World::start(options, WorldClock::starting_now(speed)).unwrap()
}

struct Client {
    socket: TcpStream,
    buffer: Vec<u8>,
}

impl Client {
    fn connect(address: Option<SocketAddr>) -> Self {
        let socket = TcpStream::connect(address.unwrap()).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        Self { socket, buffer: Vec::new() }
    }

    fn fill(&mut self) {
        let mut chunk = [0; 4096];
        let n = self.socket.read(&mut chunk).unwrap();
        assert!(n > 0, "the device hung up");
        self.buffer.extend_from_slice(&chunk[..n]);
    }

    /// The next CoLa-A telegram's text.
    fn text(&mut self) -> String {
        loop {
            if let Some(end) = self.buffer.iter().position(|b| *b == 3) {
                let frame: Vec<u8> = self.buffer.drain(..=end).collect();
                let start = frame.iter().position(|b| *b == 2).unwrap() + 1;
                return String::from_utf8(frame[start..end].to_vec()).unwrap();
            }
            self.fill();
        }
    }

    /// The next CoLa-B telegram's payload, its checksum checked.
    fn binary(&mut self) -> Vec<u8> {
        loop {
            if let Some(length) = self.buffer.get(4..8) {
                let length = u32::from_be_bytes(length.try_into().unwrap()) as usize;
                if self.buffer.len() >= length + 9 {
                    let frame: Vec<u8> = self.buffer.drain(..length + 9).collect();
                    assert_eq!(frame[..4], [2; 4]);
                    let payload = &frame[8..8 + length];
                    assert_eq!(frame[8 + length], payload.iter().fold(0, |x, b| x ^ b));
                    return payload.to_vec();
                }
            }
            self.fill();
        }
    }

    fn ask(&mut self, request: &str) -> String {
        self.socket.write_all(format!("\x02{request}\x03").as_bytes()).unwrap();
        self.text()
    }

    fn ask_binary(&mut self, payload: &[u8]) -> Vec<u8> {
        let checksum = payload.iter().fold(0, |x, b| x ^ b);
        let length = (payload.len() as u32).to_be_bytes();
        self.socket.write_all(&[&[2; 4], &length[..], payload, &[checksum]].concat()).unwrap();
        self.binary()
    }

    fn until_measuring(&mut self) {
        for _ in 0..100 {
            if self.ask("sRN STlms").starts_with("sRA STlms 7 ") {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("never ready");
    }
}

/// Fields of a text scan: telegram counter, scan time, the distances.
fn scan(text: &str) -> (u32, u32, Vec<u32>) {
    let fields: Vec<&str> = text.split(' ').collect();
    let number = |i: usize| u32::from_str_radix(fields[i], 16).unwrap();
    assert_eq!((fields[1], fields[20]), ("LMDscandata", "DIST1"));
    let count = number(25) as usize;
    (number(7), number(9), (26..26 + count).map(number).collect())
}

#[test]
fn a_text_session_logs_in_configures_and_streams() {
    let world = start(&options("text"), 1.0);
    let mut client = Client::connect(world.addresses().lms151);
    assert_eq!(client.ask("sMN mLMPsetscancfg 1388 1 1388 FFF92230 225510"), "sFA 1");
    assert_eq!(client.ask("sMN SetAccessMode 03 F4724744"), "sAN SetAccessMode 1");
    assert_eq!(
        client.ask("sMN mLMPsetscancfg 1388 1 1388 FFF92230 225510"),
        "sAN mLMPsetscancfg 0 1388 1 1388 FFF92230 225510"
    );
    assert_eq!(client.ask("sWN LMDscandatacfg 01 00 0 1 0 00 00 0 0 0 1 1"), "sWA LMDscandatacfg");
    assert_eq!(client.ask("sMN LMCstartmeas"), "sAN LMCstartmeas 0");
    assert_eq!(client.ask("sMN Run"), "sAN Run 1");
    client.until_measuring();
    assert_eq!(client.ask("sEN LMDscandata 1"), "sEA LMDscandata 1");
    let scans: Vec<_> = (0..10).map(|_| scan(&client.text())).collect();
    let mut skipped = 0;
    for pair in scans.windows(2) {
        assert_eq!(pair[1].0, pair[0].0 + 1, "no telegram is lost");
        let step_us = pair[1].1.wrapping_sub(pair[0].1);
        let turns = step_us / 20_114;
        assert!((20_114 * turns..=20_115 * turns).contains(&step_us), "{step_us}");
        skipped += u64::from(turns) - 1;
    }
    // A machine that is too slow lets turns go, and says how many.
    assert!(skipped <= world.counts().turns_skipped, "{skipped}");
    assert!(scans.iter().all(|s| s.2.len() == 541));
    world.stop();
}

#[test]
fn a_binary_session_beside_a_text_one_gets_the_same_scans() {
    let world = start(&options("both"), 1.0);
    let mut text = Client::connect(world.addresses().lms151);
    text.until_measuring();
    let mut binary = Client::connect(world.addresses().lms151);
    assert_eq!(binary.ask_binary(b"sMN SetAccessMode \x03\xf4rGD"), b"sAN SetAccessMode \x01");
    assert_eq!(binary.ask_binary(b"sEN LMDscandata \x01"), b"sEA LMDscandata \x01");
    assert_eq!(text.ask("sEN LMDscandata 1"), "sEA LMDscandata 1");
    let of_text: Vec<_> = (0..5).map(|_| scan(&text.text())).collect();
    let of_binary: Vec<Vec<u8>> = (0..12).map(|_| binary.binary()).filter(|p| p.starts_with(b"sSN ")).collect();
    let mut compared = 0;
    for payload in &of_binary {
        let body = &payload[b"sSN LMDscandata ".len()..];
        let counter = u32::from(u16::from_be_bytes([body[10], body[11]]));
        let Some((_, _, distances)) = of_text.iter().find(|s| s.0 == counter) else { continue };
        let at = payload.windows(5).position(|w| w == b"DIST1").unwrap() + 5 + 16;
        let values: Vec<u32> =
            payload[at..at + 1082].chunks(2).map(|v| u32::from(v[0]) << 8 | u32::from(v[1])).collect();
        assert_eq!(&values, distances);
        compared += 1;
    }
    assert!(compared >= 3, "only {compared} scans in common");
    assert!(text.ask("sEN LMDscandata 0").starts_with("s"));
    world.stop();
}

#[test]
fn the_level_scan_ahead_sees_the_scene_at_its_true_ranges() {
    // Standing level, 1.8 m up, on flat ground: a level beam meets no ground within reach but trunks and crowns.
    let world = start(&options("ranges"), 1.0);
    let mut client = Client::connect(world.addresses().lms151);
    client.until_measuring();
    let (_, _, distances) = {
        client.socket.write_all(b"\x02sRN LMDscandata\x03").unwrap();
        let text = client.text();
        assert!(text.starts_with("sRA LMDscandata "));
        scan(&text)
    };
    let sensor = [ORIGIN_M[0] + 10.0, ORIGIN_M[1] + 0.65];
    let mut checked = 0;
    for tree in world.scene().true_trees() {
        let (east, north) = (tree.easting_m - sensor[0], tree.northing_m - sensor[1]);
        let (range, azimuth) = (east.hypot(north), east.atan2(north).to_degrees());
        // Device angles count counter-clockwise from the right: straight ahead (north) is 90.
        let index = ((90.0 - azimuth + 45.0) / 0.5).round();
        if range < 15.0 && (0.0..541.0).contains(&index) {
            let found = f64::from(distances[index as usize]) / 1000.0;
            if found > 0.1 && found < range + 0.5 {
                assert!(found > range - tree.dbh_m - 0.6 || found < range - 1.0, "{found} {range}");
                checked += usize::from((found - range).abs() < 0.6);
            }
        }
    }
    assert!(checked >= 2, "only {checked} trunks stand where they should");
    world.stop();
}

#[test]
fn faults_arrive_as_ordered() {
    let mut options = options("faults");
    let faults =
        Faults { drop_every: 5, fragment_bytes: 97, stray_every: 4, disconnect_after_s: 2.0, ..Faults::default() };
    if let Some(lms151) = &mut options.lms151 {
        lms151.faults = faults;
    }
    let world = start(&options, 1.0);
    let mut client = Client::connect(world.addresses().lms151);
    client.until_measuring();
    client.ask("sEN LMDscandata 1");
    let telegrams: Vec<String> = (0..20).map(|_| client.text()).collect();
    assert!(telegrams.iter().any(|t| t.starts_with("sSN LIDoutputstate ")));
    let counters: Vec<u32> = telegrams.iter().filter(|t| t.starts_with("sSN LMDscandata")).map(|t| scan(t).0).collect();
    assert!(counters.windows(2).any(|w| w[1] == w[0] + 2), "a gap: {counters:?}");
    let mut sink = Vec::new();
    // Cut in the middle or between telegrams: either an end or an error.
    let _ = client.socket.read_to_end(&mut sink);
    world.stop();
}

#[test]
fn the_position_system_tells_where_the_vehicle_is() {
    let world = start(&options("gpos"), 2.0);
    let socket = TcpStream::connect(world.addresses().gpos.unwrap()).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let mut lines = BufReader::new(socket).lines().map(Result::unwrap);
    let mut kinds = std::collections::BTreeSet::new();
    for line in lines.by_ref().take(300) {
        let (body, check) = line[1..].split_once('*').unwrap();
        assert_eq!(u8::from_str_radix(check, 16).unwrap(), body.bytes().fold(0, |x, b| x ^ b), "{line}");
        let fields: Vec<&str> = body.split(',').collect();
        kinds.insert(fields[0].to_owned());
        if fields[0] == "GPGGA" {
            assert!(fields[2].starts_with("2938.04") && fields[3] == "N", "{line}");
            assert!(fields[4].starts_with("08221.1") && fields[5] == "W", "{line}");
        }
    }
    let expected = ["GPGGA", "GPHDT", "GPRMC", "GPVTG", "GPZDA", "PASHR"];
    assert_eq!(kinds.iter().map(String::as_str).collect::<Vec<_>>(), expected);
    world.stop();
}

#[test]
fn the_pan_tilt_unit_answers_on_its_terminal_and_the_head_really_turns() {
    let options = options("pan-tilt");
    let world = start(&options, 1.0);
    let link = world.addresses().pan_tilt.clone().unwrap();
    let line = rustix::fs::open(&link, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap();
    let mut line = std::fs::File::from(line);
    let read_until = |end: &str, line: &mut std::fs::File| {
        let mut text = String::new();
        let mut byte = [0];
        while !text.ends_with(end) && text.len() < 100 {
            line.read_exact(&mut byte).unwrap();
            text.push(char::from(byte[0]));
        }
        text
    };
    let before = world.clock().now();
    line.write_all(b"PR ").unwrap();
    assert_eq!(read_until("\r\n", &mut line), "PR * 46.2857 seconds arc per position\r\n");
    // 3 bytes of request, 1.5 ms of thought, 36 bytes of answer at 9600 baud: 3.1 + 1.5 + 37.5 = 42.1 ms.
    assert!(world.clock().now().seconds_since(before) > 0.042);
    line.write_all(b"ED ").unwrap();
    assert_eq!(read_until("\r\n", &mut line), "ED *\r\n");
    line.write_all(b"FT TP-700 A TP ").unwrap();
    assert_eq!(read_until("-700\r\n", &mut line), "*\r\n*\r\n*\r\n* -700\r\n");
    let tilt_deg = world.angles(world.clock().now()).tilt_rad.to_degrees();
    assert!((tilt_deg + 9.0).abs() < 0.01, "{tilt_deg}");
    drop(line);
    world.stop();
    assert!(link.symlink_metadata().is_err(), "the link is gone");
}

#[test]
fn an_address_in_use_is_refused_with_advice() {
    let world = start(&options("taken"), 1.0);
    let mut other = options("taken-too");
    other.pan_tilt = None;
    other.gpos.as_mut().unwrap().address = world.addresses().gpos.unwrap().to_string();
    let error = World::start(&other, WorldClock::starting_now(1.0)).unwrap_err().to_string();
    assert!(error.contains("position system") && error.contains("port 0"), "{error}");
}
