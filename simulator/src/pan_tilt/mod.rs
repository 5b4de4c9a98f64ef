//! A simulated pan-tilt unit of the Directed Perception / FLIR family on a pseudo terminal.
//!
//! `axis` is the kinematics, `unit` understands the ASCII commands, `line` paces bytes as an RS-232 line does and
//! owns the pty. Positive pan turns left, positive tilt up, as the maker's manuals say; the vehicle frame counts pan
//! to the right, so a driver needs `pan_sign = -1`. Of the faults it takes `drop_every` (answers lost) and the stall.
//! Not simulated: binary mode, reset on power-up, several units on one line, lost steps.

mod axis;
mod line;
mod unit;

pub use axis::{Axis, Dynamics};
pub(crate) use line::start;

use crate::faults::Faults;
use serde::{Deserialize, Serialize};
use tsense_geometry::{PanTiltAngles, Timestamp};

/// How the unit is set up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PanTiltOptions {
    /// A symbolic link that points to the pseudo terminal; empty for none.
    pub link: String,
    /// Line speed, bits per second; ten bits a byte.
    pub baud: u32,
    /// Arc-seconds per position: 185.1428 (D46), 92.5714, 46.2857, 23.1428, 11.5714.
    pub resolution_arcsec: f64,
    /// Time the controller takes for an answer, seconds.
    pub controller_s: f64,
    /// What goes wrong.
    pub faults: Faults,
}

impl Default for PanTiltOptions {
    fn default() -> Self {
        Self {
            link: "/tmp/tsense-pan-tilt".to_owned(),
            baud: 9600,
            resolution_arcsec: 46.2857,
            controller_s: 0.0015,
            faults: Faults::default(),
        }
    }
}

/// The two axes as the rest of the world sees them.
#[derive(Clone, Debug)]
pub struct Head {
    /// Pan, then tilt, in the unit's positions.
    pub axes: [Axis; 2],
    rad_per_position: f64,
}

impl Head {
    /// A head at rest, looking straight ahead.
    pub fn new(resolution_arcsec: f64) -> Self {
        Self { axes: [Axis::default(), Axis::default()], rad_per_position: (resolution_arcsec / 3600.0).to_radians() }
    }

    /// Angles as the vehicle frame counts them: pan to the right, tilt up.
    pub fn angles(&self, instant: Timestamp) -> PanTiltAngles {
        let [pan, tilt] = [0, 1].map(|i: usize| self.axes[i].at(instant).0 * self.rad_per_position);
        PanTiltAngles { pan_rad: -pan, tilt_rad: tilt }
    }

    /// Positions of an axis for an angle, radians, in the unit's own sense.
    pub fn positions(&self, angle_rad: f64) -> f64 {
        angle_rad / self.rad_per_position
    }
}
