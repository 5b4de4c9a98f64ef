//! Confidence over time: growth by independent sightings, exponential decay, and faster decay by contrary evidence.
//!
//! In: an object, an instant (graph clock, epoch based, so that decay runs on while nothing runs), and what was seen.
//! Out: the object with its confidence weighed up to that instant.
//! Source: thesis, local knowledge store: "confidences added", exponential decay with a long time constant.
//!
//! Every stretch of time is counted once, for or against: snapshots arrive several a second from one sweep, so a
//! sighting counts by the share of the independence time that has passed since evidence was last weighed.
//! Seen in a share h of the snapshots, with confidence c each, an object therefore settles at
//! h c unconfirmed_s / ((1 - h) independence_s): 0.6 seen half of the time settles at 2.4, one time in four at 0.8.

use crate::config::Config;
use crate::object::Known;
use tsense_contract::{CellClass, Class};
use tsense_geometry::Timestamp;

/// What a snapshot says of a place where an object is believed to stand and was not detected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// Nothing: out of sight, behind something, too old.
    Unseen,
    /// The place was seen, and the object was not recognised.
    Unconfirmed,
    /// The place was seen, the object was not recognised, and something of this kind lies there.
    Holds(CellClass),
    /// Bare ground lies where the object should stand.
    BareGround,
}

impl Known {
    /// Time constant of this object's decay, seconds.
    pub fn time_constant_s(&self, config: &Config) -> f64 {
        let constants = &config.time_constant;
        if self.is_established(config) { constants.of(self.class) } else { constants.candidate_s }
    }

    /// Confidence decayed to `now`; before `weighed` it is what it was then.
    pub fn confidence_at(&self, now: Timestamp, config: &Config) -> f64 {
        let elapsed_s = now.seconds_since(self.weighed).max(0.0);
        self.confidence * (-elapsed_s / self.time_constant_s(config)).exp()
    }

    /// Share of the independence time that has passed since evidence was last weighed, 0 to 1.
    pub fn independence(&self, now: Timestamp, config: &Config) -> f64 {
        (now.seconds_since(self.weighed) / config.independence_s).clamp(0.0, 1.0)
    }

    /// Adds a sighting of `confidence`; returns the share that counted.
    pub fn confirm(&mut self, confidence: f64, stamp: Timestamp, config: &Config) -> f64 {
        let share = self.independence(stamp, config);
        let sum = self.confidence_at(stamp, config) + share * confidence;
        self.weigh(sum, stamp, config);
        self.sightings = self.sightings.saturating_add(1);
        if self.is_another_look(stamp, config) {
            self.independent = self.independent.saturating_add(1);
            self.independent_at = stamp;
        }
        self.last_seen = self.last_seen.max(stamp);
        share
    }

    /// Whether a sighting at `stamp` is independent of those before: long after the last independent one, or after a pause
    /// in which nobody looked. Where the head turns round, two sweeps pass a thing sooner than a half nod apart.
    fn is_another_look(&self, stamp: Timestamp, config: &Config) -> bool {
        stamp.seconds_since(self.independent_at) >= config.independence_s
            || stamp.seconds_since(self.last_seen) >= config.pause_s
    }

    /// Takes from the confidence what a view without the object says; true where it says anything.
    /// Time beyond the independence time is not held against it: nobody looked.
    pub fn contradict(&mut self, view: View, stamp: Timestamp, config: &Config) -> bool {
        let constant_s = match view {
            View::Unseen => return false,
            View::Holds(kind) if is_made_of(self.class, kind) => return false,
            View::Holds(_) | View::Unconfirmed => config.unconfirmed_s,
            View::BareGround => config.bare_ground_s,
        };
        let looked_s = self.independence(stamp, config) * config.independence_s;
        let left = self.confidence_at(stamp, config) * (-looked_s / constant_s).exp();
        self.weigh(left, stamp, config);
        looked_s > 0.0
    }

    /// Moves every instant after `now` back to `now`: the clock was set back, and the future would never be reached.
    pub fn not_after(&mut self, now: Timestamp) {
        for t in [&mut self.first_seen, &mut self.last_seen, &mut self.weighed, &mut self.independent_at] {
            *t = (*t).min(now);
        }
    }

    fn weigh(&mut self, confidence: f64, stamp: Timestamp, config: &Config) {
        self.confidence = confidence.clamp(0.0, config.confidence_max);
        self.weighed = self.weighed.max(stamp);
    }
}

/// Whether cells of a kind are what things of a class are made of: where they lie the thing is there still, whatever
/// kept the classifier from telling it. Not so trees, for the corner of a wall is as solid as a trunk, nor drops, whose
/// cells tell what was not seen.
fn is_made_of(class: Class, kind: CellClass) -> bool {
    match class {
        Class::Rock | Class::Wall => kind == CellClass::Obstacle,
        Class::Brush => kind == CellClass::Brush,
        Class::Tree | Class::Drop | Class::Unknown => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{at, known, sighting};

    #[test]
    fn confidence_falls_to_one_e_th_in_one_time_constant() {
        let config = Config::default();
        let mut tree = known(1, 0.0, 0.0);
        tree.confidence = 4.0;
        (tree.independent, tree.independent_at) = (3, at(4.0));
        tree.weighed = at(4.0);
        let month_s = 30.0 * 86_400.0;
        assert!((tree.confidence_at(at(4.0 + month_s), &config) - 4.0 / std::f64::consts::E).abs() < 1e-9);
        assert_eq!(tree.confidence_at(at(0.0), &config), 4.0);
    }

    #[test]
    fn a_candidate_decays_within_minutes() {
        let config = Config::default();
        let tree = known(1, 0.0, 0.0);
        assert!((tree.confidence_at(at(600.0), &config) - 0.5 / std::f64::consts::E).abs() < 1e-9);
    }

    /// Ten repeats within one second at c = 0.5 count as 0.5 s of 2 s: 0.5 + 0.5 * 0.5 = 0.75, and not 5.5.
    #[test]
    fn repeats_of_one_sweep_count_by_the_time_they_span() {
        let config = Config::default();
        let mut tree = known(1, 0.0, 0.0);
        for i in 1..=10 {
            tree.confirm(0.5, at(f64::from(i) * 0.1), &config);
        }
        assert!((tree.confidence - 0.75).abs() < 0.002, "{}", tree.confidence);
        assert_eq!((tree.sightings, tree.independent), (11, 1));
        assert!(!tree.is_reported(at(1.0), &config));
    }

    /// Sweeps that turn round beside a thing: 1.1, 1.3, then 2.5, 2.7, then 9.3. Each but the first begins after a pause of at
    /// least a second, the second of them within the independence time.
    #[test]
    fn what_is_seen_again_after_a_pause_is_seen_by_another_sweep() {
        let config = Config::default();
        let mut rock = known(1, 0.0, 0.0);
        let after = [0.2, 1.4, 1.6, 8.2].map(|s| {
            rock.confirm(0.8, at(s), &config);
            rock.independent
        });
        assert_eq!(after, [1, 2, 2, 3]);
        assert!(rock.is_reported(at(8.2), &config), "{rock:?}");
        let mut within = known(2, 0.0, 0.0);
        (1..=9).for_each(|i| _ = within.confirm(0.8, at(f64::from(i) * 0.2), &config));
        assert_eq!(within.independent, 1, "one sweep, seen without a pause");
    }

    #[test]
    fn two_looks_longer_than_a_sweep_apart_make_a_tree_and_three_anything_else() {
        let config = Config::default();
        for (class, looks) in
            [(Class::Tree, 2), (Class::Rock, 3), (Class::Drop, 3), (Class::Wall, 3), (Class::Brush, 3)]
        {
            let mut thing = Known { class, confidence: 1.0, ..known(1, 0.0, 0.0) };
            let made = (1..=4).find(|look| {
                assert!(!thing.is_reported(at(2.6 * f64::from(look - 1)), &config), "{class}, {look}");
                thing.confirm(1.0, at(2.6 * f64::from(*look)), &config);
                thing.is_reported(at(2.6 * f64::from(*look)), &config)
            });
            assert_eq!(made, Some(looks - 1), "{class}: the first look made it known");
        }
    }

    /// Where the head turns round beside a tree two sweeps pass it 1.2 s apart. So may one, where a bush hides it in between.
    #[test]
    fn two_looks_within_the_time_of_one_sweep_make_no_tree() {
        let config = Config::default();
        let mut tree = known(1, 0.0, 0.0);
        for s in [1.2, 1.8, 2.4] {
            tree.confirm(1.0, at(s), &config);
            assert!(tree.independent == 2 && !tree.is_reported(at(s), &config), "{tree:?}");
        }
        tree.confirm(1.0, at(4.5), &config);
        assert!(tree.is_reported(at(4.5), &config), "{tree:?}");
    }

    /// Solid cells in the place of a rock are the rock; in the place of a tree they may be anything.
    #[test]
    fn what_a_thing_is_made_of_is_not_held_against_it() {
        let config = Config::default();
        let speaks_against = |class: Class, kind: CellClass| {
            let mut thing = Known { class, ..known(1, 0.0, 0.0) };
            let said = thing.contradict(View::Holds(kind), at(1.0), &config);
            assert_eq!(said, thing.confidence < 0.5, "{class} {kind:?}");
            said
        };
        for kind in [CellClass::Obstacle, CellClass::Brush] {
            assert!(speaks_against(Class::Tree, kind) && speaks_against(Class::Drop, kind));
            assert_eq!(speaks_against(Class::Rock, kind), kind != CellClass::Obstacle);
            assert_eq!(speaks_against(Class::Wall, kind), kind != CellClass::Obstacle);
            assert_eq!(speaks_against(Class::Brush, kind), kind != CellClass::Brush);
        }
    }

    /// After one second of not being confirmed: exp(-1/8); of bare ground: exp(-1/3).
    #[test]
    fn contrary_evidence_takes_confidence_by_the_time_it_was_looked_at() {
        let config = Config::default();
        let (mut unconfirmed, mut bare) = (known(1, 0.0, 0.0), known(2, 0.0, 0.0));
        assert!(unconfirmed.contradict(View::Unconfirmed, at(1.0), &config));
        assert!(bare.contradict(View::BareGround, at(1.0), &config));
        assert!((unconfirmed.confidence - 0.5 * (-1.0_f64 / 8.0).exp()).abs() < 1e-3);
        assert!((bare.confidence - 0.5 * (-1.0_f64 / 3.0).exp()).abs() < 1e-3);
        assert!(!bare.clone().contradict(View::Unseen, at(2.0), &config));
    }

    #[test]
    fn an_hour_out_of_sight_is_not_held_against_an_object() {
        let config = Config::default();
        let mut tree = known(1, 0.0, 0.0);
        (tree.independent, tree.independent_at) = (3, at(4.0));
        tree.contradict(View::BareGround, at(3600.0), &config);
        assert!((tree.confidence - 0.5 * (-2.0_f64 / 3.0).exp()).abs() < 1e-3, "{}", tree.confidence);
    }

    /// The balance of the module head, h = 1/4, c = 0.6, at 5 Hz: 0.8 within a tenth.
    #[test]
    fn what_is_seen_one_time_in_four_settles_below_the_report_threshold() {
        let config = Config::default();
        let mut ghost = known(1, 0.0, 0.0);
        for i in 1..=600 {
            let stamp = at(f64::from(i) * 0.2);
            if i % 4 == 0 {
                ghost.confirm(0.6, stamp, &config);
            } else {
                ghost.contradict(View::Unconfirmed, stamp, &config);
            }
        }
        assert!((ghost.confidence - 0.8).abs() < 0.1, "{}", ghost.confidence);
        assert!(!ghost.is_reported(at(120.0), &config));
        assert!(ghost.confidence < sighting(0.0, 0.0).confidence * 3.0);
    }
}
