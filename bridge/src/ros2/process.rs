//! Shell: the process `ros2`. It reads topics, and publishes them as ROS messages.
//!
//! In: topics pose, joint, scan, map, grid, objects, processes; none of which nobody wants. Out: what the transport sends,
//! and the event that asks the mapper for a keyframe. It writes no topic. A transport that cannot start stops nothing else:
//! the process says so in its state and tries again.

use super::config::{Config, Transport};
use super::motion::Mounts;
use super::shell::{Inboxes, SharedTranslator};
use super::sink::{Queue, Sender, Sink, SinkError, TopicSpec};
use std::collections::BTreeMap;
use std::sync::Arc;
use tsense_contract::ProcessState;
use tsense_geometry::Timestamp;
use tsense_ports::{PortError, Process, Wake};

/// Time between two looks at the transport, graph seconds.
const TEND_PERIOD_S: f64 = 0.5;
/// Time between two attempts to start it, graph seconds.
const OPEN_PERIOD_S: f64 = 5.0;

/// Runs until the process is asked to stop.
pub fn run(mut process: Process, config: &Config, mounts: Mounts) -> Result<(), PortError> {
    let clock = process.clock();
    let mut inboxes = Inboxes::open(&mut process, config, &mounts)?;
    let mut translator = SharedTranslator::new(config, mounts);
    let mut link = Link::new(config, translator.topics());
    let mut tended = clock.now();
    link.tend(&mut process, tended);
    while process.wait(TEND_PERIOD_S) != Wake::Stop {
        let now = clock.now();
        let is_open = link.sender.is_some();
        translator.want(|_| is_open);
        inboxes.take(&mut process, &mut translator, now)?;
        for (topic, message) in translator.take_messages() {
            let overtaken = link.queue.push(topic, message.to_cdr());
            process.health().dropped("overtaken: transport too slow", overtaken);
        }
        if now.seconds_since(tended) >= TEND_PERIOD_S {
            tended = now;
            link.tend(&mut process, now);
            link.report(&mut process, &translator);
        }
    }
    Ok(())
}

/// The transport, or why there is none.
struct Link {
    config: Config,
    topics: Vec<TopicSpec>,
    queue: Arc<Queue>,
    sender: Option<Sender>,
    tried: Option<Timestamp>,
    told: BTreeMap<&'static str, u64>,
    sent: u64,
}

impl Link {
    fn new(config: &Config, topics: &[TopicSpec]) -> Self {
        Self {
            config: config.clone(),
            topics: topics.to_vec(),
            queue: Arc::new(Queue::new(topics)),
            sender: None,
            tried: None,
            told: BTreeMap::new(),
            sent: 0,
        }
    }

    /// Starts the transport where there is none, and states how it is.
    fn tend(&mut self, process: &mut Process, now: Timestamp) {
        if self.sender.as_ref().is_some_and(Sender::lives) {
            return process.health().set(ProcessState::Running, &self.words());
        }
        if self.tried.is_some_and(|tried| now.seconds_since(tried) < OPEN_PERIOD_S) {
            return;
        }
        (self.tried, self.sender) = (Some(now), None);
        self.queue = Arc::new(Queue::new(&self.topics));
        self.sent = 0;
        match self.open() {
            Ok(sender) => {
                self.sender = Some(sender);
                tracing::info!(topics = self.topics.len(), "{}", self.words());
                process.health().set(ProcessState::Running, &self.words());
            }
            Err(error) => {
                tracing::error!(%error, "nothing is published, trying again every {OPEN_PERIOD_S} s");
                process.health().set(ProcessState::Degraded, &error.to_string());
            }
        }
    }

    fn open(&self) -> Result<Sender, SinkError> {
        let sink = open_sink(&self.config, &self.topics)?;
        Sender::start(Arc::clone(&self.queue), sink).map_err(|error| SinkError::Transport(error.to_string()))
    }

    fn words(&self) -> String {
        if self.config.transport == Transport::Zenoh {
            return format!("Zenoh domain {} by {}", self.config.domain_id, self.config.zenoh_endpoint);
        }
        let readers = self.queue.readers();
        let readers = format!("{readers} subscription{}", if readers == 1 { "" } else { "s" });
        let addresses: Vec<_> = self.config.addresses.iter().map(ToString::to_string).collect();
        format!("DDS domain {} on {}, {readers}", self.config.domain_id, addresses.join(", "))
    }

    /// Puts the counters into the heartbeat.
    fn report(&mut self, process: &mut Process, translator: &SharedTranslator) {
        for (cause, total) in translator.drops() {
            let told = self.told.insert(cause, *total).unwrap_or(0);
            process.health().dropped(cause, total - told);
        }
        let (sent, failed) = self.queue.counts();
        process.health().sent(sent - self.sent);
        self.sent = sent;
        let told = self.told.insert("not sent", failed).unwrap_or(0);
        process.health().dropped("not sent", failed.saturating_sub(told));
    }
}

fn open_sink(config: &Config, topics: &[TopicSpec]) -> Result<Box<dyn Sink>, SinkError> {
    match config.transport {
        Transport::Dds => dds(config, topics),
        Transport::Zenoh => zenoh(config, topics),
    }
}

#[cfg(feature = "ros2")]
fn dds(config: &Config, topics: &[TopicSpec]) -> Result<Box<dyn Sink>, SinkError> {
    Ok(Box::new(super::dds::Dds::open(config, topics, tsense_ports::bind_sockets_to_loopback)?))
}

#[cfg(not(feature = "ros2"))]
fn dds(_: &Config, _: &[TopicSpec]) -> Result<Box<dyn Sink>, SinkError> {
    Err(SinkError::NotBuilt("ros2"))
}

#[cfg(feature = "zenoh")]
fn zenoh(config: &Config, topics: &[TopicSpec]) -> Result<Box<dyn Sink>, SinkError> {
    Ok(Box::new(super::zenoh::Zenoh::open(config, topics)?))
}

#[cfg(not(feature = "zenoh"))]
fn zenoh(_: &Config, _: &[TopicSpec]) -> Result<Box<dyn Sink>, SinkError> {
    Err(SinkError::NotBuilt("zenoh"))
}
