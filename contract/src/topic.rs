//! What a topic is: a name, a header type, an item type and a quality of service, all known at build time.
//!
//! The figures are those that survived being killed (see `docs/decisions/`): buffers are bounded, overflow drops
//! the oldest sample, nothing ever blocks on a slow reader.

use crate::message::Message;

/// Bounds of a publish-subscribe topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Publishers at a time. One writer per fact.
    pub publishers: usize,
    /// Subscribers at a time: every process of the graph, plus people who look.
    pub subscribers: usize,
    /// Samples a late joiner is given.
    pub history: usize,
    /// Samples waiting for a subscriber; the oldest is dropped on overflow.
    pub buffer: usize,
    /// Samples a subscriber may hold at once.
    pub borrow: usize,
    /// Samples a publisher may hold before sending.
    pub loans: usize,
    /// Whether an event wakes the readers. Without one they poll when woken by something else.
    pub event: bool,
}

/// A publish-subscribe topic: each sample is one header and a slice of items.
pub trait Topic: 'static {
    /// One per sample.
    type Header: Message;
    /// Any number per sample, up to [`Topic::ITEMS_MAX`].
    type Item: Message;
    /// Name of the service; a topic with instances (one ladar each) appends `/instance`.
    const NAME: &'static str;
    /// Bounds.
    const QOS: Qos;
    /// Most items in one sample; shared memory is sized for it.
    const ITEMS_MAX: usize;
}

/// A request-response topic with one server.
pub trait Service: 'static {
    /// What the client sends.
    type Request: Message;
    /// One per answer.
    type Header: Message;
    /// Any number per answer, up to [`Service::ITEMS_MAX`].
    type Item: Message;
    /// Name of the service.
    const NAME: &'static str;
    /// Most items in one answer.
    const ITEMS_MAX: usize;
    /// Clients at a time.
    const CLIENTS: usize;
}
