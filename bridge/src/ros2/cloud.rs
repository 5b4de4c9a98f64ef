//! The occupied voxels as sensor_msgs/PointCloud2, each with what stands there. Pure.
//!
//! In: a snapshot of the map and the newest grid. Out: the centres of occupied voxels in the frame `map`: x, y, z as f32,
//! `class` as the page colours it, `confidence` as the map has it. A cloud larger than its bound is thinned evenly.

use super::messages::{Header, PointCloud2, PointField};
use tsense_contract::{
    BLOCK_BRICKS, BRICK_EDGE, BRICK_VOXELS, Brick, CellClass, GridCell, GridHeader, MapHeader, Snapshot, VoxelState,
    brick_offset, first_voxel, voxel_offset,
};
use tsense_geometry::VoxelGrid;

/// Bytes of a point: three f32, two u8 and two unused, so that points stay aligned.
pub const POINT_BYTES: usize = 16;
/// Heights above the ground, in voxels, below which a voxel is ground: its own and a half of roughness.
const GROUND_VOXELS: f64 = 1.6;
/// What hangs higher above the brush than this, in voxels, is canopy.
const CANOPY_VOXELS: f64 = 2.0;
/// Above this height something solid is canopy, metres.
const SOLID_MAX_M: f64 = 3.0;

/// What a point is. The numbers 0 to 5 are those of [`CellClass`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum PointClass {
    /// No grid there, or no ground in it.
    Unknown = 0,
    /// Ground.
    Ground = 1,
    /// Brush.
    Brush = 2,
    /// A trunk.
    Tree = 3,
    /// Something solid.
    Obstacle = 4,
    /// The ground falls away.
    Drop = 5,
    /// Hangs above: leaves and branches.
    Canopy = 6,
}

/// The grid that decides the classes.
#[derive(Clone, Copy, Debug)]
pub struct ClassGrid<'a> {
    /// Its place.
    pub header: &'a GridHeader,
    /// Its cells; as many as the header says.
    pub cells: &'a [GridCell],
}

impl ClassGrid<'_> {
    /// The class of a voxel at this place in UTM.
    fn class_at(&self, center_m: [f64; 3], voxel_m: f64) -> PointClass {
        let column =
            |axis: usize| (center_m[axis] / self.header.cell_m).floor() - f64::from(self.header.first_cell[axis]);
        let (east, north) = (column(0), column(1));
        let inside = (0.0..f64::from(self.header.width)).contains(&east)
            && (0.0..f64::from(self.header.height)).contains(&north);
        if !inside {
            return PointClass::Unknown;
        }
        let cell = &self.cells[north as usize * self.header.width as usize + east as usize];
        class_of(cell, center_m[2] - self.header.base_m - f64::from(cell.ground_m), voxel_m)
    }
}

/// The class of what is occupied this high above the ground of a cell: the rule of the page.
fn class_of(cell: &GridCell, above_m: f64, voxel_m: f64) -> PointClass {
    if above_m.is_nan() {
        return PointClass::Unknown;
    }
    let class = CellClass::from_wire(cell.class);
    let brush_m = if cell.vegetation_m.is_finite() { f64::from(cell.vegetation_m) } else { 0.0 };
    let hangs = match class {
        CellClass::Unknown | CellClass::Ground | CellClass::Brush => true,
        CellClass::Obstacle => above_m > SOLID_MAX_M,
        CellClass::Tree | CellClass::Drop => false,
    };
    let is_ground = above_m < GROUND_VOXELS * voxel_m;
    match class {
        _ if hangs && !is_ground && above_m > brush_m + CANOPY_VOXELS * voxel_m => PointClass::Canopy,
        CellClass::Drop => PointClass::Drop,
        _ if is_ground => PointClass::Ground,
        CellClass::Tree => PointClass::Tree,
        CellClass::Obstacle => PointClass::Obstacle,
        _ => PointClass::Brush,
    }
}

/// One occupied voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelPoint {
    /// Centre in the map, metres.
    pub xyz_m: [f32; 3],
    /// What it is.
    pub class: PointClass,
    /// Updates behind it, faded by age.
    pub confidence: u8,
}

/// The occupied voxels of a snapshot, evenly thinned to `points_max`, and how many there were.
pub fn occupied<S: AsRef<[Brick]>>(
    snapshot: &Snapshot<'_, S>,
    grid: Option<ClassGrid<'_>>,
    origin_m: [f64; 3],
    points_max: usize,
) -> (Vec<VoxelPoint>, usize) {
    let total: usize = snapshot.blocks().map(|(_, bricks)| bricks.iter().map(count).sum::<usize>()).sum();
    let keep = total.min(points_max);
    let mut points = Vec::with_capacity(keep);
    let Some(voxels) = VoxelGrid::new(snapshot.header.voxel_size_m) else { return (points, 0) };
    let mut seen = 0_usize;
    for (key, bricks) in snapshot.blocks() {
        let first = first_voxel(key);
        each_occupied(bricks, |within, confidence| {
            seen += 1;
            // Of `total` voxels every one that carries the running share over a whole number: `keep` in all.
            if seen * keep / total == (seen - 1) * keep / total {
                return;
            }
            let center = voxels.center_of(std::array::from_fn(|axis| first[axis] + within[axis] as i32)).to_array();
            let class = grid.map_or(PointClass::Unknown, |grid| grid.class_at(center, voxels.size_m()));
            let xyz_m = std::array::from_fn(|axis| (center[axis] - origin_m[axis]) as f32);
            points.push(VoxelPoint { xyz_m, class, confidence });
        });
    }
    (points, total)
}

fn count(brick: &Brick) -> usize {
    (0..BRICK_VOXELS).filter(|i| brick.confidence[*i] != 0 && brick.occupancy[*i] > 0).count()
}

/// Calls with each occupied voxel's place in its block and its confidence.
fn each_occupied(bricks: &[Brick], mut call: impl FnMut([usize; 3], u8)) {
    for z in 0..BLOCK_BRICKS[2] {
        for y in 0..BLOCK_BRICKS[1] {
            for x in 0..BLOCK_BRICKS[0] {
                let Some(brick) = bricks.get(brick_offset([x, y, z])).filter(|brick| count(brick) > 0) else {
                    continue;
                };
                each_in_brick(brick, |inner, confidence| {
                    let corner = [x, y, z];
                    call(std::array::from_fn(|axis| corner[axis] * BRICK_EDGE + inner[axis]), confidence);
                });
            }
        }
    }
}

fn each_in_brick(brick: &Brick, mut call: impl FnMut([usize; 3], u8)) {
    for z in 0..BRICK_EDGE {
        for y in 0..BRICK_EDGE {
            for x in 0..BRICK_EDGE {
                let i = voxel_offset([x, y, z]);
                if brick.state(i) == VoxelState::Occupied {
                    call([x, y, z], brick.confidence[i]);
                }
            }
        }
    }
}

/// The points as ROS wants them.
pub fn point_cloud(header: &MapHeader, points: &[VoxelPoint], frame: &str) -> PointCloud2 {
    const FLOAT32: u8 = 7;
    const UINT8: u8 = 2;
    let field = |name: &str, offset, datatype| PointField { name: name.into(), offset, datatype, count: 1 };
    let fields = vec![
        field("x", 0, FLOAT32),
        field("y", 4, FLOAT32),
        field("z", 8, FLOAT32),
        field("class", 12, UINT8),
        field("confidence", 13, UINT8),
    ];
    let mut data = Vec::with_capacity(points.len() * POINT_BYTES);
    for point in points {
        data.extend(point.xyz_m.iter().flat_map(|c| c.to_le_bytes()));
        data.extend([point.class as u8, point.confidence, 0, 0]);
    }
    PointCloud2 {
        header: Header::new(header.stamp_ns, frame),
        height: 1,
        width: points.len() as u32,
        fields,
        is_bigendian: false,
        point_step: POINT_BYTES as u32,
        row_step: data.len() as u32,
        data,
        is_dense: true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use tsense_contract::{
        BRICKS_PER_BLOCK, CommitEntry, MapSampleKind, SnapshotAssembler, Taken, locate, pack_commit,
    };

    /// A snapshot of one block with these voxels occupied.
    fn assembler(filled: &[[i32; 3]]) -> SnapshotAssembler<Vec<Brick>> {
        let mut bricks = vec![Brick::UNKNOWN; BRICKS_PER_BLOCK];
        for voxel in filled {
            let (_, brick, i) = locate(*voxel);
            (bricks[brick].occupancy[i], bricks[brick].confidence[i]) = (3, 40);
        }
        // Free voxels are no points.
        (bricks[0].occupancy[63], bricks[0].confidence[63]) = (-3, 40);
        let mut header = MapHeader::zeroed();
        (header.voxel_size_m, header.snapshot, header.version, header.keyframe) = (0.15, 1, 1, 1);
        let mut assembler = SnapshotAssembler::new(4);
        assert_eq!(assembler.take(&header, bricks), Taken::Part);
        let commit = MapHeader { kind: MapSampleKind::Commit.to_wire(), ..header };
        let taken = assembler.take(&commit, pack_commit(&[CommitEntry { key: [0; 3], version: 1 }]));
        assert_eq!(taken, Taken::Complete);
        assembler
    }

    #[test]
    fn a_point_stands_in_the_middle_of_its_voxel() {
        let map = assembler(&[[10, 20, 3]]);
        let (points, total) = occupied(&map.complete().unwrap(), None, [1.0, 1.0, 0.0], 10);
        assert_eq!(total, 1);
        let expected = [10.5 * 0.15 - 1.0, 20.5 * 0.15 - 1.0, 3.5 * 0.15].map(|c: f64| c as f32);
        assert_eq!(points, [VoxelPoint { xyz_m: expected, class: PointClass::Unknown, confidence: 40 }]);
        let cloud = point_cloud(&MapHeader::zeroed(), &points, "map");
        assert_eq!((cloud.width, cloud.row_step, cloud.data.len()), (1, 16, 16));
        assert_eq!(cloud.data[12..14], [0, 40]);
    }

    #[test]
    fn a_cloud_beyond_its_bound_is_thinned_evenly() {
        let row: Vec<_> = (0..100).map(|x| [x, 0, 0]).collect();
        let map = assembler(&row);
        let (points, total) = occupied(&map.complete().unwrap(), None, [0.0; 3], 25);
        assert_eq!((points.len(), total), (25, 100));
        let steps: Vec<_> = points.windows(2).map(|p| ((p[1].xyz_m[0] - p[0].xyz_m[0]) / 0.15).round()).collect();
        assert_eq!(steps, vec![4.0; 24]);
    }

    #[test]
    fn the_class_follows_from_the_cell_and_the_height_above_its_ground() {
        let cell = |class: CellClass, vegetation_m| GridCell {
            vegetation_m,
            evidence: 1,
            class: class.to_wire(),
            ..GridCell::zeroed()
        };
        for (class, brush_m, above_m, expected) in [
            (CellClass::Ground, 0.0, 0.1, PointClass::Ground),
            (CellClass::Ground, 0.0, 2.0, PointClass::Canopy),
            (CellClass::Brush, 1.0, 0.1, PointClass::Ground),
            (CellClass::Brush, 1.0, 0.8, PointClass::Brush),
            (CellClass::Brush, 1.0, 1.4, PointClass::Canopy),
            (CellClass::Tree, 0.0, 4.0, PointClass::Tree),
            (CellClass::Obstacle, 0.0, 1.0, PointClass::Obstacle),
            (CellClass::Obstacle, 0.0, 3.5, PointClass::Canopy),
            (CellClass::Drop, 0.0, -1.0, PointClass::Drop),
            (CellClass::Ground, f32::NAN, f64::NAN, PointClass::Unknown),
        ] {
            assert_eq!(class_of(&cell(class, brush_m), above_m, 0.15), expected, "{class} {above_m}");
        }
    }

    #[test]
    fn outside_of_the_grid_nothing_is_known() {
        let mut header = GridHeader::zeroed();
        (header.cell_m, header.width, header.height) = (1.0, 2, 2);
        let cells = [GridCell { class: CellClass::Tree.to_wire(), ..GridCell::zeroed() }; 4];
        let grid = ClassGrid { header: &header, cells: &cells };
        assert_eq!(grid.class_at([1.5, 0.5, 5.0], 0.15), PointClass::Tree);
        for outside in [[-0.1, 0.5], [2.0, 0.5], [0.5, 2.0], [f64::NAN, 0.0]] {
            assert_eq!(grid.class_at([outside[0], outside[1], 5.0], 0.15), PointClass::Unknown);
        }
    }
}
