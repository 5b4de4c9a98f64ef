//! The whole chain on one snapshot: ground, height and density, trunks, brush, traversability, grid.
//!
//! In: a [`View`], the returns behind it where they were kept, the vehicle's pose where there is one, the configuration. Out: a [`Classification`]. Deterministic:
//! no clock, no randomness, no threads. Source: thesis, chapter 2, "Classification".

use crate::aimed::STATIONS;
use crate::brush::{Stand, brush_densities, brush_heights, filled};
use crate::cluster::clusters;
use crate::columns::View;
use crate::config::{Config, Detector, GroundMethod, TraversabilityConfig};
use crate::convolution::{convolve, trunk_kernel};
use crate::density::{Columns, columns_above_ground};
use crate::drops::{Eye, Looks, drops};
use crate::grid::{grid_header, smart_sensor_grid};
use crate::ground::{Found, Ground, ground_raster};
use crate::memory::Memory;
use crate::pyramid::ground_voxels;
use crate::returns::{ReturnColumns, Returns};
use crate::stems::{StemScene, point_stems, stems};
use crate::surface_ground::surface_ground;
use crate::things::{Stage, things};
use crate::traversability::{Cost, Terrain, traversability};
use crate::trunk::{Rejected, Scene, Trunks, trunks};
use crate::under_surface::measured_heights;
use crate::vehicle_plane::VehiclePlane;
use tsense_contract::{Detection, GridCell, GridHeader};
use tsense_geometry::{Global, Raster, Timestamp, Transform, Vehicle};

/// Heights of a ladar above the ground, metres; others are no vehicle's and no tripod's.
const EYE_HEIGHTS_M: std::ops::Range<f64> = 0.2..10.0;
/// Drops are looked for from places of a survey this far apart, metres, and must show from so many of them.
const EYE_STEP_M: f64 = 1.0;
const SURVEY_LOOKS: u16 = 2;

/// What one snapshot holds.
#[derive(Clone, Debug)]
pub struct Classification {
    /// Ground heights, deviations and evidence.
    pub ground: Ground,
    /// Heights of the columns above ground, and densities where the thesis's detector needs them.
    pub columns: Columns,
    /// Trees.
    pub trees: Vec<Detection>,
    /// Columns that trunks stand in.
    pub trunk_columns: Raster<bool>,
    /// Candidates that are no trees, each with its reason.
    pub rejected: Vec<Rejected>,
    /// Height of brush above ground, metres; 0 where none, NaN where the ground is unknown or nothing was seen above it.
    pub brush_m: Raster<f32>,
    /// How dense it stands, 0 to 1: occupied among known voxels; 0 where none, NaN where that is unknown.
    pub brush_density: Raster<f32>,
    /// Cost, reason and class of every cell.
    pub costs: Raster<Cost>,
    /// Cells of drops that a pit or an edge shows.
    pub drops_shown: Raster<bool>,
}

impl Classification {
    /// Rocks, walls, drops and patches of brush, each with the stamp of what it rests on, and how many were left out.
    pub fn things(&self, memory: &Memory) -> (Vec<Detection>, usize) {
        let Self { costs, brush_m, ground, drops_shown, .. } = self;
        things(&Stage { costs, brush_m, ground, drops_shown }, memory)
    }

    /// The Smart Sensor Grid's cells, row by row from the south-west.
    pub fn grid_cells(&self) -> Vec<GridCell> {
        smart_sensor_grid(self)
    }

    /// Where the grid lies; stamps, zone and snapshot number are the caller's to fill in.
    pub fn grid_header(&self) -> GridHeader {
        grid_header(&self.ground)
    }
}

/// What the chain works on. `returns` (settled) make fits finer than voxels; without them voxels must do. Without a
/// vehicle there is no plane below it and no stretch without ground is a drop.
#[derive(Clone, Copy)]
pub struct Input<'a> {
    /// The voxels.
    pub view: &'a View,
    /// The beams behind them.
    pub returns: Option<&'a Returns>,
    /// The vehicle.
    pub vehicle: Option<&'a Transform<Global, Vehicle>>,
    /// Instant of the newest beam.
    pub stamp: Timestamp,
}

impl<'a> Input<'a> {
    /// A survey: nothing drives, and nothing is older than anything else.
    pub fn of_survey(view: &'a View, returns: &'a Returns) -> Self {
        Self { view, returns: Some(returns), vehicle: None, stamp: Timestamp::default() }
    }
}

/// The first half of a classification: the ground, and the trees on it.
pub struct Detected {
    by_column: Option<ReturnColumns>,
    found: Found,
    columns: Columns,
    trunks: Trunks,
}

/// Finds ground and trees. Trees that `memory` knows from the snapshot before are fitted again where something new was
/// seen of them.
pub fn detect(input: &Input, memory: &mut Memory, config: &Config) -> Detected {
    let Input { view, returns, vehicle, stamp } = *input;
    // A survey is one snapshot: there is nothing to compare it with.
    if let Some(store) = returns.filter(|_| vehicle.is_some()) {
        memory.moving.look(view, store, stamp, &config.moving);
    }
    let by_column = returns.map(|store| match memory.by_column.take() {
        Some(before) => before.filled(store, view, &memory.moving),
        None => ReturnColumns::of(store, view),
    });
    memory.look(view.shape, by_column.as_ref(), stamp);
    let plane = vehicle.and_then(|pose| VehiclePlane::below(pose, config.vehicle.origin_height_m));
    let plane = plane.filter(|_| config.vehicle.plane);
    let found = find_ground(view, by_column.as_ref(), plane.as_ref(), config);
    let columns = match config.detector {
        Detector::Stems if by_column.is_some() => Columns::heights(view, &found.ground),
        _ => columns_above_ground(view, &found.ground, &config.density),
    };
    let trunks = match (config.detector, returns, &by_column) {
        (Detector::Stems, Some(returns), Some(columns)) => {
            let scene = StemScene { view, returns, columns, ground: &found.ground, met_ns: &memory.met_ns };
            // Points without a single beam: only rings are left.
            match returns.is_empty() && !columns.is_empty() {
                true => point_stems(&scene, &config.stems),
                false => stems(&scene, &mut memory.stems, &config.stems),
            }
        }
        _ => thesis_trunks(view, &found.ground, &columns, config),
    };
    Detected { by_column, found, columns, trunks }
}

/// The ground of a view: as the thesis finds it from voxels, or the surface below the returns.
fn find_ground(view: &View, returns: Option<&ReturnColumns>, plane: Option<&VehiclePlane>, config: &Config) -> Found {
    if config.ground.method == GroundMethod::Surface {
        return surface_ground(view, returns, plane, config);
    }
    let measured_m = measured_heights(view, &ground_voxels(view, &config.ground), &config.ground);
    let ground = ground_raster(&measured_m, plane, view.base_m(), config);
    Found { ground, measured_m }
}

impl Detected {
    /// The trees.
    pub fn trees(&self) -> &[Detection] {
        &self.trunks.trees
    }

    /// The second half: brush, drops, traversability.
    pub fn finish(self, input: &Input, memory: &mut Memory, config: &Config) -> Classification {
        let Input { view, returns, vehicle, stamp } = *input;
        let Self { by_column, found: Found { ground, measured_m }, columns, trunks } = self;
        let Trunks { trees, mask, rejected } = trunks;
        let stand = Stand { view, returns: by_column.as_ref(), ground: &ground, trunks: &mask };
        let met_m = brush_heights(&stand, &config.brush);
        let brush_m = filled(&met_m, &mask, &config.brush);
        let brush_density = brush_densities(view, &ground, &brush_m, &config.brush);
        let planes = std::mem::take(&mut memory.planes).again(&measured_m, &ground.height_m);
        let eyes = match (vehicle, returns) {
            (Some(pose), _) => vec![eye(returns, pose, &ground, &config.traversability)],
            (None, Some(store)) => eyes_of_survey(store, &ground),
            (None, None) => vec![],
        };
        // Nothing is told that was seen once; live the store sees to that.
        let least = if vehicle.is_some() { 1 } else { SURVEY_LOOKS };
        let looks = Looks { eyes: &eyes, returns, least, is_near: vehicle.is_some() };
        let drops = drops(view, &ground, &columns, (&measured_m, &planes.measured), &looks, &config.traversability);
        let drops = memory.with_drops(drops, &measured_m);
        let moving = memory.moving.cells(view.shape, stamp, &config.moving);
        let terrain = Terrain {
            view,
            returns: by_column.as_ref(),
            measured: &measured_m,
            planes: &planes,
            ground: &ground,
            columns: &columns,
            standing_m: &met_m,
            brush_m: &brush_m,
            trunks: &mask,
            drops: &drops.cells,
            moving: &moving,
        };
        let costs = traversability(&terrain, config);
        (memory.planes, memory.by_column) = (planes, by_column);
        let drops_shown = drops.shown;
        let trunk_columns = mask;
        Classification { ground, columns, trees, trunk_columns, rejected, brush_m, brush_density, costs, drops_shown }
    }
}

/// Where the ladar was last, as its returns say; without any, above the vehicle's origin.
fn eye(
    store: Option<&Returns>,
    vehicle: &Transform<Global, Vehicle>,
    ground: &Ground,
    config: &TraversabilityConfig,
) -> Eye {
    let ladar = store.and_then(|store| store.stations().last()).map(|station| station.base);
    let place = ladar.unwrap_or(vehicle.origin());
    let ground_m = ground.height_m.at(place.x(), place.y()).map(|z| ground.base_m + f64::from(*z));
    let height_m = ladar.zip(ground_m).map(|(ladar, ground_m)| ladar.z() - ground_m);
    // A ladar on the ground or on a mast is no vehicle's: the pose or the ground is wrong there.
    let height_m = height_m.filter(|height_m| EYE_HEIGHTS_M.contains(height_m)).unwrap_or(config.ladar_height_m);
    let count = store.map_or(0, |store| store.stations().len());
    Eye { at_m: [place.x(), place.y()], height_m, stations: count.saturating_sub(STATIONS)..count }
}

/// Where the ladar was in the course of a survey, a step apart, wherever the ground below it is known.
fn eyes_of_survey(store: &Returns, ground: &Ground) -> Vec<Eye> {
    let mut eyes: Vec<Eye> = Vec::new();
    for (i, station) in store.stations().enumerate() {
        let at_m = [station.base.x(), station.base.y()];
        let is_apart = |eye: &Eye| (eye.at_m[0] - at_m[0]).hypot(eye.at_m[1] - at_m[1]) >= EYE_STEP_M;
        let ground_m = ground.height_m.at(at_m[0], at_m[1]).map(|z| ground.base_m + f64::from(*z));
        let height_m = ground_m.map_or(f64::NAN, |ground_m| station.base.z() - ground_m);
        if EYE_HEIGHTS_M.contains(&height_m) && eyes.iter().all(is_apart) {
            let stations = i.saturating_sub(STATIONS / 2)..i + STATIONS / 2;
            eyes.push(Eye { at_m, height_m, stations });
        }
    }
    eyes
}

/// Density, convolution (2-16), threshold, clustering.
fn thesis_trunks(view: &View, ground: &Ground, columns: &Columns, config: &Config) -> Trunks {
    let kernel = trunk_kernel(&config.trunk, view.shape.cell_m);
    let response = convolve(&columns.tree_density, &kernel);
    let candidates = clusters(&response, |r| f64::from(*r) >= config.trunk.threshold);
    let scene = Scene { view, ground, columns, response: &response };
    trunks(&scene, &candidates, &config.trunk)
}
