//! Tests of the assembler: samples by hand, and any sequence of edits, losses, late joins and restarts against a model.

use crate::*;
use bytemuck::Zeroable;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::atomic::{AtomicUsize, Ordering};
use tsense_geometry::Timestamp;

fn header(kind: MapSampleKind, epoch: u64, x: i32, version: u32) -> MapHeader {
    MapHeader { epoch, key: [x, 0, 0], version, kind: kind.to_wire(), ..MapHeader::zeroed() }
}

fn brick(value: u8) -> Brick {
    Brick { occupancy: [value as i8; 64], confidence: [value; 64] }
}

/// A whole block of one value, that counts who holds it.
#[derive(Clone)]
struct Sample(Rc<Vec<Brick>>);

impl AsRef<[Brick]> for Sample {
    fn as_ref(&self) -> &[Brick] {
        &self.0
    }
}

fn whole(value: u8) -> Sample {
    Sample(Rc::new(vec![brick(value); BRICKS_PER_BLOCK]))
}

struct Bench(SnapshotAssembler<Sample>);

impl Bench {
    fn new(blocks_max: usize) -> Self {
        Self(SnapshotAssembler::new(blocks_max))
    }

    /// Blocks 5 and 3 in versions 10 and 20, full of 5 and 3.
    fn with_two_blocks() -> Self {
        let mut bench = Self::new(8);
        bench.block(1, 5, 10, 5);
        bench.block(1, 3, 20, 3);
        bench
    }

    fn block(&mut self, epoch: u64, x: i32, version: u32, value: u8) -> Taken {
        self.0.take(&header(MapSampleKind::Block, epoch, x, version), whole(value))
    }

    /// Puts `value` into bricks 7 and 8 of block `x`.
    fn delta(&mut self, x: i32, base: u32, version: u32, value: u8) -> Taken {
        let entry = DeltaEntry { key: [x, 0, 0], base, version, bricks: 2 };
        let mut items = vec![Brick::UNKNOWN; delta_items(1, 2)];
        let new = vec![brick(value); BRICKS_PER_BLOCK];
        write_delta(&mut items, &[entry], &[7, 8], |_| &new);
        self.0.take(&header(MapSampleKind::Delta, 1, 0, 1), Sample(Rc::new(items)))
    }

    /// Offers a commit of blocks `(x, version)`.
    fn commit(&mut self, epoch: u64, table: &[(i32, u32)]) -> Taken {
        let entries: Vec<_> = table.iter().map(|&(x, version)| CommitEntry { key: [x, 0, 0], version }).collect();
        let header = header(MapSampleKind::Commit, epoch, 0, entries.len() as u32);
        self.0.take(&header, Sample(Rc::new(pack_commit(&entries))))
    }

    /// Key and the bricks 6 and 7 of each block of the complete snapshot.
    fn seen(&self) -> Vec<(i32, [u8; 2])> {
        let snapshot = self.0.complete().unwrap();
        snapshot.blocks().map(|(key, b)| (key[0], [b[6].confidence[0], b[7].confidence[63]])).collect()
    }
}

#[test]
fn a_matching_commit_completes_a_snapshot_in_key_order() {
    let mut bench = Bench::with_two_blocks();
    assert!(bench.0.complete().is_none() && bench.0.keyframe_needed());
    assert_eq!(bench.commit(1, &[(5, 10), (3, 20)]), Taken::Complete);
    assert_eq!(bench.seen(), [(3, [3, 3]), (5, [5, 5])]);
    assert!(!bench.0.keyframe_needed());
}

#[test]
fn a_missing_or_stale_block_asks_for_a_keyframe_and_the_keyframe_heals_it() {
    let mut bench = Bench::with_two_blocks();
    let outcome = bench.commit(1, &[(5, 11), (3, 20), (4, 1)]);
    assert_eq!(outcome, Taken::Incomplete { missing: 1, stale: 1 });
    assert!(bench.0.complete().is_none() && bench.0.keyframe_needed());
    bench.block(1, 5, 11, 6);
    bench.block(1, 4, 1, 4);
    assert_eq!(bench.commit(1, &[(5, 11), (3, 20), (4, 1)]), Taken::Complete);
}

#[test]
fn the_next_sample_ends_the_snapshot_and_a_commit_drops_what_left_the_map() {
    let mut bench = Bench::with_two_blocks();
    bench.commit(1, &[(5, 10), (3, 20)]);
    bench.block(1, 6, 1, 6);
    assert!(bench.0.complete().is_none());
    assert_eq!(bench.commit(1, &[(5, 10), (6, 1)]), Taken::Complete);
    assert_eq!(bench.0.held(), 2);
    bench.delta(5, 10, 11, 0);
    assert!(bench.0.complete().is_none());
}

#[test]
fn what_leaves_the_map_can_be_looked_at_before_the_commit_is_taken() {
    let mut bench = Bench::with_two_blocks();
    bench.commit(1, &[(3, 20), (5, 10)]);
    let table = [CommitEntry { key: [5, 0, 0], version: 10 }];
    let left = |bench: &Bench, kind, epoch| {
        let header = header(kind, epoch, 0, 1);
        let items = pack_commit(&table);
        bench.0.leaving(&header, &items).map(|(key, version, bricks)| (key[0], version, bricks[0])).collect::<Vec<_>>()
    };
    assert_eq!(left(&bench, MapSampleKind::Commit, 1), [(3, 20, brick(3))]);
    assert_eq!(left(&bench, MapSampleKind::Commit, 2), []);
    assert_eq!(left(&bench, MapSampleKind::Delta, 1), []);
}

#[test]
fn a_delta_changes_its_bricks_in_a_copy_and_gives_the_sample_back() {
    let (mut bench, sample) = (Bench::new(8), whole(5));
    bench.0.take(&header(MapSampleKind::Block, 1, 5, 10), sample.clone());
    assert_eq!(Rc::strong_count(&sample.0), 2, "borrowed, not copied");
    assert_eq!(bench.0.copies(), 0);
    assert_eq!(bench.delta(5, 10, 11, 77), Taken::Part);
    assert_eq!((Rc::strong_count(&sample.0), sample.0[7], bench.0.copies()), (1, brick(5), 1));
    assert_eq!(bench.commit(1, &[(5, 11)]), Taken::Complete);
    assert_eq!(bench.seen(), [(5, [5, 77])]);
    bench.block(1, 5, 12, 6);
    bench.delta(5, 12, 13, 78);
    assert_eq!(bench.commit(1, &[(5, 13)]), Taken::Complete);
    assert_eq!((bench.seen(), bench.0.copies()), (vec![(5, [6, 78])], 1), "the copy is used again");
}

#[test]
fn a_delta_on_another_base_changes_nothing_and_the_block_is_stale() {
    let mut bench = Bench::with_two_blocks();
    bench.delta(5, 11, 12, 77);
    bench.delta(9, 1, 2, 77);
    assert_eq!(bench.commit(1, &[(5, 12), (3, 20)]), Taken::Incomplete { missing: 0, stale: 1 });
    assert_eq!(bench.commit(1, &[(5, 10), (3, 20)]), Taken::Complete);
    assert_eq!(bench.seen(), [(3, [3, 3]), (5, [5, 5])]);
}

#[test]
fn a_delta_on_nothing_is_a_new_block_unknown_but_for_its_bricks() {
    let mut bench = Bench::new(2);
    bench.delta(5, UNKNOWN_VERSION, 1, 9);
    bench.delta(5, UNKNOWN_VERSION, 2, 8);
    assert_eq!(bench.commit(1, &[(5, 2)]), Taken::Complete);
    assert_eq!(bench.seen(), [(5, [0, 8])]);
    let known = bench.0.complete().unwrap().blocks().map(|(_, b)| b.iter().filter(|b| **b != Brick::UNKNOWN).count());
    assert_eq!(known.collect::<Vec<_>>(), [2]);
}

#[test]
fn a_new_epoch_forgets_every_block_and_the_old_one_is_heard_no_more() {
    let mut bench = Bench::with_two_blocks();
    bench.commit(1, &[(5, 10), (3, 20)]);
    let same_versions = bench.commit(2, &[(5, 10), (3, 20)]);
    assert_eq!(same_versions, Taken::Incomplete { missing: 2, stale: 0 });
    bench.block(3, 5, 1, 1);
    assert_eq!(bench.0.held(), 1);
    assert!(bench.0.keyframe_needed());
    assert_eq!(bench.commit(3, &[(5, 1)]), Taken::Complete);
    assert_eq!(bench.block(2, 3, 20, 3), Taken::Refused(Refusal::Ended));
    assert_eq!(bench.commit(1, &[]), Taken::Refused(Refusal::Ended));
    assert_eq!(bench.seen(), [(5, [1, 1])], "it did not even end the snapshot");
}

#[test]
fn replaced_samples_are_given_back_and_no_more_than_the_bound_are_held() {
    let (sample, mut bench) = (whole(1), Bench::new(2));
    for version in 1..=3 {
        let taken = bench.0.take(&header(MapSampleKind::Block, 1, 1, version), sample.clone());
        assert_eq!(taken, Taken::Part);
    }
    assert_eq!(Rc::strong_count(&sample.0), 2);
    bench.block(1, 2, 1, 2);
    let third = bench.0.take(&header(MapSampleKind::Block, 1, 3, 1), sample.clone());
    assert_eq!((third, Rc::strong_count(&sample.0)), (Taken::Refused(Refusal::Full), 2));
    for x in 3..20 {
        assert_eq!(bench.delta(x, UNKNOWN_VERSION, 1, 1), Taken::Refused(Refusal::Full));
    }
    assert_eq!((bench.0.held(), bench.0.copies()), (2, 1));
}

#[test]
fn blocks_beyond_the_earth_are_refused_and_all_others_have_a_first_voxel() {
    let mut bench = Bench::new(4);
    let last = 21_000_000;
    for x in [last + 1, -last - 1, i32::MAX, i32::MIN] {
        assert_eq!(bench.block(1, x, 1, 1), Taken::Refused(Refusal::Place));
        assert_eq!(bench.delta(x, UNKNOWN_VERSION, 1, 1), Taken::Refused(Refusal::Place));
        let centre =
            MapHeader { center_voxel: [0, x.saturating_mul(100), 0], ..header(MapSampleKind::Commit, 1, 0, 0) };
        assert_eq!(bench.0.take(&centre, Sample(Rc::default())), Taken::Refused(Refusal::Place));
    }
    assert_eq!(bench.0.held(), 0);
    for x in [last, -last] {
        assert_eq!(bench.block(1, x, 1, 1), Taken::Part);
        assert_eq!(first_voxel([x, 0, 0]), [100 * x, 0, 0]);
    }
}

#[test]
fn nonsense_is_refused_and_changes_nothing_but_the_snapshots_end() {
    let mut bench = Bench::with_two_blocks();
    let short = Sample(Rc::new(vec![brick(1); 7]));
    let taken = bench.0.take(&header(MapSampleKind::Block, 1, 5, 11), short.clone());
    assert_eq!(taken, Taken::Refused(Refusal::Size));
    assert_eq!(bench.0.take(&header(MapSampleKind::Delta, 1, 0, 3), short), Taken::Refused(Refusal::Size));
    assert_eq!(bench.commit(1, &[(5, 10), (3, 20)]), Taken::Complete);
    let twice = bench.commit(1, &[(5, 10), (5, 10), (3, 20)]);
    assert_eq!(twice, Taken::Incomplete { missing: 1, stale: 0 }, "a table that lists a block twice is not believed");
}

#[test]
fn an_empty_map_is_a_complete_snapshot_without_blocks() {
    let mut bench = Bench::new(2);
    assert_eq!(bench.commit(1, &[]), Taken::Complete);
    assert_eq!(bench.0.complete().unwrap().blocks().len(), 0);
}

#[test]
fn requests_for_keyframes_coalesce_to_two_a_second() {
    let mut requests = KeyframeRequests::default();
    let asked = (0..100).filter(|i| requests.due(true, Timestamp::from_ns(i * 20_000_000))).count();
    assert_eq!(asked, 4, "2 s of asking every 20 ms");
    assert!(!requests.due(false, Timestamp::from_seconds(100.0)));
    assert!(requests.due(true, Timestamp::from_seconds(100.0)));
}

/// One thing that happens to a mapper, its topic or its reader.
#[derive(Clone, Debug)]
enum Event {
    /// Bricks `from` to `from + count` of block `x` change.
    Edit { x: i32, from: usize, count: usize },
    /// A block leaves the map; with the next edit it is new.
    Drop { x: i32 },
    /// A snapshot is published; `whole[x]` says how block `x` is sent, `lost` which of its samples are lost.
    Snapshot { keyframe: bool, whole: u8, lost: u8 },
    /// The reader starts anew.
    Join,
    /// The mapper starts anew.
    Restart,
}

fn events() -> impl Strategy<Value = Vec<Event>> {
    let edit = (0..4i32, 0..BRICKS_PER_BLOCK, 1..40usize).prop_map(|(x, from, count)| Event::Edit { x, from, count });
    // Three snapshots in four arrive whole.
    let lost = prop_oneof![3 => Just(0u8), 1 => any::<u8>()];
    let snapshot = (prop::bool::weighted(0.15), any::<u8>(), lost)
        .prop_map(|(keyframe, whole, lost)| Event::Snapshot { keyframe, whole, lost });
    let event = prop_oneof![
        8 => edit,
        8 => snapshot,
        1 => (0..4i32).prop_map(|x| Event::Drop { x }),
        1 => Just(Event::Join),
        1 => Just(Event::Restart),
    ];
    prop::collection::vec(event, 1..60)
}

/// A block of the model: bricks, the version published last, the bricks changed since.
struct Truth {
    bricks: Vec<Brick>,
    version: u32,
    dirty: Vec<u16>,
}

impl Default for Truth {
    fn default() -> Self {
        Self { bricks: vec![Brick::UNKNOWN; BRICKS_PER_BLOCK], version: 0, dirty: Vec::new() }
    }
}

/// A mapper as its reader must see it.
struct Model {
    epoch: u64,
    snapshot: u64,
    versions: u32,
    values: u8,
    blocks: BTreeMap<i32, Truth>,
}

impl Model {
    fn new(epoch: u64) -> Self {
        Self { epoch, snapshot: 0, versions: 0, values: 0, blocks: BTreeMap::new() }
    }

    fn edit(&mut self, x: i32, from: usize, count: usize) {
        let block = self.blocks.entry(x).or_default();
        for i in from..(from + count).min(BRICKS_PER_BLOCK) {
            self.values = self.values.wrapping_add(1);
            block.bricks[i] = brick(self.values);
            block.dirty.push(i as u16);
        }
        block.dirty.sort_unstable();
        block.dirty.dedup();
    }

    /// The samples of the next snapshot.
    fn snapshot(&mut self, keyframe: bool, whole: u8) -> Vec<(MapHeader, Vec<Brick>)> {
        let (mut samples, mut entries, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
        self.snapshot += 1;
        let header = |kind, x, version| MapHeader { snapshot: self.snapshot, ..header(kind, self.epoch, x, version) };
        for (&x, block) in &mut self.blocks {
            let (base, dirty) = (block.version, std::mem::take(&mut block.dirty));
            if !dirty.is_empty() {
                self.versions += 1;
                block.version = self.versions;
            }
            if keyframe || (!dirty.is_empty() && whole >> x & 1 == 1) {
                samples.push((header(MapSampleKind::Block, x, block.version), block.bricks.clone()));
            } else if !dirty.is_empty() {
                entries.push(DeltaEntry { key: [x, 0, 0], base, version: block.version, bricks: dirty.len() as u32 });
                numbers.extend(dirty);
            }
        }
        if !entries.is_empty() {
            let mut items = vec![brick(0xee); delta_items(entries.len(), numbers.len())];
            write_delta(&mut items, &entries, &numbers, |key| &self.blocks[&key[0]].bricks);
            samples.push((header(MapSampleKind::Delta, 0, entries.len() as u32), items));
        }
        let table: Vec<_> =
            self.blocks.iter().map(|(&x, block)| CommitEntry { key: [x, 0, 0], version: block.version }).collect();
        samples.push((header(MapSampleKind::Commit, 0, table.len() as u32), pack_commit(&table)));
        samples
    }

    /// Whether a reader's view is this mapper's, bit for bit.
    fn is_seen(&self, view: &Snapshot<'_, Vec<Brick>>) -> bool {
        (view.header.epoch, view.header.snapshot) == (self.epoch, self.snapshot)
            && view.blocks().len() == self.blocks.len()
            && self.blocks.iter().zip(view.versioned_blocks()).all(|((x, truth), (key, version, bricks))| {
                key == [*x, 0, 0] && version == truth.version && bricks == truth.bricks
            })
    }
}

const CASES: u32 = 400;
static VIEWS: AtomicUsize = AtomicUsize::new(0);
static INCOMPLETE: AtomicUsize = AtomicUsize::new(0);

fn whatever_happens(events: Vec<Event>) -> Result<(), TestCaseError> {
    let mut model = Model::new(1);
    let mut reader = SnapshotAssembler::new(BLOCKS_MAX);
    for event in events {
        match event {
            Event::Edit { x, from, count } => model.edit(x, from, count),
            Event::Drop { x } => drop(model.blocks.remove(&x)),
            Event::Join => reader = SnapshotAssembler::new(BLOCKS_MAX),
            Event::Restart => model = Model::new(model.epoch + 1),
            Event::Snapshot { keyframe, whole, lost } => {
                for (i, (header, items)) in model.snapshot(keyframe, whole).into_iter().enumerate() {
                    if lost >> (i % 8) & 1 == 1 {
                        continue;
                    }
                    let taken = reader.take(&header, items);
                    prop_assert_eq!(taken == Taken::Complete, reader.complete().is_some());
                    INCOMPLETE.fetch_add(usize::from(matches!(taken, Taken::Incomplete { .. })), Ordering::Relaxed);
                    if let Some(view) = reader.complete() {
                        prop_assert!(model.is_seen(&view));
                        VIEWS.fetch_add(1, Ordering::Relaxed);
                    }
                }
            }
        }
        prop_assert!(reader.copies() <= 4);
    }
    // Without losses a keyframe heals everything.
    for (header, items) in model.snapshot(true, 0) {
        reader.take(&header, items);
    }
    prop_assert!(reader.complete().is_some_and(|view| model.is_seen(&view)));
    Ok(())
}

#[test]
fn a_complete_view_is_the_mappers_bit_for_bit_whatever_is_edited_lost_or_restarted() {
    let mut runner = prop::test_runner::TestRunner::new_with_rng(
        ProptestConfig { cases: CASES, failure_persistence: None, ..ProptestConfig::default() },
        prop::test_runner::TestRng::deterministic_rng(prop::test_runner::RngAlgorithm::ChaCha),
    );
    runner.run(&events(), whatever_happens).unwrap();
    let (views, incomplete) = (VIEWS.load(Ordering::Relaxed), INCOMPLETE.load(Ordering::Relaxed));
    assert!(
        views > 4 * CASES as usize && incomplete > CASES as usize,
        "{views} views, {incomplete} incomplete commits"
    );
}
