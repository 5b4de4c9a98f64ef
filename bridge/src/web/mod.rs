//! The web part of the bridge: one page that shows what the system sees and believes, live, in a browser.
//!
//! Pure: [`frames`] (bytes of the protocol), [`surface`] (visible voxels), [`slots`] (what a client still needs),
//! [`scene`] (messages in, frames out), [`guard`] (who may ask). Shell: [`server`] and [`client`], a thread of their
//! own. The path of a value: topic -> `process.rs` -> [`scene::Scene`] -> [`hub::Hub`] -> each [`client`] -> viewer.

pub mod assets;
pub mod client;
pub mod counters;
pub mod frames;
pub mod guard;
pub mod hub;
pub mod metrics;
pub mod scene;
pub mod server;
pub mod slots;
pub mod surface;
