//! From clusters of high response to trees, or to the reason why not.
//!
//! In: the view, the ground, the columns and the clusters that passed the threshold. Out: a [`Detection`] per tree and
//! a [`Rejected`] per other candidate. False trees must be rare: space that rays passed through is no trunk, a trunk
//! is occupied over a vertical run, stands alone, and is neither long nor big.
//!
//! Diameter: a disc of diameter d touches on average N = (pi/4 d^2 + 2 d s + s^2) / s^2 square cells of edge s (area,
//! perimeter and cell by the Santalo formula of integral geometry). N is counted in space that beams did not clear: each
//! column near the trunk counts with the share of its voxels around breast height that are not free, so the unseen
//! inside of a trunk counts as well, and d is solved for. The beam's width may be taken off, too. The deviation is that of
//! N for a disc thrown at random onto the grid, about 0.3 s on d, more where less of the circumference was seen.

use crate::cluster::Cell;
use crate::columns::View;
use crate::config::TrunkConfig;
use crate::density::Columns;
use crate::ground::Ground;
use tsense_contract::{Class, Detection};
use tsense_geometry::Raster;

/// Height at which trunks are measured, metres above ground.
pub const BREAST_HEIGHT_M: f64 = 1.3;
/// Half of the slice around breast height that diameter and position are taken from, metres.
const SLICE_HALF_M: f64 = 0.5;
/// Least share of that slice at which a column of the core is solid.
const SOLID_SHARE: f64 = 0.3;
/// How far outside the disc around the solid columns a column may belong to the trunk, cells: its neighbours' corners.
const RIM_CELLS: f64 = 0.8;

/// Why a candidate is no tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// No column of it is occupied at breast height.
    Empty,
    /// Beams pass through it.
    RaysPass,
    /// It is not occupied over enough of its height.
    NotVertical,
    /// It is too thin.
    TooThin,
    /// It is too wide.
    TooWide,
    /// It is too long for its width.
    Elongated,
    /// What surrounds it is occupied, too.
    Surrounded,
    /// It ends too low.
    TooLow,
    /// Too little of the space beside it was seen to be free.
    Hidden,
    /// No stem can be fitted to its returns.
    NoFit,
    /// It leans too far.
    Leaning,
    /// Beams end in front of and behind its surface, too.
    Scattered,
    /// Echoes lie too far off its surface.
    Rough,
    /// Another stem explains its returns better.
    Double,
    /// A wall goes on beside it.
    Flat,
}

impl Reason {
    /// All reasons.
    pub const ALL: [Self; 15] = [
        Self::Empty,
        Self::RaysPass,
        Self::NotVertical,
        Self::TooThin,
        Self::TooWide,
        Self::Elongated,
        Self::Surrounded,
        Self::TooLow,
        Self::Hidden,
        Self::NoFit,
        Self::Leaning,
        Self::Scattered,
        Self::Rough,
        Self::Double,
        Self::Flat,
    ];
    /// In a few words.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Empty => "nothing at breast height",
            Self::RaysPass => "rays pass through",
            Self::NotVertical => "not occupied over its height",
            Self::TooThin => "too thin",
            Self::TooWide => "too wide",
            Self::Elongated => "too long for its width",
            Self::Surrounded => "surrounded",
            Self::TooLow => "too low",
            Self::Hidden => "free space beside it not seen",
            Self::NoFit => "no stem fits",
            Self::Leaning => "leans too far",
            Self::Scattered => "rays end around its surface",
            Self::Rough => "no smooth surface",
            Self::Double => "part of another stem",
            Self::Flat => "part of a wall",
        }
    }
}

/// A candidate that is no tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rejected {
    /// Easting and northing of the cluster's centre, metres.
    pub at_m: [f64; 2],
    /// Why.
    pub reason: Reason,
    /// The figure that decided: a share, a ratio or metres, as the limit of the same name in the configuration.
    pub value: f64,
}

/// Trees, the cells they stand on, and rejected candidates.
#[derive(Clone, Debug)]
pub struct Trunks {
    /// Trees in the order of their southernmost cell.
    pub trees: Vec<Detection>,
    /// True in the columns of trunks.
    pub mask: Raster<bool>,
    /// The other candidates.
    pub rejected: Vec<Rejected>,
}

/// What every candidate is tested against.
pub struct Scene<'a> {
    /// The voxels.
    pub view: &'a View,
    /// The ground.
    pub ground: &'a Ground,
    /// The columns above it.
    pub columns: &'a Columns,
    /// The convolution's response.
    pub response: &'a Raster<f32>,
}

/// Tests every cluster.
pub fn trunks(scene: &Scene, clusters: &[Vec<Cell>], config: &TrunkConfig) -> Trunks {
    let mut found = Trunks { trees: Vec::new(), mask: Raster::filled(scene.view.shape, false), rejected: Vec::new() };
    for cluster in clusters {
        match Candidate::of(scene, cluster).and_then(|candidate| candidate.proven(scene, config)) {
            Ok((tree, cells)) => {
                found.trees.push(tree);
                cells.into_iter().for_each(|cell| found.mask[cell] = true);
            }
            Err((reason, value)) => {
                found.rejected.push(Rejected { at_m: center_m(scene.view, cluster), reason, value });
            }
        }
    }
    found
}

type Verdict<T> = Result<T, (Reason, f64)>;

/// A cluster and the columns of it that are occupied at breast height.
struct Candidate {
    /// Columns that are more occupied than free above ground: the core.
    core: Vec<Cell>,
    /// Ground below it, metres above the view's base.
    ground_m: f64,
    /// Largest response.
    response: f64,
}

fn center_m(view: &View, cells: &[Cell]) -> [f64; 2] {
    let n = cells.len().max(1) as f64;
    let sum = cells.iter().map(|&(column, row)| view.shape.center_of(column, row));
    sum.fold([0.0; 2], |[x, y], [cx, cy]| [x + cx / n, y + cy / n])
}

impl Candidate {
    fn of(scene: &Scene, cluster: &[Cell]) -> Verdict<Self> {
        let response = cluster.iter().map(|&cell| f64::from(scene.response[cell])).fold(0.0, f64::max);
        let core: Vec<Cell> = cluster.iter().copied().filter(|&cell| scene.columns.tree_density[cell] > 0.0).collect();
        if core.is_empty() {
            return Err((Reason::Empty, 0.0));
        }
        let ground_m = core.iter().map(|&cell| f64::from(scene.ground.height_m[cell])).sum::<f64>() / core.len() as f64;
        Ok(Self { core, ground_m, response })
    }

    /// All tests in the order of their price, then the measurements.
    fn proven(self, scene: &Scene, config: &TrunkConfig) -> Verdict<(Detection, Vec<Cell>)> {
        let view = scene.view;
        let (from, to) = (level(view, self.ground_m, config.proof_m[0]), level(view, self.ground_m, config.proof_m[1]));
        at_most(Reason::TooWide, self.extent_m(view), config.extent_max_m)?;
        at_most(Reason::Elongated, self.elongation(), config.elongation_max)?;
        let fill = self.fill(view, from, to);
        at_least(Reason::NotVertical, fill, config.fill_min)?;
        let free_share = self.free_share(view, from, to);
        at_most(Reason::RaysPass, free_share, config.free_share_max)?;
        let height_m = height_above_m(view, &self.core, self.ground_m);
        at_least(Reason::TooLow, height_m, config.height_min_m)?;
        let slice = self.slice(view)?;
        let (surround, arc) = self.surroundings(view, from, to);
        at_most(Reason::Surrounded, surround, config.surround_max)?;
        at_least(Reason::Hidden, arc, config.arc_min)?;
        let confidence = fill * (1.0 - free_share) * (self.response / (3.0 * config.threshold.max(0.01))).min(1.0);
        Ok((self.detection(scene, &slice, [height_m, arc, confidence], config), self.core))
    }

    /// Long side of the box around the core.
    fn extent_m(&self, view: &View) -> f64 {
        let span = |of: fn(&Cell) -> usize| {
            let (low, high) = self.core.iter().map(of).fold((usize::MAX, 0), |(l, h), v| (l.min(v), h.max(v)));
            high + 1 - low
        };
        span(|cell| cell.0).max(span(|cell| cell.1)) as f64 * view.shape.cell_m
    }

    /// Ratio of the long to the short axis of the core; a cell's own width keeps one cell round.
    fn elongation(&self) -> f64 {
        let n = self.core.len() as f64;
        let mean = |of: &dyn Fn(&Cell) -> f64| self.core.iter().map(of).sum::<f64>() / n;
        let (mx, my) = (mean(&|c| c.0 as f64), mean(&|c| c.1 as f64));
        let xx = mean(&|c| (c.0 as f64 - mx).powi(2)) + 1.0 / 12.0;
        let yy = mean(&|c| (c.1 as f64 - my).powi(2)) + 1.0 / 12.0;
        let xy = mean(&|c| (c.0 as f64 - mx) * (c.1 as f64 - my));
        let (half, root) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
        ((half + root) / (half - root).max(1e-9)).sqrt()
    }

    /// Share of levels at which some column of the core is occupied.
    fn fill(&self, view: &View, from: usize, to: usize) -> f64 {
        let occupied = |level| self.core.iter().any(|&cell| view.occupied.contains(index(view, cell), level));
        (from..to).filter(|&level| occupied(level)).count() as f64 / (to - from).max(1) as f64
    }

    /// Share of free among the known voxels of the core.
    fn free_share(&self, view: &View, from: usize, to: usize) -> f64 {
        let (mut free, mut occupied) = (0, 0);
        for &cell in &self.core {
            free += view.free.count(index(view, cell), from, to);
            occupied += view.occupied.count(index(view, cell), from, to);
        }
        free as f64 / (free + occupied).max(1) as f64
    }

    /// The columns around the core with what beams left of them around breast height.
    fn slice(&self, view: &View) -> Verdict<Slice> {
        let from = level(view, self.ground_m, BREAST_HEIGHT_M - SLICE_HALF_M);
        let to = level(view, self.ground_m, BREAST_HEIGHT_M + SLICE_HALF_M);
        let share = |count: usize| count as f64 / (to - from) as f64;
        let mut solid = self.core.clone();
        solid.retain(|&cell| share(view.occupied.count(index(view, cell), from, to)) >= SOLID_SHARE);
        let Some((center, radius)) = disc_around(&solid) else { return Err((Reason::Empty, 0.0)) };
        let near = |cell: &Cell| (cell.0 as f64 - center[0]).hypot(cell.1 as f64 - center[1]) <= radius + RIM_CELLS;
        let kept = |cell: Cell| (cell, 1.0 - share(view.free.count(index(view, cell), from, to)));
        let columns = neighbourhood(view, &self.core, 1).into_iter().filter(near).map(kept).collect();
        Ok(Slice { columns })
    }

    /// Occupied share of the ring two to three cells outside the core, and the share of its cells that are mostly free.
    fn surroundings(&self, view: &View, from: usize, to: usize) -> (f64, f64) {
        let inner = neighbourhood(view, &self.core, 1);
        let mut ring = neighbourhood(view, &self.core, 3);
        ring.retain(|cell| inner.binary_search_by_key(&(cell.1, cell.0), |&(c, r)| (r, c)).is_err());
        let (mut occupied, mut open) = (0, 0);
        for &cell in &ring {
            occupied += view.occupied.count(index(view, cell), from, to);
            open += usize::from(view.free.count(index(view, cell), from, to) * 3 >= to - from);
        }
        let cells = ring.len().max(1) as f64;
        (occupied as f64 / (cells * (to - from).max(1) as f64), open as f64 / cells)
    }

    fn detection(
        &self,
        scene: &Scene,
        slice: &Slice,
        [height, arc, confidence]: [f64; 3],
        config: &TrunkConfig,
    ) -> Detection {
        let cell_m = scene.view.shape.cell_m;
        let [easting_m, northing_m] = slice.center_m(scene.view);
        let dbh_m = slice.diameter_m(cell_m, config.beam_width_m);
        let unseen = 1.0 + (1.0 - arc);
        Detection {
            easting_m,
            northing_m,
            ground_m: scene.ground.base_m + self.ground_m,
            position_std_m: (0.25 * cell_m * unseen) as f32,
            dbh_m: dbh_m as f32,
            dbh_std_m: (0.3 * cell_m * unseen) as f32,
            height_m: height as f32,
            confidence: confidence.clamp(0.0, 1.0) as f32,
            arc_coverage: arc as f32,
            lean_rad: [0.0; 2],
            class: Class::Tree.to_wire(),
            stamp_ns: 0,
            reserved: [0; 7],
        }
    }
}

fn level(view: &View, ground_m: f64, height_m: f64) -> usize {
    ((ground_m + height_m) / view.shape.cell_m).round().max(0.0) as usize
}

fn index(view: &View, (column, row): Cell) -> usize {
    row * view.shape.width + column
}

/// All cells within `radius` cells of some cells (a square around each).
fn neighbourhood(view: &View, cells: &[Cell], radius: usize) -> Vec<Cell> {
    let mut cells: Vec<Cell> = cells.iter().flat_map(|cell| view.shape.around(*cell, radius)).collect();
    cells.sort_unstable_by_key(|&(column, row)| (row, column));
    cells.dedup();
    cells
}

/// Top of what is connected to a trunk's cells from breast height upwards, within half a metre around them and over gaps
/// of at most a metre (crowns are sparse), metres above ground. `ground_m` is metres above the view's base.
pub fn height_above_m(view: &View, cells: &[Cell], ground_m: f64) -> f64 {
    let cell_m = view.shape.cell_m;
    let gap_max = (1.0 / cell_m).round() as usize;
    let near = neighbourhood(view, cells, (0.5 / cell_m).round() as usize);
    let mut top = level(view, ground_m, BREAST_HEIGHT_M);
    while let Some(next) =
        near.iter().filter_map(|&cell| view.occupied.highest(index(view, cell), top + 1, top + 1 + gap_max)).max()
    {
        top = next;
    }
    (top + 1) as f64 * cell_m - ground_m
}

fn at_most(reason: Reason, value: f64, limit: f64) -> Verdict<()> {
    if value <= limit { Ok(()) } else { Err((reason, value)) }
}

fn at_least(reason: Reason, value: f64, limit: f64) -> Verdict<()> {
    if value >= limit { Ok(()) } else { Err((reason, value)) }
}

/// The disc around cells, in cells: centre of their bounding box, half its long side.
fn disc_around(cells: &[Cell]) -> Option<([f64; 2], f64)> {
    let ends = |of: fn(&Cell) -> usize| {
        cells.iter().map(of).fold(None, |ends, v| match ends {
            None => Some((v, v)),
            Some((low, high)) => Some((v.min(low), v.max(high))),
        })
    };
    let ((x0, x1), (y0, y1)) = (ends(|cell| cell.0)?, ends(|cell| cell.1)?);
    let middle = |low: usize, high: usize| (low + high) as f64 / 2.0;
    Some(([middle(x0, x1), middle(y0, y1)], ((x1 - x0).max(y1 - y0) + 1) as f64 / 2.0))
}

/// Columns of a trunk around breast height, each with the share that beams did not clear.
struct Slice {
    columns: Vec<(Cell, f64)>,
}

impl Slice {
    /// Centroid of what beams left.
    fn center_m(&self, view: &View) -> [f64; 2] {
        let total: f64 = self.columns.iter().map(|(_, share)| share).sum();
        let mut center = [0.0; 2];
        for &((column, row), share) in &self.columns {
            let at = view.shape.center_of(column, row);
            (center[0], center[1]) = (center[0] + at[0] * share / total, center[1] + at[1] * share / total);
        }
        center
    }

    fn diameter_m(&self, cell_m: f64, beam_width_m: f64) -> f64 {
        let cells = self.columns.iter().map(|(_, share)| share).sum();
        // Nothing thinner than 2 cm is called a trunk.
        (touching_diameter_m(cells, cell_m) - beam_width_m).max(0.02)
    }
}

/// Diameter of the disc that touches `cells` cells on average: pi/4 d^2 + 2 d s + s^2 (1 - N) = 0.
fn touching_diameter_m(cells: f64, cell_m: f64) -> f64 {
    use std::f64::consts::PI;
    2.0 * cell_m / PI * ((4.0 + PI * (cells - 1.0).max(0.0)).sqrt() - 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Throws discs onto the grid and counts the cells that they touch.
    #[test]
    fn the_number_of_touched_cells_gives_the_diameter_back() {
        let (mut seed, mut discs) = (3u64, 0);
        let mut random = || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        for diameter in [0.1, 0.25, 0.5] {
            let mut sum = 0.0;
            for _ in 0..2000 {
                let (x, y) = (10.0 + random(), 10.0 + random());
                let touched = (0..400).filter(|i| {
                    let near = |low: f64, c: f64| c.clamp(low, low + 1.0) - c;
                    near((i % 20) as f64, x).hypot(near((i / 20) as f64, y)) < diameter / 0.15 / 2.0
                });
                sum += touched.count() as f64;
                discs += 1;
            }
            let back = touching_diameter_m(sum / 2000.0, 0.15);
            assert!((back - diameter).abs() < 0.005, "{diameter}: {back}");
        }
        assert_eq!(discs, 6000);
    }
}
