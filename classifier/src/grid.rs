//! The Smart Sensor Grid: one georeferenced raster for the planner, a cell a voxel column.
//!
//! In: ground, brush and costs. Out: [`GridCell`]s row by row from the south-west, and the header that says where they
//! lie; stamps, zone and snapshot number are the shell's to fill in. Source: thesis, "Smart Sensor Grid".

use crate::ground::Ground;
use crate::traversability::Cost;
use tsense_contract::{GridCell, GridHeader};
use tsense_geometry::Raster;

/// The grid's cells.
pub fn smart_sensor_grid(ground: &Ground, brush_m: &Raster<f32>, costs: &Raster<Cost>) -> Vec<GridCell> {
    let cell = |i: usize| {
        let (cost, brush_m) = (costs.cells()[i], brush_m.cells()[i]);
        GridCell {
            ground_m: ground.height_m.cells()[i],
            ground_std_m: ground.std_m.cells()[i],
            vegetation_m: brush_m,
            cost: cost.cost,
            reason: cost.reason.to_wire(),
            evidence: ground.evidence.cells()[i].to_wire(),
            class: cost.class.to_wire(),
        }
    };
    (0..costs.shape().len()).map(cell).collect()
}

/// Where the grid lies. Stamps, zone and snapshot number are zero.
pub fn grid_header(ground: &Ground) -> GridHeader {
    let shape = ground.height_m.shape();
    GridHeader {
        stamp_ns: 0,
        classified_ns: 0,
        snapshot: 0,
        cell_m: shape.cell_m,
        base_m: ground.base_m,
        first_cell: shape.first_cell,
        width: shape.width as u32,
        height: shape.height as u32,
        zone: 0,
        south: 0,
        reserved: [0; 6],
    }
}
