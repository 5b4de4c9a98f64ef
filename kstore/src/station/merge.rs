//! Objects of several vehicles become objects of one store.
//!
//! In: what each vehicle reports, by (vehicle, its id), UTM metres. Out: merged objects with ids of their own, and what
//! changed. A merged object is computed anew from what its vehicles report now, so that nothing is counted twice however
//! often it is told. Which belongs to which: same class, within the gate of `merge` (covariances, 0.3 m at least), at most
//! one of each vehicle (what one vehicle holds for two things are two). Where several fit, the nearest.
//! Each pair (vehicle, id) keeps its merged id as long as it lies there, also when it is reported again after a break.

use crate::config::Config;
use crate::correction::distance_m;
use crate::history::{Event, Reason};
use crate::index::Index;
use crate::merge::{common_reach_m, gate_m};
use crate::object::Known;
use crate::records::Changes;
use crate::zone::Zone;
use std::collections::{BTreeMap, BTreeSet};
use tsense_geometry::Timestamp;

/// A merged object lets one of its vehicles' objects go beyond this many gates: at the gate itself noise would part and
/// join them again and again.
const PART_GATES: f64 = 1.5;

/// A vehicle's number at this station, and the vehicle's id of the object.
pub type SourceKey = (u32, u64);

/// What one vehicle says of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// The merged object it is part of, or was while it was reported.
    pub object: u64,
    /// Epoch of the vehicle's list that it was last seen in.
    pub epoch: u64,
    /// Whether the vehicle reports it now.
    pub present: bool,
    /// As the vehicle knows it, at a place in the station's zone.
    pub known: Known,
}

#[derive(Clone, Debug)]
struct Merged {
    known: Known,
    sources: Vec<SourceKey>,
}

/// The merged store.
#[derive(Clone, Debug)]
pub struct Fleet {
    config: Config,
    zone: Option<Zone>,
    sources: BTreeMap<SourceKey, Source>,
    objects: BTreeMap<u64, Merged>,
    index: Index,
    next_id: u64,
    touched: Touched,
}

/// What changed since it was last written down.
#[derive(Clone, Debug, Default)]
struct Touched {
    objects: BTreeSet<u64>,
    sources: BTreeSet<SourceKey>,
    events: Vec<Event>,
}

/// What must be written down in one transaction.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// Of the merged objects.
    pub changes: Changes,
    /// Of what the vehicles say.
    pub sources: Vec<(SourceKey, Source)>,
}

impl Fleet {
    /// The store as it was written down.
    pub fn restore(config: Config, zone: Option<Zone>, next_id: u64, sources: Vec<(SourceKey, Source)>) -> Self {
        let newest_id = sources.iter().map(|(_, s)| s.object).max().unwrap_or(0);
        let mut fleet = Self {
            config,
            zone,
            sources: sources.into_iter().collect(),
            objects: BTreeMap::new(),
            index: Index::of(std::iter::empty()),
            next_id: next_id.max(newest_id.saturating_add(1)).max(1),
            touched: Touched::default(),
        };
        let mut groups: BTreeMap<u64, Vec<SourceKey>> = BTreeMap::new();
        for (key, source) in fleet.sources.iter().filter(|(_, s)| s.present) {
            groups.entry(source.object).or_default().push(*key);
        }
        for (id, keys) in groups {
            let known = fleet.fused(id, &keys);
            fleet.index.insert(known.class, id, known.place_m);
            fleet.objects.insert(id, Merged { known, sources: keys });
        }
        fleet
    }

    /// The zone of all places, from the first object on.
    pub fn zone(&self) -> Option<Zone> {
        self.zone
    }

    /// The first zone becomes the store's.
    pub fn settle_zone(&mut self, zone: Zone) -> Zone {
        *self.zone.get_or_insert(zone)
    }

    /// Merged objects by id.
    pub fn objects(&self) -> impl Iterator<Item = &Known> {
        self.objects.values().map(|merged| &merged.known)
    }

    /// Number of merged objects.
    pub fn len(&self) -> usize {
        self.objects.len()
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.objects.is_empty()
    }

    /// What a vehicle says of an object.
    pub fn source(&self, key: SourceKey) -> Option<&Source> {
        self.sources.get(&key)
    }

    /// Objects of a vehicle: those it reports now, and all that it ever reported.
    pub fn count_of(&self, vehicle: u32) -> (usize, usize) {
        let all = self.sources.range((vehicle, 0)..=(vehicle, u64::MAX));
        all.fold((0, 0), |(now, ever), (_, s)| (now + usize::from(s.present), ever + 1))
    }

    /// A vehicle reports an object, in a list of this epoch.
    pub fn take(&mut self, key: SourceKey, epoch: u64, known: Known) {
        let old = self.sources.get(&key);
        let (object, home) = old.map_or((0, None), |s| (s.object, s.present.then_some(s.object)));
        if old.is_some_and(|s| s.present && s.epoch == epoch && s.known == known) {
            return;
        }
        let is_same = old.is_some_and(|s| s.present && s.known == known);
        self.sources.insert(key, Source { object, epoch, present: true, known });
        self.touched.sources.insert(key);
        match home {
            Some(_) if is_same => {}
            Some(id) if self.fits(key, id, PART_GATES) => self.refresh(id),
            Some(id) => {
                self.leave(key, id);
                self.join(key);
            }
            None => self.join(key),
        }
    }

    /// A vehicle reports an object no more.
    pub fn withdraw(&mut self, key: SourceKey) {
        let Some(source) = self.sources.get_mut(&key).filter(|s| s.present) else { return };
        source.present = false;
        let id = source.object;
        self.touched.sources.insert(key);
        self.leave(key, id);
    }

    /// A vehicle's list of this epoch was read to its end: what was not in it is gone.
    pub fn end_listing(&mut self, vehicle: u32, epoch: u64) {
        let all = self.sources.range((vehicle, 0)..=(vehicle, u64::MAX));
        let gone: Vec<SourceKey> = all.filter(|(_, s)| s.present && s.epoch != epoch).map(|(key, _)| *key).collect();
        gone.into_iter().for_each(|key| self.withdraw(key));
    }

    /// A vehicle has never been there. Which of its sources go from the file is not told: all of its number.
    pub fn forget(&mut self, vehicle: u32) {
        let keys: Vec<SourceKey> =
            self.sources.range((vehicle, 0)..=(vehicle, u64::MAX)).map(|(key, _)| *key).collect();
        for key in keys {
            self.withdraw(key);
            self.sources.remove(&key);
            self.touched.sources.remove(&key);
        }
    }

    /// What changed since the last call.
    pub fn take_batch(&mut self) -> Batch {
        let touched = std::mem::take(&mut self.touched);
        let (there, removed): (Vec<u64>, Vec<u64>) =
            touched.objects.into_iter().partition(|id| self.objects.contains_key(id));
        let changed = there.iter().map(|id| self.objects[id].known.clone()).collect();
        let sources = touched.sources.into_iter().map(|key| (key, self.sources[&key].clone())).collect();
        Batch { changes: Changes { changed, removed, events: touched.events, next_id: self.next_id }, sources }
    }

    /// Whether a source lies within so many gates of what the other vehicles say of a merged object.
    fn fits(&self, key: SourceKey, id: u64, gates: f64) -> bool {
        let (Some(merged), Some(source)) = (self.objects.get(&id), self.sources.get(&key)) else { return false };
        let others: Vec<SourceKey> = merged.sources.iter().copied().filter(|other| *other != key).collect();
        let same_class = merged.known.class == source.known.class;
        same_class && (others.is_empty() || self.distance_gates(&self.fused(id, &others), &source.known) <= gates)
    }

    /// Distance of two estimates of a place, in gates.
    fn distance_gates(&self, a: &Known, b: &Known) -> f64 {
        let reach_m = common_reach_m(a.class, a.dbh, b.dbh);
        distance_m(a.place_m, b.place_m) / gate_m(a.position_std_m, b.position_std_m, reach_m, &self.config)
    }

    /// Finds the merged object that a source belongs to, or makes one.
    fn join(&mut self, key: SourceKey) {
        let Some(source) = self.sources.get(&key) else { return };
        let (before, known) = (source.object, &source.known);
        let fits = |merged: &&Merged| {
            merged.sources.iter().all(|(vehicle, _)| *vehicle != key.0)
                && self.distance_gates(&merged.known, known) <= 1.0
        };
        let near = self.near(known).filter(fits);
        // The one it was part of before, else the nearest.
        let rank = |m: &Merged| (m.known.id != before, distance_m(m.known.place_m, known.place_m), m.known.id);
        let order = |a: &Merged, b: &Merged| {
            let (a, b) = (rank(a), rank(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
        };
        let found = near.min_by(|a, b| order(a, b)).map(|merged| merged.known.id);
        let id = found.unwrap_or_else(|| self.make(key, before));
        if let Some(merged) = self.objects.get_mut(&id) {
            let at = merged.sources.binary_search(&key).unwrap_or_else(|at| at);
            merged.sources.insert(at, key);
        }
        self.assign(key, id);
        if found.is_none() {
            self.note(id, Reason::FirstSeen);
        }
        self.refresh(id);
    }

    /// A new merged object of one source; under its old id where that is free.
    fn make(&mut self, key: SourceKey, before: u64) -> u64 {
        let id = if before != 0 && !self.objects.contains_key(&before) { before } else { self.next_id };
        self.next_id = self.next_id.max(id.saturating_add(1));
        let known = Known { id, ..self.sources[&key].known.clone() };
        self.index.insert(known.class, id, known.place_m);
        self.objects.insert(id, Merged { known, sources: Vec::new() });
        id
    }

    fn assign(&mut self, key: SourceKey, id: u64) {
        if let Some(source) = self.sources.get_mut(&key) {
            source.object = id;
            self.touched.sources.insert(key);
        }
    }

    /// Takes a source out of a merged object, which ends with its last one.
    fn leave(&mut self, key: SourceKey, id: u64) {
        let Some(merged) = self.objects.get_mut(&id) else { return };
        merged.sources.retain(|other| *other != key);
        if merged.sources.is_empty() {
            self.remove(id, Reason::Withdrawn);
        } else {
            self.refresh(id);
        }
    }

    fn remove(&mut self, id: u64, reason: Reason) {
        self.note(id, reason);
        if let Some(merged) = self.objects.remove(&id) {
            self.index.remove(merged.known.class, id, merged.known.place_m);
            self.touched.objects.insert(id);
        }
    }

    /// Computes a merged object anew, and unites it with another where they have come to be one.
    fn refresh(&mut self, id: u64) {
        let Some(merged) = self.objects.get(&id) else { return };
        let mut known = self.fused(id, &merged.sources);
        let old = &merged.known;
        known.noted_m = old.noted_m;
        let moved = distance_m(known.place_m, known.noted_m) > self.config.gate_m;
        if moved {
            known.noted_m = known.place_m;
        }
        self.index.remove(old.class, id, old.place_m);
        self.index.insert(known.class, id, known.place_m);
        if let Some(merged) = self.objects.get_mut(&id) {
            merged.known = known;
        }
        self.touched.objects.insert(id);
        if moved {
            self.note(id, Reason::Moved);
        }
        if let Some(other) = self.same_as(id) {
            self.unite(id.min(other), id.max(other));
        }
    }

    /// The nearest merged object within the gate that no vehicle tells from this one.
    fn same_as(&self, id: u64) -> Option<u64> {
        let merged = self.objects.get(&id)?;
        let vehicles: BTreeSet<u32> = merged.sources.iter().map(|(vehicle, _)| *vehicle).collect();
        let known = &merged.known;
        let same = self.near(known).filter(|other| {
            other.known.id != id
                && other.sources.iter().all(|(vehicle, _)| !vehicles.contains(vehicle))
                && self.distance_gates(&other.known, known) <= 1.0
        });
        let distance = |m: &Merged| distance_m(m.known.place_m, known.place_m);
        let nearest = same.min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.known.id.cmp(&b.known.id)));
        nearest.map(|other| other.known.id)
    }

    /// The older id stays.
    fn unite(&mut self, older: u64, younger: u64) {
        let Some(sources) = self.objects.get(&younger).map(|merged| merged.sources.clone()) else { return };
        self.remove(younger, Reason::PartOf(older));
        sources.iter().for_each(|key| self.assign(*key, older));
        if let Some(merged) = self.objects.get_mut(&older) {
            merged.sources.extend(sources);
            merged.sources.sort_unstable();
        }
        self.note(older, Reason::United(younger));
        self.refresh(older);
    }

    /// What several vehicles say of one thing, in one. The order is that of the keys, so that it does not depend on
    /// who told first.
    fn fused(&self, id: u64, keys: &[SourceKey]) -> Known {
        let mut all = keys.iter().map(|key| &self.sources[key].known);
        let now = all.clone().map(|known| known.weighed).max().unwrap_or_default();
        let mut fused = all.next().cloned().unwrap_or_else(|| unreachable!("a merged object has a source"));
        all.for_each(|known| fused.unite(known, now, &self.config));
        Known { id, reported: fused.is_reported(now, &self.config), noted_m: fused.place_m, ..fused }
    }

    fn near(&self, known: &Known) -> impl Iterator<Item = &Merged> {
        let ids = self.index.near(Some(known.class), known.place_m, self.config.gate_max_m);
        ids.filter_map(|id| self.objects.get(&id))
    }

    fn note(&mut self, id: u64, reason: Reason) {
        if let Some(merged) = self.objects.get(&id) {
            let known = &merged.known;
            let now: Timestamp = known.weighed;
            self.touched.events.push(Event::of(known, reason, now, self.zone, known.confidence));
        }
    }
}
