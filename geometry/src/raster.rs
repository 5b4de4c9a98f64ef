//! A square-celled map: rows of values with a place in UTM.
//!
//! Column `i` covers eastings `[first_cell[0] + i, + 1) * cell_m`, row `j` northings alike; row 0 is the
//! southernmost. Cells are aligned with the voxel columns when `cell_m` is the voxel size.

/// Where a raster lies and how many cells it has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RasterShape {
    /// Column and row index of cell (0, 0), counted from the UTM origin.
    pub first_cell: [i32; 2],
    /// Cells along easting.
    pub width: usize,
    /// Cells along northing.
    pub height: usize,
    /// Edge of a cell, metres.
    pub cell_m: f64,
}

impl RasterShape {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.width * self.height
    }
    /// True where there is no cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Easting and northing of the centre of a cell, metres.
    pub fn center_of(&self, column: usize, row: usize) -> [f64; 2] {
        let at = |first: i32, i: usize| (f64::from(first) + i as f64 + 0.5) * self.cell_m;
        [at(self.first_cell[0], column), at(self.first_cell[1], row)]
    }
    /// Column and row of the cell that holds a place.
    pub fn cell_at(&self, easting: f64, northing: f64) -> Option<(usize, usize)> {
        let along = |c: f64, first: i32, count: usize| {
            let i = (c / self.cell_m).floor() - f64::from(first);
            (i >= 0.0 && i < count as f64).then_some(i as usize)
        };
        Some((along(easting, self.first_cell[0], self.width)?, along(northing, self.first_cell[1], self.height)?))
    }
    /// Columns and rows of the cells of a square that reaches so many cells around one, row by row, cut at the borders.
    pub fn around(self, (column, row): (usize, usize), reach: usize) -> impl Iterator<Item = (usize, usize)> {
        let span = |at: usize, count: usize| at.saturating_sub(reach)..(at + reach + 1).min(count);
        let columns = span(column, self.width);
        span(row, self.height).flat_map(move |row| columns.clone().map(move |column| (column, row)))
    }
}

/// A value a cell, row by row from the south-west.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster<T> {
    shape: RasterShape,
    cells: Vec<T>,
}

impl<T: Clone> Raster<T> {
    /// A raster with every cell alike.
    pub fn filled(shape: RasterShape, value: T) -> Self {
        Self { shape, cells: vec![value; shape.len()] }
    }
}

impl<T> Raster<T> {
    /// A raster from its cells; nothing where their number is not the shape's.
    pub fn from_cells(shape: RasterShape, cells: Vec<T>) -> Option<Self> {
        (cells.len() == shape.len()).then_some(Self { shape, cells })
    }
    /// Where it lies.
    pub fn shape(&self) -> RasterShape {
        self.shape
    }
    /// All cells, row by row from the south-west.
    pub fn cells(&self) -> &[T] {
        &self.cells
    }
    /// All cells, to be changed.
    pub fn cells_mut(&mut self) -> &mut [T] {
        &mut self.cells
    }
    /// A cell, or nothing outside.
    pub fn get(&self, column: usize, row: usize) -> Option<&T> {
        (column < self.shape.width).then(|| self.cells.get(row * self.shape.width + column))?
    }
    /// The cell that holds a place, or nothing outside.
    pub fn at(&self, easting: f64, northing: f64) -> Option<&T> {
        let (column, row) = self.shape.cell_at(easting, northing)?;
        self.get(column, row)
    }
    /// The same shape with every value mapped.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Raster<U> {
        Raster { shape: self.shape, cells: self.cells.iter().map(f).collect() }
    }
}

/// Reads cell (column, row); panics outside, as a slice does.
impl<T> std::ops::Index<(usize, usize)> for Raster<T> {
    type Output = T;
    fn index(&self, (column, row): (usize, usize)) -> &T {
        assert!(column < self.shape.width);
        &self.cells[row * self.shape.width + column]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Raster<T> {
    fn index_mut(&mut self, (column, row): (usize, usize)) -> &mut T {
        assert!(column < self.shape.width);
        &mut self.cells[row * self.shape.width + column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_and_its_cell_agree() {
        let shape = RasterShape { first_cell: [100, -10], width: 4, height: 3, cell_m: 0.5 };
        let mut raster = Raster::filled(shape, 0);
        raster[(2, 1)] = 7;
        let [e, n] = shape.center_of(2, 1);
        assert_eq!((e, n), (51.25, -4.25));
        assert_eq!(raster.at(e, n), Some(&7));
        assert_eq!(raster.at(49.99, n), None);
        assert_eq!(raster.at(f64::NAN, n), None);
    }

    #[test]
    fn the_square_around_a_cell_is_cut_at_the_borders() {
        let shape = RasterShape { first_cell: [0; 2], width: 4, height: 3, cell_m: 0.5 };
        let around = |at, reach| shape.around(at, reach).collect::<Vec<_>>();
        assert_eq!(around((2, 1), 0), [(2, 1)]);
        assert_eq!(around((0, 0), 1), [(0, 0), (1, 0), (0, 1), (1, 1)]);
        assert_eq!(around((3, 2), 1), [(2, 1), (3, 1), (2, 2), (3, 2)]);
        assert_eq!(around((1, 1), 1).len(), 9);
        assert_eq!(around((1, 1), 9).len(), shape.len());
    }
}
