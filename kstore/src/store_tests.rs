//! Scenes for the store, a few lines each.

use crate::config::Config;
use crate::decay::View;
use crate::query::{Query, view_without_grid};
use crate::records::{Dropped, Outcome, Snapshot};
use crate::store::KnowledgeStore;
use crate::testing::{at, blind, detection, snapshot, zone};
use crate::zone::Zone;
use tsense_contract::{Class, Detection};

fn store() -> KnowledgeStore {
    KnowledgeStore::new(Config::default())
}

fn reported(store: &KnowledgeStore, seconds: f64) -> Vec<u64> {
    store.query(&Query::all(1000), at(seconds)).objects.iter().map(|o| o.id).collect()
}

#[test]
fn a_tree_seen_for_five_seconds_is_reported_once_at_its_place() {
    let mut store = store();
    for i in 0..=25 {
        store.take(&snapshot(f64::from(i) * 0.2), &[detection(5.0, 3.0)], view_without_grid);
    }
    let answer = store.query(&Query::near([5.0, 3.0], 1.0, 10), at(5.0));
    assert_eq!(answer.objects.len(), 1);
    let tree = answer.objects[0];
    assert_eq!((tree.id, tree.reported, tree.sightings, tree.class), (1, 1, 26, Class::Tree.to_wire()));
    assert!((tree.easting_m - 5.0).abs() < 1e-9 && (tree.dbh_m - 0.3).abs() < 1e-6);
    // 0.6 at first, then 0.6 for every 2 s of the 5 s: 2.1 less a little decay.
    assert!((tree.confidence - 2.1).abs() < 0.02, "{}", tree.confidence);
}

#[test]
fn a_false_trunk_of_one_snapshot_is_never_reported_and_soon_forgotten() {
    let mut store = store();
    let ghost = Detection { confidence: 1.0, ..detection(4.0, 0.0) };
    store.take(&snapshot(0.0), &[ghost], view_without_grid);
    for i in 1..200 {
        let seconds = f64::from(i) * 0.2;
        assert_eq!(reported(&store, seconds), Vec::<u64>::new());
        store.take(&snapshot(seconds), &[], view_without_grid);
        store.forget(at(seconds));
    }
    assert!(store.is_empty());
}

/// A detection that is told again and again while nobody looks there is one sighting, and no reason to forget either.
#[test]
fn what_rests_on_old_beams_is_neither_believed_more_nor_held_against() {
    let mut store = store();
    let seen = |seconds: f64| Detection { stamp_ns: at(seconds).ns, ..detection(5.0, 3.0) };
    for i in 0..=100 {
        store.take(&snapshot(f64::from(i) * 0.2), &[seen(0.0)], view_without_grid);
    }
    let tree = store.objects().next().expect("it is kept").clone();
    assert_eq!((tree.independent, tree.last_seen), (1, at(0.0)));
    assert!((tree.confidence - 0.6).abs() < 0.001 && reported(&store, 20.0).is_empty(), "{tree:?}");
    for i in 1..=2 {
        store.take(&snapshot(20.0 + 2.0 * f64::from(i)), &[seen(20.0 + 2.0 * f64::from(i))], view_without_grid);
    }
    assert_eq!(reported(&store, 24.0), vec![tree.id]);
}

/// Somebody waits as long as a sweep lasts, then goes a step farther, and so on: no place is reported.
#[test]
fn who_moves_on_before_the_next_sweep_is_never_reported() {
    let mut store = store();
    for i in 0..300 {
        let seconds = f64::from(i) * 0.2;
        let person = Detection { confidence: 1.0, ..detection(4.0 + 1.1 * (seconds / 2.4).floor(), 0.0) };
        store.take(&snapshot(seconds), &[person], view_without_grid);
        assert_eq!(reported(&store, seconds), Vec::<u64>::new(), "at {seconds} s");
    }
    assert!(store.len() >= 3);
}

/// The classification repeats itself for the 2.25 seconds until the next sweep corrects the map: twelve sightings of
/// full confidence, five hertz, never reported.
#[test]
fn a_false_trunk_of_one_whole_sweep_is_never_reported() {
    let mut store = store();
    for i in 0..300 {
        let seconds = f64::from(i) * 0.2;
        let ghost = (seconds <= 2.25).then(|| Detection { confidence: 1.0, ..detection(4.0, 0.0) });
        store.take(&snapshot(seconds), ghost.as_slice(), view_without_grid);
        assert_eq!(reported(&store, seconds), Vec::<u64>::new(), "at {seconds} s");
    }
}

#[test]
fn a_trusted_tree_stays_while_it_is_out_of_sight_and_goes_when_its_place_is_seen_bare() {
    let mut store = store();
    for i in 0..100 {
        store.take(&snapshot(f64::from(i) * 0.2), &[detection(5.0, 0.0)], blind);
    }
    for i in 100..1000 {
        store.take(&snapshot(f64::from(i) * 0.2), &[], blind);
    }
    assert_eq!(reported(&store, 200.0), vec![1]);
    for i in 1000..1060 {
        store.take(&snapshot(f64::from(i) * 0.2), &[], |_| View::BareGround);
    }
    assert_eq!(reported(&store, 212.0), Vec::<u64>::new());
}

#[test]
fn an_object_beyond_the_well_seen_area_is_not_contradicted() {
    let mut store = store();
    store.take(&snapshot(0.0), &[detection(30.0, 0.0), detection(9.0, 0.0)], view_without_grid);
    let outcome = store.take(&snapshot(1.0), &[], view_without_grid);
    assert_eq!(outcome, Outcome { contradicted: 1, ..Outcome::default() });
}

#[test]
fn two_detections_of_one_snapshot_are_two_objects_and_stay_two() {
    let mut store = store();
    let twins = [detection(5.0, 0.0), detection(5.2, 0.0)];
    assert_eq!(store.take(&snapshot(0.0), &twins, blind).created, 2);
    for i in 1..30 {
        // Seen together and one at a time.
        let seen = if i % 3 == 0 { &twins[..] } else { &twins[..1] };
        let outcome = store.take(&snapshot(f64::from(i)), seen, blind);
        assert_eq!((outcome.created, outcome.united, store.len()), (0, 0, 2), "snapshot {i}");
    }
}

#[test]
fn objects_that_drift_together_are_united_under_the_older_id() {
    let mut store = store();
    store.take(&snapshot(0.0), &[detection(5.0, 0.0)], blind);
    store.take(&snapshot(2.0), &[detection(5.4, 0.0)], blind);
    assert_eq!(store.len(), 2);
    // Each sighting half-way in between pulls the second object towards the first, until they are one.
    let united: usize =
        (2..10).map(|i| store.take(&snapshot(f64::from(i) * 2.0), &[detection(5.25, 0.0)], blind).united).sum();
    assert_eq!((united, store.len()), (1, 1));
    let tree = store.get(1).unwrap();
    assert_eq!((tree.sightings, tree.first_seen), (10, at(0.0)));
    assert_eq!(store.take_changes().removed, vec![2]);
}

#[test]
fn classes_do_not_absorb_each_other() {
    let mut store = store();
    let rock = Detection { class: Class::Rock.to_wire(), ..detection(5.0, 0.0) };
    store.take(&snapshot(0.0), &[detection(5.0, 0.0), rock], blind);
    store.take(&snapshot(2.0), &[rock], blind);
    assert_eq!(store.len(), 2);
    let query = Query { class: Some(Class::Rock), unreported: true, ..Query::all(10) };
    let answer = store.query(&query, at(2.0)).objects;
    assert_eq!(answer.iter().map(|o| (o.id, o.sightings)).collect::<Vec<_>>(), vec![(2, 2)]);
}

#[test]
fn a_full_store_forgets_the_weakest_and_counts_them() {
    let mut store = KnowledgeStore::new(Config { objects_max: 10, ..Config::default() });
    let many: Vec<Detection> = (0..13)
        .map(|i| Detection { confidence: 0.3 + 0.05 * i as f32, ..detection(f64::from(i) * 5.0, 0.0) })
        .collect();
    store.take(&snapshot(0.0), &many, blind);
    assert_eq!((store.len(), store.dropped().store_full), (10, 3));
    let kept: Vec<f64> = store.objects().map(|o| o.place_m[0]).collect();
    assert_eq!(kept, (3..13).map(|i| f64::from(i) * 5.0).collect::<Vec<_>>());
}

#[test]
fn late_snapshots_are_refused_and_counted() {
    let mut store = store();
    store.take(&snapshot(10.0), &[detection(0.0, 0.0)], blind);
    store.take(&snapshot(9.0), &[detection(0.0, 0.0)], blind);
    assert_eq!(store.dropped(), Dropped { late: 1, ..Dropped::default() });
    assert_eq!(store.get(1).unwrap().sightings, 1);
}

/// On the equator, on the border of zones 17 and 18, the same tree has mirrored eastings.
#[test]
fn a_tree_seen_from_the_next_zone_is_the_same_tree() {
    let mut store = store();
    let border = Snapshot { vehicle_m: [833_960.0, 0.0], ..snapshot(0.0) };
    store.take(&border, &[detection(833_978.557, 0.0), detection(833_950.0, 0.0)], blind);
    let zone = Zone::from_epsg(32_618).unwrap();
    let next_zone = Snapshot { zone, vehicle_m: [166_040.0, 0.0], ..snapshot(2.0) };
    let outcome = store.take(&next_zone, &[detection(166_021.443, 0.0)], blind);
    assert_eq!((outcome.absorbed, store.len(), store.zone()), (1, 2, Some(next_zone.zone)));
    assert!((store.get(2).unwrap().place_m[0] - 166_021.443).abs() < 1e-3);
    assert_eq!(store.take_changes().changed.len(), 2);
}

#[test]
fn a_clock_set_back_by_a_day_does_not_freeze_the_store() {
    let mut store = store();
    store.take(&snapshot(86_400.0), &[detection(5.0, 0.0)], blind);
    for i in 0..=25 {
        store.take(&snapshot(f64::from(i) * 0.2), &[detection(5.0, 0.0)], blind);
    }
    assert_eq!(reported(&store, 5.0), vec![1]);
}

#[test]
fn queries_answer_by_area_confidence_and_limit_nearest_first() {
    let mut store = store();
    let row: Vec<Detection> = (0..20).map(|i| detection(f64::from(i), 0.0)).collect();
    for i in 0..4 {
        store.take(&snapshot(f64::from(i) * 2.0), &row, blind);
    }
    let ids = |query: &Query| store.query(query, at(6.0)).objects.iter().map(|o| o.id).collect::<Vec<_>>();
    let area = Query { min_m: [2.5, -1.0], max_m: [6.5, 1.0], ..Query::all(100) };
    assert_eq!(ids(&area), vec![5, 6, 4, 7]); // 4.5 is the middle: eastings 4, 5, 3, 6
    assert_eq!(ids(&Query::near([0.0, 0.0], 2.0, 100)), vec![1, 2, 3]);
    assert_eq!(ids(&Query { limit: 2, ..area }), vec![5, 6]);
    assert!(store.query(&Query { limit: 2, ..area }, at(6.0)).truncated);
    assert_eq!(ids(&Query { confidence_min: 2.5, ..area }), Vec::<u64>::new());
    assert_eq!(ids(&Query { min_m: [7.0, 1.0], ..area }), Vec::<u64>::new());
    assert_eq!(ids(&Query::all(3)), vec![1, 2, 3]);
}

#[test]
fn a_restored_store_goes_on_as_if_nothing_had_happened() {
    let mut store = store();
    for i in 0..10 {
        store.take(&snapshot(f64::from(i)), &[detection(5.0, 0.0), detection(0.0, 5.0)], blind);
    }
    let objects: Vec<_> = store.objects().cloned().collect();
    let mut restored = KnowledgeStore::restore(Config::default(), Some(zone()), store.next_id(), objects);
    let next = [detection(5.0, 0.1), detection(9.0, 9.0)];
    assert_eq!(store.take(&snapshot(11.0), &next, blind), restored.take(&snapshot(11.0), &next, blind));
    assert!(store.objects().eq(restored.objects()));
    assert_eq!(restored.next_id(), 4);
}

#[test]
fn changes_are_told_once_and_can_be_given_back() {
    let mut store = store();
    store.take(&snapshot(0.0), &[detection(5.0, 0.0)], blind);
    let changes = store.take_changes();
    assert_eq!((changes.changed.len(), changes.next_id), (1, 2));
    assert!(store.take_changes().is_empty());
    store.give_back(&changes);
    assert_eq!(store.take_changes(), changes);
}

/// Each class in turn: seen for ten seconds it is reported under one id; then it fades by its own time constant.
#[test]
fn every_class_is_merged_reported_and_fades_by_its_own_time_constant() {
    let classes = [Class::Tree, Class::Rock, Class::Drop, Class::Wall, Class::Brush];
    let mut config = Config::default();
    let t = &mut config.time_constant;
    (t.tree_s, t.rock_s, t.drop_s, t.wall_s, t.brush_s) = (1e6, 2e6, 3e6, 4e6, 5e6);
    for (class, constant_s) in classes.into_iter().zip([1e6, 2e6, 3e6, 4e6, 5e6]) {
        let mut store = KnowledgeStore::new(config.clone());
        for i in 0..=10 {
            let off_m = if i % 2 == 0 { 0.12 } else { -0.12 };
            let seen = Detection { class: class.to_wire(), ..detection(5.0 + off_m, 0.0) };
            store.take(&snapshot(f64::from(i)), &[seen], blind);
        }
        let all = store.query(&Query { class: Some(class), ..Query::all(9) }, at(10.0)).objects;
        assert_eq!(all.iter().map(|o| (o.id, o.sightings)).collect::<Vec<_>>(), [(1, 11)], "{class}");
        let left = store.get(1).unwrap().confidence_at(at(10.0 + constant_s), &config);
        assert!((left - f64::from(all[0].confidence) / std::f64::consts::E).abs() < 1e-3, "{class}: {left}");
        assert_eq!(store.forget(at(10.0 + 4.0 * constant_s)), 1, "{class}");
    }
}

/// Half a metre apart: one patch of brush three metres wide, two trunks.
#[test]
fn the_middle_of_a_patch_may_wander_and_the_axis_of_a_trunk_may_not() {
    for (class, objects) in [(Class::Brush, 1), (Class::Tree, 2)] {
        let mut store = store();
        for i in 0..6 {
            let seen = Detection { class: class.to_wire(), dbh_m: 3.0, ..detection(0.5 * f64::from(i % 2), 0.0) };
            store.take(&snapshot(f64::from(i) * 2.0), &[seen], blind);
        }
        assert_eq!(store.len(), objects, "{class}");
    }
}

#[test]
fn what_makes_no_sense_is_counted_by_its_cause_and_changes_nothing() {
    let mut store = store();
    store.take(&snapshot(0.0), &[detection(5.0, 0.0)], blind);
    let before: Vec<_> = store.objects().cloned().collect();
    let good = detection(9.0, 9.0);
    let bad = [
        Detection { easting_m: f64::NAN, ..good },
        Detection { height_m: f32::INFINITY, ..good },
        Detection { northing_m: 1e9, ..good },
        Detection { ground_m: -30_000.0, ..good },
        Detection { easting_m: 1000.0, ..good },
        Detection { position_std_m: -1.0, ..good },
        Detection { confidence: 1.5, ..good },
        Detection { dbh_m: 25.0, ..good },
        Detection { height_m: 900.0, ..good },
        Detection { class: 77, ..good },
    ];
    assert_eq!(store.take(&snapshot(1.0), &bad, blind), Outcome::default());
    store.refuse(3);
    let expected = Dropped {
        not_finite: 2,
        off_map: 2,
        far_away: 1,
        unsure: 2,
        absurd_size: 2,
        unknown_class: 1,
        senseless_snapshot: 3,
        ..Dropped::default()
    };
    assert_eq!(store.dropped(), expected);
    assert!(store.objects().eq(&before));
}
