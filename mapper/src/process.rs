//! The mapper's process: scans, poses and pan-tilt readings in; map snapshots and placed points out.
//!
//! In: topics `scan/NAME` (one a ladar), `voxels/NAME` (one another sensor), `pose`, `joint`, and the event that asks for a keyframe. Out: topics `map`
//! and `points`, and a health state in words. All thinking is in [`Mapper`]; here are the clock and the ports.
#![allow(clippy::disallowed_methods, reason = "shell: the loop around the ports")]

use crate::block_store::{BlockStore, StoreCounts};
use crate::blocks_config::BlockMode;
use crate::condition::{Heard, Sources};
use crate::config::Config;
use crate::drops::Drops;
use crate::ladar_mount::LadarMount;
use crate::mapper::Mapper;
use crate::snapshot::SnapshotContext;
use crate::voxel_map::MapError;
use tsense_contract::{Joints, MAP_KEYFRAME, Map, MapSampleKind, Points, Poses, ProcessState, Scan, Voxels};
use tsense_geometry::Timestamp;
use tsense_ports::{Clock, EventReceiver, Inbox, Outbox, PortError, Process, Wake};

/// Longest time between two turns, seconds: a third of what the topic of scans holds at 50 a second.
const TURN_S: f64 = 0.1;

/// Why the mapper's process ended.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// There is no such map.
    #[error("section [mapper]: {0}")]
    Map(#[from] MapError),
    /// No thread for the store.
    #[error("no thread for storing blocks could be started ({0}); are there too many processes?")]
    Thread(#[from] std::io::Error),
}

/// Runs until the graph asks it to stop. `mounts[i]` is the ladar that messages call `i`.
pub fn run(mut process: Process, config: &Config, mounts: Vec<LadarMount>) -> Result<(), Error> {
    let mut shell = Shell::open(&mut process, config, mounts)?;
    while process.wait(shell.seconds_to_turn()) != Wake::Stop {
        shell.take(&mut process)?;
        shell.exchange_blocks(&mut process);
        shell.place_and_trace(&mut process)?;
        shell.snapshot_when_due(&mut process)?;
        shell.report(&mut process);
    }
    shell.close();
    Ok(())
}

struct Shell {
    clock: Clock,
    mapper: Mapper,
    heard: Heard,
    scans: Vec<Inbox<Scan>>,
    voxels: Vec<Inbox<Voxels>>,
    poses: Inbox<Poses>,
    joints: Inbox<Joints>,
    keyframes: EventReceiver,
    map: Outbox<Map>,
    points: Outbox<Points>,
    period_s: f64,
    next_snapshot: Timestamp,
    published: Option<Timestamp>,
    keyframe_wanted: bool,
    reported: Drops,
    store: Option<BlockStore>,
    store_counts: StoreCounts,
    store_at_stop: bool,
}

impl Shell {
    fn open(process: &mut Process, config: &Config, mounts: Vec<LadarMount>) -> Result<Self, Error> {
        let clock = process.clock();
        let now = clock.now();
        let scans =
            mounts.iter().map(|mount| process.quiet_inbox::<Scan>(Some(&mount.name))).collect::<Result<_, _>>()?;
        let voxels = config.voxel_sensor.iter().map(|sensor| process.quiet_inbox::<Voxels>(Some(&sensor.name)));
        let voxels = voxels.collect::<Result<_, _>>()?;
        // The start time differs from that of any earlier mapper on the same clock.
        let mut mapper = Mapper::new(config, mounts.clone(), now.ns as u64)?;
        let folder = process.state_dir().join(&config.blocks.folder);
        let store = match config.blocks.mode {
            BlockMode::Discard => None,
            BlockMode::Store => Some(BlockStore::start(&folder, config, &mut mapper)?),
        };
        Ok(Self {
            clock,
            heard: Heard::new(mounts.len(), config.voxel_sensor.len()),
            mapper,
            scans,
            voxels,
            poses: process.quiet_inbox(None)?,
            joints: process.quiet_inbox(None)?,
            keyframes: process.event_receiver(MAP_KEYFRAME)?,
            map: process.outbox(None)?,
            points: process.outbox(None)?,
            period_s: 1.0 / config.snapshot_hz,
            next_snapshot: now,
            published: None,
            keyframe_wanted: true,
            reported: Drops::default(),
            store,
            store_counts: StoreCounts::default(),
            store_at_stop: config.blocks.store_at_stop,
        })
    }

    /// Between two snapshots nobody sees the map: what came meanwhile is traced together, in a warm cache.
    fn seconds_to_turn(&self) -> f64 {
        self.next_snapshot.seconds_since(self.clock.now()).clamp(0.001, TURN_S)
    }

    /// Poses and readings first: scans may need them.
    fn take(&mut self, process: &mut Process) -> Result<(), Error> {
        let now = self.clock.now();
        let mut taken = 0;
        while let Some(pose) = self.poses.take()? {
            taken += 1;
            if self.mapper.add_pose(pose.header()) {
                self.heard.pose = Some(now);
            }
        }
        while let Some(joint) = self.joints.take()? {
            taken += 1;
            if self.mapper.add_joint(joint.header()) {
                self.heard.joint = Some(now);
            }
        }
        for (ladar, inbox) in self.scans.iter_mut().enumerate() {
            while let Some(scan) = inbox.take()? {
                taken += 1;
                if self.mapper.add_scan(ladar, scan.header(), scan.items(), now) {
                    self.heard.scans[ladar] = Some(now);
                }
            }
        }
        for (sensor, inbox) in self.voxels.iter_mut().enumerate() {
            while let Some(voxels) = inbox.take()? {
                taken += 1;
                if self.mapper.add_voxels(sensor, voxels.header(), voxels.items(), now) {
                    self.heard.voxels[sensor] = Some(now);
                }
            }
        }
        process.health().taken(taken);
        Ok(())
    }

    fn place_and_trace(&mut self, process: &mut Process) -> Result<(), Error> {
        let newest = self.mapper.newest();
        while let Some(scan) = self.mapper.trace_next(self.clock.now()) {
            self.heard.traced = Some(self.clock.now());
            self.points.send(&scan.points_header, &scan.points)?;
            process.health().sent(1);
        }
        if self.mapper.newest() != newest {
            self.heard.traced = Some(self.clock.now());
        }
        Ok(())
    }

    fn snapshot_when_due(&mut self, process: &mut Process) -> Result<(), Error> {
        let now = self.clock.now();
        if now < self.next_snapshot {
            return Ok(());
        }
        // A period after the last one was due, but never a burst to catch up.
        self.next_snapshot = self.next_snapshot.plus_seconds(self.period_s).max(now);
        self.keyframe_wanted |= self.keyframes.drain();
        if self.mapper.newest() == self.published && !self.keyframe_wanted {
            return Ok(());
        }
        if let Some(context) = self.mapper.take_snapshot(self.keyframe_wanted, now) {
            self.keyframe_wanted = false;
            self.published = Some(context.stamp);
            let sent = self.publish(&context)?;
            process.health().sent(sent);
            process.health().newest(context.stamp);
        }
        Ok(())
    }

    /// Copies each brick once, into shared memory. Only the commit wakes the readers: nothing before it is of use alone.
    fn publish(&mut self, context: &SnapshotContext) -> Result<u64, Error> {
        let (mapper, outbox) = (&self.mapper, &mut self.map);
        let sent = mapper.snapshot().publish(context, mapper.map(), |header, len, fill| match header.kind() {
            MapSampleKind::Commit => outbox.send_with(header, len, fill),
            MapSampleKind::Block | MapSampleKind::Delta => outbox.queue_with(header, len, fill),
        })?;
        Ok(sent)
    }

    /// Blocks that left go to the disk, blocks that were read come back; both between two scans.
    fn exchange_blocks(&mut self, process: &mut Process) {
        let Some(store) = &mut self.store else { return };
        store.turn(&mut self.mapper);
        let (now, then) = (store.counts(), std::mem::replace(&mut self.store_counts, store.counts()));
        process.health().dropped("block not stored: queue full", now.queue_full - then.queue_full);
        process.health().dropped("block not stored: disk", now.write_failed - then.write_failed);
        process.health().dropped("stored block not read", now.read_failed - then.read_failed);
        process.health().dropped("stored block over the limit", now.removed - then.removed);
    }

    /// Waits for the disk: at a stop nothing else is to be done.
    fn close(mut self) {
        if let Some(store) = self.store.take() {
            let counts = store.finish(&mut self.mapper, self.store_at_stop);
            tracing::info!(saved = counts.saved, restored = counts.restored, "stored blocks");
        }
    }

    fn report(&mut self, process: &mut Process) {
        let drops = *self.mapper.placer().drops();
        for (cause, count) in drops.since(&self.reported) {
            process.health().dropped(cause.as_str(), count);
        }
        self.reported = drops;
        let sources = Sources { mounts: self.mapper.placer().mounts(), voxel_sensors: self.mapper.voxel_sensors() };
        let (mut state, mut reason) = self.heard.condition(&sources, self.clock.now());
        if let (ProcessState::Running, Some(fault)) = (state, self.store.as_ref().and_then(BlockStore::fault)) {
            (state, reason) = (ProcessState::Degraded, fault.to_string());
        }
        if process.health().state() != state {
            tracing::info!(state = state.as_str(), reason, "mapper");
        }
        process.health().set(state, &reason);
    }
}
