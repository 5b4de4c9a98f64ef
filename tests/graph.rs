//! The process graph as a whole: it comes up, survives kills, ends, and leaves nothing behind.
//!
//! Each test starts the real program in a graph of its own. Limits are those of the issue (flowing again within 1 s)
//! or, for waiting, far above what a busy machine needs.
#![allow(clippy::disallowed_methods, reason = "tests read files and wait")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

mod harness;

use harness::{ALL_PROCESSES, ALL_STAGES, PATIENCE, TestGraph, alive, all_alive, complaint, exists, output, pid, row};
use rustix::process::Signal;
use std::time::{Duration, Instant};

/// Longest from a kill to the heartbeat of the next process of that name. Measured idle: 20 to 130 ms, of which up to
/// 100 ms are the launcher's look at heartbeats.
const BACK_WITHIN: Duration = Duration::from_secs(1);

#[test]
fn every_process_comes_up_with_a_row_a_title_and_a_place_in_the_table() {
    let graph = TestGraph::start("", ALL_STAGES);
    // Memory is measured twice a second.
    graph.wait_until("every process has been measured", |status| {
        ALL_PROCESSES.iter().all(|name| row(status, name)["rss_bytes"].as_u64().unwrap() > 1_000_000)
    });
    let shown = output(&["status", "--json", "--graph", graph.domain().name()]);
    assert!(shown.status.success(), "{}", complaint(&shown));
    let status: serde_json::Value = serde_json::from_slice(&shown.stdout).unwrap();
    assert_eq!(status["graph"], graph.domain().name());
    let names: Vec<&str> =
        status["processes"].as_array().unwrap().iter().map(|r| r["name"].as_str().unwrap()).collect();
    assert_eq!(names, ALL_PROCESSES);
    for name in ALL_PROCESSES {
        let row = row(&status, name);
        assert!(["starting", "running", "degraded", "stale"].contains(&row["state"].as_str().unwrap()), "{row}");
        assert!(!row["reason"].as_str().unwrap().is_empty(), "{row}");
        assert_eq!(row["restarts"], 0, "{row}");
        let title = std::fs::read_to_string(format!("/proc/{}/comm", pid(row))).unwrap();
        assert_eq!(title.trim_end(), format!("tsense:{name}").chars().take(15).collect::<String>());
    }
    let table = output(&["status", "--graph", graph.domain().name()]);
    let table = String::from_utf8(table.stdout).unwrap();
    assert_eq!(table.lines().count(), 2 + ALL_PROCESSES.len(), "{table}");
    graph.finish();
}

#[test]
fn what_speaks_to_the_outside_gives_way_to_what_senses() {
    let graph = TestGraph::start("", ALL_STAGES);
    let stands_back = |name: &str| niceness(graph.pid(name)) > niceness(std::process::id());
    graph.wait_until("the bridge stands back", |_| stands_back("bridge"));
    for name in ALL_PROCESSES {
        assert_eq!(stands_back(name), name == "bridge", "{name}");
    }
    graph.finish();
}

/// How far a process stands back from the processor, from `/proc`.
fn niceness(pid: u32) -> i32 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    stat.rsplit_once(") ").unwrap().1.split(' ').nth(16).unwrap().parse().unwrap()
}

#[test]
fn each_process_killed_in_turn_is_back_within_a_second_and_the_others_never_notice() {
    let graph = TestGraph::start("", ALL_STAGES);
    let mut times = Vec::new();
    for name in ALL_PROCESSES {
        let others: Vec<u32> = ALL_PROCESSES.iter().filter(|n| **n != name).map(|n| graph.pid(n)).collect();
        times.push((name, graph.kill_and_wait(name)));
        let after: Vec<u32> = ALL_PROCESSES.iter().filter(|n| **n != name).map(|n| graph.pid(n)).collect();
        assert_eq!(others, after, "killing {name} touched others\n{}", graph.log());
        assert_eq!(graph.process(name)["restarts"], 1);
    }
    println!("alive again after kill -9: {times:?}");
    assert!(times.iter().all(|(_, time)| *time < BACK_WITHIN), "{times:?}");
    graph.finish();
}

#[test]
fn all_processes_killed_at_once_come_back_in_whatever_order() {
    let graph = TestGraph::start("", ALL_STAGES);
    for round in 1..=3 {
        let old = ALL_PROCESSES.map(|name| graph.kill(name));
        let time = graph.wait_until("all are back", |status| {
            all_alive(status) && ALL_PROCESSES.iter().all(|name| !old.contains(&pid(row(status, name))))
        });
        println!("round {round}: all alive again after {time:?}");
        assert!(ALL_PROCESSES.iter().all(|name| graph.process(name)["restarts"] == round));
    }
    graph.finish();
}

/// `TSENSE_KILLS=2000 cargo test --release --test graph campaign -- --nocapture` is the long version.
#[test]
fn a_campaign_of_kills_at_random_moments_leaves_every_process_working() {
    let kills: u32 = std::env::var("TSENSE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(60);
    let graph = TestGraph::start("restarts_max = 1000000", ALL_STAGES);
    let mut seed = 0x5eed_u64;
    let mut random = |below: u64| {
        // xorshift64: the same kills every time, though not at the same instants.
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        seed % below
    };
    for _ in 0..kills {
        // Also while it starts: the moments that wedge a graph.
        let name = ALL_PROCESSES[random(7) as usize];
        let status = graph.status().expect("the launcher answers");
        if pid(row(&status, name)) != 0 {
            let target = rustix::process::Pid::from_raw(pid(row(&status, name)) as i32).unwrap();
            let _ = rustix::process::kill_process(target, Signal::KILL);
        }
        std::thread::sleep(Duration::from_millis(random(60)));
    }
    let time = graph.wait_until("all are alive after the campaign", all_alive);
    let restarts: u64 = ALL_PROCESSES.iter().map(|n| graph.process(n)["restarts"].as_u64().unwrap()).sum();
    println!("{kills} kills, {restarts} restarts, all alive {time:?} after the last");
    assert!(restarts >= u64::from(kills / 4), "only {restarts} restarts: the kills missed");
    for name in ALL_PROCESSES {
        assert!(graph.kill_and_wait(name) < 3 * BACK_WITHIN, "{name} is slow after the campaign\n{}", graph.log());
    }
    graph.finish();
}

#[test]
fn ctrl_c_ends_everything_with_130_and_sigterm_with_0() {
    for (signal, code) in [(Signal::INT, 130), (Signal::TERM, 0)] {
        let mut graph = TestGraph::start("", ALL_STAGES);
        let pids = ALL_PROCESSES.map(|name| graph.pid(name));
        assert_eq!(graph.signal_launcher(signal).code(), Some(code), "{}", graph.log());
        graph.assert_nothing_left();
        assert!(pids.iter().all(|pid| !exists(*pid)));
    }
}

#[test]
fn children_do_not_outlive_a_killed_launcher_and_the_next_one_cleans_up() {
    let mut graph = TestGraph::start("", ALL_STAGES);
    let pids = ALL_PROCESSES.map(|name| graph.pid(name));
    graph.signal_launcher(Signal::KILL);
    let start = Instant::now();
    while pids.iter().any(|pid| exists(*pid)) {
        assert!(start.elapsed() < PATIENCE, "children outlive their launcher");
        std::thread::sleep(Duration::from_millis(5));
    }
    println!("the last child ended {:?} after its launcher", start.elapsed());
    assert!(!graph.domain().leftovers().is_empty(), "a killed launcher cannot clean up");
    graph.launch();
    graph.wait_until("the next launcher's processes are alive", |s| {
        all_alive(s) && !pids.contains(&pid(row(s, "bridge")))
    });
    graph.finish();
}

#[test]
fn a_launcher_started_again_at_once_does_not_meet_its_predecessors_children() {
    let mut graph = TestGraph::start("", ALL_STAGES);
    for _ in 0..3 {
        let pids = ALL_PROCESSES.map(|name| graph.pid(name));
        graph.signal_launcher(Signal::KILL);
        graph.launch();
        graph.wait_until("new processes are alive", |s| all_alive(s) && !pids.contains(&pid(row(s, "mapper"))));
        assert!(pids.iter().all(|pid| !exists(*pid)), "{}", graph.log());
    }
    graph.finish();
}

#[test]
fn a_process_that_keeps_dying_opens_the_circuit_breaker() {
    let mut graph = TestGraph::start("restarts_max = 2", "[kstore]\n[bridge]\nlisten = \"127.0.0.1:0\"\n");
    graph.kill_and_wait("bridge");
    graph.kill_and_wait("bridge");
    graph.kill("bridge");
    assert_eq!(graph.wait_for_launcher().code(), Some(5), "{}", graph.log());
    let log = graph.log();
    assert!(log.contains("process `bridge` was killed by signal 9"), "{log}");
    assert!(log.contains("it was started again 2 times within 60 s already: giving up"), "{log}");
    graph.assert_nothing_left();
}

#[test]
fn a_bad_configuration_lists_all_faults_of_all_sections_and_starts_nothing() {
    let graph = TestGraph::prepare(
        "",
        "[[ladar]]\nfrequency_hz = 13.0\n[mapper]\nvoxxel_size_m = 1.0\n[kstore]\ngate = 1.0\n[brige]\n",
    );
    let refused = output(&["run", graph.config_file().to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(3));
    let text = complaint(&refused);
    for part in ["3 faults", "did you mean `voxel_size_m`?", "did you mean `gate_m`?", "did you mean [bridge]?", "^^^^"]
    {
        assert!(text.contains(part), "{part}\nis not in\n{text}");
    }
    graph.assert_nothing_left();
    let graph = TestGraph::prepare(
        "",
        "[[ladar]]\nfrequency_hz = 13.0\n[kstore]\ngate_sigma = 99.0\n[bridge]\nmax_clients = 0\n",
    );
    let refused = output(&["config", "check", graph.config_file().to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(3));
    let text = complaint(&refused);
    for part in [
        "3 faults",
        "frequency_hz = 13: allowed is 25 or 50 Hz",
        "gate_sigma = 99: allowed is",
        "max_clients = 0: allowed is",
    ] {
        assert!(text.contains(part), "{part}\nis not in\n{text}");
    }
}

#[test]
fn a_second_launcher_and_a_child_by_hand_are_refused_in_words() {
    let graph = TestGraph::start("", "[bridge]\nlisten = \"127.0.0.1:0\"\n");
    let second = output(&["run", graph.config_file().to_str().unwrap()]);
    assert_eq!(second.status.code(), Some(1));
    assert!(complaint(&second).contains("is already running"), "{}", complaint(&second));
    let child = output(&["process", "bridge", "--config", graph.config_file().to_str().unwrap()]);
    assert_eq!(child.status.code(), Some(1));
    assert!(
        complaint(&child).contains("processes are started by `tsense run CONFIG`, not by hand"),
        "{}",
        complaint(&child)
    );
    assert!(alive(&graph.process("bridge")));
    let config = graph.config_file();
    let orphan = TestGraph::prepare("", "[bridge]\n");
    let child = output(&["process", "bridge", "--config", orphan.config_file().to_str().unwrap()]);
    assert!(complaint(&child).contains("start one with `tsense run CONFIG`"), "{}", complaint(&child));
    assert!(config.exists());
    graph.finish();
}

#[test]
fn the_resolved_configuration_starts_the_same_graph() {
    let graph = TestGraph::prepare("", ALL_STAGES);
    let shown = output(&["config", "show", graph.config_file().to_str().unwrap()]);
    assert!(shown.status.success(), "{}", complaint(&shown));
    std::fs::write(graph.config_file(), &shown.stdout).unwrap();
    let again = output(&["config", "show", graph.config_file().to_str().unwrap()]);
    assert_eq!(shown.stdout, again.stdout);
}

#[test]
fn the_configurations_that_come_with_the_program_have_no_fault() {
    let mut checked = 0;
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/config")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            let result = output(&["config", "check", path.to_str().unwrap()]);
            assert!(result.status.success(), "{}", complaint(&result));
            checked += 1;
        }
    }
    assert!(checked >= 2, "only {checked} configurations found");
}
