//! The graph's clock: a monotonic clock anchored to the Unix epoch once a graph, with a speed factor.
//!
//! Out: [`Timestamp`], nanoseconds since the epoch, the same in every process of a graph and never stepping back.
//! The anchor and the speed travel to the children in the graph's own small file. It does not follow later
//! corrections of the system clock: stamps of one graph stay comparable with each other.
#![allow(clippy::disallowed_methods, reason = "shell: this is where time comes from")]

use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};
use tsense_geometry::Timestamp;

/// Where the graph's time starts and how fast it runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clock {
    /// Nanoseconds since the epoch at the anchor.
    epoch_ns: i64,
    /// The machine's monotonic clock at the anchor, nanoseconds.
    monotonic_ns: i64,
    /// Graph seconds in a second of the machine.
    speed: f64,
}

impl Clock {
    /// A clock that starts now. `speed` is graph seconds in a second of the machine, 1 in production.
    pub fn start(speed: f64) -> Self {
        Self { epoch_ns: read_ns(ClockId::Realtime), monotonic_ns: read_ns(ClockId::Monotonic), speed }
    }

    /// The present instant on the graph's clock.
    pub fn now(&self) -> Timestamp {
        self.at(read_ns(ClockId::Monotonic))
    }

    /// The instant at a reading of the monotonic clock.
    fn at(&self, monotonic_ns: i64) -> Timestamp {
        let elapsed_ns = monotonic_ns.saturating_sub(self.monotonic_ns);
        // At speed 1 the whole nanoseconds are kept; a double would lose some after 104 days.
        let scaled_ns = if self.speed == 1.0 { elapsed_ns } else { (elapsed_ns as f64 * self.speed) as i64 };
        Timestamp::from_ns(self.epoch_ns.saturating_add(scaled_ns))
    }

    /// Graph seconds in a second of the machine.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Waits for graph seconds. Do not use it where [`crate::Process::wait`] can do the waiting.
    pub fn sleep(&self, seconds: f64) {
        std::thread::sleep(self.real(seconds));
    }

    /// How long a span of graph seconds takes on the machine; nothing where it is negative or not a number.
    pub fn real(&self, seconds: f64) -> std::time::Duration {
        std::time::Duration::try_from_secs_f64(seconds / self.speed).unwrap_or_default()
    }
}

/// Seconds on the machine's monotonic clock: for time-outs and rates that do not follow the graph's speed.
pub fn machine_seconds() -> f64 {
    read_ns(ClockId::Monotonic) as f64 * 1e-9
}

fn read_ns(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_runs_at_the_graphs_speed_from_its_anchor() {
        let clock = Clock { epoch_ns: 1_000, monotonic_ns: 50, speed: 4.0 };
        assert_eq!(clock.at(50).ns, 1_000);
        assert_eq!(clock.at(60).ns, 1_040);
        assert_eq!(clock.real(8.0).as_secs_f64(), 2.0);
        assert_eq!(clock.real(f64::NAN).as_secs_f64(), 0.0);
    }

    #[test]
    fn the_anchor_survives_its_trip_to_a_child() {
        let clock = Clock::start(1.0);
        let copy: Clock = serde_json::from_str(&serde_json::to_string(&clock).unwrap()).unwrap();
        assert_eq!(copy, clock);
        assert!(copy.now() >= clock.at(clock.monotonic_ns));
    }
}
