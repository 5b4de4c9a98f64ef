//! The telegram and scan counters: what was lost, what came twice, and when the device started anew.
//!
//! In: the two 16-bit counters and the device clock of each scan telegram, in the order of arrival. Out: what the step from
//! the last one means, and totals. Both counters wrap after 65536 (22 minutes at 50 Hz). Source: protocol notes 1.4, 1.5.

/// What one telegram is, seen from the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The first since the driver started.
    First,
    /// The one after the last.
    Next,
    /// Some were lost in the device or on the way.
    Gap {
        /// How many.
        lost: u16,
    },
    /// The same telegram again: drop it.
    Duplicate,
    /// The device started anew: its clock and counters mean something else now.
    Restart,
}

/// Totals since the driver started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Telegrams taken, duplicates not among them.
    pub telegrams: u64,
    /// Telegrams lost, by the telegram counter.
    pub lost: u64,
    /// Telegrams that came twice.
    pub duplicates: u64,
    /// Times the device started anew.
    pub restarts: u64,
    /// Mirror turns the device did not send a telegram for (output interval above 1).
    pub turns_not_sent: u64,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    telegram: u16,
    scan: u16,
    device_us: u32,
}

/// Follows the counters of one device.
#[derive(Clone, Debug, Default)]
pub struct Counters {
    last: Option<Seen>,
    totals: Totals,
}

/// No telegram follows another faster than this, microseconds: half a turn at 50 Hz. A counter that ran ahead of the
/// clock by more belongs to a device that started anew.
const SHORTEST_PERIOD_US: u64 = 10_000;
/// Telegrams that may be missing beyond what the clock explains, before the counter is taken for a new one.
const GAP_SLACK: u64 = 8;

impl Counters {
    /// Takes one telegram's counters in.
    pub fn observe(&mut self, telegram: u16, scan: u16, device_us: u32) -> Step {
        let now = Seen { telegram, scan, device_us };
        let step = self.last.map_or(Step::First, |last| step_between(last, now));
        match step {
            Step::Duplicate => {
                self.totals.duplicates += 1;
                return step;
            }
            Step::Gap { lost } => self.totals.lost += u64::from(lost),
            Step::Restart => self.totals.restarts += 1,
            Step::Next | Step::First => {}
        }
        if let (Step::Next | Step::Gap { .. }, Some(last)) = (step, self.last) {
            let turns = scan.wrapping_sub(last.scan);
            let telegrams = telegram.wrapping_sub(last.telegram);
            self.totals.turns_not_sent += u64::from(turns.saturating_sub(telegrams));
        }
        self.totals.telegrams += 1;
        self.last = Some(now);
        step
    }

    /// Totals so far.
    pub fn totals(&self) -> Totals {
        self.totals
    }
}

fn step_between(last: Seen, now: Seen) -> Step {
    let telegrams = now.telegram.wrapping_sub(last.telegram);
    let elapsed_us = now.device_us.wrapping_sub(last.device_us);
    let clock_went_back = elapsed_us >= 1 << 31;
    match telegrams {
        0 if elapsed_us == 0 && now.scan == last.scan => Step::Duplicate,
        // The counter has gone round exactly, or the device started anew and happens to be here again.
        0 => Step::Restart,
        _ if clock_went_back || telegrams >= 1 << 15 => Step::Restart,
        1 => Step::Next,
        n if u64::from(n) > u64::from(elapsed_us) / SHORTEST_PERIOD_US + GAP_SLACK => Step::Restart,
        n => Step::Gap { lost: n - 1 },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counters and device time in milliseconds of each telegram; what each must be called.
    fn check(cases: &[(u16, u16, u32, Step)]) -> Totals {
        let mut counters = Counters::default();
        for (i, (telegram, scan, ms, expected)) in cases.iter().enumerate() {
            assert_eq!(counters.observe(*telegram, *scan, ms.wrapping_mul(1000)), *expected, "case {i}");
        }
        counters.totals()
    }

    #[test]
    fn gaps_and_duplicates_are_counted_across_the_wrap() {
        let totals = check(&[
            (65534, 65530, 0, Step::First),
            (65535, 65531, 20, Step::Next),
            (65535, 65531, 20, Step::Duplicate),
            (0, 65532, 40, Step::Next),
            (4, 0, 120, Step::Gap { lost: 3 }),
            (5, 1, 140, Step::Next),
        ]);
        assert_eq!(totals, Totals { telegrams: 5, lost: 3, duplicates: 1, restarts: 0, turns_not_sent: 0 });
    }

    #[test]
    fn turns_without_a_telegram_are_not_losses() {
        let totals = check(&[(7, 100, 0, Step::First), (8, 103, 60, Step::Next), (9, 106, 120, Step::Next)]);
        assert_eq!((totals.lost, totals.turns_not_sent), (0, 4));
    }

    #[test]
    fn a_device_that_started_anew_is_noticed_by_counter_or_clock() {
        check(&[(900, 900, 9_000, Step::First), (1, 1, 9_020, Step::Restart), (2, 2, 9_040, Step::Next)]);
        check(&[(900, 900, 9_000, Step::First), (901, 1, 20, Step::Restart)]);
        check(&[(40_000, 4, 1_000, Step::First), (3, 4, 2_000, Step::Restart)]);
        check(&[(5, 5, 1_000, Step::First), (5, 9, 2_000, Step::Restart)]);
    }

    #[test]
    fn a_long_silence_is_a_gap_as_long_as_the_clock_explains_it() {
        check(&[(10, 10, 0, Step::First), (510, 510, 10_000, Step::Gap { lost: 499 })]);
    }

    #[test]
    fn the_device_clock_wraps_without_a_restart() {
        let mut counters = Counters::default();
        counters.observe(1, 1, u32::MAX - 5_000);
        assert_eq!(counters.observe(2, 2, 15_000), Step::Next);
    }
}
