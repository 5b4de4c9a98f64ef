//! The process of the pan-tilt unit: owns the line, publishes `joint`, halts the head when it must.
//!
//! In: the configuration, `pose` (only to halt the head when it is stale). Out: `joint`, health in words. One thread:
//! the read on the line waits 20 ms at most.
#![allow(clippy::disallowed_methods, reason = "shell: the loop around the line")]

pub use super::shell::probe::{ProbeError, Report, probe};

use super::config::Config;
use super::session::{Event, Purpose, Session};
use crate::shell::line::{Line, LineError, Opening};
use tsense_contract::{Joint, Joints, PoseQuality, Poses};
use tsense_geometry::Timestamp;
use tsense_ports::{Clock, Inbox, Outbox, PortError, Process, Wake};

/// Longest wait on the line before the process loop is served, seconds.
const WAIT_MAX_S: f64 = 0.02;
/// Wait while there is no line, seconds.
const NO_LINE_WAIT_S: f64 = 0.05;
/// How long a head may take to answer its last halt, seconds; the launcher waits longer than this.
const HALT_S: f64 = 0.5;
/// What a line may hold when it is read: more than a unit can send in a long pause.
const READ_BYTES: usize = 512;

/// Runs until the graph asks it to stop; the head is halted then.
pub fn run(mut process: Process, config: &Config) -> Result<(), PortError> {
    let mut outbox = process.outbox::<Joints>(None)?;
    let mut poses = process.inbox::<Poses>(None)?;
    let clock = process.clock();
    let mut control = Control::new(config.pose_timeout_s);
    let mut talk = Conversation::new(config, Purpose::Drive, clock);
    while process.wait(0.0) != Wake::Stop {
        control.look(&mut poses, clock.now())?;
        talk.session.set_may_move(control.verdict(clock.now()));
        for event in talk.turn() {
            publish(&mut process, &mut outbox, event)?;
        }
        let (state, reason) = talk.session.condition();
        process.health().set(state, &reason);
        if talk.line.is_none() {
            process.wait(NO_LINE_WAIT_S);
        }
    }
    talk.shut_down();
    Ok(())
}

fn publish(process: &mut Process, outbox: &mut Outbox<Joints>, event: Event) -> Result<(), PortError> {
    match event {
        Event::Joint(joint) => send(process, outbox, &joint)?,
        Event::Surveyed(unit) => unit.to_string().lines().for_each(|line| tracing::info!("{line}")),
        Event::Notice(text) => tracing::warn!("{text}"),
        Event::Dropped(cause) => process.health().dropped(cause, 1),
        Event::Open | Event::Close | Event::Stopped => {}
    }
    Ok(())
}

fn send(process: &mut Process, outbox: &mut Outbox<Joints>, joint: &Joint) -> Result<(), PortError> {
    outbox.send(joint, &[])?;
    let health = process.health();
    health.taken(1);
    health.sent(1);
    health.newest(Timestamp::from_ns(joint.stamp_ns));
    Ok(())
}

/// Who may keep the head moving: a graph that knows where it is.
struct Control {
    timeout_s: f64,
    newest: Option<Timestamp>,
}

impl Control {
    fn new(timeout_s: f64) -> Self {
        Self { timeout_s, newest: None }
    }

    fn look(&mut self, poses: &mut Inbox<Poses>, now: Timestamp) -> Result<(), PortError> {
        while let Some(pose) = poses.take()? {
            if pose.header().quality() != PoseQuality::Invalid {
                self.newest = Some(now);
            }
        }
        Ok(())
    }

    fn verdict(&self, now: Timestamp) -> Result<(), String> {
        match self.newest {
            Some(newest) if self.timeout_s > 0.0 && now.seconds_since(newest) > self.timeout_s => {
                Err(format!("no pose for more than {} s", self.timeout_s))
            }
            _ => Ok(()),
        }
    }
}

/// A session and its line.
pub(super) struct Conversation {
    pub(super) session: Session,
    pub(super) line: Option<Line>,
    opening: Option<Opening>,
    clock: Clock,
    address: String,
    baud: u32,
    purpose: Purpose,
}

impl Conversation {
    /// A session with no line yet.
    pub(super) fn new(config: &Config, purpose: Purpose, clock: Clock) -> Self {
        Self {
            session: Session::new(config, purpose),
            line: None,
            opening: None,
            clock,
            address: config.address.clone(),
            baud: config.baud,
            purpose,
        }
    }

    /// Once around: what is there, what is due, then a wait for more. Returns what the graph is to know.
    pub(super) fn turn(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        self.finish_opening();
        // What has arrived is read before the time is looked at: a process that slept must not call it late.
        self.read(0.0);
        self.session.tick(self.clock.now());
        self.act(&mut events);
        self.write();
        let until_s = self.session.deadline().map_or(WAIT_MAX_S, |at| at.seconds_since(self.clock.now()));
        self.read(until_s.clamp(0.0, WAIT_MAX_S));
        self.act(&mut events);
        self.write();
        events
    }

    fn act(&mut self, events: &mut Vec<Event>) {
        while let Some(event) = self.session.event() {
            match event {
                Event::Open => self.opening = Some(Opening::begin(&self.address, self.baud)),
                Event::Close => self.line = None,
                event => events.push(event),
            }
        }
    }

    fn finish_opening(&mut self) {
        let Some(result) = self.opening.as_ref().and_then(Opening::poll) else { return };
        self.opening = None;
        match result {
            Ok(line) => {
                self.line = Some(line);
                self.session.opened(self.clock.now());
            }
            Err(error) => self.session.closed(self.clock.now(), &error.to_string()),
        }
    }

    fn read(&mut self, wait_s: f64) {
        let Some(line) = &mut self.line else { return };
        let mut buffer = [0; READ_BYTES];
        match line.read(&mut buffer, self.clock.real(wait_s)) {
            Ok(0) => {}
            Ok(count) => self.session.receive(self.clock.now(), &buffer[..count]),
            Err(error) => self.broken(&error),
        }
    }

    fn write(&mut self) {
        let Some(line) = &mut self.line else { return };
        let Some(bytes) = self.session.take_outgoing() else { return };
        match line.write(&bytes) {
            Ok(()) => self.session.written(self.clock.now()),
            Err(error) => self.broken(&error),
        }
    }

    fn broken(&mut self, error: &LineError) {
        self.line = None;
        self.session.closed(self.clock.now(), &error.to_string());
    }

    /// Halts the head and waits a little for its answer.
    fn shut_down(&mut self) {
        self.session.stop();
        let until = self.clock.now().plus_seconds(HALT_S * self.clock.speed());
        while self.clock.now() < until && self.line.is_some() {
            if self.turn().contains(&Event::Stopped) {
                return;
            }
        }
    }
}

impl Drop for Conversation {
    /// Whatever ended the process (a panic, an error, a halt without answer): a last halt costs two bytes.
    fn drop(&mut self) {
        if let (Some(line), Purpose::Drive) = (&mut self.line, self.purpose) {
            // The leading delimiter ends a half command. Nothing can be done where it fails.
            let _ = line.write(b" H ");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fake_unit::bench;
    use super::*;
    use std::time::{Duration, Instant};
    use tsense_contract::ProcessState;

    #[test]
    fn the_head_nods_over_a_real_terminal_and_is_halted_at_the_end() {
        let unit = bench(|path| {
            // A busy test machine pauses longer than a line does.
            let config =
                Config { address: path.into(), reply_margin_ms: 1000.0, stamp_std_max_ms: 1000.0, ..Config::default() };
            let clock = Clock::start(1.0);
            let mut talk = Conversation::new(&config, Purpose::Drive, clock);
            let end = clock.now().plus_seconds(20.0);
            let mut joints = Vec::new();
            while joints.len() < 60 && clock.now() < end {
                joints.extend(talk.turn().into_iter().filter_map(|event| match event {
                    Event::Joint(joint) => Some(joint),
                    _ => None,
                }));
            }
            assert!(joints.len() >= 60, "{} joints, {:?}", joints.len(), talk.session.condition());
            assert_eq!(talk.session.condition().0, ProcessState::Running);
            assert!(joints.windows(2).all(|pair| pair[0].stamp_ns < pair[1].stamp_ns));
            assert!(joints.iter().any(|joint| joint.tilt_rate_rad_s < -0.2), "it nods down at 20 degrees/s");
            talk.shut_down();
        });
        assert!(unit.log.contains(&"B".into()));
        assert_eq!(unit.log.last().map(String::as_str), Some("H"));
    }

    #[test]
    fn a_conversation_that_is_dropped_halts_the_head() {
        let unit = bench(|path| {
            let config = Config { address: path.into(), reply_margin_ms: 1000.0, ..Config::default() };
            let mut talk = Conversation::new(&config, Purpose::Drive, Clock::start(1.0));
            let end = Instant::now() + Duration::from_secs(10);
            while talk.line.is_none() && Instant::now() < end {
                talk.turn();
            }
            assert!(talk.line.is_some());
        });
        assert_eq!(unit.log.last().map(String::as_str), Some("H"));
    }

    #[test]
    fn a_stale_pose_takes_the_head_away_and_a_bench_without_poses_keeps_it() {
        let at = |seconds: f64| Timestamp::from_seconds(seconds);
        assert_eq!(Control::new(5.0).verdict(at(99.0)), Ok(()));
        let seen = |timeout_s: f64| Control { timeout_s, newest: Some(at(10.0)) };
        assert_eq!(seen(5.0).verdict(at(14.0)), Ok(()));
        assert_eq!(seen(5.0).verdict(at(16.0)), Err("no pose for more than 5 s".into()));
        assert_eq!(seen(0.0).verdict(at(99.0)), Ok(()));
    }
}
