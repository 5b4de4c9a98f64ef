//! Segments whose runs are few and long: one by one, tile by tile.

use super::{Miss, Rows, ones};
use crate::marks::{IN_TILE, MarkField, Room, TILE_BITS};
use crate::runs::{Segment, flat_runs};

/// Marks the runs of a flat segment; how many voxels it crosses. Nothing where the plain walk must mark.
#[inline(always)]
#[allow(unsafe_code, reason = "positions are promised to be of this window")]
pub fn trace_flat(field: &mut MarkField, segment: &Segment, miss: Miss) -> Option<u64> {
    let rows = Rows::of(field, segment);
    let mut room = field.room(miss.level, segment.axes[0]);
    let found = find_flat(&mut room, segment, &rows, miss.along_min(segment.lengths));
    let waiting = room.waiting();
    // SAFETY: the window holds both ends, and the path is sure.
    unsafe { field.found(found?, waiting) };
    Some(segment.voxels())
}

/// The runs of a flat segment, tile by tile; how many. Nothing where its path is in doubt.
#[inline(always)]
fn find_flat(room: &mut Room<'_>, segment: &Segment, rows: &Rows, along_min: f64) -> Option<usize> {
    let [main, second, third] = rows.strides;
    let (mut used, mut is_full) = (0, false);
    let is_sure = flat_runs(segment, along_min, |[first, last], row| {
        let row = rows.first + second.at(row[0]) + third.at(row[1]);
        for tile in first >> TILE_BITS..=last >> TILE_BITS {
            let begin = tile << TILE_BITS;
            let (from, to) = ((first - begin).max(0), (last - begin).min(IN_TILE));
            match (room.positions.get_mut(used), room.bits.get_mut(used)) {
                (Some(position), Some(bits)) => {
                    (*position, *bits) = ((row + tile * main.tile()) as u32, ones(to - from + 1) << from);
                    used += 1;
                }
                _ => is_full = true,
            }
        }
    });
    room.raise_some();
    (is_sure && !is_full).then_some(used)
}
