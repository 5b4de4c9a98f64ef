//! What a process counts about itself; the process loop sends it as a heartbeat.

use tsense_contract::{DROP_CAUSES_MAX, DropCount, Heartbeat, ProcessState, Text};
use tsense_geometry::Timestamp;

/// State and counters of this process.
#[derive(Clone, Debug)]
pub struct Health {
    state: ProcessState,
    reason: String,
    taken: u64,
    sent: u64,
    newest: Option<Timestamp>,
    drops: Vec<(&'static str, u64)>,
    changed: bool,
}

impl Health {
    pub(crate) fn new() -> Self {
        Self {
            state: ProcessState::Starting,
            reason: "starting".into(),
            taken: 0,
            sent: 0,
            newest: None,
            drops: Vec::new(),
            changed: true,
        }
    }

    /// States how this process is, with the reason in words. A change goes out with the next tick.
    pub fn set(&mut self, state: ProcessState, reason: &str) {
        if self.state != state || self.reason != reason {
            (self.state, self.changed) = (state, true);
            self.reason = reason.into();
        }
    }

    /// The present state.
    pub fn state(&self) -> ProcessState {
        self.state
    }

    /// Counts samples taken in.
    pub fn taken(&mut self, n: u64) {
        self.taken += n;
    }

    /// Counts samples put out.
    pub fn sent(&mut self, n: u64) {
        self.sent += n;
    }

    /// Counts what was dropped, by cause. Beyond eight causes the rest is counted as "other".
    pub fn dropped(&mut self, cause: &'static str, n: u64) {
        if n == 0 {
            return;
        }
        let known = self.drops.iter().position(|(c, _)| *c == cause);
        match known {
            Some(i) => self.drops[i].1 += n,
            None if self.drops.len() < DROP_CAUSES_MAX => self.drops.push((cause, n)),
            None => {
                let last = &mut self.drops[DROP_CAUSES_MAX - 1];
                *last = ("other", last.1 + n);
            }
        }
    }

    /// Notes the stamp of the newest data put out.
    pub fn newest(&mut self, stamp: Timestamp) {
        self.newest = Some(self.newest.map_or(stamp, |old| old.max(stamp)));
    }

    /// Whether the state changed since the last time this was asked.
    pub(crate) fn take_change(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    pub(crate) fn heartbeat(&self, name: &str, now: Timestamp) -> Heartbeat {
        let mut drops = [DropCount { cause: Text::new(""), count: 0 }; DROP_CAUSES_MAX];
        for (slot, (cause, count)) in drops.iter_mut().zip(&self.drops) {
            *slot = DropCount { cause: Text::new(cause), count: *count };
        }
        Heartbeat {
            stamp_ns: now.ns,
            newest_ns: self.newest.map_or(0, |t| t.ns),
            taken: self.taken,
            sent: self.sent,
            name: Text::new(name),
            reason: Text::new(&self.reason),
            drops,
            pid: std::process::id(),
            state: self.state.to_wire(),
            reserved: [0; 3],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ninth_cause_of_drops_is_counted_as_other_and_nothing_is_lost() {
        let mut health = Health::new();
        for cause in ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j"] {
            health.dropped(cause, 2);
        }
        health.dropped("a", 5);
        let beat = health.heartbeat("mapper", Timestamp::from_ns(7));
        assert_eq!(beat.drops.iter().map(|d| d.count).sum::<u64>(), 25);
        assert_eq!(beat.drops[0].count, 7);
        assert_eq!(beat.drops[7].cause.to_text(), "other");
    }
}
