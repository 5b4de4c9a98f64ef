//! The process of one LMS-151: talks to the device, stamps its scans, publishes them as `scan/NAME`.
//!
//! In: the configuration of one ladar. Out: scans (graph clock, device angles), and a health state in words with counters.
//! One thread: the read on the socket waits 20 ms at most, and the time of receipt is taken right after it.
#![allow(clippy::disallowed_methods, reason = "shell: the loop around the socket")]

use super::assemble::Assembler;
use super::config::Config;
use super::scan_data::ScanData;
use super::session::{Counts, Session, Settings, State};
use super::shell::link::{Happened, Link};
use tsense_contract::{ProcessState, Scan};
use tsense_geometry::Timestamp;
use tsense_ports::{Outbox, PortError, Process, Wake};

/// Between two looks at the counters, seconds.
const REPORT_S: f64 = 1.0;
/// A clock fit that leaves more than this is no fit: at 20 degrees a second the head turns 0.1 degrees meanwhile.
const CLOCK_SIGMA_MAX_S: f64 = 5e-3;

struct Driver {
    process: Process,
    outbox: Outbox<Scan>,
    assembler: Assembler,
    reported: Counts,
    lost_reported: u64,
    next_report: Timestamp,
    logged: State,
}

/// Runs until the graph asks it to stop.
pub fn run(mut process: Process, config: &Config) -> Result<(), PortError> {
    let outbox = process.outbox::<Scan>(Some(&config.name))?;
    let clock = process.clock();
    let now = || clock.now();
    let mut link = Link::new(&config.address, Session::new(Settings::of(config)));
    let mut driver = Driver {
        process,
        outbox,
        assembler: Assembler::new(config),
        reported: Counts::default(),
        lost_reported: 0,
        next_report: now(),
        logged: State::Connecting,
    };
    while driver.process.wait(0.0) != Wake::Stop {
        for happened in link.turn(&now) {
            driver.take(happened, link.session.contamination())?;
        }
        if now() >= driver.next_report {
            driver.next_report = now().plus_seconds(REPORT_S);
            driver.report(&link.session);
        }
    }
    link.shut_down(&now);
    Ok(())
}

impl Driver {
    fn take(&mut self, happened: Happened, contamination: u8) -> Result<(), PortError> {
        match happened {
            Happened::Scan(data, received) => self.publish(&data, received, contamination),
            Happened::Entered(state, reason) => {
                // A stream that flickers between good and late belongs into the counters and not into the log.
                let flickers = matches!(state, State::Measuring | State::Degraded) && state != self.logged;
                if flickers && matches!(self.logged, State::Measuring | State::Degraded) {
                    tracing::debug!(state = state.as_str(), reason, "ladar");
                } else {
                    tracing::info!(state = state.as_str(), reason, "ladar");
                }
                self.logged = state;
                self.set_health(state, &reason);
                Ok(())
            }
        }
    }

    fn publish(&mut self, data: &ScanData, received: Timestamp, contamination: u8) -> Result<(), PortError> {
        self.process.health().taken(1);
        let scan = match self.assembler.take(data, received, contamination) {
            Ok(scan) => scan,
            Err(why) => {
                self.process.health().dropped(why.as_str(), 1);
                return Ok(());
            }
        };
        self.outbox.send(&scan.header, &scan.returns)?;
        self.process.health().sent(1);
        self.process.health().newest(Timestamp::from_ns(scan.header.stamp_ns));
        Ok(())
    }

    fn set_health(&mut self, state: State, reason: &str) {
        let had_scans = self.assembler.totals().telegrams > 0;
        let words = format!("{}: {reason}", state.as_str());
        self.process.health().set(process_state(state, had_scans), &words);
    }

    /// Hands on what the session counted since the last time, and says how the clock is.
    fn report(&mut self, session: &Session) {
        let (counts, totals) = (session.counts(), self.assembler.totals());
        let health = self.process.health();
        health.dropped("bad frame", counts.frames.bad_frames - self.reported.frames.bad_frames);
        health.dropped("malformed telegram", counts.malformed - self.reported.malformed);
        health.dropped("scan of an older stream", counts.scans_flushed - self.reported.scans_flushed);
        health.dropped("telegram lost on the way", totals.lost - self.lost_reported);
        (self.reported, self.lost_reported) = (counts, totals.lost);
        let (state, reason) = session.state();
        match self.assembler.clock() {
            Some(clock) if state == State::Measuring && clock.std_s > CLOCK_SIGMA_MAX_S => {
                let reason = format!("the device's clock does not fit the host's: sigma {:.1} ms", clock.std_s * 1e3);
                self.set_health(State::Degraded, &reason);
            }
            Some(clock) if state == State::Measuring => {
                let (ppm, sigma_ms) = (clock.rate_error * 1e6, clock.std_s * 1e3);
                let counters =
                    format!("{} lost, {} twice, {} restarts", totals.lost, totals.duplicates, totals.restarts);
                self.set_health(state, &format!("{reason}; {counters}; clock {ppm:+.1} ppm, sigma {sigma_ms:.2} ms"));
            }
            _ => self.set_health(state, reason),
        }
    }
}

fn process_state(state: State, had_scans: bool) -> ProcessState {
    match state {
        State::Measuring => ProcessState::Running,
        State::Degraded | State::Standby => ProcessState::Degraded,
        State::Stale => ProcessState::Stale,
        State::Refused => ProcessState::Failed,
        _ if had_scans => ProcessState::Stale,
        _ => ProcessState::Starting,
    }
}
