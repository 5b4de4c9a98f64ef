//! The mapper's core: messages in, placed scans and snapshots out. No clock, no topics: time is an argument.
//!
//! One stage of the pipeline in one object: wait for poses (`placer`), place beams (`beams`), trace them
//! (`voxel_map`), end windows (`evidence_window`), fade, follow the vehicle.

use crate::beams::PlacedScan;
use crate::config::Config;
use crate::evidence_window::EvidenceWindow;
use crate::ladar_mount::LadarMount;
use crate::placer::Placer;
use crate::snapshot::{Snapshot, SnapshotContext};
use crate::voxel_map::{MapError, VoxelMap};
use tsense_contract::{Joint, Pose, Return, ScanHeader};
use tsense_geometry::{Point, Timestamp};

/// Longest time between poses that counts for fading, seconds: after a loss the map is not forgotten at one blow.
const FADE_STEP_MAX_S: f64 = 1.0;

/// Blocks fade in turn, this share of them with each snapshot: a round in two seconds at 5 Hz.
const FADE_SHARE: usize = 10;

/// All state of the mapper.
pub struct Mapper {
    config: Config,
    placer: Placer,
    map: VoxelMap,
    window: EvidenceWindow,
    epoch: u64,
    faded: Option<Timestamp>,
    newest: Option<Timestamp>,
    beams: u64,
}

impl Mapper {
    /// A mapper that knows nothing yet. `epoch` must differ from that of any earlier mapper of the graph.
    pub fn new(config: &Config, mounts: Vec<LadarMount>, epoch: u64) -> Result<Self, MapError> {
        Ok(Self {
            placer: Placer::new(&config.placing, mounts),
            map: VoxelMap::new(config)?,
            window: EvidenceWindow::new(&config.evidence),
            config: config.clone(),
            epoch,
            faded: None,
            newest: None,
            beams: 0,
        })
    }

    /// Takes in a pose: the working space follows, and confidence fades with time and way.
    pub fn add_pose(&mut self, pose: &Pose) -> bool {
        let taken = self.placer.add_pose(pose);
        if taken {
            self.follow(pose);
            self.fade(pose);
        }
        taken
    }

    /// Takes in a pan-tilt reading.
    pub fn add_joint(&mut self, joint: &Joint) -> bool {
        self.placer.add_joint(joint)
    }

    /// Takes in a scan of ladar number `ladar`, to be placed when poses cover it.
    pub fn add_scan(&mut self, ladar: usize, header: &ScanHeader, returns: &[Return], now: Timestamp) -> bool {
        self.placer.add_scan(ladar, header, returns, now)
    }

    /// Places and traces the next waiting scan that poses and pan-tilt readings cover. Call until it gives nothing.
    pub fn trace_next(&mut self, now: Timestamp) -> Option<PlacedScan> {
        let scan = self.placer.next_placed(now)?;
        if self.window.ends_before(scan.stamp, scan.sweep) {
            self.map.close_window();
        }
        for beam in &scan.beams {
            self.map.insert(beam);
        }
        self.beams += scan.beams.len() as u64;
        self.newest = self.newest.max(Some(scan.last));
        Some(scan)
    }

    /// A snapshot and what its headers share; nothing before the first scan was traced.
    pub fn snapshot(&mut self, keyframe: bool, now: Timestamp) -> Option<(Snapshot, SnapshotContext)> {
        let (stamp, pose) = (self.newest?, *self.placer.motion().last_pose()?);
        let slots = self.map.block_slots();
        self.map.fade_blocks(slots.div_ceil(FADE_SHARE));
        let context = SnapshotContext {
            epoch: self.epoch,
            stamp,
            published: now,
            voxel_size_m: self.map.grid().size_m(),
            pose: self.placer.motion().pose_message_at(stamp).unwrap_or(pose),
            center: self.map.center(),
        };
        Some((self.map.snapshot(keyframe), context))
    }

    fn follow(&mut self, pose: &Pose) {
        let altitude_m = pose.altitude_m + self.config.center_up_m;
        self.map.center_on(Point::new(pose.easting_m, pose.northing_m, altitude_m));
    }

    fn fade(&mut self, pose: &Pose) {
        let stamp = Timestamp::from_ns(pose.stamp_ns);
        let passed_s = self.faded.map_or(0.0, |then| stamp.seconds_since(then)).clamp(0.0, FADE_STEP_MAX_S);
        self.faded = Some(stamp);
        let [east, north, _] = pose.velocity_m_s.map(f64::from);
        // A source that does not know its speed sends NaN: then only time counts.
        let speed_m_s = Some(east.hypot(north)).filter(|speed| speed.is_finite()).unwrap_or(0.0);
        let fading = &self.config.fading;
        self.map.fade(passed_s * (fading.per_second + fading.per_metre * speed_m_s));
    }

    /// The map.
    pub fn map(&self) -> &VoxelMap {
        &self.map
    }

    /// The queue of scans and the motion histories.
    pub fn placer(&self) -> &Placer {
        &self.placer
    }

    /// Instant of the newest beam traced.
    pub fn newest(&self) -> Option<Timestamp> {
        self.newest
    }

    /// Beams traced since the start.
    pub fn beams(&self) -> u64 {
        self.beams
    }
}
