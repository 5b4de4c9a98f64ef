//! Sentences of one instant are put together to a fix.
//!
//! In: parsed NMEA sentences with the instants of their times of day and their arrival. Out: fixes, each once. An epoch
//! is given out when it holds what the last one held (learned, so that nothing is waited for that does not come), when
//! the line has been silent for a while, or when the next epoch begins. `HDT` and `VTG` carry no time: they belong to
//! the burst they come in.

use super::calendar::SourceTime;
use super::config::Config;
use super::fix::Fix;
use super::nmea::{Course, Gga, Pashr, Reject, Sentence};
use tsense_contract::PoseQuality;
use tsense_geometry::Timestamp;

/// Longest an epoch is kept open on a line that never falls silent, in waits for silence.
const OPEN_MAX_WAITS: f64 = 5.0;
/// Oldest heading of `HDT` that is used for a position of another burst, seconds.
const HEADING_AGE_MAX_S: f64 = 0.15;
/// One sigma of a course taken for a heading, degrees: slip and crab angle off-road.
const COURSE_STD_DEG: f64 = 5.0;
/// One sigma of a heading held while standing, degrees.
const HELD_STD_DEG: f64 = 45.0;

/// Kinds of sentences, one bit each.
mod kind {
    pub const GGA: u8 = 1;
    pub const PASHR: u8 = 2;
    pub const HDT: u8 = 4;
    pub const VTG: u8 = 8;
    pub const RMC: u8 = 16;
    pub const GST: u8 = 32;
}

/// What is known of one instant.
#[derive(Clone, Copy, Debug)]
struct Epoch {
    time: SourceTime,
    opened: Timestamp,
    kinds: u8,
    gga: Option<Gga>,
    course: Option<Course>,
    std_m: [Option<f64>; 3],
}

/// Puts sentences together.
#[derive(Debug)]
pub struct Assembler {
    wait_s: f64,
    attitude_age_max_s: f64,
    course_speed_min_m_s: f64,
    unknown_tilt_std_deg: f64,
    undulation_m: Option<f64>,
    open: Option<Epoch>,
    /// Kinds of the last epoch, and those that came too late for it.
    expected: u8,
    given_out: Option<SourceTime>,
    attitude: Option<(SourceTime, Pashr)>,
    heading: Option<(Timestamp, f64)>,
    /// Untimed sentences that came before their epoch.
    early_course: Option<(Timestamp, Course)>,
    held_course_deg: Option<f64>,
    last_byte: Timestamp,
}

impl Assembler {
    /// Nothing seen yet.
    pub fn new(config: &Config) -> Self {
        Self {
            wait_s: config.epoch_wait_ms / 1e3,
            attitude_age_max_s: config.attitude_age_max_ms / 1e3,
            course_speed_min_m_s: config.course_speed_min_m_s,
            unknown_tilt_std_deg: config.unknown_tilt_std_deg,
            undulation_m: config.undulation_m,
            open: None,
            expected: 0,
            given_out: None,
            attitude: None,
            heading: None,
            early_course: None,
            held_course_deg: None,
            last_byte: Timestamp::default(),
        }
    }

    /// Bytes of any kind came: the line is not silent.
    pub fn touch(&mut self, now: Timestamp) {
        self.last_byte = now;
    }

    /// When [`Assembler::tick`] gives out the open epoch.
    pub fn deadline(&self) -> Option<Timestamp> {
        let open = self.open.as_ref()?;
        let longest = open.opened.plus_seconds(self.wait_s * OPEN_MAX_WAITS);
        Some(self.last_byte.plus_seconds(self.wait_s).min(longest))
    }

    /// Gives out the open epoch when its time is up.
    pub fn tick(&mut self, now: Timestamp) -> Option<Result<Fix, Reject>> {
        if self.deadline().is_some_and(|deadline| now >= deadline) { self.close() } else { None }
    }

    /// Takes a sentence; `time` is the instant of its time of day where it has one.
    pub fn take(&mut self, sentence: Sentence, time: Option<SourceTime>, now: Timestamp) -> Vec<Result<Fix, Reject>> {
        let mut out = Vec::new();
        if let Some(time) = time {
            if self.given_out == Some(time) {
                self.expected |= kind_of(&sentence);
                self.note_late(sentence, time);
                return if kind_of(&sentence) == 0 { out } else { vec![Err("sentence after its epoch")] };
            }
            if self.open.is_some_and(|open| open.time != time) {
                out.extend(self.close());
            }
            if self.open.is_none() {
                self.open_at(time, now);
            }
        }
        self.note(sentence, time, now);
        if self.is_complete() {
            out.extend(self.close());
        }
        out
    }

    fn open_at(&mut self, time: SourceTime, now: Timestamp) {
        let in_burst = |at: &Timestamp| now.seconds_since(*at) < self.wait_s;
        let course = self.early_course.take().filter(|(at, _)| in_burst(at)).map(|(_, course)| course);
        let heading = self.heading.is_some_and(|(at, _)| in_burst(&at));
        let kinds = if heading { kind::HDT } else { 0 } | if course.is_some() { kind::VTG } else { 0 };
        self.open = Some(Epoch { time, opened: now, kinds, gga: None, course, std_m: [None; 3] });
    }

    /// An attitude that came late is still the newest one.
    fn note_late(&mut self, sentence: Sentence, time: SourceTime) {
        if let Sentence::Pashr(pashr) = sentence {
            self.attitude = Some((time, pashr));
        }
    }

    fn note(&mut self, sentence: Sentence, time: Option<SourceTime>, now: Timestamp) {
        match (sentence, time) {
            (Sentence::Pashr(pashr), Some(time)) => self.attitude = Some((time, pashr)),
            (Sentence::Hdt(heading_deg), _) => self.heading = Some((now, heading_deg)),
            (Sentence::Vtg(course), _) if self.open.is_none() => {
                self.early_course = Some((now, course));
                self.expected |= kind::VTG;
            }
            _ => {}
        }
        let Some(open) = &mut self.open else { return };
        open.kinds |= kind_of(&sentence);
        match sentence {
            Sentence::Gga(gga) => open.gga = Some(gga),
            Sentence::Vtg(course) => open.course = Some(course),
            Sentence::Rmc(_, true, course, _) => open.course = open.course.or(Some(course)),
            Sentence::Gst(_, std_m) => open.std_m = std_m,
            _ => {}
        }
    }

    fn is_complete(&self) -> bool {
        let Some(open) = &self.open else { return false };
        let has = |kinds: u8| open.kinds & kinds == kinds;
        let attitude = has(kind::PASHR) || has(kind::HDT);
        has(kind::GGA) && has(self.expected) && (attitude || self.expected & !kind::GGA != 0)
    }

    /// Gives out the open epoch; one without a position gives nothing.
    fn close(&mut self) -> Option<Result<Fix, Reject>> {
        let open = self.open.take()?;
        self.given_out = Some(open.time);
        let gga = open.gga?;
        self.expected = open.kinds;
        Some(self.fix(&open, &gga))
    }

    fn fix(&mut self, open: &Epoch, gga: &Gga) -> Result<Fix, Reject> {
        let quality = quality(gga.quality)?;
        let position_deg = gga.position_deg.ok_or("fix without position")?;
        let undulation_m = gga.undulation_m.or(self.undulation_m).ok_or("no geoid separation")?;
        let height_m = gga.above_geoid_m.ok_or("fix without height")? + undulation_m;
        let attitude = self.attitude(open)?;
        let nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        let [latitude_std, longitude_std, height_std] = open.std_m;
        Ok(Fix {
            time: open.time,
            position_deg,
            height_m,
            quality: if attitude.held { PoseQuality::Degraded } else { quality },
            position_std_m: [nan(longitude_std), nan(latitude_std), nan(height_std)],
            velocity_m_s: open.course.and_then(velocity),
            tilt_deg: attitude.tilt_deg,
            heading_deg: attitude.heading_deg,
            attitude_std_deg: attitude.std_deg,
        })
    }

    /// The best attitude there is: PASHR, then HDT, then the course, then the last course.
    fn attitude(&mut self, open: &Epoch) -> Result<Attitude, Reject> {
        let aligned = |pashr: &Pashr| pashr.imu_status != Some(0);
        let fresh = |time: SourceTime| open.time.seconds_since(time).abs() <= self.attitude_age_max_s;
        let pashr = self.attitude.filter(|(time, pashr)| fresh(*time) && aligned(pashr)).map(|(_, pashr)| pashr);
        let unknown = self.unknown_tilt_std_deg;
        let axis = |value: Option<f64>, std: Option<f64>| match value {
            Some(value) => (value, std.unwrap_or(f64::NAN)),
            None => (0.0, unknown),
        };
        let (roll, roll_std) = axis(pashr.and_then(|p| p.roll_deg), pashr.and_then(|p| p.std_deg[0]));
        let (pitch, pitch_std) = axis(pashr.and_then(|p| p.pitch_deg), pashr.and_then(|p| p.std_deg[1]));
        let (heading_deg, heading_std, held) = match pashr.and_then(|p| p.heading_deg) {
            Some(heading) => (heading, pashr.and_then(|p| p.std_deg[2]).unwrap_or(f64::NAN), false),
            None => self.heading(open)?,
        };
        Ok(Attitude { tilt_deg: [roll, pitch], heading_deg, std_deg: [roll_std, pitch_std, heading_std], held })
    }

    /// Heading, its sigma, and whether it is only held from before.
    fn heading(&mut self, open: &Epoch) -> Result<(f64, f64, bool), Reject> {
        if let Some((at, heading_deg)) = self.heading
            && self.last_byte.seconds_since(at) <= HEADING_AGE_MAX_S
        {
            return Ok((heading_deg, f64::NAN, false));
        }
        let fast = |course: &Course| course.speed_m_s.is_some_and(|speed| speed >= self.course_speed_min_m_s);
        if let Some(course_deg) = open.course.filter(fast).and_then(|course| course.course_deg) {
            self.held_course_deg = Some(course_deg);
            return Ok((course_deg, COURSE_STD_DEG, false));
        }
        self.held_course_deg.map(|held| (held, HELD_STD_DEG, true)).ok_or("no heading yet")
    }
}

struct Attitude {
    tilt_deg: [f64; 2],
    heading_deg: f64,
    std_deg: [f64; 3],
    held: bool,
}

fn kind_of(sentence: &Sentence) -> u8 {
    match sentence {
        Sentence::Gga(_) => kind::GGA,
        Sentence::Pashr(_) => kind::PASHR,
        Sentence::Hdt(_) => kind::HDT,
        Sentence::Vtg(_) => kind::VTG,
        Sentence::Rmc(..) => kind::RMC,
        Sentence::Gst(..) => kind::GST,
        Sentence::Zda(..) => 0,
    }
}

fn quality(gga: u8) -> Result<PoseQuality, Reject> {
    match gga {
        0 => Err("no fix (quality 0)"),
        1 | 3 => Ok(PoseQuality::Single),
        2 | 9 => Ok(PoseQuality::Differential),
        4 => Ok(PoseQuality::RtkFixed),
        5 => Ok(PoseQuality::RtkFloat),
        // Dead reckoning, typed in by hand, a simulator, or a number not known.
        _ => Ok(PoseQuality::Degraded),
    }
}

/// East, north; up is not said. None without speed, or without course while moving.
fn velocity(course: Course) -> Option<[f64; 3]> {
    let speed = course.speed_m_s?;
    let direction = course.course_deg.or((speed < 0.1).then_some(0.0))?.to_radians();
    Some([speed * direction.sin(), speed * direction.cos(), f64::NAN])
}

#[cfg(test)]
mod tests {
    use super::super::calendar::TimeOfDay;
    use super::super::nmea::parse;
    use super::*;

    /// Sentences with their arrival in milliseconds; fixes as they come, with the arrival that gave them out.
    fn run(config: &Config, sentences: &[(i64, &str)]) -> Vec<(i64, Result<Fix, Reject>)> {
        let mut assembler = Assembler::new(config);
        let mut out = Vec::new();
        let mut queue = sentences.iter();
        let mut next = queue.next();
        for ms in 0..=sentences.last().unwrap().0 + 500 {
            let now = Timestamp::from_ns(ms * 1_000_000);
            while let Some((_, body)) = next.filter(|(at, _)| *at == ms) {
                assembler.touch(now);
                let sentence = parse(body).unwrap().unwrap();
                let time = match sentence {
                    Sentence::Gga(Gga { time, .. }) | Sentence::Pashr(Pashr { time, .. }) => Some(time),
                    Sentence::Rmc(time, ..) | Sentence::Gst(time, _) | Sentence::Zda(time, _) => Some(time),
                    Sentence::Hdt(_) | Sentence::Vtg(_) => None,
                };
                let time = time.map(|TimeOfDay { ns }| SourceTime { ns });
                out.extend(assembler.take(sentence, time, now).into_iter().map(|fix| (ms, fix)));
                next = queue.next();
            }
            out.extend(assembler.tick(now).map(|fix| (ms, fix)));
        }
        out
    }

    fn gga(time: &str) -> String {
        format!("GPGGA,{time},4500.0,N,00700.0,E,4,12,0.7,100.0,M,47.5,M,,")
    }

    #[test]
    fn position_and_attitude_of_one_instant_are_given_out_as_soon_as_both_are_there() {
        let pashr = "PASHR,120000.00,90.0,T,1.0,-2.0,0.0,0.1,0.2,0.3,2,1";
        let fixes = run(&Config::default(), &[(5, &gga("120000.00")), (9, pashr)]);
        let [(9, Ok(fix))] = &fixes[..] else { panic!("{fixes:?}") };
        assert_eq!((fix.height_m, fix.heading_deg, fix.tilt_deg), (147.5, 90.0, [1.0, -2.0]));
        assert_eq!((fix.quality, fix.attitude_std_deg), (PoseQuality::RtkFixed, [0.1, 0.2, 0.3]));
    }

    #[test]
    fn an_attitude_of_another_instant_is_not_mixed_in() {
        let pashr = "PASHR,115959.90,90.0,T,1.0,-2.0,0.0,0.1,0.2,0.3,2,1";
        let fixes = run(&Config::default(), &[(5, pashr), (9, &gga("120000.00"))]);
        let [(39, Err("no heading yet"))] = &fixes[..] else { panic!("{fixes:?}") };
    }

    #[test]
    fn a_slow_line_is_learned_and_late_sentences_are_counted() {
        let (mut stream, mut texts) = (Vec::new(), Vec::new());
        for i in 0..4 {
            let time = format!("12000{i}.00");
            // The attitude comes 60 ms after the position: too late once, waited for from then on.
            texts.push((100 + i * 1000, gga(&time)));
            texts.push((160 + i * 1000, format!("PASHR,{time},90.0,T,1.0,-2.0,0.0,0.1,0.2,0.3,2,1")));
        }
        stream.extend(texts.iter().map(|(at, text)| (*at, text.as_str())));
        let config = Config { epoch_wait_ms: 30.0, ..Config::default() };
        let first = run(&config, &stream);
        assert!(first.contains(&(160, Err("sentence after its epoch"))), "{first:?}");
        // Silence ends the epoch before the attitude comes; with the wait set to the line, all are whole.
        let config = Config { epoch_wait_ms: 80.0, ..Config::default() };
        let fixes = run(&config, &stream);
        let at: Vec<i64> = fixes.iter().filter(|(_, fix)| fix.is_ok()).map(|(at, _)| *at).collect();
        assert_eq!(at, [160, 1160, 2160, 3160], "{fixes:?}");
    }

    #[test]
    fn heading_comes_from_hdt_and_then_from_the_course_of_a_moving_vehicle() {
        let fixes = run(&Config::default(), &[(5, &gga("120000.00")), (6, "GPHDT,123.0,T")]);
        let [(6, Ok(fix))] = &fixes[..] else { panic!("{fixes:?}") };
        assert_eq!((fix.heading_deg, fix.tilt_deg, fix.attitude_std_deg[0]), (123.0, [0.0, 0.0], 10.0));

        let moving = (6, "GPVTG,200.0,T,,M,,N,18.0,K");
        let standing = (1006, "GPVTG,,T,,M,,N,0.0,K");
        let (first, second) = (gga("120000.00"), gga("120001.00"));
        let fixes = run(&Config::default(), &[(5, first.as_str()), moving, (1005, second.as_str()), standing]);
        let [(36, Ok(moving)), (1006, Ok(standing))] = &fixes[..] else { panic!("{fixes:?}") };
        assert_eq!((moving.heading_deg, moving.attitude_std_deg[2]), (200.0, 5.0));
        let [east, north, up] = moving.velocity_m_s.unwrap();
        assert!((east.hypot(north) - 5.0).abs() < 1e-9 && east < 0.0 && north < 0.0 && up.is_nan());
        assert_eq!((standing.heading_deg, standing.quality), (200.0, PoseQuality::Degraded));
    }

    #[test]
    fn fixes_without_quality_or_ellipsoidal_height_are_rejected() {
        let none = "GPGGA,120000.00,4500.0,N,00700.0,E,0,00,,100.0,M,47.5,M,,";
        assert_eq!(run(&Config::default(), &[(5, none), (6, "GPHDT,1.0,T")]), [(6, Err("no fix (quality 0)"))]);
        let bare = "GPGGA,120000.00,4500.0,N,00700.0,E,4,12,,100.0,M,,M,,";
        assert_eq!(run(&Config::default(), &[(5, bare), (6, "GPHDT,1.0,T")]), [(6, Err("no geoid separation"))]);
        let config = Config { undulation_m: Some(-30.0), ..Config::default() };
        assert_eq!(run(&config, &[(5, bare), (6, "GPHDT,1.0,T")])[0].1.unwrap().height_m, 70.0);
    }

    #[test]
    fn deviations_of_gst_are_carried() {
        let gst = "GPGST,120000.00,,,,,0.01,0.02,0.03";
        let fixes = run(&Config::default(), &[(5, &gga("120000.00")), (6, gst), (7, "GPHDT,1.0,T")]);
        assert_eq!(fixes[0].1.unwrap().position_std_m, [0.02, 0.01, 0.03], "east, north, height");
    }
}
