//! What is typed wrongly is refused with the code and in the words of the option it is for, before anything is done; and
//! nobody who stops listening ends the program.
#![allow(clippy::disallowed_methods, reason = "tests read and write files")]

mod harness;

use harness::{Folder, complaint, output, tsense};
use std::ffi::OsStr;
use std::fs::File;
use std::os::unix::ffi::OsStrExt;

#[test]
fn what_is_typed_wrongly_is_refused_by_code_and_in_words() {
    let folder = Folder::new("typed");
    let rays = folder.0.join("a.ply").display().to_string();
    let empty = folder.0.join("empty.toml").display().to_string();
    let report = folder.0.join("report.md").display().to_string();
    std::fs::write(&empty, "").unwrap();
    std::fs::write(&report, "kept").unwrap();
    assert!(output(&["simulate", "--write-rays", &rays, "--for", "1s"]).status.success());
    let survey = |further: &'static [&'static str]| [&["survey", &rays, "--out", "never"], further].concat();
    let cases: &[(Vec<&str>, i32, &str)] = &[
        (survey(&["--voxel", "nan"]), 2, "from 0.01 to 10"),
        (survey(&["--voxel", "0"]), 2, "from 0.01 to 10"),
        (survey(&["--reach", "-5"]), 2, "from 1 to 10000"),
        (survey(&["--window", "0"]), 2, "from 0.1 to 1000000"),
        (survey(&["--map", "no/such/folder.tsmap"]), 2, "there is no folder no/such"),
        (survey(&["--origin", "-5,3,2"]), 2, "leave out --origin"),
        (vec!["survey", "nothing.laz", "--out", "never"], 2, "no such file"),
        (vec!["simulate", "--vehicle-speed", "nan"], 2, "from 0.01 to 30"),
        (vec!["simulate", "--seed", "-1"], 2, "for '--seed <N>'"),
        (vec!["objects", "--min-confidence", "nan"], 2, "from 0 to"),
        (vec!["imaging", "difference", "a", "b", "--beside-max", "2"], 2, "from 0 to 1"),
        (vec!["bench", "mapper", "--rays", "nothing.ply"], 2, "no such file"),
        (vec!["score", "--report", &report], 2, "Give --plots"),
        (vec!["score", "--report", "no/such/report.md", "--live", "1s"], 2, "there is no folder no/such"),
        (vec!["bench", "shares", "--plot", "no/such/plot.svg"], 2, "there is no folder no/such"),
        (vec!["imaging", "study", "--plot-blur", "no/such/plot.svg"], 2, "there is no folder no/such"),
        (vec!["imaging", "study", "--plot-blur", "/dev/null"], 2, "no plain file"),
        (vec!["simulate", "--truth", "/dev/null", "--for", "1s"], 2, "no plain file"),
        (vec!["run", &empty, "--graph", "BAD"], 2, "1 to 16 characters"),
        (vec!["status", "--graph", "BAD"], 2, "1 to 16 characters"),
        (vec!["map", "load", "a.tsmap", "--config", &empty, "--graph", ""], 2, "1 to 16 characters"),
        (vec!["demo", "--keep", &report], 2, "no folder"),
        (vec!["bench", "clouds", "--returns", "5,3"], 2, "ascending"),
        (vec!["map", "info", "nothing.tsmap"], 2, "no such file"),
        (vec!["objects", "--store", "."], 2, "a folder"),
        (vec!["score", "forrest:7", "results"], 2, "no scene is called 'forrest'"),
        (vec!["score", "forest", "nothing"], 2, "no such file"),
        (vec!["score", "forest", "nothing", "--limits"], 2, "only plots have goals"),
        (vec!["score", "forest", "nothing", "--within", "1"], 2, "--match"),
        (vec!["config", "check", &empty], 3, "no process is configured"),
        (vec!["run", &empty], 3, "no process is configured"),
    ];
    for (words, code, part) in cases {
        let done = output(words);
        assert_eq!(done.status.code(), Some(*code), "{words:?}: {}", complaint(&done));
        assert!(complaint(&done).contains(part), "{words:?}: {}", complaint(&done));
        assert!(done.stdout.is_empty(), "{words:?}");
    }
    assert_eq!(std::fs::read_to_string(&report).unwrap(), "kept");
}

#[test]
fn names_that_are_no_text_are_names_too() {
    let folder = Folder::new("bytes");
    let [rays, results] = [b"rays\xe9.ply".as_slice(), b"out\xe9"].map(|name| folder.0.join(OsStr::from_bytes(name)));
    let mut simulate = tsense(&["simulate", "--for", "1s", "--write-rays"]);
    assert!(simulate.arg(&rays).output().unwrap().status.success());
    let done = tsense(&["survey", "--quiet", "--json", "--out"]).arg(&results).arg(&rays).output().unwrap();
    assert!(done.status.success(), "{}", complaint(&done));
    assert!(results.join("report.html").exists());
}

#[test]
fn data_that_nobody_takes_is_a_failure_and_words_that_nobody_hears_are_none() {
    let full = || File::create("/dev/full").unwrap();
    let folder = Folder::new("full");
    let rays = folder.0.join("a.ply").display().to_string();
    assert!(output(&["simulate", "--write-rays", &rays, "--for", "1s"]).status.success());
    let mut survey = tsense(&["survey", &rays, "--quiet", "--json", "--out"]);
    let done = survey.arg(folder.0.join("out")).stdout(full()).output().unwrap();
    assert_eq!(done.status.code(), Some(1), "{}", complaint(&done));
    assert!(complaint(&done).contains("standard output: No space left"), "{}", complaint(&done));
    let unheard = tsense(&["objects", "--store", "nothing.gpkg"]).stderr(full()).status().unwrap();
    assert_eq!(unheard.code(), Some(1));
}
