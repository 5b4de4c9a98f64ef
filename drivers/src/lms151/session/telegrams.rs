//! What a telegram does to the session: an answer, an error answer, a scan, or something to ignore.
//!
//! In: parsed packets and the time of receipt. Out: the next step, or a scan handed out.

use super::step::{Next, Step};
use super::{
    ATTEMPTS, Action, BACK_OFF_S, CONTAMINATION_S, CONTAMINATION_UNKNOWN, LOG_INS_MAX, POLL_S, Pending, SPIN_UP_MAX_S,
    Session, State, Trouble,
};
use crate::lms151::commands::{Reply, status_name};
use crate::lms151::fault_code::{FaultCode, Remedy};
use crate::lms151::scan_data::{self, ScanData};
use crate::lms151::telegram::{Packet, Verb};
use tsense_geometry::Timestamp;

impl Session {
    pub(super) fn telegram(&mut self, now: Timestamp, packet: &Packet<'_>) {
        match packet.verb {
            Verb::Event | Verb::ReadAnswer if packet.name == scan_data::NAME => self.scan(now, packet),
            Verb::Event => self.counts.events_ignored += 1,
            Verb::Fault => match packet.fields().u16("error code") {
                Ok(code) => self.fault(now, FaultCode(code)),
                Err(_) => self.counts.malformed += 1,
            },
            _ => self.answer(now, packet),
        }
    }

    pub(super) fn answer(&mut self, now: Timestamp, packet: &Packet<'_>) {
        let Some(pending) = self.pending.filter(|p| p.request.is_answered_by(packet)) else {
            self.counts.stray_answers += 1;
            return;
        };
        // An answer that cannot be read is asked for again by the time-out.
        let Ok(reply) = pending.request.parse_reply(packet) else {
            self.counts.malformed += 1;
            return;
        };
        self.pending = None;
        self.note(&reply);
        match self.step {
            Step::Streaming => self.resume_at = Some(now.plus_seconds(CONTAMINATION_S)),
            Step::Closing => self.closed(),
            _ => {
                let next = self.step.after(&reply, self.goal, &self.settings);
                self.follow(next, &reply, now);
            }
        }
    }

    /// Keeps what an answer tells about the device.
    pub(super) fn note(&mut self, reply: &Reply) {
        match (self.step, reply) {
            (Step::FindDialect, Reply::Texts(texts)) => self.identity.firmware = texts.join(" ").trim().into(),
            (Step::Identify, Reply::Texts(texts)) => {
                self.identity.device = texts.iter().map(|t| t.trim().into()).collect();
            }
            (Step::Streaming, Reply::Number(level)) => {
                self.contamination = (*level).min(u32::from(CONTAMINATION_UNKNOWN)) as u8;
            }
            _ => {}
        }
    }

    pub(super) fn fault(&mut self, now: Timestamp, code: FaultCode) {
        let Some(pending) = self.pending else {
            self.counts.stray_answers += 1;
            return;
        };
        match code.remedy() {
            Remedy::AskAgain if pending.attempt < ATTEMPTS => {
                self.pending = Some(Pending { deadline: now.plus_seconds(POLL_S), ..pending });
            }
            Remedy::AskAgain => self.lose(now, format!("{} still answered with {code}", pending.request.name())),
            Remedy::LogInAgain if self.log_ins < LOG_INS_MAX && !self.step.is_courtesy() => self.go(Step::LogIn, now),
            _ if self.step == Step::Streaming => {
                self.pending = None;
                self.contamination_known = false;
            }
            _ => {
                let next = self.step.after_fault(code, self.goal, &self.settings);
                self.follow(next, &Reply::Done, now);
            }
        }
    }

    pub(super) fn follow(&mut self, next: Next, reply: &Reply, now: Timestamp) {
        match next {
            Next::Go(_) if self.step == Step::Closing => self.closed(),
            Next::Go(step) => self.go(step, now),
            Next::Refused(why) => self.refuse(now, why),
            Next::Poll => {
                let Reply::Number(state) = reply else { return };
                let name = status_name((*state).min(255) as u8);
                if self.ready_until.is_some_and(|until| now >= until) {
                    self.lose(now, format!("not measuring {SPIN_UP_MAX_S} s after the start: state {state} ({name})"));
                } else {
                    self.enter(State::SpinningUp, format!("device is {name} (state {state})"));
                    self.resume_at = Some(now.plus_seconds(POLL_S));
                }
            }
        }
    }

    pub(super) fn scan(&mut self, now: Timestamp, packet: &Packet<'_>) {
        if !matches!(self.step, Step::Subscribe | Step::Streaming) {
            self.counts.scans_flushed += 1;
            return;
        }
        let mut fields = packet.fields();
        let Ok(data) = ScanData::parse(&mut fields) else {
            self.counts.malformed += 1;
            return;
        };
        self.scans += 1;
        self.last_scan = now;
        self.back_off_s = BACK_OFF_S[0];
        if self.step == Step::Streaming {
            let silent = self.trouble == Trouble::Silent && now < self.silent_until;
            self.judge(if silent { Trouble::Silent } else { self.trouble_of(&data) });
        }
        self.actions.push_back(Action::Scan(Box::new(data), now));
    }
}
