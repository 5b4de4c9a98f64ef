//! Scans wait here, in a bounded queue, until poses and pan-tilt readings cover them; then they are placed.
//!
//! In: messages as they come, and the time of now. Out: placed scans in order of arrival, or a count of why not.

use crate::beams::{Fan, PlacedScan, beam_stamp, place_scan};
use crate::config::PlacingConfig;
use crate::drops::{DropCause, Drops};
use crate::ladar_mount::{Extrinsics, LadarMount};
use crate::motion::Motion;
use std::collections::VecDeque;
use tsense_contract::{Joint, Pose, Return, Scan, ScanHeader, Topic};
use tsense_geometry::{NoValue, Timestamp};

/// Scans that may wait: four ladars at 50 Hz for a third of a second; beyond that the oldest is the least useful.
const WAITING_MAX: usize = 64;

/// Slowest mirror that is believed, seconds between beams: a scan of 1081 beams within 0.2 s.
const BEAM_INTERVAL_MAX_NS: f64 = 2.0e5;

struct WaitingScan {
    ladar: usize,
    header: ScanHeader,
    returns: Vec<Return>,
    since: Timestamp,
}

/// What can be done with a waiting scan now.
enum Readiness {
    Ready,
    Wait,
    Drop(DropCause),
}

/// The queue, the motion histories and the mounts.
pub struct Placer {
    mounts: Vec<LadarMount>,
    extrinsics: Vec<Extrinsics>,
    fans: Vec<Fan>,
    motion: Motion,
    waiting: VecDeque<WaitingScan>,
    /// Memory of scans that wait no longer; with those that do, no more than may wait.
    spare: Vec<Vec<Return>>,
    newest_scan: Vec<Option<Timestamp>>,
    drops: Drops,
    deadline_s: f64,
}

impl Placer {
    /// Nothing waits. `mounts[i]` is the ladar that messages call `i`.
    pub fn new(config: &PlacingConfig, mounts: Vec<LadarMount>) -> Self {
        Self {
            newest_scan: vec![None; mounts.len()],
            extrinsics: mounts.iter().map(LadarMount::extrinsics).collect(),
            fans: vec![Fan::default(); mounts.len()],
            mounts,
            motion: Motion::new(config),
            waiting: VecDeque::with_capacity(WAITING_MAX),
            spare: Vec::with_capacity(WAITING_MAX),
            drops: Drops::default(),
            deadline_s: config.deadline_s,
        }
    }

    /// Takes in a pose; false where it was refused.
    pub fn add_pose(&mut self, pose: &Pose) -> bool {
        self.motion.add_pose(pose, &mut self.drops)
    }

    /// Takes in a pan-tilt reading; false where it was refused.
    pub fn add_joint(&mut self, joint: &Joint) -> bool {
        self.motion.add_joint(joint, &mut self.drops)
    }

    /// Takes in a scan of ladar number `ladar`; false where it was refused.
    pub fn add_scan(&mut self, ladar: usize, header: &ScanHeader, returns: &[Return], now: Timestamp) -> bool {
        if !scan_is_good(header, returns) || ladar >= self.mounts.len() {
            self.drops.count(DropCause::ScanInvalid);
            return false;
        }
        let stamp = beam_stamp(header, 0);
        if self.newest_scan[ladar].is_some_and(|newest| stamp <= newest) {
            self.drops.count(DropCause::ScanOutOfOrder);
            return false;
        }
        self.newest_scan[ladar] = Some(stamp);
        if self.waiting.len() >= WAITING_MAX {
            self.forget(0);
            self.drops.count(DropCause::QueueFull);
        }
        let mut memory = self.spare.pop().unwrap_or_default();
        memory.extend_from_slice(returns);
        self.waiting.push_back(WaitingScan { ladar, header: *header, returns: memory, since: now });
        true
    }

    /// Places the next scan that poses and readings cover, in the memory of an earlier one. Scans past their deadline are
    /// dropped on the way; call until it says false, that there is none.
    pub fn next_placed(&mut self, now: Timestamp, placed: &mut PlacedScan) -> bool {
        let mut i = 0;
        while i < self.waiting.len() {
            match self.readiness(&self.waiting[i], now) {
                Readiness::Wait => i += 1,
                Readiness::Drop(cause) => {
                    self.forget(i);
                    self.drops.count(cause);
                }
                Readiness::Ready => {
                    let done = self.place(i, placed);
                    self.forget(i);
                    match done {
                        Ok(()) => return true,
                        Err(_) => self.drops.count(DropCause::Gap),
                    }
                }
            }
        }
        false
    }

    /// A scan waits no longer; its memory is kept.
    fn forget(&mut self, i: usize) {
        if let Some(mut scan) = self.waiting.remove(i) {
            scan.returns.clear();
            self.spare.push(scan.returns);
        }
    }

    fn place(&mut self, i: usize, placed: &mut PlacedScan) -> Result<(), NoValue> {
        let scan = &self.waiting[i];
        let (mount, extrinsics) = (&self.mounts[scan.ladar], &self.extrinsics[scan.ladar]);
        let fan = &mut self.fans[scan.ladar];
        fan.prepare(&scan.header, scan.returns.len());
        placed.ladar = scan.ladar;
        let stretch_at = |stamp| self.motion.stretch(extrinsics, stamp);
        place_scan(placed, mount, (&scan.header, &scan.returns), (fan, extrinsics.lever_m()), stretch_at)?;
        placed.sweep = if mount.on_pan_tilt { Some(self.motion.head_at(placed.last)?.sweep) } else { None };
        if let Some((zone, south)) = self.motion.zone() {
            (placed.points_header.zone, placed.points_header.south) = (zone, south);
        }
        Ok(())
    }

    fn readiness(&self, scan: &WaitingScan, now: Timestamp) -> Readiness {
        let overdue = now.seconds_since(scan.since) > self.deadline_s;
        let (first, last) = (beam_stamp(&scan.header, 0), beam_stamp(&scan.header, scan.returns.len() - 1));
        for stamp in [first, last] {
            let pose = self.motion.vehicle_at(stamp).map(|_| ());
            let head = match self.mounts[scan.ladar].on_pan_tilt {
                true => self.motion.head_at(stamp).map(|_| ()),
                false => Ok(()),
            };
            for (found, cause) in [(pose, DropCause::NoPose), (head, DropCause::NoJoint)] {
                match found {
                    Ok(()) => {}
                    Err(NoValue::Empty | NoValue::NotYet { .. }) if !overdue => return Readiness::Wait,
                    Err(NoValue::Gap { .. }) => return Readiness::Drop(DropCause::Gap),
                    Err(_) => return Readiness::Drop(cause),
                }
            }
        }
        Readiness::Ready
    }

    /// What was not used, since the start.
    pub fn drops(&self) -> &Drops {
        &self.drops
    }

    /// The same, for what else comes in.
    pub fn drops_mut(&mut self) -> &mut Drops {
        &mut self.drops
    }

    /// Poses and readings.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The ladars.
    pub fn mounts(&self) -> &[LadarMount] {
        &self.mounts
    }

    /// Stamp of the newest scan of a ladar, placed or not.
    pub fn newest_scan(&self, ladar: usize) -> Option<Timestamp> {
        self.newest_scan.get(ladar).copied().flatten()
    }
}

fn scan_is_good(header: &ScanHeader, returns: &[Return]) -> bool {
    (1..=Scan::ITEMS_MAX).contains(&returns.len())
        && (0.0..=BEAM_INTERVAL_MAX_NS).contains(&header.beam_interval_ns)
        && header.start_rad.is_finite()
        && header.step_rad.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{joint_at, pose_at, scan_at};

    struct Bench(Placer);

    impl Bench {
        fn new() -> Self {
            Self(Placer::new(&PlacingConfig::default(), vec![LadarMount::default()]))
        }
        fn pose(&mut self, s: f64) -> &mut Self {
            assert!(self.0.add_pose(&pose_at(s, [500_000.0 + s, 5.0e6, 100.0])));
            self
        }
        fn joint(&mut self, s: f64) -> &mut Self {
            assert!(self.0.add_joint(&joint_at(s, s, (s * 10.0) as u32)));
            self
        }
        fn scan(&mut self, s: f64) -> bool {
            let (header, returns) = scan_at(s);
            self.0.add_scan(0, &header, &returns, Timestamp::from_seconds(s))
        }
        fn placed(&mut self, now_s: f64) -> Option<PlacedScan> {
            let mut scan = PlacedScan::default();
            self.0.next_placed(Timestamp::from_seconds(now_s), &mut scan).then_some(scan)
        }
        fn dropped(&self, cause: DropCause) -> u64 {
            self.0.drops().of(cause)
        }
    }

    #[test]
    fn a_scan_waits_until_poses_and_readings_cover_its_last_beam() {
        let mut b = Bench::new();
        b.pose(0.0).joint(0.0);
        assert!(b.scan(0.1));
        assert!(b.placed(0.11).is_none());
        b.pose(0.2);
        assert!(b.placed(0.21).is_none(), "the pan-tilt is missing");
        b.joint(0.15);
        let scan = b.placed(0.22).unwrap();
        assert_eq!(scan.points.len(), 3);
        assert_eq!(scan.sweep, Some(0), "the nod of the sample before");
        assert_eq!(scan.points_header.zone, 32);
        assert!((scan.beams[0].origin.x() - 500_000.1).abs() < 1e-6);
        assert!(b.placed(0.22).is_none());
        assert_eq!(b.0.drops().total(), 0);
    }

    #[test]
    fn a_scan_past_its_deadline_is_dropped_with_its_cause() {
        let mut b = Bench::new();
        assert!(b.scan(0.1));
        assert!(b.placed(0.5).is_none());
        assert_eq!(b.0.drops().total(), 0);
        assert!(b.placed(0.7).is_none());
        assert_eq!(b.dropped(DropCause::NoPose), 1);
        b.pose(1.0).pose(1.2);
        assert!(b.scan(1.1));
        assert!(b.placed(1.7).is_none());
        assert_eq!(b.dropped(DropCause::NoJoint), 1);
    }

    #[test]
    fn a_scan_in_a_gap_before_all_poses_or_out_of_order_is_dropped_at_once() {
        let mut b = Bench::new();
        b.joint(0.0).joint(0.2).joint(0.4).joint(0.6).joint(0.8);
        b.pose(0.1).pose(0.7);
        assert!(b.scan(0.05));
        assert!(!b.scan(0.05));
        assert!(b.scan(0.3));
        assert!(b.placed(0.75).is_none());
        assert_eq!(b.dropped(DropCause::NoPose), 1);
        assert_eq!(b.dropped(DropCause::ScanOutOfOrder), 1);
        assert_eq!(b.dropped(DropCause::Gap), 1);
    }

    #[test]
    fn the_queue_is_bounded_and_drops_its_oldest() {
        let mut b = Bench::new();
        for i in 0..WAITING_MAX + 3 {
            assert!(b.scan(0.1 + i as f64 * 1e-3));
        }
        assert_eq!(b.dropped(DropCause::QueueFull), 3);
    }

    #[test]
    fn a_scan_of_nonsense_is_refused() {
        let mut b = Bench::new();
        let (header, returns) = scan_at(0.1);
        let now = Timestamp::from_seconds(0.1);
        assert!(!b.0.add_scan(1, &header, &returns, now), "there is no ladar 1");
        assert!(!b.0.add_scan(0, &header, &[], now));
        assert!(!b.0.add_scan(0, &ScanHeader { step_rad: f64::NAN, ..header }, &returns, now));
        assert!(!b.0.add_scan(0, &ScanHeader { beam_interval_ns: -1.0, ..header }, &returns, now));
        assert_eq!(b.dropped(DropCause::ScanInvalid), 4);
    }

    #[test]
    fn a_ladar_without_pan_tilt_waits_for_poses_only() {
        let mount = LadarMount { on_pan_tilt: false, ..LadarMount::default() };
        let mut b = Bench(Placer::new(&PlacingConfig::default(), vec![mount]));
        b.pose(0.0).pose(0.2);
        assert!(b.scan(0.1));
        assert_eq!(b.placed(0.2).unwrap().sweep, None);
    }
}
