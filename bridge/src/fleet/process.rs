//! Shell: the process `fleet`. It keeps what this vehicle has to tell up to date, and answers stations.
//!
//! In: service store (the reported objects), topic map. Out: what stations ask for, files of blocks in the state folder,
//! and the event that asks the mapper for a keyframe. It writes no topic. Nothing here waits for a station; an address
//! that cannot be had, a store that does not answer or a disk that fails is said in the state of the process.

use super::config::Config;
use super::link::VehicleLink;
use super::shelf::Shelf;
use super::vehicle::{Answer, Vehicle};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tsense_contract::{
    BLOCKS_MAX, BlockKey, Brick, FleetBlock, FleetBlockFile, KeyframeRequests, MAP_KEYFRAME, Map, MapHeader,
    MapSampleKind, ProcessState, SnapshotAssembler, Store, Taken, VehicleName, fleet_encode,
};
use tsense_geometry::Timestamp;
use tsense_ports::{Client, Clock, EventSender, Inbox, PortError, Process, Sample, Wake};

/// A block as the bytes of a map file; nothing where nothing is known of it. Given by who knows the format.
pub type EncodeBlock = fn(&MapHeader, BlockKey, &[Brick]) -> Option<Vec<u8>>;

/// Time between two looks at what is due, graph seconds.
const LOOK_S: f64 = 0.1;
/// News are told at least this often, graph seconds; and on change as often as objects are looked at.
const NEWS_S: f64 = 1.0;
/// Time between two attempts to open a link, graph seconds.
const OPEN_S: f64 = 5.0;
/// The store answers within milliseconds, also while it writes, seconds.
const STORE_S: f64 = 0.5;
/// Blocks written in one turn: each takes some 4 ms to pack and a flush of the disk; samples wait meanwhile, few enough.
const BLOCKS_PER_TURN: usize = 2;

/// Runs until the process is asked to stop.
pub fn run(mut process: Process, config: &Config, encode: EncodeBlock) -> Result<(), PortError> {
    let mut stage = Stage::open(&mut process, config, encode)?;
    while process.wait(LOOK_S) != Wake::Stop {
        let now = process.clock().now();
        stage.take_map(&mut process, now)?;
        stage.look_at_store(&mut process, now);
        stage.tend(&mut process, now);
    }
    Ok(())
}

/// What the vehicle has, as the main loop and the answering threads share it.
type Shared = Arc<Mutex<Vehicle>>;

struct Stage {
    config: Config,
    name: VehicleName,
    vehicle: Shared,
    shelf: Option<Shelf>,
    encode: EncodeBlock,
    map: Inbox<Map>,
    assembler: SnapshotAssembler<Sample<Map>>,
    keyframe: EventSender,
    requests: KeyframeRequests,
    store: Client<Store>,
    links: BTreeMap<String, VehicleLink>,
    refused: Arc<Mutex<BTreeMap<&'static str, u64>>>,
    next_look: Timestamp,
    next_news: Timestamp,
    next_open: Timestamp,
    sent: u64,
    faults: BTreeMap<&'static str, String>,
}

impl Stage {
    fn open(process: &mut Process, config: &Config, encode: EncodeBlock) -> Result<Self, PortError> {
        let now = process.clock().now();
        let mut vehicle = Vehicle::new(now.ns.unsigned_abs().max(1));
        let mut faults = BTreeMap::new();
        let shelf = config.blocks.then(|| Shelf::open(&process.state_dir().join("fleet-blocks")));
        let shelf = match shelf.transpose() {
            Ok(shelf) => shelf.map(|(shelf, found)| {
                found.into_iter().for_each(|block| vehicle.blocks.put(block));
                shelf
            }),
            Err(error) => {
                faults.insert("blocks", format!("blocks are not offered: {error}"));
                None
            }
        };
        // The section was validated; a name that is none would be no key.
        let name = VehicleName::new(&config.vehicle).or(VehicleName::new("vehicle"));
        Ok(Self {
            config: config.clone(),
            name: name.unwrap_or_else(|| unreachable!("`vehicle` is a name")),
            vehicle: Arc::new(Mutex::new(vehicle)),
            shelf,
            encode,
            map: process.inbox(None)?,
            assembler: SnapshotAssembler::new(BLOCKS_MAX),
            keyframe: process.event_sender(MAP_KEYFRAME)?,
            requests: KeyframeRequests::default(),
            store: process.client()?,
            links: BTreeMap::new(),
            refused: Arc::default(),
            next_look: now,
            next_news: now,
            next_open: now,
            sent: 0,
            faults,
        })
    }

    /// Takes the map in, and writes blocks that are due.
    fn take_map(&mut self, process: &mut Process, now: Timestamp) -> Result<(), PortError> {
        let mut newest = None;
        while let Some(sample) = self.map.take()? {
            process.health().taken(1);
            if self.shelf.is_none() {
                continue;
            }
            let header = *sample.header();
            if header.kind() == MapSampleKind::Commit {
                self.write_leaving(&header, &sample, now);
            }
            newest = (self.assembler.take(&header, sample) == Taken::Complete).then_some(header);
        }
        if let Some(header) = newest {
            self.write_due(&header, now);
        }
        let needed = self.shelf.is_some() && self.assembler.keyframe_needed();
        if self.requests.due(needed, now) {
            // A mapper that restarts just now is asked again.
            let _ = self.keyframe.notify();
        }
        Ok(())
    }

    /// Blocks that a commit lists no more are looked at for the last time.
    fn write_leaving(&mut self, header: &MapHeader, sample: &Sample<Map>, now: Timestamp) {
        let due = |key, version| lock(&self.vehicle).blocks.is_due_leaving(key, header.epoch, version);
        let leaving: Vec<(BlockKey, bool, Option<Vec<u8>>)> = self
            .assembler
            .leaving(header, sample.items())
            .map(|(key, version, bricks)| {
                let is_due = due(key, version);
                (key, is_due, is_due.then(|| (self.encode)(header, key, bricks)).flatten())
            })
            .collect();
        for (key, _, bytes) in leaving {
            self.write(header, key, bytes, now);
            lock(&self.vehicle).blocks.note_left(key);
        }
    }

    fn write_due(&mut self, header: &MapHeader, now: Timestamp) {
        let Some(snapshot) = self.assembler.complete() else { return };
        let period_s = self.config.block_period_s;
        let due = |(key, version, _): &(BlockKey, u32, &[Brick])| {
            lock(&self.vehicle).blocks.is_due(*key, header.epoch, *version, now, period_s)
        };
        let due = snapshot.versioned_blocks().filter(due).take(BLOCKS_PER_TURN);
        let packed: Vec<_> =
            due.map(|(key, version, bricks)| (key, version, (self.encode)(header, key, bricks))).collect();
        for (key, version, bytes) in packed {
            self.write(header, key, bytes, now);
            lock(&self.vehicle).blocks.note_version(key, header.epoch, version, now);
        }
    }

    /// Writes a block's file, then tells of it, then makes room.
    fn write(&mut self, header: &MapHeader, key: BlockKey, bytes: Option<Vec<u8>>, now: Timestamp) {
        let (Some(shelf), Some(bytes)) = (&self.shelf, bytes) else { return };
        let block = FleetBlock {
            number: 0,
            stamp_ns: now.ns,
            voxel_size_m: header.voxel_size_m,
            key,
            bytes: 0,
            crc: 0,
            zone: header.pose.zone,
            south: header.pose.south,
            reserved: [0; 2],
        };
        if !block.is_possible() {
            return;
        }
        match shelf.write(block, &bytes) {
            Ok(block) => {
                self.faults.remove("disk");
                let removed = {
                    let mut vehicle = lock(&self.vehicle);
                    vehicle.blocks.put(block);
                    vehicle.blocks.make_room((self.config.blocks_max_mb * 1e6) as u64)
                };
                removed.iter().for_each(|block| shelf.remove(block.place()));
                self.count("block removed for room", removed.len() as u64);
            }
            Err(error) => {
                self.count("block not written", 1);
                self.faults.insert("disk", format!("blocks are not written: {error}"));
            }
        }
    }

    /// Asks the store for the next part of its objects, when it is time.
    fn look_at_store(&mut self, process: &mut Process, now: Timestamp) {
        if now < self.next_look {
            return;
        }
        self.next_look = now.plus_seconds(self.config.objects_period_s);
        let query = lock(&self.vehicle).objects.query();
        match self.store.ask(&query, STORE_S) {
            Ok((header, objects)) => {
                self.faults.remove("store");
                process.health().taken(1);
                if lock(&self.vehicle).objects.take(&header, &objects, now) > 0 {
                    self.next_news = now;
                }
            }
            Err(error) => drop(self.faults.insert("store", format!("no objects: {error}"))),
        }
    }

    /// Opens links, tells news, states how it all is.
    fn tend(&mut self, process: &mut Process, now: Timestamp) {
        if now >= self.next_open {
            self.next_open = now.plus_seconds(OPEN_S);
            self.open_links(process.clock());
        }
        if now < self.next_news {
            return;
        }
        self.next_news = now.plus_seconds(NEWS_S);
        let news = lock(&self.vehicle).news(now);
        self.links.values().for_each(|link| link.tell(news.clone()));
        let sent: u64 = self.links.values().map(VehicleLink::sent_bytes).sum();
        process.health().sent(u64::from(sent > self.sent));
        process.health().newest(now);
        self.sent = sent;
        for (cause, count) in std::mem::take(&mut *lock(&self.refused)) {
            process.health().dropped(cause, count);
        }
        let (state, words) = self.words();
        process.health().set(state, &words);
    }

    fn open_links(&mut self, clock: Clock) {
        for address in &self.config.connect {
            if self.links.contains_key(address) {
                continue;
            }
            let (vehicle, shelf, refused) = (Arc::clone(&self.vehicle), self.shelf.clone(), Arc::clone(&self.refused));
            let answer = move |question: &[u8]| answer(&vehicle, shelf.as_ref(), &refused, question, clock.now());
            match VehicleLink::open(address, &self.name, answer) {
                Ok(link) => {
                    self.faults.remove("link");
                    tracing::info!(address, vehicle = %self.name, "the link to a station is open");
                    self.links.insert(address.clone(), link);
                }
                Err(error) => {
                    let words = format!("no link to {address}: {error}");
                    if self.faults.insert("link", words.clone()).as_ref() != Some(&words) {
                        tracing::error!("{words}; trying again every {OPEN_S} s");
                    }
                }
            }
        }
    }

    fn words(&self) -> (ProcessState, String) {
        if let Some(fault) = self.faults.values().next() {
            return (ProcessState::Degraded, fault.clone());
        }
        let stations: usize = self.links.values().map(VehicleLink::stations).sum();
        let vehicle = lock(&self.vehicle);
        let (objects, blocks) = (vehicle.objects.log().iter().count(), vehicle.blocks.log().iter().count());
        let of = self.config.connect.len();
        let words = format!(
            "{}: {stations} of {of} stations, {objects} objects, {blocks} blocks, {} bytes sent",
            self.name, self.sent
        );
        (ProcessState::Running, words)
    }

    fn count(&self, cause: &'static str, n: u64) {
        *lock(&self.refused).entry(cause).or_default() += n;
    }
}

/// The bytes that a question gets; nothing, and a count, where it makes no sense.
fn answer(
    vehicle: &Shared,
    shelf: Option<&Shelf>,
    refused: &Mutex<BTreeMap<&'static str, u64>>,
    question: &[u8],
    now: Timestamp,
) -> Option<Vec<u8>> {
    let answer = lock(vehicle).answer(question, now);
    match answer {
        Ok(Answer::Page(bytes)) => Some(bytes),
        Ok(Answer::Later) => None,
        Ok(Answer::File(ask, block)) => {
            // As it is now: it may be newer than what the log said a moment ago.
            let file = shelf.and_then(|shelf| shelf.read(block.place()).ok()).unwrap_or_default();
            let block = FleetBlock { bytes: file.len() as u32, crc: crc32fast::hash(&file), ..block };
            Some(fleet_encode(&FleetBlockFile { ask, block }, &file))
        }
        Err(fault) => {
            *lock(refused).entry(fault.as_str()).or_default() += 1;
            None
        }
    }
}

/// What a thread that died left is whole: every change is made by one call.
fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
