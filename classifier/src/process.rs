//! Shell: the process `classifier`. It puts snapshots of the map together and classifies the newest whole one.
//!
//! In: topic map. Out: topics detections and grid, and the event that asks the mapper for a keyframe. Blocks stay where
//! the mapper wrote them: the newest sample of each is borrowed, not copied. Snapshots that came while one was
//! being classified are skipped and counted.

use crate::{Classification, Config, View, Window, classify};
use tsense_contract::{
    BRICKS_PER_BLOCK, BlockOutcome, CommitOutcome, Detections, DetectionsHeader, Grid, GridHeader, KeyframeRequests,
    MAP_KEYFRAME, Map, MapHeader, MapSampleKind, ProcessState, SnapshotAssembler, Topic,
};
use tsense_geometry::{Timestamp, VoxelGrid};
use tsense_ports::{EventSender, Inbox, Outbox, PortError, Process, Sample, Wake};

/// Samples that are borrowed while they are looked at, and not held: a commit and its predecessor.
const LOOKED_AT: usize = 4;
/// Longest wait before the state is looked at again, graph seconds.
const WAIT_S: f64 = 0.2;
/// Without a snapshot for so long the results are old, graph seconds: several periods of the slowest mapper.
const STALE_S: f64 = 1.5;

/// Why the classifier ended.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A topic or an event failed.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Runs until the process is asked to stop.
pub fn run(mut process: Process, config: &Config) -> Result<(), Error> {
    let clock = process.clock();
    let mut reader = MapReader::open(&mut process)?;
    let mut writer = Writer { detections: process.outbox(None)?, grid: process.outbox(None)? };
    let mut newest = None;
    process.health().set(ProcessState::Starting, "waiting for the first whole snapshot");
    while process.wait(WAIT_S) != Wake::Stop {
        reader.take(&mut process)?;
        reader.ask(clock.now());
        if let Some(header) = reader.classify_newest(config, |header, found| writer.send(header, found, clock.now()))? {
            newest = Some(Timestamp::from_ns(header.stamp_ns));
            process.health().sent(2);
            process.health().newest(Timestamp::from_ns(header.stamp_ns));
        }
        state(&mut process, newest, clock.now());
    }
    Ok(())
}

fn state(process: &mut Process, newest: Option<Timestamp>, now: Timestamp) {
    let Some(newest) = newest else { return };
    let age_s = now.seconds_since(newest);
    if age_s > STALE_S {
        process.health().set(ProcessState::Stale, &format!("no whole snapshot for {age_s:.0} s"));
    } else {
        process.health().set(ProcessState::Running, "classifying every snapshot");
    }
}

/// The map as this process reads it.
struct MapReader {
    map: Inbox<Map>,
    keyframe: EventSender,
    requests: KeyframeRequests,
    assembler: SnapshotAssembler<Sample<Map>>,
    /// Number of the newest snapshot that was classified, with its epoch.
    done: Option<(u64, u64)>,
}

impl MapReader {
    fn open(process: &mut Process) -> Result<Self, PortError> {
        Ok(Self {
            map: process.inbox(None)?,
            keyframe: process.event_sender(MAP_KEYFRAME)?,
            requests: KeyframeRequests::default(),
            assembler: SnapshotAssembler::new(Map::QOS.borrow - LOOKED_AT),
            done: None,
        })
    }

    /// Takes what waits. Of several whole snapshots only the last remains; the others are counted.
    fn take(&mut self, process: &mut Process) -> Result<(), PortError> {
        let mut whole = 0;
        while let Some(sample) = self.map.take()? {
            process.health().taken(1);
            let header = *sample.header();
            let cause = match header.kind() {
                MapSampleKind::Commit => match self.assembler.commit(&header, sample.items()) {
                    CommitOutcome::Complete => {
                        whole += 1;
                        None
                    }
                    CommitOutcome::Incomplete { .. } => Some("incomplete snapshot"),
                },
                MapSampleKind::Block if sample.items().len() != BRICKS_PER_BLOCK => Some("block of another size"),
                MapSampleKind::Block => match self.assembler.block(&header, sample) {
                    BlockOutcome::Held => None,
                    BlockOutcome::Full => Some("more blocks than can be held"),
                },
            };
            if let Some(cause) = cause {
                process.health().dropped(cause, 1);
            }
        }
        process.health().dropped("snapshot skipped", whole.max(1) - 1);
        Ok(())
    }

    /// Asks for a keyframe where one is needed. One that does not get through is asked for again.
    fn ask(&mut self, now: Timestamp) {
        if !self.requests.due(self.assembler.keyframe_needed(), now) {
            return;
        }
        if let Err(error) = self.keyframe.notify() {
            tracing::debug!(%error, "the mapper was not asked for a keyframe");
        }
    }

    /// Classifies the newest whole snapshot, where it is a new one, and hands the result to `send`.
    fn classify_newest(
        &mut self,
        config: &Config,
        send: impl FnOnce(&MapHeader, &Classification) -> Result<(), PortError>,
    ) -> Result<Option<MapHeader>, PortError> {
        let Some(snapshot) = self.assembler.complete() else { return Ok(None) };
        let header = snapshot.header;
        let number = Some((header.epoch, header.snapshot));
        let Some(grid) = VoxelGrid::new(header.voxel_size_m).filter(|_| self.done != number) else { return Ok(None) };
        let window = Window::around(header.center_voxel, config.window_m, grid);
        let blocks = snapshot.blocks().map(|(key, sample)| (key, sample.items()));
        let view = View::of_blocks(window, grid, blocks, config.voxel_confidence_min);
        let found = classify(&view, Some(&header.pose.global_from_vehicle()), config);
        self.done = number;
        send(&header, &found)?;
        Ok(Some(header))
    }
}

/// The two topics this process writes.
struct Writer {
    detections: Outbox<Detections>,
    grid: Outbox<Grid>,
}

impl Writer {
    fn send(&mut self, map: &MapHeader, found: &Classification, now: Timestamp) -> Result<(), PortError> {
        let trees = &found.trees[..found.trees.len().min(Detections::ITEMS_MAX)];
        self.detections.send(&detections_header(map, now), trees)?;
        let cells = found.grid_cells();
        let header = GridHeader {
            stamp_ns: map.stamp_ns,
            classified_ns: now.ns,
            snapshot: map.snapshot,
            zone: map.pose.zone,
            south: map.pose.south,
            ..found.grid_header()
        };
        self.grid.send(&header, &cells)
    }
}

fn detections_header(map: &MapHeader, now: Timestamp) -> DetectionsHeader {
    DetectionsHeader {
        stamp_ns: map.stamp_ns,
        classified_ns: now.ns,
        epoch: map.epoch,
        snapshot: map.snapshot,
        vehicle_m: [map.pose.easting_m, map.pose.northing_m],
        zone: map.pose.zone,
        south: map.pose.south,
        reserved: [0; 6],
    }
}
