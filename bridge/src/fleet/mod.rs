//! The fleet part of the bridge: a process of its own that tells control stations what this vehicle knows.
//!
//! State, not messages: the newest state of each object ([`objects`]) and of each block of the map ([`blocks`]) lies in
//! a log in the order of its last change ([`log`]), and a station asks for what follows its cursor ([`vehicle`]). A
//! station that is away or slow costs the vehicle nothing. `docs/fleet.md` has the whole of it.

pub mod blocks;
pub mod config;
#[cfg_attr(not(feature = "fleet"), path = "no_link.rs")]
pub mod link;
pub mod log;
pub mod objects;
pub mod process;
pub mod shelf;
pub mod vehicle;

pub use config::Config;
pub use vehicle::{Answer, Vehicle};
