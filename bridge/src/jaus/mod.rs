//! The system as a JAUS peer sees it: cost maps, scans, and (experimental) objects and the Smart Sensor Grid.
//!
//! [`station::Station`] is the whole as a state machine of bytes and time; [`process`] is its shell, a process of its own
//! in the graph. Off by default, on loopback by default, read-only until allowed. The wire is the crate `tsense-jaus`;
//! what is said over it, to whom it is told, and in which frames: `docs/jaus.md`.

pub mod access;
pub mod component;
pub mod config;
pub mod cost_map;
pub mod discovery;
pub mod events;
pub mod objects;
pub mod place;
pub mod process;
pub mod products;
pub mod ranges;
pub mod rig;
pub mod smart_grid;
pub mod station;

pub use config::Config;
pub use rig::{Head, Rig};
