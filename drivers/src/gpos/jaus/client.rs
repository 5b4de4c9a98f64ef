//! From nothing to a stream of poses: who is there, what can they do, a pose so many times a second, please.
//!
//! In: datagrams and the time. Out: datagrams, and reports of the one sensor that was chosen. It keeps its event alive
//! and begins anew when the sensor falls silent. What others say is counted and changes nothing.

use super::config::Config;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use tsense_geometry::Timestamp;
use tsense_jaus::message::discovery::{
    NodeQuery, QueryIdentification, QueryServices, ReportIdentification, ReportServices, SUBSYSTEM,
};
use tsense_jaus::message::events::{
    CancelEvent, ConfirmEventRequest, CreateEvent, EVERY_CHANGE, Event, NO_PERIODIC, PERIODIC, RejectEventRequest,
    UpdateEvent,
};
use tsense_jaus::message::pose::{QueryGlobalPose, ReportGlobalPose};
use tsense_jaus::message::scaled::EventRate;
use tsense_jaus::transport::Options;
use tsense_jaus::{Envelope, Id, Message, Received, Transport, code_of, judp};

/// What a sensor says it can do.
const SERVICE: &str = "urn:jaus:jss:mobility:GlobalPoseSensor";
/// All fields of the pose.
const ALL_FIELDS: u16 = 0x1FF;
/// Time between two questions who is there, seconds: the standard's slowest.
const SEARCH_PERIOD_S: f64 = 5.0;
/// Time between two requests for the event, seconds.
const ASK_PERIOD_S: f64 = 1.0;
/// Requests without an answer before the search begins anew.
const ASK_MAX: u32 = 3;
/// Silence after which a sensor is looked for anew, seconds.
const SILENT_S: f64 = 3.0;
/// Time between two signs that the event is still wanted, seconds: events end after a minute by default.
const KEEP_PERIOD_S: f64 = 20.0;

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Nobody is known.
    Searching,
    /// This sensor was asked so many times.
    Asking(Id, u32),
    /// This sensor sends this event; the instants of its last report and of our last sign.
    Receiving { sensor: Id, event: u8, heard: Timestamp, kept: Timestamp },
    /// This sensor gives no events and is asked for every pose; the instant of its last report.
    Polling { sensor: Id, heard: Timestamp },
}

/// A client of a GlobalPoseSensor.
pub struct Client {
    own: Id,
    /// The sensor of the configuration.
    fixed: Option<Id>,
    rate_hz: f64,
    transport: Transport,
    state: State,
    kind: u8,
    next_at: Timestamp,
    poses: Vec<ReportGlobalPose>,
}

impl Client {
    /// A client that knows nobody. `first_sequence` should differ from start to start.
    pub fn new(config: &Config, first_sequence: u16) -> Self {
        let own = config.id.parse().unwrap_or(Id::new(1, 1, 40));
        let options = Options {
            own: vec![own],
            allowed: config.peers.iter().filter_map(|peer| peer.parse().ok()).collect(),
            group: config.multicast.then(|| SocketAddr::from((judp::GROUP, judp::PORT))),
            contacts: config.contacts.iter().filter_map(|contact| contact.parse().ok()).collect(),
            first_sequence,
        };
        let fixed = config.sensor.parse().ok();
        let mut client = Self {
            own,
            fixed,
            rate_hz: config.rate_hz,
            transport: Transport::new(options),
            state: State::Searching,
            kind: PERIODIC,
            next_at: Timestamp::default(),
            poses: Vec::new(),
        };
        client.search();
        client
    }

    fn search(&mut self) {
        self.state = self.fixed.map_or(State::Searching, |sensor| State::Asking(sensor, 0));
        self.next_at = Timestamp::default();
    }

    /// Takes a datagram; reports of the sensor that come with it.
    pub fn receive(&mut self, now: Timestamp, from: SocketAddr, datagram: &[u8]) -> Vec<ReportGlobalPose> {
        self.transport.receive(now, from, datagram);
        while let Some(message) = self.transport.next_message() {
            if let Err(cause) = self.take(now, &message) {
                self.transport.dropped(cause, 1);
            }
        }
        std::mem::take(&mut self.poses)
    }

    fn take(&mut self, now: Timestamp, message: &Received) -> Result<(), &'static str> {
        let Received { source, body, .. } = message;
        let cut = |fault: tsense_jaus::Malformed| fault.as_str();
        match code_of(body) {
            Some(ReportIdentification::CODE) if self.state == State::Searching => self.ask_services(now, *source),
            Some(ReportServices::CODE) if self.state == State::Searching => {
                self.choose(*source, &ReportServices::from_bytes(body).map_err(cut)?);
            }
            Some(ConfirmEventRequest::CODE) => {
                self.confirmed(now, *source, &ConfirmEventRequest::from_bytes(body).map_err(cut)?);
            }
            Some(RejectEventRequest::CODE) => {
                self.rejected(now, *source, &RejectEventRequest::from_bytes(body).map_err(cut)?);
            }
            Some(Event::CODE) => return self.event(now, *source, &Event::from_bytes(body).map_err(cut)?),
            Some(ReportGlobalPose::CODE) => {
                return self.report(now, *source, ReportGlobalPose::from_bytes(body).map_err(cut)?);
            }
            // Heartbeats, and answers that came too late.
            _ => {}
        }
        Ok(())
    }

    fn ask_services(&mut self, now: Timestamp, who: Id) {
        let everything = NodeQuery { node: u8::MAX, components: vec![u8::MAX].into() };
        self.send(now, who, &QueryServices { nodes: vec![everything].into() });
    }

    fn choose(&mut self, discovery: Id, report: &ReportServices) {
        let sensors = report.nodes.0.iter().flat_map(|node| {
            let has =
                |services: &[_]| services.iter().any(|s: &tsense_jaus::message::discovery::Service| s.uri == SERVICE);
            let components = node.components.0.iter().filter(move |c| has(&c.services.0));
            components.map(|c| Id::new(discovery.subsystem(), node.node, c.component))
        });
        if let Some(sensor) = sensors.filter(|id| id.is_one()).min() {
            self.state = State::Asking(sensor, 0);
            self.next_at = Timestamp::default();
        }
    }

    fn confirmed(&mut self, now: Timestamp, source: Id, confirm: &ConfirmEventRequest) {
        if matches!(self.state, State::Asking(sensor, _) if sensor == source) {
            self.state = State::Receiving { sensor: source, event: confirm.event, heard: now, kept: now };
        }
    }

    /// Without periodic events we take those on change; without either every pose is asked for.
    fn rejected(&mut self, now: Timestamp, source: Id, reject: &RejectEventRequest) {
        match self.state {
            State::Asking(sensor, _) if sensor == source => {
                if self.kind == PERIODIC && reject.response == Some(NO_PERIODIC) {
                    self.kind = EVERY_CHANGE;
                } else {
                    self.state = State::Polling { sensor, heard: now };
                }
                self.next_at = Timestamp::default();
            }
            // The event that we kept is no more: it is asked for anew.
            State::Receiving { sensor, .. } if sensor == source => {
                self.state = State::Asking(sensor, 0);
                self.next_at = Timestamp::default();
            }
            _ => {}
        }
    }

    fn event(&mut self, now: Timestamp, source: Id, event: &Event) -> Result<(), &'static str> {
        match self.state {
            State::Receiving { sensor, event: number, .. } if (sensor, number) == (source, event.event) => {
                self.report(now, source, ReportGlobalPose::from_bytes(&event.report).map_err(|f| f.as_str())?)
            }
            _ => Err("event that was not asked for"),
        }
    }

    fn report(&mut self, now: Timestamp, source: Id, pose: ReportGlobalPose) -> Result<(), &'static str> {
        match &mut self.state {
            State::Receiving { sensor, heard, .. } | State::Polling { sensor, heard } if *sensor == source => {
                *heard = now;
                self.poses.push(pose);
                Ok(())
            }
            _ => Err("pose that was not asked for"),
        }
    }

    /// Asks, keeps and begins anew; call it as often as poses are wanted, at least.
    pub fn tick(&mut self, now: Timestamp) {
        match self.state {
            State::Receiving { heard, .. } | State::Polling { heard, .. } if now.seconds_since(heard) > SILENT_S => {
                self.kind = PERIODIC;
                self.search();
            }
            State::Receiving { sensor, event, kept, .. } if now.seconds_since(kept) > KEEP_PERIOD_S => {
                self.keep(now, sensor, event);
            }
            _ => {}
        }
        if now >= self.next_at {
            self.ask(now);
        }
        self.transport.tick(now);
    }

    fn ask(&mut self, now: Timestamp) {
        let wait_s = match self.state {
            State::Searching => {
                self.send(now, Id::ALL, &QueryIdentification { kind: SUBSYSTEM });
                SEARCH_PERIOD_S
            }
            State::Asking(_, ASK_MAX..) => return self.search(),
            State::Asking(sensor, times) => {
                self.state = State::Asking(sensor, times + 1);
                let (kind, rate) = (self.kind, EventRate(self.rate_hz));
                let query = QueryGlobalPose { wanted: ALL_FIELDS }.to_bytes();
                self.send(now, sensor, &CreateEvent { request: 1, kind, rate, query });
                ASK_PERIOD_S
            }
            State::Receiving { .. } => return,
            State::Polling { sensor, .. } => {
                self.send(now, sensor, &QueryGlobalPose { wanted: ALL_FIELDS });
                1.0 / self.rate_hz
            }
        };
        self.next_at = now.plus_seconds(wait_s);
    }

    fn keep(&mut self, now: Timestamp, sensor: Id, number: u8) {
        if let State::Receiving { kept, .. } = &mut self.state {
            *kept = now;
        }
        let (kind, rate) = (self.kind, EventRate(self.rate_hz));
        let query = QueryGlobalPose { wanted: ALL_FIELDS }.to_bytes();
        self.send(now, sensor, &UpdateEvent { request: 2, kind, rate, event: number, query });
    }

    /// Says goodbye: the sensor need not send any more.
    pub fn stop(&mut self, now: Timestamp) {
        if let State::Receiving { sensor, event, .. } = self.state {
            self.send(now, sensor, &CancelEvent { request: 3, event });
        }
        self.search();
    }

    fn send(&mut self, now: Timestamp, destination: Id, message: &impl Message) {
        let body = message.to_bytes();
        self.transport.send(now, &Envelope { source: self.own, destination, acknowledged: false, body });
    }

    /// The next datagram and where it goes.
    pub fn next_datagram(&mut self) -> Option<(SocketAddr, Vec<u8>)> {
        self.transport.next_datagram()
    }

    /// The sensor whose poses come, or why there are none.
    pub fn sensor(&self) -> Result<Id, String> {
        match self.state {
            State::Searching => Err("looking for a GlobalPoseSensor".into()),
            State::Asking(sensor, _) => Err(format!("asking {sensor} for poses")),
            State::Receiving { sensor, .. } | State::Polling { sensor, .. } => Ok(sensor),
        }
    }

    /// What was thrown away so far, by cause.
    pub fn drops(&self) -> &BTreeMap<&'static str, u64> {
        self.transport.drops()
    }
}

#[cfg(test)]
#[path = "client_tests.rs"]
mod tests;
