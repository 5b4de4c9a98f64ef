//! Dates and times of day of position sources, and the one timeline they are put on.
//!
//! In: UTC times of day (NMEA sends no date with a fix), GPS weeks and seconds. Out: nanoseconds on a timeline that
//! runs like the source's clock: it does not step back at midnight, nor at a leap second. Only differences on it
//! matter; the clock filter maps it to the graph's clock.

use tsense_geometry::{NS_PER_S, Timestamp};

/// Nanoseconds in a day without a leap second.
pub const DAY_NS: i64 = 86_400 * NS_PER_S;
/// GPS time began on 1980-01-06, seconds after the Unix epoch.
const GPS_EPOCH_S: i64 = 315_964_800;
/// Seconds in a GPS week.
const WEEK_S: i64 = 604_800;

/// A time of day in UTC; up to one second beyond 24 h during a leap second.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TimeOfDay {
    /// Nanoseconds since midnight.
    pub ns: i64,
}

impl TimeOfDay {
    /// From `hhmmss` with any number of decimals. Second 60 exists at 23:59 only.
    pub fn from_hhmmss(text: &str) -> Option<Self> {
        let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
        let digits = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
        if whole.len() != 6 || !digits(whole) || !digits(fraction) {
            return None;
        }
        let two = |at: usize| whole[at..at + 2].parse::<i64>().ok();
        let (hour, minute, second) = (two(0)?, two(2)?, two(4)?);
        let leap = second == 60 && (hour, minute) == (23, 59);
        if hour > 23 || minute > 59 || (second > 59 && !leap) {
            return None;
        }
        // Nine decimals are nanoseconds; more are cut.
        let decimals: String = fraction.chars().chain("000000000".chars()).take(9).collect();
        let ns: i64 = decimals.parse().ok()?;
        Some(Self { ns: ((hour * 60 + minute) * 60 + second) * NS_PER_S + ns })
    }

    fn is_in_leap_second(self) -> bool {
        self.ns >= DAY_NS
    }
}

/// A calendar day.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Date {
    /// Gregorian year.
    pub year: i32,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
}

impl Date {
    /// A day that exists.
    pub fn new(year: i32, month: u8, day: u8) -> Option<Self> {
        let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
        let days = match month {
            4 | 6 | 9 | 11 => 30,
            2 => 28 + u8::from(leap),
            1..=12 => 31,
            _ => return None,
        };
        ((1980..=9999).contains(&year) && (1..=days).contains(&day)).then_some(Self { year, month, day })
    }

    /// From `ddmmyy`; years 80 to 99 are those of 1900.
    pub fn from_ddmmyy(text: &str) -> Option<Self> {
        if text.len() != 6 || !text.bytes().all(|b| b.is_ascii_digit()) {
            return None;
        }
        let two = |at: usize| text[at..at + 2].parse::<u8>().ok();
        let year = i32::from(two(4)?);
        Self::new(if year >= 80 { 1900 + year } else { 2000 + year }, two(2)?, two(0)?)
    }
}

impl std::fmt::Display for Date {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:04}-{:02}-{:02}", self.year, self.month, self.day)
    }
}

/// An instant on the source's timeline, nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceTime {
    /// Nanoseconds; the zero is of no meaning.
    pub ns: i64,
}

impl SourceTime {
    /// Seconds from `earlier` to this instant.
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.ns.saturating_sub(earlier.ns) as f64 / NS_PER_S as f64
    }

    /// GPS week and seconds of week, moved to UTC by the setting so that both kinds of source share a timeline.
    /// None where the seconds are no time of a week.
    pub fn from_gps(week: u32, week_s: f64, gps_minus_utc_s: f64) -> Option<Self> {
        if !(0.0..=WEEK_S as f64).contains(&week_s) || week > 9_999 {
            return None;
        }
        let start_ns = (GPS_EPOCH_S + i64::from(week) * WEEK_S) * NS_PER_S;
        Some(Self { ns: start_ns + ((week_s - gps_minus_utc_s) * NS_PER_S as f64).round() as i64 })
    }
}

/// Puts times of day on the timeline: the day is the one nearest to where the last time and the host's clock say.
#[derive(Debug, Default)]
pub struct DayCounter {
    last: Option<(TimeOfDay, SourceTime, Timestamp)>,
    /// Leap seconds seen since the start: the timeline goes on counting them.
    leap_ns: i64,
}

impl DayCounter {
    /// The instant of a time of day that arrived at `arrival`.
    pub fn place(&mut self, time: TimeOfDay, arrival: Timestamp) -> SourceTime {
        if self.last.is_some_and(|(last, ..)| last.is_in_leap_second() && !time.is_in_leap_second()) {
            self.leap_ns += NS_PER_S;
        }
        let expected_ns = match self.last {
            Some((_, source, at)) => source.ns.saturating_add(arrival.ns.saturating_sub(at.ns)),
            None => arrival.ns,
        };
        let in_day_ns = time.ns + self.leap_ns;
        let days = (expected_ns - in_day_ns + DAY_NS / 2).div_euclid(DAY_NS);
        let source = SourceTime { ns: days * DAY_NS + in_day_ns };
        self.last = Some((time, source, arrival));
        source
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tod(text: &str) -> TimeOfDay {
        TimeOfDay::from_hhmmss(text).unwrap()
    }

    #[test]
    fn times_of_day_are_exact_and_impossible_ones_are_refused() {
        assert_eq!(tod("000001.000000001").ns, NS_PER_S + 1);
        assert_eq!(tod("235960.5").ns, DAY_NS + NS_PER_S / 2);
        for bad in ["240000", "126000", "120060", "1200", "12000a", "120000.x", "-12000", "é2000"] {
            assert_eq!(TimeOfDay::from_hhmmss(bad), None, "{bad}");
        }
    }

    #[test]
    fn dates_exist_or_are_refused() {
        assert_eq!(Date::from_ddmmyy("290224"), Date::new(2024, 2, 29));
        assert_eq!(Date::from_ddmmyy("311299").unwrap().year, 1999);
        for bad in ["290223", "310425", "000125", "011325", "1125", "é1125"] {
            assert_eq!(Date::from_ddmmyy(bad), None, "{bad}");
        }
    }

    /// 2026-11-22 02:26:40 UTC.
    const HOST: i64 = 1_795_314_400;

    fn place(times: &[(&str, f64)]) -> Vec<f64> {
        let mut counter = DayCounter::default();
        let placed: Vec<SourceTime> = times
            .iter()
            .map(|(time, at)| counter.place(tod(time), Timestamp::from_ns(HOST * NS_PER_S).plus_seconds(*at)))
            .collect();
        placed.windows(2).map(|pair| pair[1].seconds_since(pair[0])).collect()
    }

    #[test]
    fn time_goes_on_at_midnight() {
        assert_eq!(place(&[("235959.90", 0.0), ("000000.00", 0.1), ("000000.10", 0.2)]), [0.1, 0.1]);
    }

    #[test]
    fn time_goes_on_through_a_leap_second_and_after_it() {
        let steps =
            place(&[("235959.5", 0.0), ("235960.0", 0.5), ("235960.5", 1.0), ("000000.0", 1.5), ("000001.0", 2.5)]);
        assert_eq!(steps, [0.5, 0.5, 0.5, 1.0]);
    }

    #[test]
    fn a_time_that_steps_back_a_little_is_not_taken_for_tomorrow() {
        assert_eq!(place(&[("120000.00", 0.0), ("115959.00", 1.0)]), [-1.0]);
    }

    #[test]
    fn gps_weeks_and_utc_share_a_timeline() {
        // Week 1695, 309428.000 s is 2012-07-04 13:57:08 GPS time; with 18 s as today 13:56:50.
        let gps = SourceTime::from_gps(1695, 309_428.0, 18.0).unwrap();
        let day_s = gps.ns / NS_PER_S % 86_400;
        assert_eq!(day_s, 13 * 3600 + 56 * 60 + 50);
        assert_eq!(SourceTime::from_gps(1695, f64::NAN, 18.0), None);
        assert_eq!(SourceTime::from_gps(1695, 604_801.0, 18.0), None);
    }
}
