//! Merging, object by object: hand-made vehicles and places.

use super::merge::{Fleet, SourceKey};
use crate::config::Config;
use crate::object::Known;
use crate::testing::{at, known, zone};

fn fleet() -> Fleet {
    Fleet::restore(Config::default(), Some(zone()), 1, Vec::new())
}

fn tree(id: u64, east_m: f64) -> Known {
    Known { confidence: 2.0, independent: 3, independent_at: at(9.0), last_seen: at(9.0), ..known(id, east_m, 0.0) }
}

fn merged(fleet: &Fleet) -> Vec<(u64, f64)> {
    fleet.objects().map(|o| (o.id, (o.place_m[0] * 1e3).round() / 1e3)).collect()
}

/// Two of equal deviation: the middle; both confidences, and no more however often it is told.
#[test]
fn two_vehicles_that_see_one_tree_make_one_object_and_telling_again_changes_nothing() {
    let mut fleet = fleet();
    for _ in 0..3 {
        fleet.take((1, 7), 1, tree(7, 10.0));
        fleet.take((2, 3), 1, tree(3, 10.2));
    }
    assert_eq!(merged(&fleet), [(1, 10.1)]);
    let object = fleet.objects().next().unwrap();
    assert_eq!((object.confidence, object.sightings, object.reported), (4.0, 2, true));
    let batch = fleet.take_batch();
    assert_eq!((batch.sources.len(), batch.changes.changed.len()), (2, 1));
    fleet.take((1, 7), 1, tree(7, 10.0));
    let batch = fleet.take_batch();
    assert!(batch.sources.is_empty() && batch.changes.is_empty());
}

#[test]
fn what_one_vehicle_holds_for_two_things_are_two_and_the_other_joins_the_nearer() {
    let mut fleet = fleet();
    fleet.take((1, 1), 1, tree(1, 10.0));
    fleet.take((1, 2), 1, tree(2, 10.2));
    fleet.take((2, 1), 1, tree(1, 10.15));
    assert_eq!(fleet.len(), 2);
    assert_eq!(fleet.source((2, 1)).unwrap().object, 2);
}

#[test]
fn an_object_that_moves_away_parts_and_two_that_meet_are_united_under_the_older_id() {
    let mut fleet = fleet();
    fleet.take((1, 1), 1, tree(1, 10.0));
    fleet.take((2, 1), 1, tree(1, 10.1));
    fleet.take((2, 1), 1, tree(1, 11.0));
    assert_eq!(merged(&fleet), [(1, 10.0), (2, 11.0)]);
    fleet.take((2, 1), 1, tree(1, 10.2));
    assert_eq!(merged(&fleet), [(1, 10.1)]);
    assert_eq!(fleet.take_batch().changes.removed, [2]);
}

#[test]
fn an_object_goes_with_its_last_vehicle_and_comes_back_under_its_id() {
    let mut fleet = fleet();
    fleet.take((1, 1), 1, tree(1, 10.0));
    fleet.take((2, 1), 1, tree(1, 10.1));
    fleet.take((1, 2), 1, tree(2, 50.0));
    fleet.withdraw((1, 1));
    assert_eq!(merged(&fleet), [(1, 10.1), (2, 50.0)]);
    fleet.withdraw((2, 1));
    fleet.withdraw((2, 1));
    fleet.withdraw((9, 9));
    assert_eq!(merged(&fleet), [(2, 50.0)]);
    fleet.take((1, 1), 1, tree(1, 10.0));
    assert_eq!(merged(&fleet), [(1, 10.0), (2, 50.0)]);
    assert_eq!(fleet.count_of(1), (2, 2));
}

#[test]
fn what_a_new_list_does_not_hold_is_gone() {
    let mut fleet = fleet();
    fleet.take((1, 1), 1, tree(1, 10.0));
    fleet.take((1, 2), 1, tree(2, 20.0));
    fleet.take((2, 1), 1, tree(1, 30.0));
    fleet.take((1, 2), 2, tree(2, 20.0));
    fleet.end_listing(1, 2);
    assert_eq!(merged(&fleet), [(2, 20.0), (3, 30.0)]);
}

#[test]
fn a_store_that_was_written_down_goes_on_as_it_was() {
    let mut fleet = fleet();
    fleet.take((1, 1), 1, tree(1, 10.0));
    fleet.take((2, 1), 1, tree(1, 10.1));
    fleet.take((2, 2), 1, tree(2, 20.0));
    fleet.withdraw((2, 2));
    let batch = fleet.take_batch();
    let again = Fleet::restore(Config::default(), Some(zone()), batch.changes.next_id, batch.sources);
    // But for the place that the history told last.
    let all = |fleet: &Fleet| fleet.objects().map(|o| Known { noted_m: [0.0; 2], ..o.clone() }).collect::<Vec<_>>();
    assert_eq!(all(&again), all(&fleet));
    let gone: SourceKey = (2, 2);
    assert_eq!(again.source(gone), fleet.source(gone));
}
