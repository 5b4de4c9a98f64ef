//! The conversation with one LMS-151 as a state machine without sockets and clocks.
//!
//! In: "connected", "received these bytes", "it is now", "connection lost". Out: [`Action`]s (connect, send, disconnect,
//! a scan arrived, the state changed) and the next deadline. It finds the dialect, stops a stream that is already running,
//! logs in, configures, starts, waits until the device measures, subscribes, watches the stream, and starts anew after
//! a loss with growing pauses. It does not stamp scans ([`crate::lms151::assemble`] does). Source: protocol notes 1.1 to 1.3.

mod step;
mod telegrams;
#[cfg(test)]
mod tests;
mod timing;
mod watch;

use super::commands::{DataConfig, Request, ScanConfig};
use super::config::{Config, DialectChoice};
use super::scan_data::ScanData;
use super::telegram::{Dialect, FrameCounts, Packet, StreamFramer};
use std::collections::VecDeque;
use step::Step;
use tsense_geometry::Timestamp;

/// Wait for an answer. The slowest seen on a real device took 14 ms.
const ANSWER_S: f64 = 3.0;
/// Requests made for one answer before the connection is given up.
const ATTEMPTS: u32 = 3;
/// Wait for the first answer on a connection before it is asked for again, in the other dialect where that is open, and how
/// often in all: a device answers in 3 ms, and one that takes longer still shows its dialect when it does answer.
const FIRST_ANSWER_S: f64 = 0.3;
const FIRST_ATTEMPTS: u32 = 10;
/// Wait for an answer that nothing depends on.
const COURTESY_S: f64 = 1.0;
/// Between two questions whether it measures yet, and after "busy": 2 Hz is the most the device likes.
const POLL_S: f64 = 0.5;
/// Longest spin-up; the maker says 30 s.
const SPIN_UP_MAX_S: f64 = 60.0;
/// First scan after subscribing; 78 ms on a real device.
const FIRST_SCAN_S: f64 = 2.0;
/// Silence, in telegram periods and seconds, that makes a stream degraded and stale.
const DEGRADED_PERIODS: f64 = 3.0;
const STALE_S: f64 = 0.5;
const STALE_PERIODS: f64 = 5.0;
/// Scans have to arrive this long without a silence before a degraded stream is called good again: the state shall not
/// flicker with every late packet.
const RECOVERED_S: f64 = 0.2;
/// Between two questions for contamination.
const CONTAMINATION_S: f64 = 10.0;
/// First and longest pause before connecting again.
const BACK_OFF_S: [f64; 2] = [0.5, 8.0];
/// Wait for the stream to stop before the connection is closed.
const CLOSING_S: f64 = 0.5;
/// Log-ins on one connection: a device that forgets every one is not talked to for ever.
const LOG_INS_MAX: u32 = 3;
/// Reason before the first attempt to connect.
const NOT_YET: &str = "not connected yet";
/// Contamination not known.
pub const CONTAMINATION_UNKNOWN: u8 = 255;

/// What the session is to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Dialect, or to find out.
    pub dialect: DialectChoice,
    /// The dialect to try first while finding out.
    pub dialect_guess: Dialect,
    /// What to set on the device; `None` leaves it as it is.
    pub measurement: Option<Measurement>,
    /// Nominal time from a telegram to the next, seconds.
    pub telegram_period_s: f64,
}

/// What the device is set to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measurement {
    /// Rate and density.
    pub scan: ScanConfig,
    /// Content of a telegram.
    pub data: DataConfig,
}

impl Settings {
    /// Settings that put the configured measurement on the device.
    pub fn of(config: &Config) -> Self {
        Self {
            measurement: Some(Measurement { scan: config.scan_config(), data: config.data_config() }),
            telegram_period_s: config.telegram_period_s(),
            ..Self::as_it_is(&config.address, config.dialect)
        }
    }

    /// Settings that leave the device's own measurement alone.
    pub fn as_it_is(address: &str, dialect: DialectChoice) -> Self {
        // Factory setting: port 2111 talks CoLa-A, port 2112 CoLa-B.
        let dialect_guess = if address.ends_with(":2112") { Dialect::B } else { Dialect::A };
        Self { dialect, dialect_guess, measurement: None, telegram_period_s: 0.04 }
    }
}

/// How the session is, for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Opening the connection, finding the dialect, or waiting to try again.
    Connecting,
    /// Becoming the authorised client.
    LoggingIn,
    /// Setting rate, density and content.
    Configuring,
    /// Waiting until the device measures.
    SpinningUp,
    /// Scans arrive.
    Measuring,
    /// Scans arrive, but late, dirty, or not as configured.
    Degraded,
    /// Scans have stopped.
    Stale,
    /// Laser and motor are off, on request.
    Standby,
    /// The device refuses something that is needed; a person has to act.
    Refused,
    /// Shut down.
    Closed,
}

impl State {
    /// In words.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Connecting => "connecting",
            Self::LoggingIn => "logging in",
            Self::Configuring => "configuring",
            Self::SpinningUp => "spinning up",
            Self::Measuring => "measuring",
            Self::Degraded => "degraded",
            Self::Stale => "stale",
            Self::Standby => "standby",
            Self::Refused => "refused",
            Self::Closed => "closed",
        }
    }
}

/// What the shell has to do.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Open the connection, then call [`Session::connected`] or [`Session::connection_lost`].
    Connect,
    /// Send these bytes.
    Send(Vec<u8>),
    /// Close the connection.
    Disconnect,
    /// A scan, and when its last byte was received.
    Scan(Box<ScanData>, Timestamp),
    /// The state or its reason changed.
    Entered(State, String),
}

/// What the session is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Goal {
    Measure,
    StandBy,
    Close,
}

/// Where the connection is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Link {
    Closed,
    /// Waits until then before connecting.
    Pausing(Timestamp),
    Opening,
    Open,
}

/// A request without an answer.
#[derive(Clone, Copy, Debug)]
struct Pending {
    request: Request,
    attempt: u32,
    deadline: Timestamp,
}

/// What is wrong while scans arrive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    None,
    Silent,
    NotAsConfigured { frequency_centihz: u32, step_e4_deg: u16 },
    Contaminated(u8),
    DeviceStatus([u8; 2]),
}

/// Counts of what was not used, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Framing, over all connections.
    pub frames: FrameCounts,
    /// Telegrams that could not be read.
    pub malformed: u64,
    /// Scans of a stream that ran before this session subscribed.
    pub scans_flushed: u64,
    /// Events of other kinds.
    pub events_ignored: u64,
    /// Answers nobody waited for.
    pub stray_answers: u64,
    /// Requests made again for want of an answer.
    pub retries: u64,
    /// Connections opened.
    pub connections: u64,
}

/// What the device said of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Type and version.
    pub device: Vec<String>,
    /// Firmware.
    pub firmware: String,
}

/// One conversation, over any number of connections.
#[derive(Debug)]
pub struct Session {
    settings: Settings,
    goal: Goal,
    link: Link,
    step: Step,
    framer: StreamFramer,
    /// The dialect requests are written in.
    speak: Dialect,
    pending: Option<Pending>,
    /// When to make the step's request (again).
    resume_at: Option<Timestamp>,
    ready_until: Option<Timestamp>,
    log_ins: u32,
    back_off_s: f64,
    /// When the last scan came, or by when the first was due less the watchdog's time.
    last_scan: Timestamp,
    scans: u64,
    /// Until then a silence still counts.
    silent_until: Timestamp,
    trouble: Trouble,
    contamination: u8,
    contamination_known: bool,
    identity: Identity,
    state: (State, String),
    actions: VecDeque<Action>,
    counts: Counts,
}

impl Session {
    /// A session that connects as soon as [`Session::on_time`] is called.
    pub fn new(settings: Settings) -> Self {
        Self {
            goal: Goal::Measure,
            link: Link::Pausing(Timestamp::from_ns(i64::MIN)),
            step: Step::FindDialect,
            framer: StreamFramer::new(None),
            speak: settings.dialect.fixed().unwrap_or(settings.dialect_guess),
            pending: None,
            resume_at: None,
            ready_until: None,
            log_ins: 0,
            back_off_s: BACK_OFF_S[0],
            last_scan: Timestamp::default(),
            scans: 0,
            silent_until: Timestamp::from_ns(i64::MIN),
            trouble: Trouble::None,
            contamination: CONTAMINATION_UNKNOWN,
            contamination_known: true,
            identity: Identity::default(),
            state: (State::Connecting, NOT_YET.into()),
            actions: VecDeque::new(),
            counts: Counts::default(),
            settings,
        }
    }

    /// The next thing to do; ask until there is none.
    pub fn poll(&mut self) -> Option<Action> {
        self.actions.pop_front()
    }

    /// The state and its reason.
    pub fn state(&self) -> (State, &str) {
        (self.state.0, &self.state.1)
    }

    /// The dialect, once known.
    pub fn dialect(&self) -> Option<Dialect> {
        self.framer.dialect()
    }

    /// What the device said of itself.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Contamination: 0 none, 1 warning, 2 error, 3 fatal, 255 unknown.
    pub fn contamination(&self) -> u8 {
        self.contamination
    }

    /// A connection failed, and the next attempt is some time away.
    pub fn is_waiting_to_reconnect(&self) -> bool {
        matches!(self.link, Link::Pausing(_)) && self.state.1 != NOT_YET
    }

    /// Scans handed out so far.
    pub fn scans(&self) -> u64 {
        self.scans
    }

    /// Bytes held of unfinished frames.
    pub fn bytes_held(&self) -> usize {
        self.framer.held()
    }

    /// What was not used, by cause.
    pub fn counts(&self) -> Counts {
        let now = self.framer.counts();
        let mut counts = self.counts;
        counts.frames.frames += now.frames;
        counts.frames.bad_frames += now.bad_frames;
        counts.frames.bytes_skipped += now.bytes_skipped;
        counts
    }

    /// When [`Session::on_time`] has to be called at the latest.
    pub fn next_deadline(&self) -> Option<Timestamp> {
        if let Link::Pausing(until) = self.link {
            return Some(until);
        }
        let watchdog = (self.step == Step::Streaming && self.link == Link::Open).then(|| self.watchdog_deadline());
        [self.pending.map(|p| p.deadline), self.resume_at, watchdog].into_iter().flatten().min()
    }

    /// The connection is open.
    pub fn connected(&mut self, now: Timestamp) {
        if self.link != Link::Opening {
            return self.actions.push_back(Action::Disconnect);
        }
        self.counts.connections += 1;
        self.link = Link::Open;
        self.framer = StreamFramer::new(self.settings.dialect.fixed());
        self.log_ins = 0;
        self.contamination_known = true;
        self.go(Step::FindDialect, now);
    }

    /// The connection could not be opened, or is gone.
    pub fn connection_lost(&mut self, now: Timestamp, why: &str) {
        match self.link {
            Link::Opening => self.pause(now, State::Connecting, format!("cannot connect: {why}")),
            Link::Open if self.goal == Goal::Close => self.closed(),
            Link::Open => self.lose(now, format!("connection lost: {why}")),
            Link::Closed | Link::Pausing(_) => {}
        }
    }

    /// Bytes arrived at `now`.
    pub fn received(&mut self, now: Timestamp, bytes: &[u8]) {
        if self.link != Link::Open {
            return;
        }
        let known_before = self.framer.dialect();
        let payloads = self.framer.feed(bytes);
        let Some(dialect) = self.framer.dialect() else { return };
        let asked_in_other = known_before.is_none() && self.speak != dialect;
        self.speak = dialect;
        for payload in payloads {
            if self.link != Link::Open {
                return;
            }
            match Packet::parse(dialect, &payload) {
                Ok(packet) => self.telegram(now, &packet),
                Err(_) => self.counts.malformed += 1,
            }
        }
        if asked_in_other && self.step == Step::FindDialect && self.link == Link::Open {
            self.ask(now, 1);
        }
    }

    /// Time has come to `now`: deadlines that have passed take effect.
    pub fn on_time(&mut self, now: Timestamp) {
        match self.link {
            Link::Pausing(until) if now >= until => self.open(),
            Link::Open => self.on_time_connected(now),
            _ => {}
        }
    }

    /// Turn laser and motor off and keep the connection.
    pub fn stand_by(&mut self, now: Timestamp) {
        self.aim(Goal::StandBy, now);
    }

    /// Measure again after [`Session::stand_by`].
    pub fn resume(&mut self, now: Timestamp) {
        self.aim(Goal::Measure, now);
    }

    /// Cancel the stream and close; [`State::Closed`] says when that is done.
    pub fn shut_down(&mut self, now: Timestamp) {
        self.goal = Goal::Close;
        match self.link {
            Link::Open if self.framer.dialect().is_some() => self.go(Step::Closing, now),
            _ => self.closed(),
        }
    }

    fn aim(&mut self, goal: Goal, now: Timestamp) {
        if self.goal == goal || self.goal == Goal::Close {
            return;
        }
        self.goal = goal;
        if self.link == Link::Open && self.step != Step::FindDialect {
            self.go(Step::StopStream, now);
        }
    }
}
