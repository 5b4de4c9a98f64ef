//! A JAUS GlobalPoseSensor as the position source: found, subscribed to, and kept.
//!
//! [`Client`] is the protocol as a state machine of bytes and time; [`fix_of`] turns a report into a fix. The socket is
//! in `gpos/shell/jaus.rs`. It asks and listens: nothing on the other side is commanded.

mod client;
mod config;
mod pose;

pub use client::Client;
pub use config::Config;
pub use pose::fix_of;
