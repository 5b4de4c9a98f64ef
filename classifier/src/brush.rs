//! Brush: how high the vegetation stands that can be pushed through, is no trunk and no canopy.
//!
//! In: the view, the returns of its columns where they were kept, the ground, the trunks' columns. Out: metres above
//! ground per cell, 0 where none was seen, NaN where the ground is unknown or no beam came near it; its density. Brush
//! is what stands from the ground up, in the profile of a column and its neighbours: it ends at a wide gap, at the lower
//! edge of what hangs together with something above the tallest brush, or where a crown begins. Its height is the
//! highest thing of the column itself below that end. Source: thesis, "Estimating the Height of Above Ground Objects";
//! the profiles and the crowns are ours.

use crate::columns::View;
use crate::config::BrushConfig;
use crate::crown::crown_bases;
use crate::ground::Ground;
use crate::profile::{Around, LAYER_M, LAYERS, Profile};
use crate::returns::ReturnColumns;
use tsense_geometry::{Raster, RasterShape};

/// Things a layer of canopy must hold: a stray return between brush and canopy does not join them.
const CANOPY_COUNT: usize = 3;
/// Radius of what is close to a column, columns.
const CLOSE_CELLS: usize = 1;
/// How far above the tallest brush canopy is looked for, metres.
const CANOPY_ABOVE_M: f32 = 1.0;
/// What hangs down to less than this is no canopy: its branches are brush, metres.
const CANOPY_BASE_MIN_M: f32 = 0.5;
/// Height above ground below which a passing beam shows that a cell was seen, metres.
const SEEN_BELOW_M: f64 = 0.3;

/// What brush is looked for in.
pub struct Stand<'a> {
    /// The voxels.
    pub view: &'a View,
    /// The returns, where they were kept.
    pub returns: Option<&'a ReturnColumns>,
    /// The ground.
    pub ground: &'a Ground,
    /// Columns of trunks.
    pub trunks: &'a Raster<bool>,
}

/// Height of brush per cell.
pub fn brush_heights(stand: &Stand, config: &BrushConfig) -> Raster<f32> {
    let shape = stand.view.shape;
    let is_trunk = widened(stand.trunks);
    let mut profiles = vec![Profile::default(); shape.len()];
    for (column, profile) in profiles.iter_mut().enumerate() {
        stand.each_height(column, |height_m| profile.add(height_m));
    }
    let (gap, top) = (layer_of(config.canopy_gap_m as f32).max(1), layer_of(config.top_m as f32));
    let crowns = crown_bases(&profiles, shape, |around| canopy_base(around, gap, 1, top));
    profiles.iter_mut().zip(&is_trunk).filter(|(_, is)| **is).for_each(|(profile, _)| *profile = Profile::default());
    let radius = (config.around_m / shape.cell_m).round() as usize;
    let stands = Around::of(&profiles, shape.width, radius);
    let close = Around::of(&profiles, shape.width, CLOSE_CELLS);
    let height = |column: usize| {
        if stand.ground.height_m.cells()[column].is_nan() {
            return f32::NAN;
        }
        let mut top_m = 0.0f32;
        // Most columns hold nothing but their ground.
        if !is_trunk[column] && profiles[column].holds_from(layer_of(config.start_m as f32)) {
            let crown_m = crowns.cells()[column] as f32 * LAYER_M;
            let end_m = brush_end_m(&stands.at(column), &close.at(column), config).min(crown_m);
            stand.each_height(column, |height_m| {
                if height_m >= config.start_m as f32 && height_m < end_m {
                    top_m = top_m.max(height_m);
                }
            });
        }
        if top_m > 0.0 || stand.was_seen(column) { top_m } else { f32::NAN }
    };
    Raster::from_cells(shape, (0..shape.len()).map(height).collect()).expect("a height a column")
}

/// How dense brush stands: the share of occupied voxels among the known ones between the first height that is brush and
/// the top of it, over each cell and the eight around it; 0 where there is none, NaN where the height, or what stands
/// there, is unknown.
pub fn brush_densities(view: &View, ground: &Ground, heights_m: &Raster<f32>, config: &BrushConfig) -> Raster<f32> {
    let shape = view.shape;
    let level = |height_m: f32| (f64::from(height_m) / shape.cell_m).floor().max(0.0) as usize;
    // Occupied and known voxels of the brush in each column.
    let mut counts = vec![[0, 0]; shape.len()];
    for (column, height_m) in heights_m.cells().iter().enumerate().filter(|(_, height_m)| **height_m > 0.0) {
        let ground_m = ground.height_m.cells()[column];
        let (from, to) = (level(ground_m + config.start_m as f32), level(ground_m + height_m) + 1);
        let [occupied, free] = [&view.occupied, &view.free].map(|bits| bits.count(column, from, to));
        counts[column] = [occupied, occupied + free];
    }
    let mut density = heights_m.clone();
    for (column, density) in density.cells_mut().iter_mut().enumerate().filter(|(_, height_m)| **height_m > 0.0) {
        let sum = |which: usize| near(column, shape).map(|i| counts[i][which]).sum::<usize>() as f32;
        *density = sum(0) / sum(1);
    }
    density
}

/// A column and those around it.
fn near(column: usize, shape: RasterShape) -> impl Iterator<Item = usize> {
    let (x, y) = (column % shape.width, column / shape.width);
    let rows = y.saturating_sub(CLOSE_CELLS)..=(y + CLOSE_CELLS).min(shape.height - 1);
    let columns = x.saturating_sub(CLOSE_CELLS)..=(x + CLOSE_CELLS).min(shape.width - 1);
    rows.flat_map(move |y| columns.clone().map(move |x| y * shape.width + x))
}

/// Heights with their holes filled where no trunk stands: few beams of one drive end in the highest part of each column. What
/// nobody saw stays unknown, amid brush, too.
pub fn filled(heights_m: &Raster<f32>, trunks: &Raster<bool>, config: &BrushConfig) -> Raster<f32> {
    let shape = heights_m.shape();
    let reach = (config.fill_m / shape.cell_m).round() as usize;
    let mut filled_m = heights_m.clone();
    if reach > 0 {
        let (closed, is_trunk) = (closed(heights_m.cells(), shape.width, reach), widened(trunks));
        for ((height_m, closed_m), _) in
            filled_m.cells_mut().iter_mut().zip(closed).zip(is_trunk).filter(|(_, is_trunk)| !is_trunk)
        {
            // NaN is not lower than anything.
            *height_m = if closed_m > *height_m { closed_m } else { *height_m };
        }
    }
    filled_m
}

/// Grey-scale closing (Serra 1982) by a square that reaches so many cells: holes that no such square fits into rise to what
/// is around them; what is unknown counts for nothing.
fn closed(heights: &[f32], width: usize, reach: usize) -> Vec<f32> {
    let higher = |a: f32, b: f32| if b > a { b } else { a };
    let lower = |a: f32, b: f32| if b < a { b } else { a };
    let around = extremes(heights, width, reach, f32::NEG_INFINITY, higher);
    extremes(&around, width, reach, f32::INFINITY, lower)
}

/// The extreme of the square around each cell, along rows and then along columns.
fn extremes(cells: &[f32], width: usize, reach: usize, least: f32, of: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    // Whole rows at a time: the compiler makes wide instructions of that.
    let join = |out: &mut [f32], row: &[f32]| out.iter_mut().zip(row).for_each(|(out, cell)| *out = of(*out, *cell));
    let mut along = vec![least; cells.len()];
    for (row, out) in cells.chunks(width).zip(along.chunks_mut(width)) {
        for shift in 0..=reach.min(width) {
            join(out, &row[shift..]);
            join(&mut out[shift..], row);
        }
    }
    let mut all = along.clone();
    for (row, out) in all.chunks_mut(width).enumerate() {
        along
            .chunks(width)
            .skip(row.saturating_sub(reach))
            .take(row.min(reach) + reach + 1)
            .for_each(|other| join(out, other));
    }
    all
}

impl Stand<'_> {
    /// Heights above ground of what was met in a column: its returns, or the middles of its voxels.
    fn each_height(&self, column: usize, mut take: impl FnMut(f32)) {
        let ground_m = self.ground.height_m.cells()[column];
        if let Some(returns) = self.returns {
            return returns.column(column).iter().for_each(|item| take(item.at_m[2] - ground_m));
        }
        let cell_m = self.view.shape.cell_m as f32;
        let level = |height_m: f32| ((ground_m + height_m) / cell_m).max(0.0) as usize;
        if ground_m.is_nan() {
            return;
        }
        let (mut at, end) = (level(0.0), level(LAYERS as f32 * LAYER_M));
        while let Some(next) = self.view.touched.lowest(column, at, end) {
            // A voxel's thing may lie anywhere in it: its middle stands for it, its lower quarter closes the layers.
            take((next as f32 + 0.25) * cell_m - ground_m);
            take((next as f32 + 0.5) * cell_m - ground_m);
            at = next + 1;
        }
    }

    /// Whether beams passed just above the ground of a column, or ended there.
    fn was_seen(&self, column: usize) -> bool {
        let level = |height_m: f64| {
            let z = f64::from(self.ground.height_m.cells()[column]) + height_m;
            (z / self.view.shape.cell_m).max(0.0) as usize
        };
        let (from, to) = (level(0.0), level(SEEN_BELOW_M));
        self.view.free.count(column, from, to) + self.view.touched.count(column, from, to) > 0
    }
}

/// Height at which brush ends in the profile of a neighbourhood, metres above ground. Where a crown hangs down to brush
/// somewhere in it, only what is `close` tells where it ends here.
fn brush_end_m(profile: &Profile, close: &Profile, config: &BrushConfig) -> f32 {
    let top = layer_of(config.top_m as f32);
    let gap = layer_of(config.gap_max_m as f32).max(1);
    let canopy_gap = layer_of(config.canopy_gap_m as f32).max(1);
    let clear = first_gap(profile, gap, top);
    let is_canopy = |base: &usize| *base > layer_of(CANOPY_BASE_MIN_M);
    let base = canopy_base(profile, canopy_gap, CANOPY_COUNT, top);
    let canopy = match base {
        Some(base) if !is_canopy(&base) => canopy_base(close, canopy_gap, 1, top).filter(is_canopy),
        base => base,
    };
    canopy.unwrap_or(top).min(clear) as f32 * LAYER_M
}

fn layer_of(height_m: f32) -> usize {
    ((height_m / LAYER_M + 0.5) as usize).min(LAYERS)
}

/// The layer at which the first gap of `gap` layers begins, or the top.
fn first_gap(profile: &Profile, gap: usize, top: usize) -> usize {
    let mut empty = 0;
    for layer in 0..top {
        empty = if profile.holds(layer, 1) { 0 } else { empty + 1 };
        if empty == gap {
            return layer + 1 - gap;
        }
    }
    top
}

/// The lowest layer that hangs together with something above the top, layers of `count` things and more.
fn canopy_base(profile: &Profile, gap: usize, count: usize, top: usize) -> Option<usize> {
    let above = top..(top + layer_of(CANOPY_ABOVE_M)).min(LAYERS);
    let mut base = above.clone().any(|layer| profile.holds(layer, count)).then_some(top)?;
    for layer in (0..top).rev() {
        if profile.holds(layer, count) {
            base = layer;
        } else if base - layer >= gap {
            break;
        }
    }
    Some(base)
}

/// The trunks' columns and the ones beside them: bark is met beside a trunk's own columns, too.
fn widened(trunks: &Raster<bool>) -> Vec<bool> {
    let shape = trunks.shape();
    let near = |i: usize| shape.around((i % shape.width, i / shape.width), 1).any(|at| trunks[at]);
    (0..shape.len()).map(near).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_contract::GroundEvidence;
    use tsense_geometry::VoxelGrid;

    #[test]
    fn the_density_of_brush_counts_what_is_known_between_the_ground_and_its_top() {
        let mut view = View::unknown(Window { first: [0; 3], size: [8, 8, 64] }, VoxelGrid::new(0.1).unwrap());
        let known = Raster::filled(view.shape, 0.05f32);
        let evidence = known.map(|_| GroundEvidence::Measured);
        let ground =
            Ground { base_m: 0.0, std_m: known.clone(), height_m: known.clone(), evidence, measured_at_cells: vec![] };
        let mut heights_m = known.map(|_| 0.0f32);
        // Brush up to 0.9 m in three columns; levels 0 and 1 are ground and grass, 10 and above crowns.
        for x in 2..5 {
            heights_m[(x, 4)] = 0.9;
            (0..2).chain(10..30).for_each(|level| view.occupied.insert(4 * 8 + x, level));
        }
        heights_m[(6, 6)] = f32::NAN;
        // Of eight levels six are known: 3, 6 and none of them are occupied.
        for (column, occupied) in [(34, 3), (35, 6), (36, 0)] {
            (2..2 + occupied).for_each(|level| view.occupied.insert(column, level));
            (2 + occupied..8).for_each(|level| view.free.insert(column, level));
        }
        let config = BrushConfig { start_m: 0.2, ..BrushConfig::default() };
        let density = brush_densities(&view, &ground, &heights_m, &config);
        let shares = [2, 3, 4].map(|x| (density[(x, 4)] * 18.0).round());
        assert_eq!((density[(0, 0)], density[(6, 6)].is_nan()), (0.0, true));
        assert_eq!(shares, [9.0 / 12.0 * 18.0, 9.0, 6.0 / 12.0 * 18.0].map(f32::round));
    }

    /// Eight by eight columns, all drawn from the ground up: `#` touched, `.` free, `?` unknown; 0.1 m a voxel.
    fn height_of(drawing: &str, trunk: bool) -> f32 {
        heights_of(8, |_, _| drawing, trunk)[(4, 4)]
    }

    /// Columns drawn one by one, so many in each direction.
    fn heights_of<'a>(width: usize, drawing: impl Fn(usize, usize) -> &'a str, trunk: bool) -> Raster<f32> {
        let mut view = View::unknown(Window { first: [0; 3], size: [width, width, 64] }, VoxelGrid::new(0.1).unwrap());
        for (x, y) in (0..width).flat_map(|y| (0..width).map(move |x| (x, y))) {
            for (level, voxel) in drawing(x, y).chars().enumerate() {
                match voxel {
                    '#' => view.touched.insert(y * width + x, level),
                    '.' => view.free.insert(y * width + x, level),
                    _ => {}
                }
            }
        }
        let known = Raster::filled(view.shape, 0.0f32);
        let ground = Ground {
            base_m: 0.0,
            evidence: known.map(|_| GroundEvidence::Measured),
            std_m: known.clone(),
            height_m: known,
            measured_at_cells: vec![],
        };
        let trunks = Raster::filled(view.shape, trunk);
        let stand = Stand { view: &view, returns: None, ground: &ground, trunks: &trunks };
        brush_heights(&stand, &BrushConfig::default())
    }

    #[test]
    fn brush_grows_from_the_ground_through_small_gaps_and_ends_below_a_wide_one() {
        assert!((height_of("####", false) - 0.35).abs() < 1e-5);
        assert!((height_of("##.#..#", false) - 0.65).abs() < 1e-5);
        assert!((height_of("####........####", false) - 0.35).abs() < 1e-5, "a crown above a clearance of 0.8 m");
        assert_eq!(height_of("##......", false), 0.0, "the ground's own voxels are no brush");
        assert!(height_of("????????????", false).is_nan(), "no beam came near");
        assert_eq!(height_of("##########", true), 0.0, "a trunk is no brush");
    }

    #[test]
    fn holes_in_brush_are_filled_and_its_rim_stays_where_it_is() {
        let shape = RasterShape { first_cell: [0; 2], width: 20, height: 20, cell_m: 0.15 };
        let at = |i: usize| (i % 20, i / 20);
        // A patch of 10 x 10 columns of which every third was met high up, one was not seen, and a trunk stands in one.
        let height = |i: usize| match at(i) {
            (9, 9) => f32::NAN,
            (x, y) if (5..15).contains(&x) && (5..15).contains(&y) && (x + y) % 3 == 0 => 0.5,
            _ => 0.0,
        };
        let heights_m = Raster::from_cells(shape, (0..400).map(height).collect()).unwrap();
        let mut trunks = Raster::filled(shape, false);
        trunks[(12, 7)] = true;
        let filled_m = filled(&heights_m, &trunks, &BrushConfig { fill_m: 0.3, ..BrushConfig::default() });
        assert!(filled_m[(9, 9)].is_nan() && filled_m[(12, 7)] == 0.0);
        let count = |raster: &Raster<f32>| raster.cells().iter().filter(|height_m| **height_m > 0.0).count();
        // All 100 but the one not seen, and what is bare of the nine at the trunk and of the rim's corners.
        assert!(count(&heights_m) < 40 && (84..=99).contains(&count(&filled_m)), "{}", count(&filled_m));
        let outside = (0..400).filter(|i| !(5..15).contains(&at(*i).0) || !(5..15).contains(&at(*i).1));
        assert!(outside.clone().count() == 300 && outside.map(|i| filled_m.cells()[i]).all(|height_m| height_m == 0.0));
    }

    /// The plain version: every cell of every square.
    #[test]
    fn the_extremes_of_rows_at_a_time_are_those_of_every_square() {
        let (width, height) = (23, 9);
        let cell = |i: usize| if i % 7 == 3 { f32::NAN } else { ((i * 37) % 101) as f32 / 50.0 };
        let cells: Vec<f32> = (0..width * height).map(cell).collect();
        let higher = |a: f32, b: f32| if b > a { b } else { a };
        let mut compared = 0;
        for reach in [1, 3, 30] {
            let fast = extremes(&cells, width, reach, f32::NEG_INFINITY, higher);
            for (i, fast) in fast.iter().enumerate() {
                let near = |j: &usize| (i % width).abs_diff(j % width).max((i / width).abs_diff(j / width)) <= reach;
                let plain = (0..cells.len()).filter(near).map(|j| cells[j]).fold(f32::NEG_INFINITY, higher);
                assert_eq!(*fast, plain, "reach {reach}, cell {i}");
                compared += 1;
            }
        }
        assert_eq!(compared, 3 * width * height);
    }

    #[test]
    fn where_a_crown_hangs_down_to_brush_nearby_only_what_is_close_tells_the_brush_here() {
        let profile_of = |heights_m: &[(f32, f32)]| {
            let mut profile = Profile::default();
            for (from_m, to_m) in heights_m {
                (0..64).map(|k| 0.1 * k as f32 + 0.05).filter(|z| z > from_m && z < to_m).for_each(|z| {
                    (0..3).for_each(|_| profile.add(z));
                });
            }
            profile
        };
        let (config, around) = (BrushConfig::default(), profile_of(&[(0.0, 6.0)]));
        let close = profile_of(&[(0.0, 0.5), (1.2, 6.0)]);
        assert!((brush_end_m(&around, &close, &config) - 1.2).abs() < 1e-5);
        assert!((brush_end_m(&around, &around, &config) - 3.0).abs() < 1e-5, "nothing tells them apart");
    }

    #[test]
    fn a_crown_that_goes_on_upwards_is_canopy_down_to_a_narrow_gap() {
        let crown = format!("#####...{}", "#".repeat(40));
        assert!((height_of(&crown, false) - 0.45).abs() < 1e-5, "{}", height_of(&crown, false));
        let bush = format!("#####...{}", "#".repeat(10));
        assert!((height_of(&bush, false) - 1.75).abs() < 1e-5, "a bush ends below the tallest brush");
    }

    #[test]
    fn beside_a_bush_that_reaches_a_crown_grass_below_the_crown_is_as_low_as_it_is() {
        let (grass, bush) = ("####".to_string(), "#".repeat(16));
        let crown = format!("####{}{}", ".".repeat(12), "#".repeat(24));
        let drawing = |x: usize, y: usize| match (x.abs_diff(15), y.abs_diff(15)) {
            (5, 0..=2) => bush.as_str(),
            (x, y) if x * x + y * y <= 100 => crown.as_str(),
            _ => grass.as_str(),
        };
        let heights_m = heights_of(31, drawing, false);
        assert!((heights_m[(19, 15)] - 0.35).abs() < 1e-5, "{}", heights_m[(19, 15)]);
        assert!((heights_m[(20, 15)] - 1.55).abs() < 1e-5, "the bush: {}", heights_m[(20, 15)]);
    }
}
