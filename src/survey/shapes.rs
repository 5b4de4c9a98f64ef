//! From cells to shapes: groups of touching cells, their outlines, their length and width.
//!
//! In: which cells of a raster belong together. Out: groups as [`Run`]s of cells, and for a group its outline as polygons
//! with holes, metres, that run along the cells' edges. Parts of a group that touch by a corner only are polygons of
//! their own, so that every ring is simple. Memory grows with the runs, so with the length of the outline, not with the
//! area.

use tsense_geometry::RasterShape;

/// A closed line of corners, the first one repeated; outer rings run counter-clockwise, holes clockwise.
pub type Ring = Vec<[f64; 2]>;

/// Row and column of a cell, counted from the origin of the coordinates.
pub type Cell = [i32; 2];

/// Cells of one row beside each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Run {
    /// Their row.
    pub row: i32,
    /// The first column.
    pub from: i32,
    /// The column after the last.
    pub to: i32,
}

impl Run {
    /// Its cells, from west to east.
    pub fn cells(self) -> impl Iterator<Item = Cell> + Clone {
        (self.from..self.to).map(move |column| [self.row, column])
    }
}

/// The groups of cells that touch each other, by an edge or by a corner, in the order of their first cells.
pub fn groups(shape: RasterShape, belongs: impl Fn(Cell) -> bool) -> Vec<Vec<Run>> {
    let [west, south] = shape.first_cell;
    let mut runs: Vec<Run> = Vec::new();
    for row in (south..).take(shape.height) {
        for column in (west..).take(shape.width).filter(|column| belongs([row, *column])) {
            append(&mut runs, Run { row, from: column, to: column + 1 });
        }
    }
    joined(&runs, true)
}

/// Adds a run behind others; where it goes on where the last one ends, they are one.
fn append(runs: &mut Vec<Run>, run: Run) {
    match runs.last_mut() {
        Some(last) if last.row == run.row && last.to == run.from => last.to = run.to,
        _ => runs.push(run),
    }
}

/// The cells of several groups as one.
pub fn union(mut runs: Vec<Run>) -> Vec<Run> {
    runs.sort_unstable();
    let mut all = Vec::with_capacity(runs.len());
    runs.into_iter().for_each(|run| append(&mut all, run));
    all
}

/// Whether a cell is one of a group's.
pub fn holds(runs: &[Run], [row, column]: Cell) -> bool {
    let next = runs.partition_point(|run| (run.row, run.from) <= (row, column));
    next.checked_sub(1).is_some_and(|i| runs[i].row == row && column < runs[i].to)
}

/// The cells around a cell.
pub fn around([row, column]: Cell) -> impl Iterator<Item = Cell> {
    (row - 1..=row + 1).flat_map(move |y| (column - 1..=column + 1).map(move |x| [y, x]))
}

/// Runs by which of them touch, by an edge or by a corner too; each lies behind those south and west of it.
fn joined(runs: &[Run], by_corners: bool) -> Vec<Vec<Run>> {
    let reach = i32::from(by_corners);
    let (mut first, mut below): (Vec<usize>, _) = ((0..runs.len()).collect(), 0);
    for (i, run) in runs.iter().enumerate() {
        let is_past = |other: &Run| (other.row, other.to + reach) <= (run.row - 1, run.from);
        below += runs[below..i].iter().take_while(|other| is_past(other)).count();
        let touching = (below..i).take_while(|j| runs[*j].row < run.row && runs[*j].from < run.to + reach);
        for j in touching {
            let (a, b) = (first_of(&mut first, i), first_of(&mut first, j));
            first[a.max(b)] = a.min(b);
        }
    }
    let mut groups: Vec<Vec<Run>> = vec![Vec::new(); runs.len()];
    for (i, run) in runs.iter().enumerate() {
        groups[first_of(&mut first, i)].push(*run);
    }
    groups.retain(|group| !group.is_empty());
    groups
}

/// The first run that a run is known to be joined to.
fn first_of(first: &mut [usize], mut i: usize) -> usize {
    while first[i] != i {
        first[i] = first[first[i]];
        i = first[i];
    }
    i
}

/// The outline of a group: a polygon a part, each its outer ring and then its holes.
pub fn outline(cell_m: f64, group: &[Run]) -> Vec<Vec<Ring>> {
    joined(group, false).iter().map(|part| polygon(cell_m, part)).collect()
}

/// Corners of cells: column and row of the cell north-east of it.
type Corner = [i32; 2];

fn polygon(cell_m: f64, part: &[Run]) -> Vec<Ring> {
    let mut rings: Vec<Vec<Corner>> = Vec::new();
    let mut edges = Edges::of(part);
    while let Some(start) = edges.first() {
        rings.push(ring(&mut edges, start));
    }
    // The outer ring holds the most.
    rings.sort_by_key(|ring| -doubled_area(ring));
    rings.iter().map(|ring| ring.iter().map(|corner| corner.map(|c| f64::from(c) * cell_m)).collect()).collect()
}

/// The edges between cells of a part and others, sorted by where they start; the part lies to their left.
struct Edges {
    edges: Vec<(Corner, Corner)>,
    is_taken: Vec<bool>,
    next: usize,
}

impl Edges {
    fn of(part: &[Run]) -> Self {
        let mut edges = Vec::new();
        for run in part {
            let Run { row, from, to } = *run;
            edges.extend([([from, row + 1], [from, row]), ([to, row], [to, row + 1])]);
            edges.extend(gaps(part, *run, row - 1).map(|[from, to]| ([from, row], [to, row])));
            edges.extend(gaps(part, *run, row + 1).map(|[from, to]| ([to, row + 1], [from, row + 1])));
        }
        edges.sort_unstable();
        Self { is_taken: vec![false; edges.len()], edges, next: 0 }
    }

    /// Where the first edge starts that was not taken.
    fn first(&mut self) -> Option<Corner> {
        self.next += self.is_taken[self.next..].iter().take_while(|is_taken| **is_taken).count();
        self.edges.get(self.next).map(|edge| edge.0)
    }

    /// Takes the edge that starts at a corner: of two, the one farther to the left of a way.
    fn take(&mut self, at: Corner, way: Corner) -> Option<Corner> {
        let start = self.edges.partition_point(|edge| edge.0 < at);
        let here = (start..self.edges.len()).take_while(|i| self.edges[*i].0 == at).filter(|i| !self.is_taken[*i]);
        let left = here.max_by_key(|i| {
            let next = direction(at, self.edges[*i].1);
            way[0] * next[1] - way[1] * next[0]
        })?;
        self.is_taken[left] = true;
        Some(self.edges[left].1)
    }
}

/// The stretches of a run that have no cell of the part beside them in another row.
fn gaps(part: &[Run], run: Run, row: i32) -> impl Iterator<Item = [i32; 2]> {
    let first = part.partition_point(|other| (other.row, other.to) <= (row, run.from));
    let beside = part[first..].iter().take_while(move |other| other.row == row && other.from < run.to);
    let ends = beside.map(|other| [other.from, other.to]).chain([[run.to; 2]]);
    let gaps = ends.scan(run.from, |from, [start, end]| Some([std::mem::replace(from, end), start]));
    gaps.filter(|[from, to]| from < to)
}

fn direction(from: Corner, to: Corner) -> Corner {
    [0, 1].map(|axis| (to[axis] - from[axis]).signum())
}

/// Takes one ring out of the edges. Where two ways lead on, the left one stays with the same cell.
fn ring(edges: &mut Edges, start: Corner) -> Vec<Corner> {
    let (mut corners, mut at, mut way) = (vec![start], start, [0, 0]);
    while let Some(to) = edges.take(at, way) {
        let next = direction(at, to);
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
    let [west, south] = ring[0].map(i64::from);
    let from_first = |corner: &Corner| [i64::from(corner[0]) - west, i64::from(corner[1]) - south];
    let cross = |a: [i64; 2], b: [i64; 2]| a[0] * b[1] - b[0] * a[1];
    ring.windows(2).map(|pair| cross(from_first(&pair[0]), from_first(&pair[1]))).sum()
}

/// Length and width of a group along its principal axes, metres: whole cells.
pub fn length_and_width_m(cell_m: f64, group: &[Run]) -> [f64; 2] {
    let places = || {
        group
            .iter()
            .flat_map(|run| run.cells())
            .map(|[row, column]| [column, row].map(|i| (f64::from(i) + 0.5) * cell_m))
    };
    let count = places().count() as f64;
    let mean = [0, 1].map(|axis| places().map(|p| p[axis]).sum::<f64>() / count);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for [x, y] in places().map(|p| [p[0] - mean[0], p[1] - mean[1]]) {
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    let axis = f64::atan2(2.0 * xy, xx - yy) / 2.0;
    let along = |cos: f64, sin: f64| {
        let ends = places().map(|p| (p[0] - mean[0]) * cos + (p[1] - mean[1]) * sin);
        let (low, high) = ends.fold((0.0f64, 0.0f64), |(low, high), at| (low.min(at), high.max(at)));
        high - low + cell_m
    };
    let sides = [along(axis.cos(), axis.sin()), along(-axis.sin(), axis.cos())];
    [sides[0].max(sides[1]), sides[0].min(sides[1])]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The groups of a drawing of unit cells, its last line the southernmost.
    fn drawn(lines: &[&str]) -> Vec<Vec<Run>> {
        let shape = RasterShape { first_cell: [10, 20], width: lines[0].len(), height: lines.len(), cell_m: 1.0 };
        let north = 19 + lines.len() as i32;
        groups(shape, |[row, column]| lines[(north - row) as usize].as_bytes()[(column - 10) as usize] == b'#')
    }

    #[test]
    fn a_ring_of_cells_has_a_hole_and_corners_only() {
        let groups = drawn(&["###.", "#.#.", "###.", "...#"]);
        assert_eq!(groups.len(), 1, "cells that touch by a corner are one group");
        let polygons = outline(1.0, &groups[0]);
        assert_eq!(polygons.len(), 2, "but two polygons");
        let lonely = vec![[13.0, 20.0], [14.0, 20.0], [14.0, 21.0], [13.0, 21.0], [13.0, 20.0]];
        assert_eq!(polygons[0], [lonely]);
        let outer = vec![[10.0, 21.0], [13.0, 21.0], [13.0, 24.0], [10.0, 24.0], [10.0, 21.0]];
        let hole = vec![[11.0, 22.0], [11.0, 23.0], [12.0, 23.0], [12.0, 22.0], [11.0, 22.0]];
        assert_eq!(polygons[1], [outer, hole]);
    }

    /// The plain version joins cell by cell. Rings enclose as many cells as there are, whatever the drawing.
    #[test]
    fn groups_are_what_touches_and_outlines_enclose_their_cells() {
        let mut compared = 0;
        for seed in 0..200u32 {
            let shape = RasterShape { first_cell: [-3, 5], width: 9, height: 9, cell_m: 1.0 };
            let noise = |[row, column]: Cell| {
                let i = (row * 40 + column) as u32;
                (seed.wrapping_mul(2_654_435_761) ^ i.wrapping_mul(40_503)).wrapping_mul(2_246_822_519) >> 30 < 2
            };
            let groups = groups(shape, noise);
            let cells: Vec<Vec<Cell>> =
                groups.iter().map(|group| group.iter().flat_map(|run| run.cells()).collect()).collect();
            assert_eq!(cells, plain_groups(shape, noise));
            for (group, cells) in groups.iter().zip(cells) {
                let rings: Vec<Ring> = outline(1.0, group).into_iter().flatten().collect();
                let area =
                    |ring: &Ring| ring.windows(2).map(|p| p[0][0] * p[1][1] - p[1][0] * p[0][1]).sum::<f64>() / 2.0;
                assert_eq!(rings.iter().map(area).sum::<f64>(), cells.len() as f64);
                let is_corner = |p: &[[f64; 2]]| (p[0][0] == p[1][0]) != (p[1][0] == p[2][0]);
                assert!(rings.iter().all(|ring| ring.first() == ring.last() && ring.windows(3).all(is_corner)));
                assert!(
                    (5..14)
                        .all(|row| (-3..6).all(|column| holds(group, [row, column]) == cells.contains(&[row, column])))
                );
                compared += 1;
            }
        }
        assert!(compared > 500, "{compared}");
    }

    fn plain_groups(shape: RasterShape, belongs: impl Fn(Cell) -> bool) -> Vec<Vec<Cell>> {
        let all =
            (5..5 + shape.height as i32).flat_map(|row| (-3..-3 + shape.width as i32).map(move |column| [row, column]));
        let mut open: std::collections::BTreeSet<Cell> = all.filter(|cell| belongs(*cell)).collect();
        let mut found = Vec::new();
        while let Some(first) = open.pop_first() {
            let (mut group, mut next) = (vec![first], 0);
            while let Some(&cell) = group.get(next) {
                group.extend(around(cell).filter(|cell| open.remove(cell)));
                next += 1;
            }
            group.sort_unstable();
            found.push(group);
        }
        found
    }

    #[test]
    fn cut_groups_are_whole_again_when_they_are_joined() {
        let whole = drawn(&["#####", "##.##", ".###."]).remove(0);
        let cut = |west: bool| {
            whole.iter().map(move |run| {
                if west { Run { to: run.to.min(12), ..*run } } else { Run { from: run.from.max(12), ..*run } }
            })
        };
        let cut: Vec<Run> = cut(false).chain(cut(true)).filter(|run| run.from < run.to).collect();
        assert!(cut.len() > whole.len());
        assert_eq!(union(cut), whole);
    }

    #[test]
    fn a_slanting_wall_is_as_long_as_it_is() {
        let wall: Vec<Run> = (0..60).map(|i| Run { row: 10 + i, from: 20 + i, to: 21 + i }).collect();
        let [length, width] = length_and_width_m(0.1, &wall);
        assert!(
            (length - (59.0 * 0.1 * 2f64.sqrt() + 0.1)).abs() < 1e-6 && (width - 0.1).abs() < 1e-6,
            "{length} {width}"
        );
    }
}
