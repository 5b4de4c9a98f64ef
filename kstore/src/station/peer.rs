//! The station's end of the link to one vehicle: what to ask next, and which answers to believe. Pure: bytes and time.
//!
//! One question of each list is open at a time, and only the answer that repeats its number counts; so answers that are
//! late, repeated or out of order change nothing. What is lost is asked again. The cursor is not moved here but by the
//! caller, once what the page holds is on disk.

use tsense_contract::{
    FLEET_PAGE_MAX, FleetAsk, FleetFault, FleetList, FleetNews, FleetPage, fleet_decode, fleet_encode,
};
use tsense_geometry::Timestamp;

/// An answer that did not come within this is asked for again, seconds: a page of 98 kB takes 4 s at 200 kbit/s.
pub const ANSWER_S: f64 = 5.0;
/// Without news a list is asked for at least this often, seconds.
const PERIOD_S: f64 = 10.0;
/// A vehicle that was not heard for this long is called away, seconds: it says something every second.
const AWAY_S: f64 = 5.0;

/// How far a list was read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cursor {
    /// Epoch of the vehicle's list; 0 before the first page.
    pub epoch: u64,
    /// Number of the newest change that the station has.
    pub after: u64,
    /// Whether this epoch was read to its end once.
    pub listed: bool,
}

/// Why an answer was not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refusal {
    /// It is no message.
    Bytes(FleetFault),
    /// Nobody asked that, or it was answered already.
    Unasked,
    /// It does not follow the cursor, or contradicts itself.
    Senseless,
}

impl Refusal {
    /// The reason for counters.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Bytes(fault) => fault.as_str(),
            Self::Unasked => "late, or repeated",
            Self::Senseless => "senseless page",
        }
    }
}

/// One list of one vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Reader {
    list: FleetList,
    cursor: Cursor,
    /// Epoch and newest number that the vehicle told last.
    told: Option<[u64; 2]>,
    open: Option<(u64, Timestamp)>,
    answered: Option<Timestamp>,
}

impl Reader {
    /// A list that was read this far.
    pub fn new(list: FleetList, cursor: Cursor) -> Self {
        Self { list, cursor, told: None, open: None, answered: None }
    }

    /// How far it was read.
    pub fn cursor(&self) -> Cursor {
        self.cursor
    }

    /// Changes that the vehicle has told of and the station does not have; nothing where that is not known.
    pub fn lag(&self) -> Option<u64> {
        let [epoch, head] = self.told?;
        if epoch == 0 {
            return None;
        }
        Some(if epoch == self.cursor.epoch { head.saturating_sub(self.cursor.after) } else { head })
    }

    /// The vehicle told how far the list goes.
    pub fn tell(&mut self, told: [u64; 2]) {
        self.told = Some(told);
    }

    /// A question, if it is time for one.
    pub fn question(&mut self, ask: u64, now: Timestamp) -> Option<Vec<u8>> {
        let within = |at: Timestamp, s: f64| (0.0..s).contains(&now.seconds_since(at));
        let is_open = self.open.is_some_and(|(_, at)| within(at, ANSWER_S));
        let is_news = self.told.is_some_and(|told| told != [self.cursor.epoch, self.cursor.after]);
        let is_old = !self.answered.is_some_and(|at| within(at, PERIOD_S));
        let is_ready = self.told.is_none_or(|[epoch, _]| epoch != 0);
        if is_open || !is_ready || !(is_news || is_old) {
            return None;
        }
        self.open = Some((ask, now));
        let Cursor { epoch, after, .. } = self.cursor;
        let list = self.list.to_wire();
        Some(fleet_encode(&FleetAsk { ask, epoch, after, limit: FLEET_PAGE_MAX, list, reserved: [0; 3] }, &[]))
    }

    /// Checks an answer; what it brings is the caller's, who moves the cursor to the one returned.
    pub fn check(&mut self, page: &FleetPage, now: Timestamp) -> Result<Cursor, Refusal> {
        if self.open.is_none_or(|(ask, _)| ask != page.ask) || page.list != self.list.to_wire() {
            return Err(Refusal::Unasked);
        }
        let Cursor { epoch, after, listed } = self.cursor;
        let goes_on = page.epoch == epoch && page.after == after;
        let starts = page.after == 0 && page.epoch != 0;
        if !(goes_on || starts) || page.last < page.after || page.last > page.head {
            return Err(Refusal::Senseless);
        }
        (self.open, self.answered) = (None, Some(now));
        self.told = Some([page.epoch, page.head]);
        let listed = (goes_on && listed) || page.last == page.head;
        Ok(Cursor { epoch: page.epoch, after: page.last, listed })
    }

    /// What the page held is on disk.
    pub fn advance(&mut self, cursor: Cursor) {
        self.cursor = cursor;
    }
}

/// A vehicle as the link knows it.
#[derive(Clone, Debug)]
pub struct Peer {
    /// Its objects.
    pub objects: Reader,
    /// Its blocks.
    pub blocks: Reader,
    /// The file of a block that was asked for: number of the question, and when.
    pub open_file: Option<(u64, Timestamp)>,
    heard: Option<Timestamp>,
}

impl Peer {
    /// A vehicle whose lists were read this far.
    pub fn new(objects: Cursor, blocks: Cursor) -> Self {
        Self {
            objects: Reader::new(FleetList::Objects, objects),
            blocks: Reader::new(FleetList::Blocks, blocks),
            open_file: None,
            heard: None,
        }
    }

    /// Whether it was heard lately.
    pub fn is_near(&self, now: Timestamp) -> bool {
        self.heard.is_some_and(|at| (0.0..AWAY_S).contains(&now.seconds_since(at)))
    }

    /// Something of it came.
    pub fn heard(&mut self, now: Timestamp) {
        self.heard = Some(now);
    }

    /// It says how far its lists go.
    pub fn tell(&mut self, news: &[u8], now: Timestamp) -> Result<(), Refusal> {
        let (news, rest) = fleet_decode::<FleetNews>(news).map_err(Refusal::Bytes)?;
        if !rest.is_empty() {
            return Err(Refusal::Bytes(FleetFault::Length));
        }
        self.heard(now);
        self.objects.tell(news.objects);
        self.blocks.tell(news.blocks);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::at;

    fn page(ask: u64, epoch: u64, after: u64, last: u64, head: u64) -> FleetPage {
        FleetPage {
            ask,
            epoch,
            after,
            last,
            head,
            stamp_ns: 0,
            count: 0,
            list: FleetList::Objects.to_wire(),
            zone: 17,
            south: 0,
            reserved: 0,
        }
    }

    #[test]
    fn one_question_is_open_at_a_time_and_only_its_answer_counts_once() {
        let mut reader = Reader::new(FleetList::Objects, Cursor::default());
        assert!(reader.question(1, at(0.0)).is_some());
        assert_eq!(reader.question(2, at(4.9)), None);
        assert!(reader.question(3, at(5.0)).is_some());
        assert_eq!(reader.check(&page(1, 9, 0, 5, 8), at(5.1)), Err(Refusal::Unasked));
        let cursor = reader.check(&page(3, 9, 0, 5, 8), at(5.2)).unwrap();
        assert_eq!(cursor, Cursor { epoch: 9, after: 5, listed: false });
        reader.advance(cursor);
        assert_eq!(reader.check(&page(3, 9, 0, 5, 8), at(5.3)), Err(Refusal::Unasked));
        assert_eq!(reader.lag(), Some(3));
        // There is more, so it goes on at once; at the end it waits for news.
        assert!(reader.question(4, at(5.4)).is_some());
        let cursor = reader.check(&page(4, 9, 5, 8, 8), at(5.5)).unwrap();
        assert!(cursor.listed);
        reader.advance(cursor);
        assert_eq!(reader.question(5, at(6.0)), None);
        reader.tell([9, 10]);
        assert!(reader.question(6, at(6.0)).is_some());
    }

    #[test]
    fn a_page_follows_the_cursor_or_starts_a_list_anew() {
        let cursor = Cursor { epoch: 9, after: 5, listed: true };
        let check = |page: FleetPage| {
            let mut reader = Reader::new(FleetList::Objects, cursor);
            reader.question(1, at(0.0));
            reader.check(&page, at(1.0))
        };
        assert_eq!(check(page(1, 9, 5, 6, 6)), Ok(Cursor { after: 6, ..cursor }));
        assert_eq!(check(page(1, 10, 0, 2, 3)), Ok(Cursor { epoch: 10, after: 2, listed: false }));
        for bad in [page(1, 9, 4, 6, 6), page(1, 10, 5, 6, 6), page(1, 9, 5, 4, 6), page(1, 9, 5, 7, 6)] {
            assert_eq!(check(bad), Err(Refusal::Senseless));
        }
    }
}
