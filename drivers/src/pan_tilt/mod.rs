//! Driver of the pan-tilt unit: Directed Perception / FLIR commands and answers become stamped joint angles.
//!
//! The core is [`Session`]: bytes and instants in; bytes, joint angles and deadlines out. `process.rs` is its shell.
//! Angles leave as the thesis has them: theta1 positive to the right, theta2 positive up, radians.

mod answer;
mod command;
pub mod config;
mod exchange;
#[cfg(test)]
mod fake_unit;
mod nod;
pub mod process;
mod session;
#[cfg(test)]
mod session_tests;
pub mod shell;
mod track;
mod unit;

pub use answer::Axis;
pub use config::Config;
pub use session::{Event, Purpose, Session};
pub use shell::probe::{ProbeError, Report, probe};
pub use unit::{AxisUnit, Unit};
