//! The demo's scorecard: what the system reported against what the simulator knows.
//!
//! In: reports as they arrive on the topics. Out: figures with units in their names; `None` where nothing could be
//! measured, which JSON shows as null.

use crate::graph::{ProcessRow, Status};
use serde::Serialize;
use std::collections::BTreeMap;
use tsense_contract::{COST_LETHAL, COST_UNKNOWN, CellClass, Class, GridCell, GridHeader, GroundEvidence, Object};
use tsense_simulator::{
    BrushScore, HazardCell, HazardScore, HeightScore, KindScore, ReportedThing, ReportedTree, Share, ThingKind,
    ThingScore, TreeScore, World, score_brush, score_ground, score_hazards, score_things, score_trees,
};

/// Most cells remembered: a drive of 4 km with a 30 m wide grid of 0.15 m cells would fill it.
const CELLS_MAX: usize = 5_000_000;
/// Most ages remembered: four hours at 20 detections a second.
const AGES_MAX: usize = 288_000;

/// What the demo prints at the end.
#[derive(Clone, Debug, Serialize)]
pub struct Scorecard {
    /// Trees that the knowledge store reports, against those that the sensor could see.
    pub trees: TreeScore,
    /// Ground heights of measured and interpolated cells.
    pub ground: HeightScore,
    /// Brush heights.
    pub brush: Brush,
    /// What must not be driven over, and what may.
    pub hazards: HazardScore,
    /// Rocks, walls, drops and brush that the knowledge store reports.
    pub things: ThingScore,
    /// Beams measured per second of the world, from the first scan on.
    pub beams_per_s: f64,
    /// Samples, scans and detections dropped by all processes, whatever the cause.
    pub dropped: u64,
    /// Age of detections when a reader gets them.
    pub detection_age_ms: Ages,
    /// Restarts of all processes.
    pub restarts: u64,
    /// The processes at the end.
    pub processes: Vec<ProcessRow>,
    /// Seconds of real time until every process was up; null where that never happened.
    pub up_after_s: Option<f64>,
    /// Seconds of the world that the demo ran.
    pub duration_s: f64,
}

/// Brush heights against the truth, and whether brush was found where it is.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Brush {
    /// Over cells where both see brush, metres.
    pub height_rmse_m: Option<f64>,
    /// Mean error of those, metres.
    pub height_bias_m: Option<f64>,
    /// Cells compared.
    pub cells: usize,
    /// Share of the cells reported as brush that are.
    pub precision: f64,
    /// Share of the brush cells seen that were reported.
    pub recall: f64,
}

impl From<BrushScore> for Brush {
    fn from(score: BrushScore) -> Self {
        let HeightScore { cells, rmse_m, bias_m } = score.height;
        let BrushScore { precision, recall, .. } = score;
        Self { height_rmse_m: rmse_m, height_bias_m: bias_m, cells, precision, recall }
    }
}

/// What the demo measured besides the reports themselves.
#[derive(Clone, Debug)]
pub struct Flow {
    /// Beams measured per second of the world.
    pub beams_per_s: f64,
    /// Ages of detections.
    pub ages: Ages,
    /// Seconds of the world that the demo ran.
    pub duration_s: f64,
    /// Seconds of real time until every process was up.
    pub up_after_s: Option<f64>,
}

impl Scorecard {
    /// Scores the reported trees and the grid's cells against the world.
    pub fn new(
        status: &Status,
        world: &World,
        counted: &[bool],
        objects: &[Object],
        cells: &GridLog,
        flow: Flow,
    ) -> Self {
        let scene = world.scene();
        let trees = objects.iter().filter(|object| Class::from_wire(object.class) == Class::Tree);
        let reported: Vec<_> = trees.map(reported_tree).collect();
        let things: Vec<_> = objects.iter().filter_map(reported_thing).collect();
        let place = |[e, n]: [f64; 2], height: f64| [e, n, height];
        Self {
            trees: score_trees(&scene.true_trees(), counted, &reported),
            ground: score_ground(scene, cells.cells().map(|(at, cell)| place(at, cell.ground_m))),
            brush: score_brush(scene, cells.cells().map(|(at, cell)| place(at, cell.vegetation_m))).into(),
            hazards: score_hazards(scene, cells.hazard_cells()),
            things: score_things(scene, &things, |at_m| cells.is_known(at_m)),
            beams_per_s: flow.beams_per_s,
            dropped: status.processes.iter().flat_map(|row| row.dropped.values()).sum(),
            detection_age_ms: flow.ages,
            restarts: status.processes.iter().map(|row| row.restarts).sum(),
            processes: status.processes.clone(),
            up_after_s: flow.up_after_s,
            duration_s: flow.duration_s,
        }
    }

    /// For people.
    pub fn to_text(&self) -> String {
        let metres = |value: Option<f64>| value.map_or("-".to_owned(), |m| format!("{m:.3} m"));
        let ms = |value: Option<f64>| value.map_or("-".to_owned(), |ms| format!("{ms:.0} ms"));
        let t = &self.trees;
        let mut lines = vec![
            format!(
                "trees        {} in sight, {} reported, {} right",
                t.truth,
                t.reported,
                t.matched + t.matched_uncounted
            ),
            format!("             precision {:.2}, recall {:.2}", t.precision, t.recall),
            format!("             position {}, DBH {} (rms)", metres(t.position_rmse_m), metres(t.dbh_rmse_m)),
            format!("ground       {} rms over {} cells", metres(self.ground.rmse_m), self.ground.cells),
            format!("brush        {} rms height over {} cells", metres(self.brush.height_rmse_m), self.brush.cells),
            format!("             precision {:.2}, recall {:.2}", self.brush.precision, self.brush.recall),
            self.hazards_line(),
            self.things_line(),
            format!("beams        {:.0} a second", self.beams_per_s),
            format!(
                "detections   {} old at the median, {} at p99",
                ms(self.detection_age_ms.p50),
                ms(self.detection_age_ms.p99)
            ),
            format!("dropped      {}", self.dropped),
            format!("restarts     {}", self.restarts),
        ];
        for row in &self.processes {
            for (cause, count) in &row.dropped {
                lines.push(format!("             {}: {count} {cause}", row.name));
            }
        }
        lines.join("\n") + "\n"
    }
}

impl Scorecard {
    fn hazards_line(&self) -> String {
        let share = |share: Share| share.share.map_or("-".to_owned(), |s| format!("{:.0} %", 100.0 * s));
        let h = &self.hazards;
        format!(
            "hazards      found: ditch {} (named {}), rocks {}, walls {}; false on clear ground: {}, drops {}",
            share(h.drops),
            share(h.drops_by_name),
            share(h.rocks),
            share(h.walls),
            share(h.false_lethal),
            share(h.false_drops),
        )
    }

    fn things_line(&self) -> String {
        let of = |kind: KindScore| format!("{} of {}", kind.right, kind.reported);
        let t = &self.things;
        format!(
            "things       right of those reported: rocks {} ({} of {} found), walls {}, drops {}, brush {}",
            of(t.rocks),
            t.rocks_found,
            t.rocks_true,
            of(t.walls),
            of(t.drops),
            of(t.brush),
        )
    }
}

fn reported_thing(object: &Object) -> Option<ReportedThing> {
    let kind = match Class::from_wire(object.class) {
        Class::Rock => ThingKind::Rock,
        Class::Wall => ThingKind::Wall,
        Class::Drop => ThingKind::Drop,
        Class::Brush => ThingKind::Brush,
        Class::Tree | Class::Unknown => return None,
    };
    Some(ReportedThing { kind, at_m: [object.easting_m, object.northing_m] })
}

fn reported_tree(object: &Object) -> ReportedTree {
    let dbh_m = f64::from(object.dbh_m);
    ReportedTree { easting_m: object.easting_m, northing_m: object.northing_m, dbh_m }
}

/// Age of a detection when a reader gets it, counted from the newest beam it rests on.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Ages {
    /// Median, milliseconds.
    pub p50: Option<f64>,
    /// 99th percentile, milliseconds.
    pub p99: Option<f64>,
}

/// Collects ages.
#[derive(Debug, Default)]
pub struct AgeLog {
    ages_ms: Vec<f64>,
}

impl AgeLog {
    /// Adds an age, milliseconds.
    pub fn add(&mut self, age_ms: f64) {
        if self.ages_ms.len() < AGES_MAX {
            self.ages_ms.push(age_ms);
        }
    }

    /// The percentiles so far.
    pub fn ages(&self) -> Ages {
        let mut sorted = self.ages_ms.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let last = sorted.len().checked_sub(1)?;
            sorted.get((share * last as f64).round() as usize).copied()
        };
        Ages { p50: at(0.5), p99: at(0.99) }
    }
}

/// What the grid last said of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellReport {
    /// Ground height above the ellipsoid, metres.
    pub ground_m: f64,
    /// Vegetation height above ground, metres.
    pub vegetation_m: f64,
}

/// The newest report of every cell whose ground was measured or interpolated, and of every cell with a known cost.
#[derive(Debug, Default)]
pub struct GridLog {
    cells: BTreeMap<[i32; 2], CellReport>,
    /// Cost and class.
    costs: BTreeMap<[i32; 2], (u8, u8)>,
    cell_m: f64,
}

impl GridLog {
    /// Takes in a grid; its known cells replace what was reported of them before.
    pub fn add(&mut self, header: &GridHeader, cells: &[GridCell]) {
        self.cell_m = header.cell_m;
        let width = header.width.max(1) as usize;
        for (index, cell) in cells.iter().enumerate() {
            let key = [header.first_cell[0] + (index % width) as i32, header.first_cell[1] + (index / width) as i32];
            if cell.cost != COST_UNKNOWN && (self.costs.len() < CELLS_MAX || self.costs.contains_key(&key)) {
                self.costs.insert(key, (cell.cost, cell.class));
            }
            let evidence = GroundEvidence::from_wire(cell.evidence);
            let is_known = matches!(evidence, GroundEvidence::Measured | GroundEvidence::Interpolated);
            if !is_known || cell.ground_m.is_nan() {
                continue;
            }
            if self.cells.len() < CELLS_MAX || self.cells.contains_key(&key) {
                let ground_m = header.base_m + f64::from(cell.ground_m);
                self.cells.insert(key, CellReport { ground_m, vegetation_m: f64::from(cell.vegetation_m) });
            }
        }
    }

    /// Easting, northing of each cell's centre, metres, with its report.
    pub fn cells(&self) -> impl Iterator<Item = ([f64; 2], CellReport)> + '_ {
        self.cells.iter().map(|(key, report)| (self.center_of(key), *report))
    }

    /// Whether the cost of the cell that holds a place is known.
    fn is_known(&self, at_m: [f64; 2]) -> bool {
        self.cell_m > 0.0 && self.costs.contains_key(&at_m.map(|c| (c / self.cell_m).floor() as i32))
    }

    /// Cells with a known cost.
    fn hazard_cells(&self) -> impl Iterator<Item = HazardCell> + '_ {
        self.costs.iter().map(|(key, (cost, class))| HazardCell {
            cell: *key,
            at_m: self.center_of(key),
            is_known: true,
            is_lethal: *cost == COST_LETHAL,
            is_drop: CellClass::from_wire(*class) == CellClass::Drop,
        })
    }

    fn center_of(&self, key: &[i32; 2]) -> [f64; 2] {
        key.map(|i| (f64::from(i) + 0.5) * self.cell_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn percentiles_of_a_hundred_ages() {
        let mut log = AgeLog::default();
        assert_eq!(log.ages(), Ages::default());
        (0..=100).rev().for_each(|age| log.add(f64::from(age)));
        assert_eq!(log.ages(), Ages { p50: Some(50.0), p99: Some(99.0) });
    }

    #[test]
    fn a_later_grid_replaces_a_cell_and_unknown_cells_stay_out() {
        let mut header = GridHeader::zeroed();
        (header.cell_m, header.base_m, header.width, header.height) = (0.5, 10.0, 2, 1);
        header.first_cell = [4, -2];
        let mut cells = [GridCell::zeroed(); 2];
        (cells[1].ground_m, cells[1].evidence) = (0.25, GroundEvidence::Measured.to_wire());
        let mut log = GridLog::default();
        log.add(&header, &cells);
        cells[1].ground_m = 0.5;
        log.add(&header, &cells);
        let all: Vec<_> = log.cells().collect();
        assert_eq!(all, vec![([2.75, -0.75], CellReport { ground_m: 10.5, vegetation_m: 0.0 })]);
    }
}
