//! Things that move, by what newly arrived beams meet where beams passed before.
//!
//! In: each snapshot's view and its fresh returns. Out: the voxels in which something that moves was met, and the columns in
//! which it may still be. A return in a voxel that was free in the snapshot before, with nothing that was there already in the
//! voxels around it, came; many of them together, as tall as a body, move. The rim of a bush flickers, too, but
//! beside leaves that were there before. What stays is met again by the next sweep in voxels that are not free any more: then it
//! is a thing like others. The other way round, occupied voxels that beams pass now, as many and as tall and with nothing beside
//! them, were of something that went. Voxels of the world; bounded; it says nothing of a thing's way or speed, nor that something
//! moves where its place is seen for the first time. Source: thesis, "Differencing"; the rest is ours.

mod config;

pub use config::MovingConfig;

use crate::column_bits::ColumnBits;
use crate::columns::View;
use crate::returns::Returns;
use std::collections::BTreeMap;
use tsense_geometry::{NS_PER_S, Raster, RasterShape, Timestamp, VoxelIndex};

/// Returns that came are put together for this long, nanoseconds: what a sweep needs to pass a person.
const GATHER_NS: i64 = NS_PER_S;
/// Most voxels of which it is judged at once whether something came, and whether something went: twenty people; a few
/// milliseconds. Newer ones are left out.
const JUDGED_MAX: usize = 2048;
/// Most voxels in which something that moves was met: eighty people. Newer ones are left out.
const MARKED_MAX: usize = 8192;

/// Largest share of the voxels of something that went that may lie beside what stays: its feet.
const BESIDE_MAX: f64 = 0.25;

/// What was met in a voxel in the last while.
#[derive(Clone, Copy, Debug)]
struct Met {
    returns: usize,
    /// Whether it was free before.
    came: bool,
    /// When something was last met, nanoseconds.
    stamp_ns: i64,
}

/// Something that moves was met in a voxel.
#[derive(Clone, Copy, Debug)]
struct Mark {
    /// When it was, or when it was gone, nanoseconds.
    stamp_ns: i64,
    /// Whether it is not known to be gone.
    is_there: bool,
}

/// What is remembered of things that move.
#[derive(Default)]
pub struct Moving {
    /// The snapshot before.
    before: Option<Before>,
    met: BTreeMap<VoxelIndex, Met>,
    /// Voxels that were occupied and are passed now, and since when, nanoseconds.
    went: BTreeMap<VoxelIndex, i64>,
    /// Voxels whose returns are no part of the world.
    marked: BTreeMap<VoxelIndex, Mark>,
    /// Columns of the view in which there is such a voxel; empty where there is none at all.
    columns: Vec<bool>,
    frame: Frame,
}

/// Where the voxels of a view lie in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Frame {
    first: VoxelIndex,
    width: usize,
    height: usize,
    levels: usize,
    cell_m: f64,
}

struct Before {
    frame: Frame,
    view: View,
}

impl Frame {
    fn of(view: &View) -> Self {
        let RasterShape { first_cell: [x, y], width, height, cell_m } = view.shape;
        Self { first: [x, y, view.first_level], width, height, levels: view.levels, cell_m }
    }

    /// Column and level of a voxel, if it lies in the view.
    fn place(&self, voxel: VoxelIndex) -> Option<(usize, usize)> {
        let at = |axis: usize, count: usize| {
            usize::try_from(i64::from(voxel[axis]) - i64::from(self.first[axis])).ok().filter(|i| *i < count)
        };
        Some((at(1, self.height)? * self.width + at(0, self.width)?, at(2, self.levels)?))
    }

    fn voxel(&self, column: usize, level: usize) -> VoxelIndex {
        let [x, y, z] = self.first;
        [x + (column % self.width) as i32, y + (column / self.width) as i32, z + level as i32]
    }

    fn level(&self, z_m: f32) -> usize {
        (f64::from(z_m) / self.cell_m).max(0.0) as usize
    }
}

impl Before {
    fn holds(&self, bits: &ColumnBits, voxel: VoxelIndex) -> bool {
        self.frame.place(voxel).is_some_and(|(column, level)| bits.contains(column, level))
    }
}

impl Moving {
    /// Takes down what the fresh returns of a snapshot show to move; remembers the snapshot for the next one.
    pub(crate) fn look(&mut self, view: &View, returns: &Returns, stamp: Timestamp, config: &MovingConfig) {
        self.frame = Frame::of(view);
        let frame = self.frame;
        let keep_ns = (config.keep_s * NS_PER_S as f64) as i64;
        // Not in the future either, should the clock be set back.
        let is_recent = |ns: i64, within_ns: i64| stamp.ns.saturating_sub(ns).saturating_abs() <= within_ns;
        self.met.retain(|_, met| is_recent(met.stamp_ns, GATHER_NS));
        self.went.retain(|_, went_ns| is_recent(*went_ns, GATHER_NS));
        self.marked.retain(|voxel, mark| is_recent(mark.stamp_ns, keep_ns) && frame.place(*voxel).is_some());
        if self.before.as_ref().is_some_and(|before| before.frame.cell_m == frame.cell_m) {
            returns.each_fresh(view, |column, z_m| self.meet(frame.voxel(column, frame.level(z_m)), stamp));
            self.judge_met(config);
            self.miss(view, stamp);
            self.judge_went(view, stamp, config);
        }
        self.before = Some(Before { frame, view: view.clone() });
        self.columns.clear();
        if !self.marked.is_empty() {
            self.columns.resize(view.shape.len(), false);
            for (column, _) in self.marked.keys().filter_map(|voxel| frame.place(*voxel)) {
                self.columns[column] = true;
            }
        }
    }

    /// Whether what was met at a height of a column, metres above the view's base, is no part of the world.
    pub(crate) fn holds(&self, column: usize, z_m: f32) -> bool {
        !self.columns.is_empty()
            && self.columns[column]
            && self.marked.contains_key(&self.frame.voxel(column, self.frame.level(z_m)))
    }

    /// The cells in which, or beside which, something that moves was met not long ago.
    pub(crate) fn cells(&self, shape: RasterShape, stamp: Timestamp, config: &MovingConfig) -> Raster<bool> {
        let mut cells = Raster::filled(shape, false);
        let hold_ns = (config.hold_s * NS_PER_S as f64) as i64;
        for (voxel, _) in
            self.marked.iter().filter(|(_, mark)| mark.is_there && stamp.ns.saturating_sub(mark.stamp_ns) <= hold_ns)
        {
            let Some((column, _)) = self.frame.place(*voxel) else { continue };
            shape.around((column % shape.width, column / shape.width), 1).for_each(|cell| cells[cell] = true);
        }
        cells
    }

    /// A fresh return in a voxel.
    fn meet(&mut self, voxel: VoxelIndex, stamp: Timestamp) {
        let came = self.comes(voxel);
        if !came && !self.met.contains_key(&voxel) && !self.marked.contains_key(&voxel) {
            return;
        }
        if self.met.len() < JUDGED_MAX || self.met.contains_key(&voxel) {
            let met = self.met.entry(voxel).or_insert(Met { returns: 0, came: false, stamp_ns: 0 });
            *met = Met { returns: met.returns + 1, came: met.came || came, stamp_ns: stamp.ns };
        }
    }

    /// Whether a voxel was free, and what is around it held nothing but what moves.
    fn comes(&self, voxel: VoxelIndex) -> bool {
        let Some(before) = self.before.as_ref().filter(|before| before.holds(&before.view.free, voxel)) else {
            return false;
        };
        let is_still = |at: VoxelIndex| {
            before.holds(&before.view.touched, at) && !self.met.contains_key(&at) && !self.marked.contains_key(&at)
        };
        !around(voxel).any(is_still)
    }

    /// Marks what moves among the voxels that were met. A group that was met again where it was before has come to stay.
    fn judge_met(&mut self, config: &MovingConfig) {
        for group in groups(&self.met) {
            let came = group.iter().filter(|(_, met)| met.came).count();
            let returns: usize = group.iter().map(|(_, met)| met.returns).sum();
            if 2 * came >= group.len() && returns >= config.returns_min && self.is_tall(&group, config) {
                self.mark(group.iter().map(|(voxel, met)| (*voxel, Mark { stamp_ns: met.stamp_ns, is_there: true })));
                continue;
            }
            for (voxel, met) in group {
                let is_old = |mark: &Mark| !mark.is_there || met.stamp_ns.saturating_sub(mark.stamp_ns) > GATHER_NS;
                if self.marked.get(&voxel).is_some_and(is_old) {
                    self.marked.remove(&voxel);
                }
            }
        }
    }

    /// Takes down what was occupied in the snapshot before and is passed in this one.
    fn miss(&mut self, view: &View, stamp: Timestamp) {
        let Some(before) = &self.before else { return };
        let (was, frame) = (&before.view, self.frame);
        // Where the window has not moved, whole columns compare at once.
        let stands = before.frame == frame;
        for word in 0..was.touched.words() {
            let planes = was.touched.plane(word).iter().zip(was.free.plane(word)).enumerate();
            let met = planes.map(|(column, (touched, free))| {
                let passed = if stands { view.free.plane(word)[column] } else { u64::MAX };
                (column, touched & !free & passed)
            });
            for (column, bits) in met.filter(|(_, bits)| *bits != 0) {
                let levels = (0..64).filter(|level| bits >> level & 1 == 1).map(|level| 64 * word + level);
                for voxel in levels.map(|level| before.frame.voxel(column, level)) {
                    let is_passed = frame.place(voxel).is_some_and(|(column, level)| view.free.contains(column, level));
                    if is_passed && self.went.len() < JUDGED_MAX {
                        self.went.insert(voxel, stamp.ns);
                    }
                }
            }
        }
    }

    /// Marks what went among the voxels that were left: a group beside which little stays.
    fn judge_went(&mut self, view: &View, stamp: Timestamp, config: &MovingConfig) {
        for group in groups(&self.went) {
            let is_occupied = |at: VoxelIndex| {
                self.frame.place(at).is_some_and(|(column, level)| view.occupied.contains(column, level))
            };
            let beside = group.iter().filter(|(voxel, _)| around(*voxel).any(is_occupied)).count();
            let is_alone = beside as f64 <= BESIDE_MAX * group.len() as f64;
            if is_alone && group.len() >= config.returns_min && self.is_tall(&group, config) {
                self.mark(group.iter().map(|(voxel, _)| (*voxel, Mark { stamp_ns: stamp.ns, is_there: false })));
            }
        }
    }

    fn is_tall<T>(&self, group: &[(VoxelIndex, T)], config: &MovingConfig) -> bool {
        let levels = || group.iter().map(|(voxel, _)| voxel[2]);
        let span = levels().max().zip(levels().min()).map_or(0, |(high, low)| high - low + 1);
        f64::from(span) * self.frame.cell_m >= config.height_min_m
    }

    fn mark(&mut self, marks: impl Iterator<Item = (VoxelIndex, Mark)>) {
        for (voxel, mark) in marks {
            if self.marked.len() < MARKED_MAX || self.marked.contains_key(&voxel) {
                self.marked.insert(voxel, mark);
            }
        }
    }
}

/// Voxels that touch by a face, an edge or a corner, together.
fn groups<T: Copy>(voxels: &BTreeMap<VoxelIndex, T>) -> Vec<Vec<(VoxelIndex, T)>> {
    let (mut left, mut groups) = (voxels.clone(), Vec::new());
    while let Some(first) = left.pop_first() {
        let (mut group, mut next) = (vec![first], 0);
        while let Some((voxel, _)) = group.get(next).copied() {
            group.extend(around(voxel).filter_map(|at| left.remove_entry(&at)));
            next += 1;
        }
        groups.push(group);
    }
    groups
}

/// A voxel and the 26 around it.
fn around([x, y, z]: VoxelIndex) -> impl Iterator<Item = VoxelIndex> {
    (0..27).map(move |i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1])
}

#[cfg(test)]
mod tests;
