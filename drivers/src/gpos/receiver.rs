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

    /// Takes a fix that came whole at `now`, or why it is none: from a source whose reports are no stream of bytes.
    pub fn receive_fix(&mut self, now: Timestamp, fix: Result<Fix, Reject>) {
        if let Ok(fix) = &fix {
            self.observe(fix.time, now);
        }
        self.take_fix(now, fix);
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
