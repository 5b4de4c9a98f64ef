//! The returns of each column of a view, side by side in memory.
//!
//! In: the store and where the columns stand. Out: for each column its returns, metres relative to the view's lowest
//! corner: exact to a tenth of a millimetre in an `f32` for any view. Made anew for each snapshot by a counting sort,
//! in the memory of the one before.

use super::{Returns, Station};
use crate::columns::View;
use crate::moving::Moving;
use tsense_geometry::{Global, Point, RasterShape};

/// A return in a view: 24 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ColumnReturn {
    /// Where it is, relative to the view's corner: east, north, up, metres.
    pub at_m: [f32; 3],
    /// Where the ladar was, relative to the view's corner.
    pub from_m: [f32; 3],
}

impl ColumnReturn {
    /// Distance from the ladar, metres.
    pub fn range_m(&self) -> f32 {
        (0..3).map(|axis| (self.at_m[axis] - self.from_m[axis]).powi(2)).sum::<f32>().sqrt()
    }
}

/// Returns by column.
#[derive(Clone, Debug)]
pub struct ReturnColumns {
    shape: RasterShape,
    /// Where a column's returns start; two more than there are columns.
    starts: Vec<u32>,
    returns: Vec<ColumnReturn>,
    /// How many returns of each column nobody has looked at yet.
    fresh: Vec<u16>,
}

impl ReturnColumns {
    /// The returns of `store` in the columns of `view`; those above and below it are left out.
    pub fn of(store: &Returns, view: &View) -> Self {
        let nothing = Self { shape: view.shape, starts: Vec::new(), returns: Vec::new(), fresh: Vec::new() };
        nothing.filled(store, view, &Moving::default())
    }

    /// The same, in the memory of what was made for another snapshot, without the returns of what moves.
    pub fn filled(mut self, store: &Returns, view: &View, moving: &Moving) -> Self {
        let count = view.shape.len();
        self.shape = view.shape;
        // A column's start stands one further on until the returns are in their places: it is moved on with each of them.
        zeroed(&mut self.starts, count + 2);
        zeroed(&mut self.fresh, count);
        each(store, view, |column, item, is_fresh| {
            let stays = !moving.holds(column, item.at_m[2]);
            self.starts[column + 2] += u32::from(stays);
            self.fresh[column] = self.fresh[column].saturating_add((is_fresh && stays).into());
        });
        (0..count).for_each(|i| self.starts[i + 2] += self.starts[i + 1]);
        self.returns.resize(self.starts[count + 1] as usize, ColumnReturn::default());
        each(store, view, |column, item, _| {
            if !moving.holds(column, item.at_m[2]) {
                let next = &mut self.starts[column + 1];
                self.returns[*next as usize] = item;
                *next += 1;
            }
        });
        self
    }

    /// Number of returns.
    pub fn len(&self) -> usize {
        self.returns.len()
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.returns.is_empty()
    }

    /// The returns of a column, by its index in the raster, in the order of their stations.
    pub fn column(&self, column: usize) -> &[ColumnReturn] {
        &self.returns[self.starts[column] as usize..self.starts[column + 1] as usize]
    }

    /// How many returns of each column nobody has looked at yet.
    pub fn fresh(&self) -> &[u16] {
        &self.fresh
    }

    /// Returns that nobody has looked at yet in the columns within `radius_m` of a place, a square.
    pub fn fresh_around(&self, [x, y]: [f64; 2], radius_m: f64) -> usize {
        let (columns, rows) = (self.span(x, radius_m, self.shape.width), self.span(y, radius_m, self.shape.height));
        let row = |row: usize| &self.fresh[row * self.shape.width..][columns.clone()];
        rows.flat_map(row).map(|fresh| usize::from(*fresh)).sum()
    }

    /// The columns or rows within `radius_m` of a place along an axis.
    fn span(&self, at_m: f64, radius_m: f64, count: usize) -> std::ops::Range<usize> {
        let cells = |m: f64| (m / self.shape.cell_m).floor();
        let to = (cells(at_m + radius_m) + 1.0).clamp(0.0, count as f64) as usize;
        (cells(at_m - radius_m).max(0.0) as usize).min(to)..to
    }

    /// The returns within `radius_m` of a place, metres east and north of the view's corner.
    pub fn around(&self, [x, y]: [f64; 2], radius_m: f64) -> impl Iterator<Item = &ColumnReturn> {
        let (columns, rows) = (self.span(x, radius_m, self.shape.width), self.span(y, radius_m, self.shape.height));
        let row_of = move |row: usize| {
            let start = |column: usize| self.starts[row * self.shape.width + column] as usize;
            &self.returns[start(columns.start)..start(columns.end)]
        };
        let near = move |item: &&ColumnReturn| {
            let away_m = [f64::from(item.at_m[0]) - x, f64::from(item.at_m[1]) - y];
            away_m[0] * away_m[0] + away_m[1] * away_m[1] <= radius_m * radius_m
        };
        rows.flat_map(row_of).filter(near)
    }
}

/// A list of zeros, in its own memory.
fn zeroed<T: Clone + Default>(list: &mut Vec<T>, len: usize) {
    list.clear();
    list.resize(len, T::default());
}

/// Each return of the store that lies in the view, with its column, and whether it is fresh.
fn each(store: &Returns, view: &View, mut take: impl FnMut(usize, ColumnReturn, bool)) {
    let place = Place::of(view);
    each_of(store.stations(), &place, &mut take);
    let (points, shift) = (store.points(), place.shift_of(store.points().base));
    for end_m in &points.ends_m {
        let at_m: [f32; 3] = std::array::from_fn(|axis| end_m[axis] + shift[axis]);
        if let Some(column) = place.column_of(at_m) {
            // As if seen from close above: what is not known makes no height doubtful.
            take(column, ColumnReturn { at_m, from_m: [at_m[0], at_m[1], at_m[2] + 1.0] }, false);
        }
    }
}

impl Returns {
    /// Each return in a view that nobody has looked at yet: its column, and its height above the view's base, metres.
    pub(crate) fn each_fresh(&self, view: &View, mut take: impl FnMut(usize, f32)) {
        let stations = self.stations().filter(|station| station.has_fresh());
        each_of(stations, &Place::of(view), |column, item, is_fresh| {
            if is_fresh {
                take(column, item.at_m[2]);
            }
        });
    }
}

/// Each return of some stations that lies in a view.
fn each_of<'a>(
    stations: impl Iterator<Item = &'a Station>,
    place: &Place,
    mut take: impl FnMut(usize, ColumnReturn, bool),
) {
    for station in stations {
        let shift = place.shift_of(station.base);
        for beam in station.beams().iter().filter(|beam| beam.is_return) {
            let at_m: [f32; 3] = std::array::from_fn(|axis| beam.end_m[axis] + shift[axis]);
            if let Some(column) = place.column_of(at_m) {
                let origin_m = station.origin_m(beam);
                let from_m = std::array::from_fn(|axis| origin_m[axis] + shift[axis]);
                take(column, ColumnReturn { at_m, from_m }, beam.is_fresh);
            }
        }
    }
}

/// Where a view lies.
struct Place {
    shape: RasterShape,
    corner_m: [f64; 3],
    height_m: f32,
    per_cell: f32,
}

impl Place {
    fn of(view: &View) -> Self {
        let shape = view.shape;
        let [east_m, north_m] = [0, 1].map(|axis| f64::from(shape.first_cell[axis]) * shape.cell_m);
        let (height_m, per_cell) = ((view.levels as f64 * shape.cell_m) as f32, (1.0 / shape.cell_m) as f32);
        Self { shape, corner_m: [east_m, north_m, view.base_m()], height_m, per_cell }
    }

    /// The differences fit an f32: a view is at most a few hundred metres wide.
    fn shift_of(&self, base: Point<Global>) -> [f32; 3] {
        let base_m = base.to_array();
        std::array::from_fn(|axis| (base_m[axis] - self.corner_m[axis]) as f32)
    }

    #[inline]
    fn column_of(&self, at_m: [f32; 3]) -> Option<usize> {
        // What is not below zero is cut off towards zero: that is its cell.
        let (x, y) = (at_m[0] * self.per_cell, at_m[1] * self.per_cell);
        let inside = x >= 0.0 && y >= 0.0 && (x as usize) < self.shape.width && (y as usize) < self.shape.height;
        (inside && (0.0..self.height_m).contains(&at_m[2])).then_some(y as usize * self.shape.width + x as usize)
    }
}
