//! The vehicle's side of the link: what it has, and the answers to what a station asks. Pure: bytes in, bytes out.
//!
//! It keeps nothing about any station: who asks says how far he has got. A question that is malformed gets no answer
//! and is counted.

use super::blocks::Blocks;
use super::log::ChangeLog;
use super::objects::Objects;
use tsense_contract::{
    FLEET_PAGE_MAX, FleetAsk, FleetBlock, FleetBlockAsk, FleetFault, FleetList, FleetNews, FleetObject, FleetPage,
    Message, Object, fleet_decode, fleet_encode,
};
use tsense_geometry::Timestamp;

/// What a vehicle tells.
#[derive(Clone, Debug)]
pub struct Vehicle {
    /// Its objects.
    pub objects: Objects,
    /// Its blocks.
    pub blocks: Blocks,
}

/// What a question gets.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// These bytes.
    Page(Vec<u8>),
    /// The file of this block, under this number of a question; the shell reads it.
    File(u64, FleetBlock),
    /// Nothing yet: not all objects are known.
    Later,
}

impl Vehicle {
    /// One that has nothing yet. `epoch` is greater than that of any life of this vehicle before.
    pub fn new(epoch: u64) -> Self {
        Self { objects: Objects::new(epoch), blocks: Blocks::new(epoch) }
    }

    /// How far the lists go.
    pub fn news(&self, now: Timestamp) -> Vec<u8> {
        let (objects, blocks) = (self.objects.log(), self.blocks.log());
        let news = FleetNews {
            stamp_ns: now.ns,
            objects: if self.objects.is_complete() { [objects.epoch(), objects.head()] } else { [0; 2] },
            blocks: [blocks.epoch(), blocks.head()],
        };
        fleet_encode(&news, &[])
    }

    /// Answers a question.
    pub fn answer(&self, question: &[u8], now: Timestamp) -> Result<Answer, FleetFault> {
        match fleet_decode::<FleetAsk>(question) {
            Ok((ask, [])) => self.page(&ask, now),
            Ok(_) => Err(FleetFault::Length),
            Err(FleetFault::Version | FleetFault::Length) => self.file(question),
            Err(fault) => Err(fault),
        }
    }

    fn page(&self, ask: &FleetAsk, now: Timestamp) -> Result<Answer, FleetFault> {
        match FleetList::from_wire(ask.list) {
            FleetList::Objects if !self.objects.is_complete() => Ok(Answer::Later),
            FleetList::Objects => Ok(Answer::Page(page(self.objects.log(), ask, self.objects.zone(), now, told))),
            FleetList::Blocks => {
                let numbered = |number, _: &_, block: Option<&FleetBlock>| FleetBlock {
                    number,
                    ..block.copied().unwrap_or(bytemuck::Zeroable::zeroed())
                };
                Ok(Answer::Page(page(self.blocks.log(), ask, (0, 0), now, numbered)))
            }
            FleetList::Unknown => Err(FleetFault::Version),
        }
    }

    fn file(&self, question: &[u8]) -> Result<Answer, FleetFault> {
        let (ask, rest) = fleet_decode::<FleetBlockAsk>(question)?;
        match self.blocks.log().get(&ask.block.place()) {
            _ if !rest.is_empty() => Err(FleetFault::Length),
            Some(block) => Ok(Answer::File(ask.ask, *block)),
            // It made room for others since it was listed.
            None => Ok(Answer::File(ask.ask, FleetBlock { bytes: 0, crc: 0, ..ask.block })),
        }
    }
}

/// An object that is there, or the id of one that is gone.
fn told(number: u64, id: &u64, object: Option<&FleetObject>) -> FleetObject {
    let gone = || FleetObject { object: Object { id: *id, ..bytemuck::Zeroable::zeroed() }, ..zeroed() };
    FleetObject { number, ..object.copied().unwrap_or_else(gone) }
}

fn zeroed<M: Message>() -> M {
    bytemuck::Zeroable::zeroed()
}

/// The part of a log that follows a cursor.
fn page<K: Clone + Ord, V, I: Message>(
    log: &ChangeLog<K, V>,
    ask: &FleetAsk,
    (zone, south): (u8, u8),
    now: Timestamp,
    item: impl Fn(u64, &K, Option<&V>) -> I,
) -> Vec<u8> {
    let after = if ask.epoch == log.epoch() && ask.after <= log.head() { ask.after } else { 0 };
    let limit = ask.limit.clamp(1, FLEET_PAGE_MAX) as usize;
    let items: Vec<I> = log.after(after, limit).map(|(number, key, value)| item(number, key, value)).collect();
    let is_end = items.len() < limit;
    let last = if is_end { log.head() } else { log.after(after, limit).last().map_or(after, |(number, ..)| number) };
    let header = FleetPage {
        ask: ask.ask,
        epoch: log.epoch(),
        after,
        last,
        head: log.head(),
        stamp_ns: now.ns,
        count: items.len() as u32,
        list: ask.list,
        zone,
        south,
        reserved: 0,
    };
    fleet_encode(&header, bytemuck::cast_slice(&items))
}
