//! What time does to the session: requests made again, connections given up and opened anew, steps entered.
//!
//! In: deadlines that have passed, and steps to go to. Out: requests to send, connections to open and close.

use super::step::Step;
use super::{
    ANSWER_S, ATTEMPTS, Action, BACK_OFF_S, CLOSING_S, CONTAMINATION_S, CONTAMINATION_UNKNOWN, COURTESY_S,
    FIRST_ANSWER_S, FIRST_ATTEMPTS, FIRST_SCAN_S, Link, Pending, SPIN_UP_MAX_S, Session, State, Trouble,
};
use crate::lms151::config::DialectChoice;
use crate::lms151::telegram::StreamFramer;
use tsense_geometry::Timestamp;

impl Session {
    pub(super) fn on_time_connected(&mut self, now: Timestamp) {
        if self.step == Step::Streaming && now >= self.watchdog_deadline() {
            return self.watchdog(now);
        }
        if let Some(pending) = self.pending.filter(|p| now >= p.deadline) {
            return self.unanswered(now, pending);
        }
        if self.resume_at.is_some_and(|at| now >= at) {
            self.resume_at = None;
            self.ask(now, 1);
        }
    }

    pub(super) fn unanswered(&mut self, now: Timestamp, pending: Pending) {
        let name = pending.request.name();
        let finding = self.step == Step::FindDialect && self.framer.dialect().is_none();
        let attempts = match self.step {
            Step::FindDialect => FIRST_ATTEMPTS,
            Step::Closing => return self.closed(),
            step if step.is_courtesy() => return self.without_courtesy(now),
            _ => ATTEMPTS,
        };
        if pending.attempt < attempts {
            self.counts.retries += 1;
            if finding && self.settings.dialect == DialectChoice::Auto {
                self.speak = self.speak.other();
            }
            return self.ask(now, pending.attempt + 1);
        }
        let what = if finding && self.settings.dialect == DialectChoice::Auto {
            "no answer in CoLa-A or CoLa-B: is this the SOPAS port (2111 or 2112) of an LMS1xx?".into()
        } else {
            format!("no answer to {name} in {attempts} attempts ({})", self.speak)
        };
        self.lose(now, what);
    }

    pub(super) fn without_courtesy(&mut self, now: Timestamp) {
        if self.step == Step::Streaming {
            self.pending = None;
            self.resume_at = Some(now.plus_seconds(CONTAMINATION_S));
            return;
        }
        self.go(self.step.following(self.goal, &self.settings), now);
    }

    // Moving on.

    pub(super) fn go(&mut self, step: Step, now: Timestamp) {
        self.step = step;
        self.pending = None;
        self.resume_at = None;
        match step {
            Step::LogIn => self.log_ins += 1,
            Step::AwaitMeasuring => self.ready_until = Some(now.plus_seconds(SPIN_UP_MAX_S)),
            Step::Streaming => {
                self.trouble = Trouble::None;
                self.last_scan = now.plus_seconds(FIRST_SCAN_S - self.stale_after_s());
            }
            _ => {}
        }
        match step {
            Step::Streaming => self.enter(State::SpinningUp, "waiting for the first scan".into()),
            Step::Closing => {}
            step => {
                let what = step.request(&self.settings).map(|r| format!("{} asked", r.name()));
                self.enter(step.state(), what.unwrap_or_else(|| "laser and motor are off on request".into()));
            }
        }
        let ask = step != Step::Streaming || self.contamination_known;
        if ask {
            self.ask(now, 1);
        }
    }

    /// Makes the step's request.
    pub(super) fn ask(&mut self, now: Timestamp, attempt: u32) {
        let Some(request) = self.step.request(&self.settings) else { return };
        let wait_s = match self.step {
            Step::FindDialect => FIRST_ANSWER_S,
            Step::Identify => COURTESY_S,
            Step::Closing => CLOSING_S,
            _ => ANSWER_S,
        };
        self.pending = Some(Pending { request, attempt, deadline: now.plus_seconds(wait_s) });
        self.actions.push_back(Action::Send(self.speak.frame(&request.encode(self.speak))));
    }

    pub(super) fn open(&mut self) {
        self.link = Link::Opening;
        self.actions.push_back(Action::Connect);
    }

    /// Gives the connection up and tries again later.
    pub(super) fn lose(&mut self, now: Timestamp, why: String) {
        let state = if self.step == Step::Streaming { State::Stale } else { State::Connecting };
        self.disconnect();
        self.pause(now, state, why);
    }

    pub(super) fn refuse(&mut self, now: Timestamp, why: String) {
        self.back_off_s = BACK_OFF_S[1];
        self.disconnect();
        self.pause(now, State::Refused, why);
    }

    pub(super) fn disconnect(&mut self) {
        self.counts = self.counts();
        self.framer = StreamFramer::new(self.framer.dialect());
        self.step = Step::FindDialect;
        self.actions.push_back(Action::Disconnect);
    }

    pub(super) fn pause(&mut self, now: Timestamp, state: State, why: String) {
        self.pending = None;
        self.resume_at = None;
        self.contamination = CONTAMINATION_UNKNOWN;
        let pause_s = self.back_off_s;
        self.back_off_s = (2.0 * pause_s).min(BACK_OFF_S[1]);
        self.link = Link::Pausing(now.plus_seconds(pause_s));
        self.enter(state, format!("{why}; connecting again in {pause_s} s"));
    }

    pub(super) fn closed(&mut self) {
        if self.link == Link::Open {
            self.disconnect();
        }
        self.link = Link::Closed;
        self.pending = None;
        self.resume_at = None;
        self.enter(State::Closed, "shut down".into());
    }

    pub(super) fn enter(&mut self, state: State, reason: String) {
        if self.state.0 != state || self.state.1 != reason {
            self.state = (state, reason);
            self.actions.push_back(Action::Entered(self.state.0, self.state.1.clone()));
        }
    }
}
