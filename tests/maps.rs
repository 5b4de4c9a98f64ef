//! Map files from end to end: made by a survey, looked at, compared, exported, damaged, loaded; saved from a running
//! graph whose blocks outlive it.
#![allow(clippy::disallowed_methods, reason = "tests read and write files, and wait")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

mod harness;

use harness::{PATIENCE, TestGraph, all_alive, complaint, output};
use las::Reader;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tsense_simulator::{
    GposOptions, Lms151Options, Motion, PanTiltOptions, VehicleOptions, World, WorldClock, WorldOptions,
};

/// A folder of its own for each test, gone when the test ends.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("tsense-maps-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
    fn file(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const ORIGIN: [f64; 3] = [500_010.0, 5_000_010.0, 102.0];

/// What the beams of a plot aim at: a square of flat ground, and a wall of 3 m behind it.
fn targets() -> impl Iterator<Item = [f64; 3]> {
    let corner = [ORIGIN[0] - 8.0, ORIGIN[1] - 8.0];
    let at = move |i: i32| corner[0] + f64::from(i % 160) * 0.1;
    let ground = (0..160 * 160).map(move |i| [at(i), corner[1] + f64::from(i / 160) * 0.1, 100.05]);
    ground.chain((0..160 * 30).map(move |i| [at(i), corner[1] + 16.05, 100.1 + f64::from(i / 160) * 0.1]))
}

/// A ray cloud of that, seen from 2 m above the middle; with a box of 1 x 1 x 1 m on the ground, or without. Every
/// direction is measured in three windows, so that what a beam passes is sure.
fn write_rays(path: &str, with_box: bool) {
    let properties = ["x", "y", "z", "time", "nx", "ny", "nz"].map(|name| format!("property double {name}\n")).concat();
    let (mut rays, mut count) = (Vec::new(), 0);
    let low = [ORIGIN[0] + 3.0, ORIGIN[1] + 3.0, 100.0];
    for pass in 0..3 {
        for target in targets() {
            let way: [f64; 3] = std::array::from_fn(|axis| target[axis] - ORIGIN[axis]);
            let share = if with_box { entry(&ORIGIN, &way, &low).unwrap_or(1.0) } else { 1.0 };
            let end: [f64; 3] = std::array::from_fn(|axis| ORIGIN[axis] + way[axis] * share);
            let back: [f64; 3] = std::array::from_fn(|axis| ORIGIN[axis] - end[axis]);
            for c in [end[0], end[1], end[2], f64::from(pass) * 60.0, back[0], back[1], back[2]] {
                rays.extend(c.to_le_bytes());
            }
            rays.push(255u8);
            count += 1;
        }
    }
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}property uchar alpha\nend_header\n"
    );
    std::fs::write(path, [head.into_bytes(), rays].concat()).unwrap();
}

/// Share of a way at which it enters a cube of 1 m, if it does before its end.
fn entry(from: &[f64; 3], way: &[f64; 3], low: &[f64; 3]) -> Option<f64> {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for axis in 0..3 {
        let at = |side: f64| (low[axis] + side - from[axis]) / way[axis];
        enter = enter.max(at(0.0).min(at(1.0)));
        leave = leave.min(at(0.0).max(at(1.0)));
    }
    (enter < leave).then_some(enter + 1e-6)
}

/// Surveys a made-up plot into a map file.
fn survey(scratch: &Scratch, name: &str, with_box: bool) -> String {
    let (rays, map) = (scratch.file(&format!("{name}.ply")), scratch.file(&format!("{name}.tsmap")));
    write_rays(&rays, with_box);
    let out = scratch.file(&format!("{name}-results"));
    succeeds(&["survey", &rays, "--out", &out, "--crs", "EPSG:32632", "--map", &map, "--quiet"]);
    map
}

fn succeeds(arguments: &[&str]) -> String {
    let done = output(arguments);
    assert!(done.status.success(), "{arguments:?}: {}", complaint(&done));
    String::from_utf8(done.stdout).unwrap()
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&succeeds(arguments)).expect("one JSON value on standard output")
}

fn fails(arguments: &[&str], code: i32, words: &str) {
    let done = output(arguments);
    assert_eq!(done.status.code(), Some(code), "{arguments:?}: {}", complaint(&done));
    assert!(complaint(&done).contains(words), "{arguments:?}: {}", complaint(&done));
    assert!(done.stdout.is_empty(), "{arguments:?}");
}

#[test]
fn a_map_of_a_survey_is_looked_at_compared_and_exported() {
    let scratch = Scratch::new("commands");
    let (before, after) = (survey(&scratch, "before", false), survey(&scratch, "after", true));
    let info = json(&["map", "info", &before, "--json"]);
    assert_eq!((&info["epsg"], &info["zone"], &info["damaged_blocks"]), (&32632.into(), &32.into(), &0.into()));
    let occupied = info["voxels"]["occupied"].as_u64().unwrap();
    // 16 x 16 m of ground and 16 x 3 m of wall in voxels of 0.15 m: 11 378 + 2 133, and those at the rims.
    assert!((13_000..15_000).contains(&occupied), "{occupied}");
    // Central meridian of zone 32: 9 degrees east at 500 km.
    let degrees: Vec<f64> = info["extent_deg"].as_array().unwrap().iter().map(|d| d.as_f64().unwrap()).collect();
    assert!(degrees[0] < 9.0002 && degrees[2] > 9.0001 && degrees[1] > 45.1 && degrees[3] < 45.2, "{degrees:?}");
    assert!(succeeds(&["map", "info", &before]).contains("UTM zone 32N, EPSG:32632"));

    let changes = scratch.file("changes.ply");
    let changed = json(&["map", "diff", &before, &after, "--json", "--touching", "3", "--out", &changes]);
    let appeared = changed["appeared"].as_u64().unwrap();
    // The two faces and the lid that look at the sensor, about 7 x 7 voxels each; beams before saw through most of them.
    assert!((30..250).contains(&appeared), "{changed}");
    assert!(changed["forgotten"].as_u64().unwrap() > 0, "the shadow of the box: {changed}");
    assert!(std::fs::read(&changes).unwrap().starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    let same = json(&["map", "diff", &after, &after, "--json"]);
    assert_eq!((&same["appeared"], &same["newly_free"], &same["forgotten"]), (&0.into(), &0.into(), &0.into()));
    let both = scratch.file("both.tsmap");
    let fused = json(&["map", "fuse", &before, &after, "--weight", "1", "--out", &both, "--json"]);
    assert_eq!(fused["bytes"], std::fs::metadata(&both).unwrap().len());
    let shadow = json(&["map", "diff", &before, &both, "--json"]);
    assert_eq!(shadow["forgotten"], 0, "what the box hides in one map is known by the other: {shadow}");
    for name in ["points.las", "points.laz"] {
        check_las(&before, &scratch.file(name), occupied);
    }
    let ply = scratch.file("points.ply");
    let exported = json(&["map", "export", &before, "--out", &ply, "--color", "confidence", "--json"]);
    assert_eq!((&exported["points"], &exported["file"]), (&occupied.into(), &ply.as_str().into()));
    let bytes = std::fs::read(&ply).unwrap();
    let head = String::from_utf8_lossy(&bytes[..400]).into_owned();
    let data = bytes.len() - head.find("end_header\n").unwrap() - 11;
    assert!(head.contains(&format!("element vertex {occupied}")) && head.contains("uchar scalar_confidence"), "{head}");
    assert_eq!(data as u64, occupied * (3 * 8 + 3 + 2));
}

/// The export holds every occupied voxel, its attributes, and its coordinate system.
fn check_las(map: &str, out: &str, occupied: u64) {
    succeeds(&["map", "export", map, "--out", out]);
    let mut reader = Reader::from_path(out).unwrap();
    let header = reader.header();
    assert_eq!(header.number_of_points(), occupied);
    assert_eq!(header.get_geotiff_crs().unwrap().unwrap().get_projected_crs_geo_key_value(), Some(32632));
    let extra = header.vlrs().iter().find(|vlr| vlr.record_id == 4).unwrap();
    assert_eq!((extra.data.len(), extra.data[2], extra.data[194]), (384, 2, 1));
    assert!(extra.data[4..].starts_with(b"occupancy\0") && extra.data[196..].starts_with(b"confidence\0"));
    let points = reader.read_points(occupied).unwrap();
    for point in points.points().map(Result::unwrap) {
        assert!((point.extra_bytes[0] as i8) > 0 && point.extra_bytes[1] > 0);
        let in_voxels = point.x / 0.15 - 0.5;
        assert!((in_voxels - in_voxels.round()).abs() < 1e-3 && (99.0..105.0).contains(&point.z), "{point:?}");
    }
}

#[test]
fn what_is_no_map_or_damaged_ends_with_6_and_leaves_nothing_behind() {
    let scratch = Scratch::new("damaged");
    let map = survey(&scratch, "plot", true);
    let mut bytes = std::fs::read(&map).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 16;
    let (bad, out) = (scratch.file("bad.tsmap"), scratch.file("bad.laz"));
    std::fs::write(&bad, &bytes).unwrap();
    fails(&["map", "export", &bad, "--out", &out], 6, "the file is damaged; copy or save it again");
    fails(&["map", "diff", &map, &bad], 6, "checksum");
    assert!(!Path::new(&out).exists() && !Path::new(&scratch.file("bad.part")).exists());
    let told = output(&["map", "info", &bad, "--json"]);
    let info: Value = serde_json::from_slice(&told.stdout).unwrap();
    assert_eq!(
        (told.status.code(), info["damaged_blocks"].as_u64()),
        (Some(6), Some(1)),
        "the others are told all the same"
    );
    std::fs::write(&bad, &bytes[..bytes.len() - 9]).unwrap();
    fails(&["map", "export", &bad, "--out", &out], 6, "byte ");
    fails(&["map", "fuse", &map, &bad, "--out", &out], 6, "checksum");
    fails(&["map", "publish", &bad, "--as", "y"], 6, "checksum");
    fails(&["map", "publish", &map, "--as", "y", "--graph", "not-running"], 1, "not-running");
    fails(&["map", "info", &scratch.file("plot.ply")], 6, "this is no map file");
    fails(&["map", "info", &scratch.file("nothing.tsmap")], 2, "no such file");
    fails(&["map", "export", &map, "--out", &scratch.file("points.xyz")], 2, "ends in .las, .laz or .ply");
    fails(&["map", "export", &map, "--out", "/dev/null/points.las"], 2, "there is no folder /dev/null");
    fails(&["map", "save", &out, "--graph", "not-running"], 1, "not-running");
    assert_eq!(output(&["map", "export", &map]).status.code(), Some(2));
}

#[test]
fn a_map_is_loaded_into_the_store_of_a_graph_that_is_not_running() {
    let scratch = Scratch::new("load");
    let map = survey(&scratch, "plot", false);
    let blocks = json(&["map", "info", &map, "--json"])["blocks"].as_u64().unwrap();
    let mut graph = TestGraph::prepare("", "[mapper]\n[mapper.blocks]\nmode = \"store\"\n");
    let config = graph.config_file().display().to_string();
    let load = ["map", "load", &map, "--config", &config];
    let done = output(&load);
    assert!(complaint(&done).contains(&format!("{blocks} blocks stored, 0 kept")), "{}", complaint(&done));
    assert!(complaint(&output(&load)).contains(&format!("0 blocks stored, {blocks} kept")));
    let stored = std::fs::read_dir(graph.state_dir().join("blocks/32N-0.15m")).unwrap();
    for file in stored.map(|file| file.unwrap().path().display().to_string()) {
        assert_eq!(json(&["map", "info", &file, "--json"])["blocks"], 1, "a block file is a map file");
    }
    graph.launch();
    graph.wait_until("the mapper is alive", all_alive);
    fails(&load, 1, "is running");
    graph.finish();
    let discards = scratch.file("discards.toml");
    std::fs::write(&discards, "[graph]\nname = \"mapsdisc\"\n[mapper]\n").unwrap();
    fails(&["map", "load", &map, "--config", &discards], 3, "set it to \"store\"");
    std::fs::write(&discards, "[graph]\nname = \"mapsdisc\"\n[mapper]\nvoxel_size_m = 0.2\nblocks.mode = \"store\"\n")
        .unwrap();
    fails(&["map", "load", &map, "--config", &discards], 2, "voxel_size_m is 0.2");
}

fn world(scratch: &Scratch, vehicle: VehicleOptions) -> World {
    let any = "127.0.0.1:0".to_owned();
    let options = WorldOptions {
        lms151: Some(Lms151Options { address: any.clone(), spin_up_s: 0.1, ..Lms151Options::default() }),
        pan_tilt: Some(PanTiltOptions { link: scratch.file("pan-tilt"), ..PanTiltOptions::default() }),
        gpos: Some(GposOptions { address: any, ..GposOptions::default() }),
        vehicle,
        ..WorldOptions::default()
    };
    World::start(&options, WorldClock::starting_now(1.0)).expect("the world starts")
}

/// A mapper that stores blocks, and the sensors it needs. Nothing fades, so that whatever was known stays known.
fn sections(world: &World) -> String {
    let addresses = world.addresses();
    let (ladar, gpos) = (addresses.lms151.expect("a ladar"), addresses.gpos.expect("a position system"));
    let pan_tilt = addresses.pan_tilt.as_ref().expect("a pan-tilt unit");
    format!(
        "[[ladar]]\naddress = \"{ladar}\"\ntilt_from_ladar = {{ x_m = 0.05, z_m = -0.1 }}\n\
         [pan_tilt]\naddress = {pan_tilt:?}\nmount = {{ x_m = 0.6, z_m = -1.7 }}\n[gpos]\naddress = \"tcp:{gpos}\"\n\
         [mapper]\nfading = {{ per_second = 0.0, per_metre = 0.0 }}\nblocks = {{ mode = \"store\" }}\n"
    )
}

/// Saves the running graph's map until it holds at least so many known voxels.
fn save_until(graph: &TestGraph, file: &str, reached: impl Fn(&str) -> bool) {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        let saved = output(&["map", "save", file, "--graph", graph.domain().name(), "--json"]);
        if saved.status.success() && reached(file) {
            let said: Value = serde_json::from_slice(&saved.stdout).unwrap();
            assert_eq!(said["bytes"], std::fs::metadata(file).unwrap().len(), "{said}");
            return;
        }
    }
    panic!("never: {file}\n{:#?}\n{}", graph.status(), graph.log());
}

#[test]
fn the_map_of_a_graph_is_saved_and_comes_back_after_a_restart() {
    let scratch = Scratch::new("graph");
    let world = world(&scratch, VehicleOptions::default());
    let mut graph = TestGraph::start("", &sections(&world));
    let (before, after) = (scratch.file("before.tsmap"), scratch.file("after.tsmap"));
    let known = |file: &str| {
        let info = json(&["map", "info", file, "--json"]);
        ["free", "occupied"].iter().map(|state| info["voxels"][state].as_u64().unwrap()).sum::<u64>()
    };
    // Half a sweep of the head and more.
    save_until(&graph, &before, |file| known(file) > 100_000);
    assert_eq!(graph.stop(), Some(0), "{}", graph.log());
    let stored = std::fs::read_dir(graph.state_dir().join("blocks")).unwrap().count();
    assert_eq!(stored, 1, "one zone, one voxel size");
    graph.launch();
    graph.wait_until("every process is alive", all_alive);
    let start = Instant::now();
    // What was known before the restart is known again: a mapper without its blocks would need a whole sweep.
    save_until(&graph, &after, |file| json(&["map", "diff", &before, file, "--json"])["forgotten"] == 0);
    println!("{} known voxels before, {} after, {:?} after the start", known(&before), known(&after), start.elapsed());
    graph.finish();
    drop(world);
}

/// Every stored block, by its name.
fn stored_blocks(graph: &TestGraph) -> BTreeMap<String, Vec<u8>> {
    let zones = std::fs::read_dir(graph.state_dir().join("blocks")).into_iter().flatten().flatten();
    let files = zones.flat_map(|zone| std::fs::read_dir(zone.path()).into_iter().flatten().flatten());
    let whole = files.filter(|file| file.path().extension().is_some_and(|e| e == "tsmap"));
    // A file that was removed or replaced meanwhile is looked at the next time.
    whole.filter_map(|f| Some((f.file_name().into_string().ok()?, std::fs::read(f.path()).ok()?))).collect()
}

/// An oval of 51 m at 4 m/s, blocks of 5 x 5 x 2 m: each is left behind, and found again 13 s later.
#[test]
fn a_vehicle_that_comes_round_again_finds_what_it_left() {
    let scratch = Scratch::new("drive");
    let vehicle = VehicleOptions { motion: Motion::Drive, speed_m_s: 4.0, waits_s: 0.5, ..VehicleOptions::default() };
    let world = world(&scratch, vehicle);
    let small = "voxel_size_m = 0.05\nworking_space_m = [6.0, 6.0, 6.0]\n";
    let mut graph = TestGraph::start("", &format!("{}{small}", sections(&world)));
    let (mut first, mut again) = (BTreeMap::new(), BTreeMap::new());
    let start = Instant::now();
    while again.len() < 12 {
        assert!(start.elapsed() < 2 * PATIENCE, "{} and {} blocks\n{}", first.len(), again.len(), graph.log());
        std::thread::sleep(Duration::from_millis(50));
        for (name, bytes) in stored_blocks(&graph) {
            let left = first.entry(name.clone()).or_insert_with(|| bytes.clone());
            if *left != bytes {
                again.insert(name, bytes);
            }
        }
    }
    assert_eq!(graph.stop(), Some(0), "{}", graph.log());
    let (then, now) = (scratch.file("then.tsmap"), scratch.file("now.tsmap"));
    let mut kept = 0;
    for (name, bytes) in &again {
        std::fs::write(&then, &first[name]).unwrap();
        std::fs::write(&now, bytes).unwrap();
        let difference = json(&["map", "diff", &then, &now, "--json"]);
        assert_eq!(difference["forgotten"], 0, "{name}: {difference}");
        kept += difference["unchanged"].as_u64().unwrap();
    }
    println!("{} blocks left, {} found again, {kept} voxels kept, {:?}", first.len(), again.len(), start.elapsed());
    let log = graph.log();
    let counts = log.lines().rev().find(|line| line.contains("stored blocks")).unwrap_or_default();
    println!("{counts}");
    assert!(kept > 10_000 && counts.contains("restored=") && !counts.contains("restored=0"), "{counts}");
}
