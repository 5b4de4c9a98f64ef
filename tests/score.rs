//! `tsense score` against score.py, on a plot of random truth and random results; skipped loudly without either.
//!
//! Wants Python with numpy, scipy and rasterio: `TSENSE_PYTHON` names the interpreter, `python3` otherwise.
#![allow(clippy::disallowed_methods, reason = "a test that runs programs and reads files")]

#[path = "../bridge/tests/common/python.rs"]
#[allow(dead_code, reason = "this test needs a part of it")]
mod python;

use python::python_with;
use std::path::Path;
use std::process::Command;

const SCORE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/scenes/score.py");
const MAKE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/score/make_plot.py");

fn run(command: &mut Command) -> Vec<u8> {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

fn json(bytes: &[u8]) -> serde_json::Value {
    serde_json::from_slice(bytes).unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(bytes)))
}

fn score(truth: &Path, found: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tsense"));
    command.arg("score").arg(truth).arg(found);
    command
}

#[test]
fn every_figure_is_that_of_score_py() {
    if !Path::new(SCORE).exists() {
        println!("SKIPPED: {SCORE} not found");
        return;
    }
    let Some(python) = python_with("numpy, scipy, rasterio") else { return };
    let folder = std::env::temp_dir().join(format!("tsense-score-test-{}", std::process::id()));
    let mut compared = 0;
    for seed in 1..=3 {
        let (truth, found) = (folder.join(format!("B{seed}")), folder.join(format!("found{seed}")));
        run(Command::new(&python).arg(MAKE).arg(&truth).arg(&found).arg(seed.to_string()));
        let theirs = json(&run(Command::new(&python).arg(SCORE).arg(&truth).arg(&found).arg("--json")));
        let ours = json(&run(score(&truth, &found).arg("--json")));
        for (key, value) in theirs.as_object().unwrap() {
            let (a, b) = (value.as_f64(), ours["score"][key].as_f64());
            let same = a.zip(b).is_some_and(|(a, b)| (a - b).abs() <= 1e-6) || (value.is_null() && b.is_none());
            assert!(same, "seed {seed}, {key}: theirs {value}, ours {}", ours["score"][key]);
            compared += 1;
        }
        let limits = score(&truth, &found).arg("--limits").output().unwrap();
        assert_eq!(limits.status.code(), Some(8), "random results miss their goals");
    }
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(compared >= 3 * 17, "only {compared} figures compared");
}
