//! Criterion benches of the voxel map: a scan on each instruction set, the end of a window, a snapshot.
//!
//! `cargo bench -p tsense-mapper`. The scene is a slope seen by a nodding fan of 1081 beams; `tsense bench mapper`
//! measures on recorded rays and beside the peers.

#![allow(clippy::disallowed_methods, reason = "a bench measures time")]
#![allow(missing_docs, reason = "the macros of criterion write undocumented items")]

use bytemuck::Zeroable;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use tsense_contract::{Brick, Map, Pose, Topic};
use tsense_geometry::{Point, Timestamp};
use tsense_mapper::{Beam, BeamKind, Config, InstructionSet, Snapshot, SnapshotContext, VoxelMap, Weight};

const BEAMS: usize = 1081;
const AT: [f64; 3] = [500_003.1, 5_412_007.7, 212.4];
const HEIGHT_M: f64 = 1.7;
const RANGE_MAX_M: f64 = 20.0;
const RISE: f64 = 0.1;

/// One mirror turn of 270 degrees at a tilt.
fn scan(tilt_rad: f64) -> Vec<Beam> {
    let origin = Point::new(AT[0], AT[1], AT[2] + HEIGHT_M);
    let beam = |i: usize| {
        let angle = (-135.0 + 0.25 * i as f64).to_radians();
        let [east, north, up] = [angle.sin(), angle.cos() * tilt_rad.cos(), angle.cos() * tilt_rad.sin()];
        let falls = RISE * east - up;
        let ground_m = if falls > 0.0 { HEIGHT_M / falls } else { f64::INFINITY };
        let range_m = ground_m.min(RANGE_MAX_M);
        let kind = if ground_m < RANGE_MAX_M { BeamKind::Hit } else { BeamKind::NoReturn };
        let end = Point::new(origin.x() + east * range_m, origin.y() + north * range_m, origin.z() + up * range_m);
        Beam { origin, end, kind, weight: Weight::FULL }
    };
    (0..BEAMS).map(beam).collect()
}

/// A nod down: 75 scans.
fn nod() -> Vec<Vec<Beam>> {
    (0..75).map(|i| scan((20.0 - 0.8 * f64::from(i)).to_radians())).collect()
}

fn map_after_a_nod(nod: &[Vec<Beam>]) -> VoxelMap {
    let mut map = VoxelMap::new(&Config::default()).expect("the default configuration is a map");
    map.center_on(Point::new(AT[0], AT[1], AT[2]));
    nod.iter().for_each(|scan| insert_all(&mut map, scan));
    map
}

fn insert_all(map: &mut VoxelMap, scan: &[Beam]) {
    for beam in scan {
        map.insert(beam);
    }
}

fn scans(c: &mut Criterion) {
    let nod = nod();
    let mut group = c.benchmark_group("scan");
    group.throughput(Throughput::Elements(BEAMS as u64));
    for set in InstructionSet::available() {
        let (mut map, mut next) = (map_after_a_nod(&nod), 0);
        map.use_instruction_set(set);
        group.bench_function(set.as_str(), |b| {
            b.iter(|| {
                insert_all(&mut map, &nod[next]);
                next = (next + 1) % nod.len();
            });
        });
    }
}

fn windows(c: &mut Criterion) {
    let nod = nod();
    let mut map = map_after_a_nod(&nod);
    c.bench_function("window/close after a nod", |b| {
        b.iter_custom(|rounds| {
            (0..rounds)
                .map(|_| {
                    nod.iter().for_each(|scan| insert_all(&mut map, scan));
                    let start = std::time::Instant::now();
                    map.close_window();
                    start.elapsed()
                })
                .sum()
        });
    });
}

fn snapshots(c: &mut Criterion) {
    let nod = nod();
    let mut map = map_after_a_nod(&nod);
    let (mut snapshot, mut room) = (Snapshot::default(), vec![Brick::UNKNOWN; Map::ITEMS_MAX]);
    let at = Timestamp::from_ns(0);
    let (pose, center) = (Pose::zeroed(), [0; 3]);
    let context = SnapshotContext { epoch: 1, stamp: at, published: at, voxel_size_m: 0.15, pose, center };
    let mut publish = |map: &mut VoxelMap, keyframe| {
        map.snapshot(keyframe, &mut snapshot);
        snapshot.publish(&context, map, |_, len, fill| {
            fill(&mut room[..len]);
            Ok::<(), std::convert::Infallible>(())
        })
    };
    c.bench_function("snapshot/keyframe", |b| b.iter(|| publish(&mut map, true)));
    let mut next = 0;
    c.bench_function("snapshot/three scans", |b| {
        b.iter_custom(|rounds| {
            (0..rounds)
                .map(|_| {
                    for _ in 0..3 {
                        insert_all(&mut map, &nod[next]);
                        next = (next + 1) % nod.len();
                    }
                    let start = std::time::Instant::now();
                    let _ = publish(&mut map, false);
                    start.elapsed()
                })
                .sum()
        });
    });
}

criterion_group!(benches, scans, windows, snapshots);
criterion_main!(benches);
