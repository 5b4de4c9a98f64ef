//! Several ladars on one head: each a process of its own, all of them in one map.

mod harness;

use harness::{complaint, output, row};

#[test]
fn three_ladars_on_one_head_feed_one_map() {
    let demo = output(&["demo", "--headless", "--quiet", "--json", "--seed", "7", "--ladars", "3", "--for", "10s"]);
    assert!(demo.status.success(), "{}", complaint(&demo));
    let card: serde_json::Value = serde_json::from_slice(&demo.stdout).expect("a scorecard");
    for name in ["ladar", "ladar-left", "ladar-right"] {
        assert_eq!(row(&card, name)["state"], "running", "{card:#}");
    }
    let mapper = row(&card, "mapper");
    assert_eq!(mapper["reason"], "placing and tracing scans", "no ladar is missing: {mapper:#}");
    // 541 beams fifty times a second each; one ladar alone gives 27,000.
    let beams_per_s = card["beams_per_s"].as_f64().expect("a rate");
    assert!(beams_per_s > 40_000.0, "{beams_per_s}");
}
