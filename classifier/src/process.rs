//! Shell: the process `classifier`. Map snapshots in, detections and the Smart Sensor Grid out.
//!
//! In: topic map (a block is kept borrowed until a delta changes it: see the assembler in `contract`) and topic points,
//! whose beams go into the bounded store of returns. Out: topics detections and grid, the event that asks the mapper for
//! a keyframe, and a health state in words. Only the newest complete snapshot is classified; older ones that waited
//! behind it are skipped and counted.
#![allow(clippy::disallowed_methods, reason = "shell: the loop around the ports")]

use crate::classify::{Classification, Input, detect};
use crate::columns::{View, Window};
use crate::config::Config;
use crate::intake::Intake;
use crate::memory::Memory;
use crate::returns::{PlacedBeam, Returns};
use tsense_contract::{
    Detection, Detections, DetectionsHeader, Grid, GridHeader, KeyframeRequests, MAP_KEYFRAME, Map, MapHeader,
    PlacedReturn, Points, PointsHeader, ProcessState, ReturnKind, Snapshot, Topic,
};
use tsense_geometry::{Point, Timestamp, VoxelGrid};
use tsense_ports::{EventSender, Inbox, Outbox, PortError, Process, Sample, Wake};

/// Longest wait without data, graph seconds: how late a missing keyframe is asked for again.
const IDLE_S: f64 = 0.2;
/// Without a complete snapshot for this long the classification is called stale, graph seconds.
const STALE_S: f64 = 2.0;

/// Why the classifier ended.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A topic or an event failed.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Runs until the process is asked to stop.
pub fn run(mut process: Process, config: &Config) -> Result<(), Error> {
    let mut shell = Shell::open(&mut process, config)?;
    shell.report(&mut process);
    while process.wait(IDLE_S) != Wake::Stop {
        shell.take_points(&mut process)?;
        shell.take(&mut process)?;
        shell.classify_newest(&mut process)?;
        shell.ask_for_keyframe(&process);
        shell.report(&mut process);
    }
    Ok(())
}

struct Shell {
    config: Config,
    map: Inbox<Map>,
    points: Inbox<Points>,
    detections: Outbox<Detections>,
    grid: Outbox<Grid>,
    keyframe: EventSender,
    requests: KeyframeRequests,
    intake: Intake<Sample<Map>>,
    returns: Returns,
    memory: Memory,
    /// Zone and hemisphere that the returns lie in.
    zone: [u8; 2],
    /// When a snapshot was classified last.
    done: Option<Timestamp>,
    started: Timestamp,
    /// What keeps a snapshot from being classified, if anything.
    fault: Option<String>,
}

impl Shell {
    fn open(process: &mut Process, config: &Config) -> Result<Self, PortError> {
        Ok(Self {
            config: config.clone(),
            map: process.inbox(None)?,
            points: process.inbox(None)?,
            detections: process.outbox(None)?,
            grid: process.outbox(None)?,
            keyframe: process.event_sender(MAP_KEYFRAME)?,
            requests: KeyframeRequests::default(),
            intake: Intake::default(),
            returns: Returns::new(&config.returns),
            memory: Memory::new(config.stems.judged_max),
            zone: [0; 2],
            done: None,
            started: process.clock().now(),
            fault: None,
        })
    }

    /// Takes the scans that wait into the store. Coordinates of another zone do not mix with those before.
    fn take_points(&mut self, process: &mut Process) -> Result<(), PortError> {
        while let Some(scan) = self.points.take()? {
            process.health().taken(1);
            let header = scan.header();
            if self.zone != [header.zone, header.south] {
                self.returns.clear();
                self.memory = Memory::new(self.config.stems.judged_max);
                self.zone = [header.zone, header.south];
            }
            scan.items().iter().filter_map(|item| placed(header, item)).for_each(|beam| self.returns.insert(&beam));
        }
        Ok(())
    }

    /// Takes all that waits. A complete snapshot that is not the last of them is skipped.
    fn take(&mut self, process: &mut Process) -> Result<(), PortError> {
        while let Some(sample) = self.map.take()? {
            process.health().taken(1);
            let header = *sample.header();
            self.intake.take(&header, sample, |cause| process.health().dropped(cause, 1));
        }
        Ok(())
    }

    /// Classifies the newest snapshot. The trees go out before the rest is worked out: they are wanted soonest. With them
    /// go the things of the snapshot before, each under its own stamp.
    fn classify_newest(&mut self, process: &mut Process) -> Result<(), PortError> {
        let Some(snapshot) = self.intake.next() else { return Ok(()) };
        let (header, config) = (snapshot.header, &self.config);
        roll(&mut self.returns, &header, config);
        let view = view_of(&snapshot, config);
        self.intake.done(&header);
        let view = match view {
            Ok(view) => view,
            Err(fault) => {
                process.health().dropped("snapshot not classified", 1);
                self.fault = Some(fault);
                return Ok(());
            }
        };
        self.fault = None;
        let vehicle = Some(header.pose.global_from_vehicle()).filter(|pose| pose.is_finite() && header.pose.zone != 0);
        let stamp = Timestamp::from_ns(header.stamp_ns);
        let input = Input { view: &view, returns: Some(&self.returns), vehicle: vehicle.as_ref(), stamp };
        let detected = detect(&input, &mut self.memory, config);
        let (detections, cut) = surest(detected.trees(), self.memory.things());
        process.health().dropped("detection beyond the bound", cut as u64);
        self.detections.send(&detections_header(&header, process.clock().now()), &detections)?;
        let found = detected.finish(&input, &mut self.memory, config);
        self.returns.seen();
        let (things, cut) = found.things(&self.memory);
        process.health().dropped("thing beyond the bound", cut as u64);
        self.memory.keep_things(things);
        let now = process.clock().now();
        self.done = Some(now);
        let cells = found.grid_cells();
        if cells.len() <= Grid::ITEMS_MAX {
            self.grid.send(&grid_header(&header, &found, now), &cells)?;
        } else {
            process.health().dropped("grid too large", 1);
        }
        process.health().sent(2);
        process.health().newest(Timestamp::from_ns(header.stamp_ns));
        Ok(())
    }

    /// A request that does not get through (the mapper restarts just now) is made again.
    fn ask_for_keyframe(&mut self, process: &Process) {
        if self.requests.due(self.intake.keyframe_needed(), process.clock().now())
            && let Err(error) = self.keyframe.notify()
        {
            tracing::debug!(%error, "the mapper was not asked for a keyframe");
        }
    }

    fn report(&mut self, process: &mut Process) {
        let now = process.clock().now();
        let age_s = self.done.map(|when| now.seconds_since(when));
        let (state, reason) = match (&self.fault, age_s) {
            (Some(fault), _) => (ProcessState::Degraded, fault.clone()),
            (None, None) if now.seconds_since(self.started) > STALE_S => {
                (ProcessState::Starting, "no complete snapshot of the map yet: is the mapper running?".into())
            }
            (None, None) => (ProcessState::Starting, "waiting for the map's first snapshot".into()),
            (None, Some(age_s)) if age_s > STALE_S => {
                (ProcessState::Stale, format!("no new snapshot of the map for {age_s:.0} s"))
            }
            (None, Some(_)) => (ProcessState::Running, "every snapshot is classified".into()),
        };
        if process.health().state() != state {
            tracing::info!(state = state.as_str(), reason, "classifier");
        }
        process.health().set(state, &reason);
    }
}

/// A beam of a scan, if it says something: dazzled and uncertain ones do not.
fn placed(header: &PointsHeader, item: &PlacedReturn) -> Option<PlacedBeam> {
    let is_return = match ReturnKind::from_wire(item.kind) {
        ReturnKind::Echo => true,
        ReturnKind::NoReturn => false,
        ReturnKind::Dazzled | ReturnKind::TooWeak | ReturnKind::Reserved => return None,
    };
    let at = |xyz_m: [f32; 3]| {
        let [x, y, z] = [0, 1, 2].map(|axis| header.origin_m[axis] + f64::from(xyz_m[axis]));
        Point::new(x, y, z)
    };
    let (origin, end) = (at(header.ladar_m), at(item.xyz_m));
    Some(PlacedBeam { ladar: header.ladar, stamp: Timestamp::from_ns(header.stamp_ns), origin, end, is_return })
}

/// Forgets the returns behind the vehicle and makes the others ready to be read.
fn roll(returns: &mut Returns, header: &MapHeader, config: &Config) {
    let center = Point::new(header.pose.easting_m, header.pose.northing_m, 0.0);
    let reach_m = config.window_m[0].hypot(config.window_m[1]) / 2.0;
    if center.is_finite() {
        returns.roll(center, reach_m, Timestamp::from_ns(header.stamp_ns));
    }
    returns.settle();
}

/// The window around the map's centre; or why there is none.
fn view_of(snapshot: &Snapshot<'_, Sample<Map>>, config: &Config) -> Result<View, String> {
    let header = &snapshot.header;
    let grid = VoxelGrid::new(header.voxel_size_m)
        .ok_or_else(|| format!("the map has voxels of {} m; 0.01 to 10 m are possible", header.voxel_size_m))?;
    let window = Window::around(header.center_voxel, config.window_m, grid);
    Ok(View::of_blocks(window, grid, snapshot.blocks(), config.voxel_confidence_min))
}

/// The detections that fit into a message, of the trees the surest ones where they do not all fit; and how many were cut.
fn surest(trees: &[Detection], things: &[Detection]) -> (Vec<Detection>, usize) {
    let mut kept = trees.to_vec();
    if kept.len() + things.len() > Detections::ITEMS_MAX {
        kept.sort_by(|a, b| b.confidence.total_cmp(&a.confidence));
        kept.truncate(Detections::ITEMS_MAX.saturating_sub(things.len()));
    }
    let cut = trees.len() - kept.len();
    kept.extend_from_slice(things);
    (kept, cut)
}

fn detections_header(header: &MapHeader, now: Timestamp) -> DetectionsHeader {
    DetectionsHeader {
        stamp_ns: header.stamp_ns,
        classified_ns: now.ns,
        epoch: header.epoch,
        snapshot: header.snapshot,
        vehicle_m: [header.pose.easting_m, header.pose.northing_m],
        zone: header.pose.zone,
        south: header.pose.south,
        reserved: [0; 6],
    }
}

fn grid_header(header: &MapHeader, found: &Classification, now: Timestamp) -> GridHeader {
    GridHeader {
        stamp_ns: header.stamp_ns,
        classified_ns: now.ns,
        snapshot: header.snapshot,
        zone: header.pose.zone,
        south: header.pose.south,
        ..found.grid_header()
    }
}
