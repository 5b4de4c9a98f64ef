//! The whole process `kstore` killed with SIGKILL, again and again: what it told anybody is still so afterwards.
//!
//! The client stands outside: it sends detections, asks over the service, listens to topic `objects`, and keeps a log of what
//! it was told that the process cannot take back. Time in the graph runs fast, so that objects are forgotten, too.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests touch the disk and start processes")]

mod common;

use common::graph::{Graph, be_the_kstore};
use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::process::ExitStatusExt;
use std::time::{Duration, Instant};
use tsense_contract::{Object, Service, Store, StoreQuery};
use tsense_kstore::Config;
use tsense_ports::{Client, PortError};

const CHILD: &str = "child_that_is_the_kstore_until_it_is_killed";
/// Graph seconds in a second.
const SPEED: f64 = 10.0;

/// What is seen in one snapshot alone is forgotten within half a minute of the graph.
fn forgetful() -> Config {
    let mut config = Config { commit_interval_s: 0.02, unconfirmed_s: 1e6, ..Config::default() };
    config.time_constant.candidate_s = 10.0;
    config
}

#[test]
fn child_that_is_the_kstore_until_it_is_killed() {
    be_the_kstore(&forgetful());
}

/// What the client was told.
#[derive(Default)]
struct Log {
    /// Sightings and newest sighting of each object that is there.
    known: BTreeMap<u64, (u32, i64)>,
    gone: BTreeSet<u64>,
    answers: usize,
}

impl Log {
    /// Objects that somebody was told of, one way or the other.
    fn told(&mut self, objects: &[Object], round: u32) {
        for object in objects {
            assert!(!self.gone.contains(&object.id), "round {round}: object {} was forgotten and is back", object.id);
            let (sightings, seen_ns) = self.known.entry(object.id).or_default();
            *sightings = (*sightings).max(object.sightings);
            *seen_ns = (*seen_ns).max(object.last_seen_ns);
        }
    }

    /// A whole answer: what is not in it is gone, and nothing in it is older than what was told before.
    fn told_all(&mut self, objects: &[Object], round: u32) {
        self.answers += 1;
        for object in objects {
            let (sightings, seen_ns) = self.known.get(&object.id).copied().unwrap_or_default();
            let kept = object.sightings >= sightings && object.last_seen_ns >= seen_ns;
            assert!(kept, "round {round}: of object {} {sightings} sightings were told, now {object:?}", object.id);
        }
        let there: BTreeSet<u64> = objects.iter().map(|object| object.id).collect();
        self.gone.extend(self.known.keys().filter(|id| !there.contains(id)));
        self.known.retain(|id, _| there.contains(id));
        self.told(objects, round);
    }

    /// Objects that no time can have made the store forget: lost. From 0.6 confidence falls to 0.1 in 1.8 time constants.
    fn lost(&self, objects: &[Object], now_ns: i64) -> Vec<u64> {
        let there: BTreeSet<u64> = objects.iter().map(|object| object.id).collect();
        let fresh = |seen_ns: i64| ((now_ns - seen_ns) as f64) < 1.5e9 * forgetful().time_constant.candidate_s;
        let lost = self.known.iter().filter(|(id, (_, seen_ns))| fresh(*seen_ns) && !there.contains(id));
        lost.map(|(id, _)| *id).collect()
    }
}

/// All objects, believed or not.
fn ask_all(client: &mut Client<Store>, patience_s: f64) -> Result<Vec<Object>, PortError> {
    let query = StoreQuery { unreported: 1, by_id: 1, ..StoreQuery::everything() };
    let (header, objects) = client.ask(&query, patience_s)?;
    assert!(header.truncated == 0 && objects.len() < Store::ITEMS_MAX, "a whole answer fits");
    Ok(objects)
}

/// Sends trees, asks and listens until the process is dead: seven that are seen all the time, and one that nobody sees again.
fn work(graph: &mut Graph, client: &mut Client<Store>, log: &mut Log, round: u32, until: Instant) {
    let mut step = 0;
    while Instant::now() < until {
        step += 1;
        let fresh = f64::from(round * 50 + step);
        let mut trees: Vec<_> = (0..7).map(|i| common::tree(f64::from(i) * 3.0, 0.0)).collect();
        trees.push(common::tree(fresh % 40.0 * 2.5 - 50.0, 10.0 + (fresh / 40.0).floor() % 40.0 * 2.5));
        graph.see(&trees);
        log.told(&graph.listen(0.05), round);
        if let Ok(objects) = ask_all(client, 0.05) {
            log.told_all(&objects, round);
        }
    }
    log.told(&graph.listen(0.5), round);
}

fn kill(rounds: u32) {
    let mut graph = Graph::at_speed("ksk", SPEED);
    let mut client = graph.process.client::<Store>().unwrap();
    let mut log = Log::default();
    for round in 0..rounds {
        let mut child = graph.start(CHILD);
        // From "while it opens its file" to "in the middle of its work", at an instant of no particular phase.
        let after = Duration::from_micros(2_000 + u64::from(round) * 123_457 % 500_000);
        let early = round % 5 == 4;
        if !early {
            let objects = ask_all(&mut client, 20.0).expect("the store answers");
            let lost = log.lost(&objects, graph.process.clock().now().ns);
            assert_eq!(lost, [] as [u64; 0], "round {round}");
            log.told_all(&objects, round);
        }
        let killer = std::thread::spawn(move || {
            std::thread::sleep(if early { after / 10 } else { after });
            child.kill().unwrap();
            assert_eq!(child.wait().unwrap().signal(), Some(9), "it died itself");
        });
        work(&mut graph, &mut client, &mut log, round, Instant::now() + after);
        killer.join().unwrap();
        graph.host.clean_dead();
    }
    println!(
        "{rounds} kills of the process, {} whole answers, {} objects known and {} forgotten, nothing lost",
        log.answers,
        log.known.len(),
        log.gone.len()
    );
    let steady = log.known.values().filter(|(sightings, _)| *sightings > rounds).count();
    assert!(log.answers > rounds as usize && steady >= 7, "too little was told: {:?}", log.known);
    assert!(rounds < 50 || log.gone.len() > rounds as usize / 2, "too little was forgotten");
}

#[test]
fn what_the_process_told_survives_its_kill() {
    kill(10);
}

/// `cargo test -p tsense-kstore --test killed_process -- --ignored --nocapture`
#[test]
#[ignore = "two minutes"]
fn what_the_process_told_survives_150_kills() {
    kill(150);
}
