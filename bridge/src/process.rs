//! Shell: the process `bridge`. It reads every topic a person wants to see, and serves the page.
//!
//! In: topics map, points, grid, objects, detections, pose, joint, processes. Out: the page on the configured address,
//! and the event that asks the mapper for a keyframe. It writes no topic. An address that cannot be had does not stop
//! the rest of the system: the bridge says so in its state and tries again.

use crate::Config;
use crate::web::hub::Hub;
use crate::web::scene::Scene;
use crate::web::server::Server;
use std::collections::BTreeMap;
use std::sync::Arc;
use tsense_contract::{
    Detections, Grid, Joints, KeyframeRequests, MAP_KEYFRAME, Map, Objects, Points, Poses, ProcessState, Processes,
    Topic,
};
use tsense_geometry::Timestamp;
use tsense_ports::{EventSender, Inbox, PortError, Process, Sample, Wake};

/// Time between two frames of counters and two looks at the server, graph seconds.
const COUNTERS_PERIOD_S: f64 = 0.5;
/// Time between two attempts to listen, graph seconds.
const LISTEN_PERIOD_S: f64 = 5.0;

/// Why the bridge ended.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A topic or an event failed.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Runs until the process is asked to stop.
pub fn run(mut process: Process, config: &Config) -> Result<(), Error> {
    let clock = process.clock();
    let hub = Arc::new(Hub::default());
    // The screen refreshes in the viewer's time, whatever the graph's speed.
    let mut scene =
        Scene::new(Arc::clone(&hub), &Config { update_hz: config.update_hz / clock.speed(), ..config.clone() });
    let mut inboxes = Inboxes::open(&mut process)?;
    let keyframe = process.event_sender(MAP_KEYFRAME)?;
    let mut requests = KeyframeRequests::default();
    let mut page = Page::new(config, hub);
    let mut counted = clock.now();
    page.tend(&mut process, counted);
    while process.wait(COUNTERS_PERIOD_S) != Wake::Stop {
        let now = clock.now();
        inboxes.take(&mut process, &mut scene, now)?;
        if requests.due(scene.keyframe_needed(), now) {
            ask_for_keyframe(&keyframe);
        }
        if now.seconds_since(counted) >= COUNTERS_PERIOD_S {
            counted = now;
            page.tend(&mut process, now);
            page.report(&mut process, &mut scene, now);
        }
    }
    Ok(())
}

/// The next incomplete commit asks again, so a request that did not get through is only late.
fn ask_for_keyframe(event: &EventSender) {
    if let Err(error) = event.notify() {
        tracing::debug!(%error, "the mapper was not asked for a keyframe");
    }
}

/// Everything the bridge reads.
struct Inboxes {
    map: Inbox<Map>,
    points: Inbox<Points>,
    grid: Inbox<Grid>,
    objects: Inbox<Objects>,
    detections: Inbox<Detections>,
    poses: Inbox<Poses>,
    joints: Inbox<Joints>,
    processes: Inbox<Processes>,
}

impl Inboxes {
    fn open(process: &mut Process) -> Result<Self, PortError> {
        Ok(Self {
            map: process.inbox(None)?,
            points: process.inbox(None)?,
            grid: process.inbox(None)?,
            objects: process.inbox(None)?,
            detections: process.inbox(None)?,
            poses: process.inbox(None)?,
            joints: process.inbox(None)?,
            processes: process.inbox(None)?,
        })
    }

    /// Takes what waits. Poses come first: they say which zone the rest is in.
    fn take(&mut self, process: &mut Process, scene: &mut Scene<Sample<Map>>, now: Timestamp) -> Result<(), PortError> {
        let mut taken = newest(&mut self.joints, |joint, _| scene.joint(joint))?;
        taken += newest(&mut self.poses, |pose, _| scene.pose(pose, now))?;
        while let Some(sample) = self.map.take()? {
            let header = *sample.header();
            scene.map(&header, sample, now);
            taken += 1;
        }
        while let Some(sample) = self.points.take()? {
            scene.points(sample.header(), sample.items(), now);
            taken += 1;
        }
        taken += newest(&mut self.grid, |header, cells| scene.grid(header, cells))?;
        taken += newest(&mut self.objects, |header, objects| scene.objects(header, objects))?;
        taken += newest(&mut self.detections, |header, list| scene.detections(header, list))?;
        taken += newest(&mut self.processes, |header, list| scene.processes(header, list))?;
        process.health().taken(taken);
        Ok(())
    }
}

/// Shows the newest sample of a topic whose older ones nobody needs; returns how many there were.
fn newest<T: Topic>(inbox: &mut Inbox<T>, show: impl FnOnce(&T::Header, &[T::Item])) -> Result<u64, PortError> {
    let (sample, older) = inbox.take_newest()?;
    if let Some(sample) = &sample {
        show(sample.header(), sample.items());
    }
    Ok(older + u64::from(sample.is_some()))
}

/// The server, or why there is none.
struct Page {
    config: Config,
    hub: Arc<Hub>,
    server: Option<Server>,
    tried: Option<Timestamp>,
    told: BTreeMap<&'static str, u64>,
}

impl Page {
    fn new(config: &Config, hub: Arc<Hub>) -> Self {
        Self { config: config.clone(), hub, server: None, tried: None, told: BTreeMap::new() }
    }

    /// Starts the server where there is none, and states how it is.
    fn tend(&mut self, process: &mut Process, now: Timestamp) {
        if let Some(server) = &self.server {
            let viewers = self.hub.clients();
            let reason = format!("page at {}, {viewers} viewer{}", server.url(), if viewers == 1 { "" } else { "s" });
            return process.health().set(ProcessState::Running, &reason);
        }
        if self.tried.is_some_and(|tried| now.seconds_since(tried) < LISTEN_PERIOD_S) {
            return;
        }
        self.tried = Some(now);
        match Server::start(&self.config, Arc::clone(&self.hub)) {
            Ok(server) => {
                tracing::info!(url = server.url(), "the page is served");
                process.health().set(ProcessState::Running, &format!("page at {}, 0 viewers", server.url()));
                self.server = Some(server);
            }
            Err(error) => {
                tracing::error!(%error, "the page is not served, trying again every {LISTEN_PERIOD_S} s");
                process.health().set(ProcessState::Degraded, &error.to_string());
            }
        }
    }

    /// Puts the counters on the screen and into the heartbeat.
    fn report(&mut self, process: &mut Process, scene: &mut Scene<Sample<Map>>, now: Timestamp) {
        for (cause, total) in scene.drops() {
            let told = self.told.insert(cause, *total).unwrap_or(0);
            process.health().dropped(cause, total - told);
        }
        let counters = scene.publish_counters(now);
        let state = process.health().state().as_str();
        let url = self.server.as_ref().map(Server::url);
        self.hub.set_report(serde_json::json!({"state": state, "url": url, "counters": counters}));
    }
}
