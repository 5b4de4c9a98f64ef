//! A simulated position system: NMEA-0183 over TCP, with errors as a real receiver's.
//!
//! `utm` turns the scene's grid into latitude, longitude and true north, `error` is what the receiver gets wrong,
//! `nmea` writes sentences, `server` owns the socket and the thread.
//! Of the faults it takes drop, duplicate, fragment, bad checksum, disconnect and stall.

mod date;
mod error;
mod nmea;
mod server;
mod utm;

pub(crate) use date::date_of_day;
pub use error::{PoseErrors, Quality};
pub(crate) use server::start;
pub use utm::{Geodetic, geodetic_of_utm};

use crate::faults::Faults;
use serde::{Deserialize, Serialize};

/// How the position system is set up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GposOptions {
    /// Where it listens, `address:port`; port 0 takes any free one.
    pub address: String,
    /// Epochs a second; whole milliseconds apart: 20, 25, 40 and 50 are.
    pub rate_hz: u32,
    /// Time from the epoch to its sentences, seconds.
    pub latency_s: f64,
    /// What it gets wrong.
    pub errors: PoseErrors,
    /// What goes wrong on the wire.
    pub faults: Faults,
}

impl Default for GposOptions {
    fn default() -> Self {
        Self {
            address: "127.0.0.1:2947".to_owned(),
            rate_hz: 50,
            latency_s: 0.006,
            errors: PoseErrors::default(),
            faults: Faults::default(),
        }
    }
}
