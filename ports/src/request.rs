//! The two ends of a request-response service: a [`Client`] asks and waits a bounded time, a [`Server`] answers.

use crate::clock::machine_seconds;
use crate::error::PortError;
use crate::event::{EventReceiver, EventSender};
use crate::service::{self, RequestFactory, Role, sleep};
use crate::wire::Wire;
use bytemuck::TransparentWrapper;
use iceoryx2::prelude::*;
use std::time::Duration;
use tsense_contract::Service as Request;

type ClientPort<S> = iceoryx2::port::client::Client<
    ipc::Service,
    Wire<<S as Request>::Request>,
    (),
    [Wire<<S as Request>::Item>],
    Wire<<S as Request>::Header>,
>;
type ServerPort<S> = iceoryx2::port::server::Server<
    ipc::Service,
    Wire<<S as Request>::Request>,
    (),
    [Wire<<S as Request>::Item>],
    Wire<<S as Request>::Header>,
>;

/// How often a client looks for its answer at first: a small one comes within a fraction of a millisecond.
const LOOK_SOON: Duration = Duration::from_micros(50);
/// For how long it looks that often, seconds: a hundred looks.
const SOON_S: f64 = 0.005;
/// How often it looks afterwards.
const LOOK_EVERY: Duration = Duration::from_millis(1);

/// Notifiers and listeners of a service's event.
pub(crate) fn event_places<S: Request>() -> (usize, usize) {
    (S::CLIENTS, 1)
}

/// An answer: one header and any number of items.
pub type Answer<S> = (<S as Request>::Header, Vec<<S as Request>::Item>);

/// The asking end.
pub struct Client<S: Request> {
    port: ClientPort<S>,
    bell: EventSender,
    _factory: RequestFactory<S>,
}

impl<S: Request> Client<S> {
    pub(crate) fn open(node: &Node<ipc::Service>) -> Result<Self, PortError> {
        let factory = service::request::<S>(node, Role::Open)?;
        let port = service::port(S::NAME, &factory, || factory.client_builder().create())?;
        let bell = EventSender::open(node, S::NAME, event_places::<S>())?;
        Ok(Self { port, bell, _factory: factory })
    }

    /// Asks, and waits up to `timeout_s` seconds of the machine. Where the server is away it asks again until then.
    pub fn ask(&mut self, request: &S::Request, timeout_s: f64) -> Result<Answer<S>, PortError> {
        let start_s = machine_seconds();
        while machine_seconds() - start_s < timeout_s {
            let failed = |seen: String| PortError::Send { topic: S::NAME.into(), seen };
            let pending = self.port.send_copy(Wire(*request)).map_err(|e| failed(format!("{e:?}")))?;
            self.bell.notify()?;
            let asked_s = machine_seconds();
            while machine_seconds() - start_s < timeout_s {
                // Asked before looking: an answer given just before the server let go of the request is still found.
                let connected = pending.is_connected();
                if let Some(answer) = pending.receive().map_err(|e| failed(format!("{e:?}")))? {
                    return Ok((answer.user_header().0, Wire::peel_slice(answer.payload()).to_vec()));
                }
                sleep(if machine_seconds() - asked_s < SOON_S { LOOK_SOON } else { LOOK_EVERY });
                // A request made while no server was there, or whose server died, is lost: ask again.
                if !connected {
                    break;
                }
            }
        }
        Err(PortError::NoAnswer { service: S::NAME.into(), timeout_s })
    }
}

/// The answering end.
pub struct Server<S: Request> {
    port: ServerPort<S>,
    bell: EventReceiver,
    _factory: RequestFactory<S>,
}

impl<S: Request> Server<S> {
    pub(crate) fn open(node: &Node<ipc::Service>) -> Result<Self, PortError> {
        let factory = service::request::<S>(node, Role::Open)?;
        let bell = EventReceiver::open(node, S::NAME, event_places::<S>())?;
        let port =
            service::port(S::NAME, &factory, || factory.server_builder().initial_max_slice_len(S::ITEMS_MAX).create())?;
        Ok(Self { port, bell, _factory: factory })
    }

    pub(crate) fn bell(&self) -> &std::rc::Rc<crate::event::Bell> {
        self.bell.bell()
    }

    /// Answers every request that waits; returns how many. An answer that is too long is an error.
    pub fn serve(&mut self, mut answer: impl FnMut(&S::Request) -> Answer<S>) -> Result<usize, PortError> {
        let failed = |seen: String| PortError::Send { topic: S::NAME.into(), seen };
        let mut served = 0;
        while let Some(request) = self.port.receive().map_err(|e| failed(format!("{e:?}")))? {
            let (header, items) = answer(&request.payload().0);
            if items.len() > S::ITEMS_MAX {
                return Err(PortError::TooManyItems { topic: S::NAME.into(), len: items.len(), max: S::ITEMS_MAX });
            }
            let mut loan = request.loan_slice_uninit(items.len()).map_err(|e| failed(e.to_string()))?;
            *loan.user_header_mut() = Wire(header);
            let response = loan.write_from_slice(Wire::wrap_slice(&items));
            // A client that gave up meanwhile is no fault of ours.
            if let Err(e) = response.send() {
                tracing::debug!(service = S::NAME, error = ?e, "an answer found nobody waiting for it");
            }
            served += 1;
        }
        Ok(served)
    }
}
