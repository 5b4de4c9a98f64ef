//! Configuration of the pan-tilt driver: section `[pan_tilt]`.
//!
//! Angles are those of the thesis (theta1 positive to the right, theta2 positive up), in degrees as people write
//! them; the unit's own counts, signs and zero appear only in the keys that say so.

use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};
use tsense_geometry::Mounting;

/// What the pan-tilt driver is told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// A serial device (`/dev/ttyUSB0`) or `tcp:HOST:PORT`.
    pub address: String,
    /// Rate of the serial line, bits per second. For a `tcp:` address the rate of the line behind the server;
    /// 0 where there is none. The line's own time is part of every stamp.
    pub baud: u32,
    /// Where the unit's base sits on the vehicle: `T_base^V` of thesis (2-9).
    pub mount: Mounting,
    /// Whether the head nods between `tilt_min_deg` and `tilt_max_deg`; else it holds `tilt_hold_deg`.
    pub nod: bool,
    /// Lowest tilt of a nod, degrees, positive up.
    pub tilt_min_deg: f64,
    /// Highest tilt of a nod, degrees, positive up.
    pub tilt_max_deg: f64,
    /// Speed of the nod, degrees per second.
    pub tilt_rate_deg_s: f64,
    /// Tilt that is held while not nodding, degrees, positive up.
    pub tilt_hold_deg: f64,
    /// Pan that is held, degrees, positive to the right.
    pub pan_deg: f64,
    /// Speed of pan while it goes to `pan_deg`, degrees per second.
    pub pan_rate_deg_s: f64,
    /// Acceleration of both axes, degrees per second squared; 0 leaves the unit's own.
    pub acceleration_deg_s2: f64,
    /// +1 where the unit counts pan positive to the right, -1 to the left (the maker's manual).
    pub pan_sign: i8,
    /// +1 where the unit counts tilt positive up (the maker's manual), -1 down.
    pub tilt_sign: i8,
    /// Pan angle where the unit reads 0, degrees.
    pub pan_zero_deg: f64,
    /// Tilt angle where the unit reads 0, degrees.
    pub tilt_zero_deg: f64,
    /// Whether to ask for both axes with `B` where the unit has it; else `PP` and `TP` are used.
    pub combined_query: bool,
    /// From the request's last bit to the instant the unit samples its position, milliseconds (calibration).
    pub sample_delay_ms: f64,
    /// A sample whose instant is less certain than this is dropped, milliseconds: at 20 degrees a second 15 ms are 0.3
    /// degrees. It comes of a process that was not let run; behind a slow serial server it has to be larger.
    pub stamp_std_max_ms: f64,
    /// Beyond twice the line's time, how long an answer may take, milliseconds.
    pub reply_margin_ms: f64,
    /// Least time from one poll to the next, milliseconds; the line itself is slower at 9600 baud.
    pub poll_period_ms: f64,
    /// The operator's consent that the driver resets the unit after an axis hit its limit. A reset moves the head
    /// through its whole range. Without it the angles stay marked invalid.
    pub reset_allowed: bool,
    /// The head is halted when the newest pose is older than this, seconds; 0 never halts. A graph in which no pose
    /// was ever seen (a bench) is left alone.
    pub pose_timeout_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            address: "/dev/ttyUSB0".into(),
            baud: 9600,
            mount: Mounting { z_m: -1.5, ..Mounting::default() },
            nod: true,
            tilt_min_deg: -30.0,
            tilt_max_deg: 15.0,
            tilt_rate_deg_s: 20.0,
            tilt_hold_deg: 0.0,
            pan_deg: 0.0,
            pan_rate_deg_s: 20.0,
            acceleration_deg_s2: 0.0,
            pan_sign: -1,
            tilt_sign: 1,
            pan_zero_deg: 0.0,
            tilt_zero_deg: 0.0,
            combined_query: true,
            sample_delay_ms: 1.0,
            stamp_std_max_ms: 15.0,
            reply_margin_ms: 50.0,
            poll_period_ms: 10.0,
            reset_allowed: false,
            pose_timeout_s: 5.0,
        }
    }
}

/// Slowest line rate that is worth opening, bits per second: a poll would take a second below it.
const BAUD_MIN: u32 = 300;
/// Fastest line rate a serial driver is asked for, bits per second.
const BAUD_MAX: u32 = 4_000_000;

impl Config {
    /// Time that the head needs from one end of its nod to the other, seconds, without what it needs to turn round.
    pub fn sweep_s(&self) -> f64 {
        (self.tilt_max_deg - self.tilt_min_deg) / self.tilt_rate_deg_s
    }

    /// All faults of this section.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        check.range("tilt_min_deg", self.tilt_min_deg, -90.0, 90.0, "degrees");
        check.range("tilt_max_deg", self.tilt_max_deg, -90.0, 90.0, "degrees");
        check.range("tilt_rate_deg_s", self.tilt_rate_deg_s, 0.1, 300.0, "degrees per second");
        check.range("tilt_hold_deg", self.tilt_hold_deg, -90.0, 90.0, "degrees");
        check.range("pan_deg", self.pan_deg, -180.0, 180.0, "degrees");
        check.range("pan_rate_deg_s", self.pan_rate_deg_s, 0.1, 300.0, "degrees per second");
        check.range("acceleration_deg_s2", self.acceleration_deg_s2, 0.0, 3000.0, "degrees per second squared");
        check.range("pan_zero_deg", self.pan_zero_deg, -360.0, 360.0, "degrees");
        check.range("tilt_zero_deg", self.tilt_zero_deg, -360.0, 360.0, "degrees");
        check.range("sample_delay_ms", self.sample_delay_ms, -50.0, 50.0, "milliseconds");
        check.range("stamp_std_max_ms", self.stamp_std_max_ms, 0.5, 1000.0, "milliseconds");
        check.range("reply_margin_ms", self.reply_margin_ms, 5.0, 5000.0, "milliseconds");
        check.range("poll_period_ms", self.poll_period_ms, 0.0, 90.0, "milliseconds");
        check.range("pose_timeout_s", self.pose_timeout_s, 0.0, 3600.0, "seconds");
        self.check_kind(&mut check);
        check.into_faults()
    }

    fn check_kind(&self, check: &mut Checks) {
        let has_address = !self.address.is_empty() && self.address != "tcp:";
        check.require(has_address, "address", &self.address, "a serial device or tcp:HOST:PORT");
        let no_line = self.baud == 0 && self.address.starts_with("tcp:");
        let fits = no_line || (BAUD_MIN..=BAUD_MAX).contains(&self.baud);
        check.require(fits, "baud", self.baud, "from 300 to 4000000 bits per second, or 0 with tcp:");
        let is_crossed = self.tilt_max_deg - self.tilt_min_deg < 1.0;
        check.require(!is_crossed, "tilt_max_deg", self.tilt_max_deg, "at least 1 degree above tilt_min_deg");
        for (key, sign) in [("pan_sign", self.pan_sign), ("tilt_sign", self.tilt_sign)] {
            check.require([1, -1].contains(&sign), key, sign, "1 or -1");
        }
        let mount = &self.mount;
        let parts = [mount.x_m, mount.y_m, mount.z_m, mount.roll_deg, mount.pitch_deg, mount.yaw_deg];
        let fits = parts.iter().all(|part| part.is_finite() && part.abs() <= 360.0);
        check.require(fits, "mount", format!("{mount:?}"), "numbers from -360 to 360 (metres, degrees)");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_have_no_fault() {
        assert_eq!(Config::default().validate(), vec![]);
    }

    #[test]
    fn all_faults_are_listed_at_once() {
        let config = Config {
            address: String::new(),
            baud: 0,
            tilt_min_deg: f64::NAN,
            tilt_rate_deg_s: 0.0,
            pan_sign: 0,
            tilt_sign: i8::MIN,
            ..Config::default()
        };
        let keys: Vec<String> = config.validate().into_iter().map(|fault| fault.key).collect();
        assert_eq!(keys, ["tilt_min_deg", "tilt_rate_deg_s", "address", "baud", "pan_sign", "tilt_sign"]);
    }

    #[test]
    fn a_tcp_unit_may_have_no_line_rate() {
        let config = Config { address: "tcp:192.168.1.90:4000".into(), baud: 0, ..Config::default() };
        assert_eq!(config.validate(), vec![]);
    }
}
