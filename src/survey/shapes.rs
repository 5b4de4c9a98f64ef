//! From cells to shapes: groups of touching cells, their outlines, their length and width.
//!
//! In: which cells of a raster belong together. Out: groups of cell indices, and for a group its outline as polygons with
//! holes, metres, that run along the cells' edges. Parts of a group that touch by a corner only are polygons of their
//! own, so that every ring is simple.

use std::collections::{BTreeMap, BTreeSet};
use tsense_geometry::RasterShape;

/// A closed line of corners, the first one repeated; outer rings run counter-clockwise, holes clockwise.
pub type Ring = Vec<[f64; 2]>;

/// The groups of cells that touch each other, by an edge or by a corner, in the order of their first cells.
pub fn groups(shape: RasterShape, belongs: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let open = (0..shape.len()).filter(|i| belongs(*i)).collect();
    components(shape, open, true)
}

/// Components of a set of cells.
fn components(shape: RasterShape, mut open: BTreeSet<usize>, by_corners: bool) -> Vec<Vec<usize>> {
    let mut found = Vec::new();
    while let Some(first) = open.pop_first() {
        let (mut group, mut next) = (vec![first], 0);
        while let Some(&cell) = group.get(next) {
            next += 1;
            for neighbour in neighbours(shape, cell, by_corners) {
                if open.remove(&neighbour) {
                    group.push(neighbour);
                }
            }
        }
        group.sort_unstable();
        found.push(group);
    }
    found
}

/// The cells that touch a cell by an edge, or by a corner too.
pub fn neighbours(shape: RasterShape, cell: usize, by_corners: bool) -> impl Iterator<Item = usize> {
    let (x, y) = ((cell % shape.width) as i64, (cell / shape.width) as i64);
    let steps = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]];
    steps.into_iter().take(if by_corners { 8 } else { 4 }).filter_map(move |[dx, dy]| {
        let (x, y) = (x + dx, y + dy);
        let inside = (0..shape.width as i64).contains(&x) && (0..shape.height as i64).contains(&y);
        inside.then(|| y as usize * shape.width + x as usize)
    })
}

/// The outline of a group: a polygon a part, each its outer ring and then its holes.
pub fn outline(shape: RasterShape, group: &[usize]) -> Vec<Vec<Ring>> {
    let parts = components(shape, group.iter().copied().collect(), false);
    parts.iter().map(|part| polygon(shape, part)).collect()
}

/// Corners of cells are counted from the raster's south-western one.
type Corner = [i64; 2];

fn polygon(shape: RasterShape, part: &[usize]) -> Vec<Ring> {
    let mut rings: Vec<Vec<Corner>> = Vec::new();
    let mut edges = edges(shape, part);
    while let Some((&start, _)) = edges.first_key_value() {
        rings.push(ring(&mut edges, start));
    }
    // The outer ring holds the most.
    rings.sort_by_key(|ring| -doubled_area(ring));
    let place =
        |corner: &Corner| [0, 1].map(|axis| (i64::from(shape.first_cell[axis]) + corner[axis]) as f64 * shape.cell_m);
    rings.iter().map(|ring| ring.iter().map(place).collect()).collect()
}

/// The edges between cells of a part and others, by where they start; the part lies to their left.
fn edges(shape: RasterShape, part: &[usize]) -> BTreeMap<Corner, Vec<Corner>> {
    let cells: BTreeSet<Corner> = part.iter().map(|i| [(i % shape.width) as i64, (i / shape.width) as i64]).collect();
    let mut edges: BTreeMap<Corner, Vec<Corner>> = BTreeMap::new();
    for &[x, y] in &cells {
        let sides = [
            ([x, y - 1], [x, y], [x + 1, y]),
            ([x + 1, y], [x + 1, y], [x + 1, y + 1]),
            ([x, y + 1], [x + 1, y + 1], [x, y + 1]),
            ([x - 1, y], [x, y + 1], [x, y]),
        ];
        for (_, from, to) in sides.into_iter().filter(|(beyond, ..)| !cells.contains(beyond)) {
            edges.entry(from).or_default().push(to);
        }
    }
    edges
}

/// Takes one ring out of the edges. Where two ways lead on, the left one stays with the same cell.
fn ring(edges: &mut BTreeMap<Corner, Vec<Corner>>, start: Corner) -> Vec<Corner> {
    let (mut corners, mut at, mut way) = (vec![start], start, [0, 0]);
    while let Some(ways) = edges.get_mut(&at) {
        let turn = |to: &Corner| way[0] * (to[1] - at[1]) - way[1] * (to[0] - at[0]);
        let left = (0..ways.len()).max_by_key(|i| turn(&ways[*i])).unwrap_or(0);
        let to = ways.swap_remove(left);
        if ways.is_empty() {
            edges.remove(&at);
        }
        let next = [to[0] - at[0], to[1] - at[1]];
        if next == way {
            corners.pop();
        }
        corners.push(to);
        (at, way) = (to, next);
        if at == start {
            break;
        }
    }
    corners
}

/// Twice the area inside a ring, cells; negative where it runs clockwise.
fn doubled_area(ring: &[Corner]) -> i64 {
    ring.windows(2).map(|pair| pair[0][0] * pair[1][1] - pair[1][0] * pair[0][1]).sum()
}

/// Length and width of a group along its principal axes, metres: whole cells.
pub fn length_and_width_m(shape: RasterShape, group: &[usize]) -> [f64; 2] {
    let places: Vec<[f64; 2]> = group.iter().map(|i| shape.center_of(i % shape.width, i / shape.width)).collect();
    let count = places.len() as f64;
    let mean = [0, 1].map(|axis| places.iter().map(|p| p[axis]).sum::<f64>() / count);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for [x, y] in places.iter().map(|p| [p[0] - mean[0], p[1] - mean[1]]) {
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    let axis = f64::atan2(2.0 * xy, xx - yy) / 2.0;
    let along = |cos: f64, sin: f64| {
        let ends = places.iter().map(|p| (p[0] - mean[0]) * cos + (p[1] - mean[1]) * sin);
        let (low, high) = ends.fold((0.0f64, 0.0f64), |(low, high), at| (low.min(at), high.max(at)));
        high - low + shape.cell_m
    };
    let sides = [along(axis.cos(), axis.sin()), along(-axis.sin(), axis.cos())];
    [sides[0].max(sides[1]), sides[0].min(sides[1])]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A raster of unit cells from a drawing, its last line the southernmost.
    fn drawn(lines: &[&str]) -> (RasterShape, Vec<Vec<usize>>) {
        let shape = RasterShape { first_cell: [10, 20], width: lines[0].len(), height: lines.len(), cell_m: 1.0 };
        let is_set = |i: usize| lines[lines.len() - 1 - i / shape.width].as_bytes()[i % shape.width] == b'#';
        (shape, groups(shape, is_set))
    }

    #[test]
    fn a_ring_of_cells_has_a_hole_and_corners_only() {
        let (shape, groups) = drawn(&["###.", "#.#.", "###.", "...#"]);
        assert_eq!(groups.len(), 1, "cells that touch by a corner are one group");
        let polygons = outline(shape, &groups[0]);
        assert_eq!(polygons.len(), 2, "but two polygons");
        let lonely = vec![[13.0, 20.0], [14.0, 20.0], [14.0, 21.0], [13.0, 21.0], [13.0, 20.0]];
        assert_eq!(polygons[0], [lonely]);
        let outer = vec![[10.0, 21.0], [13.0, 21.0], [13.0, 24.0], [10.0, 24.0], [10.0, 21.0]];
        let hole = vec![[11.0, 22.0], [11.0, 23.0], [12.0, 23.0], [12.0, 22.0], [11.0, 22.0]];
        assert_eq!(polygons[1], [outer, hole]);
    }

    /// Rings enclose as many cells as there are, whatever the drawing.
    #[test]
    fn outlines_enclose_their_cells_and_every_ring_closes() {
        let mut compared = 0;
        for seed in 0..200u32 {
            let shape = RasterShape { first_cell: [0; 2], width: 9, height: 9, cell_m: 1.0 };
            let noise =
                |i: usize| (seed.wrapping_mul(2_654_435_761) ^ (i as u32 * 40_503)).wrapping_mul(2_246_822_519) >> 30;
            for group in groups(shape, |i| noise(i) < 2) {
                let rings: Vec<Ring> = outline(shape, &group).into_iter().flatten().collect();
                let area =
                    |ring: &Ring| ring.windows(2).map(|p| p[0][0] * p[1][1] - p[1][0] * p[0][1]).sum::<f64>() / 2.0;
                assert_eq!(rings.iter().map(area).sum::<f64>(), group.len() as f64);
                assert!(rings.iter().all(|ring| ring.first() == ring.last() && ring.len() >= 5));
                compared += 1;
            }
        }
        assert!(compared > 500, "{compared}");
    }

    #[test]
    fn a_slanting_wall_is_as_long_as_it_is() {
        let shape = RasterShape { first_cell: [0; 2], width: 100, height: 100, cell_m: 0.1 };
        let wall = (0..60).map(|i| (10 + i) * 100 + 20 + i).collect::<Vec<_>>();
        let [length, width] = length_and_width_m(shape, &wall);
        assert!(
            (length - (59.0 * 0.1 * 2f64.sqrt() + 0.1)).abs() < 1e-6 && (width - 0.1).abs() < 1e-6,
            "{length} {width}"
        );
    }
}
