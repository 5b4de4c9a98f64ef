//! Distances over a raster by two passes: to the nearest known cell, and the lower envelope of cones.
//!
//! Steps of 1 to the four neighbours and of the root of 2 to the diagonal ones, so distances are at most 8 % long.
//! In and out: cells of a raster row by row, distances in cells. Source: chamfer distance transform (Borgefors 1986).

/// Distance to the nearest cell that is `known`, in cells, and that cell's index; infinite and 0 where none is known.
pub fn nearest(known: impl Iterator<Item = bool>, width: usize) -> (Vec<f32>, Vec<u32>) {
    let mut distance: Vec<f32> = known.map(|known| if known { 0.0 } else { f32::INFINITY }).collect();
    let mut source: Vec<u32> = (0..distance.len() as u32).collect();
    sweep(&mut distance, width, 1.0, |to, from| source[to] = source[from]);
    (distance, source)
}

/// Lowers every height to what the cones over all others allow: `min over all (height + rise * distance)`, where
/// `rise` is per cell. Unknown heights are infinite.
pub fn lower_envelope(heights: &mut [f32], width: usize, rise: f32) {
    sweep(heights, width, rise, |_, _| {});
}

/// Both passes of the transform; `taken(to, from)` is called wherever a cell takes its value over a neighbour.
fn sweep(cells: &mut [f32], width: usize, rise: f32, mut taken: impl FnMut(usize, usize)) {
    if width == 0 {
        return;
    }
    let diagonal = rise * std::f32::consts::SQRT_2;
    let height = cells.len() / width;
    let mut relax = |cells: &mut [f32], to: usize, from: usize, cost: f32| {
        let offer = cells[from] + cost;
        if offer < cells[to] {
            cells[to] = offer;
            taken(to, from);
        }
    };
    for row in 0..height {
        for column in 0..width {
            let i = row * width + column;
            if column > 0 {
                relax(cells, i, i - 1, rise);
            }
            if row > 0 {
                relax(cells, i, i - width, rise);
                if column > 0 {
                    relax(cells, i, i - width - 1, diagonal);
                }
                if column + 1 < width {
                    relax(cells, i, i - width + 1, diagonal);
                }
            }
        }
    }
    for row in (0..height).rev() {
        for column in (0..width).rev() {
            let i = row * width + column;
            if column + 1 < width {
                relax(cells, i, i + 1, rise);
            }
            if row + 1 < height {
                relax(cells, i, i + width, rise);
                if column + 1 < width {
                    relax(cells, i, i + width + 1, diagonal);
                }
                if column > 0 {
                    relax(cells, i, i + width - 1, diagonal);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_known_cell_is_found_in_every_direction() {
        let (distance, source) = nearest((0..49).map(|i| i == 24), 7);
        assert_eq!((distance[24], distance[21], distance[3]), (0.0, 3.0, 3.0));
        assert!((distance[0] - 3.0 * 2f32.sqrt()).abs() < 1e-6);
        assert!(source.iter().all(|&s| s == 24));
        assert!(nearest((0..9).map(|_| false), 3).0.iter().all(|d| d.is_infinite()));
    }

    #[test]
    fn a_low_cell_pulls_its_surroundings_down_by_a_cone() {
        let mut heights = vec![5.0; 49];
        (heights[24], heights[10]) = (1.0, f32::INFINITY);
        lower_envelope(&mut heights, 7, 0.5);
        assert_eq!((heights[24], heights[23], heights[10]), (1.0, 1.5, 2.0));
        assert!((heights[0] - (1.0 + 0.5 * 3.0 * 2f32.sqrt())).abs() < 1e-6);
    }
}
