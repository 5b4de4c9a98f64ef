//! The folder of stored blocks, its writer killed with SIGKILL at any instant: every file under its name is whole, and
//! no older than what was acknowledged.
//!
//! The child is this test binary itself: it writes a few blocks over and over, each time with a generation in every
//! brick, and says on its output which generation it finished.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests touch the disk and start processes")]

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;
use tsense_contract::{BRICKS_PER_BLOCK, BlockKey, Brick};
use tsense_geometry::Timestamp;
use tsense_mapper::block_store::Folder;
use tsense_mapper::tsmap::{MapFileHeader, StoredBlock};

const FOLDER: &str = "TSENSE_BLOCKS_CHILD_FOLDER";
const ROUNDS: u64 = 20;
const KEYS: [BlockKey; 3] = [[0, 0, 0], [1, 0, 0], [-7, 12, 3]];
const LIMIT_BYTES: u64 = 1 << 30;

fn header() -> MapFileHeader {
    MapFileHeader::in_zone(0.15, Timestamp::from_ns(1), 32, false)
}

/// Every brick says the generation, and no two alike: it does not pack to nothing.
fn bricks(generation: u64) -> Vec<Brick> {
    let word = |i: u64| generation << 32 | (i + 1).wrapping_mul(0x9e37_79b9) & 0xffff_ffff;
    (0..BRICKS_PER_BLOCK as u64).map(|i| bytemuck::cast([word(i); 16])).collect()
}

fn open(root: &Path) -> Folder {
    Folder::open(root, LIMIT_BYTES).unwrap()
}

/// Generations of all blocks in the folder; fails where one is not whole.
fn generations(root: &Path) -> Vec<Option<u64>> {
    let mut folder = open(root);
    let loaded = KEYS.map(|key| folder.load(&header(), key).unwrap());
    let generation = |block: StoredBlock| {
        let words: [u64; 16] = bytemuck::cast(block.bricks[0]);
        assert!(block.bricks == bricks(words[0] >> 32), "a block of two generations");
        words[0] >> 32
    };
    loaded.into_iter().map(|block| block.map(generation)).collect()
}

/// The child's part; does nothing when run as a test.
#[test]
fn child_that_writes_until_it_is_killed() {
    let Some(root) = std::env::var_os(FOLDER) else { return };
    let start = generations(Path::new(&root)).into_iter().flatten().max().unwrap_or(0);
    let mut folder = open(Path::new(&root));
    for generation in start + 1.. {
        for key in KEYS {
            folder.save(&header(), &StoredBlock::of(key, &bricks(generation), &[])).unwrap();
        }
        let mut out = std::io::stdout().lock();
        writeln!(out, "ACK {generation}").unwrap();
        out.flush().unwrap();
    }
}

/// Runs the child for a while; the last generation that it acknowledged.
fn run_and_kill(root: &Path, after: Duration) -> u64 {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "child_that_writes_until_it_is_killed", "--nocapture"])
        .env(FOLDER, root)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let out = BufReader::new(child.stdout.take().unwrap());
    std::thread::sleep(after);
    child.kill().unwrap();
    child.wait().unwrap();
    let acks = out.lines().map_while(Result::ok).filter_map(|line| line.rsplit_once("ACK ")?.1.parse().ok());
    acks.last().unwrap_or(0)
}

struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_writer_killed_at_any_instant_leaves_whole_blocks_and_no_half_ones() {
    let scratch = Scratch(std::env::temp_dir().join(format!("tsense-blocks-killed-{}", std::process::id())));
    std::fs::create_dir_all(&scratch.0).unwrap();
    let mut acknowledged = 0;
    for round in 0..ROUNDS {
        // Instants of no particular phase.
        let after = Duration::from_millis(60 + round * 37 % 190);
        acknowledged = run_and_kill(&scratch.0, after).max(acknowledged);
        for held in generations(&scratch.0) {
            let is_new_enough = held.unwrap_or(0) >= acknowledged;
            assert!(is_new_enough, "round {round}: generation {held:?} after {acknowledged} was acknowledged");
        }
        let zones = std::fs::read_dir(&scratch.0).unwrap().flatten();
        let names = zones.flat_map(|zone| std::fs::read_dir(zone.path()).unwrap().flatten());
        let odd: Vec<_> = names.map(|file| file.path()).filter(|path| path.extension().unwrap() != "tsmap").collect();
        assert!(odd.is_empty(), "remains that opening did not remove: {odd:?}");
    }
    assert!(acknowledged >= ROUNDS / 2, "only {acknowledged} generations were written: too few to kill");
    eprintln!("{ROUNDS} kills, {acknowledged} generations of {} blocks: all whole", KEYS.len());
}
