//! Beams into the map: the way to each one's end is marked as missed, the end is hit.

use super::{Rule, VoxelMap};
use crate::beams::{Beam, BeamKind, Weight};
use crate::clip::Space;
use crate::evidence::{hit_mark, hit_quarters};
use crate::trace::{Miss, Walk, Work, trace};
use crate::window::VOXELS_PER_BLOCK;
use tsense_contract::{BLOCK_VOXELS, BRICK_VOXELS, BRICKS_PER_BLOCK, locate};
use tsense_geometry::{COORDINATE_MAX_M, Global, Point, VoxelIndex};

impl VoxelMap {
    /// Takes in a beam: the way is free, the end of a hit is occupied. False where nothing of it lies in the
    /// working space, or a coordinate is not finite or not on Earth.
    pub fn insert(&mut self, beam: &Beam) -> bool {
        self.insert_all(std::slice::from_ref(beam)) == 1
    }

    /// Takes in beams; how many [`VoxelMap::insert`] would have said true of.
    pub fn insert_all(&mut self, beams: &[Beam]) -> usize {
        self.instruction_set.run(Insertion { map: self, beams })
    }

    #[inline(always)]
    fn insert_on<W: Walk>(&mut self, beam: &Beam) -> bool {
        let (Some(start), Some(end)) = (self.in_window(beam.origin), self.in_window(beam.end)) else {
            return false;
        };
        if self.enter_blocks(start, end).is_none() {
            return false;
        }
        // The hit first: its voxel is far off in memory, and comes while the way is walked.
        let hit = beam.kind == BeamKind::Hit && self.hit(end, hit_mark(beam.weight), beam.weight);
        let freed = self.free_the_way::<W>(start, end, beam);
        freed || hit
    }

    /// Voxel units from the window's first voxel. The subtraction is exact, so the voxel is the grid's.
    #[inline(always)]
    pub(super) fn in_window(&self, point: Point<Global>) -> Option<[f64; 3]> {
        let at_m = point.to_array();
        let on_earth = at_m.iter().fold(true, |all, c| all & (c.abs() <= COORDINATE_MAX_M));
        on_earth.then(|| std::array::from_fn(|axis| at_m[axis] / self.grid.size_m() - self.first[axis]))
    }

    #[inline(always)]
    fn free_the_way<W: Walk>(&mut self, start: [f64; 3], end: [f64; 3], beam: &Beam) -> bool {
        let free_end = match beam.kind {
            BeamKind::Hit => shortened(start, end, self.spare_voxels, self.grazing_share(end)),
            BeamKind::NoReturn => Some(end),
        };
        let Some((start, end)) = free_end.and_then(|end| self.enter_blocks(start, end)) else {
            return false;
        };
        let miss = Miss::new(beam.weight, self.chord_min_voxels);
        self.voxel_visits += trace::<W>(&mut self.marks, start, end, miss);
        true
    }

    /// A hit with something on top of it is the side of a thing, and beams are sure up to there; the ground has
    /// nothing on it, and beams graze it. Asked of the map as it was when the window opened, so that the order of the
    /// window's beams does not matter.
    #[inline(always)]
    fn grazing_share(&self, end: [f64; 3]) -> f64 {
        if self.grazing_spare_share == 0.0 {
            return 0.0;
        }
        let [x, y, z] = end.map(floor);
        let stands = (1..=2).any(|up| self.was_occupied([x, y, z + up]));
        if stands { 0.0 } else { self.grazing_spare_share }
    }

    /// Whether a voxel was occupied when the window opened: misses count when it ends, hits have left a note.
    #[inline(always)]
    pub(super) fn was_occupied(&self, voxel: VoxelIndex) -> bool {
        self.in_space(voxel)
            && self.marks.was_occupied(voxel).unwrap_or_else(|| {
                let position = self.position_in_window(voxel);
                self.bricks[position / BRICK_VOXELS].0.occupancy[position % BRICK_VOXELS] > 0
            })
    }

    /// Whether a voxel, counted from the window's first, lies in the working space.
    pub(super) fn in_space(&self, voxel: VoxelIndex) -> bool {
        (0..3).all(|axis| self.space[axis].contains(&voxel[axis]))
    }

    #[inline(always)]
    pub(super) fn position_in_window(&self, [i, j, k]: VoxelIndex) -> usize {
        let [x, y, z] = self.window.offsets();
        (x.at(i) + y.at(j) + z.at(k)) as usize
    }

    /// Marks the end of a beam, where that lies in the blocks just entered; what a window knew of it does not count twice.
    #[inline(always)]
    pub(super) fn hit(&mut self, end: [f64; 3], mark: u8, weight: Weight) -> bool {
        if !self.entered.contains(end) {
            return false;
        }
        let voxel = end.map(floor);
        let position = self.position_in_window(voxel);
        let (brick, within) = (position / BRICK_VOXELS, position % BRICK_VOXELS);
        let occupied = self.bricks[brick].0.occupancy[within] > 0;
        let before = self.marks.hit(voxel, mark, occupied);
        let (before, now) = (hit_quarters(before), weight.quarters());
        self.voxel_visits += 1;
        if now <= before {
            return true;
        }
        match &mut self.rule {
            Rule::Steps(steps) => steps.hit(&mut self.bricks[brick].0, within, before, now),
            Rule::Ratio(ratio, counters) if before == 0 => {
                ratio.hit(&mut counters[brick], &mut self.bricks[brick].0, within);
            }
            Rule::Ratio(..) => {}
        }
        self.blocks[brick / BRICKS_PER_BLOCK].dirty.insert(brick % BRICKS_PER_BLOCK);
        true
    }

    /// The part of a segment within the working space. Notes the blocks around it: a box of one to eight of them, as a
    /// rule, and the last beam's.
    #[inline(always)]
    pub(super) fn enter_blocks(&mut self, start: [f64; 3], end: [f64; 3]) -> Option<([f64; 3], [f64; 3])> {
        let is_known = |start, end| self.entered.contains(start) && self.entered.contains(end);
        if is_known(start, end) {
            return Some((start, end));
        }
        let (start, end) = Space::of(&self.space).clip(start, end)?;
        if !is_known(start, end) {
            self.enter_new_blocks(start, end);
        }
        Some((start, end))
    }

    #[cold]
    fn enter_new_blocks(&mut self, start: [f64; 3], end: [f64; 3]) {
        let blocks: [[usize; 2]; 3] = std::array::from_fn(|axis| {
            [start[axis].min(end[axis]), start[axis].max(end[axis])].map(|c| c as usize / BLOCK_VOXELS[axis])
        });
        let [x, y, z] = blocks.map(|[low, high]| low..=high);
        for k in z {
            for j in y.clone() {
                x.clone().for_each(|i| self.enter_block([i, j, k]));
            }
        }
        let edges = |axis: usize| {
            let [low, high] = blocks[axis].map(|block| (block * BLOCK_VOXELS[axis]) as i32);
            low..high + BLOCK_VOXELS[axis] as i32
        };
        self.entered = Space::of(&std::array::from_fn(edges)).and(Space::of(&self.space));
    }

    fn enter_block(&mut self, within: [usize; 3]) {
        let offsets = self.window.offsets();
        let position: u32 = (0..3).map(|a| offsets[a].at((within[a] * BLOCK_VOXELS[a]) as i32)).sum();
        let block = &mut self.blocks[position as usize / VOXELS_PER_BLOCK];
        if !block.marked {
            block.marked = true;
            self.marks.reach(within);
            if block.key.is_none() {
                let first = self.window.first_voxel();
                let voxel = std::array::from_fn(|a| first[a] + (within[a] * BLOCK_VOXELS[a]) as i32);
                (block.key, block.faded) = (Some(locate(voxel).0), self.fade_due as u32);
            }
        }
    }
}

/// Beams that go into a map on one instruction set.
struct Insertion<'a> {
    map: &'a mut VoxelMap,
    beams: &'a [Beam],
}

impl Work for Insertion<'_> {
    type Out = usize;

    #[inline(always)]
    fn on<W: Walk>(self) -> usize {
        let mut inserted = 0;
        // No closure: it would not be compiled for the instruction set.
        for beam in self.beams {
            inserted += usize::from(self.map.insert_on::<W>(beam));
        }
        inserted
    }
}

/// Floor of what lies in or near the window: a cast is one instruction everywhere, `floor` is not.
#[inline(always)]
fn floor(c: f64) -> i32 {
    let cut = c as i32;
    cut.saturating_sub(i32::from(f64::from(cut) > c))
}

/// The end of a segment drawn back by `spare` voxels, or by a share of its length if that is more; nothing where that
/// is all of it.
#[inline(always)]
fn shortened(start: [f64; 3], end: [f64; 3], spare: f64, spare_share: f64) -> Option<[f64; 3]> {
    if spare == 0.0 && spare_share == 0.0 {
        return Some(end);
    }
    let length = (0..3).map(|axis| (end[axis] - start[axis]).powi(2)).sum::<f64>().sqrt();
    let share = 1.0 - (spare / length).max(spare_share);
    (share > 0.0).then(|| std::array::from_fn(|axis| start[axis] + (end[axis] - start[axis]) * share))
}
