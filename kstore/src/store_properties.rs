//! Properties of the store that hold for any detections, each over a counted number of seeded cases.

use crate::config::Config;
use crate::decay::View;
use crate::query::Query;
use crate::store::KnowledgeStore;
use crate::testing::{at, detection, snapshot};
use proptest::prelude::*;
use proptest::test_runner::{Config as Cases, TestRunner};
use std::cell::Cell;
use std::collections::BTreeSet;
use tsense_contract::{CellClass, Detection};

const CASES: u32 = 128;

/// Runs `property` on `CASES` cases from a fixed seed and asserts that it really ran that often.
fn check<S: Strategy>(strategy: S, property: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let ran = Cell::new(0);
    let cases = Cases { cases: CASES, failure_persistence: None, ..Cases::default() };
    let rng = proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha);
    let result = TestRunner::new_with_rng(cases, rng).run(&strategy, |value| {
        ran.set(ran.get() + 1);
        property(value)
    });
    assert!(result.is_ok(), "{}", result.unwrap_err());
    assert!(ran.get() >= CASES, "only {} cases ran", ran.get());
}

/// Detections crowded enough to fight for objects, some of them nonsense.
fn crowded() -> impl Strategy<Value = Detection> {
    let number = prop_oneof![
        20 => 0.01f32..1.0,
        1 => Just(f32::NAN),
        1 => Just(f32::INFINITY),
        1 => Just(-1.0f32),
        1 => Just(f32::MIN_POSITIVE),
        1 => Just(f32::MAX),
    ];
    let place = prop_oneof![30 => -3.0f64..3.0, 1 => Just(f64::NAN), 1 => Just(1e300)];
    (place.clone(), place, number.clone(), number.clone(), number.clone(), number, 0u8..8).prop_map(
        |(east, north, std, confidence, dbh_m, dbh_std_m, class)| Detection {
            position_std_m: std * 0.3,
            confidence,
            dbh_m,
            dbh_std_m,
            class,
            ..detection(east, north)
        },
    )
}

fn snapshots() -> impl Strategy<Value = Vec<(Vec<Detection>, u8)>> {
    prop::collection::vec((prop::collection::vec(crowded(), 0..12), 0u8..4), 1..12)
}

fn view(kind: u8) -> View {
    [View::Unseen, View::Unconfirmed, View::BareGround, View::Holds(CellClass::Obstacle)][usize::from(kind) % 4]
}

#[test]
fn the_order_of_detections_within_a_snapshot_does_not_matter() {
    check((snapshots(), any::<prop::sample::Index>()), |(snapshots, turn)| {
        let (mut a, mut b) = (KnowledgeStore::new(Config::default()), KnowledgeStore::new(Config::default()));
        for (i, (detections, kind)) in snapshots.iter().enumerate() {
            let mut turned = detections.clone();
            turned.reverse();
            if !turned.is_empty() {
                let by = turn.index(turned.len());
                turned.rotate_left(by);
            }
            let snapshot = snapshot(i as f64);
            prop_assert_eq!(
                a.take(&snapshot, detections, |_| view(*kind)),
                b.take(&snapshot, &turned, |_| view(*kind))
            );
        }
        prop_assert!(a.objects().eq(b.objects()));
        Ok(())
    });
}

#[test]
fn whatever_comes_confidence_is_bounded_numbers_are_finite_and_every_refusal_is_counted() {
    check(snapshots(), |snapshots| {
        let config = Config::default();
        let mut store = KnowledgeStore::new(config.clone());
        let (mut given, mut taken) = (0, 0);
        for (i, (detections, kind)) in snapshots.iter().enumerate() {
            let outcome = store.take(&snapshot(i as f64), detections, |_| view(*kind));
            prop_assert_eq!(outcome.taken, outcome.absorbed + outcome.created);
            given += detections.len() as u64;
            taken += outcome.taken as u64;
            for o in store.objects() {
                prop_assert!((0.0..=config.confidence_max).contains(&o.confidence));
                prop_assert!(o.place_m.iter().all(|x| x.abs() <= 3.0) && o.ground_m == 100.0);
                prop_assert!(o.position_std_m.is_finite() && o.position_std_m >= config.position_std_floor_m);
                prop_assert!(o.dbh.is_none_or(|d| d.value.is_finite() && d.std.is_finite() && d.std > 0.0));
                prop_assert!(o.independent <= o.sightings && o.last_seen >= o.first_seen);
            }
        }
        let refused: u64 = store.dropped().by_cause().iter().map(|(_, n)| n).sum();
        prop_assert_eq!(given, taken + refused);
        Ok(())
    });
}

#[test]
fn ids_are_never_reused_and_the_index_always_agrees_with_the_objects() {
    check(snapshots(), |snapshots| {
        let mut store = KnowledgeStore::new(Config { objects_max: 12, ..Config::default() });
        let (mut gone, mut alive): (BTreeSet<u64>, BTreeSet<u64>) = Default::default();
        for (i, (detections, kind)) in snapshots.iter().enumerate() {
            store.take(&snapshot(i as f64), detections, |_| view(*kind));
            store.forget(at(i as f64));
            let now: BTreeSet<u64> = store.objects().map(|o| o.id).collect();
            gone.extend(alive.difference(&now));
            prop_assert!(now.is_disjoint(&gone), "an id came back");
            prop_assert!(now.len() <= 12 && now.last().is_none_or(|id| *id < store.next_id()));
            prop_assert_eq!(store.index.len(), store.len());
            for o in store.objects() {
                prop_assert!(store.near(Some(o.class), o.place_m, 1e-9).any(|other| other.id == o.id));
            }
            alive = now;
        }
        Ok(())
    });
}

/// The plain version: look at every object.
#[test]
fn a_query_finds_what_looking_at_every_object_finds() {
    let corner = -4.0f64..4.0;
    let area = ([corner.clone(), corner.clone()], [0.0f64..6.0, 0.0..6.0], prop::option::of(0.1f64..4.0));
    let limit = prop_oneof![3 => 0usize..10, 1 => 1000usize..1001];
    let query = (area, 0.0f64..1.5, limit, any::<bool>(), prop::option::of(0u64..9));
    check(
        (snapshots(), query),
        |(snapshots, ((min_m, size, radius_m), confidence_min, limit, unreported, after_id))| {
            let config =
                Config { report_sightings: 2, report_span_s: 1.0, report_confidence: 0.5, ..Config::default() };
            let mut store = KnowledgeStore::new(config.clone());
            for (i, (detections, _)) in snapshots.iter().enumerate() {
                store.take(&snapshot(2.0 * i as f64), detections, |_| View::Unseen);
            }
            let max_m = [min_m[0] + size[0], min_m[1] + size[1]];
            let middle = [0, 1].map(|i| (min_m[i] + max_m[i]) / 2.0);
            let near_m = radius_m.map(|radius_m| (middle, radius_m));
            let query = Query { min_m, max_m, near_m, confidence_min, unreported, after_id, ..Query::all(limit) };
            let now = at(60.0);
            let distance = |p: [f64; 2]| crate::correction::distance_m(p, middle);
            let inside = |p: [f64; 2]| {
                (0..2).all(|i| (min_m[i]..=max_m[i]).contains(&p[i])) && radius_m.is_none_or(|r| distance(p) <= r)
            };
            let mut plain: Vec<_> = store
                .objects()
                .filter(|o| inside(o.place_m) && o.confidence_at(now, &config) >= confidence_min)
                .filter(|o| unreported || o.is_reported(now, &config))
                .filter(|o| after_id.is_none_or(|id| o.id > id))
                .map(|o| (if after_id.is_some() { 0.0 } else { distance(o.place_m) }, o.id))
                .collect();
            plain.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let answer = store.query(&query, now);
            prop_assert_eq!(answer.truncated, plain.len() > limit);
            let expected: Vec<u64> = plain.iter().take(limit).map(|(_, id)| *id).collect();
            prop_assert_eq!(answer.objects.iter().map(|o| o.id).collect::<Vec<_>>(), expected);
            Ok(())
        },
    );
}
