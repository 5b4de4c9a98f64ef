//! The mapper's core: messages in, placed scans and snapshots out. No clock, no topics: time is an argument.
//!
//! One stage of the pipeline in one object: wait for poses (`placer`), place beams (`beams`), trace them
//! (`voxel_map`), fuse other sensors' voxels (`voxel_queue`), end windows (`evidence_window`), fade, follow the vehicle.

use crate::beams::PlacedScan;
use crate::config::Config;
use crate::drops::DropCause;
use crate::evidence_window::EvidenceWindow;
use crate::ladar_mount::LadarMount;
use crate::placer::Placer;
use crate::snapshot::{Snapshot, SnapshotContext};
use crate::voxel_map::{EDGE_VOXELS_MAX, MapError, VoxelMap};
use crate::voxel_queue::{Place, VoxelQueue, WaitingVoxels};
use crate::voxel_sensor::VoxelSensor;
use tsense_contract::{Joint, Pose, Return, ScanHeader, SensedVoxel, VoxelsHeader, VoxelsKind};
use tsense_geometry::{Point, Timestamp};

/// Longest time between poses that counts for fading, seconds: after a loss the map is not forgotten at one blow.
const FADE_STEP_MAX_S: f64 = 1.0;

/// Blocks fade in turn, this share of them with each snapshot: a round in two seconds at 5 Hz.
const FADE_SHARE: usize = 10;

/// All state of the mapper.
pub struct Mapper {
    config: Config,
    placer: Placer,
    voxels: VoxelQueue,
    map: VoxelMap,
    window: EvidenceWindow,
    snapshot: Snapshot,
    /// The scan placed last, kept for its memory.
    placed: PlacedScan,
    epoch: u64,
    faded: Option<Timestamp>,
    newest: Option<Timestamp>,
    beams: u64,
}

impl Mapper {
    /// A mapper that knows nothing yet. `epoch` must differ from that of any earlier mapper of the graph.
    pub fn new(config: &Config, mounts: Vec<LadarMount>, epoch: u64) -> Result<Self, MapError> {
        // Where there are no ladars there are no scans to wait for.
        let deadline_s = if mounts.is_empty() { 0.0 } else { config.placing.deadline_s };
        Ok(Self {
            placer: Placer::new(&config.placing, mounts),
            voxels: VoxelQueue::new(&config.voxel_sensor, deadline_s),
            map: VoxelMap::new(config)?,
            window: EvidenceWindow::new(&config.evidence),
            snapshot: Snapshot::default(),
            placed: PlacedScan::default(),
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

    /// Takes in a sample of sensor number `sensor`, to be fused when the scans have come as far.
    pub fn add_voxels(&mut self, sensor: usize, header: &VoxelsHeader, items: &[SensedVoxel], now: Timestamp) -> bool {
        let edge_max_m = EDGE_VOXELS_MAX * self.map.grid().size_m();
        let place = Place { zone: self.placer.motion().zone(), edge_max_m };
        self.voxels.add(sensor, (header, items), (&place, now), self.placer.drops_mut())
    }

    /// Places and traces the next waiting scan that poses and pan-tilt readings cover. Call until it gives nothing.
    /// The scan is good until the next call.
    pub fn trace_next(&mut self, now: Timestamp) -> Option<&PlacedScan> {
        let mut scan = std::mem::take(&mut self.placed);
        let is_there = self.placer.next_placed(now, &mut scan);
        if is_there {
            self.trace(&mut scan);
        } else {
            self.fuse_overdue(now);
        }
        self.placed = scan;
        is_there.then_some(&self.placed)
    }

    /// Traces a placed scan, after other sensors' voxels of the time before it, and after ending the window of evidence that
    /// ends before it. Beams that would go on below the ground are cut.
    pub fn trace(&mut self, scan: &mut PlacedScan) {
        while let Some(sample) = self.voxels.next_before(scan.stamp) {
            self.fuse(sample);
        }
        if self.window.ends_before(scan.stamp, scan.sweep) {
            self.map.close_window();
        }
        for beam in &mut scan.beams {
            *beam = self.map.above_ground(beam);
        }
        self.map.insert_all(&scan.beams);
        self.beams += scan.beams.len() as u64;
        self.newest = self.newest.max(Some(scan.last));
    }

    fn fuse_overdue(&mut self, now: Timestamp) {
        while let Some(sample) = self.voxels.next_overdue(now) {
            self.fuse(sample);
        }
    }

    /// Another sensor's voxels join the window of evidence as a scan of a ladar that does not nod.
    fn fuse(&mut self, sample: WaitingVoxels) {
        let is_measured = sample.header.kind() == VoxelsKind::Measured;
        if is_measured && self.window.ends_before(sample.stamp(), None) {
            self.map.close_window();
        }
        let fused = self.map.fuse_sensed(&sample.header, &sample.items, sample.weight);
        let drops = self.placer.drops_mut();
        drops.add(DropCause::VoxelItems, fused.invalid as u64);
        // A sample without voxels says that the sensor lives.
        if fused.inside + fused.invalid == 0 && !sample.items.is_empty() {
            drops.count(DropCause::VoxelsOutside);
        }
        // What is known from earlier makes the map no newer.
        if is_measured {
            self.newest = self.newest.max(Some(sample.stamp()));
        }
        self.voxels.keep_memory(sample.items);
    }

    /// Takes a snapshot, to be published before the next beam, and gives what its headers share; nothing before the first
    /// scan was traced.
    pub fn take_snapshot(&mut self, keyframe: bool, now: Timestamp) -> Option<SnapshotContext> {
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
        self.map.snapshot(keyframe, &mut self.snapshot);
        Some(context)
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

    /// The snapshot taken last.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// The map.
    pub fn map(&self) -> &VoxelMap {
        &self.map
    }

    /// The map, for whoever takes blocks from it and brings them back.
    pub fn map_mut(&mut self) -> &mut VoxelMap {
        &mut self.map
    }

    /// Which life of the mapper this is.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// The queue of scans and the motion histories.
    pub fn placer(&self) -> &Placer {
        &self.placer
    }

    /// The sensors whose voxels are fused.
    pub fn voxel_sensors(&self) -> &[VoxelSensor] {
        self.voxels.sensors()
    }

    /// The queue, for a caller that places scans and traces them apart.
    pub fn placer_mut(&mut self) -> &mut Placer {
        &mut self.placer
    }

    /// Instant of the newest beam traced, or of the newest voxels measured.
    pub fn newest(&self) -> Option<Timestamp> {
        self.newest
    }

    /// Beams traced since the start.
    pub fn beams(&self) -> u64 {
        self.beams
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{joint_at, pose_at, scan_at};
    use tsense_contract::{MapSampleKind, VoxelState, locate};
    use tsense_geometry::{Point, VoxelGrid};

    fn fed() -> Mapper {
        let mut mapper = Mapper::new(&Config::default(), vec![LadarMount::default()], 77).unwrap();
        for i in 0..20 {
            let s = 1000.0 + f64::from(i) * 0.1;
            assert!(mapper.add_pose(&pose_at(s, [500_000.05, 5_000_000.05, 100.05])));
            assert!(mapper.add_joint(&joint_at(s, 0.0, 0)));
            let (header, returns) = scan_at(s + 0.05);
            assert!(mapper.add_scan(0, &header, &returns, Timestamp::from_seconds(s + 0.06)));
        }
        mapper
    }

    #[test]
    fn messages_become_voxels_and_a_snapshot_that_says_when_and_where() {
        let mut mapper = fed();
        let now = Timestamp::from_seconds(1002.0);
        assert!(mapper.take_snapshot(true, now).is_none(), "nothing was traced yet");
        let placed = std::iter::from_fn(|| mapper.trace_next(now).map(|_| ())).count();
        assert_eq!((placed, mapper.beams()), (19, 57), "the last scan waits for its pose");
        let context = mapper.take_snapshot(false, now).unwrap();
        assert_eq!((context.epoch, context.published, context.stamp), (77, now, mapper.newest().unwrap()));
        assert!((context.pose.easting_m - 500_000.05).abs() < 1e-6);
        assert_eq!(context.pose.stamp_ns, context.stamp.ns);
        // 3 m ahead is 3 m north.
        let ahead = VoxelGrid::new(0.15).unwrap().index_of(Point::new(500_000.05, 5_000_003.05, 100.05)).unwrap();
        let (key, brick, voxel) = locate(ahead);
        assert!(mapper.snapshot().changes.iter().any(|entry| entry.key == key));
        assert_eq!(mapper.map().block(key).unwrap()[brick].state(voxel), VoxelState::Occupied);
        let mut headers = Vec::new();
        let samples = mapper.snapshot().publish(&context, mapper.map(), |header, _, _| {
            headers.push(*header);
            Ok::<(), ()>(())
        });
        let commit = headers.last().unwrap();
        assert_eq!((samples, headers.len(), commit.kind()), (Ok(2), 2, MapSampleKind::Commit));
        let blocks = mapper.snapshot().table.len();
        assert_eq!((commit.version as usize, commit.center_voxel), (blocks, mapper.map().center()));
    }

    #[test]
    fn confidence_fades_faster_when_driving() {
        let faded = |speed_m_s: f32| {
            let mut mapper = fed();
            while mapper.trace_next(Timestamp::from_seconds(1002.0)).is_some() {}
            for i in 0..100 {
                let pose = pose_at(1002.0 + f64::from(i) * 0.1, [500_000.05, 5_000_000.05, 100.05]);
                mapper.add_pose(&Pose { velocity_m_s: [0.0, speed_m_s, 0.0], ..pose });
            }
            for _ in 0..FADE_SHARE {
                mapper.take_snapshot(false, Timestamp::from_seconds(1012.0));
            }
            let ahead = mapper.map().grid().index_of(Point::new(500_000.05, 5_000_003.05, 100.05)).unwrap();
            mapper.map().voxel(ahead).confidence
        };
        let (still, driving, unknown) = (faded(0.0), faded(1.5), faded(f32::NAN));
        assert!(still > driving && driving >= 1, "{still} {driving}");
        assert_eq!(still, unknown);
    }
}
