//! Events of one component: who wants which report how often. AS5710 Events.
//!
//! In: requests and the time. Out: confirmations, and which events are due. An event ends when its owner cancels it or
//! does not keep it; their number, their queries and their rates are bounded.

use tsense_geometry::Timestamp;
use tsense_jaus::message::events::{
    ConfirmEventRequest, CreateEvent, EVERY_CHANGE, EventRecord, INVALID_ID, INVALID_SETUP, PERIODIC, QueryEvents,
    REFUSED, RejectEventRequest, ReportEvents, UNSUPPORTED, UpdateEvent, Words,
};
use tsense_jaus::message::scaled::EventRate;
use tsense_jaus::{Id, Message, code_of};

/// Events of a component: every product to each of a dozen consumers. Their queries are at most 16 KB together.
const EVENTS_MAX: usize = 64;
/// Events of one owner.
const EVENTS_OF_ONE_MAX: usize = 16;
/// Longest query: a list of sensors or of objects.
const QUERY_BYTES_MAX: usize = 256;

/// The bounds that the configuration sets.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Highest rate, hertz.
    pub rate_max_hz: f64,
    /// Minutes after which an event ends that nobody keeps; 0 never.
    pub timeout_min: u8,
}

#[derive(Clone, Debug)]
struct Entry {
    owner: Id,
    event: u8,
    kind: u8,
    rate_hz: f64,
    query: Vec<u8>,
    sequence: u8,
    due: Timestamp,
    seen: Option<u64>,
    kept: Timestamp,
}

/// All events of a component.
#[derive(Debug)]
pub struct Events {
    limits: Limits,
    entries: Vec<Entry>,
}

/// An event whose report is to be sent.
#[derive(Clone, Debug, PartialEq)]
pub struct Due {
    /// Who gets it.
    pub owner: Id,
    /// Its number.
    pub event: u8,
    /// Its query.
    pub query: Vec<u8>,
}

impl Events {
    /// No events.
    pub fn new(limits: Limits) -> Self {
        Self { limits, entries: Vec::new() }
    }

    /// Makes an event. Asking again for the same is keeping it. `check` says why a query is none of ours.
    pub fn create(
        &mut self,
        owner: Id,
        ask: &CreateEvent,
        now: Timestamp,
        check: impl Fn(&[u8]) -> Result<(), u8>,
    ) -> Vec<u8> {
        let same = |e: &&Entry| e.owner == owner && e.kind == ask.kind && e.query == ask.query;
        let event = match self.entries.iter().find(same) {
            Some(entry) => Ok(entry.event),
            None => self.free_number(owner),
        };
        let made = event.and_then(|event| self.set(owner, event, ask, now, check));
        answer(ask.request, made)
    }

    /// Changes or keeps an event.
    pub fn update(
        &mut self,
        owner: Id,
        ask: &UpdateEvent,
        now: Timestamp,
        check: impl Fn(&[u8]) -> Result<(), u8>,
    ) -> Vec<u8> {
        let UpdateEvent { request, kind, rate, event, query } = ask.clone();
        let known = self.entries.iter().any(|e| e.owner == owner && e.event == event);
        let ask = CreateEvent { request, kind, rate, query };
        answer(request, if known { self.set(owner, event, &ask, now, check) } else { Err(INVALID_ID) })
    }

    /// Ends an event.
    pub fn cancel(&mut self, owner: Id, request: u8, event: u8) -> Vec<u8> {
        let before = self.entries.len();
        self.entries.retain(|e| (e.owner, e.event) != (owner, event));
        let ended = self.entries.len() != before;
        answer(request, if ended { Ok((event, 0.0)) } else { Err(INVALID_ID) })
    }

    fn free_number(&self, owner: Id) -> Result<u8, u8> {
        let of_owner = self.entries.iter().filter(|e| e.owner == owner).count();
        if of_owner >= EVENTS_OF_ONE_MAX || self.entries.len() >= EVENTS_MAX {
            return Err(REFUSED);
        }
        (1..=u8::MAX).find(|number| self.entries.iter().all(|e| e.event != *number)).ok_or(REFUSED)
    }

    fn set(
        &mut self,
        owner: Id,
        event: u8,
        ask: &CreateEvent,
        now: Timestamp,
        check: impl Fn(&[u8]) -> Result<(), u8>,
    ) -> Result<(u8, f64), u8> {
        let periodic = ask.kind == PERIODIC;
        if ask.query.len() > QUERY_BYTES_MAX
            || !(periodic || ask.kind == EVERY_CHANGE)
            || (periodic && ask.rate.0 <= 0.0)
        {
            return Err(INVALID_SETUP);
        }
        check(&ask.query)?;
        let rate_hz = if periodic { ask.rate.0.min(self.limits.rate_max_hz) } else { self.limits.rate_max_hz };
        let (kind, query) = (ask.kind, ask.query.clone());
        match self.entries.iter_mut().find(|e| e.event == event) {
            Some(entry) if entry.query == query => {
                (entry.kind, entry.rate_hz, entry.kept) = (kind, rate_hz, now);
                // A slower rate of before does not delay the first report of a faster one.
                entry.due = entry.due.min(now.plus_seconds(1.0 / rate_hz));
            }
            Some(entry) => {
                *entry = Entry { kind, rate_hz, query, due: now, seen: None, kept: now, ..entry.clone() };
            }
            None => {
                let new = Entry { owner, event, kind, rate_hz, query, sequence: 0, due: now, seen: None, kept: now };
                self.entries.push(new);
            }
        }
        Ok((event, if periodic { rate_hz } else { 0.0 }))
    }

    /// Events that nobody kept end; returns how many.
    pub fn expire(&mut self, now: Timestamp) -> u64 {
        let patience_s = f64::from(self.limits.timeout_min) * 60.0;
        let before = self.entries.len();
        self.entries.retain(|e| patience_s == 0.0 || now.seconds_since(e.kept) <= patience_s);
        (before - self.entries.len()) as u64
    }

    /// Events that are due. `generation` counts the changes of what a query asks for.
    pub fn due(&mut self, now: Timestamp, generation: impl Fn(&[u8]) -> u64) -> Vec<Due> {
        let mut due = Vec::new();
        for entry in self.entries.iter_mut().filter(|e| e.due <= now) {
            let generation = generation(&entry.query);
            if entry.kind == EVERY_CHANGE && entry.seen.unwrap_or(0) == generation {
                continue;
            }
            entry.seen = Some(generation);
            // On the beat; a beat that was slept through is not made up for.
            let period_s = 1.0 / entry.rate_hz;
            let next = entry.due.plus_seconds(period_s);
            entry.due = if next > now { next } else { now.plus_seconds(period_s) };
            due.push(Due { owner: entry.owner, event: entry.event, query: entry.query.clone() });
        }
        due
    }

    /// The number of an event's next report.
    pub fn next_sequence(&mut self, event: u8) -> u8 {
        let Some(entry) = self.entries.iter_mut().find(|e| e.event == event) else { return 0 };
        let sequence = entry.sequence;
        entry.sequence = sequence.wrapping_add(1);
        sequence
    }

    /// The events that are asked for.
    pub fn list(&self, ask: QueryEvents) -> ReportEvents {
        let asked = |e: &&Entry| match ask {
            QueryEvents::Code(code) => code_of(&e.query) == Some(code),
            QueryEvents::Kind(kind) => e.kind == kind,
            QueryEvents::Event(event) => e.event == event,
            QueryEvents::All => true,
        };
        let record = |e: &Entry| EventRecord { kind: e.kind, event: e.event, query: e.query.clone() };
        ReportEvents { events: self.entries.iter().filter(asked).map(record).collect::<Vec<_>>().into() }
    }

    /// Minutes after which events end.
    pub fn timeout_min(&self) -> u8 {
        self.limits.timeout_min
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.entries.clear();
    }

    /// Who has events here, each once.
    pub fn owners(&self) -> Vec<Id> {
        let mut owners: Vec<Id> = self.entries.iter().map(|e| e.owner).collect();
        owners.sort();
        owners.dedup();
        owners
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

/// The answer to a request for an event that there is not.
pub fn unsupported(request: u8) -> Vec<u8> {
    answer(request, Err(UNSUPPORTED))
}

/// A confirmation, or a rejection with its code and words.
fn answer(request: u8, result: Result<(u8, f64), u8>) -> Vec<u8> {
    match result {
        Ok((event, rate_hz)) => ConfirmEventRequest { request, event, rate: EventRate(rate_hz) }.to_bytes(),
        Err(code) => {
            let words = match code {
                REFUSED => "too many events",
                INVALID_SETUP => "kind is 0 or 1, a periodic rate above 0, the query at most 256 bytes",
                INVALID_ID => "no such event of yours",
                _ => "no such query here, and no events of commands",
            };
            let words = Some(Words(words.into()));
            RejectEventRequest { request, response: Some(code), words }.to_bytes()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONSOLE: Id = Id::new(126, 1, 20);
    const PLANNER: Id = Id::new(126, 2, 30);

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + seconds)
    }

    fn events() -> Events {
        Events::new(Limits { rate_max_hz: 25.0, timeout_min: 1 })
    }

    fn ask(kind: u8, rate_hz: f64, query: &[u8]) -> CreateEvent {
        CreateEvent { request: 7, kind, rate: EventRate(rate_hz), query: query.to_vec() }
    }

    fn any(_: &[u8]) -> Result<(), u8> {
        Ok(())
    }

    fn confirmed(bytes: &[u8]) -> (u8, f64) {
        let confirm = ConfirmEventRequest::from_bytes(bytes).unwrap();
        (confirm.event, (confirm.rate.0 * 10.0).round() / 10.0)
    }

    fn rejected(bytes: &[u8]) -> u8 {
        RejectEventRequest::from_bytes(bytes).unwrap().response.unwrap()
    }

    #[test]
    fn a_periodic_event_comes_at_its_rate_and_not_faster_than_allowed() {
        let mut events = events();
        assert_eq!(confirmed(&events.create(CONSOLE, &ask(PERIODIC, 10.0, &[2, 0x24]), at(0.0), any)), (1, 10.0));
        assert_eq!(confirmed(&events.create(CONSOLE, &ask(PERIODIC, 1000.0, &[3, 0x24]), at(0.0), any)), (2, 25.0));
        let mut count = [0; 3];
        for step in 0..1000 {
            for due in events.due(at(f64::from(step) / 1000.0), |_| 0) {
                count[usize::from(due.event)] += 1;
                assert_eq!(events.next_sequence(due.event), count[usize::from(due.event)] - 1);
            }
        }
        assert_eq!(count, [0, 10, 25]);
        // After a sleep there is one report, not all that were missed.
        assert_eq!(events.due(at(30.0), |_| 0).len(), 2);
        assert_eq!(events.due(at(30.01), |_| 0).len(), 0);
    }

    #[test]
    fn an_event_on_change_comes_with_each_change_and_with_what_is_there_already() {
        let mut events = events();
        events.create(CONSOLE, &ask(EVERY_CHANGE, 0.0, &[1, 2]), at(0.0), any);
        assert_eq!(events.due(at(0.0), |_| 0).len(), 0, "nothing is there yet");
        assert_eq!(events.due(at(0.1), |_| 3).len(), 1);
        assert_eq!(events.due(at(0.2), |_| 3).len(), 0);
        assert_eq!(events.due(at(0.3), |_| 4).len(), 1);
        assert_eq!(events.due(at(0.31), |_| 5).len(), 0, "not faster than 25 a second");
        assert_eq!(events.due(at(0.35), |_| 5).len(), 1);
    }

    #[test]
    fn an_event_ends_when_nobody_keeps_it_and_asking_again_is_keeping() {
        let mut events = events();
        for seconds in [0.0, 50.0, 100.0] {
            assert_eq!(confirmed(&events.create(CONSOLE, &ask(PERIODIC, 1.0, &[1, 2]), at(seconds), any)).0, 1);
        }
        let keep = UpdateEvent { request: 1, kind: PERIODIC, rate: EventRate(5.0), event: 1, query: vec![1, 2] };
        assert_eq!(confirmed(&events.update(CONSOLE, &keep, at(150.0), any)), (1, 5.0));
        assert_eq!((events.expire(at(209.0)), events.expire(at(211.0)), events.len()), (0, 1, 0));
        assert_eq!(rejected(&events.update(CONSOLE, &keep, at(212.0), any)), INVALID_ID);
    }

    #[test]
    fn only_the_owner_changes_or_ends_an_event() {
        let mut events = events();
        events.create(CONSOLE, &ask(PERIODIC, 1.0, &[1, 2]), at(0.0), any);
        let steal = UpdateEvent { request: 1, kind: PERIODIC, rate: EventRate(5.0), event: 1, query: vec![9, 9] };
        assert_eq!(rejected(&events.update(PLANNER, &steal, at(0.0), any)), INVALID_ID);
        assert_eq!(rejected(&events.cancel(PLANNER, 1, 1)), INVALID_ID);
        assert_eq!(confirmed(&events.cancel(CONSOLE, 1, 1)), (1, 0.0));
        assert!(events.is_empty());
    }

    #[test]
    fn what_makes_no_sense_or_is_too_much_is_refused_with_its_reason() {
        let mut events = events();
        let mut create =
            |owner, ask: &CreateEvent, check: fn(&[u8]) -> Result<(), u8>| events.create(owner, ask, at(0.0), check);
        assert_eq!(rejected(&create(CONSOLE, &ask(2, 1.0, &[1, 2]), any)), INVALID_SETUP);
        assert_eq!(rejected(&create(CONSOLE, &ask(PERIODIC, 0.0, &[1, 2]), any)), INVALID_SETUP);
        assert_eq!(rejected(&create(CONSOLE, &ask(PERIODIC, 1.0, &[0; 257]), any)), INVALID_SETUP);
        assert_eq!(rejected(&create(CONSOLE, &ask(PERIODIC, 1.0, &[1, 2]), |_| Err(UNSUPPORTED))), UNSUPPORTED);
        let mut refused = 0;
        for i in 0..100_u8 {
            let owner = Id::new(1, 1, 1 + i / 20);
            let bytes = create(owner, &ask(PERIODIC, 1.0, &[i, 2]), any);
            refused += u32::from(RejectEventRequest::from_bytes(&bytes).is_ok_and(|r| r.response == Some(REFUSED)));
        }
        // Sixteen each of four owners, and none of the fifth.
        assert_eq!((refused, events.len(), events.owners().len()), (36, 64, 4));
        assert_eq!(events.list(QueryEvents::All).events.0.len(), 64);
        assert_eq!(events.list(QueryEvents::Event(3)).events.0.len(), 1);
        assert_eq!(events.list(QueryEvents::Kind(EVERY_CHANGE)).events.0.len(), 0);
    }
}
