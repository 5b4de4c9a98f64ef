//! Segments whose runs are few and long: one by one, tile by tile.

use super::{Miss, Rows, ones};
use crate::marks::{IN_TILE, MarkField, Room, TILE_BITS};
use crate::runs::{Segment, TakeRuns, flat_runs};

/// Marks the runs of a flat segment; how many voxels it crosses. Nothing where the plain walk must mark.
#[inline(always)]
#[allow(unsafe_code, reason = "positions are promised to be of this window")]
pub fn trace_flat(field: &mut MarkField, segment: &Segment, miss: Miss) -> Option<u64> {
    let rows = Rows::of(field, segment);
    let room = field.room(miss.level, segment.axes[0]);
    let mut path = FlatPath { room, rows, used: 0, is_full: false };
    let is_sure = flat_runs(segment, miss.along_min(segment.lengths), &mut path);
    path.room.raise_some();
    let (used, waiting, is_full) = (path.used, path.room.waiting(), path.is_full);
    if !is_sure || is_full {
        return None;
    }
    // SAFETY: the window holds both ends, and the path is sure.
    unsafe { field.found(used, waiting) };
    Some(segment.voxels())
}

/// The runs of a flat segment, tile by tile.
struct FlatPath<'a> {
    room: Room<'a>,
    rows: Rows,
    used: usize,
    is_full: bool,
}

impl TakeRuns for FlatPath<'_> {
    #[inline(always)]
    fn take(&mut self, [first, last]: [i32; 2], row: [i32; 2]) {
        let [main, second, third] = self.rows.strides;
        let row = self.rows.first + second.at(row[0]) + third.at(row[1]);
        for tile in first >> TILE_BITS..=last >> TILE_BITS {
            let begin = tile << TILE_BITS;
            let (from, to) = ((first - begin).max(0), (last - begin).min(IN_TILE));
            match (self.room.positions.get_mut(self.used), self.room.bits.get_mut(self.used)) {
                (Some(position), Some(bits)) => {
                    (*position, *bits) = ((row + tile * main.tile()) as u32, ones(to - from + 1) << from);
                    self.used += 1;
                }
                _ => self.is_full = true,
            }
        }
    }
}
