//! Samples of every topic: recorded, spoiled, played.

use bytemuck::Zeroable;
use std::fmt::Debug;
use std::time::{Duration, Instant};
use tsense_contract::{
    Detections, Grid, Joints, Map, Objects, Points, Poses, Scan, SensedVoxel, Topic, VoxelState, Voxels, VoxelsHeader,
};
use tsense_ports::{Inbox, Outbox, Process};
use tsense_simulator::{ORIGIN_M, ZONE};

/// Samples of a topic that are kept, at most.
const KEPT_MAX: usize = 100;
/// Of all samples these are spoiled, so that what needs several whole ones still comes about.
const SPOILED_SHARE: f64 = 0.4;
/// What arithmetic stumbles over.
const ODD_INTEGERS: [i64; 9] =
    [0, 1, -1, i64::MAX, i64::MIN, i32::MAX as i64, i32::MIN as i64, u32::MAX as i64, 1 << 53];
const ODD_NUMBERS: [f64; 10] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE, -0.0, 1e12, -1e12, 1e7, -1e-3];

/// SplitMix64 (Steele, Lea and Flood 2014).
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    fn share(&mut self) -> f64 {
        self.next() as f64 / u64::MAX as f64
    }
}

/// Writes odd values over some of the fields from byte `from` on; fields lie at multiples of their size.
fn spoil(bytes: &mut [u8], from: usize, random: &mut Random) {
    for _ in 0..=random.below(4) {
        let value = match random.below(4) {
            0 => random.next().to_le_bytes(),
            1 => (ODD_NUMBERS[random.below(ODD_NUMBERS.len())] as f32).to_le_bytes().repeat(2).try_into().unwrap(),
            2 => ODD_NUMBERS[random.below(ODD_NUMBERS.len())].to_le_bytes(),
            _ => ODD_INTEGERS[random.below(ODD_INTEGERS.len())].to_le_bytes(),
        };
        let size = [1, 2, 4, 8][random.below(4)];
        if bytes.len() >= from + size {
            let at = (from + random.below(bytes.len() - from - size + 1)).next_multiple_of(size);
            if let Some(field) = bytes.get_mut(at..at + size) {
                field.copy_from_slice(&value[..size]);
            }
        }
    }
}

/// Samples of one topic.
struct Tape<T: Topic> {
    instance: Option<&'static str>,
    /// Bytes of the header that say which sample is newer: they are spoiled only towards the end, since nothing may count
    /// after the last of all.
    order_bytes: usize,
    /// Moves a header on in time and number, so that a tape that is played again is no thing of the past.
    renumber: fn(&mut T::Header, u64),
    samples: Vec<(T::Header, Vec<T::Item>)>,
    inbox: Option<Inbox<T>>,
    outbox: Option<Outbox<T>>,
    played: usize,
}

impl<T: Topic> Debug for Tape<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {} samples", T::NAME, self.samples.len())
    }
}

impl<T: Topic> Tape<T> {
    fn new(instance: Option<&'static str>, order_bytes: usize, renumber: fn(&mut T::Header, u64)) -> Self {
        Self { instance, order_bytes, renumber, samples: Vec::new(), inbox: None, outbox: None, played: 0 }
    }
}

/// What all tapes do.
pub trait Play: Debug {
    fn topic(&self) -> &'static str;
    fn listen(&mut self, process: &mut Process);
    fn take(&mut self);
    fn is_full(&self) -> bool;
    fn open(&mut self, process: &mut Process) -> bool;
    fn close(&mut self);
    /// The next sample; `late`: everything may be spoiled.
    fn play(&mut self, random: &mut Random, late: bool);
}

impl<T: Topic> Play for Tape<T> {
    fn topic(&self) -> &'static str {
        T::NAME
    }

    fn listen(&mut self, process: &mut Process) {
        self.inbox = Some(process.inbox(self.instance).unwrap());
    }

    fn take(&mut self) {
        while let Some(sample) = self.inbox.as_mut().and_then(|inbox| inbox.take().unwrap()) {
            if self.samples.len() < KEPT_MAX {
                self.samples.push((*sample.header(), sample.items().to_vec()));
            }
        }
    }

    fn is_full(&self) -> bool {
        !self.samples.is_empty()
    }

    fn open(&mut self, process: &mut Process) -> bool {
        self.outbox = process.outbox(self.instance).ok();
        self.played = 0;
        self.outbox.is_some()
    }

    fn close(&mut self) {
        (self.inbox, self.outbox) = (None, None);
    }

    fn play(&mut self, random: &mut Random, late: bool) {
        let Some(outbox) = &mut self.outbox else { return };
        let (mut header, mut items) = self.samples[self.played % self.samples.len()].clone();
        (self.renumber)(&mut header, (self.played / self.samples.len()) as u64);
        self.played += 1;
        if random.share() < SPOILED_SHARE {
            if random.below(8) == 0 {
                items.truncate(random.below(items.len() + 1));
            }
            let from = if late { 0 } else { self.order_bytes };
            let which = random.below(3);
            if which != 0 {
                spoil(bytemuck::bytes_of_mut(&mut header), from, random);
            }
            if which != 1 {
                spoil_items(&mut items, random);
            }
        }
        outbox.send(&header, &items).unwrap();
    }
}

fn spoil_items<I: bytemuck::Pod>(items: &mut [I], random: &mut Random) {
    if items.is_empty() || size_of::<I>() == 0 {
        return;
    }
    for _ in 0..=random.below(8) {
        let item = random.below(items.len());
        spoil(bytemuck::bytes_of_mut(&mut items[item]), 0, random);
    }
}

/// Samples of every topic that carries data.
#[derive(Debug)]
pub struct Tapes(Vec<Box<dyn Play>>);

/// Length of a tape, in time: each time it is played, everything is this much later.
const LATER_NS: i64 = 10_000_000_000;

fn later(stamp_ns: &mut i64, times: u64) {
    *stamp_ns += LATER_NS * times as i64;
}

impl Default for Tapes {
    fn default() -> Self {
        Self(vec![
            Box::new(Tape::<Scan>::new(Some("ladar"), 8, |scan, times| later(&mut scan.stamp_ns, times))),
            Box::new(Tape::<Joints>::new(None, 8, |joint, times| later(&mut joint.stamp_ns, times))),
            Box::new(Tape::<Poses>::new(None, 8, |pose, times| later(&mut pose.stamp_ns, times))),
            Box::new(Tape::<Map>::new(None, 24, |map, times| {
                later(&mut map.stamp_ns, times);
                map.snapshot += 1000 * times;
            })),
            Box::new(Tape::<Points>::new(None, 8, |points, times| later(&mut points.stamp_ns, times))),
            Box::new(Tape::<Detections>::new(None, 32, |detections, times| {
                later(&mut detections.stamp_ns, times);
                detections.snapshot += 1000 * times;
            })),
            Box::new(Tape::<Grid>::new(None, 24, |grid, times| {
                later(&mut grid.stamp_ns, times);
                grid.snapshot += 1000 * times;
            })),
            Box::new(Tape::<Objects>::new(None, 8, |objects, times| later(&mut objects.stamp_ns, times))),
            Box::new(voxels()),
        ])
    }
}

/// Nobody in the graph sends these: they are stamped and made up when the recording begins.
fn voxels() -> Tape<Voxels> {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970");
    let header = VoxelsHeader {
        stamp_ns: now.as_nanos() as i64,
        origin_m: ORIGIN_M,
        voxel_size_m: 0.3,
        zone: ZONE,
        ..VoxelsHeader::zeroed()
    };
    let item =
        |i: u16| SensedVoxel::new([f32::from(i % 32), f32::from(i / 32), 3.0], VoxelState::from_wire(i as u8 % 3));
    let samples = vec![(header, (0..1000).map(item).collect())];
    Tape { samples, ..Tape::<Voxels>::new(Some("stereo"), 8, |voxels, times| voxels.sequence = times) }
}

impl Tapes {
    /// Listens to a graph at work.
    pub fn record(&mut self, process: &mut Process, span: Duration) {
        self.0.iter_mut().for_each(|tape| tape.listen(process));
        let start = Instant::now();
        // A graph that has just begun sees nothing yet.
        while start.elapsed() < 5 * span && !(start.elapsed() > span && self.are_full()) {
            process.wait(0.01);
            self.0.iter_mut().for_each(|tape| tape.take());
        }
        self.close();
    }

    /// Whether something is there of every topic.
    pub fn are_full(&self) -> bool {
        self.0.iter().all(|tape| tape.is_full())
    }

    /// Becomes the writer of a topic; false where somebody is.
    pub fn open(&mut self, topic: &str, process: &mut Process) -> bool {
        let tape = self.0.iter_mut().find(|tape| tape.topic() == topic);
        tape.expect("a topic that is recorded").open(process)
    }

    /// Ends that.
    pub fn close(&mut self) {
        self.0.iter_mut().for_each(|tape| tape.close());
    }

    /// Sends samples in turn for so long; how many rounds of all topics.
    pub fn play(&mut self, process: &mut Process, random: &mut Random, span: Duration) -> usize {
        let (start, mut rounds) = (Instant::now(), 0);
        while start.elapsed() < span {
            process.wait(0.005);
            let late = start.elapsed() > span * 3 / 4;
            self.0.iter_mut().for_each(|tape| tape.play(random, late));
            rounds += 1;
        }
        rounds
    }
}
