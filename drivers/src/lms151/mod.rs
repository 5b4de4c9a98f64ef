//! Driver of the SICK LMS-151 laser scanner: CoLa-A and CoLa-B over TCP become stamped scans.
//!
//! From the wire inwards: framing ([`cola_a`], [`cola_b`]), telegrams ([`telegram`], [`fields`], [`fault_code`]), their
//! meaning ([`commands`], [`scan_data`]), the conversation ([`session`]), and what makes a scan of a telegram
//! ([`counters`], [`clock_fit`], [`assemble`]). All of these take bytes and time as arguments. [`process`] and [`shell`]
//! own the socket and the clock. Source: the protocol notes' section 1.

pub mod assemble;
pub mod clock_fit;
pub mod cola_a;
pub mod cola_b;
pub mod commands;
pub mod config;
pub mod counters;
pub mod dialect;
pub mod fault_code;
pub mod fields;
pub mod process;
pub mod scan_data;
pub mod session;
pub mod shell;
pub mod telegram;
