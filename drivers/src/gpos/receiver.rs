//! From the bytes of a position source to poses: framing, parsing, epochs, clock, grid, watch, in this order.
//!
//! In: bytes with the instant they were read, and the time. Out: [`Event`]s and the next deadline. No line and no
//! clock: the shell (`process.rs`) and the tests own those.

use super::calendar::{Date, DayCounter, SourceTime};
use super::clock::DelayFilter;
use super::config::{Config, Format};
use super::epoch::Assembler;
use super::fix::Fix;
use super::frame::{Found, Frame, Framer, Losses};
use super::nmea::{self, Gga, Pashr, Reject, Sentence};
use super::novatel;
use super::place::Placer;
use super::utm::Zone;
use super::watch::Watch;
use std::collections::{BTreeMap, VecDeque};
use tsense_contract::{POSE_FROZEN, POSE_JUMPED, Pose, PoseQuality, ProcessState};
use tsense_geometry::Timestamp;

/// What the shell is to do or to know.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A pose to be sent.
    Pose(Pose),
    /// The zone was pinned: to be kept for the life of the graph.
    Pinned(Zone),
    /// Things were thrown away: why, and how many.
    Dropped(&'static str, u64),
    /// Something worth a line in the log.
    Notice(String),
}

/// While inertial logs come, NMEA of the same receiver is not used: two sources of one pose would fight, seconds.
const NOVATEL_FIRST_S: f64 = 1.0;
/// Events that wait for the shell at most; it takes them after every call.
const EVENTS_MAX: usize = 1024;
/// Kinds of frames that are told apart in a report.
const KINDS_MAX: usize = 64;
/// Start, eight data and stop bits.
const BITS_PER_BYTE: f64 = 10.0;

/// What a source sent, for `probe`.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Seen {
    /// Frames by kind: sentence names, log names and numbers.
    pub frames: BTreeMap<String, u64>,
    /// The last date the source gave.
    pub date: Option<String>,
}

/// A position source.
pub struct Receiver {
    config: Config,
    byte_s: f64,
    framer: Framer,
    losses: Losses,
    days: DayCounter,
    assembler: Assembler,
    clock: DelayFilter,
    placer: Placer,
    watch: Watch,
    seen: Seen,
    novatel_at: Option<Timestamp>,
    last_time: Option<SourceTime>,
    last_pose: Option<(Timestamp, Pose)>,
    last_reject: Option<Reject>,
    connected: Result<(), String>,
    events: VecDeque<Event>,
}

impl Receiver {
    /// A source of which nothing is known.
    pub fn new(config: &Config) -> Self {
        // A socket delivers a sentence at once, a serial line takes its time over it.
        let byte_s =
            if config.address.starts_with("tcp:") { 0.0 } else { BITS_PER_BYTE / f64::from(config.baud.max(1)) };
        Self {
            config: config.clone(),
            byte_s,
            framer: Framer::default(),
            losses: Losses::default(),
            days: DayCounter::default(),
            assembler: Assembler::new(config),
            clock: DelayFilter::default(),
            placer: Placer::new(config),
            watch: Watch::new(config),
            seen: Seen::default(),
            novatel_at: None,
            last_time: None,
            last_pose: None,
            last_reject: None,
            connected: Err(format!("opening {}", config.address)),
            events: VecDeque::new(),
        }
    }

    /// The next event.
    pub fn event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    fn emit(&mut self, event: Event) {
        if self.events.len() < EVENTS_MAX {
            self.events.push_back(event);
        }
    }

    fn drop_one(&mut self, cause: &'static str) {
        self.emit(Event::Dropped(cause, 1));
    }

    /// A zone kept from before: pinned with the first fix, unless that lies too far from it.
    pub fn remember(&mut self, zone: Zone) {
        self.placer.remember(zone);
    }

    /// What the source sent so far.
    pub fn seen(&self) -> &Seen {
        &self.seen
    }

    /// The line is open: half frames and delays of the old one are forgotten.
    pub fn opened(&mut self) {
        self.framer.clear();
        self.clock.clear();
        self.watch.clear();
        self.connected = Ok(());
    }

    /// The line could not be opened, or broke.
    pub fn closed(&mut self, reason: &str) {
        self.connected = Err(reason.into());
    }

    /// Takes bytes read at `now`.
    pub fn receive(&mut self, now: Timestamp, bytes: &[u8]) {
        self.assembler.touch(now);
        for found in self.framer.push(bytes) {
            self.take_frame(now, found);
        }
        self.count_losses();
        self.tick(now);
    }

    /// Takes note of the time.
    pub fn tick(&mut self, now: Timestamp) {
        if let Some(fix) = self.assembler.tick(now) {
            self.take_fix(now, fix);
        }
    }

    /// When [`Receiver::tick`] has something to do.
    pub fn deadline(&self) -> Option<Timestamp> {
        self.assembler.deadline()
    }

    fn count_losses(&mut self) {
        let now = self.framer.losses();
        let before = std::mem::replace(&mut self.losses, now);
        for (cause, count) in [
            ("bad checksum", now.checksum - before.checksum),
            ("malformed frame", now.malformed - before.malformed),
            ("byte outside of a frame", now.noise_bytes - before.noise_bytes),
        ] {
            if count > 0 {
                self.emit(Event::Dropped(cause, count));
            }
        }
    }

    fn take_frame(&mut self, now: Timestamp, found: Found) {
        self.note_kind(&found.frame);
        // The frame's first byte; the line's time for the rest is no delay of the source.
        let arrival = now.plus_seconds(-(found.bytes_since_start as f64) * self.byte_s);
        let gps_minus_utc_s = self.config.gps_minus_utc_s;
        let fix = match found.frame {
            Frame::Nmea(text) if self.config.format != Format::Novatel => return self.take_nmea(now, arrival, &text),
            Frame::NovatelText(text) if self.config.format != Format::Nmea => {
                novatel::from_text(&text, gps_minus_utc_s)
            }
            Frame::NovatelBinary { id, week, week_ms, body } if self.config.format != Format::Nmea => {
                novatel::from_binary(id, week, week_ms, &body, gps_minus_utc_s)
            }
            _ => return,
        };
        match fix {
            Ok(None) => {}
            Ok(Some(fix)) => {
                self.novatel_at = Some(now);
                self.observe(fix.time, arrival);
                self.take_fix(now, Ok(fix));
            }
            Err(reject) => self.take_fix(now, Err(reject)),
        }
    }

    fn note_kind(&mut self, frame: &Frame) {
        let kind = match frame {
            Frame::Nmea(text) | Frame::NovatelText(text) => text.split(',').next().unwrap_or("").to_string(),
            Frame::NovatelBinary { id, .. } => format!("NovAtel binary {id}"),
        };
        if self.seen.frames.len() < KINDS_MAX || self.seen.frames.contains_key(&kind) {
            *self.seen.frames.entry(kind).or_default() += 1;
        }
    }

    fn take_nmea(&mut self, now: Timestamp, arrival: Timestamp, text: &str) {
        if self.novatel_at.is_some_and(|at| now.seconds_since(at) < NOVATEL_FIRST_S) {
            return;
        }
        let sentence = match nmea::parse(text) {
            Ok(Some(sentence)) => sentence,
            Ok(None) => return,
            Err(reject) => {
                self.last_reject = Some(reject);
                return self.drop_one(reject);
            }
        };
        let (time, date) = match sentence {
            Sentence::Gga(Gga { time, .. }) | Sentence::Pashr(Pashr { time, .. }) => (Some(time), None),
            Sentence::Rmc(time, _, _, date) | Sentence::Zda(time, date) => (Some(time), date),
            Sentence::Gst(time, _) => (Some(time), None),
            Sentence::Hdt(_) | Sentence::Vtg(_) => (None, None),
        };
        self.seen.date = date.as_ref().map(Date::to_string).or(self.seen.date.take());
        let time = time.map(|time| self.days.place(time, arrival));
        if let Some(time) = time {
            self.observe(time, arrival);
        }
        for fix in self.assembler.take(sentence, time, now) {
            self.take_fix(now, fix);
        }
    }

    fn observe(&mut self, time: SourceTime, arrival: Timestamp) {
        let before = self.clock.steps();
        if !self.clock.observe(time, arrival) {
            self.drop_one("time ahead of its arrival");
        }
        if self.clock.steps() != before {
            // Times before and after the step cannot be compared.
            self.last_time = None;
            self.emit(Event::Notice("the source's clock stepped: stamps are fitted anew".into()));
        }
    }

    fn take_fix(&mut self, now: Timestamp, fix: Result<Fix, Reject>) {
        match fix.and_then(|fix| self.pose(&fix)) {
            Ok(pose) => {
                self.last_reject = None;
                self.last_pose = Some((now, pose));
                self.emit(Event::Pose(pose));
            }
            Err(reject) => {
                self.last_reject = Some(reject);
                self.drop_one(reject);
            }
        }
    }

    fn pose(&mut self, fix: &Fix) -> Result<Pose, Reject> {
        if self.last_time.is_some_and(|last| fix.time <= last) {
            return Err("fix repeated or out of order");
        }
        let stamp = self.clock.to_graph(fix.time, self.config.latency_ms / 1e3).ok_or("no clock yet")?;
        let pinned = self.placer.zone();
        let pose = self.placer.place(fix, stamp)?;
        self.last_time = Some(fix.time);
        if let (None, Some(zone)) = (pinned, self.placer.zone()) {
            self.emit(Event::Pinned(zone));
        }
        let pose = self.watch.check(pose);
        for (bit, cause) in [(POSE_FROZEN, "flagged frozen"), (POSE_JUMPED, "flagged jumped")] {
            if pose.flags & bit != 0 {
                self.drop_one(cause);
            }
        }
        Ok(pose)
    }

    /// How the driver is, in words.
    pub fn condition(&self, now: Timestamp) -> (ProcessState, String) {
        let stale = match &self.last_pose {
            Some((at, _)) => now.seconds_since(*at) > self.config.stale_s,
            None => true,
        };
        let silent = if self.last_pose.is_some() { ProcessState::Stale } else { ProcessState::Starting };
        match (&self.connected, &self.last_pose) {
            (Err(reason), _) => (silent, reason.clone()),
            (Ok(()), Some((_, pose))) if !stale => self.condition_of(pose),
            (Ok(()), _) => match self.last_reject {
                Some(reject) => (ProcessState::Stale, format!("no pose: {reject}")),
                None => (silent, format!("no pose for more than {} s", self.config.stale_s)),
            },
        }
    }

    fn condition_of(&self, pose: &Pose) -> (ProcessState, String) {
        let zone = self.placer.zone().map_or(String::new(), |zone| zone.to_string());
        match (pose.flags, pose.quality()) {
            (flags, _) if flags & POSE_FROZEN != 0 => {
                (ProcessState::Degraded, "the position stands while the source reports speed".into())
            }
            (_, PoseQuality::Degraded) => (ProcessState::Degraded, format!("quality degraded, zone {zone}")),
            (_, quality) => (ProcessState::Running, format!("{quality}, zone {zone}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::tests::sentence;
    use super::*;
    use proptest::prelude::*;

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
}
