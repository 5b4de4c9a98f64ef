//! Prints how fast a store of 100,000 objects answers, takes a snapshot, forgets, and is written down.
//!
//! `cargo run --release -p tsense-kstore --example store_speed`
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "a measurement: it looks at the clock and prints")]

use std::time::Instant;
use tsense_contract::{Class, Detection};
use tsense_geometry::Timestamp;
use tsense_kstore::persist::Vault;
use tsense_kstore::{Config, KnowledgeStore, Query, Snapshot, View, Zone};

const OBJECTS: usize = 100_000;
const SPACING_M: f64 = 2.6; // 1500 stems a hectare.

fn tree(i: usize) -> Detection {
    let (column, row) = (i % 316, i / 316);
    Detection {
        easting_m: 500_000.0 + column as f64 * SPACING_M,
        northing_m: 4_000_000.0 + row as f64 * SPACING_M,
        ground_m: 100.0,
        position_std_m: 0.05,
        dbh_m: 0.3,
        dbh_std_m: 0.02,
        height_m: 12.0,
        confidence: 0.9,
        arc_coverage: 0.4,
        lean_rad: [0.0; 2],
        class: Class::Tree.to_wire(),
        stamp_ns: 0,
        reserved: [0; 7],
    }
}

fn snapshot(seconds: f64) -> Snapshot {
    let stamp = Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds);
    let middle = SPACING_M * 158.0;
    let vehicle_m = [500_000.0 + middle, 4_000_000.0 + middle];
    Snapshot { stamp, vehicle_m, zone: Zone::from_epsg(32_617).expect("a UTM zone"), epoch: 1 }
}

/// Runs something many times and prints the middle and the slow end, microseconds: by the wall clock, and by the time
/// this thread computed, which other programs on the machine do not blur.
fn time(what: &str, times: usize, mut run: impl FnMut(usize)) {
    let (mut wall, mut computed) = (Vec::new(), Vec::new());
    for i in 0..times {
        let (start, before_us) = (Instant::now(), computed_us());
        run(i);
        computed.push(computed_us() - before_us);
        wall.push(start.elapsed().as_secs_f64() * 1e6);
    }
    let [wall, computed] = [wall, computed].map(|mut spans: Vec<f64>| {
        spans.sort_by(f64::total_cmp);
        format!("p50 {:9.1} p99 {:9.1}", spans[times / 2], spans[times * 99 / 100])
    });
    println!("{what:44} wall us {wall}   computed us {computed}");
}

fn computed_us() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e6 + time.tv_nsec as f64 * 1e-3
}

fn main() {
    // All objects are seen at once, from the middle.
    let config = Config { detection_range_max_m: 1e6, ..Config::default() };
    let mut store = KnowledgeStore::new(config.clone());
    let all: Vec<Detection> = (0..OBJECTS).map(tree).collect();
    for step in 0..4 {
        store.take(&snapshot(f64::from(step) * 2.0), &all, |_| View::Unseen);
    }
    let now = snapshot(6.0).stamp;
    println!("{} objects", store.len());

    // A place that depends on the number of the query only.
    let place = |i: usize| [500_000.0 + (i * 7919 % 800) as f64, 4_000_000.0 + (i * 104_729 % 800) as f64];
    for radius_m in [5.0, 15.0, 30.0, 100.0] {
        let mut found = 0;
        time(&format!("query: circle of {radius_m} m"), 1000, |i| {
            found += store.query(&Query::near(place(i), radius_m, 4096), now).objects.len();
        });
        println!("{:48} {} objects an answer", "", found / 1000);
    }
    time("query: everything, cut at 4096", 100, |_| {
        let answer = store.query(&Query::all(4096), now);
        assert!(answer.truncated);
    });
    time("query: an area of everything, cut at 4096", 100, |_| {
        let area = Query { min_m: [499_000.0, 3_999_000.0], max_m: [501_000.0, 4_001_000.0], ..Query::all(4096) };
        assert!(store.query(&area, now).truncated);
    });
    let near: Vec<Detection> = all.iter().filter(|t| near_vehicle(t)).copied().collect();
    time(&format!("take: a snapshot of {} trees", near.len()), 500, |i| {
        store.take(&snapshot(8.0 + i as f64 * 0.2), &near, |_| View::Unconfirmed);
    });
    time("forget: a look at all", 50, |_| {
        store.forget(now);
    });
    write_down(&config, &mut store, &near);
}

fn near_vehicle(tree: &Detection) -> bool {
    let [east, north] = snapshot(0.0).vehicle_m;
    (tree.easting_m - east).hypot(tree.northing_m - north) < 15.0
}

fn write_down(config: &Config, store: &mut KnowledgeStore, near: &[Detection]) {
    let folder = std::env::temp_dir().join(format!("tsense-store-speed-{}", std::process::id()));
    let path = folder.join("objects.gpkg");
    let (mut vault, _) = Vault::open(&path, config).expect("a new store");
    let zone = snapshot(0.0).zone;
    store.mark_all_changed();
    time("commit: all objects", 1, |_| {
        vault.commit(zone, &store.take_changes()).expect("a commit");
    });
    let before = written_bytes();
    time("commit: after each snapshot", 200, |i| {
        store.take(&snapshot(200.0 + i as f64 * 0.2), near, |_| View::Unconfirmed);
        vault.commit(zone, &store.take_changes()).expect("a commit");
    });
    println!("{:48} {} kB a commit", "", (written_bytes() - before) / 200 / 1000);
    drop(vault);
    time("load: all objects", 3, |_| {
        let (_, loaded) = Vault::open(&path, config).expect("the store");
        assert_eq!(loaded.objects.len(), store.len());
    });
    println!("{:48} {} MB", "the file", std::fs::metadata(&path).map_or(0, |m| m.len()) / 1_000_000);
    let _ = std::fs::remove_dir_all(&folder);
}

/// Bytes this process has caused to be written, by the kernel's count.
fn written_bytes() -> u64 {
    let io = std::fs::read_to_string("/proc/self/io").unwrap_or_default();
    let line = io.lines().find_map(|l| l.strip_prefix("wchar: "));
    line.and_then(|n| n.trim().parse().ok()).unwrap_or(0)
}
