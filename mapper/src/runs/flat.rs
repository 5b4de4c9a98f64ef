//! Segments that are nearly parallel to their main axis: few runs, of any length, one by one in `f64`.

use super::Segment;

/// Closer together than this on the main axis, voxels, two crossings may come in either order: rounding is below a
/// thousandth of it.
const NEAR: f64 = 1e-8;

/// What takes runs; no closure, for that would be a call for each.
pub trait TakeRuns {
    /// Takes a run: its first and last voxels on the main axis, and the indices of its row on the two others. Where
    /// the last lies before the first, it has no voxel that counts.
    fn take(&mut self, voxels: [i32; 2], row: [i32; 2]);
}

/// Finds the runs of a segment. Voxels in which the segment runs less than `along_min` along the main axis do not
/// count. False where the path is in doubt; what was found before is right all the same.
#[inline(always)]
pub fn flat_runs(segment: &Segment, along_min: f64, runs: &mut impl TakeRuns) -> bool {
    let mut crossings = [Crossings::new(segment, 1), Crossings::new(segment, 2)];
    let mut row = [segment.start[1] as i32, segment.start[2] as i32];
    let mut enter = segment.start[0];
    while crossings[0].left + crossings[1].left > 0 {
        let [second, third] = crossings.each_ref().map(|crossings| crossings.next);
        let first = usize::from(third < second);
        let leave = crossings[first].next.min(segment.end[0]);
        if (second - third).abs() < NEAR || from_face(leave) < NEAR {
            return false;
        }
        emit(enter, leave, along_min, row, runs);
        row[first] += crossings[first].step;
        crossings[first].cross(segment.start[0]);
        enter = leave;
    }
    emit(enter, segment.end[0], along_min, row, runs);
    true
}

/// The faces of an axis that a segment crosses.
struct Crossings {
    left: u32,
    step: i32,
    /// The next one's distance from the start along this axis, and where that is on the main axis.
    distance: f64,
    next: f64,
    per_voxel: f64,
}

impl Crossings {
    #[inline(always)]
    fn new(segment: &Segment, axis: usize) -> Self {
        let (from, to) = (segment.start[axis] as i32, segment.end[axis] as i32);
        let face = from + i32::from(to > from);
        let mut crossings = Self {
            left: from.abs_diff(to),
            step: (to - from).signum(),
            distance: (f64::from(face) - segment.start[axis]).abs(),
            next: f64::INFINITY,
            per_voxel: segment.lengths[0] / segment.lengths[axis],
        };
        crossings.find_next(segment.start[0]);
        crossings
    }

    #[inline(always)]
    fn cross(&mut self, start: f64) {
        self.left -= 1;
        self.distance += 1.0;
        self.find_next(start);
    }

    #[inline(always)]
    fn find_next(&mut self, start: f64) {
        self.next = if self.left > 0 { start + self.distance * self.per_voxel } else { f64::INFINITY };
    }
}

/// How far a position is from the nearest face.
#[inline(always)]
fn from_face(at: f64) -> f64 {
    (at - f64::from((at + 0.5) as i32)).abs()
}

#[inline(always)]
fn emit(enter: f64, leave: f64, along_min: f64, row: [i32; 2], runs: &mut impl TakeRuns) {
    if along_min <= 0.0 {
        runs.take([enter as i32, leave as i32], row);
    } else if leave - enter >= along_min {
        let (first, last) = (enter + along_min, leave - along_min);
        // Where that is a face, the voxel before it counts just so.
        let is_face = first == f64::from(first as i32);
        runs.take([first as i32 - i32::from(is_face), last as i32], row);
    }
}
