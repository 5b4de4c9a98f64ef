//! Configuration of one ladar: where it is, how it measures, how it is mounted, how far it is believed.
//!
//! One `[[ladar]]` table each. `validate` lists every fault; nothing is repaired.

use super::commands::{DataConfig, RANGE_E4_DEG, ScanConfig};
use super::telegram::Dialect;
use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};
use tsense_geometry::Mounting;

/// Which dialect to speak.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DialectChoice {
    /// Whichever the device answers in.
    #[default]
    Auto,
    /// CoLa-A only.
    A,
    /// CoLa-B only.
    B,
}

impl DialectChoice {
    /// The dialect, where it is chosen.
    pub fn fixed(self) -> Option<Dialect> {
        match self {
            Self::Auto => None,
            Self::A => Some(Dialect::A),
            Self::B => Some(Dialect::B),
        }
    }
}

/// Echo strength in each telegram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Remission {
    /// Not sent.
    #[default]
    None,
    /// One byte a beam.
    #[serde(rename = "8bit")]
    Bits8,
    /// Two bytes a beam.
    #[serde(rename = "16bit")]
    Bits16,
}

impl Remission {
    /// Bits a beam, where sent.
    pub fn bits(self) -> Option<u8> {
        match self {
            Self::None => None,
            Self::Bits8 => Some(8),
            Self::Bits16 => Some(16),
        }
    }
}

/// Which echo of a beam becomes its distance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Echo {
    /// The nearest: obstacles, brush.
    #[default]
    First,
    /// The farthest valid one: terrain seen through rain, dust or a fence.
    Last,
}

/// One ladar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Name of the ladar, of its process and of its scan topic; starts with `ladar`.
    pub name: String,
    /// Host and port of the device.
    pub address: String,
    /// `auto`, `a` (text) or `b` (binary): what the device's port speaks.
    pub dialect: DialectChoice,
    /// Mirror turns a second: 25 or 50.
    pub frequency_hz: f64,
    /// Angle between beams: 0.25 (at 25 Hz only) or 0.5 degrees.
    pub resolution_deg: f64,
    /// Echo strength: `none`, `8bit` or `16bit`.
    pub remission: Remission,
    /// Which echo of a beam becomes its distance: `first` or `last`.
    pub echo: Echo,
    /// A telegram for every n-th turn.
    pub output_interval: u16,
    /// From the first beam to the time of transmission, seconds; to be calibrated by swinging the head over an edge both ways.
    /// Absent: the 270 degree sweep at the measured rate plus 3.1 ms, as seen on an LMS111.
    pub first_beam_to_tx_s: Option<f64>,
    /// Extrinsics T_L^tilt of thesis (2-9): where the ladar sits in the tilting body.
    pub tilt_from_ladar: Mounting,
    /// Nearest usable distance; nearer echoes come from the window or the vehicle.
    pub range_min_m: f64,
    /// Farthest usable distance.
    pub range_max_m: f64,
    /// How far a beam without a return still clears space (a dark target may be farther than this and not answer).
    pub no_return_range_m: f64,
    /// Weight of this ladar's evidence when several update the same voxels.
    pub weight: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            name: "ladar".into(),
            address: "192.168.0.1:2111".into(),
            dialect: DialectChoice::Auto,
            frequency_hz: 50.0,
            resolution_deg: 0.5,
            remission: Remission::None,
            echo: Echo::First,
            output_interval: 1,
            first_beam_to_tx_s: None,
            tilt_from_ladar: Mounting::default(),
            range_min_m: 0.5,
            range_max_m: 30.0,
            no_return_range_m: 18.0,
            weight: 1.0,
        }
    }
}

/// Longest name that still fits a service name and a heartbeat.
const NAME_MAX: usize = 31;

impl Config {
    /// All faults, each with its key, value and allowed range.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        self.check_connection(&mut check);
        self.check_measurement(&mut check);
        check.range("first_beam_to_tx_s", self.first_beam_to_tx_s.unwrap_or(0.0), -0.1, 0.2, "s");
        check.range("range_min_m", self.range_min_m, 0.0, 10.0, "m");
        check.range("range_max_m", self.range_max_m, self.range_min_m.max(0.5), 80.0, "m, and above range_min_m");
        let usable_m = self.range_max_m.max(0.0);
        check.range("no_return_range_m", self.no_return_range_m, 0.0, usable_m, "m, at most range_max_m");
        check.range("weight", self.weight, 0.0, 10.0, "");
        let m = &self.tilt_from_ladar;
        for (key, value) in [("x_m", m.x_m), ("y_m", m.y_m), ("z_m", m.z_m)] {
            check.range(&format!("tilt_from_ladar.{key}"), value, -10.0, 10.0, "m");
        }
        for (key, value) in [("roll_deg", m.roll_deg), ("pitch_deg", m.pitch_deg), ("yaw_deg", m.yaw_deg)] {
            check.range(&format!("tilt_from_ladar.{key}"), value, -360.0, 360.0, "degrees");
        }
        check.into_faults()
    }

    fn check_connection(&self, check: &mut Checks) {
        let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-' || b == b'_';
        let is_name = self.name.starts_with("ladar") && self.name.bytes().all(plain) && self.name.len() <= NAME_MAX;
        check.require(is_name, "name", &self.name, "`ladar` and then small letters, digits, - and _ (31 at most)");
        let port = self.address.rsplit_once(':').filter(|(host, _)| !host.is_empty()).map(|(_, port)| port);
        let is_address = port.is_some_and(|port| port.parse::<u16>().is_ok_and(|port| port > 0));
        check.require(is_address, "address", &self.address, "HOST:PORT, as in 192.168.0.1:2111");
    }

    fn check_measurement(&self, check: &mut Checks) {
        let (hz, deg) = (self.frequency_hz, self.resolution_deg);
        check.require([25.0, 50.0].contains(&hz), "frequency_hz", hz, "25 or 50 Hz");
        check.require([0.25, 0.5].contains(&deg), "resolution_deg", deg, "0.25 or 0.5 degrees");
        let together = "0.5 degrees at 50 Hz, or frequency_hz = 25";
        check.require((hz, deg) != (50.0, 0.25), "resolution_deg", deg, together);
        check.range("output_interval", self.output_interval, 1.0, 50.0, "");
    }

    /// Rate and density in the device's units.
    pub fn scan_config(&self) -> ScanConfig {
        ScanConfig {
            frequency_centihz: (self.frequency_hz * 100.0).round() as u32,
            step_e4_deg: (self.resolution_deg * 1e4).round() as u32,
            range_e4_deg: RANGE_E4_DEG,
        }
    }

    /// What each telegram is to carry.
    pub fn data_config(&self) -> DataConfig {
        DataConfig {
            both_echoes: self.echo == Echo::Last,
            remission_bits: self.remission.bits(),
            output_interval: self.output_interval,
        }
    }

    /// Nominal time from one telegram to the next, seconds.
    pub fn telegram_period_s(&self) -> f64 {
        f64::from(self.output_interval.max(1)) / self.frequency_hz.max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_valid_and_faults_are_listed_all_at_once() {
        assert_eq!(Config::default().validate(), []);
        let bad = Config {
            name: "lidar".into(),
            address: "192.168.0.1".into(),
            resolution_deg: 0.25,
            range_max_m: f64::NAN,
            weight: -1.0,
            output_interval: 0,
            ..Config::default()
        };
        let keys: Vec<String> = bad.validate().into_iter().map(|f| f.key).collect();
        for key in ["name", "address", "resolution_deg", "output_interval", "range_max_m", "weight"] {
            assert!(keys.iter().any(|k| k == key), "{key} is not among {keys:?}");
        }
    }

    #[test]
    fn every_pair_the_device_takes_is_valid_and_no_other() {
        let mut valid = Vec::new();
        for frequency_hz in [12.5, 25.0, 50.0, f64::NAN] {
            for resolution_deg in [0.125, 0.25, 0.5, 1.0] {
                if (Config { frequency_hz, resolution_deg, ..Config::default() }).validate().is_empty() {
                    valid.push((frequency_hz, resolution_deg));
                }
            }
        }
        assert_eq!(valid, [(25.0, 0.25), (25.0, 0.5), (50.0, 0.5)]);
    }
}
