//! Tests of snapshots: what is sent, how much, and that a reader sees the map of the mapper bit for bit.

use crate::beams::{Beam, BeamKind, Weight};
use crate::config::{Config, EvidenceConfig};
use crate::scene::{AT, Scene};
use crate::snapshot::{Snapshot, SnapshotContext};
use crate::testing::{Random, pose_at};
use crate::voxel_map::VoxelMap;
use std::ops::Range;
use tsense_contract::{
    BRICKS_PER_BLOCK, Brick, MapHeader, MapSampleKind, SnapshotAssembler, Taken, UNKNOWN_VERSION, commit_items,
};
use tsense_geometry::{Global, Point, Timestamp};

type Samples = Vec<(MapHeader, Vec<Brick>)>;

fn feed(reader: &mut SnapshotAssembler<Vec<Brick>>, samples: Samples) {
    for (header, items) in samples {
        reader.take(&header, items);
    }
}

fn context(epoch: u64, map: &VoxelMap) -> SnapshotContext {
    SnapshotContext {
        epoch,
        stamp: Timestamp::from_seconds(1.0),
        published: Timestamp::from_seconds(1.1),
        voxel_size_m: map.grid().size_m(),
        pose: pose_at(1.0, [0.0; 3]),
        center: map.center(),
    }
}

/// A map with its next snapshot, and the samples it was published in.
struct Bench {
    map: VoxelMap,
    snapshot: Snapshot,
    epoch: u64,
}

impl Bench {
    fn new(config: &Config, epoch: u64) -> Self {
        Self { map: VoxelMap::new(config).unwrap(), snapshot: Snapshot::default(), epoch }
    }

    fn publish(&mut self, keyframe: bool) -> Samples {
        let mut samples = Vec::new();
        self.map.snapshot(keyframe, &mut self.snapshot);
        let sent = self.snapshot.publish(&context(self.epoch, &self.map), &self.map, |header, len, fill| {
            // What was in the memory before must not show.
            let mut items = vec![Brick { occupancy: [-86; 64], confidence: [170; 64] }; len];
            fill(&mut items);
            samples.push((*header, items));
            Ok::<(), ()>(())
        });
        assert_eq!(sent, Ok(samples.len() as u64));
        samples
    }

    /// Whether a reader's view is this map, bit for bit.
    fn is_seen(&self, reader: &SnapshotAssembler<Vec<Brick>>) -> bool {
        let view = reader.complete().unwrap();
        (view.header.epoch, view.header.snapshot) == (self.epoch, self.snapshot.number)
            && view.blocks().len() == self.snapshot.table.len()
            && view.blocks().all(|(key, bricks)| self.map.block(key) == Some(bricks))
    }
}

/// Voxels of a metre in a space of 200 x 200 x 80 m, every beam to its last voxel.
fn plain() -> Config {
    Config {
        voxel_size_m: 1.0,
        working_space_m: [200.0, 200.0, 80.0],
        evidence: EvidenceConfig {
            spare_voxels: 0.0,
            grazing_spare_share: 0.0,
            chord_min_voxels: 0.0,
            ..EvidenceConfig::default()
        },
        ..Config::default()
    }
}

fn beam(origin: [f64; 3], end: [f64; 3], kind: BeamKind) -> Beam {
    let point = |[x, y, z]: [f64; 3]| Point::<Global>::new(x, y, z);
    Beam { origin: point(origin), end: point(end), kind, weight: Weight::FULL }
}

#[test]
fn a_snapshot_sends_what_changed_a_keyframe_everything_and_versions_never_return() {
    let mut bench = Bench::new(&plain(), 1);
    let here = beam([0.5; 3], [3.5, 0.5, 0.5], BeamKind::Hit);
    bench.map.insert(&here);
    bench.map.close_window();
    bench.publish(false);
    let first = bench.snapshot.clone();
    assert_eq!((first.number, first.whole.len(), first.changes.len(), first.table.len()), (0, 0, 1, 1));
    assert_eq!((first.changes[0].base, first.changes[0].bricks, &first.numbers[..]), (UNKNOWN_VERSION, 1, &[0][..]));
    assert_eq!(bench.publish(false).len(), 1, "nothing changed: a commit");
    assert_eq!((bench.snapshot.number, &bench.snapshot.table), (1, &first.table));
    bench.map.insert(&beam([50.5, 0.5, 0.5], [-50.5, 0.5, 0.5], BeamKind::NoReturn));
    bench.map.close_window();
    assert_eq!(bench.publish(false).len(), 2);
    let second = bench.snapshot.clone();
    assert_eq!((second.changes.len(), second.table.len(), second.dirty_bricks), (2, 2, 26));
    let bases: Vec<_> = second.changes.iter().map(|entry| entry.base).collect();
    assert_eq!(bases, [UNKNOWN_VERSION, first.table[0].version]);
    assert!(second.changes.iter().all(|entry| entry.version > first.table[0].version));
    assert_eq!(bench.publish(true).len(), 2);
    let keyframe = &bench.snapshot;
    assert_eq!((keyframe.changes.len(), &keyframe.table, keyframe.numbers.len()), (2, &second.table, 26));
    assert!(keyframe.changes.iter().all(|entry| entry.base == UNKNOWN_VERSION), "all that is known");
    bench.map.center_on(Point::new(5000.0, 0.0, 0.0));
    bench.publish(false);
    assert!(bench.snapshot.table.is_empty(), "dropped blocks leave the table");
    bench.map.center_on(Point::new(0.0, 0.0, 0.0));
    bench.map.insert(&here);
    bench.publish(false);
    let again = &bench.snapshot;
    assert_eq!(again.changes[0].base, UNKNOWN_VERSION, "what it was before is forgotten");
    assert!(again.table[0].version > second.table.iter().map(|entry| entry.version).max().unwrap());
}

#[test]
fn changes_that_do_not_fit_one_sample_take_several_and_none_is_too_long() {
    let mut bench = Bench::new(&plain(), 1);
    let mut reader = SnapshotAssembler::new(96);
    // Every brick of the lower four fifths of each block: more than may go as changes.
    let fill = |bench: &mut Bench, levels: Range<i32>, x_to: f64| {
        for z in levels {
            for y in (-100..100).step_by(4) {
                let [y, z] = [y, z * 4].map(|c| f64::from(c) + 0.5);
                bench.map.insert(&beam([-99.5, y, z], [x_to, y, z], BeamKind::NoReturn));
            }
        }
        bench.map.close_window();
    };
    fill(&mut bench, 0..8, 99.5);
    let samples = bench.publish(false);
    assert_eq!((bench.snapshot.whole.len(), bench.snapshot.changes.len(), samples.len()), (4, 0, 5));
    feed(&mut reader, samples);
    assert!(bench.is_seen(&reader));
    // Seven tenths of each.
    fill(&mut bench, 0..7, 99.5);
    let samples = bench.publish(false);
    let kinds: Vec<_> = samples.iter().map(|(header, items)| (header.kind(), items.len())).collect();
    assert_eq!(bench.snapshot.dirty_bricks, 4 * 25 * 25 * 7);
    assert_eq!(kinds[..4], [(MapSampleKind::Delta, 1 + 69 + 4375); 4]);
    feed(&mut reader, samples);
    assert!(bench.is_seen(&reader));
    let keyframe = bench.publish(true);
    assert_eq!((bench.snapshot.whole.len(), keyframe.len()), (4, 5), "four fifths are known: whole is quicker");
    let mut late = SnapshotAssembler::new(96);
    feed(&mut late, keyframe);
    assert!(bench.is_seen(&late));
    // A quarter of each: one sample for two blocks.
    fill(&mut bench, 0..5, 99.5);
    let samples = bench.publish(false);
    assert_eq!(samples.len(), 5, "3125 bricks a block: two do not fit beside their table");
    fill(&mut bench, 0..4, 99.5);
    assert_eq!(bench.publish(false).len(), 3);
}

/// What the samples of a snapshot may be beyond the changed bricks: their numbers, the tables, filling up.
fn overhead_items(snapshot: &Snapshot, samples: usize) -> usize {
    snapshot.numbers.len().div_ceil(64)
        + snapshot.changes.len().div_ceil(5)
        + commit_items(snapshot.table.len())
        + 2 * samples
}

#[test]
fn what_is_published_is_bounded_by_what_changed() {
    let mut bench = Bench::new(&Config::default(), 1);
    bench.map.center_on(Point::new(AT[0], AT[1], AT[2]));
    let mut reader = SnapshotAssembler::new(96);
    let (mut sweep, mut snapshots, mut with_whole) = (0, 0, 0);
    let (mut items_sent, mut bricks_changed) = (0, 0);
    for i in 0..300 {
        let (_, nod, beams) = Scene::tripod().scan(i);
        if nod != std::mem::replace(&mut sweep, nod) {
            bench.map.close_window();
        }
        for beam in &beams {
            bench.map.insert(beam);
        }
        if i % 3 != 2 {
            continue;
        }
        let samples = bench.publish(false);
        let snapshot = &bench.snapshot;
        let items: usize = samples.iter().map(|(_, items)| items.len()).sum();
        let whole = snapshot.whole.len() * BRICKS_PER_BLOCK;
        // A block is sent whole where three quarters of it changed, so at most a third is sent for nothing.
        assert!(whole <= (snapshot.dirty_bricks - snapshot.numbers.len()) * 4 / 3, "{whole} items whole");
        assert!(items - whole <= snapshot.numbers.len() + overhead_items(snapshot, samples.len()), "{items} items");
        items_sent += items;
        bricks_changed += snapshot.dirty_bricks;
        with_whole += usize::from(whole > 0);
        snapshots += 1;
        feed(&mut reader, samples);
        assert!(bench.is_seen(&reader));
    }
    assert_eq!(snapshots, 100);
    eprintln!("{bricks_changed} bricks changed, {items_sent} items sent, {with_whole} snapshots with whole blocks");
    assert!(items_sent * 10 <= bricks_changed * 11, "{items_sent} items for {bricks_changed} bricks");
}

const RUNS: u64 = 24;

/// Beams at random, windows, a moving window of blocks, fading, restarts; samples lost, readers that join late.
#[test]
fn a_reader_with_any_losses_never_sees_anything_but_the_map() {
    let (mut views, mut incomplete, mut healed) = (0, 0, 0);
    for run in 0..RUNS {
        let mut random = Random(run);
        let mut bench = Bench::new(&plain(), 1);
        let mut reader = SnapshotAssembler::new(96);
        let mut center = [0.0; 3];
        for _ in 0..40 {
            let point = |random: &mut Random| std::array::from_fn(|axis| center[axis] + random.between(-90.0, 90.0));
            for _ in 0..random.bits() % 20 {
                let kind = if random.bits() & 1 == 0 { BeamKind::Hit } else { BeamKind::NoReturn };
                bench.map.insert(&beam(point(&mut random), point(&mut random), kind));
            }
            match random.bits() % 16 {
                0..5 => bench.map.close_window(),
                5 => {
                    center[0] += random.between(-150.0, 150.0);
                    bench.map.center_on(Point::new(center[0], center[1], center[2]));
                }
                6 => {
                    bench.map.fade(3.0);
                    bench.map.fade_blocks(4);
                }
                7 if random.bits().is_multiple_of(4) => bench = Bench::new(&plain(), bench.epoch + 1),
                8 if random.bits().is_multiple_of(4) => reader = SnapshotAssembler::new(96),
                _ => {}
            }
            let (keyframe, lossy) =
                (reader.keyframe_needed() && random.bits().is_multiple_of(2), random.bits().is_multiple_of(4));
            for (header, items) in bench.publish(keyframe) {
                if lossy && random.bits().is_multiple_of(3) {
                    continue;
                }
                let taken = reader.take(&header, items);
                incomplete += u32::from(matches!(taken, Taken::Incomplete { .. }));
                if taken == Taken::Complete {
                    assert!(bench.is_seen(&reader), "run {run}");
                    views += 1;
                    healed += u32::from(header.keyframe == 1);
                }
            }
        }
    }
    eprintln!("{views} complete views, {incomplete} incomplete commits, {healed} keyframes");
    assert!(views > 600 && incomplete > 100 && healed > 50, "{views} {incomplete} {healed}");
}
