//! What publishing snapshots costs: the figures of a benchmark, for whoever has rays, a clock and a place to send to.
//!
//! In: scans of beams in `Global` with the nod each belongs to; a function that tells the time; one that sends a sample.
//! Out: microseconds from asking for a snapshot to its commit being sent, as percentiles, apart for snapshots of a few
//! scans, for those in which a window of evidence ended (once a nod, when all misses of the nod are counted) and for
//! keyframes. It reads no clock and opens no topic.

use crate::beams::Beam;
use crate::snapshot::{Snapshot, SnapshotContext};
use crate::voxel_map::VoxelMap;
use tsense_contract::{Brick, MapHeader};

/// Two percentiles of several figures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Percentiles {
    /// How many there were.
    pub count: usize,
    /// The median.
    pub p50: f64,
    /// Above 99 of 100.
    pub p99: f64,
}

impl Percentiles {
    /// Of figures in any order.
    pub fn of(mut figures: Vec<f64>) -> Self {
        figures.sort_by(f64::total_cmp);
        let at = |share: f64| figures.get(((figures.len() as f64 - 1.0) * share).round() as usize).copied();
        Self { count: figures.len(), p50: at(0.5).unwrap_or(f64::NAN), p99: at(0.99).unwrap_or(f64::NAN) }
    }
}

/// Microseconds of one kind of snapshot, and the bricks in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SnapshotCost {
    /// From asking for the snapshot to its commit being sent, microseconds.
    pub us: Percentiles,
    /// Items sent: bricks, with tables and numbers.
    pub items: Percentiles,
}

/// The figures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SnapshotCosts {
    /// Snapshots of a few scans' changes.
    pub changes: SnapshotCost,
    /// Those in which a window of evidence ended, too.
    pub window_ends: SnapshotCost,
    /// Every block, with all that is known of it.
    pub keyframes: SnapshotCost,
}

/// Times and items of one kind of snapshot.
#[derive(Default)]
struct Figures {
    us: Vec<f64>,
    items: Vec<f64>,
}

impl Figures {
    fn cost(self) -> SnapshotCost {
        SnapshotCost { us: Percentiles::of(self.us), items: Percentiles::of(self.items) }
    }
}

/// Traces scans into a map, publishes a snapshot after every `scans_a_snapshot` of them, and a keyframe after each
/// tenth snapshot, which is then no part of the others' figures.
pub fn snapshot_costs(
    map: &mut VoxelMap,
    context: &SnapshotContext,
    scans: &[(u32, Vec<Beam>)],
    scans_a_snapshot: usize,
    mut seconds: impl FnMut() -> f64,
    mut send: impl FnMut(&MapHeader, usize, &mut dyn FnMut(&mut [Brick])),
) -> SnapshotCosts {
    let (mut changes, mut window_ends, mut keyframes) = (Figures::default(), Figures::default(), Figures::default());
    let mut snapshot = Snapshot::default();
    let mut measure = |map: &mut VoxelMap, keyframe, figures: &mut Figures| {
        let (mut items, start) = (0, seconds());
        map.snapshot(keyframe, &mut snapshot);
        let sent = snapshot.publish(context, map, |header, len, fill| {
            items += len;
            send(header, len, fill);
            Ok::<(), std::convert::Infallible>(())
        });
        figures.us.push((seconds() - start) * 1e6);
        figures.items.push(items as f64);
        sent.is_ok()
    };
    let (mut nod, mut ended) = (scans.first().map(|scan| scan.0), false);
    for (i, (of_nod, beams)) in scans.iter().enumerate() {
        if nod.replace(*of_nod) != Some(*of_nod) {
            map.close_window();
            ended = true;
        }
        for beam in beams {
            map.insert(beam);
        }
        if (i + 1) % scans_a_snapshot == 0 {
            measure(map, false, if std::mem::take(&mut ended) { &mut window_ends } else { &mut changes });
        }
        if (i + 1) % (10 * scans_a_snapshot) == 0 {
            measure(map, true, &mut keyframes);
        }
    }
    SnapshotCosts { changes: changes.cost(), window_ends: window_ends.cost(), keyframes: keyframes.cost() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::scene::{AT, Scene};
    use crate::testing::pose_at;
    use tsense_geometry::{Point, Timestamp};

    #[test]
    fn percentiles_are_of_the_sorted_figures() {
        let of = Percentiles::of((1..=101).rev().map(f64::from).collect());
        assert_eq!(of, Percentiles { count: 101, p50: 51.0, p99: 100.0 });
        assert!(Percentiles::of(vec![]).p50.is_nan());
    }

    #[test]
    fn each_kind_of_snapshot_is_counted_apart() {
        let mut map = VoxelMap::new(&Config::default()).unwrap();
        map.center_on(Point::new(AT[0], AT[1], AT[2]));
        let scans: Vec<_> = (0..90).map(|i| Scene::tripod().scan(i)).map(|(_, nod, beams)| (nod, beams)).collect();
        let stamp = Timestamp::from_seconds(1.0);
        let (pose, center) = (pose_at(1.0, AT), map.center());
        let context = SnapshotContext { epoch: 1, stamp, published: stamp, voxel_size_m: 0.15, pose, center };
        let (mut room, mut ticks) = (vec![Brick::UNKNOWN; 6250], 0.0);
        let clock = || {
            ticks += 1e-6;
            ticks
        };
        let costs = snapshot_costs(&mut map, &context, &scans, 3, clock, |_, len, fill| fill(&mut room[..len]));
        let counts = [costs.changes, costs.window_ends, costs.keyframes].map(|cost| cost.us.count);
        assert_eq!(counts, [29, 1, 3], "the nod ends after 75 scans");
        assert!((costs.changes.us.p99 - 1.0).abs() < 1e-6);
        assert!(costs.keyframes.items.p50 > 1000.0 && costs.changes.items.p50 < costs.keyframes.items.p50 / 2.0);
    }
}
