//! The layout for Foxglove and Lichtblick: each panel is configured and placed, and shows topics that are served.
#![allow(clippy::disallowed_methods, reason = "a test reads the file")]

use serde_json::Value;
use std::collections::BTreeSet;
use tsense_bridge::foxglove::Config;
use tsense_bridge::ros2::translator::Translator;
use tsense_bridge::ros2::{self, Mount, Mounts};
use tsense_geometry::Mounting;

/// Panels that both programs have.
const PANELS: [&str; 2] = ["3D", "RawMessages"];

/// Topics that a graph with one ladar serves by default.
fn served() -> BTreeSet<String> {
    let ladar =
        Mount { name: "ladar".into(), range_min_m: 0.5, range_max_m: 50.0, tilt_from_ladar: Mounting::default() };
    let mounts = Mounts { pan_tilt: Some(Mounting::default()), ladars: vec![ladar] };
    let translator: Translator = Translator::new(&Config::default().translator(&ros2::Config::default()), mounts);
    translator.topics().iter().map(|topic| topic.name.clone()).collect()
}

/// Panels of a tree of rows and columns.
fn placed(layout: &Value, into: &mut BTreeSet<String>) {
    match layout {
        Value::String(panel) => assert!(into.insert(panel.clone()), "{panel} is there twice"),
        Value::Object(split) => {
            assert!(["row", "column"].contains(&split["direction"].as_str().unwrap()), "{split:?}");
            placed(&split["first"], into);
            placed(&split["second"], into);
        }
        other => panic!("neither a panel nor a split: {other}"),
    }
}

#[test]
fn each_panel_of_the_layout_is_placed_and_its_topics_are_served() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../config/foxglove-layout.json")).unwrap();
    let layout: Value = serde_json::from_str(&text).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    let mut shown = BTreeSet::new();
    placed(&layout["layout"], &mut shown);
    assert_eq!(shown, panels.keys().cloned().collect());
    let served = served();
    let mut drawn = BTreeSet::new();
    for (id, panel) in panels {
        let (kind, _) = id.split_once('!').unwrap();
        assert!(PANELS.contains(&kind), "{id}");
        let listed = panel["topics"].as_object().into_iter().flat_map(|topics| topics.keys());
        for topic in listed.map(String::as_str).chain(panel["topicPath"].as_str()) {
            assert!(served.contains(topic), "{id} shows {topic}, of {served:?}");
            drawn.insert(topic.to_owned());
        }
    }
    let invisible = ["/tf".to_owned(), "/tf_static".to_owned()];
    let missing: Vec<_> = served.difference(&drawn).filter(|topic| !invisible.contains(topic)).collect();
    assert!(missing.is_empty(), "served and not shown: {missing:?}");
    let frame = panels["3D!tsense"]["followTf"].as_str().unwrap();
    assert_eq!(frame, ros2::Config::default().frames.base);
}
