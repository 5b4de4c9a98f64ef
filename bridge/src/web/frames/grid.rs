//! The Smart Sensor Grid as compact arrays: seven bytes a cell.

use super::{Frame, Header, Kind, Writer};
use tsense_contract::{GridCell, GridHeader};

/// Ground height of a cell that has none.
pub const GROUND_UNKNOWN: i16 = i16::MIN;
/// Bytes of a cell.
const CELL_BYTES: usize = 7;
/// Steps of a vegetation height a metre: a byte reaches 25.5 m.
const VEGETATION_STEPS_A_METRE: f32 = 10.0;

/// Payload: `f32` cell edge, `u32` width, `u32` height, `u32` zero, then six arrays, each row by row from the
/// south-west: `i16` ground in centimetres above the origin, `u8` vegetation in decimetres, `u8` cost, `u8` reason,
/// `u8` class in the low and ground evidence in the high half, `u8` density of vegetation in percent, 255 unknown. The
/// origin is the corner of cell (0, 0) at the base height. Nothing where the number of cells is not width times height or the frame would be too large.
pub fn grid_frame(grid: &GridHeader, cells: &[GridCell]) -> Option<Frame> {
    let expected = (grid.width as usize).checked_mul(grid.height as usize)?;
    if expected != cells.len() || 16 + CELL_BYTES * cells.len() > super::PAYLOAD_MAX {
        return None;
    }
    let [east, north] = grid.first_cell.map(|cell| f64::from(cell) * grid.cell_m);
    let header = Header {
        kind: Kind::Grid,
        zone: grid.zone,
        south: grid.south,
        stamp_ns: grid.stamp_ns,
        origin_m: [east, north, grid.base_m],
    };
    let mut writer = Writer::new(&header, 16 + CELL_BYTES * cells.len());
    writer.f32s(&[grid.cell_m as f32]);
    writer.u32(grid.width);
    writer.u32(grid.height);
    writer.u32(0);
    cells.iter().for_each(|cell| writer.bytes(&ground_cm(cell.ground_m).to_le_bytes()));
    let bytes: [fn(&GridCell) -> u8; 5] = [
        |cell| vegetation_dm(cell.vegetation_m),
        |cell| cell.cost,
        |cell| cell.reason,
        |cell| cell.class & 15 | cell.evidence << 4,
        |cell| cell.density_pct,
    ];
    bytes.iter().for_each(|byte| cells.iter().for_each(|cell| writer.bytes(&[byte(cell)])));
    Some(writer.finish())
}

/// Centimetres; what is NaN or beyond 327 m is unknown.
fn ground_cm(ground_m: f32) -> i16 {
    let cm = (ground_m * 100.0).round();
    if cm.abs() <= f32::from(i16::MAX) { cm as i16 } else { GROUND_UNKNOWN }
}

/// Decimetres, at most 255; NaN is 0.
fn vegetation_dm(vegetation_m: f32) -> u8 {
    (vegetation_m * VEGETATION_STEPS_A_METRE).round() as u8
}

#[cfg(test)]
mod tests {
    use super::super::{HEADER_BYTES, PAYLOAD_MAX, parse};
    use super::*;
    use bytemuck::Zeroable;
    use tsense_contract::{Grid, Topic};

    fn grid(width: u32, height: u32) -> GridHeader {
        let mut grid = GridHeader::zeroed();
        (grid.width, grid.height, grid.cell_m, grid.base_m) = (width, height, 0.15, 30.0);
        grid.first_cell = [2_460_000, 10];
        grid
    }

    #[test]
    fn a_cell_is_seven_bytes_in_six_arrays() {
        let cell = |ground_m, vegetation_m, class| GridCell {
            ground_m,
            vegetation_m,
            density_pct: 40 + class,
            cost: 7,
            reason: 5,
            evidence: 2,
            class,
            ..GridCell::zeroed()
        };
        let frame = grid_frame(&grid(2, 1), &[cell(-1.234, 0.87, 2), cell(f32::NAN, 99.0, 3)]).unwrap();
        let (header, payload) = parse(&frame).unwrap();
        assert!((header.origin_m[0] - 369_000.0).abs() < 1e-6 && header.origin_m[2] == 30.0);
        assert_eq!(payload[..4], 0.15f32.to_le_bytes());
        assert_eq!(payload[4..16], [2, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(payload[16..18], (-123i16).to_le_bytes());
        assert_eq!(payload[18..20], GROUND_UNKNOWN.to_le_bytes());
        assert_eq!(payload[20..], [9, 255, 7, 7, 5, 5, 0x22, 0x23, 42, 43]);
    }

    #[test]
    fn nonsense_heights_are_unknown_and_a_wrong_shape_is_no_frame() {
        assert_eq!(ground_cm(f32::INFINITY), GROUND_UNKNOWN);
        assert_eq!(ground_cm(-328.0), GROUND_UNKNOWN);
        assert_eq!(vegetation_dm(f32::NAN), 0);
        assert_eq!(vegetation_dm(-1.0), 0);
        let cells = [GridCell::zeroed(); 3];
        assert!(grid_frame(&grid(2, 1), &cells).is_none());
        assert!(grid_frame(&grid(u32::MAX, u32::MAX), &cells).is_none());
    }

    #[test]
    fn the_largest_grid_of_the_contract_fits() {
        let frame = grid_frame(&grid(672, 672), &vec![GridCell::zeroed(); Grid::ITEMS_MAX]).unwrap();
        assert!(frame.len() - HEADER_BYTES <= PAYLOAD_MAX);
    }
}
