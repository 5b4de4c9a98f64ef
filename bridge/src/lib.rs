//! The system as others see it: a page for people (`web`), JAUS peers (`jaus`), ROS 2 (`ros2`), Foxglove (`foxglove`),
//! control stations (`fleet`).
//!
//! Conventions of the outside (names, frames, units) exist only in this crate and at the drivers' wires. It reads
//! topics and writes none but its heartbeat: nothing that a viewer does can change what the system does.

mod allowed;
mod config;
pub mod fleet;
pub mod foxglove;
pub mod jaus;
pub mod process;
pub mod ros2;
pub mod web;

pub use config::Config;
pub use process::run;
