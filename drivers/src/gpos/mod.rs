//! Driver of the position system: NMEA-0183, NovAtel INSPVAX or a JAUS GlobalPoseSensor become poses in UTM.
//!
//! The core is [`Receiver`]: bytes and instants in; poses, drops by cause and deadlines out. `process.rs` is its shell.
//! Poses leave as the thesis has them: grid yaw (true heading minus convergence), ellipsoidal height, stamps on the
//! graph's clock.

mod calendar;
mod clock;
pub mod config;
mod epoch;
mod fix;
mod frame;
mod jaus;
mod nmea;
mod novatel;
mod place;
pub mod process;
mod receiver;
#[cfg(test)]
mod receiver_tests;
pub mod shell;
mod utm;
mod watch;

pub use config::{Config, Format};
pub use receiver::{Event, Receiver, Seen};
pub use shell::probe::{PoseReport, ProbeError, Report, probe};
pub use utm::Zone;
