//! What the store forgets, by decay and by its bounds, and what it tells the history of each object.

use crate::correction::distance_m;
use crate::history::{Event, Reason};
use crate::object::Known;
use crate::store::KnowledgeStore;
use tsense_geometry::Timestamp;

/// When the store is full it is thinned by this share at once, so that thinning (a look at every object) stays rare.
const THINNING_SHARE: usize = 64;

impl KnowledgeStore {
    /// Forgets every object whose confidence has decayed below the threshold; returns how many.
    pub fn forget(&mut self, now: Timestamp) -> usize {
        let config = &self.config;
        let faded = |o: &&Known| o.confidence_at(now, config) < config.remove_confidence;
        let faded: Vec<u64> = self.objects.values().filter(faded).map(|o| o.id).collect();
        faded.iter().for_each(|id| self.drop_object(*id, Reason::Faded, now));
        let ids: Vec<u64> = self.objects.keys().copied().collect();
        ids.iter().for_each(|id| self.look_at(*id, now));
        faded.len()
    }

    /// When there are more objects than allowed, the least confident go, of equals those not seen for longest.
    pub(crate) fn thin(&mut self, now: Timestamp) {
        let max = self.config.objects_max;
        if self.objects.len() > max {
            let excess = self.objects.len() - (max - max / THINNING_SHARE);
            self.dropped.store_full += self.drop_least(excess, Reason::StoreFull, now);
        }
    }

    /// The file is near its largest size: the least confident of all objects go.
    pub fn make_room(&mut self) {
        let now = self.newest.unwrap_or_default();
        self.dropped.file_full += self.drop_least(self.objects.len().div_ceil(THINNING_SHARE), Reason::FileFull, now);
    }

    fn drop_least(&mut self, count: usize, reason: Reason, now: Timestamp) -> u64 {
        let mut order: Vec<(f64, Timestamp, u64)> =
            self.objects.values().map(|o| (o.confidence_at(now, &self.config), o.last_seen, o.id)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        order.iter().take(count).for_each(|(_, _, id)| self.drop_object(*id, reason, now));
        count.min(order.len()) as u64
    }

    /// Tells the history where an object is reported or not any more, or has wandered.
    pub(crate) fn look_at(&mut self, id: u64, now: Timestamp) {
        let Some(known) = self.objects.get_mut(&id) else { return };
        let reported = known.is_reported(now, &self.config);
        let wandered = distance_m(known.place_m, known.noted_m) > self.config.gate_m;
        let turned = std::mem::replace(&mut known.reported, reported) != reported;
        if wandered {
            known.noted_m = known.place_m;
            self.note(id, Reason::Moved, now);
        }
        if turned {
            self.changed.insert(id);
            self.note(id, if reported { Reason::Reported } else { Reason::Doubted }, now);
        }
    }

    pub(crate) fn note(&mut self, id: u64, reason: Reason, now: Timestamp) {
        if let Some(known) = self.objects.get(&id) {
            let confidence = known.confidence_at(now, &self.config);
            self.pending.push(Event::of(known, reason, now, self.zone, confidence));
            self.dropped.history = self.pending.lost();
        }
    }

    /// Forgets an object for a reason.
    pub(crate) fn drop_object(&mut self, id: u64, reason: Reason, now: Timestamp) {
        self.note(id, reason, now);
        self.remove(id);
    }
}
