//! Device drivers: bytes from devices become scans, pan-tilt states and poses.
//!
//! Each driver speaks its device's real protocol and nothing else; there is no simulated mode. Each is a pure core
//! (bytes and time are arguments) and a shell: `process.rs`, the loop, and `shell/`, the socket or the serial line.

pub mod gpos;
pub mod lms151;
pub mod pan_tilt;

mod shell;
