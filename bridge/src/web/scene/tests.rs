//! Tests of the scene: messages in by hand, frames out through the hub.

use super::*;
use crate::web::frames::parse;
use crate::web::slots::Cursor;
use bytemuck::Zeroable;
use tsense_contract::{
    BRICKS_PER_BLOCK, CommitEntry, DeltaEntry, MapSampleKind, delta_items, pack_commit, write_delta,
};

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_seconds(1000.0 + seconds)
}

fn pose(zone: u8, easting_m: f64) -> Pose {
    Pose { zone, easting_m, northing_m: 3_279_000.0, altitude_m: 30.0, ..Pose::zeroed() }
}

fn header(kind: MapSampleKind, x: i32, version: u32) -> MapHeader {
    let (pose, kind) = (pose(17, 369_000.0), kind.to_wire());
    MapHeader { epoch: 1, key: [x, 0, 0], version, voxel_size_m: 0.15, pose, kind, ..MapHeader::zeroed() }
}

fn block_with(voxels: usize) -> Vec<Brick> {
    let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
    for brick in &mut bricks[..voxels] {
        (brick.occupancy[0], brick.confidence[0]) = (1, 1);
    }
    bricks
}

/// A scene that knows where it is, and the hub behind it, drained by one client.
struct Bench {
    scene: Scene,
    hub: Arc<Hub>,
    cursor: Cursor,
}

impl Bench {
    fn new() -> Self {
        let hub = Arc::new(Hub::default());
        let mut scene = Scene::new(Arc::clone(&hub), &Config::default());
        scene.pose(&pose(17, 369_000.7), at(0.0));
        let mut bench = Self { scene, hub, cursor: Cursor::default() };
        bench.kinds();
        bench
    }

    fn frames(&mut self) -> Vec<Frame> {
        std::iter::from_fn(|| self.hub.next(&mut self.cursor)).collect()
    }

    fn kinds(&mut self) -> Vec<Kind> {
        self.frames().iter().map(|frame| parse(frame).unwrap().0.kind).collect()
    }

    fn block(&mut self, x: i32, version: u32, voxels: usize) {
        self.scene.map(&header(MapSampleKind::Block, x, version), block_with(voxels), at(0.0));
    }

    /// Puts a visible voxel into brick 6000 of a block.
    fn delta(&mut self, x: i32, base: u32, version: u32) {
        let entry = DeltaEntry { key: [x, 0, 0], base, version, bricks: 1 };
        let (mut items, new) = (vec![Brick::UNKNOWN; delta_items(1, 1)], block_with(BRICKS_PER_BLOCK));
        write_delta(&mut items, &[entry], &[6000], |_| &new);
        self.scene.map(&header(MapSampleKind::Delta, 0, 1), items, at(0.0));
    }

    fn commit(&mut self, table: &[(i32, u32)]) {
        let entries: Vec<_> = table.iter().map(|&(x, version)| CommitEntry { key: [x, 0, 0], version }).collect();
        self.scene.map(&header(MapSampleKind::Commit, 0, entries.len() as u32), pack_commit(&entries), at(0.0));
    }
}

#[test]
fn a_snapshot_appears_at_its_commit_and_then_only_changed_blocks_are_sent() {
    let mut bench = Bench::new();
    bench.block(1, 1, 3);
    bench.block(2, 1, 4);
    assert_eq!(bench.kinds(), []);
    bench.commit(&[(1, 1), (2, 1)]);
    let frames = bench.frames();
    let last = parse(&frames[2]).unwrap();
    assert_eq!(last.0.kind, Kind::Commit);
    assert_eq!(last.1[16..24], [2, 0, 0, 0, 7, 0, 0, 0], "2 blocks, 7 voxels");
    bench.block(2, 2, 5);
    bench.commit(&[(1, 1), (2, 2)]);
    assert_eq!(bench.kinds(), [Kind::Block, Kind::Commit]);
}

#[test]
fn a_new_viewer_gets_the_blocks_of_the_map_and_not_those_that_left_it() {
    let mut bench = Bench::new();
    bench.block(1, 1, 3);
    bench.block(2, 1, 4);
    bench.commit(&[(1, 1), (2, 1)]);
    bench.commit(&[(2, 1)]);
    bench.cursor = Cursor::default();
    assert_eq!(bench.kinds(), [Kind::Hello, Kind::Vehicle, Kind::Block, Kind::Commit]);
}

#[test]
fn a_map_that_comes_before_the_first_pose_brings_its_own() {
    let mut bench = Bench { scene: Scene::new(Arc::default(), &Config::default()), ..Bench::new() };
    bench.block(1, 1, 3);
    bench.commit(&[(1, 1)]);
    assert!(!bench.scene.keyframe_needed() && bench.scene.drops().is_empty(), "{:?}", bench.scene.drops());
    bench.scene.place = None;
    bench.scene.grid(&GridHeader { zone: 17, ..GridHeader::zeroed() }, &[]);
    assert_eq!(bench.scene.drops()["before the first pose"], 1);
}

#[test]
fn an_incomplete_commit_changes_nothing_is_counted_and_needs_a_keyframe() {
    let mut bench = Bench::new();
    bench.block(1, 1, 3);
    bench.commit(&[(1, 1), (2, 1)]);
    assert_eq!(bench.kinds(), []);
    assert!(bench.scene.keyframe_needed());
    assert_eq!(bench.scene.drops()["incomplete snapshot"], 1);
}

#[test]
fn a_delta_shows_at_its_commit_and_a_lost_one_leaves_the_screen_as_it_was_until_the_keyframe() {
    let mut bench = Bench::new();
    bench.block(1, 1, 3);
    bench.block(2, 1, 4);
    bench.commit(&[(1, 1), (2, 1)]);
    bench.frames();
    bench.delta(2, 1, 2);
    assert_eq!(bench.kinds(), []);
    bench.commit(&[(1, 1), (2, 2)]);
    let frames = bench.frames();
    assert_eq!(frames.iter().map(|f| parse(f).unwrap().0.kind).collect::<Vec<_>>(), [Kind::Block, Kind::Commit]);
    assert_eq!(parse(&frames[1]).unwrap().1[16..24], [2, 0, 0, 0, 8, 0, 0, 0], "a voxel more");
    // The delta from 2 to 3 is lost.
    bench.delta(2, 3, 4);
    bench.commit(&[(1, 1), (2, 4)]);
    assert_eq!(bench.kinds(), []);
    assert!(bench.scene.keyframe_needed());
    assert_eq!(bench.scene.drops()["incomplete snapshot"], 1);
    bench.cursor = Cursor::default();
    let of_blocks = bench.frames().into_iter().filter(|f| parse(f).unwrap().0.kind == Kind::Block);
    let versions: Vec<u8> = of_blocks.map(|frame| parse(&frame).unwrap().1[12]).collect();
    assert_eq!(versions, [1, 2], "what was shown last");
    bench.block(1, 1, 3);
    bench.block(2, 4, 9);
    bench.commit(&[(1, 1), (2, 4)]);
    assert_eq!(bench.kinds(), [Kind::Block, Kind::Commit]);
    assert!(!bench.scene.keyframe_needed());
}

#[test]
fn data_of_another_zone_is_dropped_and_a_vehicle_in_another_zone_empties_the_screen() {
    let mut bench = Bench::new();
    bench.block(1, 1, 3);
    bench.commit(&[(1, 1)]);
    bench.scene.grid(&GridHeader { zone: 18, ..GridHeader::zeroed() }, &[]);
    assert_eq!(bench.scene.drops()["another zone"], 1);
    bench.scene.pose(&pose(18, 200_000.0), at(1.0));
    bench.cursor = Cursor::default();
    assert_eq!(bench.kinds(), [Kind::Hello, Kind::Vehicle]);
    assert!(bench.scene.keyframe_needed());
}

#[test]
fn the_origin_stays_within_a_kilometre_and_coordinates_stay_small() {
    let mut bench = Bench::new();
    bench.scene.pose(&pose(17, 369_900.0), at(1.0));
    bench.scene.pose(&pose(17, 370_100.25), at(2.0));
    let frames = bench.frames();
    let (header, payload) = parse(frames.last().unwrap()).unwrap();
    assert_eq!(header.origin_m[0], 370_100.0);
    assert_eq!(payload[..4], 0.25f32.to_le_bytes());
}

#[test]
fn nonsense_is_counted_by_cause_and_never_shown() {
    let mut bench = Bench::new();
    bench.scene.pose(&pose(0, 0.0), at(1.0));
    bench.scene.pose(&pose(17, f64::NAN), at(1.0));
    bench.scene.map(&header(MapSampleKind::Block, 0, 1), vec![], at(1.0));
    bench.scene.grid(&GridHeader { zone: 17, width: 3, height: 3, ..GridHeader::zeroed() }, &[]);
    assert_eq!(bench.kinds(), []);
    let causes: Vec<_> = bench.scene.drops().iter().map(|(cause, n)| (*cause, *n)).collect();
    let expected = [("block of another size", 1), ("grid of another shape", 1), ("pose without a position", 2)];
    assert_eq!(causes, expected);
}

#[test]
fn scans_are_thinned_to_the_configured_rate_but_all_are_counted() {
    let mut bench = Bench::new();
    let header = PointsHeader { zone: 17, ..PointsHeader::zeroed() };
    let mut shown = 0;
    for i in 0..=150 {
        bench.scene.points(&header, &[PlacedReturn::zeroed(); 541], at(f64::from(i) * 0.02));
        shown += bench.frames().len();
    }
    assert_eq!(shown, 31, "3 s at 10 Hz");
    let counters = bench.scene.publish_counters(at(3.0));
    assert_eq!(counters["scans_per_s"], 50.0);
    assert_eq!(counters["beams_per_s"], 27050.0);
}
