//! What the mapper could not use, counted by cause.

/// Why a scan, a pose or a pan-tilt reading was not used.
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
}

impl DropCause {
    /// All causes; no more than a heartbeat carries.
    pub const ALL: [Self; 8] = [
        Self::NoPose,
        Self::NoJoint,
        Self::Gap,
        Self::ScanInvalid,
        Self::ScanOutOfOrder,
        Self::QueueFull,
        Self::PoseRefused,
        Self::JointRefused,
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
        }
    }
}

/// Counts by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drops([u64; DropCause::ALL.len()]);

impl Drops {
    /// One more.
    pub fn count(&mut self, cause: DropCause) {
        self.0[cause as usize] += 1;
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
