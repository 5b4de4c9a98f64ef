//! What clients ask of the store: objects by area, class and confidence.
//!
//! In: a query off the wire (UTM metres; the bounds may be infinite). Out: objects, nearest to the middle of the area
//! first where the area has one, by id where it has none, cut at the limit.

use crate::decay::View;
use crate::merge::distance_m;
use crate::object::Known;
use crate::store::KnowledgeStore;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use tsense_contract::{Class, Object, StoreQuery};
use tsense_geometry::Timestamp;

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
            limit,
        }
    }

    /// Reported objects within a circle.
    pub fn near(place_m: [f64; 2], radius_m: f64, limit: usize) -> Self {
        let [east, north] = place_m;
        Self {
            min_m: [east - radius_m, north - radius_m],
            max_m: [east + radius_m, north + radius_m],
            near_m: Some((place_m, radius_m)),
            ..Self::all(limit)
        }
    }

    /// A query off the wire, at most `items_max` objects; nothing where a bound or the confidence is no number.
    pub fn parse(wire: &StoreQuery, items_max: usize) -> Option<Self> {
        let numbers = wire.min_m.iter().chain(&wire.max_m).copied().chain([f64::from(wire.confidence_min)]);
        if numbers.into_iter().any(f64::is_nan) {
            return None;
        }
        let limit = if wire.limit == 0 { items_max } else { items_max.min(usize::from(wire.limit)) };
        Some(Self {
            min_m: wire.min_m,
            max_m: wire.max_m,
            class: Some(Class::from_wire(wire.class)).filter(|c| *c != Class::Unknown),
            confidence_min: f64::from(wire.confidence_min),
            unreported: wire.unreported == 1,
            ..Self::all(limit)
        })
    }

    /// The middle of the area, or nothing where it is unbounded.
    fn middle(&self) -> Option<[f64; 2]> {
        let middle = [0, 1].map(|axis| (self.min_m[axis] + self.max_m[axis]) / 2.0);
        middle.iter().all(|x| x.is_finite()).then_some(middle)
    }

    fn is_empty(&self) -> bool {
        self.min_m.iter().zip(&self.max_m).any(|(min, max)| min > max)
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
        if query.is_empty() {
            return Answer::default();
        }
        let near = query.near_m.map(|(place, _)| place).or_else(|| query.middle());
        match near {
            Some(place) => self.nearest_first(query, place, now),
            None => {
                let inside = |o: &&Known| (0..2).all(|i| (query.min_m[i]..=query.max_m[i]).contains(&o.place_m[i]));
                self.first(query, self.objects.values().filter(inside), now)
            }
        }
    }

    /// Ranks by place alone, then looks at objects until there are enough: a wide area with a small limit is cheap.
    fn nearest_first(&self, query: &Query, place: [f64; 2], now: Timestamp) -> Answer {
        let rank = |(id, at): (u64, [f64; 2])| Reverse((Metres(distance_m(at, place)), id));
        let radius_m = query.near_m.map_or(f64::INFINITY, |(_, radius_m)| radius_m);
        let within = self.index.within(query.min_m, query.max_m).map(rank).filter(|r| r.0.0.0 <= radius_m);
        let mut ranked: BinaryHeap<_> = within.collect::<Vec<_>>().into();
        let objects = std::iter::from_fn(|| ranked.pop()).filter_map(|Reverse((_, id))| self.objects.get(&id));
        self.first(query, objects, now)
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

/// A distance that can be ordered: never NaN.
#[derive(Clone, Copy, PartialEq)]
struct Metres(f64);

impl Eq for Metres {}

impl PartialOrd for Metres {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Metres {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Without a grid everything near the vehicle counts as seen; the store itself bounds "near".
pub fn view_without_grid(_place_m: [f64; 2]) -> View {
    View::Unconfirmed
}
