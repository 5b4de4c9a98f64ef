//! Events: reports that come by themselves, periodically or on every change. AS5710.

use super::scaled::EventRate;
use super::{Field, List8};
use crate::bytes::{Malformed, Reader, Writer};

messages! {
    /// Asks for an event.
    CreateEvent = 0x01F0 {
        /// Comes back in the answer.
        request: u8,
        /// [`PERIODIC`] or [`EVERY_CHANGE`].
        kind: u8,
        /// Wanted rate, hertz.
        rate: EventRate,
        /// Code and fields of the query whose report is wanted.
        query: Vec<u8>,
    }
    /// Changes an event, or keeps it.
    UpdateEvent = 0x01F1 {
        /// Comes back in the answer.
        request: u8,
        /// [`PERIODIC`] or [`EVERY_CHANGE`].
        kind: u8,
        /// Wanted rate, hertz.
        rate: EventRate,
        /// The event.
        event: u8,
        /// Code and fields of the query whose report is wanted.
        query: Vec<u8>,
    }
    /// Ends an event.
    CancelEvent = 0x01F2 {
        /// Comes back in the answer.
        request: u8,
        /// The event.
        event: u8,
    }
    /// Asks to be told when a command was carried out.
    CreateCommandEvent = 0x01F6 {
        /// Comes back in the answer.
        request: u8,
        /// How long it may take, seconds.
        duration_max_s: u32,
        /// Code and fields of the command.
        command: Vec<u8>,
    }
    /// An event was made, changed or ended.
    ConfirmEventRequest = 0x01F3 {
        /// That of the request.
        request: u8,
        /// The event.
        event: u8,
        /// Its rate, hertz.
        rate: EventRate,
    }
    /// Asks after how long events end.
    QueryEventTimeout = 0x21F2 {}
    /// After how long events end that nobody keeps.
    ReportEventTimeout = 0x41F2 {
        /// Minutes, 0 never.
        timeout_min: u8,
    }
    /// The events there are.
    ReportEvents = 0x41F0 {
        /// One by one.
        events: List8<EventRecord>,
    }
    /// A report that comes by itself.
    Event = 0x41F1 {
        /// The event.
        event: u8,
        /// Rises by one with each report.
        sequence: u8,
        /// Code and fields of the report.
        report: Vec<u8>,
    }
}

records! {
    /// An event in a list.
    EventRecord {
        /// [`PERIODIC`] or [`EVERY_CHANGE`].
        kind: u8,
        /// The event.
        event: u8,
        /// Code and fields of its query.
        query: Vec<u8>,
    }
}

/// Kind of an event: at a rate.
pub const PERIODIC: u8 = 0;
/// Kind of an event: whenever the report changes.
pub const EVERY_CHANGE: u8 = 1;

/// [`RejectEventRequest`]: no periodic events here.
pub const NO_PERIODIC: u8 = 1;
/// [`RejectEventRequest`]: no events on change here.
pub const NO_CHANGE_BASED: u8 = 2;
/// [`RejectEventRequest`]: refused.
pub const REFUSED: u8 = 3;
/// [`RejectEventRequest`]: the event makes no sense.
pub const INVALID_SETUP: u8 = 4;
/// [`RejectEventRequest`]: the query is not one of this component.
pub const UNSUPPORTED: u8 = 5;
/// [`RejectEventRequest`]: no such event.
pub const INVALID_ID: u8 = 6;

presence! {
    /// An event was not made, changed or ended.
    RejectEventRequest: u8 {
        /// That of the request.
        must request: u8,
        /// Why, a code.
        may response: u8,
        /// Why, in words.
        may words: Words,
    }
}

message_of_field! { RejectEventRequest = 0x01F4 }

/// Text of 80 bytes, padded with zeros.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Words(pub String);

impl Field for Words {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        let text = String::from_utf8_lossy(reader.bytes(80)?);
        Ok(Self(text.trim_end_matches('\0').to_owned()))
    }
    fn write(&self, out: &mut Writer) {
        let mut bytes = [0; 80];
        let end = (0..=self.0.len().min(80)).rev().find(|i| self.0.is_char_boundary(*i)).unwrap_or(0);
        bytes[..end].copy_from_slice(&self.0.as_bytes()[..end]);
        out.bytes(&bytes);
    }
}

/// Which events are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QueryEvents {
    /// Those on a query with this code.
    Code(u16),
    /// Those of this kind.
    Kind(u8),
    /// This one.
    Event(u8),
    /// All.
    All,
}

impl Field for QueryEvents {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        match reader.u8()? {
            0 => reader.u16().map(Self::Code),
            1 => reader.u8().map(Self::Kind),
            2 => reader.u8().map(Self::Event),
            3 => reader.u8().map(|_| Self::All),
            _ => Err(Malformed::Tag),
        }
    }
    fn write(&self, out: &mut Writer) {
        let mut two = |tag, value| {
            out.u8(tag);
            out.u8(value);
        };
        match self {
            Self::Code(code) => {
                out.u8(0);
                out.u16(*code);
            }
            Self::Kind(kind) => two(1, *kind),
            Self::Event(event) => two(2, *event),
            Self::All => two(3, 0),
        }
    }
}

message_of_field! { QueryEvents = 0x21F0 }
