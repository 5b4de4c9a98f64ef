//! Configuration of the position driver: section `[gpos]`.

use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};

/// Which sentences and logs are taken from the stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Whatever comes.
    #[default]
    Auto,
    /// NMEA-0183 only.
    Nmea,
    /// NovAtel INSPVAX, INSPVA and INSPVAS only, ASCII and binary.
    Novatel,
}

/// What the position driver is told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// A serial device (`/dev/ttyUSB1`), `tcp:HOST:PORT`, or `jaus` for a GlobalPoseSensor.
    pub address: String,
    /// Rate of the serial line, bits per second; unused with `tcp:`.
    pub baud: u32,
    /// `auto`, `nmea` or `novatel`.
    pub format: Format,
    /// `auto` pins the UTM zone of the first valid pose; `17N`, `56S` pin this one.
    pub zone: String,
    /// Where the reported point (antenna, or the point an inertial unit reports) sits on the vehicle, metres: x
    /// forward, y right, z down from the vehicle's origin.
    pub antenna_m: [f64; 3],
    /// +1 where the source's roll is positive with the right side down (NovAtel, Trimble), else -1.
    pub roll_sign: i8,
    /// +1 where the source's pitch is positive with the nose up, else -1.
    pub pitch_sign: i8,
    /// Added to the source's roll after its sign, degrees.
    pub roll_offset_deg: f64,
    /// Added to the source's pitch after its sign, degrees.
    pub pitch_offset_deg: f64,
    /// Added to the source's true heading, degrees: a pair of antennas mounted askew.
    pub heading_offset_deg: f64,
    /// GPS time minus UTC, seconds: 18 since 2017.
    pub gps_minus_utc_s: f64,
    /// Least time from the instant a fix is true to its arrival that no filter can see, milliseconds (calibration).
    pub latency_ms: f64,
    /// Geoid above ellipsoid where GGA leaves it out, metres; without it such fixes have no height and are dropped.
    pub undulation_m: Option<f64>,
    /// Silence on the line that ends an epoch of sentences, milliseconds.
    pub epoch_wait_ms: f64,
    /// Oldest attitude that is combined with a position, milliseconds of the source's own time.
    pub attitude_age_max_ms: f64,
    /// Without heading, the course over ground is taken for it above this speed, metres per second.
    pub course_speed_min_m_s: f64,
    /// One sigma of roll and pitch where no sentence gives them and 0 is assumed, degrees.
    pub unknown_tilt_std_deg: f64,
    /// Age of the newest pose at which the driver calls itself stale, seconds.
    pub stale_s: f64,
    /// The same position this many times in a row while the source reports speed is flagged as frozen.
    pub frozen_repeats: u32,
    /// Beyond speed, time and deviations, how far a pose may lie from the last before it is flagged, metres.
    pub jump_margin_m: f64,
    /// Where a GlobalPoseSensor is looked for; used where `address` is `jaus`.
    pub jaus: super::jaus::Config,
}

/// The address that names a GlobalPoseSensor.
pub(super) const JAUS: &str = "jaus";

impl Default for Config {
    fn default() -> Self {
        Self {
            address: "tcp:127.0.0.1:10110".into(),
            baud: 115_200,
            format: Format::Auto,
            zone: "auto".into(),
            antenna_m: [0.0; 3],
            roll_sign: 1,
            pitch_sign: 1,
            roll_offset_deg: 0.0,
            pitch_offset_deg: 0.0,
            heading_offset_deg: 0.0,
            gps_minus_utc_s: 18.0,
            latency_ms: 0.0,
            undulation_m: None,
            epoch_wait_ms: 30.0,
            attitude_age_max_ms: 20.0,
            course_speed_min_m_s: 1.0,
            unknown_tilt_std_deg: 10.0,
            stale_s: 1.0,
            frozen_repeats: 5,
            jump_margin_m: 0.5,
            jaus: super::jaus::Config::default(),
        }
    }
}

impl Config {
    /// All faults of this section.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        for part in self.antenna_m {
            check.range("antenna_m", part, -50.0, 50.0, "metres");
        }
        check.range("roll_offset_deg", self.roll_offset_deg, -180.0, 180.0, "degrees");
        check.range("pitch_offset_deg", self.pitch_offset_deg, -90.0, 90.0, "degrees");
        check.range("heading_offset_deg", self.heading_offset_deg, -360.0, 360.0, "degrees");
        check.range("gps_minus_utc_s", self.gps_minus_utc_s, 0.0, 60.0, "seconds");
        check.range("latency_ms", self.latency_ms, 0.0, 1000.0, "milliseconds");
        check.range("undulation_m", self.undulation_m.unwrap_or(0.0), -150.0, 150.0, "metres");
        check.range("epoch_wait_ms", self.epoch_wait_ms, 1.0, 1000.0, "milliseconds");
        check.range("attitude_age_max_ms", self.attitude_age_max_ms, 0.0, 1000.0, "milliseconds");
        check.range("course_speed_min_m_s", self.course_speed_min_m_s, 0.1, 20.0, "metres per second");
        check.range("unknown_tilt_std_deg", self.unknown_tilt_std_deg, 0.1, 90.0, "degrees");
        check.range("stale_s", self.stale_s, 0.05, 60.0, "seconds");
        check.range("frozen_repeats", self.frozen_repeats, 2.0, 1000.0, "times");
        check.range("jump_margin_m", self.jump_margin_m, 0.0, 100.0, "metres");
        self.check_kind(&mut check);
        if self.address == JAUS {
            check.extend(self.jaus.validate());
        }
        check.into_faults()
    }

    fn check_kind(&self, check: &mut Checks) {
        let has_address = !self.address.is_empty() && self.address != "tcp:";
        check.require(has_address, "address", &self.address, "a serial device, tcp:HOST:PORT, or jaus");
        let has_rate = !self.address.starts_with("tcp:") && self.address != JAUS;
        let fits = !has_rate || (300..=4_000_000).contains(&self.baud);
        check.require(fits, "baud", self.baud, "from 300 to 4000000 bits per second");
        let is_zone = self.zone == "auto" || super::utm::Zone::parse(&self.zone).is_some();
        check.require(is_zone, "zone", &self.zone, "auto, or 1 to 60 with N or S: 17N");
        for (key, sign) in [("roll_sign", self.roll_sign), ("pitch_sign", self.pitch_sign)] {
            check.require([1, -1].contains(&sign), key, sign, "1 or -1");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_have_no_fault_and_all_faults_are_listed_at_once() {
        assert_eq!(Config::default().validate(), vec![]);
        let config = Config {
            antenna_m: [0.0, f64::NAN, 99.0],
            zone: "61N".into(),
            roll_sign: 0,
            latency_ms: -1.0,
            ..Config::default()
        };
        let keys: Vec<String> = config.validate().into_iter().map(|fault| fault.key).collect();
        assert_eq!(keys, ["antenna_m", "antenna_m", "latency_ms", "zone", "roll_sign"]);
    }
}
