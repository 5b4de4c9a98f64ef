//! Shell: messages over Zenoh in the convention of rmw_zenoh_cpp, through a router, by the `zenoh` crate.
//!
//! The bytes are the same as over DDS. The newest of a latched topic are kept and given to who joins late and asks for them,
//! where `zenoh-ext`'s subscribers (those of rmw_zenoh) ask. A full link drops what it cannot take and never holds the sender up.

#![allow(clippy::disallowed_methods, reason = "shell: ROS stamps each sample with the time of the machine")]

use super::config::Config;
use super::sink::{Sink, SinkError, TopicSpec};
use super::zenoh_names::{attachment, data_key, history_key, node_token, publisher_token};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};
use twox_hash::XxHash3_128;
use zenoh::bytes::ZBytes;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::query::Queryable;
use zenoh::time::Timestamp;
use zenoh::{Session, Wait};

/// A sample as it was sent. Cloning it copies no payload.
#[derive(Clone)]
struct Sent {
    payload: ZBytes,
    attachment: ZBytes,
    stamp: Timestamp,
}

/// The newest samples of a latched topic, the oldest first.
type Latched = Arc<Mutex<VecDeque<Sent>>>;

/// A panic elsewhere leaves the list as it was: each change is one statement.
fn locked(latched: &Latched) -> MutexGuard<'_, VecDeque<Sent>> {
    latched.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One topic's end.
struct Writer {
    publisher: Publisher<'static>,
    gid: [u8; 16],
    sequence: i64,
    depth: usize,
    /// What is kept, and what answers; none where the topic is not latched.
    latched: Option<(Latched, Queryable<()>)>,
}

/// A session with a publisher and a token a topic.
pub struct Zenoh {
    writers: Vec<Writer>,
    // While these live, peers see the node and its publishers.
    _tokens: Vec<LivelinessToken>,
    session: Session,
}

impl Zenoh {
    /// Connects to the router and announces the topics.
    pub fn open(config: &Config, topics: &[TopicSpec]) -> Result<Self, SinkError> {
        let session = zenoh::open(session_config(config)?).wait().map_err(in_words)?;
        let (domain, id) = (config.domain_id, session.zid().to_string());
        let token = |key: &str| session.liveliness().declare_token(key.to_owned()).wait().map_err(in_words);
        let mut tokens = vec![token(&node_token(domain, &id))?];
        let mut writers = Vec::new();
        for (i, topic) in topics.iter().enumerate() {
            // Entity 0 is the node.
            let name = publisher_token(domain, &id, i + 1, topic);
            let key = data_key(domain, topic);
            let history = history_key(&key, &id);
            let latched = topic.transient_local.then(|| latch(&session, &key, &history)).transpose()?;
            if latched.is_some() {
                tokens.push(token(&history)?);
            }
            let publisher = session.declare_publisher(key).congestion_control(CongestionControl::Drop);
            writers.push(Writer {
                publisher: publisher.wait().map_err(in_words)?,
                gid: XxHash3_128::oneshot(name.as_bytes()).to_le_bytes(),
                sequence: 0,
                depth: topic.depth,
                latched,
            });
            tokens.push(token(&name)?);
        }
        Ok(Self { writers, _tokens: tokens, session })
    }
}

/// Answers who asks for what was sent before.
fn latch(session: &Session, key: &str, history: &str) -> Result<(Latched, Queryable<()>), SinkError> {
    let latched = Latched::default();
    let (kept, key) = (Arc::clone(&latched), key.to_owned());
    let answer = move |query: zenoh::query::Query| {
        let samples = locked(&kept).clone();
        for Sent { payload, attachment, stamp } in samples {
            let reply = query.reply(&key, payload).attachment(attachment).timestamp(stamp).wait();
            if let Err(error) = reply {
                tracing::debug!(%error, key, "who joined late was not answered");
            }
        }
    };
    let queryable = session.declare_queryable(history.to_owned()).callback(answer).wait().map_err(in_words)?;
    Ok((latched, queryable))
}

/// A client of one router: no scouting, no listening.
fn session_config(config: &Config) -> Result<zenoh::Config, SinkError> {
    let mut session = zenoh::Config::default();
    let endpoints = format!("[{:?}]", config.zenoh_endpoint);
    for (key, value) in
        [("mode", "\"client\""), ("connect/endpoints", &endpoints), ("scouting/multicast/enabled", "false")]
    {
        session.insert_json5(key, value).map_err(in_words)?;
    }
    Ok(session)
}

impl Sink for Zenoh {
    fn publish(&mut self, topic: usize, cdr: Vec<u8>) -> Result<(), SinkError> {
        let Some(writer) = self.writers.get_mut(topic) else { return Ok(()) };
        writer.sequence += 1;
        let now_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
        let attachment = attachment(writer.sequence, i64::try_from(now_ns).unwrap_or(i64::MAX), writer.gid);
        let sample =
            Sent { payload: cdr.into(), attachment: attachment.to_vec().into(), stamp: self.session.new_timestamp() };
        if let Some((latched, _)) = &writer.latched {
            let mut kept = locked(latched);
            kept.push_back(sample.clone());
            let beyond = kept.len().saturating_sub(writer.depth);
            kept.drain(..beyond);
        }
        let Sent { payload, attachment, stamp } = sample;
        writer.publisher.put(payload).attachment(attachment).timestamp(stamp).wait().map_err(in_words)
    }

    fn readers(&mut self) -> Option<usize> {
        None
    }
}

fn in_words(error: impl std::fmt::Display) -> SinkError {
    SinkError::Transport(format!("Zenoh: {error}"))
}
