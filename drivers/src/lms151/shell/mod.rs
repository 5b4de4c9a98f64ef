//! The parts of the LMS-151 driver that touch the operating system: the connection, and what the command line asks of a device.

pub mod device;
pub mod link;
