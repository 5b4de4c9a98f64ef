//! The two ends of a topic: an [`Outbox`] writes samples, an [`Inbox`] takes them, without copying.
//!
//! Nothing here blocks: when a reader is slow its oldest sample is dropped. A reader that holds more samples than
//! the topic allows gets an error; the writer loses nothing.
#![allow(unsafe_code, reason = "a sample's memory is handed out as plain data before it is filled")]

use crate::error::PortError;
use crate::event::Bell;
use crate::service::{self, EventFactory, Role, TopicFactory, topic_name};
use crate::wire::Wire;
use bytemuck::TransparentWrapper;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use std::rc::Rc;
use tsense_contract::Topic;

type Writer<T> = Publisher<ipc::Service, [Wire<<T as Topic>::Item>], Wire<<T as Topic>::Header>>;
type Reader<T> = Subscriber<ipc::Service, [Wire<<T as Topic>::Item>], Wire<<T as Topic>::Header>>;
type Taken<T> = iceoryx2::sample::Sample<ipc::Service, [Wire<<T as Topic>::Item>], Wire<<T as Topic>::Header>>;

/// What the process loop does with every port at each tick.
pub(crate) trait Tick {
    /// Connects to peers that came since; a late joiner gets the history now. True where samples wait.
    fn tick(&self) -> bool;
}

/// Notifiers and listeners of a topic's event.
pub(crate) fn event_places<T: Topic>() -> (usize, usize) {
    (T::QOS.publishers, T::QOS.subscribers)
}

struct OutboxPorts<T: Topic> {
    writer: Writer<T>,
    notifier: Option<Notifier<ipc::Service>>,
    // Held so that the service outlives its ports.
    _factories: (TopicFactory<T>, Option<EventFactory>),
}

impl<T: Topic> Tick for OutboxPorts<T> {
    fn tick(&self) -> bool {
        if let Err(e) = self.writer.update_connections() {
            tracing::debug!(topic = T::NAME, error = ?e, "connecting to a reader failed, tried again at the next tick");
        }
        false
    }
}

/// The writing end of a topic.
pub struct Outbox<T: Topic> {
    ports: Rc<OutboxPorts<T>>,
    topic: String,
}

impl<T: Topic> Outbox<T> {
    pub(crate) fn open(node: &Node<ipc::Service>, instance: Option<&str>) -> Result<Self, PortError> {
        let topic = topic_name::<T>(instance);
        let factory = service::topic::<T>(node, &topic, Role::Open)?;
        let writer = service::port(&topic, &factory, || {
            factory.publisher_builder().initial_max_slice_len(T::ITEMS_MAX).max_loaned_samples(T::QOS.loans).create()
        })?;
        let event = match T::QOS.event {
            true => Some(service::event(node, &topic, event_places::<T>(), Role::Open)?),
            false => None,
        };
        let notifier = match &event {
            Some(event) => Some(service::port(&topic, event, || event.notifier_builder().create())?),
            None => None,
        };
        Ok(Self { ports: Rc::new(OutboxPorts { writer, notifier, _factories: (factory, event) }), topic })
    }

    pub(crate) fn ticker(&self) -> std::rc::Weak<dyn Tick> {
        let ports: Rc<dyn Tick> = self.ports.clone();
        Rc::downgrade(&ports)
    }

    /// Sends a sample, copying the items into shared memory.
    pub fn send(&mut self, header: &T::Header, items: &[T::Item]) -> Result<(), PortError> {
        self.send_with(header, items.len(), |slots| slots.copy_from_slice(items))
    }

    /// Sends a sample of `len` items that `fill` writes straight into shared memory. `fill` must write every item:
    /// the slice it gets still holds bytes of an earlier sample.
    pub fn send_with(
        &mut self,
        header: &T::Header,
        len: usize,
        fill: impl FnOnce(&mut [T::Item]),
    ) -> Result<(), PortError> {
        self.queue_with(header, len, fill)?;
        self.notify()
    }

    /// As [`Outbox::send_with`], but wakes nobody: for samples that are of no use before one that is sent after them.
    pub fn queue_with(
        &mut self,
        header: &T::Header,
        len: usize,
        fill: impl FnOnce(&mut [T::Item]),
    ) -> Result<(), PortError> {
        if len > T::ITEMS_MAX {
            return Err(PortError::TooManyItems { topic: self.topic.clone(), len, max: T::ITEMS_MAX });
        }
        let failed = |seen: String| PortError::Send { topic: self.topic.clone(), seen };
        let mut loan = self.ports.writer.loan_slice_uninit(len).map_err(|e| failed(e.to_string()))?;
        *loan.user_header_mut() = Wire(*header);
        let slots = loan.payload_mut();
        // SAFETY: shared memory is mapped and zeroed by the kernel, so every byte is initialised, and items are `Pod`:
        // whatever earlier sample the bytes come from, they are valid items. `Wire` is transparent.
        let slots = unsafe { std::slice::from_raw_parts_mut(slots.as_mut_ptr().cast::<T::Item>(), slots.len()) };
        fill(slots);
        // SAFETY: as above.
        let sample = unsafe { loan.assume_init() };
        sample.send().map(drop).map_err(|e| failed(e.to_string()))
    }

    fn notify(&self) -> Result<(), PortError> {
        let Some(notifier) = &self.ports.notifier else { return Ok(()) };
        notifier
            .notify()
            .map(drop)
            .map_err(|e| PortError::Send { topic: self.topic.clone(), seen: format!("event: {e}") })
    }
}

struct InboxPorts<T: Topic> {
    reader: Reader<T>,
    _factory: TopicFactory<T>,
}

impl<T: Topic> Tick for InboxPorts<T> {
    fn tick(&self) -> bool {
        self.reader.has_samples().unwrap_or(false)
    }
}

/// Whether a sample wakes the process that reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wakes {
    /// At once, where the topic has an event.
    Yes,
    /// No: the process looks when it likes.
    No,
}

/// The reading end of a topic.
pub struct Inbox<T: Topic> {
    ports: Rc<InboxPorts<T>>,
    bell: Option<Rc<Bell>>,
    topic: String,
}

impl<T: Topic> Inbox<T> {
    pub(crate) fn open(node: &Node<ipc::Service>, instance: Option<&str>, wakes: Wakes) -> Result<Self, PortError> {
        let topic = topic_name::<T>(instance);
        let factory = service::topic::<T>(node, &topic, Role::Open)?;
        let event = match T::QOS.event && wakes == Wakes::Yes {
            true => Some(service::event(node, &topic, event_places::<T>(), Role::Open)?),
            false => None,
        };
        // The listener comes first: a sample sent in between wakes, at worst once for nothing.
        let bell = match event {
            Some(event) => {
                let listener = service::port(&topic, &event, || event.listener_builder().create())?;
                Some(Bell::new(listener, event))
            }
            None => None,
        };
        let reader =
            service::port(&topic, &factory, || factory.subscriber_builder().buffer_size(T::QOS.buffer).create())?;
        let ports = Rc::new(InboxPorts { reader, _factory: factory });
        Ok(Self { ports, bell, topic })
    }

    pub(crate) fn bell(&self) -> Option<&Rc<Bell>> {
        self.bell.as_ref()
    }

    pub(crate) fn ticker(&self) -> std::rc::Weak<dyn Tick> {
        let ports: Rc<dyn Tick> = self.ports.clone();
        Rc::downgrade(&ports)
    }

    /// The oldest sample that waits, if any. After a wake, take until there is none.
    pub fn take(&mut self) -> Result<Option<Sample<T>>, PortError> {
        let taken = self.ports.reader.receive().map_err(|e| PortError::Receive {
            topic: self.topic.clone(),
            seen: e.to_string(),
            borrow: T::QOS.borrow,
        })?;
        Ok(taken.map(|taken| Sample { taken }))
    }

    /// The newest sample that waits, if any; older ones are given back unread and counted in the second value.
    pub fn take_newest(&mut self) -> Result<(Option<Sample<T>>, u64), PortError> {
        let (mut newest, mut skipped) = (None, 0);
        while let Some(sample) = self.take()? {
            skipped += u64::from(newest.replace(sample).is_some());
        }
        Ok((newest, skipped))
    }
}

/// A sample in shared memory; dropping it gives it back.
pub struct Sample<T: Topic> {
    taken: Taken<T>,
}

impl<T: Topic> Sample<T> {
    /// The sample's header.
    pub fn header(&self) -> &T::Header {
        &self.taken.user_header().0
    }

    /// The sample's items.
    pub fn items(&self) -> &[T::Item] {
        Wire::peel_slice(self.taken.payload())
    }
}

impl<T: Topic> AsRef<[T::Item]> for Sample<T> {
    fn as_ref(&self) -> &[T::Item] {
        self.items()
    }
}
