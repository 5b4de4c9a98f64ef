//! What clients ask of the store: objects by area, distance, class and confidence.
//!
//! In: a query off the wire (UTM metres; the bounds may be infinite). Out: objects, nearest to the middle of the area
//! first where the area has one, by id where it has none or where that is asked for, cut at the limit.

use crate::correction::distance_m;
use crate::decay::View;
use crate::object::Known;
use crate::store::KnowledgeStore;
use std::collections::BTreeMap;
use tsense_contract::{Class, Object, StoreQuery};
use tsense_geometry::Timestamp;

/// Up to so many objects are looked for one by one.
const FEW: usize = 256;

/// A circle of this radius, metres, holds more than one stem of a dense wood (1500 stems a hectare). The circle with the area
/// of as many as are wanted is where many objects are looked for first.
const STEM_M: f64 = 1.7;
/// Then in circles of so many times its radius, and then in the whole area: where there are too few that costs little, and
/// where there are enough they are not many times as many as are wanted.
const WIDER: [f64; 5] = [1.0, 2.0, 4.0, 16.0, 64.0];

/// A question to the store.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Query {
    /// South-west corner, metres.
    pub min_m: [f64; 2],
    /// North-east corner, metres.
    pub max_m: [f64; 2],
    /// Only within this distance of a place (easting, northing, radius), metres.
    pub near_m: Option<([f64; 2], f64)>,
    /// Only this class.
    pub class: Option<Class>,
    /// Only at this confidence and above.
    pub confidence_min: f64,
    /// Also objects that are not believed enough to be reported.
    pub unreported: bool,
    /// By id, only ids above this one.
    pub after_id: Option<u64>,
    /// At most this many.
    pub limit: usize,
}

impl Query {
    /// Every reported object, up to a limit.
    pub fn all(limit: usize) -> Self {
        let everywhere = [f64::INFINITY; 2];
        Self {
            min_m: everywhere.map(|x| -x),
            max_m: everywhere,
            near_m: None,
            class: None,
            confidence_min: 0.0,
            unreported: false,
            after_id: None,
            limit,
        }
    }

    /// Reported objects within a circle.
    pub fn near(place_m: [f64; 2], radius_m: f64, limit: usize) -> Self {
        Self::all(limit).within(place_m, radius_m)
    }

    /// The same, only within a circle.
    fn within(self, place_m: [f64; 2], radius_m: f64) -> Self {
        let [min_m, max_m] = [-radius_m, radius_m].map(|reach_m| place_m.map(|x| x + reach_m));
        Self {
            min_m: [0, 1].map(|axis| self.min_m[axis].max(min_m[axis])),
            max_m: [0, 1].map(|axis| self.max_m[axis].min(max_m[axis])),
            near_m: Some((place_m, radius_m)),
            ..self
        }
    }

    /// A query off the wire, at most `items_max` objects; nothing where a bound, a distance or the confidence is no
    /// number.
    pub fn parse(wire: &StoreQuery, items_max: usize) -> Option<Self> {
        let numbers = wire.min_m.iter().chain(&wire.max_m).copied();
        let numbers = numbers.chain([f64::from(wire.confidence_min), wire.radius_m]);
        if numbers.into_iter().any(f64::is_nan) {
            return None;
        }
        let all = Self {
            min_m: wire.min_m,
            max_m: wire.max_m,
            class: Some(Class::from_wire(wire.class)).filter(|c| *c != Class::Unknown),
            confidence_min: f64::from(wire.confidence_min),
            unreported: wire.unreported == 1,
            after_id: (wire.by_id == 1).then_some(wire.after_id),
            ..Self::all(if wire.limit == 0 { items_max } else { items_max.min(usize::from(wire.limit)) })
        };
        match wire.radius_m {
            radius_m if radius_m <= 0.0 => Some(all),
            radius_m => wire.near_m.iter().all(|x| x.is_finite()).then(|| all.within(wire.near_m, radius_m)),
        }
    }

    /// The query on the wire. A limit beyond what a message can say asks for as many as fit.
    pub fn to_wire(&self) -> StoreQuery {
        let (near_m, radius_m) = self.near_m.unwrap_or_default();
        StoreQuery {
            min_m: self.min_m,
            max_m: self.max_m,
            near_m,
            radius_m,
            after_id: self.after_id.unwrap_or_default(),
            confidence_min: self.confidence_min as f32,
            class: self.class.unwrap_or(Class::Unknown).to_wire(),
            unreported: u8::from(self.unreported),
            limit: u16::try_from(self.limit).unwrap_or_default(),
            by_id: u8::from(self.after_id.is_some()),
            reserved: [0; 7],
        }
    }

    /// The place to which the nearest come first: the middle of the circle, or of the area where it has one.
    pub fn middle(&self) -> Option<[f64; 2]> {
        let middle = [0, 1].map(|axis| (self.min_m[axis] + self.max_m[axis]) / 2.0);
        self.near_m.map(|(place, _)| place).or(Some(middle)).filter(|m| m.iter().all(|x| x.is_finite()))
    }

    /// The farthest that the area reaches from a place within, metres, with room for rounding.
    fn reach_m(&self, place_m: [f64; 2]) -> f64 {
        let reach = [0, 1].map(|i| (self.max_m[i] - place_m[i]).max(place_m[i] - self.min_m[i]));
        let circle_m = self.near_m.map(|(middle, radius_m)| radius_m + distance_m(middle, place_m));
        1e-6 + reach[0].hypot(reach[1]).min(circle_m.unwrap_or(f64::INFINITY))
    }

    fn is_empty(&self) -> bool {
        self.min_m.iter().zip(&self.max_m).any(|(min, max)| min > max)
    }

    fn is_bounded(&self) -> bool {
        self.min_m.iter().chain(&self.max_m).all(|x| x.is_finite())
    }

    fn holds(&self, place_m: [f64; 2]) -> bool {
        (0..2).all(|i| (self.min_m[i]..=self.max_m[i]).contains(&place_m[i]))
            && self.near_m.is_none_or(|(middle, radius_m)| square_m2(middle, place_m) <= radius_m * radius_m)
    }
}

/// An answer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    /// The objects.
    pub objects: Vec<Object>,
    /// True where the limit left some out.
    pub truncated: bool,
}

impl KnowledgeStore {
    /// Answers a query as of `now`.
    pub fn query(&self, query: &Query, now: Timestamp) -> Answer {
        match (query.after_id, query.middle()) {
            _ if query.is_empty() => Answer::default(),
            (None, Some(place)) => self.nearest_first(query, place, now),
            (after_id, _) => self.by_id(query, after_id.unwrap_or(0), now),
        }
    }

    /// A few are taken from the middle outwards until there are enough, however wide the area; many are collected and sorted
    /// as far as they are needed, which is faster for each, from farther and farther until there are enough.
    fn nearest_first(&self, query: &Query, place: [f64; 2], now: Timestamp) -> Answer {
        if query.limit <= FEW {
            let reach_m = query.reach_m(place);
            let near = self.index.nearest(query.class, place);
            let near = near.take_while(|f| distance_m(f.place_m, place) <= reach_m);
            let near = near.filter(|f| query.holds(f.place_m));
            return self.first(query, near.filter_map(|f| self.objects.get(&f.id)), now);
        }
        let whole_m = query.reach_m(place);
        let first_m = STEM_M * (query.limit as f64).sqrt();
        let nearer = WIDER.into_iter().map(|times| times * first_m).filter(|reach_m| *reach_m < whole_m);
        let ranked = nearer.map(|reach_m| self.within_reach(query, place, reach_m));
        // As many as are wanted, or fewer: some farther away may match as well.
        let enough = ranked.filter(|ranked| ranked.len() > query.limit);
        let mut answers = enough.map(|ranked| self.ranked(query, ranked, now));
        let whole = || self.ranked(query, self.within_reach(query, place, whole_m), now);
        answers.find(|a| a.truncated).unwrap_or_else(whole)
    }

    /// All that lies within a distance of a place: its square as bits, and the id.
    fn within_reach(&self, query: &Query, place: [f64; 2], reach_m: f64) -> Vec<(u64, u64)> {
        let near = query.within(place, reach_m);
        let within = self.index.within(query.class, near.min_m, near.max_m).filter(|f| query.holds(f.place_m));
        let ranked = within.map(|f| (square_m2(f.place_m, place), f.id)).filter(|(m2, _)| *m2 <= reach_m * reach_m);
        ranked.map(|(m2, id)| (m2.to_bits(), id)).collect()
    }

    fn ranked(&self, query: &Query, waiting: Vec<(u64, u64)>, now: Timestamp) -> Answer {
        // One more than is wanted says whether there are more.
        let piece = query.limit.saturating_add(1);
        let ranked = Ranked { objects: &self.objects, waiting, piece, sorted: Vec::new().into_iter() };
        self.first(query, ranked, now)
    }

    /// In the order of ids, so that a client can ask for the rest of a long answer.
    fn by_id(&self, query: &Query, after_id: u64, now: Timestamp) -> Answer {
        let Some(from) = after_id.checked_add(1) else { return Answer::default() };
        if !query.is_bounded() {
            return self.first(
                query,
                self.objects.range(from..).map(|(_, o)| o).filter(|o| query.holds(o.place_m)),
                now,
            );
        }
        let within = self.index.within(query.class, query.min_m, query.max_m);
        let mut ids: Vec<u64> = within.filter(|f| f.id >= from && query.holds(f.place_m)).map(|f| f.id).collect();
        ids.sort_unstable();
        self.first(query, ids.iter().filter_map(|id| self.objects.get(id)), now)
    }

    /// The first objects that match, up to the limit.
    fn first<'a>(&'a self, query: &Query, candidates: impl Iterator<Item = &'a Known>, now: Timestamp) -> Answer {
        let mut answer = Answer::default();
        for known in candidates.filter(|o| self.matches(o, query)) {
            let object = known.to_message(now, &self.config);
            if f64::from(object.confidence) < query.confidence_min || (object.reported == 0 && !query.unreported) {
                continue;
            }
            if answer.objects.len() == query.limit {
                answer.truncated = true;
                break;
            }
            answer.objects.push(object);
        }
        answer
    }

    /// What can be said without looking at the clock.
    fn matches(&self, known: &Known, query: &Query) -> bool {
        query.class.is_none_or(|class| class == known.class)
            && known.confidence >= query.confidence_min
            && (query.unreported || known.is_established(&self.config))
    }
}

/// Distance squared, square metres: orders and bounds need no root.
fn square_m2(a: [f64; 2], b: [f64; 2]) -> f64 {
    let [east, north] = [a[0] - b[0], a[1] - b[1]];
    east * east + north * north
}

/// What is nearest goes first, of equals the oldest: looked up and sorted in pieces, as they are asked for.
struct Ranked<'a> {
    objects: &'a BTreeMap<u64, Known>,
    /// Distance squared, as bits, which order as their numbers do, and the id: of those that have not had their turn.
    waiting: Vec<(u64, u64)>,
    piece: usize,
    /// The piece at hand.
    sorted: std::vec::IntoIter<(u64, &'a Known)>,
}

impl<'a> Ranked<'a> {
    fn next_piece(&mut self) -> std::vec::IntoIter<(u64, &'a Known)> {
        let piece = self.piece.min(self.waiting.len());
        if piece < self.waiting.len() {
            self.waiting.select_nth_unstable(piece);
        }
        let rest = self.waiting.split_off(piece);
        let mut nearest = std::mem::replace(&mut self.waiting, rest);
        // Ids that follow each other lie beside each other: so most are found where the processor just was.
        nearest.sort_unstable_by_key(|(_, id)| *id);
        let found = nearest.iter().filter_map(|(m2, id)| Some((*m2, self.objects.get(id)?)));
        let mut sorted: Vec<_> = found.collect();
        sorted.sort_unstable_by_key(|(m2, known)| (*m2, known.id));
        sorted.into_iter()
    }
}

impl<'a> Iterator for Ranked<'a> {
    type Item = &'a Known;

    fn next(&mut self) -> Option<&'a Known> {
        while self.sorted.len() == 0 && !self.waiting.is_empty() {
            self.sorted = self.next_piece();
        }
        self.sorted.next().map(|(_, known)| known)
    }
}

/// Without a grid everything near the vehicle counts as seen; the store itself bounds "near".
pub fn view_without_grid(_place_m: [f64; 2]) -> View {
    View::Unconfirmed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::testing::{at, detection, known, snapshot};

    #[test]
    fn a_query_is_the_same_after_the_wire() {
        let near = Query { class: Some(Class::Rock), unreported: true, ..Query::near([3.0, 4.0], 5.0, 7) };
        let pages = Query { after_id: Some(9), confidence_min: 0.5, ..Query::all(100) };
        for query in [near, pages, Query::all(4096)] {
            assert_eq!(Query::parse(&query.to_wire(), 4096), Some(query));
        }
        assert_eq!(Query::parse(&Query::all(100_000).to_wire(), 4096), Some(Query::all(4096)));
        assert_eq!(Query::parse(&StoreQuery::everything(), 9), Some(Query::all(9)));
    }

    #[test]
    fn sorting_in_pieces_is_sorting() {
        // Ranks with many equals, in no order.
        let waiting: Vec<(u64, u64)> = (0..500).map(|i| (i * 7919 % 97, i * 31 % 499)).collect();
        // Some that the index knows have gone.
        let is_there = |id: u64| !id.is_multiple_of(7);
        let objects = (0..499).filter(|id| is_there(*id)).map(|id| (id, known(id, 0.0, 0.0))).collect();
        let mut plain = waiting.clone();
        plain.sort_unstable();
        let plain: Vec<u64> = plain.iter().map(|(_, id)| *id).filter(|id| is_there(*id)).collect();
        for piece in [1, 2, 7, 499, 500, 501] {
            let sorted = Vec::new().into_iter();
            let ranked = Ranked { objects: &objects, waiting: waiting.clone(), piece, sorted };
            assert_eq!(ranked.map(|known| known.id).collect::<Vec<_>>(), plain, "pieces of {piece}");
        }
    }

    #[test]
    fn many_are_found_near_and_far_and_the_nearest_come_first() {
        let config = Config { detection_range_max_m: 1e5, ..Config::default() };
        let mut store = KnowledgeStore::new(config);
        // Of 700 trees on a line of 7.7 km more than 300 stand within 1880 m of its middle, but not within 470 m.
        let trees: Vec<_> = (0..700).map(|i| detection(f64::from(i) * 11.0, 0.0)).collect();
        store.take(&snapshot(0.0), &trees, |_| View::Unseen);
        let asked = |limit, size_m: f64| Query {
            min_m: [3850.0 - size_m, -size_m],
            max_m: [3850.0 + size_m, size_m],
            unreported: true,
            ..Query::all(limit)
        };
        for (limit, size_m, found) in [(300, 1e9, 300), (300, 1000.0, 181), (700, 1e9, 700), (5000, 1e12, 700)] {
            let answer = store.query(&asked(limit, size_m), at(1.0));
            assert_eq!((answer.objects.len(), answer.truncated), (found, found == 300), "{limit} within {size_m} m");
            let distances: Vec<f64> = answer.objects.iter().map(|o| (o.easting_m - 3850.0).abs()).collect();
            assert!(distances.is_sorted() && distances[found - 1] < 11.0 * (found / 2 + 1) as f64);
        }
    }

    #[test]
    fn what_is_no_number_is_no_query() {
        let all = StoreQuery::everything();
        let bad = [
            StoreQuery { min_m: [f64::NAN, 0.0], ..all },
            StoreQuery { confidence_min: f32::NAN, ..all },
            StoreQuery { radius_m: f64::NAN, ..all },
            StoreQuery { radius_m: 1.0, near_m: [f64::INFINITY, 0.0], ..all },
        ];
        assert_eq!(bad.map(|wire| Query::parse(&wire, 10)), [None; 4]);
    }
}
