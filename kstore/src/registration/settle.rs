//! How the store confirms where the vehicle is, finds it anew, and follows slow drift: snapshot by snapshot.
//!
//! In: the sightings of a snapshot. Out: the same, moved to where the stored trees say they are, and
//! the store's registration, which says how surely.

use super::AGREE_M;
use crate::consensus::{Consensus, Landmark, TURN_MAX_RAD, consensus, pairs, rigid};
use crate::correction::{Correction, distance_m};
use crate::object::{Known, Sighting};
use crate::records::Snapshot;
use crate::store::KnowledgeStore;
use std::collections::BTreeSet;
use tsense_contract::Class;
use tsense_geometry::Timestamp;

/// Trees that must agree before a pose is believed or moved: four may stand alike by chance.
const AGREE_MIN: usize = 5;
/// Share of the trees in sight near stored ones that agree where the pose is right.
const AGREE_SHARE: f64 = 0.6;
/// The best move has this many times the agreement of any other one.
const CLEARLY: f64 = 1.4;
/// Trees in sight that take part, the nearest first: more make it slower and no surer.
const SEEN_MAX: usize = 60;
/// Loose objects within this distance of the vehicle take part beside what is in sight, metres.
const LOOSE_NEAR_M: f64 = 30.0;
/// Trees known for less than this are no anchors for slow drift, seconds: they stand where the pose of a moment ago put
/// them, and a chain of such would turn an error of heading into one of place.
const ANCHOR_AGE_S: f64 = 60.0;
/// After this long without a snapshot the pose may have been begun anew, seconds.
const SESSION_GAP_S: f64 = 60.0;

/// How many trees in sight stand near a stored one, and how many stand on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Agreement {
    near: usize,
    on: usize,
}

impl Agreement {
    fn is_good(self) -> bool {
        self.on >= AGREE_MIN && self.on as f64 >= AGREE_SHARE * self.near as f64
    }
    fn is_poor(self) -> bool {
        self.near >= AGREE_MIN && !self.is_good()
    }
}

impl KnowledgeStore {
    /// Moves the sightings of a snapshot to where the stored trees say they are.
    pub(crate) fn register(&mut self, snapshot: &Snapshot, sightings: &mut [Sighting]) {
        if self.config.registration_reach_m <= 0.0 {
            return;
        }
        let elapsed_s = self.begin_session(snapshot);
        let vehicle_m = snapshot.vehicle_m;
        let seen = trees(sightings, vehicle_m);
        self.settle(&seen, vehicle_m, snapshot.stamp);
        self.follow(&seen, vehicle_m, snapshot.stamp, elapsed_s);
        let correction = self.registration.correction;
        for sighting in sightings {
            sighting.place_m = correction.apply(vehicle_m, sighting.place_m);
        }
    }

    /// Notes a new session; returns the time since the last snapshot.
    fn begin_session(&mut self, snapshot: &Snapshot) -> f64 {
        let last = self.registration.last.replace((snapshot.epoch, snapshot.stamp, snapshot.vehicle_m));
        let elapsed_s = last.map_or(f64::INFINITY, |(_, stamp, _)| snapshot.stamp.seconds_since(stamp).abs());
        if elapsed_s > SESSION_GAP_S || last.is_some_and(|(epoch, _, _)| epoch != snapshot.epoch) {
            // What was not yet believed in is no landmark: it may come to be seen from the new pose only.
            let config = &self.config;
            let candidates = self.objects.values().filter(|o| !o.is_established(config));
            self.registration.loose = candidates.map(|o| o.id).collect();
            // Where no tree is known there is nothing to compare with: the first pose says where things are.
            self.registration.firm = !self.objects.values().any(|o| o.class == Class::Tree && o.is_established(config));
        }
        elapsed_s
    }

    /// Confirms the correction, or finds the one that the trees agree with, or leaves it in doubt.
    fn settle(&mut self, seen: &[Landmark], vehicle_m: [f64; 2], now: Timestamp) {
        let seen = self.placed(seen, vehicle_m);
        let all = self.anchors(&seen, |_| true);
        let agreement = self.agreement(&seen, &all);
        self.registration.in_doubt = agreement.is_poor();
        if !self.registration.firm {
            self.confirm(&seen, vehicle_m, now);
        }
        if self.registration.in_doubt {
            match self.clear(&seen, &all, vehicle_m) {
                Some(found) => self.registration.go_by(&found),
                None => self.registration.firm = false,
            }
        }
    }

    /// Compares what is in sight and what is loose with what is not: they confirm where the vehicle is, or the loose
    /// ones move along to where it is and are united with those they turn out to be.
    fn confirm(&mut self, seen: &[Landmark], vehicle_m: [f64; 2], now: Timestamp) {
        let seen = self.with_loose(seen, vehicle_m);
        let firm = self.anchors(&seen, |o| !self.registration.loose.contains(&o.id));
        let found = self.clear(&seen, &firm, vehicle_m);
        if found.is_none() && !self.agreement(&seen, &firm).is_good() {
            return;
        }
        let found = found.unwrap_or_default();
        let loose = std::mem::take(&mut self.registration.loose);
        self.registration.go_by(&found);
        self.registration.firm = true;
        self.shift(&loose, found.offset_m, now);
    }

    /// The move that lays what is in sight on what is stored, if no other comes near it.
    fn clear(&self, seen: &[Landmark], stored: &[Landmark], vehicle_m: [f64; 2]) -> Option<Correction> {
        let about_m = self.registration.correction.vehicle(vehicle_m);
        let found = consensus(seen, stored, about_m, self.config.registration_reach_m, AGREE_M)?;
        self.is_clear(&found, seen, stored).then_some(found.correction)
    }

    fn is_clear(&self, found: &Consensus, seen: &[Landmark], stored: &[Landmark]) -> bool {
        let Agreement { near, .. } = self.agreement(seen, stored);
        found.agreed >= AGREE_MIN
            && found.agreed as f64 >= CLEARLY * found.runner_up as f64
            && 2 * found.agreed >= near
            && self.registration.correction.then(&found.correction).length_m() <= 2.0 * self.config.registration_reach_m
    }

    /// Follows the mean offset of the trees in sight that have been known for a while, and forgets slowly.
    fn follow(&mut self, seen: &[Landmark], vehicle_m: [f64; 2], now: Timestamp, elapsed_s: f64) {
        let correction = self.registration.correction;
        let seen = self.placed(seen, vehicle_m);
        let old = self.anchors(&seen, |o| now.seconds_since(o.first_seen) >= ANCHOR_AGE_S);
        let pairs = pairs(&seen, &old, [0.0; 2], &Correction::default(), AGREE_M);
        let approach = |constant_s: f64| 1.0 - (-elapsed_s / constant_s).exp();
        let kept = correction.share(1.0 - approach(self.config.registration_fade_s));
        let step = if pairs.len() >= AGREE_MIN { rigid(&pairs, correction.vehicle(vehicle_m)) } else { None };
        let next = match step {
            // The first snapshot after a long time: what fades is the past, what is in sight counts in full.
            Some(step) if elapsed_s > SESSION_GAP_S => correction.then(&step),
            Some(step) => kept.then(&step.share(approach(self.config.registration_follow_s))),
            None => kept,
        };
        if next.turn_rad.abs() <= TURN_MAX_RAD && next.length_m() <= 2.0 * self.config.registration_reach_m {
            self.registration.correction = next;
        }
    }

    fn placed(&self, seen: &[Landmark], vehicle_m: [f64; 2]) -> Vec<Landmark> {
        let correction = self.registration.correction;
        seen.iter().map(|t| Landmark { place_m: correction.apply(vehicle_m, t.place_m), ..*t }).collect()
    }

    /// Established trees within reach of what is in sight, of those that `may_count`.
    fn anchors(&self, seen: &[Landmark], may_count: impl Fn(&Known) -> bool) -> Vec<Landmark> {
        let reach_m = self.config.registration_reach_m;
        let near: BTreeSet<u64> =
            seen.iter().flat_map(|t| self.index.near(Some(Class::Tree), t.place_m, reach_m)).collect();
        let trees = near.iter().filter_map(|id| self.objects.get(id));
        trees.filter(|o| o.is_established(&self.config) && may_count(o)).map(Known::landmark).collect()
    }

    fn agreement(&self, seen: &[Landmark], stored: &[Landmark]) -> Agreement {
        let reach_m = self.config.registration_reach_m;
        let nearest_m = |t: &Landmark| stored.iter().map(|s| distance_m(s.place_m, t.place_m)).fold(f64::MAX, f64::min);
        let distances: Vec<f64> = seen.iter().map(nearest_m).collect();
        let within = |m: f64| distances.iter().filter(|d| **d <= m).count();
        Agreement { near: within(reach_m), on: within(AGREE_M) }
    }

    /// What is in sight, and the loose trees around: together they may suffice where either does not.
    fn with_loose(&self, seen: &[Landmark], vehicle_m: [f64; 2]) -> Vec<Landmark> {
        let middle = self.registration.correction.vehicle(vehicle_m);
        let mut loose: Vec<&Known> = self
            .near(Some(Class::Tree), middle, LOOSE_NEAR_M)
            .filter(|o| self.registration.loose.contains(&o.id))
            .filter(|o| seen.iter().all(|t| distance_m(t.place_m, o.place_m) > AGREE_M))
            .collect();
        loose.sort_by_key(|o| o.id);
        seen.iter().copied().chain(loose.into_iter().map(Known::landmark)).take(2 * SEEN_MAX).collect()
    }
}

impl Known {
    fn landmark(&self) -> Landmark {
        Landmark { place_m: self.place_m, dbh: self.dbh }
    }
}

/// The trees among the sightings, nearest to the vehicle first.
fn trees(sightings: &[Sighting], vehicle_m: [f64; 2]) -> Vec<Landmark> {
    let mut trees: Vec<&Sighting> = sightings.iter().filter(|s| s.class == Class::Tree).collect();
    trees.sort_by(|a, b| distance_m(a.place_m, vehicle_m).total_cmp(&distance_m(b.place_m, vehicle_m)));
    trees.iter().take(SEEN_MAX).map(|s| Landmark { place_m: s.place_m, dbh: s.dbh }).collect()
}
