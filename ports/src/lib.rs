//! The shell that every process shares: the graph's domain in shared memory, its topics, events and requests, the
//! clock, signals, the process loop, and logging.
//!
//! This is the only crate that knows iceoryx2. Stages reach it from their shells alone. What was measured about the
//! middleware, and the recipe that survives `kill -9` at any moment, stands in the documentation of [`Host`].

mod cleanup;
mod clock;
mod confine;
mod domain;
mod error;
mod event;
mod health;
mod host;
pub mod logging;
mod memory;
mod parent;
mod process;
mod request;
mod service;
pub mod signals;
mod topic;
mod unborn;
mod wire;

pub use clock::{Clock, machine_seconds};
pub use confine::bind_sockets_to_loopback;
pub use domain::{Domain, Facts, NAME_MAX, SHARED_MEMORY};
pub use error::PortError;
pub use event::{EventReceiver, EventSender};
pub use health::Health;
pub use host::{Host, Leftover};
pub use memory::Most;
pub use parent::STOP_TIMEOUT_S;
pub use process::{HEARTBEAT_S, Process, Wake};
pub use request::{Answer, Client, Server};
pub use service::topic_name;
pub use topic::{Inbox, Outbox, Sample};
