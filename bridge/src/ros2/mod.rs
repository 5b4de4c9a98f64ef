//! The ROS 2 part of the bridge: a process of its own that says in ROS messages what the system sees and believes.
//!
//! Pure: [`messages`] and [`cdr`] (bytes), [`frames`], [`motion`], [`grid`], [`scan`], [`cloud`], [`objects`],
//! [`diagnostics`] (what a message of ours is in ROS), [`translator`] (messages in, bytes out). Shell: [`sink`] (queue and
//! thread), `dds` (the transport, behind the feature `ros2`), [`process`]. The path of a value: topic -> [`process`] ->
//! [`translator::Translator`] -> [`sink::Queue`] -> a transport's thread -> network. It writes no topic of the graph but its
//! heartbeat, and it understands nothing that anybody sends: ROS can only listen.

pub mod cdr;
pub mod cloud;
pub mod config;
#[cfg(feature = "ros2")]
pub mod dds;
pub mod diagnostics;
pub mod frames;
pub mod grid;
pub mod messages;
pub mod motion;
pub mod objects;
pub mod process;
pub mod scan;
pub mod shell;
pub mod sink;
pub mod translator;
#[cfg(feature = "zenoh")]
pub mod zenoh;
pub mod zenoh_names;

pub use config::Config;
pub use motion::{Mount, Mounts};
