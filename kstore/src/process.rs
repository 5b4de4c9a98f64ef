//! Shell: the process `kstore`. It keeps the store, writes it down, tells others, and answers questions.
//!
//! In: topic detections, topic grid (what a snapshot saw where nothing was detected). Out: topic objects, service
//! store. What is told is what is on disk: objects go out after the commit that holds them, so nothing that anybody
//! was told is lost when this process is killed. Only while the disk fails they go out unwritten, and the state of the
//! process says so.

use crate::config::Config;
use crate::decay::View;
use crate::persist::{self, FileFault, Loaded, Room, Vault};
use crate::query::{Query, view_without_grid};
use crate::records::{Dropped, Snapshot};
use crate::seen::Seen;
use crate::store::KnowledgeStore;
use crate::writer::{Done, Outcome, Writer, WriterDied};
use crate::zone::Zone;
use std::path::Path;
use tsense_contract::{
    Detection, Detections, DetectionsHeader, Grid, Objects, ObjectsHeader, ProcessState, Service, Store, StoreQuery,
    Topic,
};
use tsense_geometry::Timestamp;
use tsense_ports::{Inbox, Outbox, PortError, Process, Sample, Server, Wake, machine_seconds};

/// Time between two looks for a finished commit, graph seconds: a commit takes about 6 ms on a disk of today.
const LOOK_S: f64 = 0.01;
/// Time between two looks at everything else when nothing happens, graph seconds.
const IDLE_S: f64 = 0.1;
/// Time between two attempts to write while the disk fails, seconds of the machine.
const RETRY_S: f64 = 5.0;
/// Time between two rounds of forgetting, graph seconds; a round looks at every object, 15 ms where there are 100,000.
const FORGET_S: f64 = 10.0;
/// A grid this much older or newer than the detections still shows the same map, seconds.
const GRID_AGE_S: f64 = 1.0;
/// Without detections for this long the objects are called stale, graph seconds.
const STALE_S: f64 = 3.0;

/// Why the store ended.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A topic or a service failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The writing thread died.
    #[error(transparent)]
    Writer(#[from] WriterDied),
    /// The writing thread could not be started.
    #[error("no thread for writing the store could be started ({0}); are there too many processes?")]
    Thread(#[from] std::io::Error),
}

/// Runs until the process is asked to stop.
pub fn run(mut process: Process, config: &Config) -> Result<(), Error> {
    let path = process.state_dir().join(&config.file);
    let mut ports = Ports::open(&mut process)?;
    let mut keeper = Keeper::open(&path, config)?;
    keeper.state_health(&mut process);
    while process.wait(keeper.patience_s()) != Wake::Stop {
        let now = process.clock().now();
        ports.take(&mut process, &mut keeper, now)?;
        keeper.forget(now);
        keeper.finish()?;
        keeper.commit();
        ports.answer(&keeper, now)?;
        ports.publish(&mut process, &mut keeper, now)?;
        keeper.state_health(&mut process);
    }
    keeper.close()
}

/// The store, its copy as it is on disk, and the thread that writes.
struct Keeper {
    config: Config,
    /// The store.
    live: KnowledgeStore,
    /// The store as the disk has it: what others are told.
    told: KnowledgeStore,
    writer: Writer,
    /// What keeps the store from being written, if anything.
    fault: Option<FileFault>,
    /// What a person should know of the file.
    notes: Vec<String>,
    /// Not before this, seconds of the machine.
    next_commit_s: f64,
    next_forget: Timestamp,
    /// The newest snapshot taken, and when.
    newest: Option<(Snapshot, Timestamp)>,
    counted: Dropped,
    /// Something changed that others have not been told.
    news: bool,
}

impl Keeper {
    fn open(path: &Path, config: &Config) -> Result<Self, Error> {
        let (vault, loaded, fault) = match Vault::open(path, config) {
            Ok((vault, loaded)) => (Some(vault), loaded, None),
            Err(fault) => (None, without_vault(path), Some(fault)),
        };
        loaded.notes.iter().for_each(|note| tracing::warn!("{note}"));
        if let Some(fault) = &fault {
            tracing::error!(%fault, "the store is kept in memory only");
        }
        tracing::info!(objects = loaded.objects.len(), file = %path.display(), "the store is loaded");
        let notes = loaded.notes.clone();
        let live = loaded.into_store(config.clone());
        Ok(Self {
            config: config.clone(),
            told: live.clone(),
            live,
            writer: Writer::start(path.to_path_buf(), config.clone(), vault)?,
            next_commit_s: if fault.is_some() { machine_seconds() + RETRY_S } else { 0.0 },
            fault,
            notes,
            next_forget: Timestamp::default(),
            newest: None,
            counted: Dropped::default(),
            news: true,
        })
    }

    /// Takes in one snapshot's detections.
    fn take(
        &mut self,
        header: &DetectionsHeader,
        detections: &[Detection],
        grid: Option<&Sample<Grid>>,
        now: Timestamp,
    ) {
        let Some(snapshot) = Snapshot::parse(header, now) else {
            self.live.refuse(detections.len());
            return;
        };
        let (stamp, zone) = (snapshot.stamp, snapshot.zone);
        let grid = grid.filter(|g| Timestamp::from_ns(g.header().stamp_ns).seconds_since(stamp).abs() <= GRID_AGE_S);
        let seen = grid.and_then(|g| Seen::new(g.header(), g.items(), zone));
        let view =
            |place: [f64; 2]| -> View { seen.as_ref().map_or_else(|| view_without_grid(place), |s| s.view(place)) };
        let outcome = self.live.take(&snapshot, detections, view);
        tracing::debug!(snapshot = header.snapshot, ?outcome, "detections taken");
        self.newest = Some((snapshot, now));
    }

    fn forget(&mut self, now: Timestamp) {
        if now >= self.next_forget {
            self.live.forget(now);
            self.next_forget = now.plus_seconds(FORGET_S);
        }
    }

    /// Hands changes to the writer when it is time.
    fn commit(&mut self) {
        let now_s = machine_seconds();
        // Without a zone there is nothing to write yet.
        let Some(zone) = self.live.zone() else { return };
        if self.writer.is_busy() || now_s < self.next_commit_s || !(self.live.has_changes() || self.fault.is_some()) {
            return;
        }
        self.next_commit_s = now_s + self.config.commit_interval_s;
        let changes = self.live.take_changes();
        if let Err(changes) = self.writer.write(zone, changes) {
            self.live.give_back(&changes);
        }
    }

    /// Takes the writer's answer, if there is one.
    fn finish(&mut self) -> Result<(), WriterDied> {
        if let Some(done) = self.writer.done()? {
            self.settle(done);
        }
        Ok(())
    }

    fn settle(&mut self, Done { zone, changes, outcome }: Done) {
        match outcome {
            Ok(Outcome::Written(room)) => {
                self.told.apply(zone, &changes);
                if room == Room::Little {
                    self.live.make_room();
                }
                if let Some(fault) = self.fault.take() {
                    tracing::info!(after = %fault, "the store is written again");
                }
            }
            Ok(Outcome::Found(loaded)) => {
                self.live.give_back(&changes);
                self.notes.extend(loaded.notes);
                self.live.adopt(loaded.zone, loaded.objects, loaded.next_id);
                self.next_commit_s = 0.0;
            }
            Err(fault) => {
                self.live.give_back(&changes);
                self.next_commit_s = machine_seconds() + RETRY_S;
                if self.fault.as_ref() != Some(&fault) {
                    tracing::error!(%fault, "the store is not written; tried again every {RETRY_S} s");
                }
                self.fault = Some(fault);
            }
        }
        self.news = true;
    }

    /// The store others are told of.
    fn shown(&self) -> &KnowledgeStore {
        if self.fault.is_some() { &self.live } else { &self.told }
    }

    fn header(&self, truncated: bool) -> ObjectsHeader {
        let shown = self.shown();
        let (zone, south) = shown.zone().map_or((0, 0), Zone::to_wire);
        let registration = self.live.registration();
        let correction = registration.correction();
        ObjectsHeader {
            stamp_ns: shown.newest().map_or(0, |t| t.ns),
            stored: shown.len() as u64,
            vehicle_m: self.newest.as_ref().map_or([0.0; 2], |(snapshot, _)| snapshot.vehicle_m),
            offset_m: correction.offset_m,
            turn_rad: correction.turn_rad,
            truncated: u8::from(truncated),
            zone,
            south,
            registered: u8::from(registration.is_firm()),
            reserved: [0; 4],
        }
    }

    fn answer(&self, wire: &StoreQuery, now: Timestamp) -> (ObjectsHeader, Vec<<Store as Service>::Item>) {
        let answer = Query::parse(wire, <Store as Service>::ITEMS_MAX).map(|query| self.shown().query(&query, now));
        let answer = answer.unwrap_or_default();
        (self.header(answer.truncated), answer.objects)
    }

    /// How long the loop may sleep, graph seconds.
    fn patience_s(&self) -> f64 {
        if self.writer.is_busy() { LOOK_S } else { IDLE_S.min(self.config.commit_interval_s) }
    }

    fn state_health(&mut self, process: &mut Process) {
        let now = process.clock().now();
        let dropped = self.live.dropped();
        for ((cause, total), (_, before)) in dropped.by_cause().into_iter().zip(self.counted.by_cause()) {
            process.health().dropped(cause, total - before);
        }
        self.counted = dropped;
        let (state, mut reason) = self.state(now);
        if let Some(note) = self.notes.last() {
            reason = format!("{reason}; {note}");
        }
        process.health().set(state, &reason);
    }

    fn state(&self, now: Timestamp) -> (ProcessState, String) {
        if let Some(fault) = &self.fault {
            return (ProcessState::Degraded, fault.to_string());
        }
        match self.newest {
            None => (ProcessState::Starting, "waiting for the first detections".into()),
            Some((_, taken)) if now.seconds_since(taken) > STALE_S => {
                (ProcessState::Stale, format!("no detections for more than {STALE_S} s"))
            }
            Some(_) => (ProcessState::Running, "all detections are merged and written".into()),
        }
    }

    /// Writes the last changes down and closes the file.
    fn close(mut self) -> Result<(), Error> {
        if let Some(done) = self.writer.wait()? {
            self.settle(done);
        }
        self.next_commit_s = 0.0;
        self.commit();
        if let Some(done) = self.writer.close()?
            && let Err(fault) = done.outcome
        {
            tracing::error!(%fault, "the last changes were not written");
        }
        Ok(())
    }
}

/// What can be known of a store that cannot be opened for writing.
fn without_vault(path: &Path) -> Loaded {
    let mut loaded = persist::read_only(path).unwrap_or_default();
    loaded.next_id = loaded.next_id.max(persist::ids_below(path));
    loaded
}

/// The topics and the service of this process.
struct Ports {
    detections: Inbox<Detections>,
    grids: Inbox<Grid>,
    grid: Option<Sample<Grid>>,
    objects: Outbox<Objects>,
    server: Server<Store>,
    next_publish: Timestamp,
}

impl Ports {
    fn open(process: &mut Process) -> Result<Self, PortError> {
        Ok(Self {
            detections: process.inbox(None)?,
            grids: process.inbox(None)?,
            grid: None,
            objects: process.outbox(None)?,
            server: process.server()?,
            next_publish: Timestamp::default(),
        })
    }

    fn take(&mut self, process: &mut Process, keeper: &mut Keeper, now: Timestamp) -> Result<(), PortError> {
        if let (Some(grid), _) = self.grids.take_newest()? {
            self.grid = Some(grid);
        }
        while let Some(sample) = self.detections.take()? {
            keeper.take(sample.header(), sample.items(), self.grid.as_ref(), now);
            process.health().taken(1);
            process.health().newest(Timestamp::from_ns(sample.header().stamp_ns));
        }
        Ok(())
    }

    fn answer(&mut self, keeper: &Keeper, now: Timestamp) -> Result<(), PortError> {
        self.server.serve(|query| keeper.answer(query, now)).map(drop)
    }

    fn publish(&mut self, process: &mut Process, keeper: &mut Keeper, now: Timestamp) -> Result<(), PortError> {
        if !keeper.news && now < self.next_publish {
            return Ok(());
        }
        let limit = <Objects as Topic>::ITEMS_MAX;
        let correction = keeper.live.registration().correction();
        let vehicle_m = keeper.newest.as_ref().map(|(snapshot, _)| snapshot.vehicle_m);
        let near = |vehicle_m| Query::near(correction.vehicle(vehicle_m), keeper.config.publish_radius_m, limit);
        let mut answer = keeper.shown().query(&vehicle_m.map_or(Query::all(limit), near), now);
        for object in &mut answer.objects {
            // As the pose says now, so that objects lie on the grid and the map of the same moment.
            let stored_m = [object.easting_m, object.northing_m];
            [object.easting_m, object.northing_m] =
                vehicle_m.map_or(stored_m, |vehicle_m| correction.undo(vehicle_m, stored_m));
        }
        self.objects.send(&keeper.header(answer.truncated), &answer.objects)?;
        process.health().sent(1);
        keeper.news = false;
        self.next_publish = now.plus_seconds(keeper.config.publish_interval_s);
        Ok(())
    }
}
