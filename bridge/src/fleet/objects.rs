//! The objects of the vehicle's store as a log of changes, from the answers of the service `store`.
//!
//! In: the store's reported objects page by page, by id, at the store's own places; the instant. Out: a
//! [`ChangeLog`] of those that changed enough to tell. An id that an answer should have held and did not is gone. The
//! store's numbers decay and wander a little all the time, so only what a reader would notice is a change.

use super::log::ChangeLog;
use tsense_contract::{FleetObject, Object, ObjectsHeader, StoreQuery};
use tsense_geometry::Timestamp;

/// An object that is seen again and stays as it was is told again after this time, seconds: its last sighting.
const SEEN_AGAIN_S: f64 = 60.0;
/// Changes below these are none: place and ground, diameter, height, metres.
const PLACE_M: f64 = 0.02;
const GROUND_M: f64 = 0.05;
const DBH_M: f32 = 0.01;
const HEIGHT_M: f32 = 0.1;
/// Deviations and confidences change by this share before they are told.
const SHARE: f32 = 0.2;

/// What the vehicle tells of its objects.
#[derive(Clone, Debug)]
pub struct Objects {
    log: ChangeLog<u64, FleetObject>,
    zone: (u8, u8),
    after_id: u64,
    /// Whether the walk came to its end once in this epoch: before, what is not in the log is not known to be gone.
    is_complete: bool,
}

impl Objects {
    /// None yet.
    pub fn new(epoch: u64) -> Self {
        Self { log: ChangeLog::new(epoch), zone: (0, 0), after_id: 0, is_complete: false }
    }

    /// The changes.
    pub fn log(&self) -> &ChangeLog<u64, FleetObject> {
        &self.log
    }

    /// Whether the log holds all that the store reports: it is told only then.
    pub fn is_complete(&self) -> bool {
        self.is_complete
    }

    /// Zone and hemisphere of the places; zone 0 before there is any.
    pub fn zone(&self) -> (u8, u8) {
        self.zone
    }

    /// What to ask the store next: a walk over all of its reported objects in the order of their ids, again and again.
    pub fn query(&self) -> StoreQuery {
        StoreQuery { by_id: 1, after_id: self.after_id, ..StoreQuery::everything() }
    }

    /// Takes the answer to [`Self::query`]; how many objects changed.
    pub fn take(&mut self, header: &ObjectsHeader, answer: &[Object], now: Timestamp) -> usize {
        let zone = (header.zone, header.south);
        // A store without a zone is empty, or has not read its file yet: it says nothing about what is gone.
        if header.zone == 0 {
            return 0;
        }
        if self.zone != zone {
            (self.zone, self.after_id, self.is_complete) = (zone, 0, false);
            self.log.start_epoch();
            return 0;
        }
        let last_id = answer.last().map_or(u64::MAX, |o| if header.truncated == 1 { o.id } else { u64::MAX });
        let head = self.log.head();
        let gone: Vec<u64> =
            self.listed(last_id).filter(|id| answer.binary_search_by_key(id, |o| o.id).is_err()).collect();
        gone.iter().for_each(|id| self.log.remove(id));
        for object in answer.iter().filter(|o| o.reported == 1) {
            if self.log.get(&object.id).is_none_or(|told| is_worth_telling(&told.object, object)) {
                let told = FleetObject { number: 0, weighed_ns: now.ns, object: *object };
                self.log.put(object.id, told);
            }
        }
        self.after_id = if last_id == u64::MAX { 0 } else { last_id };
        self.is_complete |= last_id == u64::MAX;
        (self.log.head() - head) as usize
    }

    /// Ids that were told, above the cursor of the walk and up to `last_id`.
    fn listed(&self, last_id: u64) -> impl Iterator<Item = u64> {
        let from = self.after_id.saturating_add(1);
        self.log.from(from).map(|(id, _)| *id).take_while(move |id| *id <= last_id)
    }
}

/// Whether a reader who knows `told` would notice.
fn is_worth_telling(told: &Object, now: &Object) -> bool {
    let moved_m = (told.easting_m - now.easting_m).hypot(told.northing_m - now.northing_m);
    let seen_again_s = Timestamp::from_ns(now.last_seen_ns).seconds_since(Timestamp::from_ns(told.last_seen_ns));
    moved_m > PLACE_M
        || (told.ground_m - now.ground_m).abs() > GROUND_M
        || differs(told.dbh_m, now.dbh_m, DBH_M)
        || differs(told.height_m, now.height_m, HEIGHT_M)
        || differs(told.dbh_std_m, now.dbh_std_m, SHARE * told.dbh_std_m)
        || differs(told.position_std_m, now.position_std_m, SHARE * told.position_std_m)
        || differs(told.confidence, now.confidence, SHARE * told.confidence)
        || (told.class, told.first_seen_ns) != (now.class, now.first_seen_ns)
        || seen_again_s >= SEEN_AGAIN_S
}

/// By more than `least`, or measured only once.
fn differs(told: f32, now: f32, least: f32) -> bool {
    told.is_nan() != now.is_nan() || (told - now).abs() > least
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    fn tree(id: u64) -> Object {
        Object {
            id,
            easting_m: 500_000.0 + id as f64,
            position_std_m: 0.05,
            dbh_m: 0.3,
            dbh_std_m: f32::NAN,
            height_m: f32::NAN,
            confidence: 2.0,
            reported: 1,
            ..Object::zeroed()
        }
    }

    fn header(zone: u8, truncated: u8) -> ObjectsHeader {
        ObjectsHeader { zone, truncated, ..ObjectsHeader::zeroed() }
    }

    fn told(objects: &Objects) -> Vec<(u64, bool)> {
        objects.log().after(0, 99).map(|(_, id, value)| (*id, value.is_some())).collect()
    }

    #[test]
    fn an_id_that_an_answer_should_have_held_is_gone() {
        let mut objects = Objects::new(1);
        let now = Timestamp::from_ns(1);
        objects.take(&header(17, 0), &[], now);
        assert_eq!(objects.take(&header(17, 1), &[tree(1), tree(2)], now), 2);
        assert!(!objects.is_complete());
        assert_eq!(objects.take(&header(17, 0), &[tree(5)], now), 1);
        assert!(objects.is_complete());
        assert_eq!(objects.take(&header(17, 1), &[tree(1), tree(3)], now), 2);
        assert_eq!(objects.query().after_id, 3);
        assert_eq!(told(&objects), [(1, true), (5, true), (2, false), (3, true)]);
        assert_eq!(objects.take(&header(17, 0), &[], now), 1);
        assert_eq!((told(&objects).last(), objects.query().after_id), (Some(&(5, false)), 0));
    }

    #[test]
    fn a_store_that_was_just_started_says_nothing_and_another_zone_says_all_anew() {
        let mut objects = Objects::new(1);
        let now = Timestamp::from_ns(1);
        // The first zone is news, too: the walk starts again in it.
        assert_eq!(objects.take(&header(17, 0), &[tree(1), tree(2)], now), 0);
        assert_eq!(objects.take(&header(17, 0), &[tree(1), tree(2)], now), 2);
        assert_eq!(objects.take(&header(0, 0), &[], now), 0);
        assert_eq!((objects.log().epoch(), objects.is_complete()), (2, true));
        objects.take(&header(18, 0), &[tree(1)], now);
        assert_eq!((objects.log().epoch(), objects.zone(), objects.is_complete()), (3, (18, 0), false));
        objects.take(&header(18, 0), &[tree(1)], now);
        assert_eq!((told(&objects), objects.is_complete()), (vec![(1, true), (2, false)], true));
    }

    #[test]
    fn what_nobody_would_notice_is_no_change() {
        let changed = |new: Object| is_worth_telling(&tree(1), &new);
        let old = tree(1);
        let same = Object { easting_m: old.easting_m + 0.01, confidence: 2.3, last_seen_ns: 59_000_000_000, ..old };
        assert!(!changed(same) && !changed(old));
        let notable = [
            Object { easting_m: old.easting_m + 0.03, ..old },
            Object { confidence: 2.5, ..old },
            Object { height_m: 9.0, ..old },
            Object { dbh_m: 0.32, ..old },
            Object { position_std_m: 0.03, ..old },
            Object { last_seen_ns: 61_000_000_000, ..old },
            Object { class: 2, ..old },
        ];
        assert_eq!(notable.map(changed), [true; 7]);
    }
}
