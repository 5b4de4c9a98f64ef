//! The system as others see it. Today: one web page that shows what it sees and believes (`web`).
//!
//! Conventions of the outside (web, later JAUS and ROS: names, frames, units) exist only in this crate. It reads
//! topics and writes none but its heartbeat: nothing that a viewer does can change what the system does.

mod config;
pub mod foxglove;
pub mod jaus;
pub mod process;
pub mod ros2;
pub mod web;

pub use config::Config;
pub use process::run;
