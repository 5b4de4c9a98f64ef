//! A person of 3 x 3 x 10 voxels who walks in free space over flat ground, seen by beams from the north.

use super::*;
use crate::columns::Window;
use crate::returns::{PlacedBeam, ReturnsConfig};
use tsense_geometry::{Point, VoxelGrid};

const CELL_M: f64 = 0.15;

/// What is seen of a stretch of ground, snapshot by snapshot.
struct Bench {
    moving: Moving,
    returns: Returns,
    /// First voxel of the window.
    first: VoxelIndex,
    snapshot: i64,
}

impl Bench {
    /// Ground and free space above it, looked at once.
    fn new() -> Self {
        let (moving, returns) = (Moving::default(), Returns::new(&ReturnsConfig::default()));
        let mut bench = Self { moving, returns, first: [400, 800, 0], snapshot: 0 };
        bench.look(&[], &[]);
        bench
    }

    fn stamp(&self) -> Timestamp {
        Timestamp::from_seconds(10.0 + 0.2 * self.snapshot as f64)
    }

    /// A snapshot in which beams end in some voxels, and others are touched since before.
    fn look(&mut self, met: &[VoxelIndex], stay: &[VoxelIndex]) {
        self.snapshot += 1;
        let (window, grid) = (Window { first: self.first, size: [40, 40, 20] }, VoxelGrid::new(CELL_M).unwrap());
        let mut view = View::unknown(window, grid);
        let frame = Frame::of(&view);
        for (column, level) in (0..1600).flat_map(|column| (0..20).map(move |level| (column, level))) {
            let voxel = frame.voxel(column, level);
            match level == 0 || met.contains(&voxel) || stay.contains(&voxel) {
                true => view.occupied.insert(column, level),
                false => view.free.insert(column, level),
            }
        }
        view.touched = view.occupied.clone();
        let stamp = self.stamp();
        for voxel in met {
            let [x, y, z] = voxel.map(|i| (f64::from(i) + 0.5) * CELL_M);
            let (origin, end) = (Point::new(x, y + 6.0, z), Point::new(x, y, z));
            self.returns.insert(&PlacedBeam { ladar: 0, stamp, origin, end, is_return: true });
        }
        self.returns.settle();
        self.moving.look(&view, &self.returns, stamp, &MovingConfig::default());
        self.returns.seen();
    }

    /// Whether a cell must not be driven, and whether what was met in a voxel counts for nothing else.
    fn told(&self, [x, y, z]: VoxelIndex) -> (bool, bool) {
        let shape = RasterShape { first_cell: [self.first[0], self.first[1]], width: 40, height: 40, cell_m: CELL_M };
        let cell = ((x - self.first[0]) as usize, (y - self.first[1]) as usize);
        let cells = self.moving.cells(shape, self.stamp(), &MovingConfig::default());
        (cells[cell], self.moving.holds(cell.1 * 40 + cell.0, ((f64::from(z) + 0.5) * CELL_M) as f32))
    }
}

/// The side of a person that is seen, at a voxel column.
fn person(x: i32) -> Vec<VoxelIndex> {
    (0..30).map(|i| [x + i % 3, 820, 1 + i / 3]).collect()
}

const AT: VoxelIndex = [411, 820, 6];

#[test]
fn a_walker_is_told_at_once_and_leaves_no_trail() {
    let mut bench = Bench::new();
    assert_eq!(bench.told(AT), (false, false));
    bench.look(&person(410), &[]);
    assert_eq!(bench.told(AT), (true, true));
    bench.look(&person(416), &person(410));
    assert_eq!((bench.told(AT), bench.told([417, 820, 6])), ((true, true), (true, true)));
    // The map has seen through his first place after three seconds, and then not yet.
    (0..15).for_each(|_| bench.look(&[], &person(410)));
    assert_eq!(bench.told(AT), (false, true), "nobody is there any more, and nothing was");
}

#[test]
fn who_stands_still_becomes_a_thing_like_others() {
    let mut bench = Bench::new();
    bench.look(&person(410), &[]);
    (0..8).for_each(|_| bench.look(&[], &person(410)));
    bench.look(&person(410), &person(410));
    assert_eq!(bench.told(AT), (false, false), "met again where it was, a sweep later");
}

#[test]
fn who_stood_there_from_the_first_look_and_left_leaves_nothing_until_somebody_comes_again() {
    let mut bench = Bench::new();
    bench.moving = Moving::default();
    bench.look(&person(410), &[]);
    assert_eq!(bench.told(AT), (false, false), "nobody knows what was there before");
    bench.look(&[], &[]);
    assert_eq!(bench.told(AT), (false, true));
    bench.look(&person(410)[12..15], &[]);
    assert_eq!(bench.told([411, 820, 5]), (false, false), "too little to move, enough to be there");
}

#[test]
fn leaves_that_flicker_beside_others_do_not_move() {
    let mut bench = Bench::new();
    bench.moving = Moving::default();
    let row = |y: i32| (0..30).map(move |i| [410 + i % 3, y, 1 + i / 3]);
    let leaves: Vec<VoxelIndex> = row(820).chain(row(822)).collect();
    bench.look(&leaves, &[]);
    bench.look(&row(821).collect::<Vec<_>>(), &leaves);
    assert_eq!(bench.told([411, 821, 6]), (false, false));
}

#[test]
fn the_window_may_move_in_between() {
    let mut bench = Bench::new();
    bench.first = [404, 796, 0];
    bench.look(&person(410), &[]);
    assert_eq!(bench.told(AT), (true, true));
    bench.first = [404, 800, 0];
    bench.look(&[], &person(410));
    assert_eq!(bench.told(AT), (true, true));
}

#[test]
fn what_is_small_or_low_does_not_move() {
    for few in [&person(410)[..5], &person(410)[..3]] {
        let mut bench = Bench::new();
        bench.look(few, &[]);
        assert!(!bench.told(few[0]).0);
    }
}

#[test]
fn a_clock_that_is_set_back_forgets_what_moved() {
    let mut bench = Bench::new();
    bench.look(&person(410), &[]);
    bench.snapshot -= 600;
    bench.look(&[], &person(410));
    assert_eq!(bench.told(AT), (false, false));
}
