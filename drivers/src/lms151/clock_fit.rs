//! When the device's clock reads so much, what does the host's read? `host = a + b * device`, from the earliest arrivals.
//!
//! In: for each telegram the device's transmission counter (u32, microseconds, wraps after 71.6 minutes) and the host's time
//! of receipt. Out: the host time of that transmission and one sigma of it. A telegram can be late and never early, so the line runs
//! along the lower edge of the points: of all lines with no point below, the one that lies closest to them, which is the edge
//! of their lower convex hull at their mean. Before [`FIT_AFTER_S`] of points the rate is taken as exactly 1. It does not
//! know the network's least delay (0 to 0.4 ms on a quiet network); that stays in the stamp. Source: protocol notes 1.5.

use std::collections::VecDeque;
use tsense_geometry::Timestamp;

/// Length of the sliding window, seconds: long enough that 0.4 ms of jitter leave a few ppm of rate, short enough to
/// follow a crystal that warms up.
pub const WINDOW_S: f64 = 30.0;
/// Shortest span of points whose slope is believed, seconds.
pub const FIT_AFTER_S: f64 = 3.0;
/// Most points: the window at 100 telegrams a second, twice what this device sends.
const POINTS_MAX: usize = 3000;
/// Largest believable difference of the two clocks' rates. Crystals differ by 11 ppm or less on the captures.
const RATE_ERROR_MAX: f64 = 200e-6;
/// The two clocks disagree by more than any backlog on the connection (it is cut after 0.5 s of silence): a new device clock.
const JUMP_S: f64 = 2.0;
/// One sigma of the device's own time from the end of its sweep to transmission, seconds: 205 us, evenly spread, on an LMS111.
const DEVICE_SIGMA_S: f64 = 0.205e-3 / 3.464;
/// The share of arrivals that the line rests on: their spread is what the line may be off by. The later ones say how busy
/// the network and this machine are, and nothing about the line.
const EARLY_PERCENT: usize = 10;
/// One sigma claimed while there are too few points to measure it, seconds: on a busy host the first may all be late.
const FIRST_SIGMA_S: f64 = 3e-3;

/// A telegram's host time on the fitted line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitted {
    /// Host time of transmission.
    pub transmitted: Timestamp,
    /// One sigma, seconds: the spread of the earliest tenth of the arrivals, and the device's own jitter.
    pub std_s: f64,
    /// Rate of the host's clock over the device's, minus 1.
    pub rate_error: f64,
}

/// One telegram relative to the window's origin, seconds. `late_s` is host minus device time.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    device_s: f64,
    late_s: f64,
}

/// The sliding fit of one device's clock.
#[derive(Clone, Debug, Default)]
pub struct ClockFit {
    /// Counter of the last telegram, and the unwrapped time it stands for.
    last: Option<(u32, u64)>,
    /// Host time of the first telegram; unwrapped device times count from it.
    origin: Timestamp,
    arrivals: VecDeque<Arrival>,
    resets: u64,
}

impl ClockFit {
    /// Takes one telegram in and says when it was sent.
    pub fn observe(&mut self, device_us: u32, received: Timestamp) -> Fitted {
        let device_s = self.unwrap(device_us, received);
        let late_s = received.seconds_since(self.origin) - device_s;
        self.arrivals.push_back(Arrival { device_s, late_s });
        while self.arrivals.len() > POINTS_MAX || self.arrivals[0].device_s < device_s - WINDOW_S {
            self.arrivals.pop_front();
        }
        let line = self.line();
        let late = |a: &Arrival| a.late_s - line.at(a.device_s);
        Fitted {
            transmitted: self.origin.plus_seconds(device_s + line.at(device_s)),
            std_s: sigma(self.arrivals.iter().map(late).collect()),
            rate_error: line.slope,
        }
    }

    /// Forgets everything: the device started anew.
    pub fn reset(&mut self) {
        self.last = None;
        self.arrivals.clear();
        self.resets += 1;
    }

    /// Times everything was forgotten.
    pub fn resets(&self) -> u64 {
        self.resets
    }

    /// Seconds of device time since the origin, across wraps; starts anew where the two clocks part.
    fn unwrap(&mut self, device_us: u32, received: Timestamp) -> f64 {
        let previous = self.last.zip(self.arrivals.back().copied());
        if let Some(((last_us, unwrapped_us), newest)) = previous {
            let unwrapped_us = unwrapped_us + u64::from(device_us.wrapping_sub(last_us));
            let device_s = unwrapped_us as f64 / 1e6;
            let parted_s = received.seconds_since(self.origin) - device_s - newest.late_s;
            if parted_s.abs() < JUMP_S {
                self.last = Some((device_us, unwrapped_us));
                return device_s;
            }
            self.reset();
        }
        self.last = Some((device_us, 0));
        self.origin = received;
        0.0
    }

    fn line(&self) -> Line {
        let (Some(first), Some(last)) = (self.arrivals.front(), self.arrivals.back()) else { return Line::default() };
        let mean_s = self.arrivals.iter().map(|a| a.device_s).sum::<f64>() / self.arrivals.len() as f64;
        let slope = if last.device_s - first.device_s < FIT_AFTER_S {
            0.0
        } else {
            edge_slope(&lower_hull(self.arrivals.iter().copied()), mean_s).clamp(-RATE_ERROR_MAX, RATE_ERROR_MAX)
        };
        // With the slope limited or assumed, the line still touches the earliest arrival.
        let offset_s = self.arrivals.iter().map(|a| a.late_s - slope * a.device_s).fold(f64::INFINITY, f64::min);
        Line { slope, offset_s }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Line {
    slope: f64,
    offset_s: f64,
}

impl Line {
    fn at(self, device_s: f64) -> f64 {
        self.offset_s + self.slope * device_s
    }
}

/// The points that no line from below can avoid, left to right (Andrew's monotone chain).
fn lower_hull(points: impl Iterator<Item = Arrival>) -> Vec<Arrival> {
    let mut hull: Vec<Arrival> = Vec::new();
    for p in points {
        while let [.., a, b] = hull[..] {
            let turn =
                (b.device_s - a.device_s) * (p.late_s - a.late_s) - (b.late_s - a.late_s) * (p.device_s - a.device_s);
            if turn > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(p);
    }
    hull
}

fn edge_slope(hull: &[Arrival], at_s: f64) -> f64 {
    let edge = hull.windows(2).find(|e| e[1].device_s >= at_s);
    edge.map_or(0.0, |e| (e[1].late_s - e[0].late_s) / (e[1].device_s - e[0].device_s).max(1e-9))
}

/// The delay that the earliest tenth stays below, and the device's own jitter.
fn sigma(mut late_s: Vec<f64>) -> f64 {
    // Too few points say nothing about the spread.
    if late_s.len() < 10 {
        return FIRST_SIGMA_S;
    }
    let at = late_s.len() * EARLY_PERCENT / 100;
    let (_, early_s, _) = late_s.select_nth_unstable_by(at, f64::total_cmp);
    early_s.hypot(DEVICE_SIGMA_S)
}

/// The measured period of the mirror: median of scan-time differences over turn differences.
///
/// Protocol notes 1.5: the nominal rate is not the real one (20.1145 ms instead of 20 on the LMS111).
#[derive(Clone, Debug, Default)]
pub struct RotationPeriod {
    last: Option<(u16, u32)>,
    periods_us: VecDeque<f64>,
}

/// Turns in the median: two seconds at 50 Hz.
const PERIODS_MAX: usize = 101;
/// Turns before the median is believed.
const PERIODS_MIN: usize = 5;
/// Longest run of turns between two telegrams that still gives a period.
const TURNS_MAX: u16 = 100;

impl RotationPeriod {
    /// Takes one telegram's turn counter and scan time in.
    pub fn observe(&mut self, scan_counter: u16, scan_time_us: u32) {
        if let Some((last_counter, last_us)) = self.last.replace((scan_counter, scan_time_us)) {
            let turns = scan_counter.wrapping_sub(last_counter);
            if (1..=TURNS_MAX).contains(&turns) {
                self.periods_us.push_back(f64::from(scan_time_us.wrapping_sub(last_us)) / f64::from(turns));
            }
        }
        if self.periods_us.len() > PERIODS_MAX {
            self.periods_us.pop_front();
        }
    }

    /// The period in seconds, once there are enough turns; `None` before.
    pub fn seconds(&self) -> Option<f64> {
        if self.periods_us.len() < PERIODS_MIN {
            return None;
        }
        let mut sorted: Vec<f64> = self.periods_us.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        Some(sorted[sorted.len() / 2] / 1e6)
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device whose clock starts at `start_us` and runs `ppm` slow against the host's, sending every 20 ms over a
    /// network that delays by up to 0.4 ms, now and then by 5 ms. Returns the worst error of a stamp once fitted, seconds.
    fn worst_error_s(start_us: u32, ppm: f64, telegrams: u32, fit: &mut ClockFit) -> f64 {
        let epoch = Timestamp::from_ns(1_700_000_000_000_000_000);
        let (mut random, mut worst_s) = (0x2545_F491_4F6C_DD1Du64, 0.0f64);
        for i in 0..telegrams {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let unit = (random >> 40) as f64 / (1u64 << 24) as f64;
            let late_s = if i % 17 == 3 { 5e-3 * unit } else { 0.4e-3 * unit * unit };
            let true_s = f64::from(i) * 0.0201145;
            let device_us = start_us.wrapping_add((true_s * 1e6 / (1.0 + ppm * 1e-6)).round() as u32);
            let fitted = fit.observe(device_us, epoch.plus_seconds(true_s + late_s));
            if true_s > FIT_AFTER_S {
                worst_s = worst_s.max((fitted.transmitted.seconds_since(epoch) - true_s).abs());
                assert!(fitted.std_s < 1e-3, "{fitted:?}");
            }
        }
        worst_s
    }

    #[test]
    fn drift_and_jitter_leave_a_tenth_of_a_millisecond() {
        for ppm in [-50.0, 0.0, 11.0, 100.0] {
            let error_s = worst_error_s(1_000_000, ppm, 3000, &mut ClockFit::default());
            assert!(error_s < 0.1e-3, "{ppm} ppm: {error_s}");
        }
    }

    #[test]
    fn the_microsecond_counter_may_wrap_at_any_time() {
        let mut fit = ClockFit::default();
        let error_s = worst_error_s(u32::MAX - 20_000_000, 11.0, 3000, &mut fit);
        assert!(error_s < 0.1e-3 && fit.resets() == 0, "{error_s}");
    }

    #[test]
    fn a_device_that_starts_anew_starts_the_fit_anew() {
        let mut fit = ClockFit::default();
        let epoch = Timestamp::from_ns(1_700_000_000_000_000_000);
        for i in 0..500u32 {
            fit.observe(3_000_000_000 + i * 20_000, epoch.plus_seconds(f64::from(i) * 0.02));
        }
        assert_eq!(fit.resets(), 0);
        let after = epoch.plus_seconds(40.0);
        let fitted = fit.observe(1_000_000, after);
        assert_eq!((fit.resets(), fitted.transmitted, fitted.std_s), (1, after, FIRST_SIGMA_S));
    }

    #[test]
    fn a_backlog_is_stamped_by_the_clock_and_not_by_its_arrival() {
        let mut fit = ClockFit::default();
        let epoch = Timestamp::from_ns(0);
        for i in 0..300u32 {
            // Telegrams 200 to 220 all arrive with the last of them.
            let arrival = if (200..=220).contains(&i) { 220 } else { i };
            let fitted = fit.observe(i * 20_000, epoch.plus_seconds(f64::from(arrival) * 0.02));
            let error_s = fitted.transmitted.seconds_since(epoch) - f64::from(i) * 0.02;
            assert!(error_s.abs() < 1e-6, "telegram {i}: {error_s}");
        }
        assert_eq!(fit.resets(), 0);
    }

    #[test]
    fn a_busy_host_does_not_widen_the_stamp_and_a_wrong_rate_does() {
        // Two in three arrivals come up to 30 ms late.
        let (mut busy, mut wrong) = (ClockFit::default(), ClockFit::default());
        let mut last = None;
        for i in 0..1000u32 {
            let late_s = if i % 3 == 0 { 0.0 } else { f64::from(i * 7919 % 300) * 1e-4 };
            let host_s = f64::from(i) * 0.02;
            let a = busy.observe(i * 20_000, Timestamp::from_seconds(host_s + late_s));
            // A clock 1 % fast is no crystal.
            let b = wrong.observe(i * 20_200, Timestamp::from_seconds(host_s));
            last = Some((a.std_s, b.std_s));
        }
        let (busy_s, wrong_s) = last.unwrap();
        assert!(busy_s < 0.1e-3 && wrong_s > 5e-3, "{busy_s} {wrong_s}");
    }

    #[test]
    fn memory_stays_within_the_window() {
        let mut fit = ClockFit::default();
        for i in 0..100_000u32 {
            // Far faster than any device.
            if i % 97 == 0 || i > 99_900 {
                fit.observe(i * 1_000, Timestamp::from_ns(i64::from(i) * 1_000_000));
            }
            assert!(fit.arrivals.len() <= POINTS_MAX);
        }
    }

    #[test]
    fn the_period_is_the_median_and_counts_turns_without_a_telegram() {
        let mut period = RotationPeriod::default();
        let mut us = u32::MAX - 30_000;
        for scan in [65533u16, 65534, 65535, 0, 2] {
            period.observe(scan, us);
            assert_eq!(period.seconds(), None);
            us = us.wrapping_add(if scan == 0 { 40_229 } else { 20_114 });
        }
        // One turn took 20 ms too long; the median does not mind.
        period.observe(3, us.wrapping_add(20_000));
        assert_eq!(period.seconds(), Some(0.020_114));
    }
}
