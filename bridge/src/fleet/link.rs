//! Shell: the two ends of the link over Zenoh. Keys are `tsense/VEHICLE/news` (published) and `tsense/VEHICLE/ask` (asked).
//!
//! A vehicle connects, a station listens; nobody is searched for and nobody is told of others: scouting by multicast and
//! gossip is off, and a vehicle listens nowhere. Each end of each connection is a session of its own, so that a station
//! that does not read holds up no other. Nothing of the vehicle waits for a station: news are dropped where the link is
//! congested, and answers are given by a thread that waits alone.
#![allow(clippy::disallowed_methods, reason = "shell: it owns the sessions and a thread")]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::SyncSender;
use std::thread::JoinHandle;
use std::time::Duration;
use tsense_contract::{FLEET_MESSAGE_BYTES_MAX, VehicleName};
use zenoh::handlers::{RingChannel, RingChannelHandler};
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::query::{Query, Queryable};
use zenoh::{Config, Session, Wait};

/// Questions of one station that wait, at most: it has three open at a time.
const QUESTIONS_MAX: usize = 8;
/// How often the answering thread looks whether it is to end.
const LOOK: Duration = Duration::from_millis(200);
/// An answer that does not come within this is not waited for, at a station: questions are asked anew before.
const ANSWER: Duration = Duration::from_secs(10);
/// Zenoh's own frames around a message.
const FRAMES_BYTES: usize = 4096;

/// Why there is no link.
pub type LinkError = Box<dyn std::error::Error + Send + Sync>;

/// What came in at a station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// A vehicle of this name says how far its lists go.
    News(String, Vec<u8>),
    /// A vehicle of this name answers.
    Answer(String, Vec<u8>),
}

/// A session that talks to the given addresses and to nobody else. `patience_us`: a connection on which nothing could be
/// sent for this long is closed, and made anew.
fn session(listen: &[String], connect: &[String], peers_max: usize, patience_us: u32) -> Result<Session, LinkError> {
    let list = |addresses: &[String]| {
        let all: Vec<String> = addresses.iter().map(|address| format!("\"tcp/{address}\"")).collect();
        all.join(", ")
    };
    let config = format!(
        r#"{{
            mode: "peer",
            listen: {{ endpoints: [{}] }},
            connect: {{ endpoints: [{}], retry: {{ period_init_ms: 500, period_max_ms: 2000, period_increase_factor: 2 }} }},
            scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
            transport: {{
                unicast: {{ max_sessions: {peers_max} }},
                link: {{
                    tx: {{ queue: {{ congestion_control: {{ block: {{ wait_before_close: {patience_us} }} }} }} }},
                    rx: {{ max_message_size: {} }},
                }},
            }},
        }}"#,
        list(listen),
        list(connect),
        FLEET_MESSAGE_BYTES_MAX + FRAMES_BYTES,
    );
    zenoh::open(Config::from_json5(&config)?).wait()
}

/// A vehicle's end of the link to one station.
pub struct VehicleLink {
    news: Publisher<'static>,
    ending: Arc<AtomicBool>,
    sent: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
    session: Session,
}

impl VehicleLink {
    /// Connects, and goes on trying. `answer` gives the bytes that a question gets, or nothing.
    pub fn open(
        address: &str,
        name: &VehicleName,
        answer: impl Fn(&[u8]) -> Option<Vec<u8>> + Send + 'static,
    ) -> Result<Self, LinkError> {
        let session = session(&[], &[address.to_owned()], 1, 5_000_000)?;
        let news = session.declare_publisher(format!("tsense/{name}/news")).wait()?;
        let questions = session.declare_queryable(format!("tsense/{name}/ask")).complete(true);
        let questions = questions.with(RingChannel::new(QUESTIONS_MAX)).wait()?;
        let (ending, sent) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let (ends, counts) = (Arc::clone(&ending), Arc::clone(&sent));
        let work = move || answer_all(&questions, answer, &ends, &counts);
        let thread = std::thread::Builder::new().name("fleet-answers".into()).spawn(work)?;
        Ok(Self { news, ending, sent, thread: Some(thread), session })
    }

    /// Says how far the lists go; where the link is congested or down, to nobody.
    pub fn tell(&self, news: Vec<u8>) {
        if self.stations() > 0 {
            self.sent.fetch_add(news.len() as u64, Ordering::Relaxed);
        }
        if let Err(error) = self.news.put(news).wait() {
            tracing::debug!(%error, "news were not sent");
        }
    }

    /// Stations at the other end: 0 or 1.
    pub fn stations(&self) -> usize {
        self.session.info().peers_zid().wait().count()
    }

    /// Bytes that were sent to this station, without Zenoh's own.
    pub fn sent_bytes(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }
}

impl Drop for VehicleLink {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = self.session.close().wait();
    }
}

fn answer_all(
    questions: &Queryable<RingChannelHandler<Query>>,
    answer: impl Fn(&[u8]) -> Option<Vec<u8>>,
    ending: &AtomicBool,
    sent: &AtomicU64,
) {
    while !ending.load(Ordering::Relaxed) {
        let query = match questions.recv_timeout(LOOK) {
            Ok(Some(query)) => query,
            Ok(None) => continue,
            Err(_) => return,
        };
        let question = query.payload().map(|payload| payload.to_bytes().into_owned()).unwrap_or_default();
        let Some(bytes) = answer(&question) else { continue };
        let length = bytes.len() as u64;
        match query.reply(query.key_expr().clone(), bytes).wait() {
            Ok(()) => drop(sent.fetch_add(length, Ordering::Relaxed)),
            Err(error) => tracing::debug!(%error, "an answer was not sent"),
        }
    }
}

/// A station's end of all links.
pub struct StationLink {
    session: Session,
    events: SyncSender<Event>,
    lost: Arc<AtomicU64>,
    _news: Subscriber<()>,
}

impl StationLink {
    /// Listens. What comes goes into `events`; where that is full it is dropped and counted.
    pub fn open(listen: &[String], vehicles_max: usize, events: SyncSender<Event>) -> Result<Self, LinkError> {
        // Two connections a vehicle: a lost one is known as lost only some seconds after the new one is made.
        let session = session(listen, &[], 2 * vehicles_max, 500_000)?;
        let lost = Arc::new(AtomicU64::new(0));
        let (to, count) = (events.clone(), Arc::clone(&lost));
        let news = session.declare_subscriber("tsense/*/news").callback(move |sample| {
            let bytes = sample.payload().to_bytes().into_owned();
            push(&to, &count, Event::News(vehicle_of(sample.key_expr().as_str()), bytes));
        });
        Ok(Self { _news: news.wait()?, session, events, lost })
    }

    /// Asks a vehicle; the answer is an event, if one comes.
    pub fn ask(&self, vehicle: &VehicleName, question: Vec<u8>) {
        let (to, count, name) = (self.events.clone(), Arc::clone(&self.lost), vehicle.to_string());
        let get = self.session.get(format!("tsense/{vehicle}/ask")).payload(question).timeout(ANSWER);
        let asked = get.callback(move |reply| {
            if let Ok(sample) = reply.result() {
                push(&to, &count, Event::Answer(name.clone(), sample.payload().to_bytes().into_owned()));
            }
        });
        if let Err(error) = asked.wait() {
            tracing::debug!(%error, %vehicle, "a question was not sent");
        }
    }

    /// Events for which there was no room.
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

/// `tsense/NAME/...`: the name.
fn vehicle_of(key: &str) -> String {
    key.split('/').nth(1).unwrap_or_default().to_owned()
}

fn push(to: &SyncSender<Event>, lost: &AtomicU64, event: Event) {
    if to.try_send(event).is_err() {
        lost.fetch_add(1, Ordering::Relaxed);
    }
}
