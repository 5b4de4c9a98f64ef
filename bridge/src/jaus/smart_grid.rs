//! The Smart Sensor Grid as our own experimental message.

use super::config::{Config, GridValues};
use super::cost_map::{Window, brush_units};
use super::place::Place;
use tsense_contract::{COST_LETHAL, COST_UNKNOWN, CellClass, GridCell, GridHeader};
use tsense_jaus::message::smart_grid::{
    CLASS, DENSITY, GROUND, GROUND_UNKNOWN, SmartGrid, SmartGridHeader, TRAVERSABILITY, VEGETATION, VERSION,
};
use tsense_jaus::{date_stamp, time_stamp};

/// The layers that were asked for; none where the grid lies nowhere on the globe.
pub fn report(
    (header, cells): (&GridHeader, &[GridCell]),
    layers: u8,
    place: &Place,
    config: &Config,
) -> Option<SmartGrid> {
    let window = Window::of(header);
    let center = place.globe(window.center_m(header.cell_m))?;
    let wanted = |layer: u8| layers & layer != 0;
    let seen = || window.cells(header, cells);
    let layer = |layer: u8, value: &dyn Fn(&GridCell) -> u8, beyond: u8| -> Vec<u8> {
        if wanted(layer) { seen().map(|cell| cell.map_or(beyond, value)).collect() } else { Vec::new() }
    };
    let values = &config.grid_values;
    Some(SmartGrid {
        header: SmartGridHeader {
            version: VERSION,
            time: time_stamp(header.stamp_ns),
            date: date_stamp(header.stamp_ns),
            latitude_deg: center[0],
            longitude_deg: center[1],
            rotation_rad: place.convergence_rad(center)? as f32,
            cell_m: header.cell_m,
            west_column: header.first_cell[0],
            south_row: header.first_cell[1],
            zone: header.zone,
            south: header.south,
            base_m: header.base_m,
            vegetation_step_m: config.brush_step_m as f32,
            rows: u16::try_from(header.height).ok()?,
            columns: u16::try_from(header.width).ok()?,
            layers,
        },
        traversability: layer(TRAVERSABILITY, &|cell| traversability(cell.cost, values), values.unknown),
        vegetation: layer(VEGETATION, &|cell| brush_units(cell.vegetation_m, config.brush_step_m), 255),
        class: layer(CLASS, &|cell| cell.class, CellClass::Unknown.to_wire()),
        ground: if wanted(GROUND) { seen().map(ground_cm).collect() } else { Vec::new() },
        density: layer(DENSITY, &|cell| cell.density_pct, u8::MAX),
    })
}

/// Four bits of traversability: more is better, other than cost.
fn traversability(cost: u8, values: &GridValues) -> u8 {
    match cost {
        COST_UNKNOWN => values.unknown,
        COST_LETHAL => values.impassable,
        _ => {
            let (free, worst) = (f64::from(values.free), f64::from(values.worst));
            (free + (worst - free) * f64::from(cost) / f64::from(COST_LETHAL - 1)).round() as u8
        }
    }
}

fn ground_cm(cell: Option<&GridCell>) -> i16 {
    let height_m = cell.map_or(f32::NAN, |cell| cell.ground_m);
    // One value is kept for the unknown.
    if height_m.is_finite() { (height_m * 100.0).round().max(-32_767.0) as i16 } else { GROUND_UNKNOWN }
}

#[cfg(test)]
mod tests {
    use super::super::cost_map::tests::grid;
    use super::*;
    use tsense_jaus::Reader;
    use tsense_jaus::message::Field;
    use tsense_jaus::message::smart_grid::LAYERS;

    #[test]
    fn the_grid_says_exactly_where_its_cells_lie_and_returns_from_its_bytes() {
        let (header, mut cells) = grid(3, 3);
        cells[0].ground_m = -1.234;
        cells[1].ground_m = f32::NAN;
        cells[8].class = CellClass::Tree.to_wire();
        cells[6].density_pct = 40;
        let place = Place::new(17, 0).unwrap();
        let grid = report((&header, &cells), LAYERS, &place, &Config::default()).unwrap();
        assert_eq!((grid.header.cell_m, grid.header.west_column, grid.header.south_row), (0.15, 4_200_000, 32_000_000));
        assert_eq!((grid.ground[6], grid.ground[7], grid.ground[8]), (-123, GROUND_UNKNOWN, 0));
        assert_eq!((grid.class[2], grid.vegetation[2], grid.density[0]), (3, 8, 40));
        let bytes = grid.to_bytes(0xD801);
        // 62 bytes of header behind the code, 9 cells: 5 bytes of nibbles, 9, 9, 18, 9.
        assert_eq!(bytes.len(), 2 + 62 + 5 + 9 + 9 + 18 + 9);
        let mut reader = Reader::new(&bytes[2..]);
        assert_eq!(SmartGrid::read(&mut reader).unwrap(), grid);
        assert_eq!(reader.end(), Ok(()));
        let one = report((&header, &cells), TRAVERSABILITY, &place, &Config::default()).unwrap();
        assert_eq!((one.traversability.len(), one.class.len(), one.to_bytes(0xD801).len()), (9, 0, 69));
    }

    #[test]
    fn costs_become_the_values_of_the_configuration() {
        let values = GridValues::default();
        let check = |cost: u8, value: u8| assert_eq!(traversability(cost, &values), value, "cost {cost}");
        check(0, 12);
        check(126, 8);
        check(253, 3);
        check(254, 2);
        check(255, 14);
    }
}
