//! The process `kstore` in a graph of its own: detections go in by shared memory, objects come out, questions are
//! answered, and what was told is there again after SIGKILL.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests touch the disk and start processes")]

mod common;

use common::graph::{Graph, be_the_kstore, stop};
use common::tree;
use std::collections::BTreeMap;
use tsense_contract::*;
use tsense_kstore::Config;
use tsense_kstore::persist::read_only;

const CHILD: &str = "child_that_is_the_kstore";

/// Objects are trusted within half a second, so that the tests are short.
fn quick() -> Config {
    Config { independence_s: 0.1, report_span_s: 0.2, report_confidence: 0.8, ..Config::default() }
}

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_is_the_kstore() {
    be_the_kstore(&quick());
}

#[test]
fn detections_become_objects_that_are_told_asked_for_and_found_again_after_a_stop() {
    let mut graph = Graph::new("ksa");
    let child = graph.start(CHILD);
    let mut told = Vec::new();
    for _ in 0..40 {
        graph.see(&[tree(5.0, 0.0), tree(0.0, 8.0)]);
        told.extend(graph.listen(0.05));
    }
    assert!(told.iter().all(|o| o.reported == 1));
    let ids: std::collections::BTreeSet<u64> = told.iter().map(|o| o.id).collect();
    assert_eq!(ids.into_iter().collect::<Vec<_>>(), vec![1, 2]);
    assert_eq!(graph.state().0, ProcessState::Running);

    let mut client = graph.process.client::<Store>().unwrap();
    let query = StoreQuery {
        min_m: [500_000.0, 4_000_007.0],
        max_m: [500_001.0, 4_000_009.0],
        class: Class::Tree.to_wire(),
        ..StoreQuery::everything()
    };
    let (header, items) = client.ask(&query, 2.0).unwrap();
    assert_eq!((header.stored, header.zone, items.len()), (2, 17, 1));
    assert!((items[0].northing_m - 4_000_008.0).abs() < 0.01);
    let (_, none) = client.ask(&StoreQuery { min_m: [f64::NAN; 2], ..query }, 2.0).unwrap();
    assert_eq!(none.len(), 0);

    let last = told.iter().rfind(|o| o.id == 1).unwrap().sightings;
    stop(child);
    let found = read_only(&graph.folder.file()).unwrap();
    assert_eq!((found.objects.len(), found.notes.len()), (2, 0));
    assert!(found.objects[0].sightings >= last);
    assert!(!common::with_end(&graph.folder.file(), "-wal").exists());
}

#[test]
fn what_was_told_is_there_again_after_kill_9() {
    let mut graph = Graph::new("ksb");
    let mut logged: BTreeMap<u64, u32> = BTreeMap::new();
    let mut rounds_that_told = 0;
    for round in 0..8_u32 {
        let mut child = graph.start(CHILD);
        let mut told = 0;
        for step in 0..(16 + 3 * round) {
            let trees: Vec<_> = (0..=round).map(|i| tree(3.0 * f64::from(i), 0.0)).collect();
            graph.see(&trees);
            for object in graph.listen(0.03 + 0.003 * f64::from(step % 5)) {
                let sightings = logged.entry(object.id).or_default();
                *sightings = object.sightings.max(*sightings);
                told += 1;
            }
        }
        child.kill().unwrap();
        child.wait().unwrap();
        graph.host.clean_dead();
        graph.listen(0.05).iter().for_each(|o| {
            logged.insert(o.id, o.sightings);
        });
        rounds_that_told += u32::from(told > 0);
        let found = read_only(&graph.folder.file()).unwrap();
        assert_eq!(found.notes, Vec::<String>::new());
        for (id, sightings) in &logged {
            let now = found.objects.iter().find(|o| o.id == *id).map(|o| o.sightings);
            assert!(now.is_some_and(|n| n >= *sightings), "round {round}: object {id}: {sightings} told, {now:?} kept");
        }
    }
    println!("{rounds_that_told} of 8 rounds told something, {} objects in all", logged.len());
    assert!(rounds_that_told >= 6 && logged.len() >= 6, "{rounds_that_told} rounds, {logged:?}");
}

#[test]
fn a_store_that_cannot_be_written_says_so_and_works_on() {
    let mut graph = Graph::new("ksc");
    // A folder where the file should be: not even root can write to that.
    std::fs::create_dir_all(graph.folder.file()).unwrap();
    let child = graph.start(CHILD);
    let mut told = Vec::new();
    for _ in 0..30 {
        graph.see(&[tree(5.0, 0.0)]);
        told.extend(graph.listen(0.05));
    }
    assert!(told.iter().any(|o| o.id == 1 && o.reported == 1), "{told:?}");
    let (state, reason) = graph.state();
    assert_eq!(state, ProcessState::Degraded);
    assert!(reason.contains("objects.gpkg"), "{reason}");
    // Mended: within the time between two attempts all of it is on disk.
    std::fs::remove_dir(graph.folder.file()).unwrap();
    for _ in 0..120 {
        graph.see(&[tree(5.0, 0.0)]);
        graph.listen(0.05);
    }
    assert_eq!(graph.state().0, ProcessState::Running);
    assert_eq!(read_only(&graph.folder.file()).unwrap().objects.len(), 1);
    stop(child);
}
