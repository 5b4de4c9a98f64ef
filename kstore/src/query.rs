//! What clients ask of the store: objects by area, class and confidence.
//!
//! In: a query off the wire (UTM metres; the bounds may be infinite). Out: objects, nearest to the middle of the area
//! first where the area has one, by id where it has none, cut at the limit.

use crate::decay::View;
use crate::merge::distance_m;
use crate::object::Known;
use crate::store::KnowledgeStore;
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
        let found = self.index.within(query.min_m, query.max_m).filter_map(|id| self.objects.get(&id));
        let mut found: Vec<&Known> = found.filter(|o| self.matches(o, query, now)).collect();
        let truncated = found.len() > query.limit;
        match query.near_m.map(|(place, _)| place).or_else(|| query.middle()) {
            Some(middle) => {
                let mut ranked: Vec<(f64, u64, &Known)> =
                    found.into_iter().map(|o| (distance_m(o.place_m, middle), o.id, o)).collect();
                let order = |a: &(f64, u64, &Known), b: &(f64, u64, &Known)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
                if truncated && query.limit > 0 {
                    ranked.select_nth_unstable_by(query.limit - 1, order);
                    ranked.truncate(query.limit);
                }
                ranked.sort_unstable_by(order);
                found = ranked.into_iter().map(|(_, _, o)| o).collect();
            }
            None => found.sort_unstable_by_key(|o| o.id),
        }
        found.truncate(query.limit);
        Answer { objects: found.iter().map(|o| o.to_message(now, &self.config)).collect(), truncated }
    }

    fn matches(&self, known: &Known, query: &Query, now: Timestamp) -> bool {
        query.class.is_none_or(|class| class == known.class)
            && query.near_m.is_none_or(|(place, radius)| distance_m(place, known.place_m) <= radius)
            && (query.unreported || known.is_established(&self.config))
            && {
                let confidence = known.confidence_at(now, &self.config);
                let least = if query.unreported { 0.0 } else { self.config.report_confidence };
                confidence >= query.confidence_min.max(least)
            }
    }
}

/// Without a grid everything near the vehicle counts as seen; the store itself bounds "near".
pub fn view_without_grid(_place_m: [f64; 2]) -> View {
    View::Unconfirmed
}
