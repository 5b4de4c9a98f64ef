//! What the unit says it is: resolution, limits and speeds of both axes, asked for and never assumed.
//!
//! In: answers to the questions of [`Survey`]. Out: a [`Unit`], or why there is none, and counts from angles and back.
//! Source: wire format notes section 3.3; the resolution depends on the step mode (185.1428 seconds of arc on a D46
//! in half steps, 11.5714 on an E-series in eighth steps).

use super::answer::{Axis, numbers};
use super::command::{Command, Item};
use super::config::Config;
use serde::Serialize;

/// One axis as the unit describes it. Counts are the unit's own, sign and zero included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AxisUnit {
    /// Seconds of arc per count.
    pub resolution_arcsec: f64,
    /// Least position, counts.
    pub least: Option<i32>,
    /// Greatest position, counts.
    pub greatest: Option<i32>,
    /// Slowest speed, counts per second.
    pub speed_min: Option<i32>,
    /// Fastest speed, counts per second.
    pub speed_max: Option<i32>,
    /// Position when asked, counts.
    pub position: i32,
}

/// A pan-tilt unit as it describes itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Unit {
    /// Firmware version in the maker's words; empty where the unit does not say.
    pub version: String,
    /// The pan axis.
    pub pan: AxisUnit,
    /// The tilt axis.
    pub tilt: AxisUnit,
    /// Whether `B` answers with the position of both axes.
    pub combined_query: bool,
}

impl Unit {
    /// One of the two axes.
    pub fn axis(&self, axis: Axis) -> &AxisUnit {
        match axis {
            Axis::Pan => &self.pan,
            Axis::Tilt => &self.tilt,
        }
    }
}

impl std::fmt::Display for Unit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "version: {}", if self.version.is_empty() { "not said" } else { &self.version })?;
        for axis in [Axis::Pan, Axis::Tilt] {
            let unit = self.axis(axis);
            let degrees = |counts: i32| f64::from(counts) * unit.resolution_arcsec / 3600.0;
            let said = |counts: Option<i32>| counts.map_or("not said".into(), |c| format!("{:.2}", degrees(c)));
            writeln!(
                f,
                "{axis}: {} arcsec a count, at {:.2} deg, from {} to {} deg, {} to {} deg/s (the unit's own signs)",
                unit.resolution_arcsec,
                degrees(unit.position),
                said(unit.least),
                said(unit.greatest),
                said(unit.speed_min),
                said(unit.speed_max),
            )?;
        }
        write!(f, "combined query (B): {}", if self.combined_query { "yes" } else { "no" })
    }
}

/// Coarsest and finest resolution that is believed, seconds of arc per count.
const RESOLUTION_ARCSEC: std::ops::RangeInclusive<f64> = 0.1..=3600.0;
/// How far `B` may differ from `PP` and `TP` at a standstill, counts.
const COMBINED_TOLERANCE: i32 = 2;

/// The questions, and the answers so far.
#[derive(Debug)]
pub struct Survey {
    questions: std::vec::IntoIter<Command>,
    unit: Unit,
}

impl Survey {
    /// All questions open. `B` is asked only where it is wanted.
    pub fn new(combined_query: bool) -> Self {
        use Item::{Greatest, Least, Position, Resolution, SpeedMax, SpeedMin};
        let mut questions = vec![Command::Version];
        for item in [Resolution, Least, Greatest, SpeedMin, SpeedMax, Position] {
            questions.extend([Command::Ask(Axis::Pan, item), Command::Ask(Axis::Tilt, item)]);
        }
        if combined_query {
            questions.push(Command::AskBoth);
        }
        Self { questions: questions.into_iter(), unit: Unit::default() }
    }

    /// The next question.
    pub fn ask(&mut self) -> Option<Command> {
        self.questions.next()
    }

    /// Takes the answer to a question. A refusal needs no call: not every model has everything.
    pub fn answered(&mut self, question: Command, text: &str) {
        match question {
            Command::Version => self.unit.version = text.into(),
            Command::Ask(axis, item) => {
                let Some(&number) = numbers(text).first() else { return };
                let unit = match axis {
                    Axis::Pan => &mut self.unit.pan,
                    Axis::Tilt => &mut self.unit.tilt,
                };
                note(unit, item, number);
            }
            Command::AskBoth => {
                let near = |said: f64, unit: &AxisUnit| (said - f64::from(unit.position)).abs();
                let [pan, tilt, ..] = numbers(text)[..] else { return };
                let off = near(pan, &self.unit.pan).max(near(tilt, &self.unit.tilt));
                self.unit.combined_query = off <= f64::from(COMBINED_TOLERANCE);
            }
            _ => {}
        }
    }

    /// The unit, or what it failed to say.
    pub fn finish(self) -> Result<Unit, String> {
        for axis in [Axis::Pan, Axis::Tilt] {
            let resolution = self.unit.axis(axis).resolution_arcsec;
            if !RESOLUTION_ARCSEC.contains(&resolution) {
                return Err(format!("the unit gives no usable {axis} resolution ({resolution} arcsec a count)"));
            }
        }
        Ok(self.unit)
    }
}

fn note(unit: &mut AxisUnit, item: Item, number: f64) {
    let counts = number as i32;
    match item {
        Item::Resolution => unit.resolution_arcsec = number,
        Item::Least => unit.least = Some(counts),
        Item::Greatest => unit.greatest = Some(counts),
        Item::SpeedMin => unit.speed_min = Some(counts),
        Item::SpeedMax => unit.speed_max = Some(counts),
        Item::Position => unit.position = counts,
    }
}

/// Counts of one axis from the thesis's angle and back: `angle = sign * counts * resolution + zero`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    count_rad: f64,
    zero_rad: f64,
}

impl Scale {
    /// The scale of an axis with these settings.
    pub fn new(unit: &AxisUnit, axis: Axis, config: &Config) -> Self {
        let (sign, zero_deg) = match axis {
            Axis::Pan => (config.pan_sign, config.pan_zero_deg),
            Axis::Tilt => (config.tilt_sign, config.tilt_zero_deg),
        };
        let count_rad = f64::from(sign) * (unit.resolution_arcsec / 3600.0).to_radians();
        Self { count_rad, zero_rad: zero_deg.to_radians() }
    }

    /// The thesis's angle at this many counts, radians.
    pub fn angle_rad(&self, counts: f64) -> f64 {
        counts * self.count_rad + self.zero_rad
    }

    /// A rate in radians per second from counts per second.
    pub fn rate_rad_s(&self, counts_s: f64) -> f64 {
        counts_s * self.count_rad
    }

    /// The nearest position for an angle in degrees, counts; saturates.
    pub fn counts(&self, angle_deg: f64) -> i32 {
        ((angle_deg.to_radians() - self.zero_rad) / self.count_rad).round() as i32
    }

    /// A speed in counts per second from degrees per second, at least 1; saturates.
    pub fn speed(&self, rate_deg_s: f64) -> i32 {
        ((rate_deg_s.to_radians() / self.count_rad).abs().round() as i32).max(1)
    }
}

/// The positions and speeds the configuration asks for, in counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Scale of pan.
    pub pan: Scale,
    /// Scale of tilt.
    pub tilt: Scale,
    /// Where pan is held.
    pub pan_counts: i32,
    /// The ends of a nod; twice the same where the head is held.
    pub tilt_counts: [i32; 2],
    /// Speed of pan, counts per second.
    pub pan_speed: i32,
    /// Speed of tilt, counts per second.
    pub tilt_speed: i32,
    /// Acceleration of pan and tilt, counts per second squared; none leaves the unit's own.
    pub acceleration: Option<[i32; 2]>,
}

impl Plan {
    /// What this configuration means on this unit.
    pub fn new(unit: &Unit, config: &Config) -> Self {
        let pan = Scale::new(&unit.pan, Axis::Pan, config);
        let tilt = Scale::new(&unit.tilt, Axis::Tilt, config);
        let ends_deg = if config.nod { [config.tilt_min_deg, config.tilt_max_deg] } else { [config.tilt_hold_deg; 2] };
        let wanted = config.acceleration_deg_s2;
        Self {
            pan,
            tilt,
            pan_counts: pan.counts(config.pan_deg),
            tilt_counts: ends_deg.map(|deg| tilt.counts(deg)),
            pan_speed: pan.speed(config.pan_rate_deg_s),
            tilt_speed: tilt.speed(config.tilt_rate_deg_s),
            acceleration: (wanted > 0.0).then(|| [pan.speed(wanted), tilt.speed(wanted)]),
        }
    }

    /// Why the unit cannot do this; none where it can. Nothing is cut to fit: a wrong sign or zero shows here first.
    pub fn fault(&self, unit: &Unit) -> Option<String> {
        let [first, second] = self.tilt_counts;
        let positions = [
            (Axis::Pan, "pan_deg", self.pan_counts),
            (Axis::Tilt, "one end of the tilt range", first),
            (Axis::Tilt, "the other end of the tilt range", second),
        ];
        for (axis, what, counts) in positions {
            let (least, greatest) = (unit.axis(axis).least, unit.axis(axis).greatest);
            if least.is_some_and(|least| counts < least) || greatest.is_some_and(|most| counts > most) {
                let [least, most] = [least, greatest].map(|end| end.map_or("?".into(), |end| end.to_string()));
                return Some(format!("{what} is {counts} counts of {axis}: the unit allows {least} to {most}"));
            }
        }
        for (axis, speed) in [(Axis::Pan, self.pan_speed), (Axis::Tilt, self.tilt_speed)] {
            let (slowest, fastest) = (unit.axis(axis).speed_min, unit.axis(axis).speed_max);
            if slowest.is_some_and(|slowest| speed < slowest) || fastest.is_some_and(|fastest| speed > fastest) {
                let [slow, fast] = [slowest, fastest].map(|end| end.map_or("?".into(), |end| end.to_string()));
                return Some(format!("the {axis} rate is {speed} counts/s: the unit allows {slow} to {fast}"));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn d46() -> Unit {
        let axis = |least, greatest| AxisUnit {
            resolution_arcsec: 185.1428,
            least: Some(least),
            greatest: Some(greatest),
            speed_min: Some(31),
            speed_max: Some(2902),
            position: 0,
        };
        Unit { pan: axis(-3090, 3090), tilt: axis(-907, 604), ..Unit::default() }
    }

    #[test]
    fn degrees_become_counts_with_sign_and_zero() {
        let config = Config { pan_deg: 10.0, tilt_zero_deg: 5.0, ..Config::default() };
        let plan = Plan::new(&d46(), &config);
        // 10 deg * 3600 / 185.1428 = 194.445; positive pan is left on the unit, right in the thesis.
        assert_eq!(plan.pan_counts, -194);
        // (-30 - 5) deg * 3600 / 185.1428 = -680.556.
        assert_eq!(plan.tilt_counts[0], -681);
        assert_eq!(plan.tilt_speed, 389);
        assert!((plan.tilt.angle_rad(-681.0) - (-681.0 * 185.1428 / 3600.0 + 5.0_f64).to_radians()).abs() < 1e-12);
        assert!(plan.pan.angle_rad(-194.0) > 0.0);
        assert_eq!(plan.fault(&d46()), None);
    }

    #[test]
    fn a_range_beyond_the_units_is_refused_with_both_figures() {
        let config = Config { tilt_max_deg: 40.0, ..Config::default() };
        let fault = Plan::new(&d46(), &config).fault(&d46()).unwrap();
        assert_eq!(fault, "the other end of the tilt range is 778 counts of tilt: the unit allows -907 to 604");
        let config = Config { tilt_rate_deg_s: 200.0, ..Config::default() };
        assert!(Plan::new(&d46(), &config).fault(&d46()).unwrap().contains("3889 counts/s"));
    }

    #[test]
    fn a_unit_without_resolution_is_no_unit() {
        let mut survey = Survey::new(true);
        survey.answered(Command::Ask(Axis::Pan, Item::Resolution), "92.5714 seconds arc per position");
        assert!(survey.finish().unwrap_err().contains("tilt resolution (0"));
    }

    #[test]
    fn b_counts_only_where_it_agrees_with_pp_and_tp() {
        let check = |answer: &str, expected: bool| {
            let mut survey = Survey::new(true);
            survey.answered(Command::Ask(Axis::Pan, Item::Position), "-100");
            survey.answered(Command::Ask(Axis::Tilt, Item::Position), "250");
            survey.answered(Command::AskBoth, answer);
            assert_eq!(survey.unit.combined_query, expected, "{answer}");
        };
        check("-100,250,0,0", true);
        check("P(-101) T(249) S(0, 0)", true);
        check("250,-100,0,0", false);
        check("-100", false);
    }
}
