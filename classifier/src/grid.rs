//! The Smart Sensor Grid: one georeferenced raster for the planner, a cell a voxel column.
//!
//! In: a classification. Out: [`GridCell`]s row by row from the south-west, and the header that says where they
//! lie; stamps, zone and snapshot number are the shell's to fill in. Source: thesis, "Smart Sensor Grid".

use crate::classify::Classification;
use crate::ground::Ground;
use tsense_contract::{GridCell, GridHeader};

/// The grid's cells.
pub fn smart_sensor_grid(found: &Classification) -> Vec<GridCell> {
    let Classification { ground, brush_m, brush_density, costs, .. } = found;
    let cell = |i: usize| {
        let cost = costs.cells()[i];
        GridCell {
            ground_m: ground.height_m.cells()[i],
            vegetation_m: brush_m.cells()[i],
            ground_std_mm: steps(ground.std_m.cells()[i] * 1000.0, u16::MAX),
            density_pct: steps(brush_density.cells()[i] * 100.0, u16::from(u8::MAX)) as u8,
            cost: cost.cost,
            reason: cost.reason.to_wire(),
            evidence: ground.evidence.cells()[i].to_wire(),
            class: cost.class.to_wire(),
            reserved: 0,
        }
    };
    (0..costs.shape().len()).map(cell).collect()
}

/// A value as a whole number below the one that stands for the unknown.
fn steps(value: f32, unknown: u16) -> u16 {
    if value.is_nan() { unknown } else { value.round().min(f32::from(unknown - 1)) as u16 }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Config, Input, Memory, View, Window, detect};
    use tsense_geometry::{Timestamp, VoxelGrid};

    /// Level ground, and in the west brush of which every other voxel is occupied, up to 0.9 m.
    #[test]
    fn the_grid_of_a_snapshot_tells_how_dense_brush_stands() {
        let window = Window { first: [0; 3], size: [40, 40, 64] };
        let mut view = View::unknown(window, VoxelGrid::new(0.15).unwrap());
        for column in 0..40 * 40 {
            let (x, y) = (column % 40, column / 40);
            view.occupied.insert(column, 10);
            for level in 11..30 {
                let is_met = x < 20 && level < 16 && (x + y + level) % 2 == 0;
                if is_met { view.occupied.insert(column, level) } else { view.free.insert(column, level) }
            }
        }
        view.touched = view.occupied.clone();
        let input = Input { view: &view, returns: None, vehicle: None, stamp: Timestamp::default() };
        let (mut memory, config) = (Memory::new(usize::MAX), Config::default());
        let cells = detect(&input, &mut memory, &config).finish(&input, &mut memory, &config).grid_cells();
        let brush: Vec<_> = cells.iter().filter(|cell| cell.vegetation_m > 0.0).collect();
        assert!(brush.len() > 300, "{} cells of brush", brush.len());
        assert!(brush.iter().all(|cell| (35..=65).contains(&cell.density_pct)), "{:?}", brush[0]);
        assert!(cells.iter().filter(|cell| cell.vegetation_m == 0.0).all(|cell| cell.density_pct == 0));
    }

    #[test]
    fn deviations_and_densities_are_whole_numbers_and_what_is_unknown_is_the_largest() {
        let check = |value: f32, unknown: u16, expected: u16| assert_eq!(steps(value, unknown), expected, "{value}");
        check(34.6, u16::MAX, 35);
        check(1e9, u16::MAX, 65_534);
        check(f32::NAN, u16::MAX, 65_535);
        check(f32::NAN, 255, 255);
        let cell = |ground_std_mm, density_pct| GridCell { ground_std_mm, density_pct, ..bytemuck::Zeroable::zeroed() };
        let read = |cell: GridCell| (cell.ground_std_m(), cell.density());
        assert_eq!(read(cell(35, 40)), (0.035, 0.4));
        assert!(read(cell(u16::MAX, 0)).0.is_nan() && read(cell(0, u8::MAX)).1.is_nan());
    }
}
