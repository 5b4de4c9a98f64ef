//! One JAUS component: the core services, and the products behind them.
//!
//! In: a message, who sent it, the time. Out: messages to be sent, or the cause for which it was thrown away.

use super::access::{Access, Reply, Rules};
use super::config::Config;
use super::cost_map::Layer;
use super::discovery::{self, Card};
use super::events::{Events, Limits, unsupported};
use super::products::{Products, Refusal};
use tsense_geometry::Timestamp;
use tsense_jaus::message::core::{
    self, ReportAuthority, ReportHeartbeatPulse, ReportStatus, ReportTime, ReportTimeout,
};
use tsense_jaus::message::discovery::{
    QueryConfiguration, QueryIdentification, QueryServiceList, QueryServices, QuerySubsystemList, RegisterServices,
    ReportSubsystemList, SubsystemRecord,
};
use tsense_jaus::message::events::{
    self, CancelEvent, CreateCommandEvent, CreateEvent, Event, QueryEventTimeout, QueryEvents, ReportEventTimeout,
    UpdateEvent,
};
use tsense_jaus::message::range::SetRangeSensorConfiguration;
use tsense_jaus::{Id, Malformed, Message, code_of, date_stamp, time_stamp};

/// First code of reports: what peers tell us without being asked, such as their heartbeats.
const FIRST_INFORM: u16 = 0x4000;

/// What a component needs of its surroundings to answer.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// The configuration.
    pub config: &'a Config,
    /// All our components.
    pub cards: &'a [Card],
    /// What is served.
    pub products: &'a Products,
    /// The instant.
    pub now: Timestamp,
}

/// A component.
pub struct Component {
    /// Who it is.
    pub id: Id,
    layer: Layer,
    access: Access,
    events: Events,
}

impl Component {
    /// A component whose cost map shows this layer. The one with traversability serves everything else as well.
    pub fn new(id: Id, layer: Layer, config: &Config) -> Self {
        let rules =
            Rules { allowed: config.allow_control, authority: config.authority, timeout_s: config.control_timeout_s };
        let limits = Limits { rate_max_hz: config.event_rate_max_hz, timeout_min: config.event_timeout_min };
        Self { id, layer, access: Access::new(rules), events: Events::new(limits) }
    }

    /// Takes a message.
    pub fn take(&mut self, from: Id, body: &[u8], around: Surroundings<'_>) -> Result<Vec<Reply>, &'static str> {
        let cut = |fault: Malformed| fault.as_str();
        let now = around.now;
        let code = code_of(body).ok_or(Malformed::Truncated.as_str())?;
        let reply = match code {
            core::RequestControl::CODE => {
                let authority = core::RequestControl::from_bytes(body).map_err(cut)?.authority;
                return Ok(self.access.request(from, authority, now));
            }
            core::ReleaseControl::CODE => return Ok(vec![self.access.release(from)]),
            core::SetAuthority::CODE..=core::ClearEmergency::CODE => return self.command(from, code, body),
            core::SetTime::CODE => return Err("the clock is not set over jaus"),
            RegisterServices::CODE => return Err("no registry of services here"),
            CreateEvent::CODE => self.create(from, &CreateEvent::from_bytes(body).map_err(cut)?, around),
            UpdateEvent::CODE => self.update(from, &UpdateEvent::from_bytes(body).map_err(cut)?, around),
            CancelEvent::CODE => {
                let cancel = CancelEvent::from_bytes(body).map_err(cut)?;
                self.events.cancel(from, cancel.request, cancel.event)
            }
            SetRangeSensorConfiguration::CODE if self.layer == Layer::Traversability => {
                around.products.set_ranges(body).map_err(cut)?
            }
            CreateCommandEvent::CODE => unsupported(CreateCommandEvent::from_bytes(body).map_err(cut)?.request),
            FIRST_INFORM..=0x5FFF => return Ok(Vec::new()),
            _ => match self.report(body, around) {
                Ok(Some(report)) => report,
                Ok(None) => return Ok(Vec::new()),
                Err(refusal) => return Err(refusal.as_str()),
            },
        };
        Ok(vec![(from, reply)])
    }

    fn command(&mut self, from: Id, code: u16, body: &[u8]) -> Result<Vec<Reply>, &'static str> {
        self.access.command(from, code, body)?;
        if matches!(code, core::Shutdown::CODE | core::Reset::CODE) {
            self.events.clear();
        }
        Ok(Vec::new())
    }

    fn create(&mut self, from: Id, ask: &CreateEvent, around: Surroundings<'_>) -> Vec<u8> {
        let check = self.check(&ask.query, around);
        self.events.create(from, ask, around.now, |_| check)
    }

    fn update(&mut self, from: Id, ask: &UpdateEvent, around: Surroundings<'_>) -> Vec<u8> {
        let check = self.check(&ask.query, around);
        self.events.update(from, ask, around.now, |_| check)
    }

    /// Whether a query can be answered here, sooner or later.
    fn check(&self, query: &[u8], around: Surroundings<'_>) -> Result<(), u8> {
        match self.report(query, around) {
            Ok(Some(_)) | Err(Refusal::Nothing) => Ok(()),
            Ok(None) | Err(Refusal::Unsupported) => Err(events::UNSUPPORTED),
            Err(Refusal::Malformed(_)) => Err(events::INVALID_SETUP),
        }
    }

    /// The report that answers a query; none where somebody else speaks for what is asked.
    fn report(&self, query: &[u8], around: Surroundings<'_>) -> Result<Option<Vec<u8>>, Refusal> {
        let code = code_of(query).ok_or(Malformed::Truncated)?;
        // Queries without fields have nothing behind their code.
        let bare = || if query.len() == 2 { Ok(()) } else { Err(Malformed::Trailing) };
        let report = match code {
            core::QueryHeartbeatPulse::CODE => bare().map(|()| ReportHeartbeatPulse {}.to_bytes())?,
            core::QueryStatus::CODE => {
                bare().map(|()| ReportStatus { status: self.access.status(), reserved: 0 }.to_bytes())?
            }
            core::QueryControl::CODE => bare().map(|()| self.access.report().to_bytes())?,
            core::QueryAuthority::CODE => {
                bare().map(|()| ReportAuthority { authority: self.access.authority() }.to_bytes())?
            }
            core::QueryTimeout::CODE => {
                bare().map(|()| ReportTimeout { timeout_s: self.access.timeout_s() }.to_bytes())?
            }
            core::QueryTime::CODE => time(core::QueryTime::from_bytes(query)?.wanted, around.now),
            QueryEvents::CODE => self.events.list(QueryEvents::from_bytes(query)?).to_bytes(),
            QueryEventTimeout::CODE => {
                bare().map(|()| ReportEventTimeout { timeout_min: self.events.timeout_min() }.to_bytes())?
            }
            0x2B00..=0x2BFF if self.layer == Layer::Traversability => return discover(code, query, around),
            _ if !self.access.serves() && around.products.generation(code).is_some() => return Err(Refusal::Nothing),
            _ => around.products.report(self.layer, query)?,
        };
        Ok(Some(report))
    }

    /// Reports that are due, control that ends, events that nobody keeps; with what to count for the latter two.
    pub fn tick(&mut self, around: Surroundings<'_>) -> (Vec<Reply>, u64) {
        let mut out: Vec<Reply> = self.access.tick(around.now).into_iter().collect();
        let ended = self.events.expire(around.now);
        let changes = self.access.changes() + 1;
        let generation = |query: &[u8]| {
            let code = code_of(query).unwrap_or_default();
            around.products.generation(code).unwrap_or(changes)
        };
        for due in self.events.due(around.now, generation) {
            if let Ok(Some(report)) = self.report(&due.query, around) {
                let sequence = self.events.next_sequence(due.event);
                out.push((due.owner, Event { event: due.event, sequence, report }.to_bytes()));
            }
        }
        (out, ended)
    }

    /// Who gets a heartbeat: who controls, and who has events here.
    pub fn listeners(&self) -> Vec<Id> {
        let mut listeners = self.events.owners();
        listeners.extend(self.access.controller().filter(|id| !listeners.contains(id)));
        listeners
    }

    /// How many events there are.
    pub fn events(&self) -> usize {
        self.events.len()
    }

    /// Who controls.
    pub fn controller(&self) -> Option<Id> {
        self.access.controller()
    }
}

/// The time on the graph's clock, which is UTC.
fn time(wanted: u8, now: Timestamp) -> Vec<u8> {
    let has = |bit: u8| wanted & bit != 0;
    let (time, date) = (has(1).then(|| time_stamp(now.ns)), has(2).then(|| date_stamp(now.ns)));
    ReportTime { time, date }.to_bytes()
}

fn discover(code: u16, query: &[u8], around: Surroundings<'_>) -> Result<Option<Vec<u8>>, Refusal> {
    let Surroundings { config, cards, .. } = around;
    Ok(match code {
        QueryIdentification::CODE => {
            let kind = QueryIdentification::from_bytes(query)?.kind;
            discovery::identification(config, kind).map(|report| report.to_bytes())
        }
        QueryConfiguration::CODE => {
            QueryConfiguration::from_bytes(query)?;
            Some(discovery::configuration(cards).to_bytes())
        }
        QuerySubsystemList::CODE => {
            QuerySubsystemList::from_bytes(query)?;
            let id = config.main_id();
            let us = SubsystemRecord { subsystem: id.subsystem(), node: id.node(), component: id.component() };
            Some(ReportSubsystemList { subsystems: vec![us].into() }.to_bytes())
        }
        QueryServices::CODE => Some(discovery::services(cards, &QueryServices::from_bytes(query)?.nodes.0).to_bytes()),
        QueryServiceList::CODE => {
            Some(discovery::service_list(cards, &QueryServiceList::from_bytes(query)?).to_bytes())
        }
        _ => return Err(Refusal::Unsupported),
    })
}
