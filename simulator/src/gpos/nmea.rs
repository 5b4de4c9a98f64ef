//! NMEA-0183 sentences of one epoch. Out: ASCII lines with checksum. Fields: shared protocol notes, 4.1.

use super::date::date_of_day;
use tsense_geometry::Timestamp;

/// What the receiver reports at an epoch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fix {
    pub at: Timestamp,
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    pub ellipsoidal_m: f64,
    /// True heading, degrees 0 to 360.
    pub heading_deg: f64,
    pub roll_deg: f64,
    pub pitch_deg: f64,
    pub speed_m_s: f64,
    /// True course, degrees 0 to 360.
    pub course_deg: f64,
    pub quality: u8,
    /// Sigma of roll and pitch, and of the heading, degrees.
    pub sigmas_deg: [f64; 2],
}

/// Height of the geoid above the ellipsoid in Florida, metres.
const GEOID_M: f64 = -28.5;
const KNOTS_PER_M_S: f64 = 3600.0 / 1852.0;

/// A sentence with its dollar sign, checksum and line end.
pub(crate) fn sentence(body: &str) -> Vec<u8> {
    let checksum = body.bytes().fold(0u8, |x, b| x ^ b);
    format!("${body}*{checksum:02X}\r\n").into_bytes()
}

/// `ddmm.mmmmmmmm` and the letter of the hemisphere; eight decimals of a minute are 0.02 mm.
fn angle(degrees: f64, width: usize, letters: [char; 2]) -> String {
    // Rounded first, so that 59.999999999 minutes never print as 60.
    let units = (degrees.abs() * 60e8).round() as u64;
    let (whole, minutes) = (units / 6_000_000_000, units % 6_000_000_000);
    let (m, fraction) = (minutes / 100_000_000, minutes % 100_000_000);
    let letter = letters[usize::from(degrees < 0.0)];
    format!("{whole:0width$}{m:02}.{fraction:08},{letter}")
}

struct Clock {
    time: String,
    date: (i64, u8, u8),
}

fn clock(at: Timestamp) -> Clock {
    let ms = at.ns.div_euclid(1_000_000);
    let (day, ms) = (ms.div_euclid(86_400_000), ms.rem_euclid(86_400_000));
    let s = ms / 1000;
    let time = format!("{:02}{:02}{:02}.{:03}", s / 3600, s / 60 % 60, s % 60, ms % 1000);
    Clock { time, date: date_of_day(day) }
}

/// All sentences of an epoch; the position and the attitude come last and complete it. HDT and ZDA come once a second.
pub(crate) fn epoch(fix: &Fix) -> Vec<Vec<u8>> {
    let Clock { time, date: (year, month, day) } = clock(fix.at);
    let latitude = angle(fix.latitude_deg, 2, ['N', 'S']);
    let longitude = angle(fix.longitude_deg, 3, ['E', 'W']);
    let (knots, course) = (fix.speed_m_s * KNOTS_PER_M_S, fix.course_deg);
    let mode = ['N', 'A', 'D', 'P', 'R', 'F'][usize::from(fix.quality.min(5))];
    let mut lines = Vec::with_capacity(6);
    if fix.at.ns.rem_euclid(1_000_000_000) < 1_000_000 {
        lines.push(format!("GPZDA,{time},{day:02},{month:02},{year:04},00,00"));
        lines.push(format!("GPHDT,{:.3},T", fix.heading_deg));
    }
    let short = year.rem_euclid(100);
    lines.push(format!(
        "GPRMC,{time},A,{latitude},{longitude},{knots:.3},{course:.2},{day:02}{month:02}{short:02},,,{mode}"
    ));
    lines.push(format!("GPVTG,{course:.2},T,,M,{knots:.3},N,{:.3},K,{mode}", fix.speed_m_s * 3.6));
    let above_geoid = fix.ellipsoidal_m - GEOID_M;
    let quality = fix.quality;
    lines.push(format!(
        "GPGGA,{time},{latitude},{longitude},{quality},18,0.7,{above_geoid:.4},M,{GEOID_M:.4},M,1.0,0120"
    ));
    let [level, heading] = fix.sigmas_deg;
    let grade = if quality >= 4 { 2 } else { 1 };
    lines.push(format!(
        "PASHR,{time},{:.4},T,{:+.4},{:+.4},+0.00,{level:.3},{level:.3},{heading:.3},{grade},1",
        fix.heading_deg, fix.roll_deg, fix.pitch_deg
    ));
    lines.iter().map(|line| sentence(line)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fix() -> Fix {
        Fix {
            // 2026-01-01 13:46:58.250
            at: Timestamp::from_ns((20_454 * 86_400 + 13 * 3600 + 46 * 60 + 58) * 1_000_000_000 + 250_000_000),
            latitude_deg: 29.5,
            longitude_deg: -82.25,
            ellipsoidal_m: 40.0,
            heading_deg: 359.5,
            roll_deg: 1.25,
            pitch_deg: -2.5,
            speed_m_s: 1.0,
            course_deg: 90.0,
            quality: 4,
            sigmas_deg: [0.03, 0.08],
        }
    }

    #[test]
    fn an_epoch_has_its_sentences_with_one_time_and_right_checksums() {
        let text: Vec<String> = epoch(&fix()).into_iter().map(|l| String::from_utf8(l).unwrap()).collect();
        assert_eq!(text.len(), 4);
        assert!(text[0].starts_with("$GPRMC,134658.250,A,2930.00000000,N,08215.00000000,W,1.944,90.00,010126,,,R*"));
        assert!(text[1].starts_with("$GPVTG,90.00,T,,M,1.944,N,3.600,K,R*"));
        assert!(
            text[2].starts_with(
                "$GPGGA,134658.250,2930.00000000,N,08215.00000000,W,4,18,0.7,68.5000,M,-28.5000,M,1.0,0120*"
            )
        );
        assert!(text[3].starts_with("$PASHR,134658.250,359.5000,T,+1.2500,-2.5000,+0.00,0.030,0.030,0.080,2,1*"));
        for line in &text {
            let (body, check) = line[1..].trim_end().split_once('*').unwrap();
            assert_eq!(u8::from_str_radix(check, 16).unwrap(), body.bytes().fold(0, |x, b| x ^ b));
        }
    }

    #[test]
    fn a_whole_second_brings_date_and_heading() {
        let whole = Fix { at: Timestamp::from_ns(20_454 * 86_400 * 1_000_000_000), ..fix() };
        let lines = epoch(&whole);
        assert!(lines[0].starts_with(b"$GPZDA,000000.000,01,01,2026,00,00*"));
        assert!(lines[1].starts_with(b"$GPHDT,359.500,T*"));
    }

    #[test]
    fn the_checksum_of_a_known_sentence_is_right_and_minutes_never_reach_60() {
        assert!(sentence("GPGLL,5300.97914,N,00259.98174,E,125926,A").ends_with(b"*28\r\n"));
        assert_eq!(angle(29.999_999_999_999_9, 2, ['N', 'S']), "3000.00000000,N");
        assert_eq!(angle(-0.5, 3, ['E', 'W']), "00030.00000000,W");
    }
}
