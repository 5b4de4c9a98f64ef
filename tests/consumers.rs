//! What consumers that are slow or stand still cost the sensor: mapper and classifier keep their pace, and no process of the
//! bridge grows.
//!
//! One graph senses the simulated forest with the page, JAUS, ROS 2 and (where they are built in) Foxglove and the link to a
//! station switched on. Rounds take turns, since other work shares the machine: nobody listens; everybody is stopped with
//! SIGSTOP; everybody is let run a tenth of the time. The mapper's age is from a snapshot's newest beam to its publication, the classifier's from the same
//! beam to the end of the classification; both are written by the processes themselves.
#![allow(clippy::disallowed_methods, reason = "tests start processes and wait")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

#[path = "consumers/crowd.rs"]
mod crowd;
mod harness;
#[path = "../bridge/tests/common/http.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod http;
#[path = "../bridge/tests/common/python.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod python;

use crowd::{Crowd, Pace};
use harness::TestGraph;
use harness::world::TestWorld;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use tsense_contract::{Grid, Map, MapSampleKind};
use tsense_ports::{Inbox, Process};

/// Most that a consumer may cost a process of the bridge.
const MEMORY_MAX_KB: i64 = 8 << 10;

/// Ages of what came, milliseconds.
#[derive(Clone, Debug, Default)]
struct Ages {
    map_ms: Vec<f64>,
    classifier_ms: Vec<f64>,
}

impl Ages {
    fn extend(&mut self, more: Ages) {
        self.map_ms.extend(more.map_ms);
        self.classifier_ms.extend(more.classifier_ms);
    }
}

/// A share of the way from the least to the greatest.
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// The test's own ends of the two topics.
struct Watch {
    map: Inbox<Map>,
    grid: Inbox<Grid>,
    process: Process,
}

impl Watch {
    fn open(graph: &TestGraph) -> Self {
        let mut process = graph.observer();
        Self { map: process.inbox(None).unwrap(), grid: process.inbox(None).unwrap(), process }
    }

    /// Watches for a while, letting the consumers run as they should.
    fn ages(&mut self, span: Duration, crowd: Option<&mut Crowd>) -> Ages {
        let (start, mut ages, mut crowd) = (Instant::now(), Ages::default(), crowd);
        while start.elapsed() < span {
            self.process.wait(0.05);
            crowd.iter_mut().for_each(|crowd| crowd.tick());
            while let Some(sample) = self.map.take().unwrap() {
                let header = sample.header();
                if MapSampleKind::from_wire(header.kind) == MapSampleKind::Commit {
                    ages.map_ms.push((header.published_ns - header.stamp_ns) as f64 / 1e6);
                }
            }
            while let Some(sample) = self.grid.take().unwrap() {
                let header = sample.header();
                ages.classifier_ms.push((header.classified_ns - header.stamp_ns) as f64 / 1e6);
            }
        }
        ages
    }
}

/// Memory of each process of the bridge that is its own, kilobytes.
fn memory(graph: &TestGraph) -> BTreeMap<&'static str, i64> {
    let own_kb = |name: &&'static str| {
        let status = std::fs::read_to_string(format!("/proc/{}/status", graph.pid(name))).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
        (*name, line.trim().trim_end_matches(" kB").parse().unwrap())
    };
    crowd::served().iter().map(own_kb).collect()
}

/// A graph that has been at work for a while.
fn graph(world: &TestWorld) -> TestGraph {
    let graph = TestGraph::start("", &format!("{}{}", world.sections(), crowd::sections()));
    graph.wait_until("the bridge serves", |status| {
        crowd::served().iter().all(|name| harness::row(status, name)["state"] == "running")
    });
    graph
}

/// What came of the rounds of one kind.
#[derive(Default)]
struct Outcome {
    ages: Ages,
    grown_kb: BTreeMap<&'static str, i64>,
}

/// Rounds in turn, each of the given length.
fn measure(rounds: usize, span: Duration) -> BTreeMap<Pace, Outcome> {
    let world = TestWorld::start();
    let graph = graph(&world);
    let mut watch = Watch::open(&graph);
    let mut outcomes: BTreeMap<Pace, Outcome> = BTreeMap::new();
    // The map fills up, and every consumer has been served once: what a process needs for that is no consumer's cost.
    let mut first = Crowd::gather(&graph, Pace::Running);
    watch.ages(2 * span.min(Duration::from_secs(10)), Some(&mut first));
    drop(first);
    for round in 0..rounds {
        let mut paces = Pace::ALL;
        // Nothing that the vehicle passes falls to the same pace every time.
        paces.rotate_left(round % Pace::ALL.len());
        for pace in paces {
            let before = memory(&graph);
            let mut crowd = (pace != Pace::Absent).then(|| Crowd::gather(&graph, pace));
            // What came while they connected belongs to no round.
            watch.ages(Duration::from_millis(500), None);
            let ages = watch.ages(span, crowd.as_mut());
            let outcome = outcomes.entry(pace).or_default();
            outcome.ages.extend(ages);
            for (name, kb) in memory(&graph) {
                let most = outcome.grown_kb.entry(name).or_insert(i64::MIN);
                *most = (*most).max(kb - before[name]);
            }
        }
    }
    drop(watch);
    graph.finish();
    outcomes
}

fn table(outcomes: &BTreeMap<Pace, Outcome>) {
    println!("| consumers | snapshots | mapper p50, p99, ms | classifier p50, p99, ms | most memory grown, kB |");
    for (pace, Outcome { ages, grown_kb }) in outcomes {
        let [map, classifier] = [&ages.map_ms, &ages.classifier_ms]
            .map(|ms| format!("{:.2}, {:.2}", quantile(ms, 0.5), quantile(ms, 0.99)));
        let grown: Vec<_> = grown_kb.iter().map(|(name, kb)| format!("{name} {kb}")).collect();
        println!("| {pace:?} | {} | {map} | {classifier} | {} |", ages.map_ms.len(), grown.join(", "));
    }
}

fn check_memory(outcomes: &BTreeMap<Pace, Outcome>) {
    for (pace, outcome) in outcomes {
        let worst = outcome.grown_kb.iter().find(|(_, kb)| **kb > MEMORY_MAX_KB);
        assert!(worst.is_none(), "{pace:?}: {worst:?}");
    }
}

#[test]
fn the_map_keeps_coming_and_no_process_grows_while_consumers_stand_still() {
    let outcomes = measure(1, Duration::from_secs(5));
    table(&outcomes);
    check_memory(&outcomes);
    for (pace, outcome) in &outcomes {
        let (maps, grids) = (outcome.ages.map_ms.len(), outcome.ages.classifier_ms.len());
        assert!(maps >= 10 && grids >= 2, "{pace:?}: {maps} snapshots and {grids} grids in 5 s");
    }
}

/// `TSENSE_PYTHON=venv/bin/python cargo test --features foxglove,fleet --test consumers -- --ignored --nocapture`; of
/// `TSENSE_ROUNDS=8` rounds of `TSENSE_ROUND_S=20`.
#[test]
#[ignore = "ten minutes, on a machine that has them to spare"]
fn slow_and_stopped_consumers_change_the_latency_by_less_than_a_twentieth() {
    let number = |name: &str, default: u64| std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(default);
    let outcomes = measure(number("TSENSE_ROUNDS", 8) as usize, Duration::from_secs(number("TSENSE_ROUND_S", 20)));
    table(&outcomes);
    check_memory(&outcomes);
    let without = &outcomes[&Pace::Absent].ages;
    for pace in [Pace::Stopped, Pace::Slow] {
        let with = &outcomes[&pace].ages;
        let stages =
            [("mapper", &with.map_ms, &without.map_ms), ("classifier", &with.classifier_ms, &without.classifier_ms)];
        for (name, with_ms, without_ms) in stages {
            let change = quantile(with_ms, 0.99) / quantile(without_ms, 0.99) - 1.0;
            println!("{name}, {pace:?}: p99 {:+.1} %", change * 100.0);
            assert!(change < 0.05, "{name}: p99 {:+.1} % with consumers {pace:?}", change * 100.0);
        }
    }
}
