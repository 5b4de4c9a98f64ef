//! JAUS as bytes and time: the UDP transport of AS5669A and the messages this system speaks.
//!
//! In: datagrams with the address they came from, messages to be sent, the time. Out: messages, datagrams with the
//! address they go to, drops by cause. No sockets, no clock, nothing of the topics: `bridge` serves with it, the
//! position driver asks with it. Numbers keep the units and axes of the standard (degrees of latitude, radians, yaw
//! clockwise from true north, z down); turning them into ours is the user's business.
//!
//! Source: SAE AS5669A (transport), AS5710 (core), AS6009 (pose), AS6060 (range sensor), IOP (cost map), RA 3.x (objects).

mod bytes;
mod id;
pub mod judp;
pub mod message;
mod scale;
mod stamp;
pub mod transport;

pub use bytes::{Malformed, Reader, Writer};
pub use id::Id;
pub use message::{Message, code_of};
pub use scale::Scale;
pub use stamp::{date_stamp, nearest_ns, time_stamp};
pub use transport::{Envelope, Received, Transport};
