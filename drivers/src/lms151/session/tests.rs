//! The session against a device made of a few lines, in one thread, with time as a number.

use super::*;
use crate::lms151::scan_data::Channel;
use crate::lms151::telegram::{Verb, payload};

/// A device: answers in its dialect, measures `measuring_after` status questions after its start.
struct Device {
    dialect: Dialect,
    config: (u32, u32),
    polls_until_measuring: u32,
    contamination: u8,
    /// Error answers by request name, each given once, in order.
    faults: Vec<(&'static str, u16)>,
    /// Names it never answers.
    mute: Vec<&'static str>,
    asked: Vec<String>,
    scans_sent: u16,
}

struct Bench {
    session: Session,
    device: Device,
    now_s: f64,
    connected: bool,
    refuses_connections: bool,
    states: Vec<&'static str>,
    connects_at_s: Vec<f64>,
    scans: Vec<ScanData>,
}

impl Device {
    fn new(dialect: Dialect) -> Self {
        Self {
            dialect,
            config: (5000, 5000),
            polls_until_measuring: 2,
            contamination: 0,
            faults: vec![],
            mute: vec![],
            asked: vec![],
            scans_sent: 0,
        }
    }

    fn frame(&self, verb: Verb, name: &str, fields: impl FnOnce(&mut crate::lms151::fields::Writer)) -> Vec<u8> {
        self.dialect.frame(&payload(self.dialect, verb, name, fields))
    }

    fn take(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut framer = StreamFramer::new(Some(self.dialect));
        framer.feed(bytes).iter().flat_map(|p| self.answer(&Packet::parse(self.dialect, p).unwrap())).collect()
    }

    fn answer(&mut self, request: &Packet<'_>) -> Vec<u8> {
        let name = request.name;
        self.asked.push(format!("{} {name}", request.verb.as_str()));
        if self.mute.contains(&name) {
            return vec![];
        }
        if let Some(i) = self.faults.iter().position(|(n, _)| *n == name) {
            let (_, code) = self.faults.remove(i);
            let fault = if self.dialect == Dialect::A {
                format!("sFA {code:X}").into_bytes()
            } else {
                [&b"sFA"[..], &code.to_be_bytes()].concat()
            };
            return self.dialect.frame(&fault);
        }
        let (frequency, step) = self.config;
        match (request.verb, name) {
            (Verb::Read, "FirmwareVersion") => self.frame(Verb::ReadAnswer, name, |w| {
                w.text("V1.80", 2);
            }),
            (Verb::Read, "DeviceIdent") => self.frame(Verb::ReadAnswer, name, |w| {
                w.text("LMS151", 2).text("V1", 2);
            }),
            (Verb::Read, "LMPscancfg") => self.frame(Verb::ReadAnswer, name, |w| {
                w.u32(frequency).u16(1).u32(step).i32(-450_000).i32(2_250_000);
            }),
            (Verb::Method, "mLMPsetscancfg") => {
                let mut fields = request.fields();
                let status = u8::from(fields.u32("f").unwrap() == 9999);
                self.frame(Verb::MethodAnswer, name, |w| {
                    w.u8(status).u32(frequency).u16(1).u32(step).i32(-450_000).i32(2_250_000);
                })
            }
            (Verb::Read, "STlms") => {
                self.polls_until_measuring = self.polls_until_measuring.saturating_sub(1);
                let state = if self.polls_until_measuring == 0 { 7 } else { 5 };
                self.frame(Verb::ReadAnswer, name, |w| {
                    w.u8(state).u8(0);
                })
            }
            (Verb::Read, _) => {
                let level = self.contamination;
                self.frame(Verb::ReadAnswer, name, |w| {
                    w.u8(level);
                })
            }
            (Verb::Write, _) => self.frame(Verb::WriteAnswer, name, |_| {}),
            (Verb::Subscribe, _) => self.frame(Verb::SubscribeAnswer, name, |_| {}),
            (_, _) => {
                let result = u8::from(name == "SetAccessMode" || name == "Run");
                self.frame(Verb::MethodAnswer, name, |w| {
                    w.u8(result);
                })
            }
        }
    }

    fn scan(&mut self) -> Vec<u8> {
        self.scans_sent += 1;
        let channel = Channel {
            name: *b"DIST1",
            scale: 1.0,
            offset: 0.0,
            start_e4_deg: -450_000,
            step_e4_deg: 5000,
            raw: vec![1000; 541],
        };
        let scan = ScanData {
            telegram_counter: self.scans_sent,
            scan_frequency_centihz: 5000,
            channels_16: vec![channel],
            ..ScanData::default()
        };
        self.frame(Verb::Event, "LMDscandata", |w| scan.emit(w))
    }
}

fn settings(dialect: DialectChoice) -> Settings {
    Settings::of(&Config { dialect, ..Config::default() })
}

impl Bench {
    fn new(settings: Settings, device: Device) -> Self {
        Self {
            session: Session::new(settings),
            device,
            now_s: 0.0,
            connected: false,
            refuses_connections: false,
            states: vec![],
            connects_at_s: vec![],
            scans: vec![],
        }
    }

    fn now(&self) -> Timestamp {
        Timestamp::from_seconds(self.now_s)
    }

    fn feed(&mut self, bytes: &[u8]) {
        self.session.received(self.now(), bytes);
        self.settle();
    }

    /// Does what the session asks for until it asks for nothing.
    fn settle(&mut self) {
        for _ in 0..1000 {
            match self.session.poll() {
                None => return,
                Some(Action::Connect) => {
                    self.connects_at_s.push(self.now_s);
                    if self.refuses_connections {
                        self.session.connection_lost(self.now(), "refused");
                    } else {
                        self.connected = true;
                        self.session.connected(self.now());
                    }
                }
                Some(Action::Send(bytes)) => {
                    let answer = self.device.take(&bytes);
                    self.session.received(self.now(), &answer);
                }
                Some(Action::Disconnect) => self.connected = false,
                Some(Action::Scan(data, _)) => self.scans.push(*data),
                Some(Action::Entered(state, _)) => {
                    if self.states.last() != Some(&state.as_str()) {
                        self.states.push(state.as_str());
                    }
                }
            }
        }
        panic!("the session never settles");
    }

    /// Jumps from deadline to deadline for `seconds`; the device sends a scan every 20 ms if `scans`.
    fn run(&mut self, seconds: f64, scans: bool) {
        let end_s = self.now_s + seconds;
        let mut next_scan_s = self.now_s;
        loop {
            let deadline_s = self.session.next_deadline().map_or(f64::MAX, |d| d.as_seconds());
            let next_s = if scans { next_scan_s } else { f64::MAX }.min(deadline_s.max(self.now_s)).min(end_s);
            self.now_s = next_s;
            if scans && self.now_s >= next_scan_s {
                let scan = self.device.scan();
                self.feed(&scan);
                next_scan_s += 0.02;
            }
            self.session.on_time(self.now());
            self.settle();
            if self.now_s >= end_s {
                return;
            }
        }
    }

    fn state(&self) -> &'static str {
        self.session.state().0.as_str()
    }
}

#[test]
fn a_device_that_turns_as_wanted_is_configured_started_and_read_in_either_dialect() {
    use DialectChoice::*;
    for (choice, dialect) in [(A, Dialect::A), (B, Dialect::B), (Auto, Dialect::A), (Auto, Dialect::B)] {
        let mut bench = Bench::new(settings(choice), Device::new(dialect));
        bench.run(1.8, false);
        bench.run(1.0, true);
        let asked = [
            "sRN FirmwareVersion",
            "sRN DeviceIdent",
            "sEN LMDscandata",
            "sMN SetAccessMode",
            "sRN LMPscancfg",
            "sWN LMDscandatacfg",
            "sWN LMPoutputRange",
            "sMN LMCstartmeas",
            "sMN Run",
            "sRN STlms",
            "sRN STlms",
            "sEN LMDscandata",
            "sRN LCMstate",
        ];
        assert_eq!(bench.device.asked[..13], asked, "{choice:?} {dialect}");
        let states = ["connecting", "logging in", "configuring", "spinning up", "measuring"];
        assert!(bench.states.ends_with(&states) || bench.states == states[1..], "{:?}", bench.states);
        assert!(bench.scans.len() >= 49, "{}", bench.scans.len());
        assert_eq!(bench.session.contamination(), 0);
        assert_eq!((bench.session.dialect(), &bench.session.identity().firmware[..]), (Some(dialect), "V1.80"));
    }
}

#[test]
fn a_device_set_otherwise_is_stopped_and_set() {
    let mut device = Device::new(Dialect::B);
    device.config = (2500, 2500);
    let mut bench = Bench::new(settings(DialectChoice::B), device);
    bench.run(0.1, false);
    let changed = ["sRN LMPscancfg", "sMN LMCstopmeas", "sMN mLMPsetscancfg", "sWN LMDscandatacfg"];
    assert_eq!(bench.device.asked[4..8], changed);
}

#[test]
fn left_as_it_is_a_measuring_device_is_only_subscribed_to() {
    let mut device = Device::new(Dialect::A);
    device.polls_until_measuring = 1;
    let mut bench = Bench::new(Settings::as_it_is("x:2111", DialectChoice::Auto), device);
    bench.run(0.1, false);
    assert_eq!(bench.device.asked[2..5], ["sEN LMDscandata", "sRN STlms", "sEN LMDscandata"]);
}

#[test]
fn telegrams_of_a_running_stream_are_flushed_and_interleaved_events_ignored() {
    let mut device = Device::new(Dialect::B);
    let stray = device.scan();
    device.mute = vec!["FirmwareVersion"];
    let mut bench = Bench::new(settings(DialectChoice::Auto), device);
    bench.run(0.01, false);
    // The stream shows the dialect before any answer does; half a telegram first, as when joining in the middle.
    bench.feed(&stray[500..]);
    bench.feed(&stray);
    bench.device.mute.clear();
    let event = bench.device.frame(Verb::Event, "LIDoutputstate", |w| {
        w.u32(1);
    });
    bench.feed(&event);
    bench.run(4.0, false);
    bench.run(0.5, true);
    let counts = bench.session.counts();
    assert_eq!((counts.scans_flushed, counts.events_ignored), (1, 1));
    assert_eq!(bench.state(), "measuring");
}

#[test]
fn error_answers_lead_to_a_log_in_a_retry_or_a_refusal() {
    let with = |faults: Vec<(&'static str, u16)>| {
        let mut device = Device::new(Dialect::A);
        device.faults = faults;
        let mut bench = Bench::new(settings(DialectChoice::A), device);
        bench.run(1.8, false);
        let log_ins = bench.device.asked.iter().filter(|a| a.ends_with("SetAccessMode")).count();
        (log_ins, bench.state(), bench.session.state().1.to_string(), bench.connects_at_s)
    };
    let (log_ins, state, ..) = with(vec![("LMDscandatacfg", 1)]);
    assert_eq!((log_ins, state), (2, "spinning up"));
    let (log_ins, state, ..) = with(vec![("LMDscandatacfg", 0xD), ("LMDscandatacfg", 0xD)]);
    assert_eq!((log_ins, state), (1, "spinning up"));
    let (log_ins, state, why, connects) = with(vec![("LMDscandatacfg", 5)]);
    assert_eq!((log_ins, state, connects.len()), (1, "refused", 1));
    assert!(why.starts_with("LMDscandatacfg answered with error 5 (invalid data)"), "{why}");
    // What an older device does not know is passed over.
    let (_, state, ..) = with(vec![("LMPscancfg", 3), ("mLMPsetscancfg", 2), ("DeviceIdent", 3), ("LCMstate", 3)]);
    assert_eq!(state, "spinning up");
    let (log_ins, state, ..) = with(vec![("LMCstartmeas", 1); 9]);
    assert_eq!((log_ins, state), (LOG_INS_MAX as usize, "refused"));
}

#[test]
fn a_pair_of_rate_and_resolution_that_is_refused_says_which_key_to_mend() {
    let mut wanted = settings(DialectChoice::A);
    wanted.measurement.as_mut().unwrap().scan.frequency_centihz = 9999;
    let mut bench = Bench::new(wanted, Device::new(Dialect::A));
    bench.run(1.0, false);
    let (state, why) = bench.session.state();
    assert_eq!(state, State::Refused);
    assert!(why.contains("status 1 (bad frequency)") && why.contains("frequency_hz"), "{why}");
}

#[test]
fn an_unanswered_request_is_made_three_times_and_then_the_connection_again() {
    let mut device = Device::new(Dialect::A);
    device.mute = vec!["LMDscandatacfg"];
    let mut bench = Bench::new(settings(DialectChoice::A), device);
    bench.run(9.4, false);
    assert_eq!(bench.device.asked.iter().filter(|a| a.ends_with("LMDscandatacfg")).count(), 3);
    assert_eq!((bench.connected, bench.session.counts().retries), (false, 2));
    let why = bench.session.state().1.to_string();
    assert!(why.starts_with("no answer to LMDscandatacfg in 3 attempts (CoLa-A)"), "{why}");
    bench.run(0.2, false);
    assert_eq!(bench.connects_at_s, [0.0, 9.5]);
}

#[test]
fn pauses_between_connections_grow_to_eight_seconds() {
    let mut bench = Bench::new(settings(DialectChoice::A), Device::new(Dialect::A));
    bench.refuses_connections = true;
    bench.run(40.0, false);
    assert_eq!(bench.connects_at_s, [0.0, 0.5, 1.5, 3.5, 7.5, 15.5, 23.5, 31.5, 39.5]);
}

#[test]
fn a_port_that_answers_in_no_dialect_is_named_as_such() {
    let mut device = Device::new(Dialect::A);
    device.mute = vec!["FirmwareVersion"];
    let mut bench = Bench::new(settings(DialectChoice::Auto), device);
    bench.run(3.2, false);
    assert!(bench.session.state().1.starts_with("no answer in CoLa-A or CoLa-B"), "{}", bench.session.state().1);
}

#[test]
fn a_device_that_never_measures_is_given_up_after_a_minute_at_two_questions_a_second() {
    let mut device = Device::new(Dialect::A);
    device.polls_until_measuring = 1_000_000;
    let mut bench = Bench::new(settings(DialectChoice::A), device);
    bench.run(60.4, false);
    let (_, why) = bench.session.state();
    assert!(why.starts_with("not measuring 60 s after the start: state 5 (preparing)"), "{why}");
    let polls = bench.device.asked.iter().filter(|a| a.ends_with("STlms")).count();
    assert!((119..=122).contains(&polls), "{polls}");
}

#[test]
fn silence_degrades_after_three_periods_and_reconnects_after_half_a_second() {
    let mut bench = Bench::new(settings(DialectChoice::B), Device::new(Dialect::B));
    bench.run(1.0, false);
    bench.run(1.0, true);
    assert_eq!(bench.state(), "measuring");
    bench.run(0.03, false);
    assert_eq!(bench.state(), "measuring");
    bench.run(0.04, false);
    assert_eq!(bench.state(), "degraded");
    bench.run(0.05, true);
    assert_eq!(bench.state(), "degraded", "one scan does not make a stream");
    bench.run(0.3, true);
    assert_eq!(bench.state(), "measuring");
    bench.run(0.52, false);
    assert_eq!((bench.state(), bench.connected), ("stale", false));
    bench.run(1.0, false);
    bench.run(0.5, true);
    assert_eq!((bench.state(), bench.session.counts().connections), ("measuring", 2));
}

#[test]
fn dirt_and_a_wrong_setting_are_said_while_scans_arrive() {
    let mut device = Device::new(Dialect::A);
    device.contamination = 1;
    let mut bench = Bench::new(settings(DialectChoice::A), device);
    bench.run(1.0, false);
    bench.run(0.2, true);
    assert_eq!(bench.session.state(), (State::Degraded, "window is getting dirty: clean it"));
    bench.device.contamination = 0;
    bench.run(11.0, true);
    assert_eq!(bench.state(), "measuring");
    let mut wanted = settings(DialectChoice::A);
    wanted.measurement.as_mut().unwrap().scan.step_e4_deg = 2500;
    let mut bench = Bench::new(wanted, Device::new(Dialect::A));
    bench.run(1.0, false);
    bench.run(0.2, true);
    assert!(bench.session.state().1.starts_with("device measures at 50 Hz and 0.5 degrees, which is not"));
}

#[test]
fn standby_turns_the_laser_off_and_back_on() {
    let mut bench = Bench::new(settings(DialectChoice::A), Device::new(Dialect::A));
    bench.run(1.0, false);
    bench.run(0.1, true);
    bench.session.stand_by(bench.now());
    bench.settle();
    assert_eq!(bench.state(), "standby");
    let last: Vec<&str> = bench.device.asked.iter().rev().take(4).rev().map(String::as_str).collect();
    assert_eq!(last, ["sEN LMDscandata", "sMN SetAccessMode", "sMN LMCstandby", "sMN Run"]);
    bench.run(60.0, false);
    assert_eq!(bench.state(), "standby");
    bench.session.resume(bench.now());
    bench.run(1.0, false);
    bench.run(0.1, true);
    assert_eq!(bench.state(), "measuring");
}

#[test]
fn shutting_down_cancels_the_stream_and_does_not_wait_for_ever() {
    for mute in [vec![], vec!["LMDscandata"]] {
        let mut bench = Bench::new(settings(DialectChoice::A), Device::new(Dialect::A));
        bench.run(1.0, false);
        bench.run(0.1, true);
        bench.device.mute = mute;
        bench.session.shut_down(bench.now());
        bench.settle();
        bench.run(0.6, false);
        assert_eq!((bench.state(), bench.connected), ("closed", false));
        assert_eq!(bench.device.asked.last().unwrap(), "sEN LMDscandata");
        assert_eq!(bench.session.next_deadline(), None);
    }
}

#[test]
fn the_next_connection_starts_with_the_dialect_found() {
    let mut bench = Bench::new(settings(DialectChoice::Auto), Device::new(Dialect::B));
    bench.run(2.0, false);
    bench.run(0.1, true);
    let retries = bench.session.counts().retries;
    assert_eq!(retries, 1, "port 2111 is guessed to speak CoLa-A");
    bench.session.connection_lost(bench.now(), "reset by peer");
    bench.run(2.0, false);
    bench.run(0.1, true);
    assert_eq!((bench.state(), bench.session.counts().retries), ("measuring", retries));
}
