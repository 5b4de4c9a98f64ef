//! The Smart Sensor Grid as nav_msgs/OccupancyGrid and as grid_map_msgs/GridMap. Pure.
//!
//! In: topic `grid`, row by row from the south-west, heights relative to the header's base. Out: messages in the frame
//! `map`. OccupancyGrid keeps our order of cells; GridMap counts rows from the east end towards decreasing x and columns
//! from the north end towards decreasing y, column-major, as its Eigen matrices lie in memory.

use super::frames::at;
use super::messages::{
    Float32MultiArray, GridMap, GridMapInfo, Header, MapMetaData, MultiArrayDimension, MultiArrayLayout, OccupancyGrid,
};
use tsense_contract::{COST_LETHAL, COST_UNKNOWN, CellClass, GridCell, GridHeader, GroundEvidence};

/// Layers of the grid map, in this order.
pub const LAYERS: [&str; 6] = ["elevation", "elevation_std", BRUSH_HEIGHT, BRUSH_DENSITY, "traversability", "tree"];
/// The layer of the height of brush, metres.
pub const BRUSH_HEIGHT: &str = "brush_height";
/// The layer of how dense it stands, 0 to 1.
pub const BRUSH_DENSITY: &str = "brush_density";

/// True where the header and the number of cells agree, and nothing in the header is out of this world.
pub fn fits(header: &GridHeader, cells: &[GridCell]) -> bool {
    header.width as usize * header.height as usize == cells.len()
        && !cells.is_empty()
        && (0.01..=10.0).contains(&header.cell_m)
        && header.base_m.is_finite()
}

/// South-west corner of the grid in the map.
fn corner(header: &GridHeader, origin_m: [f64; 3]) -> [f64; 2] {
    std::array::from_fn(|i| f64::from(header.first_cell[i]) * header.cell_m - origin_m[i])
}

/// Cost 0 to 253 as 0 to 99, lethal as 100, unknown as -1.
pub fn occupancy(cost: u8) -> i8 {
    match cost {
        COST_UNKNOWN => -1,
        COST_LETHAL => 100,
        cost => ((u32::from(cost) * 99 + 126) / 253) as i8,
    }
}

/// The costs, for Nav2's static layer and for RViz.
pub fn occupancy_grid(header: &GridHeader, cells: &[GridCell], origin_m: [f64; 3], frame: &str) -> OccupancyGrid {
    let ros_header = Header::new(header.stamp_ns, frame);
    let [x, y] = corner(header, origin_m);
    OccupancyGrid {
        info: MapMetaData {
            map_load_time: ros_header.stamp.clone(),
            resolution: header.cell_m as f32,
            width: header.width,
            height: header.height,
            origin: at(x, y, 0.0),
        },
        header: ros_header,
        data: cells.iter().map(|cell| occupancy(cell.cost)).collect(),
    }
}

/// The layers, for grid_map.
pub fn grid_map(header: &GridHeader, cells: &[GridCell], origin_m: [f64; 3], frame: &str) -> GridMap {
    let (width, height) = (header.width as usize, header.height as usize);
    let base_m = (header.base_m - origin_m[2]) as f32;
    let layer = |value: &dyn Fn(&GridCell) -> f32| {
        let columns = (0..height).rev().flat_map(|north| (0..width).rev().map(move |east| north * width + east));
        matrix(header, columns.map(|cell| value(&cells[cell])).collect())
    };
    let [x, y] = corner(header, origin_m);
    let (length_x, length_y) = (f64::from(header.width) * header.cell_m, f64::from(header.height) * header.cell_m);
    GridMap {
        header: Header::new(header.stamp_ns, frame),
        info: GridMapInfo {
            resolution: header.cell_m,
            length_x,
            length_y,
            pose: at(x + length_x / 2.0, y + length_y / 2.0, 0.0),
        },
        layers: LAYERS.map(String::from).into(),
        basic_layers: vec![LAYERS[0].into()],
        data: vec![
            layer(&|cell| known(cell, base_m + cell.ground_m)),
            layer(&|cell| known(cell, cell.ground_std_m())),
            layer(&|cell| cell.vegetation_m),
            layer(&GridCell::density),
            layer(&|cell| traversability(cell.cost)),
            layer(&tree),
        ],
        outer_start_index: 0,
        inner_start_index: 0,
    }
}

/// A height is none where nothing is known of the ground.
fn known(cell: &GridCell, value: f32) -> f32 {
    if GroundEvidence::from_wire(cell.evidence) == GroundEvidence::Unknown { f32::NAN } else { value }
}

/// 1 drives freely, 0 must not be driven, NaN is not known: the convention of grid_map.
fn traversability(cost: u8) -> f32 {
    if cost == COST_UNKNOWN { f32::NAN } else { 1.0 - f32::from(cost) / f32::from(COST_LETHAL) }
}

/// 1 where a trunk stands, 0 where none does, NaN is not known.
fn tree(cell: &GridCell) -> f32 {
    match CellClass::from_wire(cell.class) {
        CellClass::Unknown => f32::NAN,
        CellClass::Tree => 1.0,
        _ => 0.0,
    }
}

fn matrix(header: &GridHeader, data: Vec<f32>) -> Float32MultiArray {
    let dimension = |label: &str, size, stride| MultiArrayDimension { label: label.into(), size, stride };
    let dim = vec![
        dimension("column_index", header.height, header.width * header.height),
        dimension("row_index", header.width, header.width),
    ];
    Float32MultiArray { layout: MultiArrayLayout { dim, data_offset: 0 }, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    /// 3 cells east, 2 north; cell i has cost 10 i and ground 0.1 i.
    fn small() -> (GridHeader, Vec<GridCell>) {
        let mut header = GridHeader::zeroed();
        (header.cell_m, header.base_m, header.first_cell) = (0.5, 105.0, [1000, 2000]);
        (header.width, header.height, header.stamp_ns) = (3, 2, 7);
        let cell = |i: u8| GridCell {
            ground_m: 0.1 * f32::from(i),
            ground_std_mm: 20,
            density_pct: if i == 4 { u8::MAX } else { i },
            cost: 10 * i,
            evidence: GroundEvidence::Measured.to_wire(),
            class: CellClass::Ground.to_wire(),
            ..GridCell::zeroed()
        };
        (header, (0..6).map(cell).collect())
    }

    #[test]
    fn costs_keep_their_order_and_their_extremes() {
        assert_eq!([0, 253, 254, 255].map(occupancy), [0, 99, 100, -1]);
        assert!((1..=253).all(|cost| occupancy(cost) >= occupancy(cost - 1)));
    }

    #[test]
    fn an_occupancy_grid_begins_in_the_south_west() {
        let (header, mut cells) = small();
        cells[1].cost = COST_LETHAL;
        let grid = occupancy_grid(&header, &cells, [490.0, 1000.0, 100.0], "map");
        assert_eq!((grid.info.origin.position.x, grid.info.origin.position.y), (10.0, 0.0));
        assert_eq!((grid.info.width, grid.info.height, grid.info.resolution), (3, 2, 0.5));
        assert_eq!(grid.data, [0, 100, 8, 12, 16, 20]);
    }

    /// The position of grid_map's index (row, column), from its own definition.
    fn position(info: &GridMapInfo, row: usize, column: usize) -> (f64, f64) {
        let along = |center: f64, length: f64, i: usize| center + length / 2.0 - (i as f64 + 0.5) * info.resolution;
        (along(info.pose.position.x, info.length_x, row), along(info.pose.position.y, info.length_y, column))
    }

    #[test]
    fn a_grid_map_has_each_cell_where_the_cell_is() {
        let (header, mut cells) = small();
        cells[5].evidence = GroundEvidence::Unknown.to_wire();
        cells[2].class = CellClass::Tree.to_wire();
        let map = grid_map(&header, &cells, [490.0, 1000.0, 100.0], "map");
        let elevation = &map.data[0];
        let [columns, rows] = &elevation.layout.dim[..] else { panic!("two dimensions") };
        assert_eq!((columns.label.as_str(), columns.size, columns.stride), ("column_index", 2, 6));
        assert_eq!((rows.label.as_str(), rows.size, rows.stride), ("row_index", 3, 3));
        let mut compared = 0;
        for row in 0..3 {
            for column in 0..2 {
                let (x, y) = position(&map.info, row, column);
                let (east, north) = (((x - 10.0) / 0.5) as usize, ((y - 0.0) / 0.5) as usize);
                let cell = north * 3 + east;
                let at = |layer: &str| {
                    let layer = map.layers.iter().position(|name| name == layer).unwrap();
                    map.data[layer].data[column * rows.size as usize + row]
                };
                let (got, density) = (at("elevation"), at("brush_density"));
                assert_eq!(at("tree"), if cell == 2 { 1.0 } else { 0.0 });
                assert!(density == cell as f32 / 100.0 || (cell == 4 && density.is_nan()), "cell {cell}: {density}");
                if cell == 5 {
                    assert!(got.is_nan());
                } else {
                    assert!((got - (5.0 + 0.1 * cell as f32)).abs() < 1e-6, "cell {cell}: {got}");
                }
                compared += 1;
            }
        }
        assert_eq!(compared, 6);
    }

    #[test]
    fn a_header_that_lies_about_its_cells_does_not_fit() {
        let (header, cells) = small();
        assert!(fits(&header, &cells));
        assert!(!fits(&GridHeader { width: 4, ..header }, &cells));
        assert!(!fits(&GridHeader { width: u32::MAX, height: u32::MAX, ..header }, &cells));
        assert!(!fits(&GridHeader { cell_m: f64::NAN, ..header }, &cells));
        assert!(!fits(&GridHeader { width: 0, ..header }, &[]));
    }
}
