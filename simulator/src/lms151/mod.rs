//! A simulated SICK LMS-151: a SOPAS device on TCP that answers in both dialects and streams scans of the scene.
//!
//! `cola` frames and writes telegrams, `scan` is the measured-data telegram, `device` knows every command and the
//! device's state, `link` makes faults, `server` owns sockets and threads, `mirror` turns and casts.
//! Not simulated: field evaluation, encoders, the second layer, firmware download.

mod cola;
mod device;
mod link;
mod mirror;
mod scan;
mod server;
mod shape;

pub(crate) use server::start;
pub use shape::ScanShape;

use crate::cast::Optics;
use crate::faults::Faults;
use serde::{Deserialize, Serialize};
use tsense_geometry::Mounting;

/// How the device is set up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Lms151Options {
    /// Where it listens, `address:port`; port 0 takes any free one.
    pub address: String,
    /// Time from start of measurement to ready, seconds. The real device takes up to 30.
    pub spin_up_s: f64,
    /// The microsecond counter when the world starts.
    pub clock_start_us: u32,
    /// Telegram and scan counters when the world starts.
    pub counter_start: u16,
    /// Where it sits on the tilting body; absent: where the rig says.
    pub tilt_from_ladar: Option<Mounting>,
    /// What its light can do.
    pub optics: Optics,
    /// What goes wrong.
    pub faults: Faults,
}

impl Default for Lms151Options {
    fn default() -> Self {
        Self {
            address: "127.0.0.1:2111".to_owned(),
            spin_up_s: 2.0,
            clock_start_us: 1_000_000,
            counter_start: 0,
            tilt_from_ladar: None,
            optics: Optics::default(),
            faults: Faults::default(),
        }
    }
}
