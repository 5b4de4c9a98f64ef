//! Whatever comes on a topic, the process that reads it goes on: real samples are recorded from a graph, spoiled, and sent to
//! the stages that read them, which stand alone here; the test takes the writers' place.
//!
//! `TSENSE_SPOIL_S=60 cargo test --test topics -- --nocapture` sends for longer; `TSENSE_SPOIL_SEED` sends others.
#![allow(clippy::disallowed_methods, reason = "tests wait")]
#![allow(clippy::print_stdout, reason = "tests tell what they sent")]

mod harness;
#[path = "topics/tape.rs"]
mod tape;

use harness::world::TestWorld;
use harness::{PATIENCE, TestGraph, exists, outside, row};
use rustix::process::{Pid, Signal, kill_process};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tape::{Random, Tapes};
use tsense_ports::Process;

/// How long the real graph is listened to: several snapshots, and a nod of the head.
const RECORDED: Duration = Duration::from_secs(6);

/// With another sensor, whose voxels are still new when everything has been recorded and played.
const MAPPER: &str = "[mapper]\n[[mapper.voxel_sensor]]\nname = \"stereo\"\nage_max_s = 60.0\n";

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|n| n.parse().ok()).unwrap_or(default)
}

fn recorded() -> Tapes {
    let world = TestWorld::start();
    let graph = TestGraph::start("", &world.sections().replace("[mapper]\n", MAPPER));
    let mut process = graph.observer();
    let mut tapes = Tapes::default();
    tapes.record(&mut process, RECORDED);
    graph.finish();
    assert!(tapes.are_full(), "{tapes:?}");
    tapes
}

/// Stages that are alone.
struct Alone {
    names: Vec<&'static str>,
    /// What switches them on.
    sections: String,
    /// Topics that they read.
    topics: &'static [&'static str],
}

fn alone() -> Vec<Alone> {
    let ladar = "[[ladar]]\naddress = \"127.0.0.1:1\"\n";
    vec![
        Alone {
            names: vec!["mapper"],
            sections: format!("{ladar}{MAPPER}"),
            topics: &["scan", "joint", "pose", "voxels"],
        },
        Alone { names: vec!["classifier"], sections: "[classifier]\n".into(), topics: &["map", "points"] },
        Alone { names: vec!["kstore"], sections: "[kstore]\n".into(), topics: &["detections", "grid"] },
        Alone {
            names: outside::names(),
            sections: format!("{ladar}[bridge]\nlisten = \"127.0.0.1:0\"\n{}", outside::sections()),
            topics: &["scan", "joint", "pose", "map", "points", "detections", "grid", "objects"],
        },
    ]
}

/// Becomes the writer of a topic. The ladar's driver, which is one already, is killed until its place is free.
fn take_place(graph: &TestGraph, tapes: &mut Tapes, topic: &str, process: &mut Process) {
    let taken = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while topic == "scan" && !taken.load(Ordering::Relaxed) {
                let driver = graph.process("ladar")["pid"].as_u64().filter(|pid| exists(*pid as u32));
                // It may have ended by itself just now.
                let _ = driver.and_then(|pid| Pid::from_raw(pid as i32)).map(|pid| kill_process(pid, Signal::KILL));
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let (start, mut open) = (Instant::now(), false);
        while !open && start.elapsed() < PATIENCE {
            open = tapes.open(topic, process);
        }
        taken.store(true, Ordering::Relaxed);
        assert!(open, "{topic} keeps its writer\n{}", graph.log());
    });
}

#[test]
fn nothing_that_comes_on_a_topic_ends_a_process() {
    let span = Duration::from_secs(number("TSENSE_SPOIL_S", 3));
    let mut random = Random(number("TSENSE_SPOIL_SEED", 1));
    let mut tapes = recorded();
    for Alone { names, sections, topics } in alone() {
        let graph = TestGraph::start("restarts_max = 1000000", &sections);
        let mut process = graph.observer();
        topics.iter().for_each(|topic| take_place(&graph, &mut tapes, topic, &mut process));
        let before: Vec<_> = names.iter().map(|name| graph.pid(name)).collect();
        let rounds = tapes.play(&mut process, &mut random, span);
        println!("{names:?}: {rounds} samples of each topic");
        let after: Vec<_> = names.iter().map(|name| graph.pid(name)).collect();
        assert_eq!(before, after, "{names:?}: seed {}\n{}", number("TSENSE_SPOIL_SEED", 1), graph.log());
        let status = graph.status().expect("the graph answers");
        for name in names {
            assert!(row(&status, name)["in_hz"].as_f64() > Some(1.0), "{name} takes nothing\n{status:#}");
        }
        assert!(!graph.log().contains("panicked"), "{}", graph.log());
        tapes.close();
        drop(process);
    }
}
