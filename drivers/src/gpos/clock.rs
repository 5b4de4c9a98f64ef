//! From the source's clock to the graph's: a sliding minimum of what every sentence took to arrive.
//!
//! In: pairs of (instant on the source's timeline, arrival on the graph's clock). Out: the graph's instant of any
//! instant of the source. Arrival is late by a varying delay and never early, so the least difference of the last
//! seconds is the clock offset plus the least delay; the latter is a calibration constant. A difference that leaves
//! the band for good is a step of the source's clock, and the filter begins anew.
//!
//! Source: wire format notes section 4.1 (stamp with the UTC of the fix mapped to host time).

use super::calendar::SourceTime;
use std::collections::VecDeque;
use tsense_geometry::{NS_PER_S, Timestamp};

/// Length of the sliding window, seconds: the graph's clock drifts 1 ms in it at 50 ppm.
const WINDOW_S: f64 = 20.0;
/// Differences that may be the least of some window: every pair of the window, at 400 a second.
const KEPT_MAX: usize = 8192;
/// Beyond this distance from the least difference, a pair is no delay but a step or a fault, nanoseconds.
const STEP_NS: i64 = NS_PER_S / 4;
/// Pairs in a row that are early by a step before the source's clock is believed to have stepped.
const EARLY_PAIRS: u32 = 3;
/// How long all pairs must be late by a step before the source's clock is believed to have stepped, seconds.
const LATE_S: f64 = 2.0;

/// The filter.
#[derive(Debug, Default)]
pub struct DelayFilter {
    /// (arrival, arrival - source), both rising: the front is the least difference of the window.
    least: VecDeque<(Timestamp, i64)>,
    early_pairs: u32,
    late_since: Option<Timestamp>,
    steps: u64,
}

impl DelayFilter {
    /// Takes a pair; false where it does not fit and the instant cannot be mapped well now.
    pub fn observe(&mut self, source: SourceTime, arrival: Timestamp) -> bool {
        let difference_ns = arrival.ns.saturating_sub(source.ns);
        while self.least.front().is_some_and(|(at, _)| arrival.seconds_since(*at) > WINDOW_S) {
            self.least.pop_front();
        }
        let Some(&(_, least_ns)) = self.least.front() else {
            self.insert(arrival, difference_ns);
            return true;
        };
        let beyond_ns = difference_ns.saturating_sub(least_ns);
        let fits = beyond_ns.abs() <= STEP_NS;
        if fits {
            (self.early_pairs, self.late_since) = (0, None);
            self.insert(arrival, difference_ns);
        } else if self.is_step(beyond_ns, arrival) {
            self.steps += 1;
            (self.early_pairs, self.late_since) = (0, None);
            self.least.clear();
            self.insert(arrival, difference_ns);
            return true;
        }
        // A late pair is a delay for now; an early one would be stamped in the future.
        fits || beyond_ns > 0
    }

    fn is_step(&mut self, beyond_ns: i64, arrival: Timestamp) -> bool {
        if beyond_ns < 0 {
            self.early_pairs += 1;
            self.early_pairs >= EARLY_PAIRS
        } else {
            arrival.seconds_since(*self.late_since.get_or_insert(arrival)) >= LATE_S
        }
    }

    fn insert(&mut self, arrival: Timestamp, difference_ns: i64) {
        while self.least.back().is_some_and(|(_, kept)| *kept >= difference_ns) {
            self.least.pop_back();
        }
        if self.least.len() >= KEPT_MAX {
            self.least.pop_front();
        }
        self.least.push_back((arrival, difference_ns));
    }

    /// The graph's instant, `latency_s` being the least delay; none before the first pair.
    pub fn to_graph(&self, source: SourceTime, latency_s: f64) -> Option<Timestamp> {
        let (_, least_ns) = self.least.front()?;
        Some(Timestamp::from_ns(source.ns.saturating_add(*least_ns)).plus_seconds(-latency_s))
    }

    /// Steps of the source's clock so far.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Forgets everything: the line was opened anew.
    pub fn clear(&mut self) {
        *self = Self { steps: self.steps, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(seconds: f64) -> SourceTime {
        SourceTime { ns: (seconds * 1e9).round() as i64 }
    }

    /// A small generator with a fixed seed: delays of 0 to 40 ms, most of them long.
    fn delays() -> impl Iterator<Item = f64> {
        let mut state = 7_u64;
        std::iter::repeat_with(move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let uniform = (state >> 40) as f64 / (1_u64 << 24) as f64;
            0.040 * uniform.sqrt()
        })
    }

    #[test]
    fn jittered_arrivals_give_stamps_near_the_least_delay_once_settled() {
        let mut filter = DelayFilter::default();
        let mut compared = 0;
        for (i, delay_s) in (0..3000).zip(delays()) {
            let t = f64::from(i) * 0.1;
            // The graph's clock is 1000 s ahead and gains 20 ppm.
            let truth = 1000.0 + t * (1.0 + 20e-6);
            assert!(filter.observe(source(t), Timestamp::from_seconds(truth + delay_s)));
            let stamp = filter.to_graph(source(t), 0.0).unwrap();
            if t > 10.0 {
                let late_s = stamp.seconds_since(Timestamp::from_seconds(truth));
                assert!((-0.0005..0.009).contains(&late_s), "{late_s} s late at {t}");
                compared += 1;
            }
        }
        assert!(compared > 2500);
    }

    #[test]
    fn one_early_pair_is_held_out_and_three_are_a_step() {
        let mut filter = DelayFilter::default();
        let at = |seconds: f64| Timestamp::from_seconds(1000.0 + seconds);
        for i in 0..10 {
            filter.observe(source(f64::from(i)), at(f64::from(i)));
        }
        assert!(!filter.observe(source(15.0), at(10.0)), "5 s early: a wrong time");
        assert!(filter.observe(source(11.0), at(11.0)));
        for i in 12..14 {
            assert!(!filter.observe(source(f64::from(i) + 5.0), at(f64::from(i))));
        }
        assert!(filter.observe(source(19.0), at(14.0)));
        assert_eq!((filter.steps(), filter.to_graph(source(19.0), 0.0)), (1, Some(at(14.0))));
    }

    #[test]
    fn a_clock_that_steps_back_is_followed_after_two_seconds_and_a_stall_is_not() {
        let mut filter = DelayFilter::default();
        let at = |seconds: f64| Timestamp::from_seconds(1000.0 + seconds);
        filter.observe(source(0.0), at(0.0));
        // A stall of one second: what was held up arrives late, the map stays.
        filter.observe(source(1.0), at(2.0));
        assert_eq!(filter.to_graph(source(1.0), 0.0), Some(at(1.0)));
        filter.observe(source(2.1), at(2.1));
        for i in 0..30 {
            let t = 3.0 + f64::from(i) * 0.1;
            filter.observe(source(t - 1.0), at(t));
        }
        assert_eq!((filter.steps(), filter.to_graph(source(4.0), 0.0)), (1, Some(at(5.0))));
    }
}
