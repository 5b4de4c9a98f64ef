//! Which sighting belongs to which object, and what becomes of the two.
//!
//! In: sightings of one snapshot and stored objects, UTM metres of one zone. Out: pairs, and fused objects.
//! Source: thesis, local knowledge store: "the nearest stored object within 0.3 m absorbs it: position averaged by
//! confidence, confidences added"; the averages here weigh by confidence over variance, and the gate grows with both
//! positions' deviations between `gate_m` and `gate_max_m`.

use crate::config::Config;
use crate::object::{COMPANIONS_MAX, Estimate, Known, Sighting};
use tsense_contract::Class;
use tsense_geometry::Timestamp;

/// Largest distance between two positions of one thing, metres. `reach_m`: how far it reaches across, 0 where that
/// says nothing.
pub fn gate_m(std_a_m: f64, std_b_m: f64, reach_m: f64, config: &Config) -> f64 {
    let gate_m = (config.gate_sigma * std_a_m.hypot(std_b_m)).max(config.gate_reach_share * reach_m);
    gate_m.clamp(config.gate_m, config.gate_max_m)
}

/// How far both of two things reach across, metres. The middle of a patch of brush or of a wide rock is wherever this
/// snapshot saw most of it; the axis of a trunk is not.
pub fn common_reach_m(class: Class, a: Option<Estimate>, b: Option<Estimate>) -> f64 {
    match (class, a, b) {
        (Class::Tree, ..) | (_, None, _) | (_, _, None) => 0.0,
        (_, Some(a), Some(b)) => a.value.min(b.value),
    }
}

/// A possible pair: how far apart, which object, which sighting (index into the snapshot's sightings).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Metres.
    pub distance_m: f64,
    /// Id of the object.
    pub id: u64,
    /// Index of the sighting.
    pub sighting: usize,
}

/// Nearest pair first, each object and each sighting in at most one pair. Ties go to the older object, then to the
/// earlier sighting, so the result depends on the sets only.
pub fn nearest_first(mut candidates: Vec<Candidate>) -> Vec<Candidate> {
    let order = |a: &Candidate, b: &Candidate| {
        a.distance_m.total_cmp(&b.distance_m).then(a.id.cmp(&b.id)).then(a.sighting.cmp(&b.sighting))
    };
    candidates.sort_by(order);
    let mut objects = std::collections::BTreeSet::new();
    let mut sightings = std::collections::BTreeSet::new();
    candidates.retain(|c| {
        let free = !objects.contains(&c.id) && !sightings.contains(&c.sighting);
        if free {
            objects.insert(c.id);
            sightings.insert(c.sighting);
        }
        free
    });
    candidates
}

/// A value and its weight (confidence over variance): averages add weights.
#[derive(Clone, Copy)]
struct Weighted {
    value: f64,
    weight: f64,
}

impl Weighted {
    fn of(e: Estimate) -> Self {
        Self { value: e.value, weight: e.std.powi(-2) }
    }
    fn by(self, share: f64) -> Self {
        Self { weight: self.weight * share, ..self }
    }
    fn and(self, other: Self) -> Self {
        let weight = self.weight + other.weight;
        Self { value: self.value + (other.value - self.value) * (other.weight / weight), weight }
    }
    fn estimate(self, floor: f64) -> Estimate {
        Estimate { value: self.value, std: self.weight.powf(-0.5).max(floor) }
    }
}

/// Two estimates in one; where only one is known it stands as it is.
fn fuse(a: Option<Estimate>, b: Option<Estimate>, share_of_b: f64, floor: f64) -> Option<Estimate> {
    match (a, b) {
        (Some(a), Some(b)) => Some(Weighted::of(a).and(Weighted::of(b).by(share_of_b)).estimate(floor)),
        (None, Some(b)) if share_of_b > 0.0 => Some(Estimate { std: b.std / share_of_b.sqrt(), ..b }),
        (a, _) => a,
    }
}

/// A mean of two values that may be missing, by weights.
fn mean(a: Option<f64>, b: Option<f64>, share_of_b: f64) -> Option<f64> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a + (b - a) * share_of_b),
        (a, b) => a.or(b),
    }
}

impl Known {
    /// Takes in a sighting of the same thing.
    pub fn absorb(&mut self, s: &Sighting, stamp: Timestamp, config: &Config) {
        let before = self.confidence_at(stamp, config);
        let share = self.confirm(s.confidence, stamp, config);
        let gained = share * s.confidence;
        if gained <= 0.0 {
            return; // The same instant again: nothing new is known.
        }
        self.move_towards(s.place_m, s.position_std_m, gained, config);
        self.dbh = fuse(self.dbh, s.dbh, gained, config.dbh_std_floor_m);
        let share_of_new = gained / (before + gained);
        self.height_m = mean(self.height_m, s.height_m, share_of_new);
        self.ground_m += (s.ground_m - self.ground_m) * share_of_new;
    }

    /// Takes over everything known of `other`, which turned out to be the same thing. Their sightings may come of the
    /// same sweeps, so independent ones are not added.
    pub fn unite(&mut self, other: &Self, now: Timestamp, config: &Config) {
        let (mine, its) = (self.confidence_at(now, config), other.confidence_at(now, config));
        let share_of_other = if mine + its > 0.0 { its / (mine + its) } else { 0.5 };
        self.move_towards(other.place_m, other.position_std_m, 1.0, config);
        self.dbh = fuse(self.dbh, other.dbh, 1.0, config.dbh_std_floor_m);
        self.height_m = mean(self.height_m, other.height_m, share_of_other);
        self.ground_m += (other.ground_m - self.ground_m) * share_of_other;
        self.confidence = (mine + its).min(config.confidence_max);
        self.weighed = self.weighed.max(now);
        self.first_seen = self.first_seen.min(other.first_seen);
        self.last_seen = self.last_seen.max(other.last_seen);
        self.sightings = self.sightings.saturating_add(other.sightings);
        self.independent = self.independent.max(other.independent);
        self.independent_at = self.independent_at.max(other.independent_at);
        other.companions.iter().for_each(|id| self.accompany(*id));
    }

    /// Remembers that `id` is another thing, seen beside this one in one snapshot.
    pub fn accompany(&mut self, id: u64) {
        if let Err(at) = self.companions.binary_search(&id)
            && id != self.id
            && self.companions.len() < COMPANIONS_MAX
        {
            self.companions.insert(at, id);
        }
    }

    /// True where the two were seen side by side.
    pub fn is_beside(&self, other: &Self) -> bool {
        self.companions.binary_search(&other.id).is_ok() || other.companions.binary_search(&self.id).is_ok()
    }

    fn move_towards(&mut self, place_m: [f64; 2], std_m: f64, share: f64, config: &Config) {
        let along = |axis: usize| {
            let old = Weighted::of(Estimate { value: self.place_m[axis], std: self.position_std_m });
            let new = Weighted::of(Estimate { value: place_m[axis], std: std_m });
            old.and(new.by(share)).estimate(config.position_std_floor_m)
        };
        let [east, north] = [along(0), along(1)];
        self.place_m = [east.value, north.value];
        self.position_std_m = east.std;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{at, known, sighting};

    #[test]
    fn the_gate_is_three_tenths_of_a_metre_and_grows_with_both_deviations() {
        let config = Config::default();
        assert_eq!(gate_m(0.03, 0.04, 0.0, &config), 0.3); // 3 * 0.05 = 0.15
        assert!((gate_m(0.12, 0.16, 0.0, &config) - 0.6).abs() < 1e-12); // 3 * 0.20
        assert_eq!(gate_m(3.0, 4.0, 0.0, &config), 1.0);
    }

    #[test]
    fn the_gate_of_a_patch_is_a_quarter_of_the_smaller_reach_and_a_trunk_has_none() {
        let config = Config::default();
        let wide = |value| Some(Estimate { value, std: 0.1 });
        let gate = |class| gate_m(0.05, 0.05, common_reach_m(class, wide(2.0), wide(3.0)), &config);
        assert_eq!([Class::Brush, Class::Tree].map(gate), [0.5, 0.3]);
        assert_eq!(common_reach_m(Class::Rock, wide(2.0), None), 0.0);
    }

    /// Stored: std 0.05, weight 400. Seen: std 0.1, confidence 0.5, fully independent: weight 0.5 * 100 = 50.
    /// Place 10 + 0.09 * 50/450 = 10.01; std 1/sqrt(450) = 0.04714; confidence 0.5 + 0.5.
    #[test]
    fn a_sighting_moves_the_object_by_confidence_over_variance() {
        let config = Config::default();
        let mut tree = known(1, 10.0, 20.0);
        tree.position_std_m = 0.05;
        let mut seen = sighting(10.09, 20.0);
        seen.position_std_m = 0.1;
        tree.absorb(&seen, at(2.0), &config);
        assert!((tree.place_m[0] - 10.01).abs() < 1e-9, "{:?}", tree.place_m);
        assert!((tree.place_m[1] - 20.0).abs() < 1e-9);
        assert!((tree.position_std_m - 450.0_f64.powf(-0.5)).abs() < 1e-9);
        assert!((tree.confidence - 1.0).abs() < 0.002); // less two seconds of decay of the first half
    }

    /// Diameters 0.30 +- 0.02 (weight 2500) and 0.36 +- 0.04 at confidence 0.5 (weight 0.5 * 625 = 312.5):
    /// 0.30 + 0.06 * 312.5/2812.5 = 0.306667 +- 1/sqrt(2812.5) = 0.018856.
    #[test]
    fn diameters_are_fused_by_their_deviations_and_missing_ones_change_nothing() {
        let config = Config::default();
        let mut tree = known(1, 0.0, 0.0);
        tree.dbh = Some(Estimate { value: 0.30, std: 0.02 });
        let mut seen = sighting(0.0, 0.0);
        seen.dbh = Some(Estimate { value: 0.36, std: 0.04 });
        seen.height_m = None;
        tree.height_m = Some(12.0);
        tree.absorb(&seen, at(2.0), &config);
        let dbh = tree.dbh.unwrap();
        assert!((dbh.value - 0.306_666_67).abs() < 1e-7 && (dbh.std - 0.018_856_18).abs() < 1e-7, "{dbh:?}");
        assert_eq!(tree.height_m, Some(12.0));
        seen.dbh = None;
        tree.absorb(&seen, at(4.0), &config);
        assert_eq!(tree.dbh, Some(dbh));
    }

    #[test]
    fn a_deviation_never_falls_below_its_floor() {
        let config = Config::default();
        let mut tree = known(1, 0.0, 0.0);
        for i in 1..=10_000 {
            tree.absorb(&sighting(0.0, 0.0), at(f64::from(i) * 2.0), &config);
        }
        assert_eq!(tree.position_std_m, config.position_std_floor_m);
        assert_eq!(tree.confidence, config.confidence_max);
    }

    #[test]
    fn the_nearest_pair_is_taken_first_and_each_side_only_once() {
        let pair = |distance_m, id, sighting| Candidate { distance_m, id, sighting };
        let pairs = nearest_first(vec![pair(0.2, 1, 0), pair(0.1, 1, 1), pair(0.25, 2, 0), pair(0.05, 3, 2)]);
        assert_eq!(pairs, vec![pair(0.05, 3, 2), pair(0.1, 1, 1), pair(0.25, 2, 0)]);
    }

    #[test]
    fn two_that_are_one_keep_the_first_sighting_and_add_their_confidences() {
        let config = Config::default();
        let (mut a, mut b) = (known(1, 0.0, 0.0), known(2, 0.1, 0.0));
        (b.first_seen, b.last_seen, b.weighed) = (at(10.0), at(10.0), at(10.0));
        a.weighed = at(10.0);
        (a.independent, b.independent) = (2, 2);
        a.unite(&b, at(10.0), &config);
        assert!((a.place_m[0] - 0.05).abs() < 1e-12);
        assert!((a.confidence - 1.0).abs() < 1e-12);
        assert_eq!((a.first_seen, a.last_seen, a.sightings, a.independent), (at(0.0), at(10.0), 2, 2));
    }
}
