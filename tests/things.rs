//! Things that are no trees, from the simulated world through the whole graph into the store's file; and as a survey tells them.

mod harness;

use harness::{complaint, output};
use serde_json::Value;

/// A demo of a scene: its scorecard, and what `tsense objects` then reads of a class from the store it left behind.
fn things(scene: &str, class: &str) -> (Value, Vec<Value>) {
    let folder = std::env::temp_dir().join(format!("tsense-things-{}-{scene}", std::process::id()));
    let keep = folder.display().to_string();
    let demo =
        ["demo", "--headless", "--quiet", "--json", "--seed", "7", "--scene", scene, "--for", "25s", "--keep", &keep];
    let card = output(&demo);
    assert!(card.status.success(), "{}", complaint(&card));
    let store = folder.join("objects.gpkg").display().to_string();
    let listed = output(&["objects", "--store", &store, "--class", class, "--json"]);
    assert!(listed.status.success(), "{}", complaint(&listed));
    let objects: Value = serde_json::from_slice(&listed.stdout).expect("objects as JSON");
    let objects = objects["objects"].as_array().expect("a list").clone();
    // What is left behind goes with the system's own cleaning if it cannot go now.
    let _ = std::fs::remove_dir_all(folder);
    (serde_json::from_slice(&card.stdout).expect("a scorecard"), objects)
}

fn count(card: &Value, path: &str) -> u64 {
    card.pointer(path).and_then(Value::as_u64).unwrap_or_else(|| panic!("no {path} in {card:#}"))
}

#[test]
fn rocks_are_told_where_rocks_lie_and_nothing_else_is() {
    let (card, objects) = things("rocks", "rock");
    let [reported, right] = ["reported", "right"].map(|what| count(&card, &format!("/things/rocks/{what}")));
    assert!(10 * right >= 9 * reported, "{:#}", card["things"]);
    assert_eq!(count(&card, "/things/walls/reported"), 0);
    // On a busy machine the store may tell at the end less than it has written a moment later.
    assert!(objects.len() >= 3 && objects.iter().all(|object| object["class"] == "rock"), "{objects:?}");
}

#[test]
fn a_wall_is_told_in_pieces_and_is_no_tree() {
    let (card, objects) = things("wall", "wall");
    let [reported, right] = ["reported", "right"].map(|what| count(&card, &format!("/things/walls/{what}")));
    assert_eq!(right, reported, "{:#}", card["things"]);
    assert_eq!(card["trees"]["precision"], 1.0, "{:#}", card["trees"]);
    // Sixteen metres of it, of which the vehicle sees most.
    assert!((3..=24).contains(&objects.len()), "{objects:?}");
}

/// A survey of a drive round a scene, scored.
fn surveyed(scene: &str) -> Value {
    let folder = std::env::temp_dir().join(format!("tsense-surveyed-{}-{scene}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let [rays, out] = ["rays.ply", "out"].map(|name| folder.join(name).display().to_string());
    let truth = format!("{scene}:8:oval");
    for command in [
        &["simulate", "--scene", scene, "--seed", "8", "--case", "oval", "--for", "25s", "--write-rays", &rays][..],
        &["survey", &rays, "--out", &out, "--crs", "EPSG:32617", "--quiet"],
    ] {
        let ran = output(command);
        assert!(ran.status.success(), "{}", complaint(&ran));
    }
    let score = output(&["score", &truth, &out, "--json"]);
    assert!(score.status.success(), "{}", complaint(&score));
    let _ = std::fs::remove_dir_all(folder);
    serde_json::from_slice::<Value>(&score.stdout).expect("a score")["things"].clone()
}

#[test]
fn a_survey_tells_the_ditch_and_no_other_drop() {
    let things = surveyed("ditch");
    let number =
        |path: &str| things.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}: {things:#}"));
    assert!(number("/drops/found") > 0.3 && number("/drops/right") > 0.8, "{things:#}");
    assert!(number("/drops/true_m2") > 30.0 && number("/drops/off_m") < 0.4, "{things:#}");
    assert_eq!(number("/walls/told_m2"), 0.0, "{things:#}");
}

#[test]
fn a_survey_tells_rocks_and_nothing_else() {
    let things = surveyed("rocks");
    let rocks = |what: &str| count(&things, &format!("/rocks/{what}"));
    assert!(10 * rocks("found") >= 8 * rocks("true") && rocks("true") > 15, "{things:#}");
    assert!(10 * rocks("right") >= 9 * rocks("told"), "{things:#}");
    let told = ["drops", "walls"].map(|kind| things[kind]["told_m2"].as_f64().expect("an area"));
    assert!(told[0] < 2.0 && told[1] == 0.0, "{things:#}");
}
