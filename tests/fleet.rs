//! Several vehicles and a station: over a link that loses, repeats, reorders, damages and cuts, with both ends restarted
//! at any moment, the station ends with exactly what the vehicles have. In one thread, without Zenoh; then, with the
//! feature `fleet`, with real processes.
#![allow(clippy::disallowed_methods, reason = "tests read and write files, and wait")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

#[cfg(feature = "fleet")]
mod harness;
#[cfg(feature = "fleet")]
#[path = "fleet/processes.rs"]
mod processes;
#[path = "fleet/world.rs"]
mod world;

use std::path::PathBuf;
use tsense_kstore::persist::read_only;
use world::{Chance, Place, World};

#[cfg(not(feature = "fleet"))]
#[test]
fn real_processes() {
    println!("SKIPPED: tests with real processes need `cargo test --features fleet --test fleet`");
}

/// A folder of its own for each test, gone when the test ends; in memory where that can be, for its flushes are many.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let memory = PathBuf::from("/dev/shm");
        let root = if memory.is_dir() { memory } else { std::env::temp_dir() };
        let folder = root.join(format!("tsense-fleet-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Every object of every vehicle is at the station once, every newest block too, and nothing else.
fn compare(world: &World, seed: u64) {
    let expected: Vec<Place> = world.union();
    let mut found: Vec<Place> = world.station().fleet().objects().map(world::place_of).collect();
    found.sort_unstable();
    assert_eq!(found, expected, "seed {seed}");
    let on_disk = read_only(&world.store()).unwrap();
    assert_eq!((on_disk.objects.len(), on_disk.notes.len()), (expected.len(), 0), "seed {seed}");
    assert_eq!(world.files_here(), world.files_there(), "seed {seed}");
}

#[test]
fn whatever_the_link_does_the_station_ends_with_what_the_vehicles_have() {
    let (mut answers, mut restarts) = (0, 0);
    for seed in 1..=16 {
        let scratch = Scratch::new(&format!("link-{seed}"));
        let mut world = World::new(&scratch.0, Chance::new(seed), 3);
        for step in 0..120 {
            world.step(step);
            let places: Vec<Place> = world.station().fleet().objects().map(world::place_of).collect();
            let mut once = places.clone();
            once.sort_unstable();
            once.dedup();
            assert_eq!(once.len(), places.len(), "seed {seed}, step {step}: something is there twice");
        }
        world.heal();
        compare(&world, seed);
        answers += world.answers;
        restarts += world.restarts;
    }
    println!("16 worlds, {answers} answers delivered, {restarts} restarts of stations and vehicles");
    assert!(answers > 1000 && restarts > 50, "{answers} answers, {restarts} restarts");
}

#[test]
fn a_forgotten_vehicle_takes_along_what_it_alone_reported_and_its_blocks_and_may_come_again() {
    let scratch = Scratch::new("forget");
    let mut world = World::new(&scratch.0, Chance::new(5), 3);
    (0..60).for_each(|step| world.step(step));
    world.heal();
    world.forget(1);
    let mut left: Vec<Place> = world.station().fleet().objects().map(world::place_of).collect();
    left.sort_unstable();
    assert_eq!(left, world.union_without(1));
    assert!(left.len() < world.union().len());
    assert!(world.files_here().keys().all(|file| !file.starts_with("car1/")));
    assert!(!world.files_here().is_empty());
    world.heal();
    compare(&world, 5);
}

/// How fast a station takes in what several vehicles list, commits included.
#[test]
#[ignore = "measures: cargo test --release --test fleet -- --ignored --nocapture"]
fn measure_merging() {
    for (vehicles, objects) in [(1, 20_000), (3, 20_000), (10, 10_000)] {
        // On the disk, not in memory: the flushes are part of it.
        let scratch = Scratch(std::env::current_dir().unwrap().join(format!("target/fleet-{}", std::process::id())));
        std::fs::create_dir_all(&scratch.0).unwrap();
        let measured = world::list_everything(&scratch.0, vehicles, objects);
        let (total, file) = (vehicles * objects, std::fs::metadata(scratch.0.join("fleet.gpkg")).unwrap().len());
        println!(
            "{vehicles} vehicles of {objects} objects: {:.0} objects/s, {} pages of {:.1} ms, {:.0} bytes/object on the \
             link, {:.0} on disk, {} merged",
            total as f64 / measured.seconds,
            measured.pages,
            1e3 * measured.seconds / measured.pages as f64,
            measured.bytes as f64 / total as f64,
            file as f64 / total as f64,
            measured.merged,
        );
        assert_eq!(measured.merged, objects);
    }
}

#[test]
fn random_bytes_change_nothing_and_are_counted() {
    let scratch = Scratch::new("hostile");
    let mut world = World::new(&scratch.0, Chance::new(9), 2);
    (0..20).for_each(|step| world.step(step));
    world.heal();
    let refused = world.refused();
    let before: Vec<_> = world.station().fleet().objects().cloned().collect();
    let sent = world.send_nonsense(5000);
    let after: Vec<_> = world.station().fleet().objects().cloned().collect();
    assert_eq!(before, after);
    assert_eq!(world.refused() - refused, sent);
    compare(&world, 9);
}
