//! Another sensor's voxels in the map of a running graph: what nobody else saw becomes occupied, what the ladar sees through
//! stays free, a sensor that stops is told, what is dropped is counted; and yesterday's map as a prior.
#![allow(clippy::disallowed_methods, reason = "tests read and write files, and wait")]

mod harness;
#[path = "../bridge/tests/common/python.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod python;

use bytemuck::Zeroable;
use harness::world::TestWorld;
use harness::{Folder, PATIENCE, TestGraph, complaint, output, row};
use python::python_with;
use std::process::Command;
use std::time::{Duration, Instant};
use tsense_contract::{
    BRICKS_PER_BLOCK, Brick, Pose, Poses, SensedVoxel, VoxelState, Voxels, VoxelsHeader, VoxelsKind, locate,
};
use tsense_geometry::{Point, Timestamp, VoxelGrid, VoxelIndex};
use tsense_mapper::tsmap::{self, MapFileHeader, StoredBlock};
use tsense_ports::{Inbox, Outbox, Process};

const SIZE_M: f64 = 0.15;
const SENSORS: &str = "[mapper]\n[[mapper.voxel_sensor]]\nname = \"stereo\"\nweight = 0.25\n\
    [[mapper.voxel_sensor]]\nname = \"yesterday\"\nweight = 0.25\nsilence_max_s = 0.0\n";

/// A stereo camera.
struct Stereo {
    process: Process,
    voxels: Outbox<Voxels>,
    pose: Pose,
    sequence: u64,
}

impl Stereo {
    fn open(graph: &TestGraph) -> Self {
        let mut process = graph.observer();
        let mut poses: Inbox<Poses> = process.inbox(None).unwrap();
        let voxels = process.outbox(Some("stereo")).unwrap();
        let start = Instant::now();
        let pose = loop {
            assert!(start.elapsed() < PATIENCE, "no pose\n{}", graph.log());
            process.wait(0.1);
            let newest = poses.take_newest().unwrap().0.map(|pose| *pose.header());
            if let Some(pose) = newest.filter(|pose| pose.zone != 0) {
                break pose;
            }
        };
        Self { process, voxels, pose, sequence: 0 }
    }

    fn header(&mut self) -> VoxelsHeader {
        self.sequence += 1;
        VoxelsHeader {
            stamp_ns: self.process.clock().now().ns,
            sequence: self.sequence,
            origin_m: [self.pose.easting_m, self.pose.northing_m, self.pose.altitude_m].map(f64::floor),
            voxel_size_m: SIZE_M,
            zone: self.pose.zone,
            south: self.pose.south,
            kind: VoxelsKind::Measured.to_wire(),
            ..VoxelsHeader::zeroed()
        }
    }

    /// Says that voxels are occupied, ten times a second.
    fn insist(&mut self, voxels: &[VoxelIndex], span: Duration) {
        let start = Instant::now();
        while start.elapsed() < span {
            let header = self.header();
            let items = voxels.iter().map(|voxel| {
                let at_m = grid().center_of(*voxel).to_array();
                let xyz_m = std::array::from_fn(|axis| (at_m[axis] - header.origin_m[axis]) as f32);
                SensedVoxel::new(xyz_m, VoxelState::Occupied)
            });
            self.voxels.send(&header, &items.collect::<Vec<_>>()).unwrap();
            self.process.wait(0.1);
        }
    }

    /// Voxels in a row, some metres above the vehicle: no beam comes there.
    fn above(&self, up_m: f64) -> Vec<VoxelIndex> {
        let at = Point::new(self.pose.easting_m, self.pose.northing_m, self.pose.altitude_m + up_m);
        let [x, y, z] = grid().index_of(at).unwrap();
        (0..5).map(|i| [x + i, y, z]).collect()
    }
}

fn grid() -> VoxelGrid {
    VoxelGrid::new(SIZE_M).unwrap()
}

/// The map of a running graph, read by the command.
struct Saved(Vec<StoredBlock>);

impl Saved {
    fn of(graph: &TestGraph, folder: &Folder) -> Self {
        let file = folder.0.join("now.tsmap").display().to_string();
        let saved = output(&["map", "save", &file, "--graph", graph.domain().name(), "--patience", "30"]);
        assert!(saved.status.success(), "{}\n{}", complaint(&saved), graph.log());
        Self(tsmap::decode(&std::fs::read(file).unwrap()).unwrap().1)
    }

    fn states(&self, voxels: &[VoxelIndex]) -> Vec<VoxelState> {
        let state = |voxel: &VoxelIndex| {
            let (key, brick, inner) = locate(*voxel);
            let block = self.0.iter().find(|block| block.key == key);
            block.map_or(VoxelState::Unknown, |block| block.brick(brick).state(inner))
        };
        voxels.iter().map(state).collect()
    }

    /// Voxels that beams have passed in several windows, some of each block.
    fn surely_free(&self) -> Vec<VoxelIndex> {
        let mut free = Vec::new();
        for block in &self.0 {
            let sure = block.known_bricks().filter(|(_, brick)| brick.occupancy.iter().all(|o| *o <= -8));
            free.extend(sure.take(10).map(|(place, _)| voxel_in(block, place)));
        }
        free
    }
}

/// The first voxel of a brick.
fn voxel_in(block: &StoredBlock, place: usize) -> VoxelIndex {
    let first = tsense_contract::first_voxel(block.key);
    let [x, y, _] = tsense_contract::BLOCK_BRICKS;
    let brick = [place % x, place / x % y, place / (x * y)];
    std::array::from_fn(|axis| first[axis] + 4 * brick[axis] as i32)
}

/// A map file with these voxels occupied.
fn write_map(path: &str, voxels: &[VoxelIndex], zone: u8) {
    let header = MapFileHeader::in_zone(SIZE_M, Timestamp::from_ns(1), zone, false);
    let mut blocks: Vec<(_, Vec<Brick>)> = Vec::new();
    for voxel in voxels {
        let (key, brick, inner) = locate(*voxel);
        if blocks.iter().all(|(other, _)| *other != key) {
            blocks.push((key, vec![Brick::UNKNOWN; BRICKS_PER_BLOCK]));
        }
        let (_, bricks) = blocks.iter_mut().find(|(other, _)| *other == key).unwrap();
        (bricks[brick].occupancy[inner], bricks[brick].confidence[inner]) = (8, 8);
    }
    let blocks: Vec<_> = blocks.iter().map(|(key, bricks)| StoredBlock::of(*key, bricks, &[])).collect();
    std::fs::write(path, tsmap::encode(&header, &blocks)).unwrap();
}

fn all(voxels: &[VoxelIndex], state: VoxelState) -> Vec<VoxelState> {
    vec![state; voxels.len()]
}

/// Saves the map until it is as wanted.
fn until(graph: &TestGraph, folder: &Folder, what: &str, reached: impl Fn(&Saved) -> bool) -> Saved {
    let start = Instant::now();
    loop {
        let saved = Saved::of(graph, folder);
        if reached(&saved) {
            return saved;
        }
        assert!(start.elapsed() < PATIENCE, "never: {what}\n{:#?}\n{}", graph.status(), graph.log());
    }
}

#[test]
fn a_second_sensor_adds_what_nobody_saw_does_not_override_the_ladar_and_its_end_and_faults_are_told() {
    let (world, folder) = (TestWorld::start(), Folder::new("fusion"));
    let graph = TestGraph::start("", &world.sections().replace("[mapper]\n", SENSORS));
    let mut stereo = Stereo::open(&graph);
    graph.wait_until("the camera is missed", |status| {
        row(status, "mapper")["reason"].as_str().unwrap().contains("missing: voxels of stereo")
    });
    // Three nods: what beams pass is then as free as can be.
    let seen = until(&graph, &folder, "much is surely free", |saved| saved.surely_free().len() >= 50).surely_free();
    let above = stereo.above(5.5);
    assert_eq!(Saved::of(&graph, &folder).states(&above), all(&above, VoxelState::Unknown));

    // Three nods, of 2.25 s each, and more.
    stereo.insist(&[seen.clone(), above.clone()].concat(), Duration::from_secs(9));
    assert_eq!(row(&graph.status().unwrap(), "mapper")["state"], "running", "{}", graph.log());
    let now = Saved::of(&graph, &folder);
    assert_eq!(now.states(&above), all(&above, VoxelState::Occupied));
    let kept = now.states(&seen).iter().filter(|state| **state == VoxelState::Free).count();
    assert!(kept * 20 >= seen.len() * 19, "{kept} of {} free voxels stay free", seen.len());

    for spoil in [
        |header: &mut VoxelsHeader| header.zone = 7,
        |header: &mut VoxelsHeader| header.stamp_ns -= 5_000_000_000,
        |header: &mut VoxelsHeader| header.voxel_size_m = 1.0,
        |header: &mut VoxelsHeader| header.origin_m[0] += 1e4,
    ] {
        let mut header = stereo.header();
        spoil(&mut header);
        stereo.voxels.send(&header, &[SensedVoxel::new([0.0; 3], VoxelState::Free)]).unwrap();
        stereo.process.wait(0.2);
    }
    graph.wait_until("each drop is counted by its cause, and the camera's end is told", |status| {
        let mapper = row(status, "mapper");
        let causes = ["of another zone", "too old", "of a wrong size", "outside the window"];
        let is_told = mapper["reason"] == "missing: voxels of stereo" && mapper["state"] == "degraded";
        is_told && causes.iter().all(|cause| mapper["dropped"][format!("voxels {cause}")] == 1)
    });
    drop(stereo);
    graph.finish();
}

#[test]
fn yesterdays_map_is_a_prior_that_fills_what_nobody_knows() {
    let (world, folder) = (TestWorld::start(), Folder::new("prior"));
    let graph = TestGraph::start("", &world.sections().replace("[mapper]\n", SENSORS));
    let stereo = Stereo::open(&graph);
    let (file, elsewhere) = (folder.0.join("y.tsmap"), folder.0.join("z.tsmap"));
    let [file, elsewhere] = [file, elsewhere].map(|path| path.display().to_string());
    let seen = until(&graph, &folder, "much is surely free", |saved| saved.surely_free().len() >= 50).surely_free();
    let above = stereo.above(6.0);
    write_map(&file, &[seen.clone(), above.clone()].concat(), stereo.pose.zone);
    write_map(&elsewhere, &above, stereo.pose.zone + 1);
    let publish = |file: &str, name: &str, further: &[&str]| {
        output(&[&["map", "publish", file, "--as", name, "--graph", graph.domain().name()], further].concat())
    };
    let told = publish(&file, "yesterday", &["--for", "6s", "--every", "1s", "--json", "-q"]);
    assert!(told.status.success() && told.stderr.is_empty(), "{}", complaint(&told));
    let told: serde_json::Value = serde_json::from_slice(&told.stdout).expect("one JSON value");
    let voxels = (seen.len() + above.len()) as u64;
    let rounds = told["rounds"].as_u64().unwrap();
    assert!(rounds >= 3 && told["voxels"].as_u64().unwrap() >= (rounds - 1) * voxels, "{told}");
    let now = Saved::of(&graph, &folder);
    assert_eq!(now.states(&above), all(&above, VoxelState::Occupied));
    let kept = now.states(&seen).iter().filter(|state| **state == VoxelState::Free).count();
    assert!(kept * 20 >= seen.len() * 19, "{kept} of {} free voxels stay free", seen.len());
    let mapper = graph.process("mapper");
    assert!(mapper["dropped"].as_object().unwrap().keys().all(|cause| !cause.contains("voxel")), "{mapper:#}");

    for (file, name, code, words) in [
        (&elsewhere, "yesterday", 2, "the vehicle in UTM zone"),
        (&file, "tomorrow", 1, "is this one part of the graph's configuration?"),
    ] {
        let refused = publish(file, name, &["--for", "20s"]);
        assert_eq!(refused.status.code(), Some(code), "{}", complaint(&refused));
        assert!(complaint(&refused).contains(words), "{}", complaint(&refused));
    }
    drop(stereo);
    graph.finish();
}

#[test]
fn the_sender_of_the_documents_tells_of_a_wall() {
    let Some(python) = python_with("iceoryx2, numpy") else { return };
    let (world, folder) = (TestWorld::start(), Folder::new("python"));
    // At full weight no beam that sees through overrules it.
    let sensors = SENSORS.replace("weight = 0.25", "weight = 1.0");
    let graph = TestGraph::start("", &world.sections().replace("[mapper]\n", &sensors));
    let stereo = Stereo::open(&graph);
    let (at, graph_name) = (stereo.pose, graph.domain().name());
    drop(stereo);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/voxels.py");
    let told = Command::new(python).args([script, "stereo", "6", graph_name]).output().unwrap();
    assert!(told.status.success(), "{}\n{}", complaint(&told), graph.log());
    let wall: Vec<_> = [-1.2, -0.6, 0.0, 0.6, 1.2]
        .map(|east_m| Point::new(at.easting_m + east_m, at.northing_m + 7.95, at.altitude_m + 1.5))
        .map(|place| grid().index_of(place).unwrap())
        .into();
    until(&graph, &folder, "the wall stands", |saved| saved.states(&wall) == all(&wall, VoxelState::Occupied));
    graph.finish();
}
