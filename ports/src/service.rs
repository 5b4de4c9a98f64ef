//! The middleware's services behind topics, events and requests: created by the launcher, opened by everyone else.
//!
//! In: a node and a topic's type. Out: a port factory. The quality of service is set from the topic on both sides.
//! Only the launcher creates; others open with back-off, so that a process killed half way through its start can
//! never leave a half-made service behind.

use crate::clock::machine_seconds;
use crate::error::PortError;
use crate::wire::Wire;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe, request_response};
use std::time::Duration;
use tsense_contract::{Message, Service as Request, Topic};

/// A topic's port factory.
pub type TopicFactory<T> =
    publish_subscribe::PortFactory<ipc::Service, [Wire<<T as Topic>::Item>], Wire<<T as Topic>::Header>>;
/// An event's port factory.
pub type EventFactory = event::PortFactory<ipc::Service>;
/// A request-response service's port factory.
pub type RequestFactory<S> = request_response::PortFactory<
    ipc::Service,
    Wire<<S as Request>::Request>,
    (),
    [Wire<<S as Request>::Item>],
    Wire<<S as Request>::Header>,
>;

/// Nodes that may open a service: every process of a graph, people who look, and the dead not yet cleaned up.
const NODES_MAX: usize = 48;
/// How long a child tries to open a service, seconds: a launcher that cleans up after a crash may be busy.
const OPEN_TIMEOUT_S: f64 = 5.0;
/// Wait between two tries.
const RETRY: Duration = Duration::from_millis(10);
/// How long a port waits for the cleaning of a dead owner of its place, each time.
pub(crate) const CLEAN_TIMEOUT: Duration = Duration::from_millis(100);

/// The full name of a topic with an optional instance.
pub fn topic_name<T: Topic>(instance: Option<&str>) -> String {
    instance.map_or_else(|| T::NAME.to_owned(), |i| format!("{}/{i}", T::NAME))
}

/// What a process does with a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// The launcher.
    Create,
    /// Everyone else.
    Open,
}

pub(crate) fn topic<T: Topic>(node: &Node<ipc::Service>, name: &str, role: Role) -> Result<TopicFactory<T>, PortError> {
    let ours = format!("{} with items {}", T::Header::TYPE_NAME, T::Item::TYPE_NAME);
    retry(name, &ours, || {
        let builder = node
            .service_builder(&service_name(name)?)
            .publish_subscribe::<[Wire<T::Item>]>()
            .user_header::<Wire<T::Header>>()
            .payload_alignment(alignment::<T>())
            .enable_safe_overflow(true)
            .max_publishers(T::QOS.publishers)
            .max_subscribers(T::QOS.subscribers)
            .history_size(T::QOS.history)
            .subscriber_max_buffer_size(T::QOS.buffer)
            .subscriber_max_borrowed_samples(T::QOS.borrow)
            .max_nodes(NODES_MAX);
        match role {
            Role::Create => builder.create().map_err(|e| format!("{e:?}")),
            Role::Open => builder.open().map_err(|e| format!("{e:?}")),
        }
    })
}

/// Items that fill whole cache lines of 64 bytes begin with one, so that copying them crosses no border. Others stay as
/// they are: the middleware would round each item up.
fn alignment<T: Topic>() -> Alignment {
    // Less than the item itself needs changes nothing.
    if size_of::<T::Item>().is_multiple_of(64) { Alignment::ALIGN_64 } else { Alignment::ALIGN_1 }
}

pub(crate) fn event(
    node: &Node<ipc::Service>,
    name: &str,
    (notifiers, listeners): (usize, usize),
    role: Role,
) -> Result<EventFactory, PortError> {
    retry(name, "an event", || {
        let builder = node
            .service_builder(&service_name(name)?)
            .event()
            .max_notifiers(notifiers)
            .max_listeners(listeners)
            .event_id_max_value(0) // One meaning a service: "look again".
            .max_nodes(NODES_MAX);
        match role {
            Role::Create => builder.create().map_err(|e| format!("{e:?}")),
            Role::Open => builder.open().map_err(|e| format!("{e:?}")),
        }
    })
}

pub(crate) fn request<S: Request>(node: &Node<ipc::Service>, role: Role) -> Result<RequestFactory<S>, PortError> {
    let ours = format!("{} answered by {}", S::Request::TYPE_NAME, S::Item::TYPE_NAME);
    retry(S::NAME, &ours, || {
        let builder = node
            .service_builder(&service_name(S::NAME)?)
            .request_response::<Wire<S::Request>, [Wire<S::Item>]>()
            .response_user_header::<Wire<S::Header>>()
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true)
            .max_servers(1)
            .max_clients(S::CLIENTS)
            .max_active_requests_per_client(2) // One asked, one given up on.
            .max_response_buffer_size(1)
            .max_borrowed_responses_per_pending_response(1)
            .max_loaned_requests(1)
            .max_nodes(NODES_MAX);
        match role {
            Role::Create => builder.create().map_err(|e| format!("{e:?}")),
            Role::Open => builder.open().map_err(|e| format!("{e:?}")),
        }
    })
}

fn service_name(name: &str) -> Result<ServiceName, String> {
    ServiceName::new(name).map_err(|e| format!("{e:?}"))
}

/// Tries until it works, another version is there, or the time is up.
fn retry<F>(topic: &str, ours: &str, mut attempt: impl FnMut() -> Result<F, String>) -> Result<F, PortError> {
    let start_s = machine_seconds();
    loop {
        let seen = match attempt() {
            Ok(factory) => return Ok(factory),
            Err(seen) => seen,
        };
        if seen.contains("Incompatible") || seen.contains("VersionMismatch") {
            return Err(PortError::OtherVersion { topic: topic.into(), ours: ours.into() });
        }
        let tried_s = machine_seconds() - start_s;
        if tried_s > OPEN_TIMEOUT_S {
            let advice = "only the launcher offers topics: is this one part of the graph's configuration?";
            return Err(PortError::Service { topic: topic.into(), seen, tried_s, advice });
        }
        sleep(RETRY);
    }
}

/// Creates a port; where the places are taken by the dead, has them cleaned up and tries again.
pub(crate) fn port<P, E: std::fmt::Debug>(
    topic: &str,
    factory: &impl PortFactory,
    mut create: impl FnMut() -> Result<P, E>,
) -> Result<P, PortError> {
    let start_s = machine_seconds();
    loop {
        let seen = match create() {
            Ok(port) => return Ok(port),
            Err(e) => format!("{e:?}"),
        };
        let tried_s = machine_seconds() - start_s;
        if tried_s > OPEN_TIMEOUT_S {
            return Err(if seen.contains("ExceedsMaxSupported") {
                PortError::Full { topic: topic.into(), seen }
            } else {
                let advice = "see the log above; is /dev/shm full, or does it belong to another user?";
                PortError::Service { topic: topic.into(), seen, tried_s, advice }
            });
        }
        factory.blocking_cleanup_dead_nodes(CLEAN_TIMEOUT);
        sleep(RETRY);
    }
}

#[allow(clippy::disallowed_methods, reason = "shell: a bounded back-off before the process loop runs")]
pub(crate) fn sleep(duration: Duration) {
    std::thread::sleep(duration);
}
