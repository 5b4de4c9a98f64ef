//! The map's promises, measured on synthetic scans: standing ground is not eroded, what was removed is free again,
//! new things show at once. Figures and rules are in `EVIDENCE.md`.

use crate::beams::BeamKind;
use crate::config::{Config, Scheme, WindowRule};
use crate::evidence_window::EvidenceWindow;
use crate::scene::{AT, Person, Scene};
use crate::snapshot::Snapshot;
use crate::voxel_map::VoxelMap;
use std::collections::BTreeMap;
use tsense_contract::VoxelState;
use tsense_geometry::{Point, VoxelIndex};

/// A map being fed with a scene.
struct Run {
    map: VoxelMap,
    window: EvidenceWindow,
    /// Hits of each voxel, scans that hit it, and the last of those.
    hits: BTreeMap<VoxelIndex, (u32, u32, usize)>,
    /// Ends a window after every beam: the thesis's rule, taken literally.
    literal: bool,
}

impl Run {
    fn new(config: &Config) -> Self {
        let mut map = VoxelMap::new(config).unwrap();
        map.center_on(Point::new(AT[0], AT[1] + (config.working_space_m[1] - 30.0).max(0.0) / 2.0, AT[2]));
        Self { map, window: EvidenceWindow::new(&config.evidence), hits: BTreeMap::new(), literal: false }
    }

    fn feed(&mut self, scene: &Scene, scans: std::ops::Range<usize>) {
        for i in scans {
            let (stamp, sweep, beams) = scene.scan(i);
            if self.window.ends_before(stamp, Some(sweep)) {
                self.map.close_window();
            }
            for beam in &beams {
                self.map.insert(beam);
                if self.literal {
                    self.map.close_window();
                }
                if beam.kind == BeamKind::Hit {
                    let voxel = self.map.grid().index_of(beam.end).unwrap();
                    let seen = self.hits.entry(voxel).or_insert((0, 0, usize::MAX));
                    *seen = (seen.0 + 1, seen.1 + u32::from(seen.2 != i), i);
                }
            }
        }
    }

    /// Share of voxels with at least 3 hits in at least 2 scans, in the window, that end not occupied; and their number.
    fn eroded(&mut self) -> (f64, usize) {
        self.map.close_window();
        let sure = self.hits.iter().filter(|(_, seen)| seen.0 >= 3 && seen.1 >= 2).map(|(voxel, _)| *voxel);
        let in_space = sure.filter(|voxel| self.map.holds(*voxel)).collect::<Vec<_>>();
        let lost = in_space.iter().filter(|voxel| self.map.voxel(**voxel).state != VoxelState::Occupied).count();
        (lost as f64 / in_space.len() as f64, in_space.len())
    }
}

fn static_share(config: &Config, sweeps: usize) -> (f64, usize) {
    let scene = Scene::tripod();
    let mut run = Run::new(config);
    run.feed(&scene, 0..sweeps * scene.scans_per_sweep());
    run.eroded()
}

fn drive_share(config: &Config) -> (f64, usize) {
    let scene = Scene { speed_m_s: 2.0, ..Scene::tripod() };
    let mut run = Run::new(&Config { working_space_m: [30.0, 70.0, 12.0], ..config.clone() });
    run.feed(&scene, 0..500);
    run.eroded()
}

const PERSON: Person = Person { east_m: AT[0] + 1.0, north_m: AT[1] + 6.0, radius_m: 0.25, height_m: 1.8 };

/// Occupied voxels of a person, feet left out: after it stood there for three sweeps, and 1, 2 ... sweeps after it went.
fn person_after_sweeps(config: &Config, scene: Scene, person: Person, sweeps: usize) -> Vec<usize> {
    let (there, gone) = (Scene { person: Some(person), ..scene }, scene);
    let per_sweep = scene.scans_per_sweep();
    let mut run = Run::new(config);
    run.feed(&there, 0..3 * per_sweep);
    run.map.close_window();
    let feet = run.map.grid().index_of(Point::new(person.east_m, person.north_m, AT[2] + 0.5)).unwrap();
    let body: Vec<VoxelIndex> = (-3..=3)
        .flat_map(|x| (-3..=3).flat_map(move |y| (0..10).map(move |z| [feet[0] + x, feet[1] + y, feet[2] + z])))
        // A wall behind stays.
        .filter(|voxel| scene.wall_m.is_none_or(|m| run.map.grid().corner_of(*voxel).y() < AT[1] + m - 0.2))
        .filter(|voxel| run.map.voxel(*voxel).state == VoxelState::Occupied)
        .collect();
    let mut left = vec![body.len()];
    for sweep in 3..3 + sweeps {
        run.feed(&gone, sweep * per_sweep..(sweep + 1) * per_sweep);
        run.map.close_window();
        left.push(body.iter().filter(|voxel| run.map.voxel(**voxel).state == VoxelState::Occupied).count());
    }
    left
}

#[test]
fn standing_ground_is_not_eroded() {
    let (share, voxels) = static_share(&Config::default(), 10);
    assert!(voxels > 3000, "{voxels}");
    assert!(share < 0.05, "{share:.4} of {voxels}");
}

#[test]
fn ground_that_is_driven_over_is_not_eroded() {
    let (share, voxels) = drive_share(&Config::default());
    assert!(voxels > 3000, "{voxels}");
    assert!(share < 0.005, "{share:.4} of {voxels}");
}

#[test]
fn a_person_who_left_is_free_space_within_three_sweeps() {
    let left = person_after_sweeps(&Config::default(), Scene::tripod(), PERSON, 3);
    assert!(left[0] > 30, "{left:?}");
    assert_eq!(left[3], 0, "{left:?}");
}

#[test]
fn a_person_who_stood_before_a_wall_is_free_space_too() {
    let before_wall = Scene { wall_m: Some(6.8), ..Scene::tripod() };
    let left = person_after_sweeps(&Config::default(), before_wall, PERSON, 3);
    assert!(left[0] > 30, "{left:?}");
    assert_eq!(left[3], 0, "{left:?}");
}

#[test]
fn a_person_who_comes_shows_before_the_window_ends() {
    let empty = Scene::tripod();
    let per_sweep = empty.scans_per_sweep();
    let mut run = Run::new(&Config::default());
    run.feed(&empty, 0..4 * per_sweep);
    let mut snapshot = Snapshot::default();
    run.map.snapshot(true, &mut snapshot);
    let person = Scene { person: Some(PERSON), ..empty };
    // In the middle of a sweep, without closing its window.
    run.feed(&person, 4 * per_sweep..4 * per_sweep + per_sweep * 3 / 4);
    let chest = run.map.grid().index_of(Point::new(PERSON.east_m, PERSON.north_m, AT[2] + 1.2)).unwrap();
    let shown = (-3..=3).flat_map(|x| (-3..=3).map(move |y| [chest[0] + x, chest[1] + y, chest[2]]));
    assert!(shown.filter(|voxel| run.map.voxel(*voxel).state == VoxelState::Occupied).count() > 2);
    run.map.snapshot(false, &mut snapshot);
    assert!(!snapshot.changes.is_empty());
}

#[test]
fn age_alone_deletes_no_ground() {
    let scene = Scene::tripod();
    let mut run = Run::new(&Config::default());
    run.feed(&scene, 0..2 * scene.scans_per_sweep());
    let (before, voxels) = run.eroded();
    run.map.fade(1e6);
    run.map.fade_blocks(run.map.block_slots());
    assert_eq!(run.eroded(), (before, voxels));
}

/// The tables of `EVIDENCE.md`: run with `--ignored --nocapture`.
#[test]
#[ignore = "measures; minutes"]
fn measure_rules() {
    let measure = |name: &str, config: &Config| {
        let ((still, n), (drive, m)) = (static_share(config, 10), drive_share(config));
        let left = person_after_sweeps(config, Scene::tripod(), PERSON, 4);
        let (still, drive) = (still * 100.0, drive * 100.0);
        eprintln!("{name:44} static {still:5.2} % of {n}  drive {drive:5.2} % of {m}  person {left:?}");
    };
    let with = |name: &str, scheme, window, window_s, [spare, chord, share]: [f64; 3]| {
        let mut config = Config::default();
        config.scheme.scheme = scheme;
        let e = &mut config.evidence;
        (e.window, e.window_s, e.spare_voxels, e.chord_min_voxels) = (window, window_s, spare, chord);
        e.grazing_spare_share = share;
        measure(name, &config);
    };
    use Scheme::{Confidence, HitRatio, IncrementDecrement};
    use WindowRule::{Scan, Sweep, Time};
    with("+1/-1, scan", IncrementDecrement, Scan, 0.0, [0.0; 3]);
    with("+1/-1, sweep", IncrementDecrement, Sweep, 0.3, [0.0; 3]);
    with("+1/-1, sweep, spare 2, chord 1/2", IncrementDecrement, Sweep, 0.3, [2.0, 0.5, 0.0]);
    with("+1/-1, sweep, all rules", IncrementDecrement, Sweep, 0.3, [2.0, 0.5, 0.08]);
    with("ratio, sweep, all rules", HitRatio, Sweep, 0.3, [2.0, 0.5, 0.08]);
    with("steps, sweep", Confidence, Sweep, 0.3, [0.0; 3]);
    with("steps, sweep, spare 2, chord 1/2", Confidence, Sweep, 0.3, [2.0, 0.5, 0.0]);
    for share in [0.04, 0.06, 0.08, 0.1] {
        with(&format!("steps, sweep, all rules, share {share}"), Confidence, Sweep, 0.3, [2.0, 0.5, share]);
    }
    with("steps, scan, all rules", Confidence, Scan, 0.0, [2.0, 0.5, 0.08]);
    for window_s in [0.1, 0.3, 1.0] {
        with(&format!("steps, {window_s} s, all rules"), Confidence, Time, window_s, [2.0, 0.5, 0.08]);
    }
    for occupancy_max in [4, 12] {
        let mut config = Config::default();
        config.scheme.occupancy_max = occupancy_max;
        measure(&format!("steps, sweep, all rules, at most {occupancy_max}"), &config);
    }
    measure_literal();
}

/// Every beam counts by itself and nothing protects: two sweeps, because each beam closes a window.
fn measure_literal() {
    let mut config = Config::default();
    config.scheme.scheme = Scheme::IncrementDecrement;
    let e = &mut config.evidence;
    (e.spare_voxels, e.chord_min_voxels, e.grazing_spare_share) = (0.0, 0.0, 0.0);
    let mut run = Run { literal: true, ..Run::new(&config) };
    run.feed(&Scene::tripod(), 0..2 * Scene::tripod().scans_per_sweep());
    let (share, n) = run.eroded();
    eprintln!("+1/-1, every beam, 2 sweeps: static {:5.2} % of {n}", share * 100.0);
}
