//! What the mapper costs, through real shared memory, with a reader that assembles: run in release with
//! `cargo test --release -p tsense-mapper --test publication -- --ignored --nocapture`. Processor time of one thread, the
//! kernel's part for it included.
#![allow(clippy::disallowed_methods, reason = "a test starts a thread")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

mod common;

use common::{AT_M, BEAMS, Ride, SCAN_S};
use rustix::time::{ClockId, clock_gettime};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use tsense_contract::{BLOCKS_MAX, Brick, MAP_KEYFRAME, Map, MapSampleKind, SnapshotAssembler, Taken, Topic};
use tsense_geometry::{Point, Timestamp};
use tsense_mapper::{Config, SnapshotContext, SnapshotCost, VoxelMap, snapshot_costs};
use tsense_ports::{Clock, Domain, Host, Process, Sample};

/// Processor time of this thread, seconds.
fn seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// A reader on a thread of its own.
struct Reader {
    stop: Arc<AtomicBool>,
    complete: Arc<AtomicU64>,
    thread: std::thread::JoinHandle<f64>,
}

impl Reader {
    fn start(domain: Domain) -> Self {
        let (stop, complete) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let (stopped, counted) = (Arc::clone(&stop), Arc::clone(&complete));
        let thread = std::thread::spawn(move || {
            let mut process = Process::observe(&domain, "reader").unwrap();
            let mut inbox = process.inbox::<Map>(None).unwrap();
            let mut assembler = SnapshotAssembler::<Sample<Map>>::new(BLOCKS_MAX);
            let start = seconds();
            while !stopped.load(Ordering::Relaxed) {
                process.wait(0.05);
                while let Some(sample) = inbox.take().unwrap() {
                    let header = *sample.header();
                    let taken = assembler.take(&header, sample);
                    counted.fetch_add(u64::from(taken == Taken::Complete), Ordering::Relaxed);
                }
            }
            seconds() - start
        });
        Self { stop, complete, thread }
    }
}

fn tell(what: &str, cost: &SnapshotCost) {
    let (us, items) = (cost.us, cost.items);
    println!("{what:24} {:7.1} us p50 {:7.1} p99 ({} of them; {:6.0} items p50)", us.p50, us.p99, us.count, items.p50);
}

#[test]
#[ignore = "measures; run in release"]
fn measure_publication() {
    let name = format!("pub{}", std::process::id() % 1_000_000);
    let mut host = Host::open(Domain::new(&name).unwrap(), Clock::start(1.0), &std::env::temp_dir()).unwrap();
    host.offer::<Map>(None).unwrap();
    host.offer_event(MAP_KEYFRAME).unwrap();
    let mut process = host.observer("mapper").unwrap();
    let mut outbox = process.outbox::<Map>(None).unwrap();
    let reader = Reader::start(host.domain().clone());
    // Twenty nods, 60 s.
    let mut ride = Ride::new(0.0);
    let mut scans = Vec::new();
    for _ in 0..3000 {
        let now = ride.next_scan();
        while let Some(scan) = ride.mapper.trace_next(now) {
            scans.push((scan.sweep.unwrap(), scan.beams.clone()));
        }
    }
    let mut map = VoxelMap::new(&Config::default()).unwrap();
    map.center_on(Point::new(AT_M[0], AT_M[1], AT_M[2]));
    let stamp = Timestamp::from_seconds(1000.0);
    let pose = bytemuck::Zeroable::zeroed();
    let context = SnapshotContext { epoch: 1, stamp, published: stamp, voxel_size_m: 0.15, pose, center: map.center() };
    process.wait(0.3);
    let mut room = vec![Brick::UNKNOWN; Map::ITEMS_MAX];
    let mut again = VoxelMap::new(&Config::default()).unwrap();
    again.center_on(Point::new(AT_M[0], AT_M[1], AT_M[2]));
    let copied = snapshot_costs(&mut again, &context, &scans, 3, seconds, |_, len, fill| fill(&mut room[..len]));
    tell("three scans, memory only", &copied.changes);
    tell("keyframe, memory only", &copied.keyframes);
    let costs = snapshot_costs(&mut map, &context, &scans, 3, seconds, |header, len, fill| {
        let sent = match header.kind() {
            MapSampleKind::Commit => outbox.send_with(header, len, fill),
            MapSampleKind::Block | MapSampleKind::Delta => outbox.queue_with(header, len, fill),
        };
        sent.unwrap();
    });
    println!("{} blocks", map.blocks().count());
    tell("three scans", &costs.changes);
    tell("three scans, nod ends", &costs.window_ends);
    tell("keyframe", &costs.keyframes);
    reader.stop.store(true, Ordering::Relaxed);
    let complete = reader.complete.load(Ordering::Relaxed);
    let reader_s = reader.thread.join().unwrap();
    println!("reader: {complete} complete views, {:.1} us each", reader_s * 1e6 / complete as f64);
    drop((outbox, process));
}

/// All the mapper's own work for a ladar at 50 Hz, but for waking and heartbeats.
#[test]
#[ignore = "measures; run in release"]
fn measure_the_whole_mapper() {
    let mut ride = Ride::new(1.0);
    let mut room = common::Room::new();
    let (mut beams, mut scan_s, mut snapshot_s) = (0, 0.0, 0.0);
    for i in 1..=3000 {
        let now = ride.next_scan();
        let start = seconds();
        beams += ride.trace(now);
        scan_s += seconds() - start;
        if i % 10 == 0 {
            let start = seconds();
            room.publish(&mut ride.mapper, false, now);
            snapshot_s += seconds() - start;
        }
    }
    let per_second = 1.0 / (3000.0 * SCAN_S);
    println!(
        "{:.0} ns a beam placed and traced; of a core: {:.2} % scans, {:.2} % snapshots at 5 Hz",
        scan_s * 1e9 / beams as f64,
        scan_s * per_second * 100.0,
        snapshot_s * per_second * 100.0
    );
    assert_eq!(beams, 3000 * BEAMS);
}
