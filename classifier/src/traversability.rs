//! What each cell costs to drive, and why: the largest of the costs of slope, roughness, step and what stands on it.
//!
//! In: the view, the ground, brush, trunks and drops. Out: cost, reason and class per cell. 0 is free, 253 the dearest
//! that may be driven, [`COST_LETHAL`] must not be driven, [`COST_UNKNOWN`] is kept apart: nothing was seen there.
//! Source: thesis, "Smart Sensor Grid"; limits in `[classifier.traversability]`.

use crate::columns::View;
use crate::config::{Config, TraversabilityConfig};
use crate::density::Columns;
use crate::ground::Ground;
use crate::plane_fit::PlaneSums;
use crate::returns::ReturnColumns;
use crate::solid::{Ground3d, TALL_MIN_M};
use tsense_contract::{COST_LETHAL, COST_UNKNOWN, CellClass, CostReason, GroundEvidence};
use tsense_geometry::Raster;

/// Dearest cost that may be driven.
const COST_DEAREST: f64 = 253.0;

/// Cost, reason and class of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost {
    /// 0 free to 253, [`COST_LETHAL`], [`COST_UNKNOWN`].
    pub cost: u8,
    /// What decided it.
    pub reason: CostReason,
    /// What stands there.
    pub class: CellClass,
}

/// What the cost of a cell is made from.
pub struct Terrain<'a> {
    /// The voxels.
    pub view: &'a View,
    /// The returns, where they were kept.
    pub returns: Option<&'a ReturnColumns>,
    /// The heights in which ground was seen, metres above the view's base, as they were measured.
    pub measured: &'a Raster<f32>,
    /// Planes through them, and through the ground.
    pub planes: &'a Planes,
    /// The ground.
    pub ground: &'a Ground,
    /// The columns above it.
    pub columns: &'a Columns,
    /// Height of what was met on each cell, up to the tallest brush.
    pub standing_m: &'a Raster<f32>,
    /// The same with the holes of brush filled.
    pub brush_m: &'a Raster<f32>,
    /// Columns of trunks.
    pub trunks: &'a Raster<bool>,
    /// Drops.
    pub drops: &'a Raster<bool>,
    /// Where something moves.
    pub moving: &'a Raster<bool>,
}

/// Planes through the ground as it was met, and through its whole surface.
#[derive(Default)]
pub struct Planes {
    /// Where it was met.
    pub measured: PlaneSums,
    /// Everywhere.
    pub surface: PlaneSums,
}

impl Planes {
    /// Planes of another ground, in the memory of these.
    pub fn again(self, measured_m: &Raster<f32>, ground_m: &Raster<f32>) -> Self {
        Self { measured: self.measured.again(measured_m), surface: self.surface.again(ground_m) }
    }
}

/// The cost of every cell.
pub fn traversability(terrain: &Terrain, config: &Config) -> Raster<Cost> {
    let shape = terrain.view.shape;
    let Terrain { view, returns, ground, standing_m, .. } = *terrain;
    let solid = Ground3d { view, returns, ground, height_m: standing_m }.solid(config.traversability.solid_density);
    let cell = |i: usize| terrain.cost((i % shape.width, i / shape.width), solid.cells()[i], config);
    Raster::from_cells(shape, (0..shape.len()).map(cell).collect()).expect("a cost a cell")
}

impl Terrain<'_> {
    fn cost(&self, at: (usize, usize), is_solid: bool, config: &Config) -> Cost {
        if self.moving[at] {
            return Cost { cost: COST_LETHAL, reason: CostReason::Moving, class: CellClass::Obstacle };
        }
        if self.drops[at] {
            return Cost { cost: COST_LETHAL, reason: CostReason::Drop, class: CellClass::Drop };
        }
        if self.trunks[at] {
            return Cost { cost: COST_LETHAL, reason: CostReason::Tree, class: CellClass::Tree };
        }
        if !self.was_seen(at) {
            return Cost { cost: COST_UNKNOWN, reason: CostReason::Unknown, class: CellClass::Unknown };
        }
        let limits = &config.traversability;
        let (class, standing) = self.standing(at, is_solid, limits);
        let (slope, roughness_m) = self.surface_of(at, limits);
        let step_m = self.step_m(at);
        let shares = [
            (slope / limits.slope_max, CostReason::Slope),
            (roughness_m / limits.roughness_max_m, CostReason::Roughness),
            (step_m / limits.step_max_m, CostReason::Step),
            standing,
            (self.clearance_share(at, config.vehicle.clearance_m), CostReason::Clearance),
        ];
        let (share, reason) =
            shares.into_iter().fold((0.0, CostReason::Clear), |most, next| if next.0 > most.0 { next } else { most });
        if share >= 1.0 {
            return Cost { cost: COST_LETHAL, reason, class };
        }
        // What costs less than a tenth is not worth a reason.
        let reason = if share < 0.1 { CostReason::Clear } else { reason };
        Cost { cost: (share * COST_DEAREST) as u8, reason, class }
    }

    /// Whether ground was seen or bridged here, or beams passed just above it.
    fn was_seen(&self, at: (usize, usize)) -> bool {
        let i = at.1 * self.view.shape.width + at.0;
        match self.ground.evidence[at] {
            GroundEvidence::Unknown => false,
            GroundEvidence::Extrapolated => {
                let level = self.columns.ground_level[i].max(0) as usize;
                let above = level + (1.0 / self.view.shape.cell_m) as usize;
                self.view.free.count(i, level, above) + self.view.occupied.count(i, level, above) > 0
            }
            _ => true,
        }
    }

    /// Rise over run, and the deviation from the local plane less what quantisation makes of it.
    fn surface_of(&self, at: (usize, usize), limits: &TraversabilityConfig) -> (f64, f64) {
        let cell_m = self.view.shape.cell_m;
        let radius = ((limits.radius_m / cell_m).round() as usize).max(1);
        let Planes { measured, surface } = self.planes;
        let plane = measured.fit(at.0, at.1, radius, 8).or_else(|| surface.fit(at.0, at.1, radius, 3));
        let Some(plane) = plane else { return (0.0, 0.0) };
        let quantisation_m = self.quantum_m() / 12f64.sqrt();
        (plane.steepness(), (plane.deviation_m.powi(2) - quantisation_m.powi(2)).max(0.0).sqrt())
    }

    /// How coarse measured heights are, metres: voxels, or returns.
    fn quantum_m(&self) -> f64 {
        if self.returns.is_some() { 0.0 } else { self.view.shape.cell_m }
    }

    /// Largest height difference to the measured cells around, less what quantisation may add.
    fn step_m(&self, at: (usize, usize)) -> f64 {
        let shape = self.view.shape;
        let here = self.measured[at];
        let mut step: f32 = 0.0;
        for row in at.1.saturating_sub(1)..(at.1 + 2).min(shape.height) {
            for column in at.0.saturating_sub(1)..(at.0 + 2).min(shape.width) {
                // NaN never is the larger one.
                step = step.max((self.measured[(column, row)] - here).abs());
            }
        }
        (f64::from(step) - self.quantum_m()).max(0.0)
    }

    /// What stands on the cell below the vehicle's clearance, and its share of a lethal cost.
    fn standing(
        &self,
        at: (usize, usize),
        is_solid: bool,
        limits: &TraversabilityConfig,
    ) -> (CellClass, (f64, CostReason)) {
        let brush_m = f64::from(self.brush_m[at]);
        if brush_m.is_nan() || brush_m <= 0.0 {
            return (CellClass::Ground, (0.0, CostReason::Clear));
        }
        if is_solid {
            // What is lower than a step that may be driven is a step; what is higher is an obstacle.
            return (CellClass::Obstacle, (brush_m / limits.step_max_m, CostReason::Obstacle));
        }
        // Brush can be pushed through: dear, never lethal.
        let share = (brush_m / limits.brush_max_m).min(0.99);
        (CellClass::Brush, (share, CostReason::Brush))
    }

    /// How much of the vehicle's clearance is taken by what hangs above the brush: 1 where it touches the brush.
    fn clearance_share(&self, at: (usize, usize), clearance_m: f64) -> f64 {
        let i = at.1 * self.view.shape.width + at.0;
        let cell_m = self.view.shape.cell_m;
        let ground_m = f64::from(self.ground.height_m[at]);
        let base_m = f64::from(self.brush_m[at].max(0.0)).max(TALL_MIN_M);
        let from = ((ground_m + base_m) / cell_m).ceil().max(0.0) as usize + 1;
        let to = ((ground_m + clearance_m) / cell_m).floor().max(0.0) as usize;
        match self.view.occupied.lowest(i, from, to) {
            Some(level) => (1.0 - (level as f64 * cell_m - ground_m) / clearance_m).clamp(0.0, 0.99),
            None => 0.0,
        }
    }
}
