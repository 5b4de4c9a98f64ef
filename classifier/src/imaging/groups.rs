//! Groups of voxels that touch by a face, an edge or a corner.
//!
//! In: a set of voxels and the shape of the view that it belongs to. Out: the groups, each as (column, level), in order of
//! their first column. Plain flood filling; each voxel is looked at once.

use crate::column_bits::ColumnBits;
use crate::columns::View;

/// A voxel of a view: its column and its level.
pub type Place = (usize, usize);

/// The groups of a set of voxels.
pub(super) fn groups(bits: ColumnBits, view: &View) -> Vec<Vec<Place>> {
    let (mut open, mut groups) = (bits, Vec::new());
    for column in 0..open.columns() {
        while let Some(level) = open.lowest(column, 0, view.levels) {
            groups.push(grow(&mut open, view, (column, level)));
        }
    }
    groups
}

/// Takes the group that holds `seed` out of `open`.
fn grow(open: &mut ColumnBits, view: &View, seed: Place) -> Vec<Place> {
    open.remove(seed.0, seed.1);
    let (mut group, mut next) = (vec![seed], 0);
    while next < group.len() {
        let (column, level) = group[next];
        next += 1;
        let (x, y) = (column % view.shape.width, column / view.shape.width);
        for y in y.saturating_sub(1)..(y + 2).min(view.shape.height) {
            for x in x.saturating_sub(1)..(x + 2).min(view.shape.width) {
                let column = y * view.shape.width + x;
                while let Some(level) = open.lowest(column, level.saturating_sub(1), level + 2) {
                    open.remove(column, level);
                    group.push((column, level));
                }
            }
        }
    }
    group
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_geometry::VoxelGrid;

    #[test]
    fn corners_touch_and_a_voxel_between_parts() {
        let view = View::unknown(Window { first: [0; 3], size: [8, 8, 8] }, VoxelGrid::new(0.15).unwrap());
        let mut bits = ColumnBits::empty(64, 8);
        // (0, 0, 0) and (1, 1, 1) touch by a corner; (3, 3, 1) is two steps off; column 7 and the next row do not touch.
        for (column, level) in [(0, 0), (9, 1), (27, 1), (7, 5), (8, 5)] {
            bits.insert(column, level);
        }
        let found = groups(bits, &view);
        assert_eq!(found, [vec![(0, 0), (9, 1)], vec![(7, 5)], vec![(8, 5)], vec![(27, 1)]]);
    }
}
