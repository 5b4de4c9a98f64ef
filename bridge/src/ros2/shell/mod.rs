//! Shell: the topics that a translator reads, for every process that has one.
//!
//! In: topics pose, joint, scan, map, grid, objects, processes; none of which nobody wants. Out: calls of the translator,
//! and the event that asks the mapper for a keyframe.

use super::config::Config;
use super::motion::Mounts;
use super::translator::Translator;
use tsense_contract::{Grid, Joints, KeyframeRequests, MAP_KEYFRAME, Map, Objects, Poses, Processes, Scan, Topic};
use tsense_geometry::Timestamp;
use tsense_ports::{EventSender, Inbox, PortError, Process, Sample};

/// Translates samples as they lie in shared memory.
pub type SharedTranslator = Translator<Sample<Map>, Sample<Grid>>;

/// What is read: of a topic that nobody wants, nothing.
pub struct Inboxes {
    poses: Inbox<Poses>,
    joints: Option<Inbox<Joints>>,
    scans: Vec<Inbox<Scan>>,
    map: Option<Inbox<Map>>,
    grid: Option<Inbox<Grid>>,
    objects: Option<Inbox<Objects>>,
    processes: Option<Inbox<Processes>>,
    keyframe: EventSender,
    requests: KeyframeRequests,
}

impl Inboxes {
    /// Opens what the configuration wants, and the event that asks the mapper for a keyframe.
    pub fn open(process: &mut Process, config: &Config, mounts: &Mounts) -> Result<Self, PortError> {
        let topics = &config.topics;
        let grid_wanted = [&topics.traversability, &topics.grid_map, &topics.voxels].iter().any(|t| t.hz > 0.0);
        let mut scans = Vec::new();
        if topics.scan.hz > 0.0 {
            for ladar in &mounts.ladars {
                scans.push(process.inbox(Some(&ladar.name))?);
            }
        }
        Ok(Self {
            poses: process.inbox(None)?,
            joints: wanted(process, topics.tf.hz > 0.0 && mounts.pan_tilt.is_some())?,
            scans,
            map: wanted(process, topics.voxels.hz > 0.0)?,
            grid: wanted(process, grid_wanted)?,
            objects: wanted(process, topics.objects.hz > 0.0)?,
            processes: wanted(process, topics.diagnostics.hz > 0.0)?,
            keyframe: process.event_sender(MAP_KEYFRAME)?,
            requests: KeyframeRequests::default(),
        })
    }

    /// Takes what waits. Poses come first: they say where the rest is.
    pub fn take(
        &mut self,
        process: &mut Process,
        translator: &mut SharedTranslator,
        now: Timestamp,
    ) -> Result<(), PortError> {
        let mut taken = 0;
        while let Some(sample) = self.poses.take()? {
            translator.pose(sample.header(), now);
            process.health().newest(Timestamp::from_ns(sample.header().stamp_ns));
            taken += 1;
        }
        taken += newest(self.joints.as_mut(), |sample| translator.joint(sample.header(), now))?;
        for (i, scans) in self.scans.iter_mut().enumerate() {
            while let Some(sample) = scans.take()? {
                translator.scan(i, sample.header(), sample.items(), now);
                taken += 1;
            }
        }
        taken += newest(self.grid.as_mut(), |sample| translator.grid(&sample.header().clone(), sample, now))?;
        while let Some(sample) = self.map.as_mut().map(Inbox::take).transpose()?.flatten() {
            translator.map(&sample.header().clone(), sample, now);
            taken += 1;
        }
        taken += newest(self.objects.as_mut(), |s| translator.objects(s.header(), s.items(), now))?;
        taken += newest(self.processes.as_mut(), |s| translator.processes(s.header(), s.items(), now))?;
        process.health().taken(taken);
        if self.map.is_some() && self.requests.due(translator.keyframe_needed(), now) {
            ask_for_keyframe(&self.keyframe);
        }
        Ok(())
    }
}

fn wanted<T: Topic>(process: &mut Process, wanted: bool) -> Result<Option<Inbox<T>>, PortError> {
    wanted.then(|| process.inbox(None)).transpose()
}

/// Translates the newest sample of a topic whose older ones nobody needs; returns how many there were.
fn newest<T: Topic>(inbox: Option<&mut Inbox<T>>, translate: impl FnOnce(Sample<T>)) -> Result<u64, PortError> {
    let Some(inbox) = inbox else { return Ok(0) };
    let (sample, older) = inbox.take_newest()?;
    let taken = older + u64::from(sample.is_some());
    if let Some(sample) = sample {
        translate(sample);
    }
    Ok(taken)
}

/// The next incomplete commit asks again, so a request that did not get through is only late.
fn ask_for_keyframe(event: &EventSender) {
    if let Err(error) = event.notify() {
        tracing::debug!(%error, "the mapper was not asked for a keyframe");
    }
}
