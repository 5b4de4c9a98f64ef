//! Killed with SIGKILL at any instant, again and again: what was acknowledged is on disk.
//!
//! The child is this test binary itself: it opens the store, adds sightings, commits, and says on its output what it
//! committed. The parent kills it and keeps the log that the child cannot take back.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests touch the disk and start processes")]

mod common;

use common::{Folder, config, see, tree, zone};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use tsense_kstore::persist::Vault;

const FILE: &str = "TSENSE_KSTORE_CHILD_FILE";
const ROUNDS: u32 = 20;

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_writes_until_it_is_killed() {
    let Some(file) = std::env::var_os(FILE) else { return };
    let (mut vault, loaded) = Vault::open(Path::new(&file), &config()).unwrap();
    assert_eq!(loaded.notes, Vec::<String>::new());
    let start_s = loaded.objects.iter().map(|o| o.weighed.seconds_since(common::at(0.0))).fold(0.0, f64::max);
    let mut store = loaded.into_store(config());
    for step in 1u32.. {
        // A few trees that are seen again and again, and new ones now and then.
        let fresh = f64::from(store.next_id() as u32) * 3.0;
        let trees = [tree(f64::from(step % 7) * 3.0, 0.0), tree(fresh, 50.0)];
        see(&mut store, start_s + f64::from(step) * 2.0, &trees[..1 + usize::from(step % 4 == 0)]);
        let changes = store.take_changes();
        vault.commit(zone(), &changes).unwrap();
        let mut line = String::new();
        for known in &changes.changed {
            line += &format!("{}:{} ", known.id, known.sightings);
        }
        let mut out = std::io::stdout().lock();
        writeln!(out, "ACK {line}").unwrap();
        out.flush().unwrap();
    }
}

#[test]
fn what_was_acknowledged_survives_kill_9_at_any_instant() {
    let folder = Folder::new();
    let mut acknowledged: BTreeMap<u64, u32> = BTreeMap::new();
    let mut acks = 0;
    for round in 0..ROUNDS {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child_that_writes_until_it_is_killed", "--nocapture"])
            .env(FILE, folder.file())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        let pid = child.id();
        // From "while it opens" to "in the middle of its work", at an instant of no particular phase.
        let killer = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_micros(2_000 + u64::from(round) * 23_457));
            child.kill().unwrap();
            child.wait().unwrap();
        });
        for line in out.lines().map_while(Result::ok) {
            let Some(entries) = line.strip_prefix("ACK ") else { continue };
            for entry in entries.split_whitespace() {
                let (id, sightings) = entry.split_once(':').unwrap();
                acknowledged.insert(id.parse().unwrap(), sightings.parse().unwrap());
            }
            acks += 1;
        }
        killer.join().unwrap();
        let (vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
        assert_eq!(loaded.notes, Vec::<String>::new(), "round {round}, pid {pid}");
        let found: BTreeMap<u64, u32> = loaded.objects.iter().map(|o| (o.id, o.sightings)).collect();
        for (id, sightings) in &acknowledged {
            let now = found.get(id);
            assert!(now.is_some_and(|n| n >= sightings), "round {round}: object {id}, {sightings} became {now:?}");
        }
        assert!(loaded.next_id > found.keys().last().copied().unwrap_or(0));
        drop(vault);
    }
    println!("{ROUNDS} rounds, {acks} acknowledged commits, {} objects", acknowledged.len());
    assert!(acks > ROUNDS, "only {acks} commits were acknowledged in {ROUNDS} rounds");
}
