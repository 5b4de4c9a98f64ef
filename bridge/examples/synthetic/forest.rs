//! A small forest as the bridge would be told of it: map blocks, grid, objects, scans, processes.
//!
//! Made by formula from a seed for tests and pictures of the page alone; it is no simulator: nothing is measured, and
//! nobody may draw conclusions about perception from it. World coordinates in metres, UTM zone 17 north.

use bytemuck::Zeroable;
use std::collections::{BTreeMap, BTreeSet};
use tsense_bridge::web::scene::Scene;
use tsense_contract::*;
use tsense_geometry::{Timestamp, VoxelIndex};

/// Edge of a voxel and of a grid cell, metres.
pub const VOXEL_M: f64 = 0.15;
/// Where the vehicle stands, a whole number of blocks (15 m) from the UTM origin.
pub const CENTER_M: [f64; 2] = [369_007.5, 3_279_007.5];
/// Half the edge of the square that is seen, metres.
const HALF_M: f64 = 15.0;
const CELLS: i32 = 200;

/// A tree of the formula.
#[derive(Clone, Copy, Debug)]
pub struct Tree {
    /// Metres east and north of the vehicle.
    pub at_m: [f64; 2],
    /// Radius of the trunk, metres.
    pub radius_m: f64,
    /// Height, metres.
    pub height_m: f64,
}

/// The forest.
pub struct Forest {
    /// Its trees.
    pub trees: Vec<Tree>,
    /// Occupied voxels.
    pub voxels: BTreeSet<VoxelIndex>,
    cells: BTreeMap<[i32; 2], (CellClass, f64)>,
}

/// Numbers in 0..1 from a seed (splitmix64).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// Ground height at metres east and north of the vehicle: rolling, with a ditch in the north-east.
pub fn ground_m(x: f64, y: f64) -> f64 {
    let ditch = (x + 0.4 * y - 11.0) / 0.9;
    30.0 + 0.45 * (x / 6.0).sin() + 0.35 * (y / 5.0 + 1.0).cos() + 0.03 * y - 0.9 * (-ditch * ditch).exp()
}

fn voxel_at(x: f64, y: f64, z: f64) -> VoxelIndex {
    [CENTER_M[0] + x, CENTER_M[1] + y, z].map(|c| (c / VOXEL_M).floor() as i32)
}

impl Forest {
    /// The forest of a seed.
    pub fn new(seed: u64) -> Self {
        let mut numbers = Numbers(seed);
        let mut forest = Self { trees: Vec::new(), voxels: BTreeSet::new(), cells: BTreeMap::new() };
        forest.plant(&mut numbers);
        forest.grow_ground(&mut numbers);
        for tree in forest.trees.clone() {
            forest.grow_tree(tree, &mut numbers);
        }
        for _ in 0..9 {
            forest.grow_brush(&mut numbers);
        }
        forest.put_rock([6.5, -3.5], 0.7);
        forest
    }

    fn plant(&mut self, numbers: &mut Numbers) {
        while self.trees.len() < 16 {
            let at_m = [numbers.between(-14.0, 14.0), numbers.between(-14.0, 14.0)];
            let apart = |tree: &Tree| (tree.at_m[0] - at_m[0]).hypot(tree.at_m[1] - at_m[1]) > 3.0;
            if at_m[0].hypot(at_m[1]) > 4.0 && self.trees.iter().all(apart) {
                let (radius_m, height_m) = (numbers.between(0.1, 0.26), numbers.between(6.5, 11.0));
                self.trees.push(Tree { at_m, radius_m, height_m });
            }
        }
    }

    /// True where a trunk hides the place from the vehicle.
    fn shadowed(&self, x: f64, y: f64) -> bool {
        self.trees.iter().any(|tree| {
            let [tx, ty] = tree.at_m;
            let (far, near) = (x.hypot(y), tx.hypot(ty));
            far > near + 0.3 && ((x * ty - y * tx) / far).abs() < tree.radius_m && x * tx + y * ty > 0.0
        })
    }

    fn grow_ground(&mut self, numbers: &mut Numbers) {
        for i in 0..CELLS * CELLS {
            let (x, y) = (f64::from(i % CELLS) * VOXEL_M - HALF_M, f64::from(i / CELLS) * VOXEL_M - HALF_M);
            let thin = (x.hypot(y) / 19.0).powi(2);
            if numbers.next() > thin && !self.shadowed(x, y) {
                let voxel = voxel_at(x, y, ground_m(x, y) + numbers.between(-0.04, 0.04));
                self.voxels.insert(voxel);
                self.cells.entry([voxel[0], voxel[1]]).or_insert((CellClass::Ground, 0.0));
            }
        }
    }

    fn grow_tree(&mut self, tree: Tree, numbers: &mut Numbers) {
        let ground = ground_m(tree.at_m[0], tree.at_m[1]);
        let mut z = 0.0;
        while z < tree.height_m {
            let radius = tree.radius_m * (1.0 - 0.7 * z / tree.height_m);
            for turn in 0..24 {
                let angle = f64::from(turn) * std::f64::consts::TAU / 24.0;
                let (x, y) = (tree.at_m[0] + radius * angle.cos(), tree.at_m[1] + radius * angle.sin());
                self.voxels.insert(voxel_at(x, y, ground + z));
                if z < 2.0 {
                    let [column, row, _] = voxel_at(x, y, 0.0);
                    self.cells.insert([column, row], (CellClass::Tree, 0.0));
                }
            }
            z += 0.1;
        }
        for _ in 0..420 {
            let (angle, up) = (numbers.between(0.0, std::f64::consts::TAU), numbers.next());
            let reach = 1.9 * (1.0 - up).sqrt() * numbers.next().sqrt();
            let z = ground + tree.height_m * (0.55 + 0.45 * up);
            self.voxels.insert(voxel_at(tree.at_m[0] + reach * angle.cos(), tree.at_m[1] + reach * angle.sin(), z));
        }
    }

    fn grow_brush(&mut self, numbers: &mut Numbers) {
        let (cx, cy) = (numbers.between(-12.0, 12.0), numbers.between(-12.0, 12.0));
        if cx.hypot(cy) < 3.5 {
            return;
        }
        let (radius, height) = (numbers.between(0.9, 2.0), numbers.between(0.6, 1.5));
        for _ in 0..(radius * radius * 550.0) as usize {
            let (angle, part) = (numbers.between(0.0, std::f64::consts::TAU), numbers.next().sqrt());
            let (x, y) = (cx + radius * part * angle.cos(), cy + radius * part * angle.sin());
            let top = height * (1.0 - part * part);
            let voxel = voxel_at(x, y, ground_m(x, y) + top * numbers.between(0.3, 1.0));
            self.voxels.insert(voxel);
            let cell = self.cells.entry([voxel[0], voxel[1]]).or_insert((CellClass::Brush, top));
            if cell.0 != CellClass::Tree {
                *cell = (CellClass::Brush, cell.1.max(top));
            }
        }
    }

    fn put_rock(&mut self, at: [f64; 2], radius: f64) {
        for i in 0..4000 {
            let (angle, up) = (f64::from(i) * 2.399, f64::from(i) / 4000.0);
            let reach = radius * (1.0 - up * up).sqrt();
            let (x, y) = (at[0] + reach * angle.cos(), at[1] + reach * angle.sin());
            let voxel = voxel_at(x, y, ground_m(x, y) + 0.8 * radius * up);
            self.voxels.insert(voxel);
            self.cells.insert([voxel[0], voxel[1]], (CellClass::Obstacle, 0.0));
        }
    }

    /// The map as blocks of bricks.
    pub fn blocks(&self) -> BTreeMap<BlockKey, Vec<Brick>> {
        let mut blocks = BTreeMap::new();
        for voxel in &self.voxels {
            let (key, brick, inner) = locate(*voxel);
            let bricks: &mut Vec<Brick> = blocks.entry(key).or_insert_with(|| vec![Brick::UNKNOWN; BRICKS_PER_BLOCK]);
            (bricks[brick].occupancy[inner], bricks[brick].confidence[inner]) = (20, 30);
        }
        blocks
    }

    /// Sends the map as one snapshot; every block has version `version`.
    pub fn send_map(&self, scene: &mut Scene, version: u32, now: Timestamp) {
        let mut entries = Vec::new();
        for (key, bricks) in self.blocks() {
            scene.map(&map_header(MapSampleKind::Block, key, version, version, now), bricks, now);
            entries.push(CommitEntry { key, version });
        }
        send_commit(scene, &entries, version, now);
    }

    /// The grid around the vehicle.
    pub fn grid(&self, now: Timestamp) -> (GridHeader, Vec<GridCell>) {
        let first_cell = [0, 1].map(|axis| ((CENTER_M[axis] - HALF_M) / VOXEL_M).round() as i32);
        let side = CELLS as u32;
        let header = GridHeader {
            stamp_ns: now.ns,
            cell_m: VOXEL_M,
            base_m: 30.0,
            first_cell,
            width: side,
            height: side,
            zone: 17,
            ..GridHeader::zeroed()
        };
        let cells = (0..CELLS * CELLS).map(|i| self.cell(i % CELLS, i / CELLS, first_cell)).collect();
        (header, cells)
    }

    fn cell(&self, column: i32, row: i32, first: [i32; 2]) -> GridCell {
        let (x, y) = ((f64::from(column) + 0.5) * VOXEL_M - HALF_M, (f64::from(row) + 0.5) * VOXEL_M - HALF_M);
        let ground = ground_m(x, y) - 30.0;
        let seen = self.cells.get(&[first[0] + column, first[1] + row]);
        let known = seen.is_some() || (x.hypot(y) < 12.5 && !self.shadowed(x, y));
        let (class, vegetation) = seen.copied().unwrap_or((CellClass::Unknown, 0.0));
        let slope =
            (ground_m(x + 0.3, y) - ground_m(x - 0.3, y)).hypot(ground_m(x, y + 0.3) - ground_m(x, y - 0.3)) / 0.6;
        let (cost, reason) = match class {
            _ if !known => (COST_UNKNOWN, CostReason::Unknown),
            CellClass::Tree => (COST_LETHAL, CostReason::Tree),
            CellClass::Obstacle => (COST_LETHAL, CostReason::Obstacle),
            _ if slope > 0.7 => (COST_LETHAL, CostReason::Drop),
            CellClass::Brush => ((60.0 + vegetation * 110.0).min(253.0) as u8, CostReason::Brush),
            _ => ((slope * 330.0).min(253.0) as u8, if slope > 0.15 { CostReason::Slope } else { CostReason::Clear }),
        };
        let evidence = match (seen.is_some(), known) {
            (true, _) => GroundEvidence::Measured,
            (false, true) if x.hypot(y) < 1.5 => GroundEvidence::VehiclePlane,
            (false, true) => GroundEvidence::Interpolated,
            (false, false) => GroundEvidence::Unknown,
        };
        let class = if known && class == CellClass::Unknown { CellClass::Ground } else { class };
        GridCell {
            ground_m: if known { ground as f32 } else { f32::NAN },
            ground_std_mm: 30,
            vegetation_m: vegetation as f32,
            density_pct: if class == CellClass::Brush { 90 } else { 0 },
            cost,
            reason: reason.to_wire(),
            evidence: evidence.to_wire(),
            class: class.to_wire(),
            reserved: 0,
        }
    }

    /// The trees as the store would report them.
    pub fn objects(&self, now: Timestamp) -> (ObjectsHeader, Vec<Object>) {
        let list = self.trees.iter().enumerate().map(|(i, tree)| Object {
            id: i as u64 + 1,
            last_seen_ns: now.ns - 400_000_000 * i as i64,
            easting_m: CENTER_M[0] + tree.at_m[0],
            northing_m: CENTER_M[1] + tree.at_m[1],
            ground_m: ground_m(tree.at_m[0], tree.at_m[1]),
            position_std_m: 0.03,
            dbh_m: 2.0 * tree.radius_m as f32,
            dbh_std_m: 0.02,
            height_m: tree.height_m as f32,
            confidence: 2.0 + 0.4 * i as f32,
            sightings: 4 + i as u32,
            class: Class::Tree.to_wire(),
            reported: 1,
            ..Object::zeroed()
        });
        (ObjectsHeader { stamp_ns: now.ns, stored: 19, zone: 17, ..ObjectsHeader::zeroed() }, list.collect())
    }

    /// What one snapshot shows: the trees, and a false one.
    pub fn detections(&self, now: Timestamp) -> (DetectionsHeader, Vec<Detection>) {
        let at = |x: f64, y: f64, confidence| Detection {
            easting_m: CENTER_M[0] + x,
            northing_m: CENTER_M[1] + y,
            ground_m: ground_m(x, y),
            dbh_m: 0.3,
            confidence,
            class: Class::Tree.to_wire(),
            ..Detection::zeroed()
        };
        let mut list: Vec<_> = self.trees.iter().map(|tree| at(tree.at_m[0], tree.at_m[1], 0.8)).collect();
        list.push(at(3.0, 8.0, 0.3));
        (DetectionsHeader { stamp_ns: now.ns, zone: 17, ..DetectionsHeader::zeroed() }, list)
    }

    /// One mirror turn with the head tilted: 541 beams walked through the voxels.
    pub fn scan(&self, tilt_rad: f64, now: Timestamp) -> (PointsHeader, Vec<PlacedReturn>) {
        let eye = [0.0, 1.1, ground_m(0.0, 0.0) + 1.6];
        let header = PointsHeader {
            stamp_ns: now.ns,
            origin_m: [CENTER_M[0], CENTER_M[1], 30.0],
            ladar_m: [eye[0] as f32, eye[1] as f32, (eye[2] - 30.0) as f32],
            zone: 17,
            ..PointsHeader::zeroed()
        };
        (header, (0..541).map(|i| self.beam(eye, (f64::from(i) * 0.5 - 45.0).to_radians(), tilt_rad)).collect())
    }

    fn beam(&self, eye: [f64; 3], angle_rad: f64, tilt_rad: f64) -> PlacedReturn {
        let (right, ahead) = (angle_rad.cos(), angle_rad.sin());
        let along = [right, ahead * tilt_rad.cos(), ahead * tilt_rad.sin()];
        let end = |range: f64| [0, 1, 2].map(|axis| eye[axis] + range * along[axis]);
        let hit = (10..200).map(|step| f64::from(step) * 0.08).find(|range| {
            let [x, y, z] = end(*range);
            self.voxels.contains(&voxel_at(x, y, z))
        });
        let [x, y, z] = end(hit.unwrap_or(16.0));
        let kind = if hit.is_some() { ReturnKind::Echo } else { ReturnKind::NoReturn };
        PlacedReturn {
            xyz_m: [x as f32, y as f32, (z - 30.0) as f32],
            remission: 90,
            kind: kind.to_wire(),
            reserved: 0,
        }
    }
}

/// The vehicle stands in the middle, facing north, tilted as the ground is.
pub fn pose(now: Timestamp) -> Pose {
    Pose {
        stamp_ns: now.ns,
        easting_m: CENTER_M[0],
        northing_m: CENTER_M[1],
        altitude_m: ground_m(0.0, 0.0),
        pitch_rad: (ground_m(0.0, 1.0) - ground_m(0.0, -1.0)).atan2(2.0),
        roll_rad: (ground_m(-1.0, 0.0) - ground_m(1.0, 0.0)).atan2(2.0),
        position_std_m: [0.02, 0.02, 0.04],
        zone: 17,
        quality: PoseQuality::RtkFixed.to_wire(),
        ..Pose::zeroed()
    }
}

/// The head at a tilt.
pub fn joint(tilt_rad: f64, now: Timestamp) -> Joint {
    Joint { stamp_ns: now.ns, tilt_rad, sweep: 12, ..Joint::zeroed() }
}

/// The header of a map sample.
pub fn map_header(kind: MapSampleKind, key: BlockKey, version: u32, snapshot: u32, now: Timestamp) -> MapHeader {
    MapHeader {
        epoch: 1,
        snapshot: u64::from(snapshot),
        stamp_ns: now.ns,
        published_ns: now.ns,
        voxel_size_m: VOXEL_M,
        pose: pose(now),
        key,
        version,
        kind: kind.to_wire(),
        ..MapHeader::zeroed()
    }
}

/// Ends a snapshot.
pub fn send_commit(scene: &mut Scene, entries: &[CommitEntry], snapshot: u32, now: Timestamp) {
    let header = map_header(MapSampleKind::Commit, [0; 3], entries.len() as u32, snapshot, now);
    scene.map(&header, pack_commit(entries), now);
}

/// A process table in which one process is not well.
pub fn processes(now: Timestamp) -> (ProcessesHeader, Vec<ProcessStatus>) {
    let process = |name: &str, state: ProcessState, reason: &str, in_hz, out_hz, age_ms| ProcessStatus {
        name: Text::new(name),
        reason: Text::new(reason),
        in_hz,
        out_hz,
        age_ms,
        cpu: 0.04,
        rss_bytes: 21 << 20,
        pid: 4242,
        state: state.to_wire(),
        ..ProcessStatus::zeroed()
    };
    let list = vec![
        process("ladar/front", ProcessState::Running, "measuring, 50.0 Hz, 0.5 deg", 50.0, 50.0, 12.0),
        process("pan-tilt", ProcessState::Running, "nodding at 20 deg/s", 20.0, 20.0, 30.0),
        process("gpos", ProcessState::Degraded, "differential corrections missing for 4 s", 10.0, 10.0, 60.0),
        process("mapper", ProcessState::Running, "9 blocks around the vehicle", 80.0, 2.0, 210.0),
        process("classifier", ProcessState::Running, "snapshot 118 in 41 ms", 2.0, 2.0, 260.0),
        process("kstore", ProcessState::Running, "19 objects, 16 reported", 2.0, 2.0, 300.0),
        process("bridge", ProcessState::Running, "page at http://127.0.0.1:8151/", 90.0, 0.0, f32::NAN),
    ];
    (ProcessesHeader { stamp_ns: now.ns, graph: Text::new("synthetic") }, list)
}
