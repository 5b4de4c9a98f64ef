//! Readers of topic `map` over real shared memory, hammered: slow ones, fast ones, late ones, killed ones.
//!
//! One writer publishes snapshots as fast as it can. In each, every block of the table carries its version in every one
//! of its bricks of a class (`number % CLASSES`) that changes in turn, so that a reader can tell from a view alone what
//! each brick must hold: a brick of another snapshot, or a half-written one, is seen at once. Readers are processes of
//! their own: this test binary again, with their task in the environment.
#![allow(clippy::disallowed_methods, reason = "a test starts processes and waits")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

use bytemuck::Zeroable;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tsense_contract::{
    BLOCKS_MAX, BRICKS_PER_BLOCK, Brick, CommitEntry, DeltaEntry, KeyframeRequests, MAP_KEYFRAME, Map, MapHeader,
    MapSampleKind, SnapshotAssembler, Taken, UNKNOWN_VERSION, commit_items, delta_items, write_commit, write_delta,
};
use tsense_ports::{Clock, Domain, Host, Outbox, PortError, Process, Sample};

const BLOCKS: u32 = 6;
/// Bricks of class `c` of block `b` change with the snapshots whose number plus `b` is `c`, counted modulo this.
const CLASSES: u32 = 50;
/// Every block is sent whole with these snapshots: the nods.
const WHOLE_EVERY: u64 = 64;
/// The writer starts a new life, as a restarted mapper would.
const LIFE_SNAPSHOTS: u64 = 3000;
const GRAPH: &str = "TSENSE_HAMMER_GRAPH";
const TASK: &str = "TSENSE_HAMMER_TASK";

/// What brick `number` of block `block` holds in a snapshot: the last one in which its class changed, and the life.
fn expected(epoch: u64, snapshot: u64, block: u32, number: usize) -> Brick {
    let class = number as u64 % u64::from(CLASSES);
    let now = (snapshot + u64::from(block)) % u64::from(CLASSES);
    let age = (now + u64::from(CLASSES) - class) % u64::from(CLASSES);
    let written = snapshot.checked_sub(age).map_or(0, |n| n + 1);
    pattern(epoch, written, block, number)
}

/// All 128 bytes say the same four figures.
fn pattern(epoch: u64, written: u64, block: u32, number: usize) -> Brick {
    let word = written << 32 | (epoch & 0xff) << 24 | u64::from(block) << 16 | number as u64;
    let words = [word.wrapping_mul(0x9e37_79b9_7f4a_7c15); 16];
    bytemuck::cast(words)
}

/// The writer: all blocks, and one life.
struct Writer {
    epoch: u64,
    snapshot: u64,
    blocks: Vec<Vec<Brick>>,
}

impl Writer {
    fn new(epoch: u64) -> Self {
        let block = |b| (0..BRICKS_PER_BLOCK).map(|i| pattern(epoch, 0, b, i)).collect();
        Self { epoch, snapshot: 0, blocks: (0..BLOCKS).map(block).collect() }
    }

    fn header(&self, kind: MapSampleKind, version: u32) -> MapHeader {
        let (epoch, snapshot) = (self.epoch, self.snapshot);
        MapHeader { epoch, snapshot, version, kind: kind.to_wire(), ..MapHeader::zeroed() }
    }

    fn version(&self) -> u32 {
        self.snapshot as u32 + 1
    }

    /// Changes one class of bricks of each block, and sends the blocks whole or as one delta.
    fn publish(&mut self, outbox: &mut Outbox<Map>, keyframe: bool) -> Result<(), PortError> {
        let (mut entries, mut numbers) = (Vec::new(), Vec::new());
        for block in 0..BLOCKS {
            let class = (self.snapshot + u64::from(block)) % u64::from(CLASSES);
            let changed = (class as usize..BRICKS_PER_BLOCK).step_by(CLASSES as usize);
            for number in changed.clone() {
                self.blocks[block as usize][number] = pattern(self.epoch, self.snapshot + 1, block, number);
            }
            let (base, bricks) = (self.version() - 1, changed.len() as u32);
            entries.push(DeltaEntry { key: [block as i32, 0, 0], base, version: self.version(), bricks });
            numbers.extend(changed.map(|number| number as u16));
        }
        if keyframe || self.version() - 1 == UNKNOWN_VERSION || self.snapshot.is_multiple_of(WHOLE_EVERY) {
            for (block, bricks) in self.blocks.iter().enumerate() {
                let key = [block as i32, 0, 0];
                let header = MapHeader { key, ..self.header(MapSampleKind::Block, self.version()) };
                outbox.queue_with(&header, BRICKS_PER_BLOCK, |items| items.copy_from_slice(bricks))?;
            }
        } else {
            let header = self.header(MapSampleKind::Delta, BLOCKS);
            let fill = |items: &mut [Brick]| {
                write_delta(items, &entries, &numbers, |key| &self.blocks[key[0] as usize]);
            };
            outbox.queue_with(&header, delta_items(entries.len(), numbers.len()), fill)?;
        }
        let table: Vec<_> =
            entries.iter().map(|entry| CommitEntry { key: entry.key, version: entry.version }).collect();
        let header = self.header(MapSampleKind::Commit, BLOCKS);
        outbox.send_with(&header, commit_items(table.len()), |items| write_commit(items, &table))?;
        self.snapshot += 1;
        Ok(())
    }
}

/// What a reader counts, and says at its end.
#[derive(Default)]
struct Counts {
    views: u64,
    bricks: u64,
    incomplete: u64,
    lives: u64,
    keyframes: u64,
}

/// Checks every brick of a view.
fn check(view: &tsense_contract::Snapshot<'_, Sample<Map>>, last: &mut (u64, u64), counts: &mut Counts) {
    let now = (view.header.epoch, view.header.snapshot);
    assert!(now > *last, "a view of snapshot {now:?} after one of {last:?}");
    counts.lives += u64::from(now.0 != last.0);
    *last = now;
    assert_eq!(view.blocks().len(), BLOCKS as usize);
    for (key, version, bricks) in view.versioned_blocks() {
        assert_eq!(u64::from(version), now.1 + 1, "block {key:?}");
        for (number, brick) in bricks.iter().enumerate() {
            assert!(
                *brick == expected(now.0, now.1, key[0] as u32, number),
                "block {key:?}, brick {number} of {now:?}"
            );
        }
        counts.bricks += bricks.len() as u64;
    }
    counts.views += 1;
}

/// A reader's life. `pause` lies between two looks at the topic; views are checked only when nothing newer waits.
fn read(graph: &str, pause: Duration, seconds: f64) -> Counts {
    let mut process = Process::observe(&Domain::new(graph).unwrap(), "reader").unwrap();
    let mut inbox = process.inbox::<Map>(None).unwrap();
    let keyframe = process.event_sender(MAP_KEYFRAME).unwrap();
    let mut assembler = SnapshotAssembler::<Sample<Map>>::new(BLOCKS_MAX);
    let (mut requests, mut counts, mut last) = (KeyframeRequests::default(), Counts::default(), (0, 0));
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    while Instant::now() < end {
        process.wait(0.05);
        // One look takes what a full buffer holds, so that a writer without a pause cannot keep a reader from its view.
        for _ in 0..Map::buffer() {
            let Some(sample) = inbox.take().unwrap() else { break };
            let header = *sample.header();
            match assembler.take(&header, sample) {
                Taken::Complete => check(&assembler.complete().unwrap(), &mut last, &mut counts),
                Taken::Incomplete { .. } => counts.incomplete += 1,
                Taken::Part => {}
                Taken::Refused(why) => panic!("{}", why.as_str()),
            }
        }
        if requests.due(assembler.keyframe_needed(), process.clock().now()) {
            counts.keyframes += 1;
            keyframe.notify().unwrap();
        }
        std::thread::sleep(pause);
    }
    counts
}

/// The buffer of the topic.
trait Buffer {
    fn buffer() -> usize;
}
impl Buffer for Map {
    fn buffer() -> usize {
        <Self as tsense_contract::Topic>::QOS.buffer
    }
}

/// Does nothing unless the test below started this process: then it is a reader.
#[test]
fn reader() {
    let (Ok(graph), Ok(task)) = (std::env::var(GRAPH), std::env::var(TASK)) else { return };
    let figures: Vec<f64> = task.split(' ').map(|figure| figure.parse().unwrap()).collect();
    let counts = read(&graph, Duration::from_secs_f64(figures[0]), figures[1]);
    println!("COUNTS {} {} {} {} {}", counts.views, counts.bricks, counts.incomplete, counts.lives, counts.keyframes);
}

fn start_reader(graph: &str, pause_s: f64, seconds: f64) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["reader", "--exact", "--nocapture", "--test-threads=1"])
        .env(GRAPH, graph)
        .env(TASK, format!("{pause_s} {seconds}"))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// What a reader counted: views, bricks, incomplete commits, lives of the writer, keyframes asked for.
fn counts(child: Child, who: &str) -> [u64; 5] {
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "the {who} reader saw a wrong view:\n{text}");
    let line = text.lines().find_map(|line| line.split_once("COUNTS ")).expect("it says its counts").1;
    let mut figures = line.split(' ').map(|figure| figure.parse().unwrap());
    let counts = std::array::from_fn(|_| figures.next().unwrap());
    println!("{who:8} views, bricks, incomplete, lives, keyframes: {counts:?}");
    counts
}

const SECONDS: f64 = 6.0;

#[test]
fn no_reader_ever_sees_a_torn_or_a_stale_view() {
    let name = format!("hammer{}", std::process::id() % 1_000_000);
    let mut host = Host::open(Domain::new(&name).unwrap(), Clock::start(1.0), &std::env::temp_dir()).unwrap();
    host.offer::<Map>(None).unwrap();
    host.offer_event(MAP_KEYFRAME).unwrap();
    let mut process = host.observer("writer").unwrap();
    let mut outbox = process.outbox::<Map>(None).unwrap();
    let mut keyframes = process.event_receiver(MAP_KEYFRAME).unwrap();
    let fast = start_reader(&name, 0.0, SECONDS);
    let slow = start_reader(&name, 0.15, SECONDS);
    let (mut victim, mut late) = (start_reader(&name, 0.0, 60.0), None);
    let (mut kills, mut killed) = (0, Instant::now());
    let mut writer = Writer::new(1);
    let (mut snapshots, mut sent_whole) = (0u64, 0u64);
    let start = Instant::now();
    while start.elapsed().as_secs_f64() < SECONDS + 0.5 {
        process.wait(0.0);
        let keyframe = keyframes.drain();
        sent_whole += u64::from(keyframe);
        writer.publish(&mut outbox, keyframe).unwrap();
        snapshots += 1;
        if writer.snapshot == LIFE_SNAPSHOTS {
            writer = Writer::new(writer.epoch + 1);
        }
        if killed.elapsed() > Duration::from_millis(700) {
            victim.kill().unwrap();
            victim.wait().unwrap();
            host.clean_dead();
            (kills, killed, victim) = (kills + 1, Instant::now(), start_reader(&name, 0.0, 60.0));
        }
        if late.is_none() && start.elapsed().as_secs_f64() > SECONDS / 2.0 {
            late = Some(start_reader(&name, 0.0, SECONDS / 3.0));
        }
    }
    victim.kill().unwrap();
    victim.wait().unwrap();
    println!("{snapshots} snapshots in {} lives, {sent_whole} keyframes, {kills} readers killed", writer.epoch);
    let [fast, slow, late] = [(fast, "fast"), (slow, "slow"), (late.unwrap(), "late")].map(|(c, who)| counts(c, who));
    assert!(snapshots > 500 && kills >= 5, "{snapshots} snapshots, {kills} kills");
    assert!(fast[0] > 100 && late[0] > 20, "complete views");
    assert!(slow[0] >= 3 && slow[2] > 0 && slow[4] > 0, "the slow one loses samples, and keyframes heal it");
    assert!(fast[1] >= 100 * u64::from(BLOCKS) * BRICKS_PER_BLOCK as u64);
    drop((outbox, keyframes, process));
    host.clean_dead();
    let domain = host.domain().clone();
    drop(host);
    assert_eq!(domain.leftovers(), Vec::<std::path::PathBuf>::new());
}
