//! The whole chain on the simulated world's real wires: each process is killed, and its data flows again.
//!
//! The world runs in this test; the graph is the real program. A process counts as back with the first sample that
//! was published after its death.
#![allow(clippy::disallowed_methods, reason = "tests wait")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

mod harness;

use harness::world::TestWorld;
use harness::{ALL_PROCESSES, PATIENCE, TestGraph, all_alive, exists};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use tsense_contract::{Detections, Joints, Map, Objects, Poses, Scan};
use tsense_ports::{Inbox, Process};

/// Longest from a kill to the next sample on a machine that has time to spare (the figure).
const FLOWING_WITHIN: Duration = Duration::from_secs(1);
/// The same where other work shares the machine: what is asserted, so that a busy machine fails nothing.
const FLOWING_WITHIN_BUSY: Duration = Duration::from_secs(4);

/// One inbox for what each process puts out.
struct Flow {
    scans: Inbox<Scan>,
    joints: Inbox<Joints>,
    poses: Inbox<Poses>,
    map: Inbox<Map>,
    detections: Inbox<Detections>,
    objects: Inbox<Objects>,
    process: Process,
}

impl Flow {
    fn open(graph: &TestGraph) -> Self {
        let mut process = graph.observer();
        Self {
            scans: process.inbox(Some("ladar")).unwrap(),
            joints: process.inbox(None).unwrap(),
            poses: process.inbox(None).unwrap(),
            map: process.inbox(None).unwrap(),
            detections: process.inbox(None).unwrap(),
            objects: process.inbox(None).unwrap(),
            process,
        }
    }

    /// Samples that came since the last time, by the process that sent them.
    fn count(&mut self) -> BTreeMap<&'static str, u64> {
        fn drain<T: tsense_contract::Topic>(inbox: &mut Inbox<T>) -> u64 {
            let (newest, older) = inbox.take_newest().unwrap();
            older + u64::from(newest.is_some())
        }
        self.process.wait(0.001);
        BTreeMap::from([
            ("ladar", drain(&mut self.scans)),
            ("pan-tilt", drain(&mut self.joints)),
            ("gpos", drain(&mut self.poses)),
            ("mapper", drain(&mut self.map)),
            ("classifier", drain(&mut self.detections)),
            ("kstore", drain(&mut self.objects)),
        ])
    }

    /// Waits until every process has put something out from now on.
    fn wait_for_all(&mut self, graph: &TestGraph) -> Duration {
        let start = Instant::now();
        let mut total: BTreeMap<&str, u64> = BTreeMap::new();
        while total.len() < 6 || total.values().any(|n| *n == 0) {
            assert!(start.elapsed() < PATIENCE, "{total:?}\n{:#?}\n{}", graph.status(), graph.log());
            for (name, n) in self.count() {
                *total.entry(name).or_default() += n;
            }
        }
        start.elapsed()
    }

    /// Kills a process; time from its end to its successor's first sample.
    fn kill(&mut self, graph: &TestGraph, name: &str) -> Duration {
        let old = graph.kill(name);
        let start = Instant::now();
        while exists(old) {
            std::thread::yield_now();
        }
        self.count();
        while self.count()[name] == 0 {
            assert!(start.elapsed() < PATIENCE, "{name}\n{:#?}\n{}", graph.status(), graph.log());
        }
        start.elapsed()
    }
}

#[test]
fn data_flows_through_the_whole_chain_and_again_after_each_process_is_killed() {
    let world = TestWorld::start();
    let graph = TestGraph::start("restarts_max = 1000", &world.sections());
    let mut flow = Flow::open(&graph);
    println!("everything flows {:?} after every process was alive", flow.wait_for_all(&graph));
    let mut times: BTreeMap<&str, Vec<Duration>> = BTreeMap::new();
    for _ in 0..3 {
        for name in ["ladar", "pan-tilt", "gpos", "mapper", "classifier", "kstore"] {
            times.entry(name).or_default().push(flow.kill(&graph, name));
            graph.wait_until("all alive", all_alive);
            flow.wait_for_all(&graph);
        }
    }
    let late = times.values().flatten().filter(|t| **t > FLOWING_WITHIN).count();
    println!("flowing again after kill -9, {late} of {} later than 1 s: {times:#?}", 3 * times.len());
    assert!(times.values().flatten().all(|t| *t < FLOWING_WITHIN_BUSY), "{times:#?}\n{}", graph.log());
    drop(flow);
    graph.finish();
}

/// `TSENSE_KILLS=1000 cargo test --test flow campaign -- --nocapture` is the long version.
#[test]
fn a_campaign_of_kills_while_data_flows_ends_with_data_flowing() {
    let kills: usize = std::env::var("TSENSE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(40);
    let world = TestWorld::start();
    let graph = TestGraph::start("restarts_max = 1000000", &world.sections());
    let mut flow = Flow::open(&graph);
    flow.wait_for_all(&graph);
    let mut killed = 0;
    for i in 0..kills {
        // Every process in turn, at moments that drift against the snapshots, the nods and the heartbeats.
        let status = graph.status().expect("the launcher answers");
        let pid = harness::pid(harness::row(&status, ALL_PROCESSES[i % ALL_PROCESSES.len()]));
        if let Some(pid) = rustix::process::Pid::from_raw(pid as i32) {
            killed += usize::from(rustix::process::kill_process(pid, rustix::process::Signal::KILL).is_ok());
        }
        std::thread::sleep(Duration::from_millis(20 + (i as u64 * 37) % 180));
        flow.count();
    }
    assert!(killed > kills / 2, "only {killed} of {kills} kills met a process");
    println!("{killed} kills while data flowed; everything flows {:?} after the last", flow.wait_for_all(&graph));
    drop(flow);
    graph.finish();
}
