//! A session with the pan-tilt unit as a state machine: wake it, ask what it is, set it up, nod and poll.
//!
//! In: bytes and instants, whether the line is open, whether the head may move. Out: bytes to write, [`Event`]s and
//! the next deadline. No clock, no line: the shell (`process.rs`) and the tests own those.
//!
//! Closed -> waking (bare delimiter, `ED`, `FT`, drain) -> survey -> arming (halt, limits, speeds) -> tracking. Two
//! lost answers in a row close the line; it is opened again after 0.5 s, then 1, 2, 4, 8 s.

mod condition;

use super::answer::{Axis, numbers};
use super::command::{Command, Item};
use super::config::Config;
use super::exchange::{Exchange, LineTiming, Report, Timing};
use super::nod::Nod;
use super::track::Track;
use super::unit::{Plan, Survey, Unit};
use std::collections::VecDeque;
use tsense_contract::{JOINT_HALTED, JOINT_LIMIT_HIT, Joint};
use tsense_geometry::Timestamp;

/// What the shell is to do or to know.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// Open the line, then call [`Session::opened`] or [`Session::closed`].
    Open,
    /// Close the line.
    Close,
    /// The unit said what it is.
    Surveyed(Box<Unit>),
    /// A sample of the joint angles.
    Joint(Joint),
    /// Something worth a line in the log.
    Notice(String),
    /// Something was thrown away, and why.
    Dropped(&'static str),
    /// The head was told to stop for good, and said that it does.
    Stopped,
}

/// Whether a session moves the head or only looks at the unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Set up, nod and poll.
    Drive,
    /// Ask what is there; send nothing that moves the head or changes a setting that lasts.
    Look,
}

#[derive(Debug)]
enum Phase {
    /// No line; the next attempt to open it.
    Closed(Timestamp),
    /// The shell is opening the line.
    Opening,
    /// Commands before the unit can be read well, then a drain.
    Waking(VecDeque<Command>),
    /// Questions.
    Surveying(Survey),
    /// Settings, refused ones being only noted.
    Arming(VecDeque<Command>),
    /// Nod and poll.
    Tracking,
    /// Nothing more to do.
    Done,
}

/// First wait before the line is opened again, seconds; doubles up to [`BACK_OFF_MAX_S`].
const BACK_OFF_MIN_S: f64 = 0.5;
/// Longest wait before the line is opened again, seconds.
const BACK_OFF_MAX_S: f64 = 8.0;
/// What a unit may still be saying when the line opens: one answer, seconds beyond its time on the line.
const WAKE_DRAIN_S: f64 = 0.05;
/// Bytes of that answer: the longest one of a poll.
const WAKE_DRAIN_BYTES: usize = 30;
/// What it may still be saying when it was told to be terse, seconds.
const DRAIN_S: f64 = 0.2;
/// While pan stands still it is asked for once in this many polls.
const PAN_EVERY: u32 = 8;
/// Resets a process makes at most: a head that runs into its limit again and again meets an obstacle.
const RESETS_MAX: u32 = 3;
/// Events that wait for the shell at most; it takes them after every call.
const EVENTS_MAX: usize = 256;

/// The session.
#[derive(Debug)]
pub struct Session {
    config: Config,
    purpose: Purpose,
    exchange: Exchange,
    phase: Phase,
    back_off_s: f64,
    unit: Unit,
    plan: Option<Plan>,
    plan_fault: Option<String>,
    nod: Option<Nod>,
    track: Track,
    polls: u32,
    next_poll: Timestamp,
    may_move: Result<(), String>,
    halted: bool,
    limit_hit: Option<Axis>,
    resetting: bool,
    resets: u32,
    stopping: bool,
    refused: Option<String>,
    lost: String,
    events: VecDeque<Event>,
}

impl Session {
    /// A session with no line yet; the first [`Event::Open`] comes with the first [`Session::tick`].
    pub fn new(config: &Config, purpose: Purpose) -> Self {
        let timing = LineTiming { baud: config.baud, margin_s: config.reply_margin_ms / 1e3 };
        Self {
            config: config.clone(),
            purpose,
            exchange: Exchange::new(timing),
            phase: Phase::Closed(Timestamp::from_ns(i64::MIN)),
            back_off_s: BACK_OFF_MIN_S,
            unit: Unit::default(),
            plan: None,
            plan_fault: None,
            nod: None,
            track: Track::default(),
            polls: 0,
            next_poll: Timestamp::default(),
            may_move: Ok(()),
            halted: false,
            limit_hit: None,
            resetting: false,
            resets: 0,
            stopping: false,
            refused: None,
            lost: String::new(),
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

    /// Whether the head may move; with a reason where not. It is halted at once and goes on when it may again.
    pub fn set_may_move(&mut self, may_move: Result<(), String>) {
        if may_move != self.may_move {
            self.emit(Event::Notice(may_move.clone().err().unwrap_or("the head may move again".into())));
            self.may_move = may_move;
        }
    }

    /// Halts the head for good; [`Event::Stopped`] follows, at once where there is no line.
    pub fn stop(&mut self) {
        self.stopping = true;
        if !matches!(self.phase, Phase::Tracking | Phase::Arming(_)) {
            self.finish();
        }
    }

    fn finish(&mut self) {
        self.phase = Phase::Done;
        self.emit(Event::Stopped);
    }

    /// The line is open.
    pub fn opened(&mut self, now: Timestamp) {
        self.exchange.clear();
        self.exchange.drain(now, WAKE_DRAIN_S + self.exchange.line_s(WAKE_DRAIN_BYTES), true);
        self.phase = Phase::Waking(VecDeque::from([Command::EchoOff, Command::Terse]));
    }

    /// The line could not be opened, or broke.
    pub fn closed(&mut self, now: Timestamp, reason: &str) {
        self.exchange.clear();
        self.resetting = false;
        self.lost = reason.into();
        if self.stopping {
            self.finish();
        } else {
            self.phase = Phase::Closed(now.plus_seconds(self.back_off_s));
            self.emit(Event::Notice(format!("{reason}; trying again in {} s", self.back_off_s)));
            self.back_off_s = (self.back_off_s * 2.0).min(BACK_OFF_MAX_S);
        }
    }

    fn give_up(&mut self, now: Timestamp, reason: &str) {
        self.emit(Event::Close);
        self.closed(now, reason);
    }

    /// Bytes to write now; call [`Session::written`] when they are.
    pub fn take_outgoing(&mut self) -> Option<Vec<u8>> {
        self.exchange.take_outgoing()
    }

    /// The bytes were handed to the line.
    pub fn written(&mut self, at: Timestamp) {
        self.exchange.written(at);
    }

    /// Takes bytes read at `now`.
    pub fn receive(&mut self, now: Timestamp, bytes: &[u8]) {
        for report in self.exchange.receive(now, bytes) {
            self.take(now, report);
        }
        self.proceed(now);
    }

    /// Takes note of the time.
    pub fn tick(&mut self, now: Timestamp) {
        if let Phase::Closed(again) = self.phase
            && now >= again
        {
            self.phase = Phase::Opening;
            self.emit(Event::Open);
        }
        if let Some(report) = self.exchange.tick(now) {
            self.take(now, report);
        }
        self.proceed(now);
    }

    /// When [`Session::tick`] has something to do; none: only bytes or the shell's calls move it.
    pub fn deadline(&self) -> Option<Timestamp> {
        match &self.phase {
            Phase::Closed(again) => Some(*again),
            Phase::Opening | Phase::Done => None,
            Phase::Tracking if self.exchange.is_idle() => Some(self.next_poll),
            _ => self.exchange.deadline(),
        }
    }

    fn take(&mut self, now: Timestamp, report: Report) {
        match report {
            Report::Answered(command, text, timing) => self.answered(now, command, &text, timing),
            Report::Refused(command, text) => self.was_refused(now, command, &text),
            Report::Lost(command) => {
                self.give_up(now, &format!("no answer to {command}, twice"));
            }
            Report::Limit(axis) => self.limit(axis),
            Report::Dropped(cause) => {
                // Before the unit was told to be terse it may say anything.
                if !matches!(self.phase, Phase::Waking(_)) {
                    self.emit(Event::Dropped(cause));
                }
            }
        }
    }

    fn answered(&mut self, now: Timestamp, command: Command, text: &str, timing: Timing) {
        match command {
            Command::Ask(axis, Item::Position) if matches!(self.phase, Phase::Tracking) => {
                self.sample(timing, &[(axis, numbers(text).first().copied())]);
            }
            Command::AskBoth if matches!(self.phase, Phase::Tracking) => {
                let both = numbers(text);
                let both = [(Axis::Pan, both.first().copied()), (Axis::Tilt, both.get(1).copied())];
                self.sample(timing, &both);
            }
            Command::Halt if self.stopping => self.finish(),
            Command::Halt => self.halted = true,
            Command::Reset => self.was_reset(),
            _ => {
                if let Phase::Surveying(survey) = &mut self.phase {
                    survey.answered(command, text);
                }
            }
        }
        if matches!(self.phase, Phase::Tracking) {
            self.next_poll = self.next_poll.max(now);
        }
    }

    fn was_refused(&mut self, now: Timestamp, command: Command, text: &str) {
        self.resetting = false;
        let surveying = matches!(self.phase, Phase::Surveying(_));
        // Models differ in what they know; a question refused is an answer too.
        if !surveying && !matches!(command, Command::Independent | Command::LimitsOn) {
            let notice = format!("the unit refused {command}: {text}");
            self.emit(Event::Notice(notice.clone()));
            self.emit(Event::Dropped("command refused"));
            if matches!(command, Command::Go(..) | Command::Speed(..)) {
                self.refused = Some(notice);
            }
        }
        if command == Command::Halt && self.stopping {
            self.finish();
        }
        // Not at once again: a unit that refuses every poll must not keep the line and the log busy.
        self.next_poll = now.plus_seconds(self.config.reply_margin_ms / 1e3);
    }

    fn limit(&mut self, axis: Axis) {
        // While opening, the marks of a power-up reset may still be on the line; a reset makes them on purpose.
        if !matches!(self.phase, Phase::Tracking) || self.resetting {
            return;
        }
        if self.limit_hit.replace(axis).is_none() {
            self.emit(Event::Notice(format!("the {axis} axis hit its limit: steps may be lost, angles are invalid")));
        }
    }

    fn was_reset(&mut self) {
        self.resetting = false;
        self.limit_hit = None;
        self.track = Track::default();
        self.emit(Event::Notice("the unit was reset: angles are valid again".into()));
    }

    fn sample(&mut self, timing: Timing, axes: &[(Axis, Option<f64>)]) {
        self.next_poll = timing.written.plus_seconds(self.config.poll_period_ms / 1e3);
        if timing.stamp_std_s() > self.config.stamp_std_max_ms / 1e3 {
            return self.emit(Event::Dropped("instant too uncertain"));
        }
        let stamp = timing.stamp(self.config.sample_delay_ms / 1e3);
        let mut advanced = false;
        for (axis, counts) in axes {
            let Some(counts) = counts.filter(|counts| self.is_plausible(*axis, *counts)) else {
                self.emit(Event::Dropped("implausible position"));
                return;
            };
            let pushed = self.track.push(*axis, stamp, counts as i32);
            advanced |= pushed && *axis == Axis::Tilt;
        }
        let (Some(plan), true) = (&self.plan, advanced) else { return };
        let sweep = self.nod.as_ref().map_or(0, Nod::sweep);
        if let Some(joint) = self.track.joint(plan, timing.stamp_std_s(), sweep, self.flags()) {
            self.back_off_s = BACK_OFF_MIN_S;
            self.lost.clear();
            self.emit(Event::Joint(joint));
        }
    }

    /// Within one turn: anything else is no position.
    fn is_plausible(&self, axis: Axis, counts: f64) -> bool {
        const TURN_ARCSEC: f64 = 360.0 * 3600.0;
        (counts * self.unit.axis(axis).resolution_arcsec).abs() <= TURN_ARCSEC
    }

    fn flags(&self) -> u8 {
        let limit = if self.limit_hit.is_some() { JOINT_LIMIT_HIT } else { 0 };
        limit | if self.halted { JOINT_HALTED } else { 0 }
    }

    /// Starts what is due, where nothing is asked.
    fn proceed(&mut self, now: Timestamp) {
        while self.exchange.is_idle() {
            let started = match &mut self.phase {
                Phase::Waking(commands) => commands.pop_front(),
                Phase::Surveying(survey) => survey.ask(),
                Phase::Arming(commands) => commands.pop_front(),
                Phase::Tracking => {
                    if let Some(command) = self.due(now) {
                        self.exchange.start(command);
                    }
                    return;
                }
                Phase::Closed(_) | Phase::Opening | Phase::Done => return,
            };
            match started {
                Some(command) => self.exchange.start(command),
                None => self.advance(now),
            }
        }
    }

    /// The phase has nothing left to ask.
    fn advance(&mut self, now: Timestamp) {
        match std::mem::replace(&mut self.phase, Phase::Done) {
            Phase::Waking(_) => {
                self.exchange.drain(now, DRAIN_S, false);
                self.phase = Phase::Surveying(Survey::new(self.config.combined_query));
            }
            Phase::Surveying(survey) => match survey.finish() {
                Ok(unit) => self.surveyed(unit),
                Err(reason) => self.give_up(now, &reason),
            },
            Phase::Arming(_) => {
                self.phase = Phase::Tracking;
                self.next_poll = now;
            }
            phase => self.phase = phase,
        }
    }

    fn surveyed(&mut self, unit: Unit) {
        self.emit(Event::Surveyed(Box::new(unit.clone())));
        if self.purpose == Purpose::Look {
            return self.finish();
        }
        let plan = Plan::new(&unit, &self.config);
        self.plan_fault = plan.fault(&unit);
        if let Some(fault) = &self.plan_fault {
            let notice = format!("the head stays where it is: {fault}");
            self.emit(Event::Notice(notice));
        }
        self.exchange.set_marker(Command::Ask(Axis::Tilt, Item::Resolution), unit.tilt.resolution_arcsec);
        let sweep = self.nod.as_ref().map_or(0, Nod::sweep);
        self.nod = Some(Nod::new(&plan, sweep));
        self.phase = Phase::Arming(arming(&plan, self.plan_fault.is_none()));
        (self.halted, self.refused, self.track) = (false, None, Track::default());
        (self.unit, self.plan) = (unit, Some(plan));
    }

    /// The command that is due while tracking: halt before all, then turns, then polls.
    fn due(&mut self, now: Timestamp) -> Option<Command> {
        let must_stand = self.stopping || self.limit_hit.is_some() || self.may_move.is_err();
        if self.stopping || (must_stand && !self.halted) {
            return Some(Command::Halt);
        }
        if self.limit_hit.is_some() && self.config.reset_allowed && self.resets < RESETS_MAX {
            self.resets += 1;
            self.resetting = true;
            return Some(Command::Reset);
        }
        if self.halted && !must_stand {
            self.halted = false;
            self.nod.as_mut().map(Nod::restart);
        }
        if !must_stand && let Some(command) = self.turn(now) {
            return Some(command);
        }
        if now < self.next_poll { None } else { Some(self.poll()) }
    }

    fn turn(&mut self, now: Timestamp) -> Option<Command> {
        if self.plan_fault.is_some() || self.refused.is_some() {
            return None;
        }
        let tilt = self.track.newest(Axis::Tilt)?;
        self.nod.as_mut()?.command(now, tilt)
    }

    fn poll(&mut self) -> Command {
        self.polls = self.polls.wrapping_add(1);
        if self.unit.combined_query {
            return Command::AskBoth;
        }
        let pan = self.track.newest(Axis::Pan).zip(self.nod.as_ref());
        let pan_stands = pan.is_some_and(|(pan, nod)| (pan - nod.pan_target()).abs() <= 1);
        let pan_every = if pan_stands { PAN_EVERY } else { 2 };
        let axis = if self.polls.is_multiple_of(pan_every) { Axis::Pan } else { Axis::Tilt };
        Command::Ask(axis, Item::Position)
    }
}

/// The settings before the first poll. The head stands: speed tables may be computed only then.
fn arming(plan: &Plan, fits: bool) -> VecDeque<Command> {
    let mut commands = VecDeque::from([Command::Halt, Command::LimitsOn, Command::Immediate, Command::Independent]);
    if let Some([pan, tilt]) = plan.acceleration {
        commands.extend([Command::Acceleration(Axis::Pan, pan), Command::Acceleration(Axis::Tilt, tilt)]);
    }
    if fits {
        commands.extend([Command::Speed(Axis::Pan, plan.pan_speed), Command::Speed(Axis::Tilt, plan.tilt_speed)]);
    }
    commands
}
