//! Events: one bit across processes, "look again". Several notifications before a look are one.

use crate::error::PortError;
use crate::service::{self, EventFactory, Role};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::*;
use std::rc::Rc;

/// Notifiers and listeners of a plain event: any process of the graph may ask, few listen.
pub(crate) const EVENT_PLACES: (usize, usize) = (16, 4);

/// The sending end of an event.
pub struct EventSender {
    notifier: Notifier<ipc::Service>,
    name: String,
    _factory: EventFactory,
}

impl EventSender {
    pub(crate) fn open(node: &Node<ipc::Service>, name: &str, places: (usize, usize)) -> Result<Self, PortError> {
        let factory = service::event(node, name, places, Role::Open)?;
        let notifier = service::port(name, &factory, || factory.notifier_builder().create())?;
        Ok(Self { notifier, name: name.into(), _factory: factory })
    }

    /// Wakes every listener.
    pub fn notify(&self) -> Result<(), PortError> {
        let sent = self.notifier.notify();
        sent.map(drop).map_err(|e| PortError::Send { topic: self.name.clone(), seen: e.to_string() })
    }
}

/// A listener with its unread notifications; shared by the process loop, which drains it.
pub(crate) struct Bell {
    pub(crate) listener: Listener<ipc::Service>,
    rung: std::cell::Cell<bool>,
    _factory: EventFactory,
}

impl Bell {
    pub(crate) fn new(listener: Listener<ipc::Service>, factory: EventFactory) -> Rc<Self> {
        Rc::new(Self { listener, rung: false.into(), _factory: factory })
    }

    /// Empties the socket; true where something was in it.
    pub(crate) fn drain(&self) -> bool {
        let mut any = false;
        if let Err(e) = self.listener.try_wait(|_| any = true) {
            tracing::debug!(error = ?e, "an event could not be read, tried again at the next tick");
        }
        if any {
            self.rung.set(true);
        }
        any
    }
}

/// The receiving end of an event.
pub struct EventReceiver {
    bell: Rc<Bell>,
}

impl EventReceiver {
    pub(crate) fn open(node: &Node<ipc::Service>, name: &str, places: (usize, usize)) -> Result<Self, PortError> {
        let factory = service::event(node, name, places, Role::Open)?;
        let listener = service::port(name, &factory, || factory.listener_builder().create())?;
        Ok(Self { bell: Bell::new(listener, factory) })
    }

    pub(crate) fn bell(&self) -> &Rc<Bell> {
        &self.bell
    }

    /// Whether the event came since this was asked last.
    pub fn drain(&mut self) -> bool {
        self.bell.drain();
        self.bell.rung.take()
    }
}
