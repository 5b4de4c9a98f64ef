//! Time stamps of the standard: milliseconds to day of the month in 32 bits, the date in 16. UTC.
//!
//! In and out: nanoseconds since 1970-01-01 UTC. The day of a stamp wraps every month: the full instant is the one
//! nearest to what the clock says.

use tsense_geometry::NS_PER_S;

const DAY_S: i64 = 86_400;
const NS_PER_MS: i64 = 1_000_000;

/// Year, month, day of a day number since 1970-01-01 (proleptic Gregorian; eras of 400 years that begin in March).
fn civil(days: i64) -> (i64, i64, i64) {
    let z = days + 719_468;
    let era = z.div_euclid(146_097);
    let day_of_era = z.rem_euclid(146_097);
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    (year_of_era + era * 400 + i64::from(month <= 2), month, day_of_year - (153 * shifted + 2) / 5 + 1)
}

/// Day number of a date.
fn days(year: i64, month: i64, day: i64) -> i64 {
    let year = year - i64::from(month <= 2);
    let era = year.div_euclid(400);
    let year_of_era = year.rem_euclid(400);
    let day_of_year = (153 * (month + if month > 2 { -3 } else { 9 }) + 2) / 5 + day - 1;
    era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719_468
}

/// The time stamp of an instant; what is below a millisecond is cut.
pub fn time_stamp(ns: i64) -> u32 {
    let seconds = ns.div_euclid(NS_PER_S);
    let (day_number, of_day) = (seconds.div_euclid(DAY_S), seconds.rem_euclid(DAY_S));
    let ms = ns.rem_euclid(NS_PER_S) / NS_PER_MS;
    let (_, _, day) = civil(day_number);
    (ms | (of_day % 60) << 10 | (of_day / 60 % 60) << 16 | (of_day / 3600) << 22 | day << 27) as u32
}

/// The date stamp of an instant; years outside of 2000 to 2127 are the nearest of these.
pub fn date_stamp(ns: i64) -> u16 {
    let (year, month, day) = civil(ns.div_euclid(NS_PER_S * DAY_S));
    (day | month << 5 | (year - 2000).clamp(0, 127) << 9) as u16
}

/// The instant of a time stamp, in whichever month brings it nearest to `now_ns`; none where it names no time of day,
/// or a day that no month around has.
pub fn nearest_ns(stamp: u32, now_ns: i64) -> Option<i64> {
    let field = |shift: u32, bits: u32| i64::from(stamp >> shift & ((1 << bits) - 1));
    let (ms, second, minute, hour, day) = (field(0, 10), field(10, 6), field(16, 6), field(22, 5), field(27, 5));
    if ms > 999 || second > 59 || minute > 59 || hour > 23 || day < 1 {
        return None;
    }
    let (year, month, _) = civil(now_ns.div_euclid(NS_PER_S * DAY_S));
    let in_month = |step: i64| {
        let months = year * 12 + month - 1 + step;
        let day_number = days(months.div_euclid(12), months.rem_euclid(12) + 1, day);
        // The 31st of a short month would be a day of the next.
        let exists = civil(day_number).2 == day;
        let seconds = day_number * DAY_S + (hour * 60 + minute) * 60 + second;
        exists.then(|| seconds.saturating_mul(NS_PER_S).saturating_add(ms * NS_PER_MS))
    };
    (-1..=1).filter_map(in_month).min_by_key(|ns| ns.abs_diff(now_ns))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2026-11-21 02:55:34.250 UTC.
    const NOW: i64 = 1_795_229_734_250_000_000;

    #[test]
    fn an_instant_has_the_fields_of_its_calendar() {
        assert_eq!(civil(NOW / NS_PER_S / DAY_S), (2026, 11, 21));
        // 250 ms, 34 s, 55 min, 2 h, day 21: the stamp in the golden vectors.
        assert_eq!(time_stamp(NOW).to_le_bytes(), [0xfa, 0x88, 0xb7, 0xa8]);
        assert_eq!(date_stamp(NOW), 21 | 11 << 5 | 26 << 9);
    }

    #[test]
    fn every_day_of_four_centuries_returns() {
        let mut compared = 0;
        for day in -25_567..146_097 - 25_567 {
            let (year, month, of_month) = civil(day);
            assert_eq!(days(year, month, of_month), day);
            compared += 1;
        }
        assert_eq!(compared, 146_097);
    }

    #[test]
    fn the_month_is_the_one_nearest_to_the_clock() {
        let hour = 3600 * NS_PER_S;
        let first_of_december = days(2026, 12, 1) * DAY_S * NS_PER_S;
        // Half an hour before midnight, seen from half an hour after it, and the other way round.
        assert_eq!(
            nearest_ns(time_stamp(first_of_december - hour / 2), first_of_december + hour / 2),
            Some(first_of_december - hour / 2)
        );
        assert_eq!(nearest_ns(time_stamp(first_of_december), first_of_december - hour), Some(first_of_december));
        let new_year = days(2027, 1, 1) * DAY_S * NS_PER_S;
        assert_eq!(nearest_ns(time_stamp(new_year - hour), new_year), Some(new_year - hour));
        assert_eq!(nearest_ns(time_stamp(NOW), NOW + 5), Some(NOW));
    }

    #[test]
    fn what_is_no_time_is_none() {
        for bad in [0, 1000 | 1 << 27, 60 << 10 | 1 << 27, 24 << 22 | 1 << 27] {
            assert_eq!(nearest_ns(bad, NOW), None, "{bad:#x}");
        }
    }
}
