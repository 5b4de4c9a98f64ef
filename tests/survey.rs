//! Surveys from end to end: what is in the folder, tiles against the whole, memory, bad files, a kill in the middle.
//!
//! Rays come from the simulator's forest, cast as a vehicle drives through it. Where a Python with rasterio, rio-cogeo,
//! laspy and pyogrio is named by `TSENSE_PYTHON` (or is `python3`), other people's programs read the files, too.
#![allow(clippy::disallowed_methods, reason = "tests read and write files, and wait")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured and what they skipped")]

mod harness;
#[path = "../bridge/tests/common/python.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod python;

use harness::{complaint, output, tsense};
use las::Reader;
use python::python_with;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use tsense_simulator::{RayCase, RayOptions, Scene, SceneName, ray_cloud};

/// Bytes of a ray in the simulator's clouds: x y z and time as doubles, the way back as floats, the colour.
const RAY: usize = 4 * 8 + 3 * 4 + 4;
/// Every file of a survey.
const FILES: [&str; 14] = [
    "brush.tif",
    "brush_density.tif",
    "chm.tif",
    "cloud.laz",
    "dtm.tif",
    "dtm_sd.tif",
    "evidence.tif",
    "objects.gpkg",
    "rejected.csv",
    "report.html",
    "report.json",
    "slope.tif",
    "traversability.tif",
    "trees.csv",
];

/// A folder of its own for each test, gone when the test ends.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("tsense-survey-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
    fn file(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        std::fs::write(self.0.join(name), bytes).unwrap();
        self.file(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Names in a folder, sorted.
fn names_in(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A drive of 40 m through the forest: about 400,000 rays.
fn drive() -> &'static [u8] {
    static DRIVE: OnceLock<Vec<u8>> = OnceLock::new();
    DRIVE.get_or_init(|| {
        let options = RayOptions { case: RayCase::Drive, for_s: 15.0, ..RayOptions::default() };
        ray_cloud(Arc::new(Scene::new(SceneName::Forest, 7)), &options).0
    })
}

/// Header and rays of a cloud.
fn split(cloud: &[u8]) -> (String, &[u8]) {
    let end = cloud.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    (String::from_utf8(cloud[..end].to_vec()).unwrap(), &cloud[end..])
}

/// The same drive several times, one after the other, each farther east: a longer drive.
fn longer(cloud: &[u8], times: usize) -> Vec<u8> {
    let (header, rays) = split(cloud);
    let count = rays.len() / RAY;
    let mut out = header.replace(&format!("vertex {count}"), &format!("vertex {}", count * times)).into_bytes();
    for i in 0..times {
        for ray in rays.chunks_exact(RAY) {
            let number = |at: usize| f64::from_le_bytes(ray[at..at + 8].try_into().unwrap());
            out.extend((number(0) + 60.0 * i as f64).to_le_bytes());
            out.extend_from_slice(&ray[8..24]);
            out.extend((number(24) + 20.0 * i as f64).to_le_bytes());
            out.extend_from_slice(&ray[32..]);
        }
    }
    out
}

fn survey(input: &str, out: &str, more: &[&str]) -> Value {
    let mut words = vec!["survey", input, "--out", out, "--crs", "EPSG:32617+5773", "--json"];
    words.extend(more);
    let done = output(&words);
    assert!(done.status.success(), "{}", complaint(&done));
    serde_json::from_slice(&done.stdout).unwrap()
}

/// Position and diameter of each tree.
fn trees(folder: &str) -> Vec<[f64; 3]> {
    let text = std::fs::read_to_string(format!("{folder}/trees.csv")).unwrap();
    let row = |line: &str| {
        let fields: Vec<f64> = line.split(',').map(|field| field.parse().unwrap_or(f64::NAN)).collect();
        [fields[1], fields[2], fields[4]]
    };
    text.lines().skip(1).map(row).collect()
}

/// Height of the ground below each point of a cloud by what tells the point, millimetres and nanoseconds.
fn ground_below(folder: &str) -> BTreeMap<[i64; 4], f64> {
    let mut reader = Reader::from_path(format!("{folder}/cloud.laz")).unwrap();
    let count = reader.header().number_of_points();
    let points = reader.read_points(count).unwrap();
    let points = points.points().map(Result::unwrap);
    let below = points.map(|p| {
        let up_m = f32::from_le_bytes(p.extra_bytes[4..8].try_into().unwrap());
        let key = [p.x * 1e3, p.y * 1e3, p.z * 1e3, p.gps_time.unwrap() * 1e9].map(|v| v.round() as i64);
        (key, if up_m == -9999.0 { f64::NAN } else { p.z - f64::from(up_m) })
    });
    below.collect()
}

#[test]
fn tiles_agree_with_the_whole_and_leave_the_same_files() {
    let scratch = Scratch::new("tiles");
    let input = scratch.write("drive.ply", drive());
    let (whole, tiled) = (scratch.file("whole"), scratch.file("tiled"));
    assert_eq!(survey(&input, &whole, &["--tile", "1000"])["tiles"], 1);
    let tiles = survey(&input, &tiled, &["--tile", "38.4"])["tiles"].as_u64().unwrap();
    assert!(tiles >= 4, "{tiles} tiles");
    assert_eq!(
        (names_in(&whole), names_in(&tiled)),
        (FILES.map(String::from).to_vec(), FILES.map(String::from).to_vec())
    );
    // Trees: all but those at the edge of what is seen at all; most a centimetre apart, none more than three.
    let (a, b) = (trees(&whole), trees(&tiled));
    let near = |tree: &[f64; 3], others: &[[f64; 3]]| {
        let off = |other: &[f64; 3]| (other[0] - tree[0]).hypot(other[1] - tree[1]);
        others.iter().map(|other| (off(other), (other[2] - tree[2]).abs())).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
    };
    let matched: Vec<(f64, f64)> = a.iter().map(|tree| near(tree, &b)).filter(|(off, _)| *off < 0.1).collect();
    println!("{} trees whole, {} in {tiles} tiles, {} the same", a.len(), b.len(), matched.len());
    assert!(a.len() > 20 && matched.len() + 1 >= a.len().max(b.len()));
    let within = |off_max: f64, dbh_max: f64| {
        let agree = matched.iter().filter(|(off, dbh)| *off < off_max && (dbh.is_nan() || *dbh <= dbh_max)).count();
        agree as f64 / matched.len() as f64
    };
    assert!(within(0.015, 0.025) >= 0.9 && within(0.03, 0.06) == 1.0, "{matched:?}");
    // Ground: the same below every return, but for a few at the edge.
    let (a, b) = (ground_below(&whole), ground_below(&tiled));
    let both = a.iter().filter_map(|(key, z)| Some((z - b.get(key)?).abs())).filter(|d| d.is_finite());
    let mut apart: Vec<f64> = both.collect();
    apart.sort_by(f64::total_cmp);
    let at = |share: f64| apart[(share * (apart.len() - 1) as f64) as usize];
    println!(
        "ground apart below {} of {} returns: median {:.4}, 99 % {:.4}, most {:.4} m",
        apart.len(),
        a.len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
    assert!(apart.len() > 100_000 && at(0.5) < 0.001 && at(0.99) < 0.08);
}

#[test]
fn a_cloud_without_sensor_positions_gives_the_same_stems_and_says_what_is_missing() {
    let scratch = Scratch::new("points");
    let (beams, points) = (scratch.file("beams"), scratch.file("points"));
    assert_eq!(survey(&scratch.write("drive.ply", drive()), &beams, &[])["stems_from"], "beams");
    // What a survey wrote of all returns is a cloud that forgot where its beams came from.
    let done = output(&["survey", &format!("{beams}/cloud.laz"), "--out", &points, "--json"]);
    assert!(done.status.success() && complaint(&done).contains("points alone"), "{}", complaint(&done));
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert!(report["processor_s"]["ground and trees"].as_f64().is_some_and(|s| s > 0.0), "seconds by stage");
    assert_eq!(report["stems_from"], "points");
    assert!(report["notes"].to_string().contains("do not say where their beams came from"), "{}", report["notes"]);
    assert_eq!((&report["epsg"], &report["epsg_heights"]), (&json!(32617), &json!(5773)), "the file's own system");
    let score = output(&["score", "forest:7", &points, "--json"]);
    let score: Value = serde_json::from_slice(&score.stdout).unwrap();
    println!("{} stems by beams, {} by points: {}", trees(&beams).len(), trees(&points).len(), score["trees"]);
    let at_least = |name: &str, least: f64| assert!(score["trees"][name].as_f64().unwrap() >= least, "{score}");
    at_least("precision", 0.97);
    at_least("recall", 0.9);
}

#[test]
fn the_thesis_chain_can_be_had_whole_and_with_either_of_its_grounds() {
    let scratch = Scratch::new("thesis");
    let input = scratch.write("drive.ply", drive());
    let ground_rms_m = ["surface", "interpolation", "tiles"].map(|ground| {
        let out = scratch.file(ground);
        let report = survey(&input, &out, &["--detector", "thesis", "--ground", ground]);
        assert_eq!(report["stems_from"], "columns");
        let score = output(&["score", "forest:7", &out, "--json"]);
        let score: Value = serde_json::from_slice(&score.stdout).unwrap();
        println!("{ground}: {score}");
        score["ground"]["rmse_m"].as_f64().unwrap()
    });
    let [surface, interpolation, tiles] = ground_rms_m;
    assert!(surface < interpolation.min(tiles) && interpolation != tiles, "{ground_rms_m:?}");
}

#[test]
fn settings_in_a_file_change_what_they_name_and_options_win_against_them() {
    let scratch = Scratch::new("settings");
    let input = scratch.write("drive.ply", drive());
    let thesis = "[classifier]\ndetector = \"thesis\"\n[classifier.ground]\nmethod = \"tiles\"\n";
    let settings = scratch.write("thesis.toml", thesis);
    let surveyed = |name: &str, more: &[&str]| {
        let out = scratch.file(name);
        survey(&input, &out, more);
        ["trees.csv", "dtm.tif"].map(|file| std::fs::read(format!("{out}/{file}")).unwrap())
    };
    let by_file = surveyed("by-file", &["--settings", &settings]);
    let by_options = surveyed("by-options", &["--detector", "thesis", "--ground", "tiles"]);
    assert!(by_file == by_options, "the same settings, another survey");
    let [_, dtm] = surveyed("both", &["--settings", &settings, "--ground", "surface"]);
    assert!(dtm != by_file[1], "--ground says nothing against the file");
    // All that is printed, given back, is what is done without.
    let shown = output(&["config", "show", "--survey"]);
    let all = scratch.write("all.toml", shown.stdout);
    assert!(surveyed("all", &["--settings", &all]) == surveyed("none", &[]));
    let wrong = scratch.write("wrong.toml", "[classifier.trunk]\nthresold = 1.0\n");
    let refused = output(&["survey", &input, "--out", &scratch.file("wrong"), "--settings", &wrong]);
    assert_eq!(refused.status.code(), Some(3), "{}", complaint(&refused));
    assert!(
        complaint(&refused).contains("wrong.toml:2:1: [classifier] thresold: unknown key"),
        "{}",
        complaint(&refused)
    );
    assert!(!Path::new(&scratch.file("wrong")).exists());
}

/// The most memory that a survey held, megabytes, as the system counts it.
fn peak_mb(input: &str, out: &str) -> u64 {
    let mut child = tsense(&["survey", input, "--out", out, "--tile", "38.4"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
        let kb = line.split_whitespace().nth(1).and_then(|kb| kb.parse().ok());
        peak = kb.map_or(peak, |kb: u64| peak.max(kb / 1024));
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(child.wait().unwrap().success());
    peak
}

#[test]
fn a_drive_four_times_as_long_needs_no_more_memory() {
    let scratch = Scratch::new("memory");
    let one = peak_mb(&scratch.write("one.ply", longer(drive(), 1)), &scratch.file("a"));
    let four = peak_mb(&scratch.write("four.ply", longer(drive(), 4)), &scratch.file("b"));
    println!("peak: {one} MB for 40 m, {four} MB for 220 m");
    // Rays wait in 64 MB before they go to the disk; that is all that may differ.
    assert!(four <= one + 80, "{one} MB, {four} MB");
}

/// A file's name and bytes, further arguments, the exit code, and what the error must say.
type BadFile = (&'static str, Vec<u8>, &'static [&'static str], i32, String);

#[test]
fn bad_input_says_where_and_leaves_nothing() {
    let scratch = Scratch::new("bad");
    let (header, rays) = split(drive());
    let count = rays.len() / RAY;
    let few = |n: usize, change: &dyn Fn(&mut Vec<u8>)| {
        let mut rays = rays[..n * RAY].to_vec();
        change(&mut rays);
        [header.replace(&format!("vertex {count}"), &format!("vertex {n}")).into_bytes(), rays].concat()
    };
    let third = header.len() - count.to_string().len() + 3 + 2 * RAY;
    let cases: [BadFile; 10] = [
        ("cut.ply", few(100, &|rays| rays.truncate(999)), &[], 6, "truncated".into()),
        (
            "nan.ply",
            few(100, &|rays| rays[2 * RAY..][..8].copy_from_slice(&f64::NAN.to_le_bytes())),
            &[],
            6,
            format!("byte {third}"),
        ),
        (
            "dark.ply",
            few(10, &|rays| rays.chunks_mut(RAY).for_each(|ray| ray[RAY - 1] = 0)),
            &[],
            6,
            "no return among them".into(),
        ),
        ("empty.ply", Vec::new(), &[], 6, "line 1".into()),
        (
            "text.ply",
            header.replace("binary_little_endian", "ascii").into_bytes(),
            &[],
            6,
            "line 2: format 'ascii'".into(),
        ),
        ("less.ply", header.replace("property double time\n", "").into_bytes(), &[], 6, "no property 'time'".into()),
        ("cloud.laz", b"LASF".to_vec(), &[], 6, "complete LAS".into()),
        ("short.laz", b"LASF".to_vec(), &["--origin", "0,0,0"], 6, "byte 4: the file ends".into()),
        ("degrees.ply", few(10, &|_| {}), &["--crs", "EPSG:4326"], 2, "not projected".into()),
        ("what.xyz", b"1 2 3".to_vec(), &[], 2, "unknown kind of file".into()),
    ];
    for (name, bytes, more, code, said) in cases {
        let (input, out) = (scratch.write(name, bytes), scratch.file(&format!("out-{name}")));
        let mut words = vec!["survey", &input, "--out", &out];
        words.extend(more);
        let done = output(&words);
        let complaint = complaint(&done);
        assert_eq!(done.status.code(), Some(code), "{name}: {complaint}");
        assert!(complaint.contains(&said), "{name}: wanted '{said}' in: {complaint}");
        assert!(names_in(&out).is_empty(), "{name} left {:?}", names_in(&out));
    }
    let gone = output(&["survey", &scratch.file("none.ply"), "--out", &scratch.file("x")]);
    assert_eq!(gone.status.code(), Some(2), "{}", complaint(&gone));
    let file = scratch.write("file", "in the way");
    let blocked =
        output(&["survey", &scratch.write("good.ply", few(1000, &|_| {})), "--out", &format!("{file}/folder")]);
    assert_eq!(blocked.status.code(), Some(1), "{}", complaint(&blocked));
}

#[test]
fn a_survey_that_is_killed_leaves_no_file_under_its_name_and_the_next_one_is_whole() {
    let scratch = Scratch::new("killed");
    let (input, out) = (scratch.write("drive.ply", drive()), scratch.file("out"));
    let deadline = Instant::now() + Duration::from_secs(120);
    for wanted in [1, 4] {
        let mut child =
            tsense(&["survey", &input, "--out", &out, "--tile", "38.4"]).stdout(Stdio::null()).spawn().unwrap();
        // Killed as soon as it writes, and when it has written tiles for a while.
        while names_in(&out).len() < wanted {
            assert!(Instant::now() < deadline, "nothing was written");
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(400 * (wanted as u64 - 1)));
        child.kill().unwrap();
        child.wait().unwrap();
        let left = names_in(&out);
        assert!(left.iter().all(|name| name.contains(".part")), "{left:?}");
    }
    survey(&input, &out, &[]);
    assert_eq!(names_in(&out), FILES);
}

#[test]
fn the_page_needs_nothing_else_and_shows_every_tree() {
    let scratch = Scratch::new("page");
    let out = scratch.file("out");
    let report = survey(&scratch.write("a <b>.ply", drive()), &out, &[]);
    let page = std::fs::read_to_string(format!("{out}/report.html")).unwrap();
    assert_eq!(page.matches("<circle data-id").count() as u64, report["trees"].as_u64().unwrap());
    for foreign in ["http:", "https:", "src=\"/", "@import", "<link", "<b>", "{rows}", ">NaN", "inf<"] {
        assert!(!page.contains(foreign), "the page holds {foreign}");
    }
    for own in ["Content-Security-Policy", "a &lt;b&gt;.ply", "--crs EPSG:32617+5773", "prefers-color-scheme: dark"] {
        assert!(page.contains(own), "the page lacks {own}");
    }
}

#[test]
fn the_programs_of_others_read_every_file() {
    let Some(python) = python_with("rasterio, rio_cogeo, laspy, lazrs, pyogrio") else { return };
    let scratch = Scratch::new("python");
    let out = scratch.file("out");
    let report = survey(&scratch.write("drive.ply", drive()), &out, &["--tile", "38.4"]);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/survey_files.py");
    let read = Command::new(python).arg(script).arg(&out).output().unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let seen: Value = serde_json::from_slice(&read.stdout).unwrap();
    println!("{seen}");
    assert_eq!(seen["trees"], report["trees"]);
    assert!(seen["points"].as_u64().unwrap() * 10 > report["returns"].as_u64().unwrap() * 9, "{seen}");
}
