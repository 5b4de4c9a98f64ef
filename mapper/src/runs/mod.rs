//! The fast ray walk: run by run along the axis on which the segment is longest, its main axis.
//!
//! A run is what a segment crosses of one row of voxels along the main axis. The segment is cut into slabs along its
//! second longest axis, one voxel thick; where it crosses their faces is a multiplication and an addition in fixed
//! point, so no slab waits for the one before, and many of them go through the same instructions at once. In each
//! slab the third axis' index rises by one at most: a slab holds one run or two. Beams that are nearly parallel to
//! the main axis have few and long runs, which [`flat_runs`] finds one by one.
//!
//! In: two points in voxel units, not below zero. Out: for each run where it begins and ends on the main axis, and
//! the indices of its row. The voxels are those of `geometry::ray_walk`: where fixed point cannot tell which face
//! comes first, the walk says so and the caller takes the plain one. No branch depends on a lane, so that a loop over
//! the lanes becomes vectors. A segment is walked towards higher indices of the main axis; on another axis on which
//! it falls it is turned round, index `i` to `-1 - i`, so that it never falls.

mod flat;
mod segment;
mod slabs;
#[cfg(test)]
mod tests;

use crate::marks::TILE_BITS;

pub use flat::{TakeRuns, flat_runs};
pub use segment::{ORDERS, Segment};
pub use slabs::{Faces, Group, Line, Slab, Slabs, THIRD_MIN, doubt, mask};

/// Slabs of a group: these share an anchor. As many as a tile has voxels on an axis, so that a group's rows are a
/// tile's.
pub const LANES: usize = 1 << TILE_BITS;

/// Bits behind the point in a lane: before it fits what sixteen slabs run through, from a tile's first voxel on, in a
/// `u32`.
pub const FRACTION_BITS: u32 = 24;
pub const ONE: u32 = 1 << FRACTION_BITS;

/// Bits behind the point of a group's begin, in an `i64`: the slope's rounding, a thousand slabs on, is below a lane's.
pub const LONG_BITS: u32 = 40;
pub const LONG_ONE: f64 = (1u64 << LONG_BITS) as f64;

/// Closer to a face than this is too close to call: slope and start are rounded down to 2^-24, 17 times at most.
pub const DOUBT: u32 = 1 << 5;

/// Shortest way along the main axis that is walked here, voxels.
pub const LENGTH_MIN: f64 = 1e-2;

/// Voxels along the main axis for a slab, at most: sixteen slabs from anywhere in a tile stay below 2^8 voxels, and a
/// run is of [`RUN_MAX`] voxels at most.
pub const STEEP_MAX: f64 = 13.0;
pub const RUN_MAX: usize = 14;
