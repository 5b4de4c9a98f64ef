//! The house rules as a test: who may know whom, module heads, file and function lengths, where the middleware lives.
//!
//! Layers come from `cargo metadata`, the rest from the source text.
#![allow(clippy::disallowed_methods, reason = "a test of the source files reads them")]

use std::path::{Path, PathBuf};
use std::process::Command;

/// Each crate, and the crates of ours it may depend on.
const LAYERS: [(&str, &[&str]); 11] = [
    ("tsense-geometry", &[]),
    ("tsense-contract", &["tsense-geometry"]),
    ("tsense-jaus", &["tsense-geometry"]),
    ("tsense-ports", &["tsense-contract", "tsense-geometry"]),
    ("tsense-drivers", JAUS_STAGE),
    ("tsense-mapper", STAGE),
    ("tsense-classifier", STAGE),
    ("tsense-kstore", STAGE),
    ("tsense-bridge", JAUS_STAGE),
    ("tsense-simulator", &["tsense-geometry"]),
    ("terrain-smart-sensor", ROOT),
];
const STAGE: &[&str] = &["tsense-contract", "tsense-geometry", "tsense-ports"];
/// Stages that speak JAUS: one serves it, one reads its poses.
const JAUS_STAGE: &[&str] = &["tsense-contract", "tsense-geometry", "tsense-ports", "tsense-jaus"];
const ROOT: &[&str] = &[
    "tsense-geometry",
    "tsense-contract",
    "tsense-ports",
    "tsense-drivers",
    "tsense-mapper",
    "tsense-classifier",
    "tsense-kstore",
    "tsense-bridge",
    "tsense-simulator",
];
const CRATE_FOLDERS: [&str; 10] =
    ["geometry", "contract", "jaus", "ports", "drivers", "mapper", "classifier", "kstore", "bridge", "simulator"];
/// Longest file and longest function that a reader is asked to hold in mind.
const FILE_LINES_MAX: usize = 500;
const FUNCTION_LINES_MAX: usize = 60;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn sources_in(folder: &Path, out: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.map(|e| e.unwrap().path()) {
        if entry.is_dir() {
            sources_in(&entry, out);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            out.push(entry);
        }
    }
}

/// Every Rust file of ours with its text, as paths relative to the root.
fn sources() -> Vec<(String, String)> {
    let mut files = Vec::new();
    for folder in CRATE_FOLDERS {
        sources_in(&root().join(folder), &mut files);
    }
    sources_in(&root().join("src"), &mut files);
    sources_in(&root().join("tests"), &mut files);
    files.sort();
    assert!(files.len() > 50, "only {} source files found: the walk is broken", files.len());
    files
        .into_iter()
        .map(|path| {
            let name = path.strip_prefix(root()).unwrap().display().to_string();
            (name, std::fs::read_to_string(&path).unwrap())
        })
        .collect()
}

fn none(faults: Vec<String>) {
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn crates_know_only_the_layers_below_them() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(root())
        .output()
        .unwrap();
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    assert_eq!(packages.len(), LAYERS.len(), "a crate without a layer, or a layer without a crate");
    let mut faults = Vec::new();
    for package in packages {
        let name = package["name"].as_str().unwrap();
        let (_, allowed) = LAYERS.iter().find(|(layer, _)| *layer == name).unwrap();
        for dependency in package["dependencies"].as_array().unwrap() {
            let other = dependency["name"].as_str().unwrap();
            if LAYERS.iter().any(|(layer, _)| *layer == other) && !allowed.contains(&other) {
                faults.push(format!("{name} must not know {other}"));
            }
        }
    }
    none(faults);
}

#[test]
fn only_ports_knows_the_middleware_and_only_shells_know_ports() {
    let mut faults = Vec::new();
    for (name, text) in sources() {
        let is_stage = ["drivers/", "mapper/", "classifier/", "kstore/", "bridge/"].iter().any(|s| name.starts_with(s));
        let is_shell = name.ends_with("process.rs") || name.contains("/shell/") || name.contains("/tests/");
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
            if line.contains("iceoryx2::") && !name.starts_with("ports/") && !name.starts_with("tests/tidy") {
                faults.push(format!("{name}:{}: iceoryx2 outside of ports", number + 1));
            }
            if is_stage && !is_shell && line.contains("tsense_ports") {
                faults.push(format!("{name}:{}: ports outside of a shell", number + 1));
            }
        }
    }
    none(faults);
}

#[test]
fn every_file_says_what_it_is_for_and_is_short_enough() {
    let mut faults = Vec::new();
    for (name, text) in sources() {
        if !text.starts_with("//!") {
            faults.push(format!("{name}: no //! head"));
        }
        let lines = text.lines().count();
        if lines > FILE_LINES_MAX {
            faults.push(format!("{name}: {lines} lines, at most {FILE_LINES_MAX}"));
        }
    }
    none(faults);
}

/// Functions and their lengths, by rustfmt's indentation: from the line with `fn` to the brace in the same column.
fn long_functions(text: &str) -> Vec<(usize, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut long = Vec::new();
    for (start, line) in lines.iter().enumerate() {
        let body = line.trim_start();
        let is_function =
            ["fn ", "pub fn ", "pub(crate) fn ", "pub(super) fn ", "async fn ", "unsafe fn ", "pub const fn "]
                .iter()
                .any(|head| body.starts_with(head));
        if !is_function {
            continue;
        }
        let close = format!("{}}}", &line[..line.len() - body.len()]);
        let length = lines[start..].iter().position(|l| *l == close).map_or(0, |last| last + 1);
        if length > FUNCTION_LINES_MAX {
            long.push((start + 1, length));
        }
    }
    long
}

#[test]
fn functions_fit_on_a_screen() {
    let mut faults = Vec::new();
    for (name, text) in sources() {
        for (line, length) in long_functions(&text) {
            faults.push(format!("{name}:{line}: a function of {length} lines, at most {FUNCTION_LINES_MAX}"));
        }
    }
    none(faults);
}

#[test]
fn the_length_rule_sees_a_long_function() {
    let text = format!("fn a() {{\n{}}}\n", "    x();\n".repeat(FUNCTION_LINES_MAX));
    assert_eq!(long_functions(&text), vec![(1, FUNCTION_LINES_MAX + 2)]);
}

/// What users read: the two documents in the root, and all below `docs/`.
fn documents() -> Vec<PathBuf> {
    let mut documents = vec![root().join("README.md"), root().join("ARCHITECTURE.md")];
    let mut folders = vec![root().join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
            } else if entry.extension().is_some_and(|e| e == "md") {
                documents.push(entry);
            }
        }
    }
    documents
}

#[test]
fn documents_that_users_read_name_no_path_of_a_developer() {
    let mut faults = Vec::new();
    for path in documents() {
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        for word in ["/work/", "../shared", "/root/", "/home/"] {
            if text.contains(word) {
                faults.push(format!("{}: names {word}", path.display()));
            }
        }
    }
    none(faults);
}

/// Files of ours that documents name, as paths from the root, and pages that they link to must exist.
#[test]
fn documents_point_at_files_that_exist() {
    let (mut faults, mut links) = (Vec::new(), 0);
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        let named = text.split('`').skip(1).step_by(2).filter(|word| word.contains('/') && !word.contains(' '));
        let named = named.filter(|word| [".rs", ".md", ".toml", ".py"].iter().any(|end| word.ends_with(end)));
        let linked = text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
        let linked = linked.filter(|link| !link.is_empty() && !link.contains(':'));
        let beside = |link| document.parent().unwrap().join(link);
        for (word, path) in named.map(|w| (w, root().join(w))).chain(linked.map(|w| (w, beside(w)))) {
            links += 1;
            if !path.exists() {
                faults.push(format!("{}: `{word}` does not exist", document.display()));
            }
        }
    }
    assert!(links > 150, "only {links} links found: the search is broken");
    none(faults);
}
