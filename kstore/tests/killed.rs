//! Killed with SIGKILL at any instant, again and again: what was acknowledged is on disk.
//!
//! The child is this test binary itself: it opens the store, takes in sightings, commits, and says on its output what
//! it committed; now and then it forgets objects, moves to another zone and back, or closes and opens its file. The
//! parent kills it and keeps the log that the child cannot take back.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests touch the disk and start processes")]

mod common;

use common::{Folder, config, tree};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use tsense_kstore::persist::Vault;
use tsense_kstore::{Changes, Config, KnowledgeStore, Snapshot, View, Zone};

const FILE: &str = "TSENSE_KSTORE_CHILD_FILE";
/// What is acknowledged of an object that was forgotten.
const GONE: u32 = 0;

/// Trees that nobody sees again are forgotten within a minute, so that the log knows of losses too.
fn forgetful() -> Config {
    let mut config = config();
    config.time_constant.candidate_s = 20.0;
    config
}

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_writes_until_it_is_killed() {
    let Some(file) = std::env::var_os(FILE) else { return };
    let path = Path::new(&file);
    let (mut vault, loaded) = Vault::open(path, &forgetful()).unwrap();
    assert_eq!(loaded.notes, Vec::<String>::new());
    let start_s = loaded.objects.iter().map(|o| o.weighed.seconds_since(common::at(0.0))).fold(0.0, f64::max);
    let mut store = loaded.into_store(forgetful());
    for step in 1u32.. {
        if step.is_multiple_of(61) {
            vault.close().unwrap();
            vault = Vault::open(path, &forgetful()).unwrap().0;
        }
        take(&mut store, step, start_s + f64::from(step) * 2.0);
        let changes = store.take_changes();
        vault.commit(store.zone().unwrap(), &changes).unwrap();
        acknowledge(&changes);
    }
}

/// A few trees that are seen again and again, new ones now and then, and another zone for a while.
fn take(store: &mut KnowledgeStore, step: u32, seconds: f64) {
    // 1200 places: before one comes again, what stood there is long forgotten.
    let fresh = (seconds / 8.0).floor();
    let fresh = tree(fresh % 40.0 * 3.0 - 60.0, 20.0 + (fresh / 40.0).floor() % 30.0 * 3.0);
    let mut trees = [tree(f64::from(step % 7) * 3.0, 0.0), fresh];
    let elsewhere = step % 97 > 90;
    let zone = Zone::from_epsg(if elsewhere { 32_618 } else { 32_617 }).unwrap();
    let mut vehicle_m = [500_000.0, 4_000_000.0];
    if elsewhere {
        // Six degrees west of the central meridian of the next zone.
        let there = tsense_kstore::Reprojection::between(common::zone(), zone).unwrap();
        vehicle_m = there.apply(vehicle_m).unwrap();
        for tree in &mut trees {
            [tree.easting_m, tree.northing_m] = there.apply([tree.easting_m, tree.northing_m]).unwrap();
        }
    }
    let snapshot = Snapshot { stamp: common::at(seconds), vehicle_m, zone, epoch: 1 };
    store.take(&snapshot, &trees[..1 + usize::from(step.is_multiple_of(4))], |_| View::Unseen);
    store.forget(common::at(seconds));
}

fn acknowledge(changes: &Changes) {
    let known = changes.changed.iter().map(|o| (o.id, o.sightings));
    let gone = changes.removed.iter().map(|id| (*id, GONE));
    let line: String = known.chain(gone).map(|(id, sightings)| format!("{id}:{sightings} ")).collect();
    let mut out = std::io::stdout().lock();
    writeln!(out, "ACK {} {line}", changes.events.len()).unwrap();
    out.flush().unwrap();
}

/// What was acknowledged, in the parent's memory.
#[derive(Default)]
struct Log {
    sightings: BTreeMap<u64, u32>,
    commits: u32,
    events: u64,
}

impl Log {
    fn read(&mut self, line: &str) {
        let Some((events, entries)) = line.strip_prefix("ACK ").and_then(|l| l.split_once(' ')) else { return };
        self.events += events.parse::<u64>().unwrap();
        self.commits += 1;
        for entry in entries.split_whitespace() {
            let (id, sightings) = entry.split_once(':').unwrap();
            self.sightings.insert(id.parse().unwrap(), sightings.parse().unwrap());
        }
    }

    /// The file holds all of it, and at most the one commit more that was not yet acknowledged.
    fn compare(&mut self, file: &Path, round: u32) {
        let (_vault, loaded) = Vault::open(file, &forgetful()).unwrap();
        assert_eq!(loaded.notes, Vec::<String>::new(), "round {round}");
        let found: BTreeMap<u64, u32> = loaded.objects.iter().map(|o| (o.id, o.sightings)).collect();
        let mut later = 0;
        for (id, sightings) in &mut self.sightings {
            let now = found.get(id).copied().unwrap_or(GONE);
            assert!(*sightings != GONE || now == GONE, "round {round}: object {id} was forgotten and is back");
            assert!(now == GONE || now >= *sightings, "round {round}: object {id}: {sightings} sightings became {now}");
            later += u32::from(now != *sightings);
            *sightings = now; // Whoever read the file has it from now on.
        }
        // One commit more: it changes two objects at most, and forgets a few.
        assert!(later <= 6, "round {round}: {later} objects are not as they were acknowledged");
        assert!(loaded.next_id > self.sightings.keys().last().copied().unwrap_or(0), "an id could be given again");
        let connection = rusqlite::Connection::open(file).unwrap();
        let newest: u64 = connection
            .query_row("SELECT coalesce(max(id), 0) FROM history", [], |r| r.get::<_, i64>(0))
            .unwrap() as u64;
        assert!(newest >= self.events, "round {round}: {} entries of history acknowledged, {newest} kept", self.events);
    }
}

fn kill(rounds: u32) {
    let folder = Folder::new();
    let mut log = Log::default();
    for round in 0..rounds {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child_that_writes_until_it_is_killed", "--nocapture"])
            .env(FILE, folder.file())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        // From "while it opens" to "in the middle of its work", at an instant of no particular phase.
        let after = Duration::from_micros(1_000 + u64::from(round) * 23_457 % 450_000);
        let killer = std::thread::spawn(move || {
            std::thread::sleep(after);
            child.kill().unwrap();
            assert_eq!(
                std::os::unix::process::ExitStatusExt::signal(&child.wait().unwrap()),
                Some(9),
                "it died itself"
            );
        });
        out.lines().map_while(Result::ok).for_each(|line| log.read(&line));
        killer.join().unwrap();
        if folder.file().exists() {
            log.compare(&folder.file(), round);
        }
    }
    let gone = log.sightings.values().filter(|s| **s == GONE).count();
    println!(
        "{rounds} kills, {} commits acknowledged of {} objects ({gone} forgotten), nothing lost",
        log.commits,
        log.sightings.len()
    );
    assert!(log.commits > rounds && gone > rounds as usize, "too little was acknowledged");
}

#[test]
fn what_was_acknowledged_survives_kill_9_at_any_instant() {
    kill(25);
}

/// `cargo test --release -p tsense-kstore --test killed -- --ignored --nocapture`
#[test]
#[ignore = "some minutes"]
fn what_was_acknowledged_survives_500_times_kill_9() {
    kill(500);
}
