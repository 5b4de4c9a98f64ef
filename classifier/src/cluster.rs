//! Clusters of touching cells (also by their corners). Source: thesis figure 2-22, with a stack instead of its loops.
//!
//! In: a raster and a test. Out: the cells of each cluster, clusters in the order of their first cell.

use tsense_geometry::Raster;

/// A cell as (column, row).
pub type Cell = (usize, usize);

/// Groups the cells that pass `test`.
pub fn clusters<T>(raster: &Raster<T>, test: impl Fn(&T) -> bool) -> Vec<Vec<Cell>> {
    let shape = raster.shape();
    let mut open: Vec<bool> = raster.cells().iter().map(test).collect();
    let mut found = Vec::new();
    for seed in 0..open.len() {
        if open[seed] {
            open[seed] = false;
            found.push(grow(&mut open, shape.width, shape.height, (seed % shape.width, seed / shape.width)));
        }
    }
    found
}

fn grow(open: &mut [bool], width: usize, height: usize, seed: Cell) -> Vec<Cell> {
    let (mut cluster, mut next) = (vec![seed], 0);
    while next < cluster.len() {
        let (column, row) = cluster[next];
        next += 1;
        for row in row.saturating_sub(1)..(row + 2).min(height) {
            for column in column.saturating_sub(1)..(column + 2).min(width) {
                if std::mem::take(&mut open[row * width + column]) {
                    cluster.push((column, row));
                }
            }
        }
    }
    cluster
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_geometry::RasterShape;

    #[test]
    fn touching_cells_are_one_cluster_and_a_gap_parts_them() {
        let drawing = "##..#\n\
                       ..#..\n\
                       .....\n\
                       #...#";
        let cells: Vec<bool> = drawing.chars().filter(|c| *c != '\n').map(|c| c == '#').collect();
        let shape = RasterShape { first_cell: [0, 0], width: 5, height: 4, cell_m: 1.0 };
        let found = clusters(&Raster::from_cells(shape, cells).unwrap(), |set| *set);
        let sizes: Vec<_> = found.iter().map(Vec::len).collect();
        assert_eq!(sizes, [3, 1, 1, 1]);
        assert_eq!(found[0], [(0, 0), (1, 0), (2, 1)]);
    }
}
