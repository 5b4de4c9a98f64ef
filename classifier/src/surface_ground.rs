//! The ground raster from the smooth surface below the returns: height, one sigma and evidence of every cell.
//!
//! In: the returns of the view's columns where they were kept, its ground voxels where not, and the vehicle's plane. Out:
//! the ground and the heights at which it was met, certain or not. The plane counts as feet under the vehicle, in cells where nothing was
//! seen. A cell is measured where its own foot stands on certain ground; beyond the stated reach it stays unknown.

use crate::columns::View;
use crate::config::Config;
use crate::distance::nearest;
use crate::ground::{Found, Ground};
use crate::pyramid::ground_voxels;
use crate::returns::ReturnColumns;
use crate::surface::{Foot, Heights, Sight, Surface, UP, feet_of_heights, feet_of_returns, ground_surface};
use crate::under_surface::{lowest_heights, reject_lone};
use crate::vehicle_plane::VehiclePlane;
use tsense_contract::GroundEvidence;
use tsense_geometry::{Raster, RasterShape};

/// How far above or below the surface a foot may be and still have met the ground: at least, and in its own sigmas.
const NEAR_M: f32 = 0.1;
const NEAR_SIGMAS: f32 = 2.5;

/// The ground of a view.
pub fn surface_ground(
    view: &View,
    returns: Option<&ReturnColumns>,
    plane: Option<&VehiclePlane>,
    config: &Config,
) -> Found {
    let shape = view.shape;
    let mut feet = feet_of(view, returns, config);
    let seen = feet.len();
    if let Some(plane) = plane {
        add_plane(&mut feet, shape, plane, view.base_m(), config);
    }
    let surface = ground_surface(&feet, shape, &config.ground.surface);
    let unknown = Raster::filled(shape, f32::NAN);
    let mut ground = Ground {
        base_m: view.base_m(),
        height_m: unknown.clone(),
        std_m: unknown.clone(),
        evidence: Raster::filled(shape, GroundEvidence::Unknown),
        measured_at_cells: vec![f32::INFINITY; shape.len()],
    };
    let Some(surface) = surface else { return Found { ground, measured_m: unknown } };
    let (met_m, is_certain) = met_ground(&feet[..seen], &surface, shape);
    for foot in &feet[seen..] {
        ground.evidence.cells_mut()[cell_of(foot, shape)] = GroundEvidence::VehiclePlane;
    }
    ground.fill(&surface, &is_certain, config);
    Found { ground, measured_m: met_m }
}

/// The lowest thing in each column, without those that no surface connects with others: ghosts below the ground.
fn feet_of(view: &View, returns: Option<&ReturnColumns>, config: &Config) -> Vec<Foot> {
    let Some(returns) = returns.filter(|returns| !returns.is_empty()) else {
        let mut heights = lowest_heights(view, &ground_voxels(view, &config.ground), config.ground.surface_in_voxel);
        reject_lone(&mut heights, &config.ground);
        return feet_of_heights(&heights);
    };
    let mut feet = feet_of_returns(returns, view.shape.len(), &config.ground.surface);
    let mut heights = Raster::filled(view.shape, f32::NAN);
    feet.iter().for_each(|foot| heights.cells_mut()[cell_of(foot, view.shape)] = foot.at_m[2]);
    reject_lone(&mut heights, &config.ground);
    feet.retain(|foot| heights.cells()[cell_of(foot, view.shape)].is_finite());
    feet
}

/// The column that a foot stands in.
fn cell_of(foot: &Foot, shape: RasterShape) -> usize {
    let per_m = (1.0 / shape.cell_m) as f32;
    let along = |c: f32, count: usize| ((c * per_m) as usize).min(count - 1);
    along(foot.at_m[1], shape.height) * shape.width + along(foot.at_m[0], shape.width)
}

/// Feet on the plane that the vehicle stands on, in the columns around it where nothing was seen.
fn add_plane(feet: &mut Vec<Foot>, shape: RasterShape, plane: &VehiclePlane, base_m: f64, config: &Config) {
    let mut taken = vec![false; shape.len()];
    feet.iter().for_each(|foot| taken[cell_of(foot, shape)] = true);
    let radius_m = config.vehicle.plane_radius_m;
    let corner = [0, 1].map(|axis| f64::from(shape.first_cell[axis]) * shape.cell_m);
    for (i, _) in taken.iter().enumerate().filter(|(_, taken)| !**taken) {
        let [easting, northing] = shape.center_of(i % shape.width, i / shape.width);
        let away_m = [easting - plane.below.x(), northing - plane.below.y()];
        if away_m[0] * away_m[0] + away_m[1] * away_m[1] <= radius_m * radius_m {
            let z = plane.height_m(easting, northing) - base_m;
            let at_m = [easting - corner[0], northing - corner[1], z].map(|c| c as f32);
            feet.push(Foot { at_m, std_m: config.vehicle.plane_std_m as f32, towards: UP });
        }
    }
}

/// Height of the ground where a foot stands on it, NaN elsewhere; and whether that ground is certain.
fn met_ground(feet: &[Foot], surface: &Surface, shape: RasterShape) -> (Raster<f32>, Vec<bool>) {
    let (mut met_m, mut is_certain) = (Raster::filled(shape, f32::NAN), vec![false; shape.len()]);
    for foot in feet {
        let [x, y, z] = foot.at_m;
        if (z - surface.heights.at(x, y)).abs() <= NEAR_M.max(NEAR_SIGMAS * foot.std_m) {
            let cell = cell_of(foot, shape);
            met_m.cells_mut()[cell] = z;
            is_certain[cell] = surface.sight[surface.heights.level.node_at(x, y)] == Sight::Strong;
        }
    }
    (met_m, is_certain)
}

impl Ground {
    /// Heights and deviations of the surface, as far as it reaches, and how each cell is known.
    fn fill(&mut self, surface: &Surface, is_certain: &[bool], config: &Config) {
        let shape = self.height_m.shape();
        let (distance, _) = nearest(is_certain.iter().copied(), shape.width);
        let stds = Heights { level: surface.heights.level, height_m: surface.std_m.clone() };
        // Half a gap on either side is between measured cells, or as good.
        let between = (config.ground.gap_max_m / 2.0 / shape.cell_m) as f32;
        let reach = (config.ground.surface.reach_m / shape.cell_m) as f32;
        let center = |i: usize| ((i as f64 + 0.5) * shape.cell_m) as f32;
        let level = surface.heights.level;
        let east: Vec<_> = (0..shape.width).map(|column| level.east_of(center(column))).collect();
        let north: Vec<_> = (0..shape.height).map(|row| level.north_of(center(row))).collect();
        for (i, distance) in distance.iter().enumerate() {
            let on_plane = self.evidence.cells()[i] == GroundEvidence::VehiclePlane;
            let evidence = match *distance {
                0.0 => GroundEvidence::Measured,
                _ if on_plane => GroundEvidence::VehiclePlane,
                d if d <= between => GroundEvidence::Interpolated,
                d if d <= reach => GroundEvidence::Extrapolated,
                _ => continue,
            };
            let (east, north) = (east[i % shape.width], north[i / shape.width]);
            self.evidence.cells_mut()[i] = evidence;
            self.height_m.cells_mut()[i] = surface.heights.between(east, north);
            self.std_m.cells_mut()[i] = stds.between(east, north);
        }
        self.measured_at_cells = distance;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_geometry::{Attitude, Point, VoxelGrid, global_from_vehicle};

    /// Voxels of ground that rises one in six to the east, seen where `seen` says; base at 0 m.
    fn ground_of(seen: impl Fn(usize, usize) -> bool, plane: Option<&VehiclePlane>) -> Found {
        let mut view = View::unknown(Window { first: [0; 3], size: [80, 80, 60] }, VoxelGrid::new(0.15).unwrap());
        for i in (0..6400).filter(|i| seen(i % 80, i / 80)) {
            view.occupied.insert(i, 10 + (i % 80) / 6);
            view.occupied.insert(i, 30);
            (12 + (i % 80) / 6..30).for_each(|level| view.free.insert(i, level));
        }
        let config = Config::default();
        find(&view, plane, &config)
    }

    fn find(view: &View, plane: Option<&VehiclePlane>, config: &Config) -> Found {
        surface_ground(view, None, plane, config)
    }

    /// The surface lies in the middle of the voxels on the average of six columns.
    fn truth(column: usize) -> f32 {
        1.575 + 0.15 * (column as f32 - 2.5) / 6.0
    }

    #[test]
    fn without_returns_voxels_give_the_slope_to_a_third_of_a_voxel() {
        let Found { ground, measured_m } = ground_of(|column, row| column < 60 && (column + row) % 2 == 0, None);
        for (column, row) in [(10, 10), (31, 40), (50, 70)] {
            let error_m = ground.height_m[(column, row)] - truth(column);
            assert!(error_m.abs() < 0.05, "{column} {row}: {error_m}");
        }
        assert!(measured_m.cells().iter().filter(|z| z.is_finite()).count() > 1500);
        assert_eq!(ground.evidence[(30, 31)], GroundEvidence::Interpolated);
        assert_eq!(ground.evidence[(78, 40)], GroundEvidence::Extrapolated);
        assert!(ground.std_m[(78, 40)] > ground.std_m[(30, 40)]);
    }

    #[test]
    fn under_the_vehicle_its_plane_is_the_ground() {
        let pose = global_from_vehicle(Attitude::default(), Point::new(40.0 * 0.15, 40.0 * 0.15, truth(40).into()));
        let plane = VehiclePlane::below(&pose, 0.0).unwrap();
        let hidden = |column: usize, row: usize| column.abs_diff(40).max(row.abs_diff(40)) > 12;
        let Found { ground, .. } = ground_of(hidden, Some(&plane));
        assert_eq!(ground.evidence[(40, 40)], GroundEvidence::VehiclePlane);
        assert!((ground.height_m[(40, 40)] - truth(40)).abs() < 0.08, "{}", ground.height_m[(40, 40)]);
    }

    #[test]
    fn nothing_seen_is_unknown_everywhere() {
        let Found { ground, .. } = ground_of(|_, _| false, None);
        assert!(ground.evidence.cells().iter().all(|evidence| *evidence == GroundEvidence::Unknown));
        assert!(ground.height_m.cells().iter().all(|z| z.is_nan()));
    }
}
