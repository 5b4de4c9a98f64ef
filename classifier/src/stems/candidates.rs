//! Where stems may stand: columns with returns in several slices above ground, the best of each neighbourhood.
//!
//! In: the returns by column and the ground. Out: places, metres east and north of the view's corner, the best first.
//! It is generous: a place that is no stem costs a fit, one that is left out costs a tree.

use super::config::StemsConfig;
use crate::ground::Ground;
use crate::returns::ReturnColumns;
use tsense_geometry::RasterShape;

/// Radius of the neighbourhood of which only the best place is kept, metres: stems stand farther apart.
const APART_M: f64 = 0.25;

/// Slices with returns, a bit each, for every column: bit 0 starts at `fit_m[0]` above the column's ground.
fn slices(columns: &ReturnColumns, ground: &Ground, config: &StemsConfig) -> Vec<u32> {
    let [low, high] = config.fit_m.map(|height_m| height_m as f32);
    let slice_m = config.slice_m as f32;
    let bits_of = |(i, ground_m): (usize, &f32)| {
        let heights = columns.column(i).iter().map(|item| item.at_m[2] - ground_m);
        heights
            .filter(|h| (low..high).contains(h))
            .fold(0u32, |bits, h| bits | 1 << (((h - low) / slice_m) as u32).min(31))
    };
    // NaN ground: no height is in the range.
    ground.height_m.cells().iter().enumerate().map(bits_of).collect()
}

/// A column's own slices count twice, those of its eight neighbours once.
fn score(slices: &[u32], shape: RasterShape, i: usize) -> (u32, u32) {
    let square = shape.around((i % shape.width, i / shape.width), 1);
    let around = square.fold(0, |bits, (column, row)| bits | slices[row * shape.width + column]);
    let own = slices[i].count_ones();
    (around.count_ones(), 2 * own + around.count_ones())
}

/// The candidates' places.
pub fn candidates(columns: &ReturnColumns, ground: &Ground, config: &StemsConfig) -> Vec<[f64; 2]> {
    let shape = ground.height_m.shape();
    let slices = slices(columns, ground, config);
    let mut scored: Vec<(u32, usize)> = Vec::new();
    for i in (0..slices.len()).filter(|&i| slices[i] != 0) {
        let (distinct, score) = score(&slices, shape, i);
        if distinct as usize >= config.candidate_slices_min {
            scored.push((score, i));
        }
    }
    // Best first; of equals, the one with the smallest index.
    scored.sort_by_key(|&(score, i)| (std::cmp::Reverse(score), i));
    apart(&scored, shape)
}

/// Takes the best, leaves out its neighbourhood, takes the best of the rest.
fn apart(scored: &[(u32, usize)], shape: RasterShape) -> Vec<[f64; 2]> {
    let reach = (APART_M / shape.cell_m).floor() as usize;
    let mut taken = vec![false; shape.len()];
    let mut kept = Vec::new();
    for &(_, i) in scored {
        if !taken[i] {
            let square = shape.around((i % shape.width, i / shape.width), reach);
            square.for_each(|(column, row)| taken[row * shape.width + column] = true);
            kept.push(i);
        }
    }
    let place = |i: usize| [(i % shape.width) as f64 + 0.5, (i / shape.width) as f64 + 0.5].map(|c| c * shape.cell_m);
    kept.into_iter().map(place).collect()
}
