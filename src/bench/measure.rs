//! Measures the voxel map on a recording: nanoseconds a beam on each instruction set, snapshots, eroded surfaces.
//!
//! In: scans. Out: [`Figures`]. Times are processor time of this thread: other programs cost it caches, but not time.
#![allow(clippy::disallowed_methods, reason = "shell: measures processor time")]

use super::recording::Recording;
use bytemuck::Zeroable;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use std::collections::BTreeMap;
use tsense_contract::{BRICKS_PER_BLOCK, Brick, Map, Pose, Topic, VoxelState};
use tsense_geometry::{Timestamp, VoxelIndex};
use tsense_mapper::{BeamKind, Config, InstructionSet, MapError, Snapshot, SnapshotContext, Survey, VoxelMap};

/// Scans between two snapshots.
const SCANS_A_SNAPSHOT: usize = 3;
/// What makes a surface sure: hits in a voxel, and scans that they came in.
const SURE: (u32, u32) = (3, 2);

/// How it is measured.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Length of a window of evidence, seconds.
    pub window_s: f64,
    /// Passes through the recording for each instruction set; the median counts.
    pub repeat: usize,
}

/// What was measured.
#[derive(Debug, Serialize)]
pub struct Figures {
    /// The recording.
    pub case: String,
    /// Beams of one pass.
    pub beams: usize,
    /// Edge of a voxel, metres.
    pub voxel_m: f64,
    /// Voxels that the beams of one pass crossed, each crossing counted.
    pub voxel_visits: u64,
    /// Every voxel that a beam crosses updated, the best instruction set; nanoseconds.
    pub ns_per_beam: f64,
    /// The same with the default rules of evidence, which leave out short chords and the ends of grazing beams.
    pub ns_per_beam_default_rules: f64,
    /// The best instruction set of this processor.
    pub instruction_set: &'static str,
    /// Nanoseconds a beam on each instruction set, every voxel updated.
    pub ns_per_beam_by_instruction_set: BTreeMap<&'static str, f64>,
    /// Publishing the changes of three scans into memory, default rules; microseconds.
    pub snapshot_us: Spread,
    /// Publishing all that is known.
    pub keyframe: Keyframe,
    /// Share of surface voxels (3 hits in 2 scans at least) that end not occupied, default rules.
    pub eroded_share: f64,
    /// Those surface voxels.
    pub surface_voxels: usize,
}

/// Of all snapshots of a pass.
#[derive(Debug, Serialize)]
pub struct Spread {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
}

/// The map, whole.
#[derive(Debug, Serialize)]
pub struct Keyframe {
    /// Blocks of the map.
    pub blocks: usize,
    /// Bricks sent: those of which anything is known, and all of a block that is mostly known.
    pub bricks: usize,
    /// Microseconds for all of them.
    pub us: f64,
}

/// Measures everything on one recording.
pub fn measure(recording: &Recording, options: &Options) -> Result<Figures, MapError> {
    let default_rules = Survey::config_for(recording.low, recording.high, options.voxel_m, options.window_s);
    let mut every_voxel = default_rules.clone();
    let rules = &mut every_voxel.evidence;
    (rules.spare_voxels, rules.chord_min_voxels, rules.grazing_spare_share) = (0.0, 0.0, 0.0);

    let sets = InstructionSet::available();
    let (by_set, voxel_visits) = ns_per_beam(recording, &every_voxel, &sets, options)?;
    let best = InstructionSet::best();
    let (default_ns, _) = ns_per_beam(recording, &default_rules, &[best], options)?;
    let (snapshots_us, keyframe) = snapshots(recording, &default_rules, options)?;
    let (eroded_share, surface_voxels) = eroded(recording, &default_rules, options)?;
    Ok(Figures {
        case: recording.name.clone(),
        beams: recording.beams(),
        voxel_m: options.voxel_m,
        voxel_visits,
        ns_per_beam: by_set[best.as_str()],
        ns_per_beam_default_rules: default_ns[best.as_str()],
        instruction_set: best.as_str(),
        ns_per_beam_by_instruction_set: by_set,
        snapshot_us: Spread { p50: quantile(&snapshots_us, 0.5), p99: quantile(&snapshots_us, 0.99) },
        keyframe,
        eroded_share,
        surface_voxels,
    })
}

/// A map for a recording.
fn map_of(recording: &Recording, config: &Config) -> Result<VoxelMap, MapError> {
    let mut map = VoxelMap::new(config)?;
    map.center_on(recording.low + (recording.high - recording.low).scaled(0.5));
    Ok(map)
}

/// Medians of passes through one map that has seen the recording once, the instruction sets by turns; visits of a pass.
fn ns_per_beam(
    recording: &Recording,
    config: &Config,
    sets: &[InstructionSet],
    options: &Options,
) -> Result<(BTreeMap<&'static str, f64>, u64), MapError> {
    let mut map = map_of(recording, config)?;
    pass(recording, &mut map, options, |_, _| {});
    let visits = map.voxel_visits();
    let mut times = vec![Vec::new(); sets.len()];
    for _ in 0..options.repeat {
        for (set, times) in sets.iter().zip(&mut times) {
            map.use_instruction_set(*set);
            let start = seconds();
            pass(recording, &mut map, options, |_, _| {});
            times.push((seconds() - start) * 1e9 / recording.beams() as f64);
        }
    }
    let medians = sets.iter().zip(&mut times).map(|(set, times)| {
        times.sort_by(f64::total_cmp);
        (set.as_str(), quantile(times, 0.5))
    });
    Ok((medians.collect(), visits))
}

/// All scans through the map, windows of evidence by time; `after` is told each scan's number.
fn pass(recording: &Recording, map: &mut VoxelMap, options: &Options, mut after: impl FnMut(usize, &mut VoxelMap)) {
    let mut opened = recording.scans.first().map(|scan| scan.stamp);
    for (i, scan) in recording.scans.iter().enumerate() {
        if opened.is_some_and(|opened| scan.stamp.seconds_since(opened) >= options.window_s) {
            map.close_window();
            opened = Some(scan.stamp);
        }
        map.insert_all(&scan.beams);
        after(i, map);
    }
    map.close_window();
}

/// Microseconds of each snapshot of a second pass, ascending; and of whole blocks.
fn snapshots(recording: &Recording, config: &Config, options: &Options) -> Result<(Vec<f64>, Keyframe), MapError> {
    let mut map = map_of(recording, config)?;
    let (mut snapshot, mut room) = (Snapshot::default(), vec![Brick::UNKNOWN; Map::ITEMS_MAX]);
    let mut publish = |map: &mut VoxelMap, keyframe: bool| {
        let start = seconds();
        map.snapshot(keyframe, &mut snapshot);
        let sent = snapshot.publish(&context(options), map, |_, len, fill| {
            fill(&mut room[..len]);
            Ok::<(), std::convert::Infallible>(())
        });
        let us = (seconds() - start) * 1e6;
        let bricks = snapshot.numbers.len() + snapshot.whole.len() * BRICKS_PER_BLOCK;
        Keyframe { us, bricks, blocks: sent.map_or(0, |_| snapshot.table.len()) }
    };
    pass(recording, &mut map, options, |_, _| {});
    publish(&mut map, true);
    let mut times = Vec::new();
    pass(recording, &mut map, options, |i, map| {
        if i % SCANS_A_SNAPSHOT == SCANS_A_SNAPSHOT - 1 {
            times.push(publish(map, false).us);
        }
    });
    times.sort_by(f64::total_cmp);
    Ok((times, publish(&mut map, true)))
}

fn context(options: &Options) -> SnapshotContext {
    let at = Timestamp::from_ns(0);
    let (pose, center) = (Pose::zeroed(), [0; 3]);
    SnapshotContext { epoch: 1, stamp: at, published: at, voxel_size_m: options.voxel_m, pose, center }
}

/// Hits of a voxel, scans that hit it, and the last of those.
type Seen = (u32, u32, usize);

/// Share of the sure surface voxels that end not occupied after one pass, and their number.
fn eroded(recording: &Recording, config: &Config, options: &Options) -> Result<(f64, usize), MapError> {
    let mut map = map_of(recording, config)?;
    pass(recording, &mut map, options, |_, _| {});
    let mut seen = BTreeMap::<VoxelIndex, Seen>::new();
    for (i, scan) in recording.scans.iter().enumerate() {
        for beam in scan.beams.iter().filter(|beam| beam.kind == BeamKind::Hit) {
            if let Some(voxel) = map.grid().index_of(beam.end) {
                let (hits, scans, last) = seen.get(&voxel).copied().unwrap_or((0, 0, usize::MAX));
                seen.insert(voxel, (hits + 1, scans + u32::from(last != i), i));
            }
        }
    }
    let sure: Vec<_> = seen.iter().filter(|(_, seen)| seen.0 >= SURE.0 && seen.1 >= SURE.1).collect();
    let lost = sure.iter().filter(|(voxel, _)| map.voxel(**voxel).state != VoxelState::Occupied).count();
    Ok((lost as f64 / sure.len().max(1) as f64, sure.len()))
}

fn quantile(ascending: &[f64], share: f64) -> f64 {
    let last = ascending.len().saturating_sub(1);
    ascending.get((last as f64 * share).round() as usize).copied().unwrap_or(f64::NAN)
}

/// Processor time of this thread.
pub fn seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}
