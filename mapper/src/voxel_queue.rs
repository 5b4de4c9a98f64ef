//! Samples of other sensors' voxels wait here, in a bounded queue, until the scans have come as far as they.
//!
//! In: messages as they come, and the time of now. Out: samples in the order of their stamps, whatever the order of their
//! arrival, each just before the first scan that begins later; or a count of why not. It touches no voxel.

use crate::beams::Weight;
use crate::drops::{DropCause, Drops};
use crate::voxel_sensor::VoxelSensor;
use tsense_contract::{SensedVoxel, VoxelsHeader};
use tsense_geometry::{COORDINATE_MAX_M, Timestamp, VoxelGrid};

/// Samples that may wait, of all sensors: 34 MB at most. A prior of 20 samples a second waits for half a second.
const WAITING_MAX: usize = 32;

/// How far the stamp of a sample may lie ahead, seconds: what two readings of one clock differ by on a busy machine.
const AHEAD_MAX_S: f64 = 0.05;

/// A larger gap of numbers is a sender that started anew.
const OVERTAKEN_MAX: u64 = 1 << 20;

/// What the map says of itself when a sample comes.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Zone and hemisphere of the first pose; nothing before it.
    pub zone: Option<(u8, u8)>,
    /// Largest edge of a sensor's voxel, metres.
    pub edge_max_m: f64,
}

/// A sample on its way into the map.
#[derive(Debug)]
pub struct WaitingVoxels {
    /// Index of the sensor in the configuration.
    pub sensor: usize,
    /// What its word counts.
    pub weight: Weight,
    /// As it came.
    pub header: VoxelsHeader,
    /// As they came.
    pub items: Vec<SensedVoxel>,
    since: Timestamp,
}

impl WaitingVoxels {
    /// Instant of the measurement.
    pub fn stamp(&self) -> Timestamp {
        Timestamp::from_ns(self.header.stamp_ns)
    }
}

/// What was heard of a sensor last.
#[derive(Clone, Copy, Debug, Default)]
struct Last {
    /// Of the newest sample that was taken.
    stamp: Option<Timestamp>,
    /// Of the last one that came.
    sequence: Option<u64>,
}

/// The queue.
pub struct VoxelQueue {
    sensors: Vec<VoxelSensor>,
    last: Vec<Last>,
    /// By stamp, then by sensor, then by arrival.
    waiting: Vec<WaitingVoxels>,
    /// Memory of samples that wait no longer.
    spare: Vec<Vec<SensedVoxel>>,
    deadline_s: f64,
}

impl VoxelQueue {
    /// Nothing waits. A sample waits for scans no longer than `deadline_s`.
    pub fn new(sensors: &[VoxelSensor], deadline_s: f64) -> Self {
        let last = vec![Last::default(); sensors.len()];
        Self { sensors: sensors.to_vec(), last, waiting: Vec::new(), spare: Vec::new(), deadline_s }
    }

    /// The sensors.
    pub fn sensors(&self) -> &[VoxelSensor] {
        &self.sensors
    }

    /// Takes in a sample of a sensor; false where it was refused.
    pub fn add(
        &mut self,
        sensor: usize,
        (header, items): (&VoxelsHeader, &[SensedVoxel]),
        (place, now): (&Place, Timestamp),
        drops: &mut Drops,
    ) -> bool {
        let Some((of, last)) = self.sensors.get(sensor).zip(self.last.get_mut(sensor)) else {
            drops.count(DropCause::VoxelsInvalid);
            return false;
        };
        let before = last.sequence.replace(header.sequence);
        drops.add(DropCause::VoxelsOvertaken, before.map_or(0, |before| overtaken(before, header.sequence)));
        if let Some(cause) = refusal(header, of, last.stamp, (place, now)) {
            drops.count(cause);
            return false;
        }
        let stamp = Timestamp::from_ns(header.stamp_ns);
        last.stamp = Some(stamp);
        let weight = Weight::new(of.weight);
        if self.waiting.len() >= WAITING_MAX {
            let oldest = self.waiting.remove(0);
            self.keep_memory(oldest.items);
            drops.count(DropCause::VoxelsQueueFull);
        }
        let mut memory = self.spare.pop().unwrap_or_default();
        memory.extend_from_slice(items);
        let sample = WaitingVoxels { sensor, weight, header: *header, items: memory, since: now };
        let at = self.waiting.partition_point(|other| (other.stamp(), other.sensor) <= (stamp, sensor));
        self.waiting.insert(at, sample);
        true
    }

    /// The next sample that belongs before a scan which begins at `stamp`. Give it back with [`VoxelQueue::keep_memory`].
    pub fn next_before(&mut self, stamp: Timestamp) -> Option<WaitingVoxels> {
        let is_due = self.waiting.first().is_some_and(|sample| sample.stamp() < stamp);
        is_due.then(|| self.waiting.remove(0))
    }

    /// The next sample, if one has waited for scans too long.
    pub fn next_overdue(&mut self, now: Timestamp) -> Option<WaitingVoxels> {
        let is_overdue = |sample: &WaitingVoxels| now.seconds_since(sample.since) > self.deadline_s;
        // Those before it in time go first, whenever they came.
        self.waiting.iter().any(is_overdue).then(|| self.waiting.remove(0))
    }

    /// The memory of a sample's items, for one that is to come.
    pub fn keep_memory(&mut self, mut items: Vec<SensedVoxel>) {
        items.clear();
        self.spare.push(items);
    }
}

/// Samples between two numbers that never came.
fn overtaken(last: u64, now: u64) -> u64 {
    let missing = now.wrapping_sub(last).wrapping_sub(1);
    if missing < OVERTAKEN_MAX { missing } else { 0 }
}

/// Why a sample is not taken. Several may have one stamp; none may have an earlier one than that before it.
fn refusal(
    header: &VoxelsHeader,
    of: &VoxelSensor,
    newest: Option<Timestamp>,
    (place, now): (&Place, Timestamp),
) -> Option<DropCause> {
    let (stamp, size_m) = (Timestamp::from_ns(header.stamp_ns), header.voxel_size_m);
    let age_s = now.seconds_since(stamp);
    match place.zone {
        _ if !header.origin_m.iter().all(|c| c.abs() <= COORDINATE_MAX_M) => Some(DropCause::VoxelsInvalid),
        _ if VoxelGrid::new(size_m).is_none() || size_m > place.edge_max_m => Some(DropCause::VoxelsSize),
        None => Some(DropCause::VoxelsNoPose),
        Some(zone) if zone != (header.zone, header.south) => Some(DropCause::VoxelsZone),
        _ if age_s > of.age_max_s => Some(DropCause::VoxelsOld),
        _ if age_s < -AHEAD_MAX_S => Some(DropCause::VoxelsAhead),
        _ if newest.is_some_and(|newest| stamp < newest) => Some(DropCause::VoxelsOutOfOrder),
        _ => None,
    }
}
