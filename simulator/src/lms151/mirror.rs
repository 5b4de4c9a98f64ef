//! The turning mirror: which beams make a scan, when each one flies, and the telegram that tells of them.
//!
//! A 50 Hz scanner really turns every 20.1145 ms; beam i flies `i * step / 360` turns after the first; the telegram
//! leaves 3.1 ms after the last beam. Source: shared protocol notes, 1.5 (measured on a real LMS111).

use super::Lms151Options;
use super::device::{DataConfig, Measuring};
use super::scan::{Channel, ScanTelegram};
use super::shape::RANGE_E4DEG;
use crate::cast::{BeamReturn, Code};
use crate::rng::{fraction, hash};
use tsense_geometry::Timestamp;

/// Shortest time from the last beam to the transmission, microseconds, and how much longer it may be.
const TRANSMISSION_US: [f64; 2] = [3067.0, 205.0];
/// Scans after the start that the real device marks as not yet good.
const WARM_UP_SCANS: u64 = 7;

/// The device's clocks and counters over its life.
#[derive(Clone, Debug)]
pub struct Mirror {
    clock_start_us: f64,
    clock_rate: f64,
    seed: u64,
    /// Turns since the device started up.
    turns: u64,
    /// Telegrams since the device started up.
    telegrams: u64,
    counter_start: u16,
    /// Turns since the measurement began.
    pub(super) turns_measured: u64,
}

impl Mirror {
    pub(super) fn new(options: &Lms151Options, seed: u64) -> Self {
        let faults = &options.faults;
        let wraps = (1u64 << 32) as f64 - faults.wrap_after_s * 1e6;
        Self {
            clock_start_us: if faults.wrap_after_s > 0.0 { wraps } else { f64::from(options.clock_start_us) },
            clock_rate: 1.0 + faults.clock_drift_ppm * 1e-6,
            seed,
            turns: 0,
            telegrams: 0,
            counter_start: options.counter_start,
            turns_measured: 0,
        }
    }

    /// The device was switched off and on: clock and counters begin at zero.
    pub(super) fn reboot(&mut self) {
        (self.clock_start_us, self.turns, self.telegrams, self.turns_measured, self.counter_start) = (0.0, 0, 0, 0, 0);
    }

    /// Counts a turn whose beams were not used.
    pub(super) fn skip(&mut self, turns: u64) {
        self.turns += turns;
        self.turns_measured += turns;
    }

    fn device_us(&self, booted: Timestamp, at: Timestamp) -> u32 {
        // Wraps at 2^32, every 71.6 minutes.
        (self.clock_start_us + at.seconds_since(booted) * 1e6 * self.clock_rate) as i64 as u32
    }

    /// Time from the last beam of this turn to its transmission, seconds.
    pub(super) fn transmission_s(&self) -> f64 {
        let jitter = fraction(hash(&[self.seed, 0x7A, self.turns]));
        (TRANSMISSION_US[0] + TRANSMISSION_US[1] * jitter) / 1e6
    }

    /// Whether this turn is transmitted: every n-th is.
    pub(super) fn is_output(&self, data: &DataConfig) -> bool {
        self.turns.is_multiple_of(u64::from(data.interval.max(1)))
    }

    /// The telegram of a turn, and the count goes on.
    pub(super) fn telegram(
        &mut self,
        measuring: &Measuring,
        first_beam: Timestamp,
        contamination: u8,
        returns: &[BeamReturn],
    ) -> ScanTelegram {
        let shape = measuring.shape;
        let last_beam = first_beam.plus_seconds(shape.sweep_s());
        let sent = last_beam.plus_seconds(self.transmission_s());
        let (low, high) = window(measuring);
        let warming = u8::from(self.turns_measured < WARM_UP_SCANS);
        let telegram = ScanTelegram {
            status: [[0, 2, 5, 5][usize::from(contamination.min(3))].max(warming), 0],
            telegram_counter: self.counter_start.wrapping_add(self.telegrams as u16),
            scan_counter: self.counter_start.wrapping_add(self.turns as u16),
            scan_time_us: self.device_us(measuring.booted, last_beam),
            transmission_time_us: self.device_us(measuring.booted, sent),
            frequency_centihz: shape.frequency_centihz,
            measurement_frequency_100hz: shape.frequency_centihz * (3_600_000 / shape.step_e4deg.max(1)) / 10_000,
            start_e4deg: RANGE_E4DEG[0] + (low as i32) * shape.step_e4deg as i32,
            step_e4deg: shape.step_e4deg as u16,
            channels_16: distance_channels(&measuring.data, &returns[low..high]),
            channels_8: Vec::new(),
            device_name: measuring.data.device_name.then(|| "simulated".to_owned()),
            clock_ms: measuring.data.clock.then(|| (sent.seconds_since(measuring.booted).max(0.0) * 1e3) as u64),
        };
        self.telegrams += 1;
        self.skip(1);
        with_strength(telegram, &measuring.data, &returns[low..high])
    }
}

/// Indices of the transmitted beams: the first, and the one after the last.
fn window(measuring: &Measuring) -> (usize, usize) {
    let (step, beams) = (measuring.shape.step_e4deg as i32, measuring.shape.beams());
    let [start, stop] = measuring.window_e4deg;
    let low = ((start - RANGE_E4DEG[0] + step - 1) / step).max(0) as usize;
    let high = ((stop - RANGE_E4DEG[0]) / step + 1).max(0) as usize;
    (low.min(beams), high.clamp(low.min(beams), beams))
}

fn millimetres(range_m: f64) -> u16 {
    // Values below 16 are codes, so a range never is one.
    (range_m * 1000.0).round().clamp(16.0, 65_535.0) as u16
}

fn distance_channels(data: &DataConfig, returns: &[BeamReturn]) -> Vec<Channel> {
    let first = |r: &BeamReturn| match r {
        BeamReturn::Nothing(code) => code.raw(),
        BeamReturn::Echoes { first, strongest, .. } => {
            millimetres(if data.second_echo { first.range_m } else { strongest.range_m })
        }
    };
    let second = |r: &BeamReturn| match r {
        BeamReturn::Echoes { second: Some(second), .. } => millimetres(second.range_m),
        _ => 0,
    };
    let mut channels = vec![Channel { name: "DIST1", values: returns.iter().map(first).collect() }];
    if data.second_echo {
        channels.push(Channel { name: "DIST2", values: returns.iter().map(second).collect() });
    }
    channels
}

/// Strength of an echo as the device tells it, 0 to 1: logarithmic in the light received.
fn level(strength: f64) -> f64 {
    ((20.0 + 25.0 * strength.max(1.0).log2()) / 254.0).min(1.0)
}

fn with_strength(mut telegram: ScanTelegram, data: &DataConfig, returns: &[BeamReturn]) -> ScanTelegram {
    if !data.remission {
        return telegram;
    }
    let (full, dazzled) = if data.remission_16_bit { (65_534.0, 0xFFFF) } else { (254.0, 0xFF) };
    let value = |strength: f64| (level(strength) * full).round() as u16;
    let first = |r: &BeamReturn| match r {
        BeamReturn::Nothing(Code::Dazzled) => dazzled,
        BeamReturn::Nothing(_) => 0,
        BeamReturn::Echoes { first, strongest, .. } => {
            value(if data.second_echo { first.strength } else { strongest.strength })
        }
    };
    let second = |r: &BeamReturn| match r {
        BeamReturn::Echoes { second: Some(second), .. } => value(second.strength),
        _ => 0,
    };
    let section = if data.remission_16_bit { &mut telegram.channels_16 } else { &mut telegram.channels_8 };
    section.push(Channel { name: "RSSI1", values: returns.iter().map(first).collect() });
    if data.second_echo {
        section.push(Channel { name: "RSSI2", values: returns.iter().map(second).collect() });
    }
    telegram
}

#[cfg(test)]
mod tests {
    use super::super::shape::ScanShape;
    use super::*;
    use crate::cast::Echo;
    use crate::faults::Faults;
    use crate::trace::Kind;

    const FAST: ScanShape = ScanShape { frequency_centihz: 5000, step_e4deg: 5000 };

    fn measuring(window_e4deg: [i32; 2]) -> Measuring {
        let data = DataConfig {
            second_echo: false,
            remission: true,
            remission_16_bit: false,
            device_name: false,
            clock: false,
            interval: 1,
        };
        Measuring { since: Timestamp::default(), shape: FAST, data, window_e4deg, booted: Timestamp::default() }
    }

    fn echo(range_m: f64) -> BeamReturn {
        let echo = Echo { range_m, strength: 4.0, kind: Kind::Ground };
        BeamReturn::Echoes { first: echo, second: None, strongest: echo }
    }

    #[test]
    fn beams_and_times_are_those_of_the_notes() {
        assert_eq!(FAST.beams(), 541);
        assert!((FAST.period_s() - 0.020_114_5).abs() < 1e-12);
        assert!((FAST.sweep_s() - 0.015_086).abs() < 1e-6);
        assert!((FAST.angle_rad(270) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        let fine = ScanShape { frequency_centihz: 2500, step_e4deg: 2500 };
        assert_eq!(fine.beams(), 1081);
        assert!((fine.period_s() - 0.040_229).abs() < 1e-12);
    }

    #[test]
    fn the_counter_wraps_when_it_was_told_to_and_times_are_3_ms_apart() {
        let faults = Faults { wrap_after_s: 10.0, ..Faults::default() };
        let mut mirror = Mirror::new(&Lms151Options { faults, counter_start: 0xFFFF, ..Lms151Options::default() }, 1);
        let returns = vec![echo(5.0); 541];
        let mut at = |s: f64| mirror.telegram(&measuring(RANGE_E4DEG), Timestamp::from_seconds(s), 0, &returns);
        let (before, after) = (at(9.9), at(10.0));
        assert!(before.scan_time_us > 0xFFFE_0000 && after.scan_time_us < 20_000);
        assert_eq!((before.telegram_counter, after.telegram_counter), (0xFFFF, 0));
        let gap = before.transmission_time_us.wrapping_sub(before.scan_time_us);
        assert!((3066..=3273).contains(&gap), "{gap}");
        assert_eq!(before.measurement_frequency_100hz, 360);
    }

    #[test]
    fn the_window_cuts_beams_and_moves_the_first_angle() {
        let mut mirror = Mirror::new(&Lms151Options::default(), 1);
        let returns: Vec<BeamReturn> = (0..541).map(|i| echo(1.0 + f64::from(i) * 0.01)).collect();
        let cut = mirror.telegram(&measuring([0, 1_800_000]), Timestamp::default(), 0, &returns);
        assert_eq!((cut.start_e4deg, cut.channels_16[0].values.len()), (0, 361));
        assert_eq!(cut.channels_16[0].values[0], 1900);
        assert_eq!(cut.channels_8[0].values[0], 70, "20 + 25 log2(4)");
    }

    #[test]
    fn contamination_and_warming_up_show_in_the_status() {
        let mut mirror = Mirror::new(&Lms151Options::default(), 1);
        let returns = vec![BeamReturn::Nothing(Code::TooWeak); 541];
        let mut status = |contamination| {
            mirror.telegram(&measuring(RANGE_E4DEG), Timestamp::default(), contamination, &returns).status
        };
        assert_eq!(status(0), [1, 0]);
        for _ in 1..WARM_UP_SCANS {
            status(0);
        }
        assert_eq!((status(0), status(1), status(2)), ([0, 0], [2, 0], [5, 0]));
    }
}
