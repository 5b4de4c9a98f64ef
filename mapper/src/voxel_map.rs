//! The voxel map: beams in, evidence over windows, blocks of bricks out.
//!
//! In: [`Beam`]s in `Global`, metres; when a window of evidence ends; how much confidence fades. Out: blocks, as
//! readers of the `map` topic know them, and which of them changed. It knows no time and no sensor.
//! Source: thesis section on the voxel map, (2-2) and (2-4); the windows are this project's own (see `evidence`).

mod changes;
mod exchange;
mod fusion;

use crate::beams::{Beam, BeamKind, Weight};
use crate::block::BlockState;
use crate::clip::clip;
use crate::config::{Config, Scheme};
use crate::evidence::{AlignedBrick, Steps, fade, hit_mark, hit_quarters, miss_mark};
use crate::marks::MarkField;
use crate::ratio::{Counters, Ratio};
use crate::trace::{InstructionSet, Miss, trace};
use crate::window::{VOXELS_PER_BLOCK, Window};
use std::ops::Range;
use tsense_contract::{BLOCK_VOXELS, BRICK_VOXELS, BRICKS_PER_BLOCK, BlockKey, Brick, VoxelState, locate};
use tsense_geometry::{COORDINATE_MAX_M, Global, Point, VoxelGrid, VoxelIndex};

/// Why there is no map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MapError {
    /// The voxel size is no size.
    #[error("voxels of {0} m: choose a size from 0.01 to 10 m")]
    VoxelSize(f64),
    /// The working space has no extent or needs too many blocks.
    #[error("a working space of {space_m:?} m in voxels of {voxel_size_m} m: choose extents that 4096 blocks cover")]
    WorkingSpace {
        /// As configured, metres.
        space_m: [f64; 3],
        /// As configured, metres.
        voxel_size_m: f64,
    },
}

/// What one voxel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Voxel {
    /// Unknown, free or occupied.
    pub state: VoxelState,
    /// Evidence: positive occupied, negative free.
    pub occupancy: i8,
    /// Updates behind it, faded by age.
    pub confidence: u8,
}

/// The box of no segment.
const NO_BLOCKS: [[f64; 2]; 3] = [[f64::INFINITY, f64::NEG_INFINITY]; 3];

/// How evidence changes bricks.
enum Rule {
    Steps(Steps),
    Ratio(Ratio, Box<[Counters]>),
}

/// Dense blocks in a window that rolls with the vehicle.
pub struct VoxelMap {
    grid: VoxelGrid,
    window: Window,
    bricks: Box<[AlignedBrick]>,
    marks: MarkField,
    blocks: Vec<BlockState>,
    rule: Rule,
    /// The working space in voxels of the window, kept from `center_on`.
    space: [Range<i32>; 3],
    /// The box of the last segment's blocks, voxels of the window: these blocks are noted already.
    entered: [[f64; 2]; 3],
    spare_voxels: f64,
    grazing_spare_share: f64,
    chord_min_voxels: f64,
    floors: (u8, u8),
    /// Units of confidence every block has to lose since the start.
    fade_due: f64,
    next_to_fade: usize,
    next_version: u32,
    snapshots: u64,
    voxel_visits: u64,
    instruction_set: InstructionSet,
    exchange: exchange::Exchange,
}

impl VoxelMap {
    /// An unknown world around the UTM origin; see [`VoxelMap::center_on`].
    pub fn new(config: &Config) -> Result<Self, MapError> {
        let size_m = config.voxel_size_m;
        let grid = VoxelGrid::new(size_m).ok_or(MapError::VoxelSize(size_m))?;
        let space_m = config.working_space_m;
        let window = Window::new(size_m, space_m).ok_or(MapError::WorkingSpace { space_m, voxel_size_m: size_m })?;
        // Zeroed pages come from the system untouched: a block that no beam reaches costs no memory.
        let bricks = window.slot_count() * BRICKS_PER_BLOCK;
        let rule = match config.scheme.scheme {
            Scheme::HitRatio => Rule::Ratio(Ratio::new(&config.scheme), bytemuck::zeroed_slice_box(bricks)),
            Scheme::IncrementDecrement | Scheme::Confidence => Rule::Steps(Steps::new(&config.scheme)),
        };
        Ok(Self {
            grid,
            space: window.working_space(),
            bricks: bytemuck::zeroed_slice_box(bricks),
            marks: MarkField::new(window.slots()),
            blocks: vec![BlockState::default(); window.slot_count()],
            window,
            rule,
            entered: NO_BLOCKS,
            spare_voxels: config.evidence.spare_voxels,
            grazing_spare_share: config.evidence.grazing_spare_share,
            chord_min_voxels: config.evidence.chord_min_voxels,
            floors: (config.fading.floor_occupied, config.fading.floor_free),
            fade_due: 0.0,
            next_to_fade: 0,
            next_version: 1,
            snapshots: 0,
            voxel_visits: 0,
            instruction_set: InstructionSet::best(),
            exchange: exchange::Exchange::new(config),
        })
    }

    /// The grid of voxels.
    pub fn grid(&self) -> VoxelGrid {
        self.grid
    }

    /// The voxel at the centre of the working space.
    pub fn center(&self) -> VoxelIndex {
        self.window.center()
    }

    /// Block slots of the window.
    pub fn block_slots(&self) -> usize {
        self.blocks.len()
    }

    /// What the innermost loop runs on.
    pub fn instruction_set(&self) -> InstructionSet {
        self.instruction_set
    }

    /// Chooses what the innermost loop runs on; the marks are the same.
    pub fn use_instruction_set(&mut self, set: InstructionSet) {
        self.instruction_set = set;
    }

    /// Voxels that beams have crossed, or ended in, since the start.
    pub fn voxel_visits(&self) -> u64 {
        self.voxel_visits
    }

    /// Moves the working space. Blocks behind are dropped, blocks ahead are unknown. False where the point is not
    /// on Earth: nothing moves then.
    pub fn center_on(&mut self, point: Point<Global>) -> bool {
        let Some(center) = self.grid.index_of(point) else {
            return false;
        };
        if self.window.moves_blocks(center) {
            // Marks follow the window's own indices, so they count before it rolls.
            self.close_window();
            self.window.center_on(center);
            self.drop_blocks_outside();
            self.note_entered();
        } else {
            self.window.center_on(center);
        }
        self.space = self.window.working_space();
        true
    }

    fn drop_blocks_outside(&mut self) {
        for (key, slot) in self.window.blocks() {
            if self.blocks[slot].key.is_some_and(|held| held != key) {
                self.hand_out(slot);
                let bricks = bricks_of(slot);
                self.bricks[bricks.clone()].fill(AlignedBrick(Brick::UNKNOWN));
                if let Rule::Ratio(_, counters) = &mut self.rule {
                    counters[bricks].fill(bytemuck::Zeroable::zeroed());
                }
                self.blocks[slot] = BlockState::default();
            }
        }
    }

    /// Takes in a beam: the way is free, the end of a hit is occupied. False where nothing of it lies in the
    /// working space, or a coordinate is not finite or not on Earth.
    pub fn insert(&mut self, beam: &Beam) -> bool {
        let (Some(start), Some(end)) = (self.in_window(beam.origin), self.in_window(beam.end)) else {
            return false;
        };
        let freed = self.free_the_way(start, end, beam);
        let hit = beam.kind == BeamKind::Hit && self.hit(end, beam.weight);
        freed || hit
    }

    /// Voxel units from the window's first voxel. The subtraction is exact, so the voxel is the grid's.
    fn in_window(&self, point: Point<Global>) -> Option<[f64; 3]> {
        let (first, at_m) = (self.window.first_voxel(), point.to_array());
        let on_earth = at_m.iter().all(|c| c.abs() <= COORDINATE_MAX_M);
        on_earth.then(|| std::array::from_fn(|axis| at_m[axis] / self.grid.size_m() - f64::from(first[axis])))
    }

    fn free_the_way(&mut self, start: [f64; 3], end: [f64; 3], beam: &Beam) -> bool {
        let free_end = match beam.kind {
            BeamKind::Hit => shortened(start, end, self.spare_voxels, self.grazing_share(end)),
            BeamKind::NoReturn => Some(end),
        };
        let Some((start, end)) = free_end.and_then(|end| clip(start, end, &self.space)) else {
            return false;
        };
        self.enter_blocks(start, end);
        let miss = Miss::new(miss_mark(beam.weight), self.chord_min_voxels);
        self.voxel_visits += trace(&mut self.marks, start, end, miss, self.instruction_set);
        true
    }

    /// A hit with something on top of it is the side of a thing, and beams are sure up to there; the ground has
    /// nothing on it, and beams graze it. Asked of the map as it was when the window opened, so that the order of the
    /// window's beams does not matter.
    fn grazing_share(&self, end: [f64; 3]) -> f64 {
        if self.grazing_spare_share == 0.0 {
            return 0.0;
        }
        let [x, y, z] = end.map(floor);
        let stands = (1..=2).any(|up| self.was_occupied([x, y, z + up]));
        if stands { 0.0 } else { self.grazing_spare_share }
    }

    /// Whether a voxel was occupied when the window opened: misses count when it ends, hits have left a note.
    fn was_occupied(&self, voxel: VoxelIndex) -> bool {
        self.in_space(voxel)
            && self.marks.was_occupied(self.marks.position(voxel)).unwrap_or_else(|| {
                let position = self.position_in_window(voxel);
                self.bricks[position / BRICK_VOXELS].0.occupancy[position % BRICK_VOXELS] > 0
            })
    }

    /// Whether a voxel, counted from the window's first, lies in the working space.
    fn in_space(&self, voxel: VoxelIndex) -> bool {
        (0..3).all(|axis| self.space[axis].contains(&voxel[axis]))
    }

    fn position_in_window(&self, [i, j, k]: VoxelIndex) -> usize {
        let [x, y, z] = self.window.offsets();
        (x.at(i) + y.at(j) + z.at(k)) as usize
    }

    /// Marks the end of a beam; what a window already knew of it does not count twice.
    fn hit(&mut self, end: [f64; 3], weight: Weight) -> bool {
        let voxel = end.map(floor);
        if !self.in_space(voxel) {
            return false;
        }
        self.enter_blocks(end, end);
        let position = self.position_in_window(voxel);
        let (brick, within) = (position / BRICK_VOXELS, position % BRICK_VOXELS);
        let occupied = self.bricks[brick].0.occupancy[within] > 0;
        let mark = self.marks.hit(self.marks.position(voxel), hit_mark(weight), occupied);
        let (before, now) = (hit_quarters(mark), weight.quarters());
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

    /// Notes the blocks around a segment within the working space: a box of one to eight of them, as a rule, and within
    /// the last beam's.
    fn enter_blocks(&mut self, start: [f64; 3], end: [f64; 3]) {
        let holds = |box_: &[f64; 2], c: f64| box_[0] <= c && c < box_[1];
        let is_known = (0..3).all(|a| holds(&self.entered[a], start[a]) && holds(&self.entered[a], end[a]));
        if !is_known {
            self.enter_new_blocks(start, end);
        }
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
        let edges = |axis: usize, [low, high]: [usize; 2]| [low, high + 1].map(|b| (b * BLOCK_VOXELS[axis]) as f64);
        self.entered = std::array::from_fn(|axis| edges(axis, blocks[axis]));
    }

    fn enter_block(&mut self, within: [usize; 3]) {
        let offsets = self.window.offsets();
        let position: u32 = (0..3).map(|a| offsets[a].at((within[a] * BLOCK_VOXELS[a]) as i32)).sum();
        let block = &mut self.blocks[position as usize / VOXELS_PER_BLOCK];
        if !block.marked {
            block.marked = true;
            if block.key.is_none() {
                let first = self.window.first_voxel();
                let voxel = std::array::from_fn(|a| first[a] + (within[a] * BLOCK_VOXELS[a]) as i32);
                (block.key, block.faded) = (Some(locate(voxel).0), self.fade_due as u32);
            }
        }
    }

    /// Ends a window of evidence: voxels that beams only passed lose, all marks go.
    pub fn close_window(&mut self) {
        self.marks.protect_hits();
        self.entered = NO_BLOCKS;
        for (block, (_, slot)) in self.window.block_indices().zip(self.window.blocks()) {
            if std::mem::take(&mut self.blocks[slot].marked) {
                self.apply_marks(block, slot);
            }
        }
    }

    fn apply_marks(&mut self, block: [usize; 3], slot: usize) {
        let dirty = &mut self.blocks[slot].dirty;
        let bricks = bricks_of(slot);
        let (bricks, rule) = (&mut self.bricks[bricks.clone()], &mut self.rule);
        self.marks.take_block(block, |brick, marks| {
            let changed = match rule {
                Rule::Steps(steps) => steps.misses(&mut bricks[brick].0, marks),
                Rule::Ratio(ratio, counters) => {
                    ratio.misses(&mut counters[slot * BRICKS_PER_BLOCK + brick], &mut bricks[brick].0, marks)
                }
            };
            if changed {
                dirty.insert(brick);
            }
        });
    }

    /// Every voxel has `units` of confidence more to lose. [`VoxelMap::fade_blocks`] takes them.
    pub fn fade(&mut self, units: f64) {
        // u32 units are enough for a century at 1 a second.
        self.fade_due = (self.fade_due + units.max(0.0)).min(f64::from(u32::MAX));
    }

    /// Takes what is due from the next `count` blocks, in turn: all at once would publish the whole map anew.
    pub fn fade_blocks(&mut self, count: usize) {
        for _ in 0..count.min(self.blocks.len()) {
            let slot = self.next_to_fade % self.blocks.len();
            self.next_to_fade = slot + 1;
            self.fade_block(slot);
        }
    }

    fn fade_block(&mut self, slot: usize) {
        let block = &mut self.blocks[slot];
        let due = (self.fade_due as u32).saturating_sub(block.faded);
        if block.key.is_none() || due == 0 || !matches!(self.rule, Rule::Steps(_)) {
            return;
        }
        block.faded += due;
        let units = due.min(255) as u8;
        for (i, brick) in bricks_of(slot).enumerate() {
            if fade(&mut self.bricks[brick].0, units, self.floors.0, self.floors.1) {
                block.dirty.insert(i);
            }
        }
    }

    /// All blocks that a beam has reached, in order of their keys' z, y, x; bricks as in the `map` topic.
    pub fn blocks(&self) -> impl Iterator<Item = (BlockKey, &[Brick])> {
        self.held().map(|(key, slot)| (key, self.bricks_in(slot)))
    }

    /// One block, where a beam has reached it.
    pub fn block(&self, key: BlockKey) -> Option<&[Brick]> {
        let slot = self.window.slot_of(key)?;
        (self.blocks[slot].key == Some(key)).then(|| self.bricks_in(slot))
    }

    /// Whether a voxel lies in the working space.
    pub fn holds(&self, index: VoxelIndex) -> bool {
        let first = self.window.first_voxel();
        (0..3).all(|axis| index[axis].checked_sub(first[axis]).is_some_and(|i| self.space[axis].contains(&i)))
    }

    /// One voxel; what the window does not hold is unknown.
    pub fn voxel(&self, index: VoxelIndex) -> Voxel {
        let Some(position) = self.window.position_of(index) else {
            return Voxel { state: VoxelState::Unknown, occupancy: 0, confidence: 0 };
        };
        let (brick, i) = (&self.bricks[position / BRICK_VOXELS].0, position % BRICK_VOXELS);
        Voxel { state: brick.state(i), occupancy: brick.occupancy[i], confidence: brick.confidence[i] }
    }

    /// Blocks that a beam has reached, with their slots.
    fn held(&self) -> impl Iterator<Item = (BlockKey, usize)> {
        self.window.blocks().filter(|(key, slot)| self.blocks[*slot].key == Some(*key))
    }

    fn bricks_in(&self, slot: usize) -> &[Brick] {
        bytemuck::cast_slice(&self.bricks[bricks_of(slot)])
    }
}

fn bricks_of(slot: usize) -> Range<usize> {
    slot * BRICKS_PER_BLOCK..(slot + 1) * BRICKS_PER_BLOCK
}

/// Floor of what lies in or near the window: a cast is one instruction everywhere, `floor` is not.
fn floor(c: f64) -> i32 {
    let cut = c as i32;
    cut.saturating_sub(i32::from(f64::from(cut) > c))
}

/// The end of a segment drawn back by `spare` voxels, or by a share of its length if that is more; nothing where that
/// is all of it.
fn shortened(start: [f64; 3], end: [f64; 3], spare: f64, spare_share: f64) -> Option<[f64; 3]> {
    if spare == 0.0 && spare_share == 0.0 {
        return Some(end);
    }
    let length = (0..3).map(|axis| (end[axis] - start[axis]).powi(2)).sum::<f64>().sqrt();
    let share = 1.0 - (spare / length).max(spare_share);
    (share > 0.0).then(|| std::array::from_fn(|axis| start[axis] + (end[axis] - start[axis]) * share))
}
