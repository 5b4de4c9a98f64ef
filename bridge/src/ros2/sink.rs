//! What carries messages to ROS: a transport behind one trait, fed from a bounded queue by a thread of its own.
//!
//! In: serialised messages. Out: the network. The process that translates never waits for a transport: a message that
//! cannot be taken in time is overtaken by the newest of its topic, and counted.

use super::config::{Config, TopicConfig};
use super::messages::RosMessage;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Most bytes of several messages waiting: the whole bridge may cost 8 MB, and a transport keeps the newest of each topic
/// too. A larger message (a grid of more than 60 x 60 m) waits alone.
const QUEUE_BYTES_MAX: usize = 4 << 20;

/// A topic as it is offered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicSpec {
    /// Its name with the slash in front.
    pub name: String,
    /// Package, `msg`, type.
    pub type_name: &'static str,
    /// REP-2016 hash.
    pub type_hash: &'static str,
    /// Reliable, or else best effort.
    pub reliable: bool,
    /// Whether who joins late gets the newest message.
    pub transient_local: bool,
    /// Messages kept.
    pub depth: usize,
}

impl TopicSpec {
    /// A topic of this message.
    pub fn of<M: RosMessage>(config: &Config, topic: &TopicConfig, suffix: &str) -> Self {
        Self {
            name: config.absolute(&topic.name) + suffix,
            type_name: M::TYPE,
            type_hash: M::HASH,
            reliable: topic.reliable,
            transient_local: topic.transient_local,
            depth: topic.depth,
        }
    }

    /// The type as DDS and rmw_zenoh name it.
    pub fn dds_type(&self) -> String {
        match self.type_name.rsplit_once('/') {
            Some((package, name)) => format!("{}::dds_::{name}_", package.replace('/', "::")),
            None => self.type_name.into(),
        }
    }
}

/// A transport.
pub trait Sink: Send {
    /// Sends a message of a topic; an error drops this message and no other.
    fn publish(&mut self, topic: usize, cdr: Vec<u8>) -> Result<(), SinkError>;

    /// Subscribers of all topics; none where the transport does not say.
    fn readers(&mut self) -> Option<usize>;
}

/// Why a transport does not start, or a message was not sent.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// This binary was built without it; the feature that it needs.
    #[error("this tsense was built without that transport; build with --features {0}")]
    NotBuilt(&'static str),
    /// The transport's own words.
    #[error("{0}")]
    Transport(String),
    /// The sockets could not be kept on this machine.
    #[error("cannot bind the sockets to the loopback device: {0}; give [bridge.ros2] addresses of the network to use")]
    NotConfined(std::io::Error),
}

/// Messages on their way from the translator to the transport.
#[derive(Debug)]
pub struct Queue {
    state: Mutex<Waiting>,
    changed: Condvar,
    depths: Vec<usize>,
    sent: AtomicU64,
    failed: AtomicU64,
    readers: AtomicUsize,
}

#[derive(Debug, Default)]
struct Waiting {
    messages: VecDeque<(usize, Vec<u8>)>,
    bytes: usize,
    closed: bool,
}

impl Queue {
    /// An empty queue for these topics.
    pub fn new(topics: &[TopicSpec]) -> Self {
        Self {
            state: Mutex::default(),
            changed: Condvar::new(),
            depths: topics.iter().map(|topic| topic.depth).collect(),
            sent: AtomicU64::new(0),
            failed: AtomicU64::new(0),
            readers: AtomicUsize::new(0),
        }
    }

    /// A panic elsewhere leaves the queue usable: each change is complete before the lock is given back.
    fn locked(&self) -> MutexGuard<'_, Waiting> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Appends a message; returns how many older ones had to go.
    pub fn push(&self, topic: usize, cdr: Vec<u8>) -> u64 {
        let mut waiting = self.locked();
        let mut overtaken = 0;
        let depth = self.depths.get(topic).copied().unwrap_or(1);
        if waiting.messages.iter().filter(|(t, _)| *t == topic).count() >= depth {
            overtaken += waiting.remove_oldest(|t| t == topic);
        }
        while !waiting.messages.is_empty() && waiting.bytes + cdr.len() > QUEUE_BYTES_MAX {
            overtaken += waiting.remove_oldest(|_| true);
        }
        waiting.bytes += cdr.len();
        waiting.messages.push_back((topic, cdr));
        drop(waiting);
        self.changed.notify_one();
        overtaken
    }

    /// The oldest message, as soon as there is one; nothing once the queue is closed.
    pub fn pop(&self) -> Option<(usize, Vec<u8>)> {
        let mut waiting = self.locked();
        loop {
            if waiting.closed {
                return None;
            }
            if let Some((topic, cdr)) = waiting.messages.pop_front() {
                waiting.bytes -= cdr.len();
                return Some((topic, cdr));
            }
            waiting = self.changed.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Ends every `pop`.
    pub fn close(&self) {
        self.locked().closed = true;
        self.changed.notify_all();
    }

    /// Messages sent, and messages the transport refused, since the start.
    pub fn counts(&self) -> (u64, u64) {
        (self.sent.load(Ordering::Relaxed), self.failed.load(Ordering::Relaxed))
    }

    /// Subscribers, as of the newest message.
    pub fn readers(&self) -> usize {
        self.readers.load(Ordering::Relaxed)
    }
}

impl Waiting {
    fn remove_oldest(&mut self, wanted: impl Fn(usize) -> bool) -> u64 {
        let Some(at) = self.messages.iter().position(|(topic, _)| wanted(*topic)) else { return 0 };
        let removed = self.messages.remove(at);
        self.bytes -= removed.map_or(0, |(_, cdr)| cdr.len());
        1
    }
}

/// The transport's thread; it ends when this is dropped.
#[derive(Debug)]
pub struct Sender {
    queue: Arc<Queue>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Sender {
    /// Lets a thread feed the sink from the queue.
    pub fn start(queue: Arc<Queue>, mut sink: Box<dyn Sink>) -> std::io::Result<Self> {
        let feeding = Arc::clone(&queue);
        let thread = std::thread::Builder::new().name("ros2-sink".into()).spawn(move || {
            while let Some((topic, cdr)) = feeding.pop() {
                let counter = match sink.publish(topic, cdr) {
                    Ok(()) => &feeding.sent,
                    Err(error) => {
                        tracing::debug!(%error, topic, "message not sent");
                        &feeding.failed
                    }
                };
                counter.fetch_add(1, Ordering::Relaxed);
                feeding.readers.store(sink.readers().unwrap_or(0), Ordering::Relaxed);
            }
        })?;
        Ok(Self { queue, thread: Some(thread) })
    }

    /// False where the thread ended by itself, which only a panic of the transport does.
    pub fn lives(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.queue.close();
        if let Some(thread) = self.thread.take() {
            // A panic of the transport was already printed; there is nobody to pass it to.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::messages::{OccupancyGrid, TfMessage};

    fn topics() -> Vec<TopicSpec> {
        let config = Config::default();
        let grid = TopicSpec::of::<OccupancyGrid>(&config, &config.topics.traversability, "");
        vec![grid, TopicSpec::of::<TfMessage>(&config, &config.topics.tf, "")]
    }

    #[test]
    fn names_and_types_are_those_that_ros_gives_them() {
        let topics = topics();
        assert_eq!((topics[0].name.as_str(), topics[1].name.as_str()), ("/tsense/traversability", "/tf"));
        assert_eq!(topics[0].dds_type(), "nav_msgs::msg::dds_::OccupancyGrid_");
    }

    #[test]
    fn the_newest_overtakes_and_the_overtaken_are_counted() {
        let queue = Queue::new(&topics());
        assert_eq!(queue.push(0, vec![1]), 0);
        assert_eq!(queue.push(1, vec![2]), 0);
        assert_eq!(queue.push(0, vec![3]), 1, "depth 1");
        assert_eq!(queue.push(1, vec![4]), 0, "depth 100");
        let taken: Vec<_> = (0..3).map(|_| queue.pop().unwrap()).collect();
        assert_eq!(taken, [(1, vec![2]), (0, vec![3]), (1, vec![4])]);
    }

    #[test]
    fn several_messages_never_hold_more_than_the_queues_bytes_and_a_larger_one_waits_alone() {
        let queue = Queue::new(&topics());
        let overtaken: u64 = (0..20).map(|_| queue.push(1, vec![0; QUEUE_BYTES_MAX / 4])).sum();
        assert_eq!(overtaken, 16);
        assert_eq!(queue.push(1, vec![0; QUEUE_BYTES_MAX + 1]), 4);
        assert_eq!(queue.push(1, vec![7]), 1);
        assert_eq!(queue.pop(), Some((1, vec![7])));
        queue.close();
        assert_eq!(queue.pop(), None);
    }

    /// A transport that hangs: nothing ever gets through.
    struct Stuck(std::sync::mpsc::Receiver<()>);

    impl Sink for Stuck {
        fn publish(&mut self, _: usize, _: Vec<u8>) -> Result<(), SinkError> {
            let _ = self.0.recv();
            Ok(())
        }

        fn readers(&mut self) -> Option<usize> {
            None
        }
    }

    #[test]
    fn a_transport_that_hangs_costs_the_translator_no_time_and_no_memory() {
        let (free, held) = std::sync::mpsc::channel();
        let queue = Arc::new(Queue::new(&topics()));
        let sender = Sender::start(Arc::clone(&queue), Box::new(Stuck(held))).unwrap();
        let overtaken: u64 = (0..10_000).map(|_| queue.push(0, vec![0; 10_000])).sum();
        assert!(overtaken >= 9_998, "one is being sent, one waits: {overtaken}");
        assert!(queue.locked().bytes <= 10_000);
        assert!(sender.lives());
        drop(free);
        drop(sender);
    }
}
