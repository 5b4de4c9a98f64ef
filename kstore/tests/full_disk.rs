//! Disks that are full, files that may not grow, media that cannot be written: real ones, in a mount namespace of a
//! child's own or under the shell's limit. The child is this test binary itself.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests touch the disk and start processes")]

mod common;

use common::{Folder, config, see, tree, zone};
use std::path::{Path, PathBuf};
use std::process::Command;
use tsense_contract::Detection;
use tsense_kstore::persist::{FileFault, Vault, read_only};
use tsense_kstore::{Changes, KnowledgeStore};

const FOLDER: &str = "TSENSE_KSTORE_CHILD_FOLDER";

/// Runs a part of this file as a child, by a line of shell that ends in `exec "$0" "$@"`. False where the shell line
/// may not do what it must: no right to mount.
fn run(part: &str, shell: &str, folder: &Path) -> bool {
    let child = std::env::current_exe().unwrap();
    let output = Command::new("unshare")
        .args(["--mount", "sh", "-c", shell])
        .arg(child)
        .args(["--exact", part, "--nocapture"])
        .env(FOLDER, folder)
        .output();
    let Ok(output) = output else { return false };
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    if said.contains("Operation not permitted") || said.contains("permission denied") {
        return false;
    }
    assert!(output.status.success() && said.contains("DONE"), "{said}");
    println!("{}", said.lines().find(|l| l.starts_with("DONE")).unwrap_or_default());
    true
}

/// The folder that a child works in; nothing where this is no child.
fn folder() -> Option<PathBuf> {
    std::env::var_os(FOLDER).map(Into::into)
}

fn batch(number: usize) -> Vec<Detection> {
    (0..50).map(|i| tree(f64::from(i) * 2.0, (number % 100) as f64)).collect()
}

/// Takes in batches and commits until a commit fails: the changes that were not written, and the fault.
fn fill(vault: &mut Vault, store: &mut KnowledgeStore, acknowledged: &mut usize) -> (Changes, FileFault) {
    for number in 1..400 {
        see(store, 2.0 * number as f64 + store.len() as f64, &batch(number));
        let changes = store.take_changes();
        match vault.commit(zone(), &changes) {
            Ok(_) => *acknowledged = store.len(),
            Err(fault) => return (changes, fault),
        }
    }
    panic!("{} objects were written and the disk is not full", store.len());
}

#[test]
fn child_on_a_disk_that_fills_up() {
    let Some(folder) = folder() else { return };
    let (file, ballast) = (folder.join("objects.gpkg"), folder.join("ballast"));
    std::fs::write(&ballast, vec![7; 300_000]).unwrap();
    let (mut vault, loaded) = Vault::open(&file, &config()).unwrap();
    let (mut store, mut acknowledged) = (loaded.into_store(config()), 0);
    let (changes, fault) = fill(&mut vault, &mut store, &mut acknowledged);
    assert!(matches!(fault, FileFault::DiskFull { .. }), "{fault}");
    assert!(acknowledged > 0);
    assert_eq!(read_only(&file).unwrap().objects.len(), acknowledged, "what was acknowledged is there, and no more");
    // As after a kill: another opening of what lies on the full disk.
    store.give_back(&changes);
    std::fs::remove_file(&ballast).unwrap();
    vault.commit(zone(), &store.take_changes()).unwrap();
    assert_eq!(read_only(&file).unwrap().objects.len(), store.len());
    drop(vault);
    assert!(Vault::open(&file, &config()).unwrap().1.objects.iter().eq(store.objects()));
    println!(
        "DONE {acknowledged} objects were acknowledged before the disk was full, {} after room was made",
        store.len()
    );
}

#[test]
fn a_disk_that_fills_up_loses_nothing_and_is_said_so() {
    let folder = Folder::new();
    let shell = format!("mount -t tmpfs -o size=1500k tmpfs {} && exec \"$0\" \"$@\"", folder.0.display());
    if !run("child_on_a_disk_that_fills_up", &shell, &folder.0) {
        println!("SKIPPED: this user may not mount a small disk");
    }
}

#[test]
fn child_whose_files_may_not_grow() {
    let Some(folder) = folder() else { return };
    let file = folder.join("objects.gpkg");
    let (mut vault, loaded) = Vault::open(&file, &config()).unwrap();
    let (mut store, mut acknowledged) = (loaded.into_store(config()), 0);
    let (_, fault) = fill(&mut vault, &mut store, &mut acknowledged);
    assert!(acknowledged > 0, "{fault}");
    assert_eq!(read_only(&file).unwrap().objects.len(), acknowledged);
    println!("DONE {acknowledged} objects were acknowledged before the limit: {fault}");
    std::mem::forget(vault); // As a kill would: nothing is closed.
}

#[test]
fn a_limit_on_the_size_of_files_loses_nothing() {
    let folder = Folder::new();
    // SIGXFSZ is ignored, so that a write beyond the limit fails instead of ending the process. Units of 512 bytes.
    if !run("child_whose_files_may_not_grow", "trap '' XFSZ; ulimit -f 1600; exec \"$0\" \"$@\"", &folder.0) {
        println!("SKIPPED: no namespaces here");
        return;
    }
    let (mut vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    assert_eq!((loaded.notes.len(), loaded.objects.is_empty()), (0, false));
    let mut store = loaded.into_store(config());
    see(&mut store, 5000.0, &batch(1));
    vault.commit(zone(), &store.take_changes()).unwrap();
}

/// A store that was killed while it wrote, on a disk that cannot be written any more.
#[test]
fn child_on_a_medium_that_became_read_only() {
    let Some(folder) = folder() else { return };
    let file = folder.join("objects.gpkg");
    let fault = Vault::open(&file, &config()).err().unwrap();
    assert!(matches!(fault, FileFault::NotWritable { .. }), "{fault}");
    let found = read_only(&file).unwrap();
    assert_eq!((found.objects.len(), found.notes.len()), (50, 0));
    println!("DONE {fault}");
}

#[test]
fn a_read_only_medium_is_read_with_the_log_that_a_kill_left_behind() {
    let folder = Folder::new();
    let (mut vault, loaded) = Vault::open(&folder.file(), &config()).unwrap();
    let mut store = loaded.into_store(config());
    see(&mut store, 0.0, &batch(1)[..20]);
    vault.commit(zone(), &store.take_changes()).unwrap();
    see(&mut store, 2.0, &batch(1));
    vault.commit(zone(), &store.take_changes()).unwrap();
    let at = Folder::new();
    // The file and its log as they are while the store is open, without the index of the log.
    for name in ["objects.gpkg", "objects.gpkg-wal"] {
        std::fs::copy(folder.0.join(name), at.0.join(name)).unwrap();
    }
    let path = at.0.display();
    let shell = format!("mount --bind {path} {path} && mount -o remount,ro,bind {path} && exec \"$0\" \"$@\"");
    if !run("child_on_a_medium_that_became_read_only", &shell, &at.0) {
        println!("SKIPPED: this user may not mount");
    }
}
