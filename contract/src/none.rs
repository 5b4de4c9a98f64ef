//! The item of topics whose samples are a header alone.

use crate::message::message;

message! {
    /// No content: samples of header-only topics carry no items.
    Nothing = "tsense.nothing.v1" {
        /// Zero.
        zero: u8,
    }
}
