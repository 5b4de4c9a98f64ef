//! A map file's voxels, told to a running graph as what was known before: a prior on topic `voxels/NAME`.
//!
//! In: blocks of a file, and the vehicle's poses. Out: samples of the voxels around the vehicle, again and again, for the
//! mapper's window rolls with the vehicle. The mapper fills with them what it does not know (`VoxelsKind::Prior`).

use super::points::{What, voxels_of};
use super::system_of;
use crate::commands::{Failure, tell};
use bytemuck::Zeroable;
use rustix::process::{Pid, test_kill_process};
use serde::Serialize;
use std::collections::VecDeque;
use tsense_contract::{BLOCK_VOXELS, Pose, Poses, SensedVoxel, Topic, Voxels, VoxelsHeader, VoxelsKind, first_voxel};
use tsense_geometry::Timestamp;
use tsense_mapper::tsmap::{MapFileHeader, StoredBlock};
use tsense_ports::{Clock, Domain, Inbox, Outbox, Process, Wake, machine_seconds, signals};

/// Time between two samples, graph seconds: the topic holds eight, and the mapper takes them ten times a second.
const SAMPLE_S: f64 = 0.05;
/// Time between two looks whether the graph still runs, seconds of the machine.
const LOOK_S: f64 = 1.0;

/// What is told, and how.
pub struct Publication {
    /// Of the file.
    pub header: MapFileHeader,
    /// Of the file.
    pub blocks: Vec<StoredBlock>,
    /// Which voxels.
    pub what: What,
    /// Time from telling a place to telling it again, graph seconds.
    pub every_s: f64,
    /// How far around the vehicle, metres east and north.
    pub reach_m: f64,
    /// For how long, graph seconds; else until a signal comes.
    pub for_s: Option<f64>,
}

/// How that went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Told {
    /// Samples sent.
    pub samples: u64,
    /// Voxels in them.
    pub voxels: u64,
    /// Times that all around the vehicle was told.
    pub rounds: u64,
    /// Ended by Ctrl-C.
    #[serde(skip)]
    pub interrupted: bool,
}

impl Publication {
    /// Tells it to a graph until the time is up, a signal comes, or the graph ends, which is a failure.
    pub fn run(&self, domain: &Domain, name: &str) -> Result<Told, Failure> {
        if self.header.zone == 0 {
            let system = system_of(&self.header);
            return Err(Failure::new(2, format!("the map is in no UTM zone on WGS 84 ({system}), and a vehicle's is")));
        }
        signals::install()?;
        let mut process = Process::observe(domain, "map")?;
        let (voxels, poses) = (process.outbox(Some(name))?, process.quiet_inbox(None)?);
        let (clock, launcher) = (process.clock(), domain.facts()?.launcher);
        let ends = self.for_s.map(|s| clock.now().plus_seconds(s));
        let mut desk =
            Desk { of: self, voxels, poses, clock, pose: None, waiting: VecDeque::new(), told: Told::default() };
        let (mut round_due, mut look_s) = (clock.now(), machine_seconds() + LOOK_S);
        while process.wait(SAMPLE_S) != Wake::Stop && ends.is_none_or(|ends| clock.now() < ends) {
            desk.take_poses()?;
            if desk.waiting.is_empty() && clock.now() >= round_due && desk.start_round() {
                round_due = clock.now().plus_seconds(self.every_s);
            }
            desk.send()?;
            if machine_seconds() >= look_s {
                look_s = machine_seconds() + LOOK_S;
                if !still_runs(domain, launcher) {
                    return Err(Failure::new(1, format!("graph {} ended", domain.name())));
                }
            }
        }
        let interrupted = signals::requested() == Some(signals::StopSignal::Interrupt);
        Ok(Told { interrupted, ..desk.told })
    }

    /// Blocks that come within reach of a place, the nearest first.
    fn near(&self, at_m: [f64; 2]) -> Vec<&StoredBlock> {
        let off_m = |block: &StoredBlock| {
            let first = first_voxel(block.key);
            (0..2).fold(0.0f64, |off, axis| {
                let low = f64::from(first[axis]) * self.header.voxel_size_m;
                let high = low + BLOCK_VOXELS[axis] as f64 * self.header.voxel_size_m;
                off.max(low - at_m[axis]).max(at_m[axis] - high)
            })
        };
        let mut near: Vec<&StoredBlock> = self.blocks.iter().filter(|block| off_m(block) <= self.reach_m).collect();
        near.sort_by(|a, b| off_m(a).total_cmp(&off_m(b)));
        near
    }

    /// A block's voxels, relative to its first corner, as the items of samples.
    fn items(&self, block: &StoredBlock) -> impl Iterator<Item = SensedVoxel> {
        let (first, size_m, what) = (first_voxel(block.key), self.header.voxel_size_m, self.what);
        voxels_of(block).filter(move |(_, state, ..)| what.wants(*state)).map(move |(voxel, state, ..)| {
            let xyz_m = std::array::from_fn(|axis| (f64::from(voxel[axis] - first[axis]) + 0.5) * size_m);
            SensedVoxel::new(xyz_m.map(|c| c as f32), state)
        })
    }

    /// The header of a sample of a block.
    fn sample(&self, block: &StoredBlock, now: Timestamp, sequence: u64) -> VoxelsHeader {
        VoxelsHeader {
            stamp_ns: now.ns,
            sequence,
            origin_m: first_voxel(block.key).map(|i| f64::from(i) * self.header.voxel_size_m),
            voxel_size_m: self.header.voxel_size_m,
            zone: self.header.zone,
            south: self.header.south.into(),
            kind: VoxelsKind::Prior.to_wire(),
            ..VoxelsHeader::zeroed()
        }
    }
}

/// Whether the launcher that we began with lives; one that is only slow to answer does.
fn still_runs(domain: &Domain, launcher: u32) -> bool {
    let pid = i32::try_from(launcher).ok().and_then(Pid::from_raw);
    let lives = pid.is_some_and(|pid| test_kill_process(pid).is_ok());
    lives && domain.facts().is_ok_and(|facts| facts.launcher == launcher)
}

/// The ports, and what of a round is still to be told.
struct Desk<'p> {
    of: &'p Publication,
    voxels: Outbox<Voxels>,
    poses: Inbox<Poses>,
    clock: Clock,
    pose: Option<Pose>,
    /// Blocks, and from which of their voxels on.
    waiting: VecDeque<(&'p StoredBlock, usize)>,
    told: Told,
}

impl Desk<'_> {
    /// The zone of a graph's poses is pinned: a map of another one will never be meant.
    fn take_poses(&mut self) -> Result<(), Failure> {
        let (newest, _) = self.poses.take_newest()?;
        let Some(pose) = newest.map(|sample| *sample.header()).filter(|pose| pose.zone != 0) else { return Ok(()) };
        let header = &self.of.header;
        if (pose.zone, pose.south == 1) != (header.zone, header.south) {
            let there = system_of(&MapFileHeader::in_zone(0.1, header.stamp, pose.zone, pose.south == 1));
            return Err(Failure::new(2, format!("the map lies in {}, the vehicle in {there}", system_of(header))));
        }
        self.pose = Some(pose);
        Ok(())
    }

    /// False before the first pose.
    fn start_round(&mut self) -> bool {
        let Some(pose) = self.pose else { return false };
        let near = self.of.near([pose.easting_m, pose.northing_m]);
        if near.is_empty() && self.told.rounds == 0 {
            tell("tsense: nothing of the map lies within reach of the vehicle yet");
        }
        self.waiting.extend(near.into_iter().map(|block| (block, 0)));
        self.told.rounds += 1;
        true
    }

    /// Sends as much of the first block as a sample holds.
    fn send(&mut self) -> Result<(), Failure> {
        let Some((block, from)) = self.waiting.pop_front() else { return Ok(()) };
        let items: Vec<SensedVoxel> = self.of.items(block).skip(from).take(Voxels::ITEMS_MAX).collect();
        if items.len() == Voxels::ITEMS_MAX {
            self.waiting.push_front((block, from + items.len()));
        }
        self.voxels.send(&self.of.sample(block, self.clock.now(), self.told.samples), &items)?;
        self.told.samples += 1;
        self.told.voxels += items.len() as u64;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_contract::{BRICKS_PER_BLOCK, Brick, VoxelState};

    /// Blocks of 50 m, each with one occupied and one free voxel in its corner.
    fn publication(what: What) -> Publication {
        let blocks = [[0, 0, 0], [3, 0, 0], [-1, 0, 0], [0, 9, 0]].map(|key| {
            let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
            bricks[0].occupancy[..2].copy_from_slice(&[8, -8]);
            bricks[0].confidence[..2].copy_from_slice(&[1, 1]);
            StoredBlock::of(key, &bricks, &[])
        });
        let header = MapFileHeader::in_zone(0.5, Timestamp::from_ns(0), 32, false);
        Publication { header, blocks: blocks.into(), what, every_s: 1.0, reach_m: 60.0, for_s: None }
    }

    #[test]
    fn what_is_near_is_told_the_nearest_first() {
        let all = publication(What::All);
        let keys = |at_m| all.near(at_m).iter().map(|block| block.key[0]).collect::<Vec<_>>();
        assert_eq!(keys([10.0, 10.0]), [0, -1]);
        assert_eq!(keys([110.0, 10.0]), [3, 0]);
        assert_eq!(keys([1e6, 0.0]), [0; 0]);
    }

    #[test]
    fn items_lie_at_the_middles_of_voxels_from_the_corner_of_their_block() {
        let of = |what| {
            let publication = publication(what);
            let block = &publication.blocks[2];
            let header = publication.sample(block, Timestamp::from_ns(7), 3);
            assert_eq!((header.origin_m, header.kind(), header.zone), ([-50.0, 0.0, 0.0], VoxelsKind::Prior, 32));
            publication.items(block).collect::<Vec<_>>()
        };
        let [occupied, free] = [(0.25, VoxelState::Occupied), (0.75, VoxelState::Free)]
            .map(|(x, state)| SensedVoxel::new([x, 0.25, 0.25], state));
        assert_eq!((of(What::All), of(What::Occupied)), (vec![occupied, free], vec![occupied]));
    }
}
