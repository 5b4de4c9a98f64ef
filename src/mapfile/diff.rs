//! Two map files of one place: which voxels changed.
//!
//! In: two files of one zone and voxel size. Out: counts by kind of change, and the changed voxels as points. A voxel
//! that was unknown before is newly known, not changed; one that is unknown now was forgotten or never seen. Single
//! voxels flicker at the rim of every surface: the classifier's imaging tool drops groups smaller than wanted.

use super::points::voxel_of;
use super::{damaged, ply};
use crate::commands::Failure;
use crate::files::write_whole;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use tsense_classifier::imaging::{Changes, difference};
use tsense_classifier::{View, Window};
use tsense_contract::{BRICKS_PER_BLOCK, BlockKey, Brick, VoxelState};
use tsense_geometry::{VoxelGrid, VoxelIndex};
use tsense_mapper::tsmap::{MapFileHeader, Reader, StoredBlock};

/// Counts of voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Free before, occupied now.
    pub appeared: u64,
    /// Occupied before, free now.
    pub vanished: u64,
    /// Unknown before, occupied now.
    pub newly_occupied: u64,
    /// Unknown before, free now.
    pub newly_free: u64,
    /// Known before, unknown now.
    pub forgotten: u64,
    /// The same state in both.
    pub unchanged: u64,
    /// Appeared or vanished in groups too small to count.
    pub flicker: u64,
}

/// A changed voxel: which, its code in the PLY, its colour.
type Changed = (VoxelIndex, u8, [u8; 3]);

/// Appeared: red. Vanished: blue. Newly occupied: yellow.
const KINDS: [(u8, [u8; 3]); 3] = [(1, [220, 30, 30]), (2, [40, 80, 230]), (3, [230, 200, 40])];

/// The difference of two maps.
pub struct Difference {
    /// Counts of voxels.
    pub counts: Counts,
    changed: Vec<Changed>,
    header: MapFileHeader,
}

/// Two maps of one coordinate system and voxel size, or why they have nothing to do with each other.
pub fn one_place(a: &MapFileHeader, b: &MapFileHeader) -> Result<(), Failure> {
    let place = |h: &MapFileHeader| (h.epsg, h.zone, h.south, h.voxel_size_m.to_bits());
    if place(a) == place(b) {
        return Ok(());
    }
    let words = |h: &MapFileHeader| format!("{}, voxels of {} m", super::system_of(h), h.voxel_size_m);
    Err(Failure::new(2, format!("the maps do not compare: {} against {}", words(a), words(b))))
}

/// Blocks by their keys.
pub type Blocks = BTreeMap<BlockKey, StoredBlock>;

/// Compares two files. `touching_min`: smallest group of touching voxels that counts as appeared or vanished.
pub fn compare(
    before: (&Path, Reader<'_>),
    after: (&Path, Reader<'_>),
    touching_min: usize,
) -> Result<Difference, Failure> {
    let header = after.1.header();
    one_place(&before.1.header(), &header)?;
    let (before, after) = (all(before)?, all(after)?);
    let filter = if touching_min > 1 { Some(Filter::new(&before, &after, &header, touching_min)?) } else { None };
    let mut difference = Difference { counts: Counts::default(), changed: Vec::new(), header };
    let keys: BTreeSet<BlockKey> = before.keys().chain(after.keys()).copied().collect();
    for key in keys {
        difference.add_block(before.get(&key), after.get(&key), filter.as_ref());
    }
    Ok(difference)
}

/// All blocks of a file.
pub fn all((path, reader): (&Path, Reader<'_>)) -> Result<Blocks, Failure> {
    let keyed = reader.map(|block| block.map(|block| (block.key, block)));
    keyed.collect::<Result<_, _>>().map_err(|fault| damaged(path, &fault))
}

impl Difference {
    fn add_block(&mut self, before: Option<&StoredBlock>, after: Option<&StoredBlock>, filter: Option<&Filter>) {
        let Some(key) = before.or(after).map(|block| block.key) else { return };
        let dense = |block: Option<&StoredBlock>| block.map(StoredBlock::to_bricks).unwrap_or_default();
        let (then, now) = (dense(before), dense(after));
        for place in 0..BRICKS_PER_BLOCK {
            let brick = |bricks: &[Brick]| bricks.get(place).copied().unwrap_or(Brick::UNKNOWN);
            let (then, now) = (brick(&then), brick(&now));
            for i in (0..64).filter(|i| then.confidence[*i] > 0 || now.confidence[*i] > 0) {
                self.add(voxel_of(key, place, i), then.state(i), now.state(i), filter);
            }
        }
    }

    fn add(&mut self, voxel: VoxelIndex, then: VoxelState, now: VoxelState, filter: Option<&Filter>) {
        use VoxelState::{Free, Occupied, Unknown};
        let kind = match (then, now) {
            (Unknown, Free) => return self.counts.newly_free += 1,
            (_, Unknown) => return self.counts.forgotten += 1,
            (Free, Occupied) | (Occupied, Free) if filter.is_some_and(|f| !f.holds(voxel, now)) => {
                return self.counts.flicker += 1;
            }
            (Free, Occupied) => 0,
            (Occupied, Free) => 1,
            (Unknown, Occupied) => 2,
            _ => return self.counts.unchanged += 1,
        };
        let counts = &mut self.counts;
        *[&mut counts.appeared, &mut counts.vanished, &mut counts.newly_occupied][kind] += 1;
        let (code, color) = KINDS[kind];
        self.changed.push((voxel, code, color));
    }

    /// Writes the changed voxels that are or were occupied, with the kind of change as `scalar_change`.
    pub fn write_ply(&self, path: &Path) -> Result<(), Failure> {
        let size_m = self.header.voxel_size_m;
        write_whole(path, |writer| {
            ply::write_head(writer, &self.header, self.changed.len() as u64, &[("uchar", "scalar_change")])?;
            for (voxel, code, color) in &self.changed {
                let at_m = voxel.map(|v| (f64::from(v) + 0.5) * size_m);
                ply::write_point(writer, at_m, *color, &[*code])?;
            }
            Ok::<(), std::io::Error>(())
        })?;
        Ok(())
    }
}

/// The classifier's difference, asked voxel by voxel.
struct Filter {
    changes: Changes,
    window: Window,
}

impl Filter {
    fn new(before: &Blocks, after: &Blocks, header: &MapFileHeader, touching_min: usize) -> Result<Self, Failure> {
        let keys = before.keys().chain(after.keys()).copied();
        let too_large = || Failure::new(2, "the maps are too large to look for groups in; use --touching 1");
        let window = Window::covering(keys).ok_or_else(too_large)?;
        let grid = VoxelGrid::new(header.voxel_size_m).ok_or_else(too_large)?;
        let view = |blocks: &Blocks| {
            let dense: Vec<(BlockKey, Vec<Brick>)> = blocks.iter().map(|(key, b)| (*key, b.to_bricks())).collect();
            View::of_blocks(window, grid, dense.iter().map(|(key, bricks)| (*key, bricks.as_slice())), 1)
        };
        let changes = difference(&view(before), &view(after), touching_min).ok_or_else(too_large)?;
        Ok(Self { changes, window })
    }

    fn holds(&self, voxel: VoxelIndex, now: VoxelState) -> bool {
        let [x, y, level]: [usize; 3] = std::array::from_fn(|axis| (voxel[axis] - self.window.first[axis]) as usize);
        let kept = if now == VoxelState::Occupied { &self.changes.appeared } else { &self.changes.vanished };
        kept.contains(y * self.window.size[0] + x, level)
    }
}
