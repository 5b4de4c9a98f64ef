//! What the mapper could not use, counted by cause.

/// Why a scan, a pose, a pan-tilt reading or another sensor's voxels were not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DropCause {
    /// No pose covered the scan before its deadline.
    NoPose,
    /// No pan-tilt reading covered the scan before its deadline.
    NoJoint,
    /// The scan lies in a gap between poses or readings.
    Gap,
    /// The scan's own figures make no sense.
    ScanInvalid,
    /// The scan is not newer than the last one of its ladar.
    ScanOutOfOrder,
    /// More scans waited than the queue holds.
    QueueFull,
    /// The pose is not finite, off the Earth, of another zone, invalid, frozen or not newer.
    PoseRefused,
    /// The reading is not finite, not newer, or its angles are not to be trusted.
    JointRefused,
    /// Voxels that are nowhere on Earth, or of a sensor that is not configured.
    VoxelsInvalid,
    /// Voxels whose edge is no size, or more than the map's allow.
    VoxelsSize,
    /// Voxels that came before the first pose: the map is nowhere yet.
    VoxelsNoPose,
    /// Voxels of another UTM zone than the map's.
    VoxelsZone,
    /// Voxels that came too late.
    VoxelsOld,
    /// Voxels with a stamp that is still to come.
    VoxelsAhead,
    /// Voxels with an earlier stamp than those before them.
    VoxelsOutOfOrder,
    /// Voxels that others overtook in the topic's queue.
    VoxelsOvertaken,
    /// More samples of voxels waited than the mapper's queue holds.
    VoxelsQueueFull,
    /// Voxels of which none lies in the working space.
    VoxelsOutside,
    /// Single voxels that are nowhere, or in no state.
    VoxelItems,
}

impl DropCause {
    /// All causes. A heartbeat carries the first eight that come about, and the rest as one.
    pub const ALL: [Self; 19] = [
        Self::NoPose,
        Self::NoJoint,
        Self::Gap,
        Self::ScanInvalid,
        Self::ScanOutOfOrder,
        Self::QueueFull,
        Self::PoseRefused,
        Self::JointRefused,
        Self::VoxelsInvalid,
        Self::VoxelsSize,
        Self::VoxelsNoPose,
        Self::VoxelsZone,
        Self::VoxelsOld,
        Self::VoxelsAhead,
        Self::VoxelsOutOfOrder,
        Self::VoxelsOvertaken,
        Self::VoxelsQueueFull,
        Self::VoxelsOutside,
        Self::VoxelItems,
    ];

    /// The cause for people and JSON.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::NoPose => "scan without pose",
            Self::NoJoint => "scan without pan-tilt",
            Self::Gap => "scan in a gap",
            Self::ScanInvalid => "scan invalid",
            Self::ScanOutOfOrder => "scan out of order",
            Self::QueueFull => "scan queue full",
            Self::PoseRefused => "pose refused",
            Self::JointRefused => "pan-tilt refused",
            Self::VoxelsInvalid => "voxels invalid",
            Self::VoxelsSize => "voxels of a wrong size",
            Self::VoxelsNoPose => "voxels before a pose",
            Self::VoxelsZone => "voxels of another zone",
            Self::VoxelsOld => "voxels too old",
            Self::VoxelsAhead => "voxels of the future",
            Self::VoxelsOutOfOrder => "voxels out of order",
            Self::VoxelsOvertaken => "voxels overtaken",
            Self::VoxelsQueueFull => "voxel queue full",
            Self::VoxelsOutside => "voxels outside the window",
            Self::VoxelItems => "single voxels invalid",
        }
    }
}

/// Counts by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drops([u64; DropCause::ALL.len()]);

impl Drops {
    /// One more.
    pub fn count(&mut self, cause: DropCause) {
        self.add(cause, 1);
    }
    /// So many more.
    pub fn add(&mut self, cause: DropCause, count: u64) {
        self.0[cause as usize] += count;
    }
    /// How many for a cause.
    pub fn of(&self, cause: DropCause) -> u64 {
        self.0[cause as usize]
    }
    /// How many in all.
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }
    /// What was counted since `earlier`, causes without news left out.
    pub fn since(&self, earlier: &Self) -> impl Iterator<Item = (DropCause, u64)> {
        let (now, then) = (*self, *earlier);
        DropCause::ALL.into_iter().map(move |c| (c, now.of(c) - then.of(c))).filter(|(_, n)| *n > 0)
    }
}
