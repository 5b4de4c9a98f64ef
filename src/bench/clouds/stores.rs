//! The stores that are compared: the voxel map; a plain list of points; lists in sub-regions of space, as in the
//! thesis's figure 2-2; an R-tree.
//!
//! In: beams in UTM. Points are kept as three `f32` from the store's own origin (UTM is too large for `f32`), with a
//! count of the beams that passed them.

use super::NEAR_M;
use super::way::{RADIUS_M, Way};
use nalgebra::Vector3;
use rstar::primitives::GeomWithData;
use rstar::{AABB, DefaultParams, RTree, RTreeNode, RTreeParams, SelectionFunction};
use tsense_contract::{BRICK_VOXELS, BRICKS_PER_BLOCK, VoxelState};
use tsense_geometry::{Global, Point};
use tsense_mapper::{Beam, BeamKind, Config, MapError, VoxelMap};

/// What they all can do.
pub trait Store {
    /// For tables.
    fn name(&self) -> &'static str;
    /// A cloud of points.
    fn is_cloud(&self) -> bool {
        true
    }
    /// All that a beam says.
    fn insert(&mut self, beam: &Beam);
    /// What must not be missed for the store to grow: in a cloud, the return.
    fn keep(&mut self, beam: &Beam);
    /// How many points or occupied voxels lie within [`NEAR_M`].
    fn near(&self, place: Point<Global>) -> usize;
    /// Memory that it holds, bytes.
    fn bytes(&self) -> usize;
    /// A window of evidence ends.
    fn end_window(&mut self) {}
}

/// The map of the system, with its default rules and its default working space.
pub struct Voxels {
    map: VoxelMap,
    /// Voxels whose middle lies within [`NEAR_M`] of a voxel's middle.
    near: Vec<[i32; 3]>,
}

impl Voxels {
    pub fn new(middle: Point<Global>) -> Result<Self, MapError> {
        let mut map = VoxelMap::new(&Config::default())?;
        map.center_on(middle);
        let reach = NEAR_M / map.grid().size_m();
        let (ends, mut near) = (-(reach as i32)..=reach as i32, Vec::new());
        for k in ends.clone() {
            for j in ends.clone() {
                near.extend(ends.clone().map(|i| [i, j, k]));
            }
        }
        near.retain(|index| f64::from(index.iter().map(|i| i * i).sum::<i32>()) <= reach * reach);
        Ok(Self { map, near })
    }
}

impl Store for Voxels {
    fn name(&self) -> &'static str {
        "voxel map"
    }
    fn is_cloud(&self) -> bool {
        false
    }
    fn insert(&mut self, beam: &Beam) {
        self.map.insert(beam);
    }
    fn keep(&mut self, beam: &Beam) {
        self.map.insert(beam);
    }
    fn near(&self, place: Point<Global>) -> usize {
        let Some([x, y, z]) = self.map.grid().index_of(place) else { return 0 };
        let is_occupied = |[i, j, k]: &[i32; 3]| self.map.voxel([x + i, y + j, z + k]).state == VoxelState::Occupied;
        self.near.iter().filter(|index| is_occupied(index)).count()
    }
    fn bytes(&self) -> usize {
        // Bits a voxel: two bytes of evidence; of marks, while a window is open, nine for hits, and six in rows for
        // misses.
        self.map.block_slots() * BRICKS_PER_BLOCK * BRICK_VOXELS * (16 + 9 + 6) / 8
    }
    fn end_window(&mut self) {
        self.map.close_window();
    }
}

/// A return, and how many beams have passed it since.
#[derive(Clone, Copy)]
struct Kept {
    at: [f32; 3],
    passed: u8,
}

impl Kept {
    fn is_near(&self, place: [f32; 3]) -> bool {
        squared(self.at, place) <= (NEAR_M * NEAR_M) as f32
    }
    fn lose(&mut self, way: &Way) {
        if way.passes(self.at) {
            self.passed = self.passed.saturating_add(1);
        }
    }
}

fn squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum()
}

fn local(origin: Point<Global>, point: Point<Global>) -> [f32; 3] {
    let way = (point - origin).xyz;
    [way.x as f32, way.y as f32, way.z as f32]
}

fn way_of(origin: Point<Global>, beam: &Beam) -> Way {
    let [start, end] = [beam.origin, beam.end].map(|point| Vector3::from(local(origin, point)));
    Way::new(start, end, beam.kind == BeamKind::Hit)
}

/// One after the other.
pub struct List {
    origin: Point<Global>,
    points: Vec<Kept>,
}

impl List {
    pub fn new(origin: Point<Global>) -> Self {
        Self { origin, points: Vec::new() }
    }
}

impl Store for List {
    fn name(&self) -> &'static str {
        "list of points"
    }
    fn insert(&mut self, beam: &Beam) {
        let way = way_of(self.origin, beam);
        self.points.iter_mut().for_each(|point| point.lose(&way));
        self.keep(beam);
    }
    fn keep(&mut self, beam: &Beam) {
        if beam.kind == BeamKind::Hit {
            self.points.push(Kept { at: local(self.origin, beam.end), passed: 0 });
        }
    }
    fn near(&self, place: Point<Global>) -> usize {
        let place = local(self.origin, place);
        self.points.iter().filter(|point| point.is_near(place)).count()
    }
    fn bytes(&self) -> usize {
        self.points.capacity() * size_of::<Kept>()
    }
}

/// Edge of a sub-region, metres: the size of a neighbourhood.
const REGION_M: f32 = 1.0;

/// A list for each cube of space.
pub struct Regions {
    origin: Point<Global>,
    low: [f32; 3],
    counts: [usize; 3],
    regions: Vec<Vec<Kept>>,
    /// The last beam that asked a region.
    asked: Vec<u32>,
    beams: u32,
}

impl Regions {
    pub fn new(origin: Point<Global>, low: Point<Global>, high: Point<Global>) -> Self {
        // A region more on each side, for noise beyond the border.
        let (low, high) = (local(origin, low).map(|c| c - REGION_M), local(origin, high));
        let counts: [usize; 3] = std::array::from_fn(|a| ((high[a] - low[a]) / REGION_M) as usize + 2);
        let all = counts.iter().product();
        Self { origin, low, counts, regions: vec![Vec::new(); all], asked: vec![0; all], beams: 0 }
    }

    /// Numbers of the regions that a box touches.
    fn touched(&self, middle: [f32; 3], half: f32) -> impl Iterator<Item = usize> + use<> {
        let counts = self.counts;
        let ends: [[usize; 2]; 3] = std::array::from_fn(|axis| {
            [-half, half].map(|d| (((middle[axis] + d - self.low[axis]) / REGION_M) as usize).min(counts[axis] - 1))
        });
        let [x, y, z] = ends.map(|[from, to]| from..=to);
        z.flat_map(move |k| {
            let x = x.clone();
            y.clone().flat_map(move |j| x.clone().map(move |i| (k * counts[1] + j) * counts[0] + i))
        })
    }
}

impl Store for Regions {
    fn name(&self) -> &'static str {
        "points in sub-regions"
    }
    fn insert(&mut self, beam: &Beam) {
        let way = way_of(self.origin, beam);
        self.beams += 1;
        let steps = (way.length / (REGION_M / 2.0)).ceil().max(1.0);
        let step = way.length / steps;
        for i in 0..steps as usize {
            let middle: [f32; 3] = (way.origin + way.direction * ((i as f32 + 0.5) * step)).into();
            for region in self.touched(middle, step / 2.0 + RADIUS_M) {
                if std::mem::replace(&mut self.asked[region], self.beams) != self.beams {
                    self.regions[region].iter_mut().for_each(|point| point.lose(&way));
                }
            }
        }
        self.keep(beam);
    }
    fn keep(&mut self, beam: &Beam) {
        if beam.kind == BeamKind::Hit {
            let at = local(self.origin, beam.end);
            if let Some(region) = self.touched(at, 0.0).next() {
                self.regions[region].push(Kept { at, passed: 0 });
            }
        }
    }
    fn near(&self, place: Point<Global>) -> usize {
        let place = local(self.origin, place);
        let regions = self.touched(place, NEAR_M as f32);
        regions.map(|region| self.regions[region].iter().filter(|point| point.is_near(place)).count()).sum()
    }
    fn bytes(&self) -> usize {
        let points: usize = self.regions.iter().map(|region| region.capacity() * size_of::<Kept>()).sum();
        points + self.regions.len() * (size_of::<Vec<Kept>>() + size_of::<u32>())
    }
}

type Leaf = GeomWithData<[f32; 3], u8>;

/// A tree of boxes.
pub struct Tree {
    origin: Point<Global>,
    points: RTree<Leaf>,
}

impl Tree {
    pub fn new(origin: Point<Global>) -> Self {
        Self { origin, points: RTree::new() }
    }
}

impl SelectionFunction<Leaf> for Way {
    fn should_unpack_parent(&self, envelope: &AABB<[f32; 3]>) -> bool {
        self.meets(envelope.lower(), envelope.upper())
    }
    fn should_unpack_leaf(&self, leaf: &Leaf) -> bool {
        self.passes(*leaf.geom())
    }
}

impl Store for Tree {
    fn name(&self) -> &'static str {
        "points in an R-tree"
    }
    fn insert(&mut self, beam: &Beam) {
        let way = way_of(self.origin, beam);
        for point in self.points.locate_with_selection_function_mut(way) {
            point.data = point.data.saturating_add(1);
        }
        self.keep(beam);
    }
    fn keep(&mut self, beam: &Beam) {
        if beam.kind == BeamKind::Hit {
            self.points.insert(Leaf::new(local(self.origin, beam.end), 0));
        }
    }
    fn near(&self, place: Point<Global>) -> usize {
        self.points.locate_within_distance(local(self.origin, place), (NEAR_M * NEAR_M) as f32).count()
    }
    fn bytes(&self) -> usize {
        // A node has room for one child more than it may keep.
        let room = (DefaultParams::MAX_SIZE + 1) * size_of::<RTreeNode<Leaf>>();
        let (mut open, mut nodes) = (vec![self.points.root()], 0);
        while let Some(node) = open.pop() {
            nodes += 1;
            open.extend(node.children().iter().filter_map(|child| match child {
                RTreeNode::Parent(parent) => Some(parent),
                RTreeNode::Leaf(_) => None,
            }));
        }
        nodes * room
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_mapper::Weight;

    /// The clouds after the same beams, and what they find at the same places.
    #[test]
    fn all_clouds_find_the_same_points_and_the_same_points_lose() {
        let (low, high) = (Point::new(5e5, 5e6, 100.0), Point::new(5e5 + 20.0, 5e6 + 20.0, 110.0));
        let middle = Point::new(5e5 + 10.0, 5e6 + 10.0, 105.0);
        let (mut list, mut regions, mut tree) = (List::new(middle), Regions::new(middle, low, high), Tree::new(middle));
        let mut random = tsense_simulator::Rng::new(3);
        let ends: Vec<_> = (0..3000)
            .map(|_| {
                Point::new(
                    5e5 + random.between(0.0, 20.0),
                    5e6 + random.between(0.0, 20.0),
                    random.between(100.0, 110.0),
                )
            })
            .collect();
        for end in &ends {
            let beam = Beam { origin: middle, end: *end, kind: BeamKind::Hit, weight: Weight::FULL };
            list.insert(&beam);
            regions.insert(&beam);
            tree.insert(&beam);
        }
        let found: usize = ends.iter().map(|end| list.near(*end)).sum();
        assert_eq!(found, ends.iter().map(|end| regions.near(*end)).sum::<usize>());
        assert_eq!(found, ends.iter().map(|end| tree.near(*end)).sum::<usize>());
        let passed: usize = list.points.iter().map(|point| usize::from(point.passed)).sum();
        assert_eq!(passed, regions.regions.iter().flatten().map(|point| usize::from(point.passed)).sum::<usize>());
        assert_eq!(passed, tree.points.iter().map(|point| usize::from(point.data)).sum::<usize>());
        // Each finds itself, many a neighbour, and some points were passed: the equalities above compare something.
        assert!(found > 3300 && passed > 100, "{found} {passed}");
    }
}
