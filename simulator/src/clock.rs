//! World time: an epoch plus a monotonic clock times a speed. The whole world runs by it: devices, vehicle, people.
//!
//! At speed 2 everything happens twice as fast as on a wall clock: a scanner sends 100 scans a second and says 50.

use rustix::thread::{ClockId, NanosleepRelativeResult, clock_nanosleep_absolute};
use rustix::time::{Timespec, clock_gettime};
use tsense_geometry::{NS_PER_S, Timestamp};

/// World time as a value: copies agree for ever, in any process of the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldClock {
    start: Timestamp,
    anchor_ns: i64,
    speed: f64,
}

fn nanoseconds(t: Timespec) -> i64 {
    t.tv_sec.saturating_mul(NS_PER_S).saturating_add(t.tv_nsec)
}

fn monotonic_ns() -> i64 {
    nanoseconds(clock_gettime(ClockId::Monotonic))
}

impl WorldClock {
    /// World time that begins now, at the wall clock's time of day.
    pub fn starting_now(speed: f64) -> Self {
        let start = Timestamp::from_ns(nanoseconds(clock_gettime(ClockId::Realtime)));
        Self::new(start, monotonic_ns(), speed)
    }

    /// World time that is `start` when `CLOCK_MONOTONIC` is at `anchor_ns`. A speed that is not above zero becomes 1.
    pub fn new(start: Timestamp, anchor_ns: i64, speed: f64) -> Self {
        Self { start, anchor_ns, speed: if speed > 0.0 && speed.is_finite() { speed } else { 1.0 } }
    }

    /// World time now.
    pub fn now(&self) -> Timestamp {
        let elapsed_ns = (monotonic_ns() - self.anchor_ns) as f64 * self.speed;
        self.start.plus_ns(elapsed_ns as i64)
    }

    /// When the world began.
    pub fn start(&self) -> Timestamp {
        self.start
    }

    /// World seconds a wall-clock second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Wall-clock seconds until an instant of world time; 0 once it is past.
    pub fn real_seconds_until(&self, instant: Timestamp) -> f64 {
        (instant.seconds_since(self.now()) / self.speed).max(0.0)
    }

    /// Sleeps until an instant of world time.
    pub fn sleep_until(&self, instant: Timestamp) {
        let at_ns = self.anchor_ns + (instant.ns.saturating_sub(self.start.ns) as f64 / self.speed) as i64;
        let at = Timespec { tv_sec: at_ns.div_euclid(NS_PER_S), tv_nsec: at_ns.rem_euclid(NS_PER_S) };
        // A signal ends the sleep early; the instant has then not come, so sleep on.
        while clock_nanosleep_absolute(ClockId::Monotonic, &at) == Err(rustix::io::Errno::INTR) {}
    }

    /// Sleeps for a time of the wall clock, however fast the world runs.
    pub fn sleep_real(seconds: f64) {
        let ns = (seconds.max(0.0) * NS_PER_S as f64) as i64;
        let mut left = Timespec { tv_sec: ns / NS_PER_S, tv_nsec: ns % NS_PER_S };
        while let NanosleepRelativeResult::Interrupted(rest) = rustix::thread::nanosleep(&left) {
            left = rest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_world_runs_as_fast_as_it_is_told() {
        let clock = WorldClock::new(Timestamp::from_ns(1_000), monotonic_ns() - 2 * NS_PER_S, 3.0);
        let world_s = clock.now().seconds_since(clock.start());
        assert!((6.0..7.0).contains(&world_s), "{world_s}");
        let before = clock.now();
        clock.sleep_until(before.plus_seconds(0.03));
        assert!(clock.now().seconds_since(before) >= 0.03);
    }
}
