//! The local knowledge store: detections in, objects one can trust out.
//!
//! In: the detections of a snapshot (UTM metres; the store follows the vehicle's zone) and what the snapshot saw where
//! nothing was detected. Out: objects by area, class and confidence, and what changed since it was last written down.
//! Does not know files, clocks or topics (`process`, `persist`). Source: thesis, local knowledge store.

use crate::config::Config;
use crate::correction::distance_m;
use crate::correction::plus;
use crate::decay::View;
use crate::history::{Pending, Reason};
use crate::index::Index;
use crate::merge::{Candidate, common_reach_m, gate_m, nearest_first};
use crate::object::{Known, Sighting};
use crate::records::{Changes, Dropped, Outcome, Snapshot};
use crate::registration::Registration;
use crate::reproject::Reprojection;
use crate::zone::Zone;
use std::collections::{BTreeMap, BTreeSet};
use tsense_contract::{Class, Detection};
use tsense_geometry::Timestamp;

/// A stamp older than the newest by more than this is no straggler: the clock was set back, seconds.
const CLOCK_SET_BACK_S: f64 = 60.0;
/// The store.
#[derive(Clone, Debug)]
pub struct KnowledgeStore {
    pub(crate) config: Config,
    pub(crate) objects: BTreeMap<u64, Known>,
    pub(crate) index: Index,
    pub(crate) zone: Option<Zone>,
    pub(crate) newest: Option<Timestamp>,
    next_id: u64,
    pub(crate) dropped: Dropped,
    pub(crate) changed: BTreeSet<u64>,
    removed: BTreeSet<u64>,
    pub(crate) pending: Pending,
    pub(crate) registration: Registration,
}

impl KnowledgeStore {
    /// An empty store.
    pub fn new(config: Config) -> Self {
        Self::restore(config, None, 1, Vec::new())
    }

    /// A store as it was written down: its zone, the next id, its objects.
    pub fn restore(config: Config, zone: Option<Zone>, next_id: u64, objects: Vec<Known>) -> Self {
        let next_id = objects.iter().map(|o| o.id.saturating_add(1)).max().unwrap_or(1).max(next_id).max(1);
        let newest = objects.iter().map(|o| o.weighed).max();
        let index = Index::of(objects.iter().map(Known::indexed));
        let objects = objects.into_iter().map(|o| (o.id, o)).collect();
        Self {
            config,
            objects,
            index,
            zone,
            newest,
            next_id,
            dropped: Dropped::default(),
            changed: BTreeSet::new(),
            removed: BTreeSet::new(),
            pending: Pending::default(),
            registration: Registration::default(),
        }
    }

    /// Takes in the detections of one snapshot. `view` says what the snapshot shows at a place (easting, northing)
    /// where a stored object was not detected.
    pub fn take(&mut self, snapshot: &Snapshot, detections: &[Detection], view: impl Fn([f64; 2]) -> View) -> Outcome {
        if !self.accepts(snapshot, detections.len()) {
            return Outcome::default();
        }
        let mut sightings = self.sightings(snapshot, detections);
        self.register(snapshot, &mut sightings);
        let pairs = nearest_first(self.candidates(&sightings));
        let absorbed = self.absorb(&sightings, &pairs, snapshot.stamp);
        let created = self.create(&sightings, &pairs, snapshot.stamp);
        let seen: BTreeSet<u64> = absorbed.iter().chain(&created).copied().collect();
        self.remember_companions(&seen);
        let contradicted = self.contradict(snapshot, &seen, view);
        let united = self.unite(&seen, snapshot.stamp);
        seen.iter().for_each(|id| self.look_at(*id, snapshot.stamp));
        self.thin(snapshot.stamp);
        Outcome { taken: sightings.len(), absorbed: absorbed.len(), created: created.len(), contradicted, united }
    }

    /// Counts the detections of a snapshot that makes no sense, at least one.
    pub fn refuse(&mut self, detections: usize) {
        self.dropped.senseless_snapshot += detections.max(1) as u64;
    }

    /// What has changed since the last call; the caller writes it down.
    pub fn take_changes(&mut self) -> Changes {
        let changed = std::mem::take(&mut self.changed);
        let changed = changed.iter().filter_map(|id| self.objects.get(id).cloned()).collect();
        let removed = std::mem::take(&mut self.removed).into_iter().collect();
        Changes { changed, removed, events: self.pending.take(), next_id: self.next_id }
    }

    /// Changes that could not be written down are changes still.
    pub fn give_back(&mut self, changes: &Changes) {
        self.changed.extend(changes.changed.iter().map(|o| o.id).filter(|id| self.objects.contains_key(id)));
        self.removed.extend(&changes.removed);
        self.pending.give_back(&changes.events);
        self.dropped.history = self.pending.lost();
    }

    /// Marks every object as changed: for a new file.
    pub fn mark_all_changed(&mut self) {
        self.changed.extend(self.objects.keys());
    }

    /// Takes in objects of a file that could not be read when this store started. What is known here, or was
    /// forgotten here, stays as it is. Everything counts as changed afterwards.
    pub fn adopt(&mut self, zone: Option<Zone>, objects: Vec<Known>, next_id: u64) {
        let here = self.zone.or(zone);
        let reprojection = zone.zip(here).and_then(|(from, to)| Reprojection::between(from, to));
        for mut known in objects {
            if self.objects.contains_key(&known.id) || self.removed.contains(&known.id) {
                continue;
            }
            if zone != here {
                let Some(place_m) = reprojection.as_ref().and_then(|r| r.apply(known.place_m)) else {
                    self.dropped.out_of_zone += 1;
                    continue;
                };
                known.place_m = place_m;
            }
            self.next_id = self.next_id.max(known.id.saturating_add(1));
            self.index.insert(known.class, known.id, known.place_m);
            self.objects.insert(known.id, known);
        }
        (self.zone, self.next_id) = (here, self.next_id.max(next_id));
        self.mark_all_changed();
    }

    /// Becomes what another store, this one's source, has written down.
    pub fn apply(&mut self, zone: Zone, changes: &Changes) {
        self.zone = Some(zone);
        for id in &changes.removed {
            self.remove(*id);
        }
        for known in &changes.changed {
            match self.objects.insert(known.id, known.clone()) {
                Some(old) => self.index.shift(known.class, known.id, old.place_m, known.place_m),
                None => self.index.insert(known.class, known.id, known.place_m),
            }
            self.newest = self.newest.max(Some(known.weighed));
        }
        self.removed.clear();
        self.changed.clear();
        self.next_id = changes.next_id;
    }

    /// Number of objects, reported or not.
    pub fn len(&self) -> usize {
        self.objects.len()
    }
    /// True where nothing is stored.
    pub fn is_empty(&self) -> bool {
        self.objects.is_empty()
    }
    /// True where something changed since the last call of [`Self::take_changes`].
    pub fn has_changes(&self) -> bool {
        !self.changed.is_empty() || !self.removed.is_empty()
    }
    /// An object by its id.
    pub fn get(&self, id: u64) -> Option<&Known> {
        self.objects.get(&id)
    }
    /// All objects by id.
    pub fn objects(&self) -> impl Iterator<Item = &Known> {
        self.objects.values()
    }
    /// The zone of all positions, from the first snapshot on.
    pub fn zone(&self) -> Option<Zone> {
        self.zone
    }
    /// Stamp of the newest evidence, or nothing before any.
    pub fn newest(&self) -> Option<Timestamp> {
        self.newest
    }
    /// What was dropped so far.
    pub fn dropped(&self) -> Dropped {
        self.dropped
    }
    /// The configuration it works by.
    pub fn config(&self) -> &Config {
        &self.config
    }
    /// How the vehicle's pose lies to the stored trees.
    pub fn registration(&self) -> &Registration {
        &self.registration
    }
    /// The next id to be given.
    pub fn next_id(&self) -> u64 {
        self.next_id
    }

    /// True where a snapshot continues this store; counts its detections where it does not.
    fn accepts(&mut self, snapshot: &Snapshot, detections: usize) -> bool {
        let behind_s = self.newest.map_or(0.0, |newest| newest.seconds_since(snapshot.stamp));
        if behind_s > CLOCK_SET_BACK_S {
            self.objects.values_mut().for_each(|o| o.not_after(snapshot.stamp));
            self.mark_all_changed();
        } else if behind_s > 0.0 {
            self.dropped.late += detections as u64;
            return false;
        }
        self.newest = Some(snapshot.stamp);
        self.move_to(snapshot.zone, snapshot.stamp);
        true
    }

    /// The store follows the zone the vehicle works in: a graph pins one zone, the next day's graph may pin another.
    fn move_to(&mut self, zone: Zone, now: Timestamp) {
        let Some(old) = self.zone.replace(zone).filter(|old| *old != zone) else { return };
        let reprojection = Reprojection::between(old, zone);
        self.registration.move_to_zone(reprojection.as_ref());
        let ids: Vec<u64> = self.objects.keys().copied().collect();
        for id in ids {
            let Some(known) = self.objects.get_mut(&id) else { continue };
            match reprojection.as_ref().and_then(|r| r.apply(known.place_m)) {
                Some(place_m) => (known.place_m, known.noted_m) = (place_m, place_m),
                None => {
                    self.drop_object(id, Reason::OutOfZone, now);
                    self.dropped.out_of_zone += 1;
                }
            }
        }
        self.index = Index::of(self.objects.values().map(Known::indexed));
        self.mark_all_changed();
    }

    /// The detections that pass the edge, in an order that does not depend on the order they came in.
    fn sightings(&mut self, snapshot: &Snapshot, detections: &[Detection]) -> Vec<Sighting> {
        let mut sightings = Vec::with_capacity(detections.len());
        for detection in detections {
            match Sighting::parse(detection, snapshot.vehicle_m, &self.config) {
                Ok(sighting) => sightings.push(sighting),
                Err(refusal) => self.dropped.count(refusal),
            }
        }
        sightings.sort_by(Sighting::order);
        sightings
    }

    fn candidates(&self, sightings: &[Sighting]) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        for (sighting, s) in sightings.iter().enumerate() {
            for known in self.near(Some(s.class), s.place_m, self.config.gate_max_m) {
                let distance_m = distance_m(known.place_m, s.place_m);
                let reach_m = common_reach_m(s.class, known.dbh, s.dbh);
                let gate_m = gate_m(known.position_std_m, s.position_std_m, reach_m, &self.config);
                if distance_m <= gate_m {
                    candidates.push(Candidate { distance_m, id: known.id, sighting });
                }
            }
        }
        candidates
    }

    fn absorb(&mut self, sightings: &[Sighting], pairs: &[Candidate], stamp: Timestamp) -> Vec<u64> {
        for pair in pairs {
            if let Some(known) = self.objects.get_mut(&pair.id) {
                let before_m = known.place_m;
                let sighting = &sightings[pair.sighting];
                known.absorb(sighting, sighting.seen(stamp), &self.config);
                self.index.shift(known.class, pair.id, before_m, known.place_m);
                self.changed.insert(pair.id);
            }
        }
        pairs.iter().map(|p| p.id).collect()
    }

    fn create(&mut self, sightings: &[Sighting], pairs: &[Candidate], stamp: Timestamp) -> Vec<u64> {
        let absorbed: BTreeSet<usize> = pairs.iter().map(|p| p.sighting).collect();
        let mut created = Vec::new();
        for (_, sighting) in sightings.iter().enumerate().filter(|(i, _)| !absorbed.contains(i)) {
            let id = self.next_id;
            self.next_id += 1;
            self.index.insert(sighting.class, id, sighting.place_m);
            self.objects.insert(id, Known::first(id, sighting, sighting.seen(stamp)));
            self.changed.insert(id);
            self.registration.made(id);
            self.note(id, Reason::FirstSeen, stamp);
            created.push(id);
        }
        created
    }

    /// Objects of one class that one snapshot saw within each other's gate are two things.
    fn remember_companions(&mut self, seen: &BTreeSet<u64>) {
        for id in seen {
            let beside: Vec<u64> = self.within_gate(*id).filter(|o| seen.contains(&o.id)).map(|o| o.id).collect();
            let Some(known) = self.objects.get(id).filter(|o| beside.iter().any(|b| !o.companions.contains(b))) else {
                continue;
            };
            let mut companions = known.companions.clone();
            companions.retain(|other| self.objects.contains_key(other));
            if let Some(known) = self.objects.get_mut(id) {
                known.companions = companions;
                beside.iter().for_each(|other| known.accompany(*other));
            }
        }
    }

    /// Objects near the vehicle that were not seen lose what the view of their place takes from them.
    fn contradict(&mut self, snapshot: &Snapshot, seen: &BTreeSet<u64>, view: impl Fn([f64; 2]) -> View) -> usize {
        // What is seen where cannot be said while the pose contradicts the stored trees.
        if self.registration.is_in_doubt() {
            return 0;
        }
        let (correction, vehicle_m) = (self.registration.correction(), snapshot.vehicle_m);
        let near: Vec<(u64, View)> = self
            .near(None, correction.vehicle(vehicle_m), self.config.well_seen_m)
            .filter(|o| !seen.contains(&o.id))
            .map(|o| (o.id, view(correction.undo(vehicle_m, o.place_m))))
            .collect();
        let mut contradicted = 0;
        for (id, view) in near {
            let Some(known) = self.objects.get_mut(&id) else { continue };
            if known.contradict(view, snapshot.stamp, &self.config) {
                self.changed.insert(id);
                self.look_at(id, snapshot.stamp);
                contradicted += 1;
            }
        }
        contradicted
    }

    /// Objects that have come to lie within each other's gate, and were never seen side by side, are one: the older
    /// id stays.
    fn unite(&mut self, seen: &BTreeSet<u64>, now: Timestamp) -> usize {
        let mut united = 0;
        for id in seen {
            while let Some((older, younger)) = self.same_as(*id) {
                let Some(other) = self.objects.get(&younger).cloned() else { break };
                self.drop_object(younger, Reason::PartOf(older), now);
                if let Some(known) = self.objects.get_mut(&older) {
                    let before_m = known.place_m;
                    known.unite(&other, now, &self.config);
                    self.index.shift(known.class, older, before_m, known.place_m);
                    self.changed.insert(older);
                }
                self.note(older, Reason::United(younger), now);
                united += 1;
                if younger == *id {
                    break; // It lives on under the older id, which this loop meets only if it was seen too.
                }
            }
        }
        united
    }

    /// The nearest object that is the same thing as `id`: (older id, younger id).
    fn same_as(&self, id: u64) -> Option<(u64, u64)> {
        let known = self.objects.get(&id)?;
        let same = self.within_gate(id).filter(|o| !o.is_beside(known));
        let distance = |o: &Known| distance_m(o.place_m, known.place_m);
        let other = same.min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.id.cmp(&b.id)))?;
        Some((id.min(other.id), id.max(other.id)))
    }

    /// Other objects of its class within the gate of an object.
    fn within_gate(&self, id: u64) -> impl Iterator<Item = &Known> {
        let known = self.objects.get(&id);
        known.into_iter().flat_map(move |known| {
            self.near(Some(known.class), known.place_m, self.config.gate_max_m).filter(move |o| {
                let reach_m = common_reach_m(o.class, o.dbh, known.dbh);
                let gate_m = gate_m(o.position_std_m, known.position_std_m, reach_m, &self.config);
                o.id != known.id && distance_m(o.place_m, known.place_m) <= gate_m
            })
        })
    }

    /// Moves objects that were stored while the pose was in doubt, and unites them with those they turn out to be.
    pub(crate) fn shift(&mut self, ids: &BTreeSet<u64>, offset_m: [f64; 2], now: Timestamp) {
        let mut shifted = BTreeSet::new();
        for id in ids {
            let Some(known) = self.objects.get_mut(id) else { continue };
            let before_m = known.place_m;
            known.place_m = plus(before_m, offset_m);
            known.noted_m = known.place_m;
            self.index.shift(known.class, *id, before_m, known.place_m);
            self.changed.insert(*id);
            self.note(*id, Reason::Registered, now);
            shifted.insert(*id);
        }
        self.unite(&shifted, now);
    }

    pub(crate) fn remove(&mut self, id: u64) {
        if let Some(known) = self.objects.remove(&id) {
            self.index.remove(known.class, id, known.place_m);
            self.changed.remove(&id);
            self.removed.insert(id);
        }
    }

    pub(crate) fn near(&self, class: Option<Class>, place_m: [f64; 2], radius_m: f64) -> impl Iterator<Item = &Known> {
        self.index.near(class, place_m, radius_m).filter_map(|id| self.objects.get(&id))
    }
}
