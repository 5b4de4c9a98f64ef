//! The store under a map that rolls: out and back, damaged files, failing disks, limits, queues.
#![allow(clippy::disallowed_methods, reason = "tests look at the files that the store made")]

use super::*;
use crate::beams::{Beam, BeamKind, Weight};
use crate::config::{FadingConfig, Scheme, SchemeConfig};
use crate::ladar_mount::LadarMount;
use crate::testing::{Random, joint_at, pose_at, scan_at};
use crate::voxel_map::VoxelMap;
use std::fs;
use std::path::PathBuf;
use tsense_contract::{VoxelState, locate};
use tsense_geometry::Point;

/// A folder of its own for each test, gone when the test ends.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("tsense-blocks-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        Self(path)
    }
    fn files(&self, ending: &str) -> Vec<PathBuf> {
        let zones = fs::read_dir(&self.0).into_iter().flatten().flatten();
        let files = zones.flat_map(|zone| fs::read_dir(zone.path()).into_iter().flatten().flatten());
        let mut found: Vec<_> = files.map(|file| file.path()).collect();
        found.retain(|path| path.to_string_lossy().ends_with(ending));
        found.sort();
        found
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

const HOME: [f64; 3] = [369_000.0, 3_279_000.0, 40.0];
const MOMENT: Moment = Moment { epoch: 1, faded: 0, stamp: Timestamp::from_ns(1_000_000_000) };

fn config(scheme: Scheme) -> Config {
    let still = FadingConfig { per_second: 0.0, per_metre: 0.0, ..FadingConfig::default() };
    Config { scheme: SchemeConfig { scheme, ..SchemeConfig::default() }, fading: still, ..Config::default() }
}

fn header() -> MapFileHeader {
    MapFileHeader::in_zone(0.15, MOMENT.stamp, 32, false)
}

/// A map with its store, in one thread.
struct Rig {
    map: VoxelMap,
    worker: Worker,
    random: Random,
    faults: Vec<StoreFault>,
}

impl Rig {
    fn new(scratch: &Scratch, config: &Config, limit_bytes: u64) -> Self {
        let mut map = VoxelMap::new(config).unwrap();
        map.keep_leaving();
        let worker = Worker::new(scratch.0.clone(), limit_bytes, Continuation::new(config));
        Self { map, worker, random: Random(7), faults: Vec::new() }
    }

    /// Moves by `east_m` from home, and lets the store do all there is to do.
    fn go(&mut self, east_m: f64) -> &mut Self {
        assert!(self.map.center_on(Point::new(HOME[0] + east_m, HOME[1], HOME[2])));
        for block in self.map.take_leaving() {
            let block = StoredBlock { stamp: MOMENT.stamp, epoch: MOMENT.epoch, ..block };
            let done = self.worker.work(Job::Save { header: header(), block, joins: false });
            self.faults.extend(if let Done::NotSaved(fault) = done { Some(fault) } else { None });
        }
        for key in self.map.take_entered() {
            match self.worker.work(Job::Load { header: header(), key, request: 0 }) {
                Done::Loaded { found: Ok(Some(block)), .. } => assert!(self.map.restore(&block, &MOMENT)),
                Done::Loaded { found: Err(fault), .. } => self.faults.push(fault),
                _ => {}
            }
        }
        self
    }

    /// Looks around: windows of beams in all directions.
    fn look(&mut self, east_m: f64) -> &mut Self {
        let origin = Point::new(HOME[0] + east_m, HOME[1], HOME[2]);
        for _ in 0..3 {
            for _ in 0..400 {
                let mut reach = || self.random.between(-16.0, 16.0);
                let end = Point::new(origin.x() + reach(), origin.y() + reach(), origin.z() + reach() / 3.0);
                let kind = if self.random.bits().is_multiple_of(4) { BeamKind::NoReturn } else { BeamKind::Hit };
                self.map.insert(&Beam { origin, end, kind, weight: Weight::FULL });
            }
            self.map.close_window();
        }
        self
    }

    fn drive(&mut self, from_m: i32, to_m: i32) -> &mut Self {
        let step = if to_m > from_m { 2 } else { -2 };
        for i in 0..=(to_m - from_m) / step {
            self.go(f64::from(from_m + i * step));
        }
        self
    }
}

#[test]
fn a_drive_out_and_back_gives_every_block_back_bit_for_bit() {
    for scheme in [Scheme::Confidence, Scheme::IncrementDecrement, Scheme::HitRatio] {
        let scratch = Scratch::new(&format!("back-{scheme:?}"));
        let mut rig = Rig::new(&scratch, &config(scheme), 1 << 30);
        rig.go(0.0).look(0.0);
        let before = rig.map.copy_all();
        rig.drive(0, 100);
        assert_eq!(rig.map.blocks().count(), 0, "all is behind");
        assert_eq!(scratch.files(".tsmap").len(), before.len());
        rig.look(100.0).drive(100, 0);
        let after = rig.map.copy_all();
        assert!(before.len() > 8 && before.iter().map(|b| b.bricks.len()).sum::<usize>() > 10_000);
        assert!(before == after, "{scheme:?}: {} blocks went, {} came back", before.len(), after.len());
        assert_eq!(rig.faults, vec![]);
        // They are part of the next snapshot, as changes of blocks that readers do not know.
        let mut snapshot = crate::snapshot::Snapshot::default();
        rig.map.snapshot(false, &mut snapshot);
        assert!(snapshot.changes.iter().all(|entry| entry.base == 0));
        assert_eq!(snapshot.changes.len() + snapshot.whole.len(), after.len());
    }
}

#[test]
fn what_the_open_window_knows_is_counted_before_a_block_leaves() {
    let scratch = Scratch::new("open-window");
    let mut rig = Rig::new(&scratch, &config(Scheme::Confidence), 1 << 30);
    rig.go(0.0);
    let origin = Point::new(HOME[0], HOME[1], HOME[2]);
    let end = Point::new(HOME[0] + 6.0, HOME[1] + 0.01, HOME[2] + 0.01);
    rig.map.insert(&Beam { origin, end, kind: BeamKind::Hit, weight: Weight::FULL });
    let (passed, hit) = (Point::new(HOME[0] + 2.0, HOME[1], HOME[2]), end);
    let state = |map: &VoxelMap, at| map.voxel(map.grid().index_of(at).unwrap()).state;
    assert_eq!(state(&rig.map, passed), VoxelState::Unknown, "misses count when the window ends");
    rig.drive(0, 100).drive(100, 0);
    assert_eq!([passed, hit].map(|at| state(&rig.map, at)), [VoxelState::Free, VoxelState::Occupied]);
}

#[test]
fn a_block_that_beams_have_reached_before_it_was_read_is_continued() {
    let scratch = Scratch::new("continued");
    let mut rig = Rig::new(&scratch, &config(Scheme::Confidence), 1 << 30);
    rig.go(0.0).look(0.0);
    let before = rig.map.copy_all();
    rig.drive(0, 100);
    assert!(rig.map.center_on(Point::new(HOME[0], HOME[1], HOME[2])));
    rig.look(0.0);
    let key = before.iter().max_by_key(|block| block.bricks.len()).unwrap().key;
    let Done::Loaded { found: Ok(Some(stored)), .. } = rig.worker.work(Job::Load { header: header(), key, request: 0 })
    else {
        panic!("it was stored");
    };
    let live: Vec<_> = rig.map.block(key).unwrap().to_vec();
    assert!(rig.map.restore(&stored, &MOMENT));
    let (then, now) = (stored.to_bricks(), rig.map.block(key).unwrap());
    let mut both = 0;
    for ((then, live), now) in then.iter().zip(&live).zip(now) {
        for voxel in 0..64 {
            let sum = then.confidence[voxel].saturating_add(live.confidence[voxel]);
            assert_eq!(now.confidence[voxel], sum);
            both += usize::from(then.confidence[voxel] > 0 && live.confidence[voxel] > 0);
            assert!(live.occupancy[voxel] <= 0 || now.occupancy[voxel] > 0, "a new thing shows at once");
        }
    }
    assert!(both > 500, "{both}");
}

#[test]
fn a_damaged_file_is_set_aside_and_its_block_starts_unknown() {
    let scratch = Scratch::new("damaged");
    let mut rig = Rig::new(&scratch, &config(Scheme::Confidence), 1 << 30);
    rig.go(0.0).look(0.0).drive(0, 100);
    let files = scratch.files(".tsmap");
    let mut bytes = fs::read(&files[0]).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&files[0], bytes).unwrap();
    // Another block's file under this name: whole, but not what was asked for.
    fs::copy(&files[2], &files[1]).unwrap();
    rig.drive(100, 0);
    assert_eq!(rig.map.blocks().count(), files.len() - 2);
    let said: Vec<_> = rig.faults.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said.iter().any(|s| s.contains("checksum") && s.contains("the block starts unknown")), "{said:?}");
    assert!(said.iter().any(|s| s.contains("under another block's name")), "{said:?}");
    assert!(said.iter().all(|s| s.contains("set aside as") && s.contains(".tsmap.damaged")), "{said:?}");
    assert_eq!((scratch.files(".tsmap").len(), scratch.files(".damaged").len()), (files.len() - 2, 2));
}

#[test]
fn a_disk_that_fails_loses_the_block_says_so_and_leaves_nothing_half_written() {
    let scratch = Scratch::new("full");
    let mut folder = Folder::open(&scratch.0, 1 << 30).unwrap();
    let other = Scratch::new("full-other");
    let mut rig = Rig::new(&other, &config(Scheme::Confidence), 1 << 30);
    rig.go(0.0).look(0.0);
    let block = rig.map.copy_all().remove(0);
    let path = folder.path_of(&header(), block.key);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    // Every write to this device finds it full.
    std::os::unix::fs::symlink("/dev/full", path.with_extension("tsmap.part")).unwrap();
    let said = folder.save(&header(), &block).unwrap_err().to_string();
    assert!(said.contains("No space left") && said.contains("blocks are not stored"), "{said}");
    assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 0);
    assert_eq!(folder.usage(), (0, 0));
    assert_eq!(folder.save(&header(), &block), Ok(0), "and goes on when there is space");
    let nowhere = scratch.0.join("a-file");
    fs::write(&nowhere, "").unwrap();
    let refused = Folder::open(&nowhere, 1 << 30).unwrap_err().to_string();
    assert!(refused.contains("check the folder's permissions"), "{refused}");
}

#[test]
fn beyond_the_limit_the_oldest_blocks_go_first() {
    let scratch = Scratch::new("limit");
    let other = Scratch::new("limit-other");
    let mut rig = Rig::new(&other, &config(Scheme::Confidence), 1 << 30);
    rig.go(0.0).look(0.0);
    let block = rig.map.copy_all().remove(0);
    let size = tsmap_bytes(&block);
    let mut folder = Folder::open(&scratch.0, 3 * size).unwrap();
    let at = |x: i32| StoredBlock { key: [x, 0, 0], ..block.clone() };
    for x in [1, 2, 3] {
        assert_eq!(folder.save(&header(), &at(x)), Ok(0));
    }
    assert_eq!(folder.save(&header(), &at(1)), Ok(0), "it takes its own place, and is now the newest");
    assert_eq!(folder.save(&header(), &at(4)), Ok(1));
    assert_eq!(folder.load(&header(), [2, 0, 0]), Ok(None));
    assert!(folder.load(&header(), [1, 0, 0]).unwrap().is_some());
    assert_eq!(folder.usage(), (3, 3 * size));
    // A new life finds them, and in their order.
    let mut again = Folder::open(&scratch.0, 2 * size).unwrap();
    assert_eq!((again.usage(), again.save(&header(), &at(5))), ((3, 3 * size), Ok(2)));
    assert!(Folder::open(&scratch.0, 10).unwrap().save(&header(), &at(6)).is_err());
}

fn tsmap_bytes(block: &StoredBlock) -> u64 {
    crate::tsmap::encode(&header(), std::slice::from_ref(block)).len() as u64
}

#[test]
fn other_zones_and_voxel_sizes_lie_apart() {
    let folder = Folder::open(&Scratch::new("zones").0, 1 << 20).unwrap();
    let name = |header: MapFileHeader| {
        folder.path_of(&header, [1, -2, 3]).strip_prefix(&Scratch::new("zones").0).unwrap().display().to_string()
    };
    assert_eq!(name(header()), "32N-0.15m/1_-2_3.tsmap");
    assert_eq!(name(MapFileHeader::in_zone(0.1, MOMENT.stamp, 33, true)), "33S-0.1m/1_-2_3.tsmap");
}

/// A mapper that has looked at one place for two seconds.
fn fed(config: &Config, epoch: u64) -> Mapper {
    let mut mapper = Mapper::new(config, vec![LadarMount::default()], epoch).unwrap();
    for i in 0..20 {
        let s = 1000.0 + f64::from(i) * 0.1;
        mapper.add_pose(&pose_at(s, HOME));
        mapper.add_joint(&joint_at(s, 0.0, 0));
        let (header, returns) = scan_at(s + 0.05);
        mapper.add_scan(0, &header, &returns, Timestamp::from_seconds(s + 0.06));
    }
    mapper
}

fn trace_all(mapper: &mut Mapper) {
    while mapper.trace_next(Timestamp::from_seconds(1002.0)).is_some() {}
}

fn wait_for(store: &mut BlockStore, mapper: &mut Mapper, done: impl Fn(&BlockStore) -> bool) {
    for _ in 0..2000 {
        store.turn(mapper);
        if done(store) {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    panic!("never: {:?} {:?}", store.counts(), store.fault());
}

fn away(s: f64) -> tsense_contract::Pose {
    pose_at(s, [HOME[0] + 200.0, HOME[1], HOME[2]])
}

#[test]
fn the_mapper_finds_its_blocks_again_after_a_detour_and_after_a_restart() {
    let scratch = Scratch::new("mapper");
    let config = config(Scheme::Confidence);
    let mut mapper = fed(&config, 1);
    let mut store = BlockStore::start(&scratch.0, &config, &mut mapper).unwrap();
    wait_for(&mut store, &mut mapper, |store| store.wanted() == 0);
    trace_all(&mut mapper);
    let ahead = mapper.map().grid().index_of(Point::new(HOME[0], HOME[1] + 3.0, HOME[2])).unwrap();
    let known = mapper.map().copy_of_all();
    mapper.add_pose(&away(1003.0));
    wait_for(&mut store, &mut mapper, |store| store.wanted() == 0 && store.counts().saved > 0);
    assert_eq!(mapper.map().voxel(ahead).state, VoxelState::Unknown);
    mapper.add_pose(&pose_at(1004.0, HOME));
    wait_for(&mut store, &mut mapper, |store| store.wanted() == 0);
    assert_eq!(mapper.map().voxel(ahead).state, VoxelState::Occupied);
    let counts = store.finish(&mut mapper, true);
    assert_eq!((counts.saved, counts.restored), (2 * known as u64, known as u64), "{counts:?}");
    assert_eq!((counts.queue_full, counts.write_failed, counts.read_failed), (0, 0, 0));

    let mut next_life = fed(&config, 2);
    let mut store = BlockStore::start(&scratch.0, &config, &mut next_life).unwrap();
    wait_for(&mut store, &mut next_life, |store| store.counts().restored == known as u64);
    assert_eq!(next_life.map().voxel(ahead), mapper.map().voxel(ahead));
    store.finish(&mut next_life, false);
}

impl VoxelMap {
    fn copy_of_all(&self) -> usize {
        self.blocks().filter(|(_, bricks)| bricks.iter().any(|b| *b != tsense_contract::Brick::UNKNOWN)).count()
    }
}

#[test]
fn a_full_queue_drops_counts_and_never_waits() {
    let config = config(Scheme::Confidence);
    let mut mapper = fed(&config, 1);
    mapper.map_mut().keep_leaving();
    trace_all(&mut mapper);
    let (jobs, waiting) = sync_channel(1);
    let (_finished, done) = channel();
    let counts = StoreCounts::default();
    let mut store = BlockStore {
        jobs: Some(jobs),
        done,
        thread: None,
        wanted: BTreeMap::new(),
        next_request: 0,
        counts,
        fault: None,
    };
    store.turn(&mut mapper);
    mapper.add_pose(&away(1003.0));
    store.turn(&mut mapper);
    assert!(store.counts().queue_full > 0, "nobody took the one request that fits");
    assert!(store.wanted() > 9, "what could not be asked for is asked for later");
    drop(waiting);
    store.turn(&mut mapper);
    assert!(store.fault().unwrap().to_string().contains("the thread that stores blocks is gone"));
}

#[test]
fn poses_that_make_no_sense_move_no_block() {
    let config = config(Scheme::Confidence);
    let mut mapper = fed(&config, 1);
    mapper.map_mut().keep_leaving();
    trace_all(&mut mapper);
    let (key, ..) = locate(mapper.map().center());
    let good = away(1003.0);
    let refused = [
        tsense_contract::Pose { zone: 33, ..good },
        tsense_contract::Pose { south: 1, ..good },
        tsense_contract::Pose { northing_m: HOME[1] + 1.0e7, ..good },
        tsense_contract::Pose { northing_m: f64::NAN, ..good },
        tsense_contract::Pose { easting_m: f64::INFINITY, ..good },
        tsense_contract::Pose { altitude_m: f64::NEG_INFINITY, ..good },
    ];
    for pose in &refused {
        assert!(!mapper.add_pose(pose), "{pose:?}");
    }
    assert_eq!(mapper.placer().drops().of(crate::DropCause::PoseRefused), refused.len() as u64);
    assert_eq!((mapper.map_mut().take_leaving().len(), locate(mapper.map().center()).0), (0, key));
    let nowhere = [f64::NAN, f64::INFINITY, HOME[0] + 1.0e7, 1e300];
    for x in nowhere {
        let (here, there) = (Point::new(HOME[0], HOME[1], HOME[2]), Point::new(x, HOME[1], HOME[2]));
        for (origin, end) in [(there, here), (there, there)] {
            let beam = Beam { origin, end, kind: BeamKind::Hit, weight: Weight::FULL };
            let hits = mapper.map_mut().insert(&beam);
            assert!(!hits || (x.abs() < 2.0e7 && end == here), "{x}");
        }
    }
    assert!(!mapper.map_mut().center_on(Point::new(f64::NAN, 0.0, 0.0)));
    assert!(mapper.add_pose(&good), "and a good one is taken afterwards");
}

#[test]
#[ignore = "measures; run in release"]
fn measure_blocks() {
    let scratch = Scratch::new("measure");
    let config = config(Scheme::Confidence);
    let mut rig = Rig::new(&scratch, &config, 1 << 30);
    rig.go(0.0);
    for _ in 0..20 {
        rig.look(0.0);
    }
    let ms = |start: std::time::Instant, n: usize| start.elapsed().as_secs_f64() * 1e3 / n as f64;
    let start = std::time::Instant::now();
    let blocks = rig.map.copy_all();
    let copy_ms = ms(start, blocks.len());
    let start = std::time::Instant::now();
    let files: Vec<_> = blocks.iter().map(|b| crate::tsmap::encode(&header(), std::slice::from_ref(b))).collect();
    let encode_ms = ms(start, blocks.len());
    let start = std::time::Instant::now();
    let read: Vec<_> = files.iter().map(|file| crate::tsmap::decode(file).unwrap().1.remove(0)).collect();
    let decode_ms = ms(start, blocks.len());
    let mut fresh = Rig::new(&scratch, &config, 1 << 30);
    fresh.map.center_on(Point::new(HOME[0], HOME[1], HOME[2]));
    let start = std::time::Instant::now();
    read.iter().for_each(|block| assert!(fresh.map.restore(block, &MOMENT)));
    let restore_ms = ms(start, blocks.len());
    let bytes = files.iter().map(Vec::len).sum::<usize>() / files.len();
    let bricks = blocks.iter().map(|b| b.bricks.len()).sum::<usize>() / blocks.len();
    println!("{} blocks of {bricks} known bricks, {bytes} bytes each", blocks.len());
    println!("ms a block: copy {copy_ms:.2}, encode {encode_ms:.2}, decode {decode_ms:.2}, restore {restore_ms:.2}");
}
