//! Differencing: what moved between two snapshots of one place.
//!
//! In: two views of one window and the least number of touching voxels that count as a change (single voxels flicker
//! at the rim of every surface). Out: voxels that were free and became occupied, and the other way round. A voxel that
//! was unknown in either is no change: it was seen for the first time, or is hidden now.

use super::groups::groups;
use crate::column_bits::ColumnBits;
use crate::columns::View;

/// Voxels that changed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Changes {
    /// Free before, occupied now.
    pub appeared: ColumnBits,
    /// Occupied before, free now.
    pub vanished: ColumnBits,
}

/// Voxels whose state turned over from `before` to `after`, or nothing where the two show different windows.
pub fn difference(before: &View, after: &View, touching_min: usize) -> Option<Changes> {
    let same = before.shape == after.shape && (before.first_level, before.levels) == (after.first_level, after.levels);
    same.then(|| Changes {
        appeared: without_flicker(both(&before.free, &after.occupied), after, touching_min),
        vanished: without_flicker(both(&before.occupied, &after.free), after, touching_min),
    })
}

fn both(a: &ColumnBits, b: &ColumnBits) -> ColumnBits {
    let mut both = a.clone();
    both.bits_mut().iter_mut().zip(b.bits()).for_each(|(bits, other)| *bits &= other);
    both
}

/// Drops groups of fewer than `touching_min` voxels that touch by a face, an edge or a corner.
fn without_flicker(bits: ColumnBits, view: &View, touching_min: usize) -> ColumnBits {
    let mut kept = ColumnBits::empty(bits.columns(), view.levels);
    let large = groups(bits, view).into_iter().filter(|group| group.len() >= touching_min);
    large.flatten().for_each(|(column, level)| kept.insert(column, level));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_geometry::VoxelGrid;

    fn empty() -> View {
        View::unknown(Window { first: [0; 3], size: [20, 20, 80] }, VoxelGrid::new(0.15).unwrap())
    }

    /// A person of 3 x 3 x 12 voxels at a column, in free space.
    fn person_at(x: usize) -> View {
        let mut view = empty();
        for (column, level) in (0..400).flat_map(|column| (56..80).map(move |level| (column, level))) {
            let inside = (x..x + 3).contains(&(column % 20)) && (8..11).contains(&(column / 20)) && level < 68;
            if inside { view.occupied.insert(column, level) } else { view.free.insert(column, level) }
        }
        view
    }

    fn count(bits: &ColumnBits) -> usize {
        (0..400).map(|column| bits.count(column, 0, 80)).sum()
    }

    #[test]
    fn a_person_who_walked_appears_where_he_is_and_vanishes_where_he_was() {
        let changes = difference(&person_at(4), &person_at(12), 4).unwrap();
        assert_eq!((count(&changes.appeared), count(&changes.vanished)), (108, 108));
        assert!(changes.appeared.contains(9 * 20 + 13, 64) && changes.vanished.contains(9 * 20 + 5, 60));
    }

    #[test]
    fn what_was_unknown_is_no_change_and_flicker_is_dropped() {
        let changes = difference(&empty(), &person_at(4), 1).unwrap();
        assert_eq!(count(&changes.appeared), 0);
        let (before, mut after) = (person_at(4), person_at(4));
        after.free.remove(0, 70);
        after.occupied.insert(0, 70);
        assert_eq!(count(&difference(&before, &after, 1).unwrap().appeared), 1);
        assert_eq!(count(&difference(&before, &after, 2).unwrap().appeared), 0);
    }

    #[test]
    fn two_windows_do_not_compare() {
        let other = View::unknown(Window { first: [4, 0, 0], size: [20, 20, 80] }, VoxelGrid::new(0.15).unwrap());
        assert_eq!(difference(&empty(), &other, 1), None);
    }
}
