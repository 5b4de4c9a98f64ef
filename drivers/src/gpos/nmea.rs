//! NMEA-0183 sentences: text between `$` and `*` in, values out. The checksum is the framer's business.
//!
//! An empty field is absent, never zero. Angles stay in degrees as sent, heights and deviations in metres, speeds
//! become metres per second, times of day nanoseconds. `PASHR` is proprietary and has no talker.
//!
//! Source: wire format notes section 4.1.

use super::calendar::{Date, TimeOfDay};

/// A position fix (`GGA`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gga {
    /// UTC time of day.
    pub time: TimeOfDay,
    /// Latitude and longitude, degrees, north and east positive.
    pub position_deg: Option<[f64; 2]>,
    /// 0 none, 1 GPS, 2 differential, 3 PPS, 4 RTK fixed, 5 RTK float, 6 dead reckoning, 7 manual, 8 simulator.
    pub quality: u8,
    /// Height above the geoid, metres.
    pub above_geoid_m: Option<f64>,
    /// Geoid above the ellipsoid, metres.
    pub undulation_m: Option<f64>,
}

/// Speed over ground and where it points (`RMC`, `VTG`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Course {
    /// Speed over ground, metres per second.
    pub speed_m_s: Option<f64>,
    /// Course over ground, degrees from true north.
    pub course_deg: Option<f64>,
}

/// Attitude (`PASHR`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pashr {
    /// UTC time of day.
    pub time: TimeOfDay,
    /// Heading, degrees from true north.
    pub heading_deg: Option<f64>,
    /// Roll, degrees, in the maker's sign.
    pub roll_deg: Option<f64>,
    /// Pitch, degrees, in the maker's sign.
    pub pitch_deg: Option<f64>,
    /// One sigma of roll, pitch, heading, degrees.
    pub std_deg: [Option<f64>; 3],
    /// 0 inertial unit off, 1 aligned; some makers leave it out.
    pub imu_status: Option<u8>,
}

/// A sentence this driver uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sentence {
    /// Position.
    Gga(Gga),
    /// Recommended minimum: time, whether it is valid, course and speed, date.
    Rmc(TimeOfDay, bool, Course, Option<Date>),
    /// True heading, degrees.
    Hdt(f64),
    /// Course and speed.
    Vtg(Course),
    /// Time and date.
    Zda(TimeOfDay, Option<Date>),
    /// Attitude.
    Pashr(Pashr),
    /// Deviations of latitude, longitude and height, metres (`GST`).
    Gst(TimeOfDay, [Option<f64>; 3]),
}

/// Knots to metres per second: 1852 m an hour.
const M_S_PER_KNOT: f64 = 1852.0 / 3600.0;

/// Why a sentence was not taken.
pub type Reject = &'static str;

/// The sentence in this text; none where it is of a kind that is not used.
pub fn parse(body: &str) -> Result<Option<Sentence>, Reject> {
    let fields = Fields(body.split(',').collect());
    let head = fields.0[0];
    let sentence = match (head, head.get(2..)) {
        ("PASHR", _) => pashr(&fields)?,
        (_, Some("GGA")) => gga(&fields)?,
        (_, Some("RMC")) => rmc(&fields)?,
        (_, Some("VTG")) => Some(Sentence::Vtg(Course {
            speed_m_s: match fields.number(5)? {
                Some(knots) => Some(knots * M_S_PER_KNOT),
                None => fields.number(7)?.map(|km_h| km_h / 3.6),
            },
            course_deg: fields.number(1)?,
        })),
        (_, Some("HDT")) => fields.number(1)?.map(Sentence::Hdt),
        (_, Some("ZDA")) => zda(&fields)?,
        (_, Some("GST")) => {
            let std_m = [fields.number(6)?, fields.number(7)?, fields.number(8)?];
            fields.time(1)?.map(|time| Sentence::Gst(time, std_m))
        }
        _ => None,
    };
    Ok(sentence)
}

fn gga(fields: &Fields<'_>) -> Result<Option<Sentence>, Reject> {
    let Some(time) = fields.time(1)? else { return Ok(None) };
    let latitude = fields.angle(2, ("N", "S"), 90.0, "latitude beyond 90 degrees")?;
    let longitude = fields.angle(4, ("E", "W"), 180.0, "longitude beyond 180 degrees")?;
    Ok(Some(Sentence::Gga(Gga {
        time,
        position_deg: latitude.zip(longitude).map(|(latitude, longitude)| [latitude, longitude]),
        quality: fields.small(6)?.unwrap_or(0),
        above_geoid_m: fields.number(9)?,
        undulation_m: fields.number(11)?,
    })))
}

fn rmc(fields: &Fields<'_>) -> Result<Option<Sentence>, Reject> {
    let Some(time) = fields.time(1)? else { return Ok(None) };
    let speed_m_s = fields.number(7)?.map(|knots| knots * M_S_PER_KNOT);
    let course = Course { speed_m_s, course_deg: fields.number(8)? };
    let date = match fields.text(9) {
        "" => None,
        text => Some(Date::from_ddmmyy(text).ok_or("unreadable date")?),
    };
    Ok(Some(Sentence::Rmc(time, fields.text(2) == "A", course, date)))
}

fn zda(fields: &Fields<'_>) -> Result<Option<Sentence>, Reject> {
    let Some(time) = fields.time(1)? else { return Ok(None) };
    let date = match (fields.number(4)?, fields.number(3)?, fields.number(2)?) {
        (Some(year), Some(month), Some(day)) => {
            Some(Date::new(year as i32, month as u8, day as u8).ok_or("unreadable date")?)
        }
        _ => None,
    };
    Ok(Some(Sentence::Zda(time, date)))
}

fn pashr(fields: &Fields<'_>) -> Result<Option<Sentence>, Reject> {
    // Ashtech's own sub-sentences ($PASHR,POS ...) have a name where the time stands.
    if fields.text(1).starts_with(|c: char| c.is_ascii_alphabetic()) {
        return Ok(None);
    }
    let Some(time) = fields.time(1)? else { return Ok(None) };
    Ok(Some(Sentence::Pashr(Pashr {
        time,
        heading_deg: fields.number(2)?,
        roll_deg: fields.number(4)?,
        pitch_deg: fields.number(5)?,
        std_deg: [fields.number(7)?, fields.number(8)?, fields.number(9)?],
        imu_status: fields.small(11)?,
    })))
}

/// The fields, 0 being the sentence's name.
struct Fields<'a>(Vec<&'a str>);

impl Fields<'_> {
    /// A field, empty where absent.
    fn text(&self, at: usize) -> &str {
        self.0.get(at).map_or("", |field| field.trim())
    }

    /// A plain decimal number: no exponents, no names of infinities.
    fn number(&self, at: usize) -> Result<Option<f64>, Reject> {
        let text = self.text(at);
        if text.is_empty() {
            return Ok(None);
        }
        let plain = text.bytes().all(|b| b.is_ascii_digit() || matches!(b, b'.' | b'-' | b'+'));
        let number = plain.then(|| text.parse().ok()).flatten();
        number.map(Some).ok_or("unreadable number")
    }

    fn small(&self, at: usize) -> Result<Option<u8>, Reject> {
        let text = self.text(at);
        if text.is_empty() { Ok(None) } else { text.parse().map(Some).map_err(|_| "unreadable number") }
    }

    fn time(&self, at: usize) -> Result<Option<TimeOfDay>, Reject> {
        let text = self.text(at);
        if text.is_empty() { Ok(None) } else { TimeOfDay::from_hhmmss(text).map(Some).ok_or("unreadable time") }
    }

    /// `dddmm.mmmm` and its hemisphere, degrees.
    fn angle(&self, at: usize, signs: (&str, &str), most: f64, beyond: Reject) -> Result<Option<f64>, Reject> {
        let Some(number) = self.number(at)? else { return Ok(None) };
        if number < 0.0 {
            return Err("unreadable number");
        }
        let degrees = (number / 100.0).floor();
        let minutes = number - degrees * 100.0;
        if minutes >= 60.0 {
            return Err("minutes of 60 or more");
        }
        let angle = degrees + minutes / 60.0;
        if angle > most {
            return Err(beyond);
        }
        match self.text(at + 1) {
            hemisphere if hemisphere == signs.0 => Ok(Some(angle)),
            hemisphere if hemisphere == signs.1 => Ok(Some(-angle)),
            _ => Err("no hemisphere"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ok(body: &str) -> Sentence {
        parse(body).unwrap().unwrap_or_else(|| panic!("{body} is not used"))
    }

    fn time(text: &str) -> TimeOfDay {
        TimeOfDay::from_hhmmss(text).unwrap()
    }

    #[test]
    fn gga_keeps_every_digit_and_the_fraction_of_the_second() {
        let Sentence::Gga(gga) =
            ok("GNGGA,134658.25,2938.9873213,N,08221.4012987,W,4,17,0.7,42.318,M,-28.500,M,1.0,0001")
        else {
            panic!()
        };
        assert_eq!(gga.time.ns, ((13 * 3600 + 46 * 60 + 58) * 4 + 1) * 250_000_000);
        let [latitude, longitude] = gga.position_deg.unwrap();
        assert!((latitude - (29.0 + 38.987_321_3 / 60.0)).abs() < 1e-12);
        assert!((longitude + (82.0 + 21.401_298_7 / 60.0)).abs() < 1e-12);
        assert_eq!((gga.quality, gga.above_geoid_m, gga.undulation_m), (4, Some(42.318), Some(-28.5)));
    }

    #[test]
    fn empty_fields_are_absent() {
        let Sentence::Gga(gga) = ok("GPGGA,120000,,,,,0,,,,M,,M,,") else { panic!() };
        assert_eq!((gga.position_deg, gga.quality, gga.above_geoid_m, gga.undulation_m), (None, 0, None, None));
        assert_eq!(ok("GPVTG,,T,,M,,N,,K,N"), Sentence::Vtg(Course::default()));
        assert_eq!(parse("GPHDT,,T"), Ok(None));
        assert_eq!(parse("GPGGA,,,,"), Ok(None));
        assert_eq!(parse("GPGSV,3,1,09"), Ok(None));
    }

    #[test]
    fn course_speed_heading_and_dates_are_read() {
        let course = Course { speed_m_s: Some(10.0 * 1852.0 / 3600.0), course_deg: Some(231.8) };
        let date = Date::new(2026, 11, 22);
        assert_eq!(
            ok("GPRMC,134658.25,A,2938.98,N,08221.40,W,10.0,231.8,221126,4.1,W,A"),
            Sentence::Rmc(time("134658.25"), true, course, date)
        );
        assert_eq!(
            ok("GPVTG,231.8,T,,M,,N,36.0,K,A"),
            Sentence::Vtg(Course { speed_m_s: Some(10.0), course_deg: Some(231.8) })
        );
        assert_eq!(ok("HEHDT,359.99,T"), Sentence::Hdt(359.99));
        assert_eq!(ok("GPZDA,134658.00,22,11,2026,00,00"), Sentence::Zda(time("134658"), date));
        assert_eq!(
            ok("GPGST,134658.00,1.2,,,,0.011,0.012,0.025"),
            Sentence::Gst(time("134658"), [Some(0.011), Some(0.012), Some(0.025)])
        );
    }

    #[test]
    fn pashr_is_read_with_and_without_its_last_field() {
        let Sentence::Pashr(with) = ok("PASHR,134658.250,91.25,T,-1.50,+2.25,0.00,0.012,0.013,0.055,2,1") else {
            panic!()
        };
        assert_eq!((with.heading_deg, with.roll_deg, with.pitch_deg), (Some(91.25), Some(-1.5), Some(2.25)));
        assert_eq!(with.std_deg, [Some(0.012), Some(0.013), Some(0.055)]);
        assert_eq!(with.imu_status, Some(1));
        let Sentence::Pashr(without) = ok("PASHR,134658.250,91.25,T,-1.50,2.25,0.00,0.012,0.013,0.055,2") else {
            panic!()
        };
        assert_eq!(without, Pashr { imu_status: None, ..with });
        assert_eq!(parse("PASHR,POS,0,09,134658.25"), Ok(None));
    }

    #[test]
    fn impossible_values_are_rejected_with_the_reason() {
        let check = |body: &str, expected: Reject| assert_eq!(parse(body), Err(expected), "{body}");
        check("GPGGA,120000,9000.01,N,00000.0,E,1,,,1,M,1,M,,", "latitude beyond 90 degrees");
        check("GPGGA,120000,4500.00,N,18000.1,E,1,,,1,M,1,M,,", "longitude beyond 180 degrees");
        check("GPGGA,120000,4560.00,N,00000.0,E,1,,,1,M,1,M,,", "minutes of 60 or more");
        check("GPGGA,120000,4500.00,,00000.0,E,1,,,1,M,1,M,,", "no hemisphere");
        check("GPGGA,126000,4500.00,N,00000.0,E,1,,,1,M,1,M,,", "unreadable time");
        check("GPHDT,nan,T", "unreadable number");
        check("GPRMC,120000,A,,,,,1,2,310225", "unreadable date");
    }

    proptest! {
        #[test]
        fn random_sentences_never_panic(
            head in prop_oneof![Just("GPGGA"), Just("PASHR"), Just("GPRMC"), Just("GPZDA"), Just("GPVTG"), Just("é"), Just("")],
            fields in proptest::collection::vec("[0-9.NSEW+-]{0,12}|.{0,4}", 0..15),
        ) {
            let _ = parse(&format!("{head},{}", fields.join(",")));
        }
    }
}
