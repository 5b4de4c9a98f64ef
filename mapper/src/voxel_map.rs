//! The voxel map: beams in, evidence over windows, blocks of bricks out.
//!
//! In: [`crate::beams::Beam`]s in `Global`, metres; when a window of evidence ends; how much confidence fades. Out: blocks, as
//! readers of the `map` topic know them, and which of them changed. It knows no time and no sensor.
//! Source: thesis section on the voxel map, (2-2) and (2-4); the windows are this project's own (see `evidence`).

mod above_ground;
mod changes;
mod closing;
mod exchange;
mod fusion;
mod insertion;

use crate::block::BlockState;
use crate::clip::Space;
use crate::config::{Config, Scheme};
use crate::evidence::{AlignedBrick, Steps, fade};
use crate::marks::MarkField;
use crate::ratio::{Counters, Ratio};
use crate::trace::InstructionSet;
use crate::untouched::Untouched;
use crate::window::Window;
use std::ops::Range;
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK, BlockKey, Brick, VoxelState};
use tsense_geometry::{Global, Point, VoxelGrid, VoxelIndex};

pub use fusion::{EDGE_VOXELS_MAX, Fused};

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

/// How evidence changes bricks.
enum Rule {
    Steps(Steps),
    Ratio(Ratio, Untouched<Counters>),
}

/// Dense blocks in a window that rolls with the vehicle.
pub struct VoxelMap {
    grid: VoxelGrid,
    window: Window,
    bricks: Untouched<AlignedBrick>,
    marks: MarkField,
    blocks: Vec<BlockState>,
    rule: Rule,
    /// The window's first voxel and the working space in voxels from it, kept from `center_on`.
    first: [f64; 3],
    space: [Range<i32>; 3],
    /// What of it lies in the last segment's blocks, which are noted already.
    entered: Space,
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
    told: Vec<fusion::ToldHit>,
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
            Scheme::HitRatio => Rule::Ratio(Ratio::new(&config.scheme), Untouched::zeroed(bricks)),
            Scheme::IncrementDecrement | Scheme::Confidence => Rule::Steps(Steps::new(&config.scheme)),
        };
        Ok(Self {
            grid,
            first: window.first_voxel().map(f64::from),
            space: window.working_space(),
            bricks: Untouched::zeroed(bricks),
            marks: MarkField::new(window.slots()),
            blocks: vec![BlockState::default(); window.slot_count()],
            window,
            rule,
            entered: Space::EMPTY,
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
            told: Vec::new(),
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
        (self.first, self.space) = (self.window.first_voxel().map(f64::from), self.window.working_space());
        self.entered = Space::EMPTY;
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
