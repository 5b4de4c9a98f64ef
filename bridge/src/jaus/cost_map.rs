//! The Smart Sensor Grid as IOP cost maps: traversability as it is, brush heights in steps.
//!
//! In: a grid (rows from the south-west, UTM). Out: a cost map: rows from the north-west, the centre in degrees, turned by
//! the grid convergence. Costs are the same numbers on both sides: 0 free, 254 impassable, 255 unknown.

use super::config::Config;
use super::place::Place;
use tsense_contract::{GridCell, GridHeader};
use tsense_jaus::message::cost_map::{
    CELLS_MAX, Cells, GlobalPlace, MapExtent, MapPose, QueryCostMap2D, ReportCostMap2D, UNKNOWN,
};
use tsense_jaus::message::scaled::{Angle16, Extent, Latitude, Longitude};

/// What a cost map shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// The cost of driving.
    Traversability,
    /// Height of brush in steps of the configuration.
    Brush,
}

/// A part of the plane in cells, counted from the UTM origin; it may reach beyond the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Westernmost column.
    pub west: i64,
    /// Southernmost row.
    pub south: i64,
    /// Cells along easting.
    pub columns: usize,
    /// Cells along northing.
    pub rows: usize,
}

impl Window {
    /// All of a grid.
    pub fn of(grid: &GridHeader) -> Self {
        let [west, south] = grid.first_cell.map(i64::from);
        Self { west, south, columns: grid.width as usize, rows: grid.height as usize }
    }

    /// The middle of this window with at most so many cells.
    fn shrunk(self, columns: usize, rows: usize) -> Self {
        let (columns, rows) = (self.columns.min(columns).max(1), self.rows.min(rows).max(1));
        Self {
            west: self.west + ((self.columns - columns) / 2) as i64,
            south: self.south + ((self.rows - rows) / 2) as i64,
            columns,
            rows,
        }
    }

    fn moved_to(self, [easting, northing]: [f64; 2], cell_m: f64) -> Self {
        let first = |center_m: f64, cells: usize| (center_m / cell_m - cells as f64 / 2.0).round() as i64;
        Self { west: first(easting, self.columns), south: first(northing, self.rows), ..self }
    }

    /// Easting and northing of the centre, metres.
    pub fn center_m(&self, cell_m: f64) -> [f64; 2] {
        [self.west as f64 + self.columns as f64 / 2.0, self.south as f64 + self.rows as f64 / 2.0].map(|c| c * cell_m)
    }

    /// Cells of the grid in a cost map's order: from the north-west, east, then south; none beyond the grid.
    pub fn cells<'a>(&self, header: &GridHeader, cells: &'a [GridCell]) -> impl Iterator<Item = Option<&'a GridCell>> {
        let Self { west, south, columns, rows } = *self;
        let grid = Self::of(header);
        (0..rows as i64).rev().flat_map(move |row| {
            (0..columns as i64).map(move |column| {
                let (x, y) = (west + column - grid.west, south + row - grid.south);
                let inside = (0..grid.columns as i64).contains(&x) && (0..grid.rows as i64).contains(&y);
                inside.then(|| cells.get(y as usize * grid.columns + x as usize)).flatten()
            })
        })
    }
}

/// The cost map that answers a query; none where the grid lies nowhere on the globe.
pub fn report(
    (header, cells): (&GridHeader, &[GridCell]),
    layer: Layer,
    query: &QueryCostMap2D,
    place: &Place,
    config: &Config,
) -> Option<ReportCostMap2D> {
    let window = window(header, query, place, config.extent_error_max_m);
    let center = place.globe(window.center_m(header.cell_m))?;
    let cost = |cell: Option<&GridCell>| match (cell, layer) {
        (None, _) => UNKNOWN,
        (Some(cell), Layer::Traversability) => cell.cost,
        (Some(cell), Layer::Brush) => brush_units(cell.vegetation_m, config.brush_step_m),
    };
    Some(ReportCostMap2D {
        rows: window.rows as u16,
        columns: window.columns as u16,
        extent: MapExtent {
            width: Extent(window.columns as f64 * header.cell_m),
            height: Extent(window.rows as f64 * header.cell_m),
        },
        center: MapPose::Global(GlobalPlace {
            latitude: Latitude(center[0]),
            longitude: Longitude(center[1]),
            rotation: Angle16(place.convergence_rad(center)?),
        }),
        cells: Cells::Costs(window.cells(header, cells).map(cost).collect::<Vec<u8>>().into()),
    })
}

/// Height of brush in steps: 0 is none, 254 that and more, 255 was not seen.
pub fn brush_units(height_m: f32, step_m: f64) -> u8 {
    if height_m.is_finite() { (f64::from(height_m) / step_m).round().clamp(0.0, 254.0) as u8 } else { UNKNOWN }
}

/// As much of the grid as was asked for, as fits a list, and as its extent can say.
fn window(header: &GridHeader, query: &QueryCostMap2D, place: &Place, error_max_m: f64) -> Window {
    let cell_m = header.cell_m;
    let mut window = Window::of(header);
    if let Some(extent) = &query.extent_max {
        let fit = |extent_m: f64| (extent_m / cell_m + 1e-6).floor() as usize;
        window = window.shrunk(fit(extent.width.0), fit(extent.height.0));
    }
    let side_max = CELLS_MAX.isqrt();
    if window.columns * window.rows > CELLS_MAX {
        window = window.shrunk(side_max, side_max);
    }
    window = window.shrunk(sayable(window.columns, cell_m, error_max_m), sayable(window.rows, cell_m, error_max_m));
    match &query.center {
        // A local frame is not known here: the map stays around the vehicle, as the standard wants it.
        Some(MapPose::Global(center)) => match place.utm([center.latitude.0, center.longitude.0]) {
            Some(center_m) => window.moved_to(center_m, cell_m),
            None => window,
        },
        Some(MapPose::Local(_)) | None => window,
    }
}

/// The most cells whose extent the message can say well enough; all where no number of them can be.
fn sayable(cells: usize, cell_m: f64, error_max_m: f64) -> usize {
    let error_m = |cells: usize| {
        let extent_m = cells as f64 * cell_m;
        (Extent::SCALE.from_u16(Extent::SCALE.to_u16(extent_m)) - extent_m).abs()
    };
    (1..=cells).rev().find(|cells| error_m(*cells) <= error_max_m).unwrap_or(cells)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use tsense_jaus::Message;

    /// A grid of UTM zone 17 whose cells cost what their place in the list is.
    pub(crate) fn grid(width: u32, height: u32) -> (GridHeader, Vec<GridCell>) {
        let header = GridHeader {
            stamp_ns: 1_795_229_734_250_000_000,
            cell_m: 0.15,
            base_m: 30.0,
            first_cell: [4_200_000, 32_000_000],
            width,
            height,
            zone: 17,
            ..GridHeader::zeroed()
        };
        let cell = |i: u32| GridCell { cost: i as u8, vegetation_m: i as f32 * 0.02, ..GridCell::zeroed() };
        (header, (0..width * height).map(cell).collect())
    }

    fn map(size: (u32, u32), layer: Layer, query: &QueryCostMap2D, config: &Config) -> ReportCostMap2D {
        let (header, cells) = grid(size.0, size.1);
        let place = Place::new(17, 0).unwrap();
        report((&header, &cells), layer, query, &place, config).unwrap()
    }

    fn costs(report: &ReportCostMap2D) -> &[u8] {
        let Cells::Costs(costs) = &report.cells else { panic!("{:?}", report.cells) };
        &costs.0
    }

    #[test]
    fn rows_run_from_the_north_west_and_numbers_stay_what_they_are() {
        let report = map((3, 2), Layer::Traversability, &QueryCostMap2D::default(), &Config::default());
        assert_eq!((report.rows, report.columns, costs(&report)), (2, 3, &[3, 4, 5, 0, 1, 2][..]));
        let MapPose::Global(center) = &report.center else { panic!() };
        // 630000.225 E, 4800000.15 N: 2 degrees of longitude less one hundredth east of the meridian.
        let back = Place::new(17, 0).unwrap().utm([center.latitude.0, center.longitude.0]).unwrap();
        assert!((back[0] - 630_000.225).abs() < 1e-3 && (back[1] - 4_800_000.15).abs() < 1e-3, "{back:?}");
        assert!((center.rotation.0.to_degrees() - 1.09).abs() < 0.03, "{}", center.rotation.0.to_degrees());
        assert_eq!(ReportCostMap2D::from_bytes(&report.to_bytes()).unwrap().to_bytes(), report.to_bytes());
    }

    #[test]
    fn brush_is_in_steps_and_what_was_not_seen_is_unknown() {
        let config = Config { brush_step_m: 0.02, ..Config::default() };
        let report = map((3, 1), Layer::Brush, &QueryCostMap2D::default(), &config);
        assert_eq!(costs(&report), [0, 1, 2]);
        let units = [(0.509, 25), (5.08, 254), (99.0, 254), (-1.0, 0), (f32::NAN, 255)];
        assert!(units.iter().all(|(height_m, unit)| brush_units(*height_m, 0.02) == *unit));
    }

    #[test]
    fn a_smaller_map_is_the_middle_of_the_grid() {
        let extent_max = Some(MapExtent { width: Extent(0.31), height: Extent(0.31) });
        let query = QueryCostMap2D { extent_max, center: None };
        let report = map((4, 4), Layer::Traversability, &query, &Config::default());
        assert_eq!((report.rows, report.columns, costs(&report)), (2, 2, &[9, 10, 5, 6][..]));
    }

    #[test]
    fn around_another_place_what_lies_beyond_is_unknown() {
        let place = Place::new(17, 0).unwrap();
        let [latitude, longitude] = place.globe([630_000.0, 4_800_000.0]).unwrap();
        let center =
            GlobalPlace { latitude: Latitude(latitude), longitude: Longitude(longitude), ..GlobalPlace::default() };
        let query = QueryCostMap2D { extent_max: None, center: Some(MapPose::Global(center)) };
        let report = map((2, 2), Layer::Traversability, &query, &Config::default());
        assert_eq!(costs(&report), [255, 0, 255, 255]);
    }

    #[test]
    fn a_grid_of_more_cells_than_a_list_can_name_is_cut_around_its_middle() {
        let report = map((400, 400), Layer::Traversability, &QueryCostMap2D::default(), &Config::default());
        assert_eq!((report.rows, report.columns, costs(&report).len()), (255, 255, 65_025));
    }

    #[test]
    fn where_the_extent_must_be_exact_the_map_is_made_smaller() {
        assert_eq!(sayable(200, 0.15, 0.08), 200);
        // 177 cells of 0.15 m are 26.55 m; 174 steps are 26.5507 m.
        assert_eq!(sayable(179, 0.15, 0.002), 177);
        let config = Config { extent_error_max_m: 0.01, ..Config::default() };
        let report = map((200, 200), Layer::Traversability, &QueryCostMap2D::default(), &config);
        assert!(
            (Extent::SCALE.from_u16(Extent::SCALE.to_u16(report.extent.width.0)) - report.extent.width.0).abs() < 0.01
        );
        assert_eq!(report.rows, 180);
    }
}
