//! What stands above the ground of each column: its height, and its density with and without the price of free space.
//!
//! In: a view and its ground. Out: per column the height of the highest occupied voxel above ground (metres, NaN where
//! the ground is unknown or nothing stands) and two densities. Source: thesis, "Estimating the Height of Above Ground
//! Objects" and "Finding Trees".

use crate::columns::View;
use crate::config::DensityConfig;
use crate::ground::Ground;
use tsense_geometry::Raster;

/// Columns above ground.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Level of the view that holds the ground's surface, -1 where the ground is unknown.
    pub ground_level: Vec<i32>,
    /// Height of the top of the highest occupied voxel above ground, metres; NaN where nothing is known to stand.
    pub height_m: Raster<f32>,
    /// Share of occupied voxels among the known ones of the counted heights, 0 where none is known.
    pub density: Raster<f32>,
    /// Occupied voxels less the penalty for free ones, over all counted heights; from 0 to 1.
    pub tree_density: Raster<f32>,
}

impl Columns {
    /// The ground's level in every column and the height of what stands on it; no densities.
    pub fn heights(view: &View, ground: &Ground) -> Self {
        let cell_m = view.shape.cell_m;
        let level = |ground_m: &f32| match ground_m.is_finite() {
            // A surface below the view (extrapolated) is counted from the view's lowest level.
            true => ((f64::from(*ground_m) / cell_m).floor() as i32).clamp(0, view.levels as i32),
            false => -1,
        };
        let ground_level: Vec<i32> = ground.height_m.cells().iter().map(level).collect();
        let mut height_m = Raster::filled(view.shape, f32::NAN);
        for (i, level) in ground_level.iter().enumerate().filter(|(_, level)| **level >= 0) {
            if let Some(highest) = view.occupied.highest(i, *level as usize, view.levels) {
                height_m.cells_mut()[i] = ((highest + 1) as f64 * cell_m) as f32 - ground.height_m.cells()[i];
            }
        }
        let zero = Raster::filled(view.shape, 0.0);
        Self { ground_level, height_m, density: zero.clone(), tree_density: zero }
    }
}

/// Measures every column of a view above its ground.
pub fn columns_above_ground(view: &View, ground: &Ground, config: &DensityConfig) -> Columns {
    let cell_m = view.shape.cell_m;
    let levels = |height_m: f64| (height_m / cell_m).round() as i32;
    let (start, top) = (levels(config.start_m), levels(config.top_m).max(levels(config.start_m) + 1));
    let mut columns = Columns::heights(view, ground);
    for i in (0..view.shape.len()).filter(|i| ground.height_m.cells()[*i].is_finite()) {
        let level = columns.ground_level[i];
        let (from, to) = ((level + start) as usize, (level + top) as usize);
        let (occupied, free) = (view.occupied.count(i, from, to) as f64, view.free.count(i, from, to) as f64);
        columns.density.cells_mut()[i] = (occupied / (occupied + free).max(1.0)) as f32;
        let paid = (occupied - config.free_penalty * free) / f64::from(top - start);
        columns.tree_density.cells_mut()[i] = paid.max(0.0) as f32;
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_contract::GroundEvidence;
    use tsense_geometry::VoxelGrid;

    #[test]
    fn a_trunk_is_dense_and_an_overhanging_branch_pays_for_the_space_below() {
        let mut view = View::unknown(Window { first: [0; 3], size: [4, 4, 40] }, VoxelGrid::new(0.1).unwrap());
        let known = Raster::filled(view.shape, 0.55f32);
        let evidence = known.map(|_| GroundEvidence::Measured);
        let mut ground =
            Ground { base_m: 0.0, std_m: known.clone(), height_m: known, evidence, measured_at_cells: vec![] };
        ground.height_m[(3, 0)] = f32::NAN;
        for level in 0..20 {
            view.occupied.insert(0, 5 + level);
            if level < 15 {
                view.free.insert(1, 5 + level)
            } else {
                view.occupied.insert(1, 5 + level)
            }
            view.occupied.insert(3, 5 + level);
        }
        let config = DensityConfig { start_m: 0.5, top_m: 2.5, free_penalty: 1.0 };
        let columns = columns_above_ground(&view, &ground, &config);
        // Ground level 5; counted are levels 10 to 29: 15 of 20 are trunk; 10 free and 5 occupied are branch.
        assert_eq!(columns.ground_level[0], 5);
        assert_eq!(columns.tree_density[(0, 0)], 0.75);
        assert_eq!(columns.density[(0, 0)], 1.0);
        assert_eq!(columns.tree_density[(1, 0)], 0.0);
        assert!((columns.density[(1, 0)] - 1.0 / 3.0).abs() < 1e-6);
        assert!((columns.height_m[(0, 0)] - 1.95).abs() < 1e-5, "top face of level 24 is 2.5 m");
        assert_eq!((columns.tree_density[(3, 0)], columns.ground_level[3]), (0.0, -1));
    }
}
