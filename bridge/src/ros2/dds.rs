//! Shell: messages over RTPS, which every stock ROS 2 understands, by `rustdds`.
//!
//! Topics are named `rt` and the ROS name, types `pkg::msg::dds_::Type_`. The bytes are ready made; rustdds adds the
//! encapsulation header itself. With loopback addresses alone every socket is bound to the loopback device, because rustdds
//! itself binds to all addresses and only chooses what it announces.

#![allow(clippy::disallowed_methods, reason = "shell: it opens sockets")]

use super::cdr::HEADER;
use super::config::Config;
use super::sink::{Sink, SinkError, TopicSpec};
use rustdds::bytes::Bytes;
use rustdds::dds::CreateError;
use rustdds::no_key::{DataWriter, SerializerAdapter};
use rustdds::policy::{Durability, History, Reliability, ResourceLimits};
use rustdds::{
    DataWriterStatus, DomainParticipant, DomainParticipantBuilder, Duration, QosPolicies, QosPolicyBuilder,
    RepresentationIdentifier, StatusEvented, TopicKind,
};
use std::net::{Ipv4Addr, UdpSocket};

/// Least messages that a reliable subscriber may leave unacknowledged before the next one is dropped: rustdds keeps them all,
/// by default 1024, which is 800 MB of grid maps. With one alone, each that came before the answer to the last would be lost.
const WINDOW_MIN: i32 = 3;
/// Kernel buffers. One large cloud fits; what subscribers send back is small.
const SEND_BUFFER_BYTES: usize = 2 << 20;
const RECEIVE_BUFFER_BYTES: usize = 256 << 10;

/// A message that is serialised already.
type Payload = Vec<u8>;

/// Passes the bytes on as they are.
struct AsTheyAre;

impl SerializerAdapter<Payload> for AsTheyAre {
    type Error = std::convert::Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Payload) -> Result<Bytes, Self::Error> {
        Ok(Bytes::copy_from_slice(value.get(HEADER.len()..).unwrap_or_default()))
    }
}

/// One topic's end.
struct Writer {
    topic: String,
    writer: DataWriter<Payload, AsTheyAre>,
    readers: usize,
}

/// A DDS participant with a writer a topic.
pub struct Dds {
    writers: Vec<Writer>,
    // Dropped last: it ends the transport's threads.
    _participant: DomainParticipant,
}

impl Dds {
    /// Opens the sockets and announces the topics. `keep_on_loopback` binds all sockets of the process to that device.
    pub fn open(
        config: &Config,
        topics: &[TopicSpec],
        keep_on_loopback: fn() -> std::io::Result<()>,
    ) -> Result<Self, SinkError> {
        config.addresses.iter().try_for_each(is_ours)?;
        let loopback = config.addresses.iter().all(|address| address.is_loopback());
        let participant = DomainParticipantBuilder::new(config.domain_id)
            .with_only_networks(config.addresses.iter().copied())
            .socket_send_buffer_size(SEND_BUFFER_BYTES)
            .socket_receive_buffer_size(RECEIVE_BUFFER_BYTES)
            .build()
            .map_err(in_words)?;
        if loopback {
            keep_on_loopback().map_err(SinkError::NotConfined)?;
        }
        let publisher = participant.create_publisher(&QosPolicies::qos_none()).map_err(in_words)?;
        let mut writers = Vec::new();
        for topic in topics {
            let (name, qos) = (format!("rt{}", topic.name), qos(topic));
            let dds_topic =
                participant.create_topic(name, topic.dds_type(), &qos, TopicKind::NoKey).map_err(in_words)?;
            let writer = publisher.create_datawriter_no_key(&dds_topic, Some(qos)).map_err(in_words)?;
            writers.push(Writer { topic: topic.name.clone(), writer, readers: 0 });
        }
        Ok(Self { writers, _participant: participant })
    }
}

impl Sink for Dds {
    fn publish(&mut self, topic: usize, cdr: Vec<u8>) -> Result<(), SinkError> {
        let Some(writer) = self.writers.get(topic) else { return Ok(()) };
        writer.writer.write(cdr, None).map_err(|error| SinkError::Transport(error.forget_data().to_string()))
    }

    fn readers(&mut self) -> Option<usize> {
        self.writers.iter_mut().for_each(Writer::listen);
        Some(self.writers.iter().map(|writer| writer.readers).sum())
    }
}

impl Writer {
    /// Takes in what the transport says of subscribers.
    fn listen(&mut self) {
        while let Some(status) = self.writer.try_recv_status() {
            match status {
                DataWriterStatus::PublicationMatched { current, .. } => {
                    self.readers = usize::try_from(current.count()).unwrap_or(0);
                }
                DataWriterStatus::OfferedIncompatibleQos { last_policy_id, .. } => {
                    tracing::warn!(topic = self.topic, policy = ?last_policy_id, "a subscriber asks for more than is offered and hears nothing; see [bridge.ros2.topics]");
                }
                _ => {}
            }
        }
    }
}

/// With an address of another machine rustdds would run and reach nobody.
fn is_ours(address: &Ipv4Addr) -> Result<(), SinkError> {
    let words =
        |error| SinkError::Transport(format!("[bridge.ros2] addresses: {address} is not of this machine: {error}"));
    UdpSocket::bind((*address, 0)).map(drop).map_err(words)
}

fn in_words(error: CreateError) -> SinkError {
    SinkError::Transport(format!("DDS does not start: {error}"))
}

fn qos(topic: &TopicSpec) -> QosPolicies {
    let reliability = match topic.reliable {
        // One thread feeds all topics: to wait for one subscriber that stands still would starve all others.
        true => Reliability::Reliable { max_blocking_time: Duration::ZERO },
        false => Reliability::BestEffort,
    };
    let durability = if topic.transient_local { Durability::TransientLocal } else { Durability::Volatile };
    let depth = i32::try_from(topic.depth).unwrap_or(1);
    let window = depth.max(WINDOW_MIN);
    QosPolicyBuilder::new()
        .reliability(reliability)
        .durability(durability)
        .history(History::KeepLast { depth })
        .resource_limits(ResourceLimits { max_samples: window, max_instances: -1, max_samples_per_instance: window })
        .build()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_of_another_machine_is_an_error_that_names_it() {
        assert!(is_ours(&Ipv4Addr::LOCALHOST).is_ok());
        // 192.0.2.0/24 is for documentation: nobody has it.
        let error = is_ours(&Ipv4Addr::new(192, 0, 2, 1)).unwrap_err().to_string();
        assert!(error.contains("192.0.2.1") && error.contains("addresses"), "{error}");
    }
}
