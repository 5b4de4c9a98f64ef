//! Our messages in, ROS messages out. No clock, no socket: time is an argument.
//!
//! In: headers and items as they lie in shared memory. Out: messages for a topic of [`Translator::topics`]. The first
//! pose decides where the frame `map` lies, unless the configuration does, and which UTM zone counts: data of another one
//! is dropped. Nothing here panics on what a message says; what does not fit is dropped and counted by cause.

use super::cloud::{self, ClassGrid};
use super::config::{Config, TopicConfig};
use super::messages::{
    AnyMessage, Detection3DArray, DiagnosticArray, GridMap, LaserScan, OccupancyGrid, Odometry, PointCloud2,
    RosMessage, TfMessage,
};
use super::motion::{Motion, Mounts};
use super::scan::{ScanLimits, laser_scan};
use super::sink::TopicSpec;
use super::{diagnostics, grid, objects};
use std::collections::BTreeMap;
use tsense_contract::{
    BLOCKS_MAX, Brick, GridCell, GridHeader, Joint, MapHeader, Object, ObjectsHeader, Pose, ProcessStatus,
    ProcessesHeader, Return, ScanHeader, SnapshotAssembler, Taken,
};
use tsense_geometry::Timestamp;

/// What sends messages of one kind; two of them share the topic `/tf`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Stream {
    Traversability,
    GridMap,
    Scan(usize),
    Voxels,
    Objects,
    Tf,
    JointTf,
    StaticTf,
    Odometry,
    Diagnostics,
}

/// Where a stream goes, and when it was fed last.
#[derive(Debug)]
struct Lane {
    topic: usize,
    period_s: f64,
    wanted: bool,
    sent: Option<Timestamp>,
}

/// The origin of the map, and the zone it lies in.
#[derive(Debug)]
struct Place {
    zone: (u8, u8),
    origin_m: [f64; 3],
    motion: Motion,
}

/// A message and the index of its topic.
pub type Message = (usize, AnyMessage);

/// Translates. `B` and `G` are what the items of a map and a grid sample lie in.
#[derive(Debug)]
pub struct Translator<B = Vec<Brick>, G = Vec<GridCell>> {
    config: Config,
    mounts: Mounts,
    topics: Vec<TopicSpec>,
    lanes: BTreeMap<Stream, Lane>,
    place: Option<Place>,
    assembler: SnapshotAssembler<B>,
    grid: Option<(GridHeader, G)>,
    odometry_before: Option<Pose>,
    drops: BTreeMap<&'static str, u64>,
    out: Vec<Message>,
}

impl<B: AsRef<[Brick]>, G: AsRef<[GridCell]>> Translator<B, G> {
    /// Before the first pose.
    pub fn new(config: &Config, mounts: Mounts) -> Self {
        let mut this = Self {
            config: config.clone(),
            topics: Vec::new(),
            lanes: BTreeMap::new(),
            place: None,
            assembler: SnapshotAssembler::new(BLOCKS_MAX),
            grid: None,
            odometry_before: None,
            drops: BTreeMap::new(),
            out: Vec::new(),
            mounts,
        };
        let t = config.topics.clone();
        this.offer::<OccupancyGrid>(&[Stream::Traversability], &t.traversability, "");
        this.offer::<GridMap>(&[Stream::GridMap], &t.grid_map, "");
        for i in 0..this.mounts.ladars.len() {
            let suffix = format!("/{}", this.mounts.ladars[i].frame());
            this.offer::<LaserScan>(&[Stream::Scan(i)], &t.scan, &suffix);
        }
        this.offer::<PointCloud2>(&[Stream::Voxels], &t.voxels, "");
        this.offer::<Detection3DArray>(&[Stream::Objects], &t.objects, "");
        this.offer::<TfMessage>(&[Stream::Tf, Stream::JointTf], &t.tf, "");
        this.offer::<TfMessage>(&[Stream::StaticTf], &t.tf_static, "");
        this.offer::<Odometry>(&[Stream::Odometry], &t.odometry, "");
        this.offer::<DiagnosticArray>(&[Stream::Diagnostics], &t.diagnostics, "");
        this
    }

    fn offer<M: RosMessage>(&mut self, streams: &[Stream], topic: &TopicConfig, suffix: &str) {
        if topic.hz <= 0.0 {
            return;
        }
        for stream in streams {
            let lane = Lane { topic: self.topics.len(), period_s: 1.0 / topic.hz, wanted: true, sent: None };
            self.lanes.insert(*stream, lane);
        }
        self.topics.push(TopicSpec::of::<M>(&self.config, topic, suffix));
    }

    /// The topics, in the order of their indices.
    pub fn topics(&self) -> &[TopicSpec] {
        &self.topics
    }

    /// Says which topics somebody wants now; for the others no message is made, and none is counted. At first: all.
    pub fn want(&mut self, wanted: impl Fn(usize) -> bool) {
        for lane in self.lanes.values_mut() {
            lane.wanted = wanted(lane.topic);
        }
    }

    /// Messages since the last call.
    pub fn take_messages(&mut self) -> Vec<Message> {
        std::mem::take(&mut self.out)
    }

    /// Drops by cause since the start.
    pub fn drops(&self) -> &BTreeMap<&'static str, u64> {
        &self.drops
    }

    /// Counts a drop.
    pub fn dropped(&mut self, cause: &'static str, n: u64) {
        if n > 0 {
            *self.drops.entry(cause).or_default() += n;
        }
    }

    /// Where the origin of the map lies in UTM, once that is known.
    pub fn origin_m(&self) -> Option<[f64; 3]> {
        self.place.as_ref().map(|place| place.origin_m)
    }

    /// A sample of topic `pose`.
    pub fn pose(&mut self, pose: &Pose, now: Timestamp) {
        let position_m = [pose.easting_m, pose.northing_m, pose.altitude_m];
        let attitude = [pose.roll_rad, pose.pitch_rad, pose.yaw_rad];
        if pose.zone == 0 || position_m.iter().chain(&attitude).any(|c| !c.is_finite()) {
            return self.dropped("pose without a position", 1);
        }
        let given = self.config.map_origin_m;
        let frames = &self.config.frames;
        let place = self.place.get_or_insert_with(|| {
            let origin_m = if given == [0.0; 3] { position_m.map(f64::floor) } else { given };
            Place { zone: (pose.zone, pose.south), origin_m, motion: Motion::new(frames.clone(), origin_m) }
        });
        if place.zone != (pose.zone, pose.south) {
            return self.dropped("another zone", 1);
        }
        if place.motion.take(pose) {
            self.publish(Stream::StaticTf, now, |this, place| Some(place.motion.static_transforms(&this.mounts, now)));
            self.publish(Stream::Tf, now, |_, place| place.motion.transforms());
            self.publish_odometry(now);
        }
    }

    fn publish_odometry(&mut self, now: Timestamp) {
        if self.publish(Stream::Odometry, now, |this, place| place.motion.odometry(this.odometry_before.as_ref())) {
            self.odometry_before = self.place.as_ref().and_then(|place| place.motion.newest());
        }
    }

    /// A sample of topic `joint`.
    pub fn joint(&mut self, joint: &Joint, now: Timestamp) {
        if self.mounts.pan_tilt.is_some() && joint.pan_rad.is_finite() && joint.tilt_rad.is_finite() {
            self.publish(Stream::JointTf, now, |_, place| Some(place.motion.joint_transforms(joint)));
        }
    }

    /// A sample of topic `scan` of the ladar with this index.
    pub fn scan(&mut self, ladar: usize, header: &ScanHeader, returns: &[Return], now: Timestamp) {
        let Some(mount) = self.mounts.ladars.get(ladar) else { return };
        let limits = ScanLimits { range_min_m: mount.range_min_m, range_max_m: mount.range_max_m };
        let frame = mount.frame();
        self.publish_anywhere(Stream::Scan(ladar), now, |_| laser_scan(header, returns, limits, &frame));
    }

    /// A sample of topic `grid`; it is kept for the classes of voxels.
    pub fn grid(&mut self, header: &GridHeader, sample: G, now: Timestamp) {
        if !self.zone_fits((header.zone, header.south)) {
            return;
        }
        if !grid::fits(header, sample.as_ref()) {
            return self.dropped("grid of another shape", 1);
        }
        self.publish(Stream::Traversability, now, |this, place| {
            Some(grid::occupancy_grid(header, sample.as_ref(), place.origin_m, &this.config.frames.map))
        });
        self.publish(Stream::GridMap, now, |this, place| {
            Some(grid::grid_map(header, sample.as_ref(), place.origin_m, &this.config.frames.map))
        });
        self.grid = Some((*header, sample));
    }

    /// A sample of topic `map`.
    pub fn map(&mut self, header: &MapHeader, sample: B, now: Timestamp) {
        if !self.zone_fits((header.pose.zone, header.pose.south)) {
            return;
        }
        match self.assembler.take(header, sample) {
            Taken::Part => {}
            Taken::Complete => self.publish_voxels(now),
            Taken::Incomplete { .. } => self.dropped("incomplete snapshot", 1),
            Taken::Refused(why) => self.dropped(why.as_str(), 1),
        }
    }

    fn publish_voxels(&mut self, now: Timestamp) {
        let mut thinned = false;
        self.publish(Stream::Voxels, now, |this, place| {
            let snapshot = this.assembler.complete()?;
            let classes = this.grid.as_ref().map(|(header, cells)| ClassGrid { header, cells: cells.as_ref() });
            let points_max = this.config.cloud_points_max;
            let (points, total) = cloud::occupied(&snapshot, classes, place.origin_m, points_max);
            thinned = points.len() < total;
            Some(cloud::point_cloud(&snapshot.header, &points, &this.config.frames.map))
        });
        self.dropped("thinned to cloud_points_max", u64::from(thinned));
    }

    /// True where the mapper should be asked for every block anew. Before the first pose nothing is kept, so it is not.
    pub fn keyframe_needed(&self) -> bool {
        self.place.is_some() && self.assembler.keyframe_needed()
    }

    /// A sample of topic `objects`.
    pub fn objects(&mut self, header: &ObjectsHeader, list: &[Object], now: Timestamp) {
        if self.zone_fits((header.zone, header.south)) {
            self.publish(Stream::Objects, now, |this, place| {
                Some(objects::detections(header, list, place.origin_m, &this.config.frames.map))
            });
        }
    }

    /// A sample of topic `processes`.
    pub fn processes(&mut self, header: &ProcessesHeader, list: &[ProcessStatus], now: Timestamp) {
        self.publish_anywhere(Stream::Diagnostics, now, |_| diagnostics::diagnostics(header, list));
    }

    /// Publishes what needs a place, where there is one and the stream is due. True where a message went out.
    fn publish<M: RosMessage>(
        &mut self,
        stream: Stream,
        now: Timestamp,
        message: impl FnOnce(&Self, &Place) -> Option<M>,
    ) -> bool {
        let Some(topic) = self.due(stream, now) else { return false };
        let Some(message) = self.place.as_ref().and_then(|place| message(self, place)) else { return false };
        self.fill(stream, topic, now, message.into());
        true
    }

    /// Publishes what means the same everywhere.
    fn publish_anywhere<M: RosMessage>(&mut self, stream: Stream, now: Timestamp, message: impl FnOnce(&Self) -> M) {
        if let Some(topic) = self.due(stream, now) {
            let message = message(self);
            self.fill(stream, topic, now, message.into());
        }
    }

    fn fill(&mut self, stream: Stream, topic: usize, now: Timestamp, message: AnyMessage) {
        if let Some(lane) = self.lanes.get_mut(&stream) {
            lane.sent = Some(now);
        }
        self.out.push((topic, message));
    }

    /// The topic of a stream that is offered and wanted, and was not fed within its period.
    fn due(&self, stream: Stream, now: Timestamp) -> Option<usize> {
        let lane = self.lanes.get(&stream).filter(|lane| lane.wanted)?;
        // A tenth of slack: data at just the configured rate must not be halved by jitter.
        let due = lane.sent.is_none_or(|sent| now.seconds_since(sent) >= 0.9 * lane.period_s);
        due.then_some(lane.topic)
    }

    /// Data of another zone has coordinates that mean another place: it is not published.
    fn zone_fits(&mut self, zone: (u8, u8)) -> bool {
        let fits = self.place.as_ref().is_some_and(|place| place.zone == zone);
        let cause = if self.place.is_none() { "before the first pose" } else { "another zone" };
        self.dropped(cause, u64::from(!fits));
        fits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::motion::Mount;
    use bytemuck::Zeroable;
    use tsense_contract::{BRICKS_PER_BLOCK, CommitEntry, MapSampleKind, pack_commit};
    use tsense_geometry::Mounting;

    fn translator(config: &Config) -> Translator {
        let ladar =
            Mount { name: "ladar".into(), range_min_m: 0.5, range_max_m: 50.0, tilt_from_ladar: Mounting::default() };
        Translator::new(config, Mounts { pan_tilt: Some(Mounting::default()), ladars: vec![ladar] })
    }

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(1000.0 + seconds)
    }

    fn pose(seconds: f64) -> Pose {
        let mut pose = Pose::zeroed();
        (pose.easting_m, pose.northing_m, pose.altitude_m) = (500_000.7, 4_000_000.2, 102.9);
        (pose.stamp_ns, pose.zone) = (at(seconds).ns, 17);
        pose
    }

    fn grid(zone: u8) -> (GridHeader, Vec<GridCell>) {
        let mut header = GridHeader::zeroed();
        (header.zone, header.cell_m, header.width, header.height) = (zone, 0.15, 2, 2);
        (header, vec![GridCell::zeroed(); 4])
    }

    fn names(translator: &mut Translator) -> Vec<String> {
        let messages = translator.take_messages();
        messages.iter().map(|(topic, _)| translator.topics()[*topic].name.clone()).collect()
    }

    #[test]
    fn every_topic_is_offered_once_and_a_rate_of_zero_offers_none() {
        let mut config = Config::default();
        let offered: Vec<_> = translator(&config).topics().iter().map(|t| t.name.clone()).collect();
        let expected = "/tsense/traversability /tsense/grid_map /tsense/scan/ladar /tsense/voxels /tsense/objects /tf \
                        /tf_static /tsense/odom /diagnostics";
        assert_eq!(offered, expected.split_whitespace().collect::<Vec<_>>());
        config.topics.voxels.hz = 0.0;
        assert!(translator(&config).topics().iter().all(|t| t.name != "/tsense/voxels"));
    }

    #[test]
    fn the_first_pose_sets_the_map_down_and_nothing_with_a_place_goes_before_it() {
        let mut t = translator(&Config::default());
        let (header, cells) = grid(17);
        t.grid(&header, cells.clone(), at(0.0));
        t.joint(&Joint::zeroed(), at(0.0));
        assert!(t.take_messages().is_empty());
        t.pose(&pose(0.1), at(0.1));
        assert_eq!(t.origin_m(), Some([500_000.0, 4_000_000.0, 102.0]));
        assert_eq!(names(&mut t), ["/tf_static", "/tf", "/tsense/odom"]);
        t.grid(&header, cells, at(0.2));
        t.joint(&Joint::zeroed(), at(0.2));
        assert_eq!(names(&mut t), ["/tsense/traversability", "/tsense/grid_map", "/tf"]);
        assert_eq!(t.drops()["before the first pose"], 1);
    }

    #[test]
    fn what_does_not_fit_is_counted_by_cause() {
        let mut t = translator(&Config { map_origin_m: [1.0, 2.0, 3.0], ..Config::default() });
        t.pose(&Pose { zone: 0, ..pose(0.0) }, at(0.0));
        t.pose(&Pose { yaw_rad: f64::NAN, ..pose(0.0) }, at(0.0));
        t.pose(&pose(0.1), at(0.1));
        assert_eq!(t.origin_m(), Some([1.0, 2.0, 3.0]));
        t.take_messages();
        t.pose(&Pose { zone: 18, ..pose(0.2) }, at(0.2));
        let (header, cells) = grid(18);
        t.grid(&header, cells, at(0.3));
        let (header, cells) = grid(17);
        t.grid(&GridHeader { width: 9, ..header }, cells, at(0.3));
        t.scan(7, &ScanHeader::zeroed(), &[], at(0.3));
        assert!(t.take_messages().is_empty());
        let drops: Vec<_> = t.drops().iter().map(|(cause, n)| (*cause, *n)).collect();
        assert_eq!(drops, [("another zone", 2), ("grid of another shape", 1), ("pose without a position", 2)]);
    }

    /// A map of one block with three voxels occupied.
    fn map(translator: &mut Translator, now: Timestamp) {
        let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
        bricks[0].occupancy[..3].fill(3);
        bricks[0].confidence[..3].fill(40);
        let mut header = MapHeader::zeroed();
        (header.voxel_size_m, header.snapshot, header.version, header.keyframe) = (0.15, 1, 1, 1);
        header.pose.zone = 17;
        translator.map(&header, bricks, now);
        let commit = MapHeader { kind: MapSampleKind::Commit.to_wire(), ..header };
        translator.map(&commit, pack_commit(&[CommitEntry { key: [0; 3], version: 1 }]), now);
    }

    #[test]
    fn what_nobody_wants_is_neither_made_nor_counted_and_a_thinned_cloud_counts_once() {
        let mut t = translator(&Config { cloud_points_max: 2, ..Config::default() });
        t.want(|_| false);
        t.pose(&pose(0.0), at(0.0));
        map(&mut t, at(0.1));
        t.scan(0, &ScanHeader::zeroed(), &[], at(0.1));
        assert!(t.take_messages().is_empty() && t.drops().is_empty(), "{:?}", t.drops());
        let voxels = t.topics().iter().position(|topic| topic.name == "/tsense/voxels").unwrap();
        t.want(|topic| topic == voxels);
        map(&mut t, at(0.2));
        t.scan(0, &ScanHeader::zeroed(), &[], at(0.2));
        assert_eq!(names(&mut t), ["/tsense/voxels"]);
        assert_eq!(t.drops().iter().collect::<Vec<_>>(), [(&"thinned to cloud_points_max", &1)]);
    }

    #[test]
    fn no_stream_is_fed_faster_than_configured() {
        let mut config = Config::default();
        config.topics.scan.hz = 10.0;
        let mut t = translator(&config);
        for i in 0..50 {
            t.scan(0, &ScanHeader::zeroed(), &[Return::zeroed(); 541], at(f64::from(i) * 0.02));
        }
        assert_eq!(t.take_messages().len(), 10);
    }
}
