//! The Foxglove part of the bridge: a process of its own that draws the system in Foxglove or Lichtblick.
//!
//! The messages of [`crate::ros2::translator`] become those of the open Foxglove WebSocket protocol (`convert`); the
//! `foxglove` crate serves them at an address that nobody is told, and [`front`] lets in who may ask. It understands
//! nothing that a client sends but which channels it wants.

pub mod config;
#[cfg(feature = "foxglove")]
pub mod convert;
pub mod front;
pub mod process;
#[cfg(feature = "foxglove")]
pub mod server;

pub use config::Config;
