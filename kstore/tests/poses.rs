//! Poses that jump between sessions, drift, turn and cross a UTM zone border must not double the trees: a stand of
//! known trees is driven through again and again, with drawn pose errors and without, and both stores are scored.

use tsense_contract::{Class, Detection};
use tsense_geometry::Timestamp;
use tsense_kstore::{Config, KnowledgeStore, Query, Reprojection, Snapshot, Zone, view_without_grid};

const SESSIONS: usize = 5;
/// Sessions are a day apart.
const DAY_S: f64 = 86_400.0;
const RANGE_M: f64 = 15.0;
const SPEED_M_S: f64 = 1.5;
const STEP_S: f64 = 0.5;
const STAND_M: [f64; 2] = [90.0, 48.0];
/// A stored tree within this of a true one is that tree, metres.
const MATCH_M: f64 = 0.3;
/// The stand's south-west corner in zone 17, at 45 degrees north, 600 m from the border of zone 18.
const CORNER_M: [f64; 2] = [735_800.0, 4_987_000.0];

/// A small generator (splitmix64), so that the test has no seed but its own.
struct Draw(u64);

impl Draw {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
    fn between(&mut self, min: f64, max: f64) -> f64 {
        min + (max - min) * self.uniform()
    }
    fn normal(&mut self, std: f64) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        std * radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

#[derive(Clone, Copy)]
struct Tree {
    place_m: [f64; 2],
    dbh_m: f64,
}

/// Trees at random, none closer than 1.2 m to another.
fn stand(stems: usize, draw: &mut Draw) -> Vec<Tree> {
    let mut trees: Vec<Tree> = Vec::new();
    while trees.len() < stems {
        let place_m = [0, 1].map(|axis| CORNER_M[axis] + draw.between(0.0, STAND_M[axis]));
        if trees.iter().all(|t| distance_m(t.place_m, place_m) > 1.2) {
            trees.push(Tree { place_m, dbh_m: draw.between(0.1, 0.5) });
        }
    }
    trees
}

/// How wrong the pose is in one session: a jump, a drift over the session, an error of heading, a second jump half-way.
#[derive(Clone, Copy, Default)]
struct PoseError {
    jump_m: [f64; 2],
    drift_m: [f64; 2],
    turn_rad: f64,
    half_way_m: [f64; 2],
}

impl PoseError {
    fn drawn(session: usize, draw: &mut Draw) -> Self {
        let mut vector = |min: f64, max: f64| {
            let (length, angle) = (draw.between(min, max), draw.between(0.0, std::f64::consts::TAU));
            [length * angle.cos(), length * angle.sin()]
        };
        // The first session says where things are: it drifts only.
        let jump_m = if session == 0 { [0.0; 2] } else { vector(0.5, 2.0) };
        let half_way_m = if session == 3 { vector(0.5, 2.0) } else { [0.0; 2] };
        let drift_m = vector(0.0, 0.5);
        Self { jump_m, drift_m, half_way_m, turn_rad: draw.normal(0.3_f64.to_radians()) }
    }

    /// The error of the vehicle's place, `done` of the session gone.
    fn at(&self, done: f64) -> [f64; 2] {
        let second = if done > 0.5 { 1.0 } else { 0.0 };
        [0, 1].map(|i| self.jump_m[i] + self.drift_m[i] * done + self.half_way_m[i] * second)
    }
}

/// Where the vehicle is, metres of way from the start: rows along the stand, twelve metres apart.
fn vehicle_m(way_m: f64) -> [f64; 2] {
    let row = (way_m / STAND_M[0]).floor();
    let along = way_m - row * STAND_M[0];
    let east = if row as i64 % 2 == 0 { along } else { STAND_M[0] - along };
    [CORNER_M[0] + east, CORNER_M[1] + 6.0 + 12.0 * row]
}

fn zone(number: u8) -> Zone {
    Zone::from_wire(number, 0).unwrap()
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// What the classifier would tell of a tree.
fn detection(tree: &Tree, seen_m: [f64; 2], draw: &mut Draw) -> Detection {
    let [easting_m, northing_m] = seen_m.map(|x| x + draw.normal(0.05));
    Detection {
        easting_m,
        northing_m,
        ground_m: 100.0,
        position_std_m: 0.05,
        dbh_m: (tree.dbh_m + draw.normal(0.03)).max(0.05) as f32,
        dbh_std_m: 0.03,
        height_m: f32::NAN,
        confidence: 0.6,
        arc_coverage: 0.4,
        lean_rad: [0.0; 2],
        class: Class::Tree.to_wire(),
        reserved: [0; 7],
    }
}

/// One drive through the stand. Odd sessions work in zone 17, even ones in zone 18 (as the vehicle's position system
/// might decide anew each day).
fn drive(store: &mut KnowledgeStore, trees: &[Tree], session: usize, error: &PoseError, draw: &mut Draw) -> f64 {
    let number = 17 + (session % 2) as u8;
    let to_zone = Reprojection::between(zone(17), zone(number)).unwrap();
    let project = |p: [f64; 2]| if number == 17 { p } else { to_zone.apply(p).unwrap() };
    let length_m = STAND_M[0] * 4.0 - 1.0;
    let steps = (length_m / (SPEED_M_S * STEP_S)) as usize;
    let mut seconds = session as f64 * DAY_S;
    for step in 0..steps {
        let done = step as f64 / steps as f64;
        let true_m = vehicle_m(length_m * done);
        let (at_m, off_m) = (project(true_m), error.at(done));
        let pose_m = [at_m[0] + off_m[0], at_m[1] + off_m[1]];
        let (sin, cos) = error.turn_rad.sin_cos();
        let mut seen = Vec::new();
        for tree in trees.iter().filter(|t| distance_m(t.place_m, true_m) < RANGE_M) {
            let place = project(tree.place_m);
            let [east, north] = [place[0] - at_m[0], place[1] - at_m[1]];
            let turned = [pose_m[0] + east * cos - north * sin, pose_m[1] + east * sin + north * cos];
            let told = detection(tree, turned, draw);
            if draw.uniform() < 0.75 {
                seen.push(told);
            }
        }
        let ghost = [0, 1].map(|i| pose_m[i] + draw.between(-RANGE_M, RANGE_M));
        let ghost = detection(&trees[0], ghost, draw);
        if draw.uniform() < 0.3 {
            seen.push(ghost);
        }
        let stamp = Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds);
        let snapshot = Snapshot { stamp, vehicle_m: pose_m, zone: zone(number), epoch: session as u64 };
        store.take(&snapshot, &seen, view_without_grid);
        if step % 20 == 0 {
            store.forget(stamp);
        }
        seconds += STEP_S;
    }
    seconds
}

/// Precision and recall as one number, and how many are reported.
fn score(store: &KnowledgeStore, trees: &[Tree], seconds: f64) -> (f64, usize) {
    let now = Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds);
    let back = Reprojection::between(store.zone().unwrap(), zone(17)).unwrap();
    let objects = store.query(&Query::all(100_000), now).objects;
    let mut free: Vec<[f64; 2]> = objects.iter().map(|o| back.apply([o.easting_m, o.northing_m]).unwrap()).collect();
    let reported = free.len();
    let mut found = 0;
    for tree in trees {
        let nearest = (0..free.len())
            .min_by(|a, b| distance_m(free[*a], tree.place_m).total_cmp(&distance_m(free[*b], tree.place_m)));
        if let Some(i) = nearest.filter(|i| distance_m(free[*i], tree.place_m) <= MATCH_M) {
            free.swap_remove(i);
            found += 1;
        }
    }
    (2.0 * f64::from(found) / (reported + trees.len()) as f64, reported)
}

/// Drives all sessions, restarting in between; the score and the number of trees reported.
fn run(seed: u64, stems: usize, config: &Config, with_errors: bool) -> (f64, usize) {
    let mut draw = Draw(seed);
    let trees = stand(stems, &mut draw);
    let mut store = KnowledgeStore::new(config.clone());
    let mut seconds = 0.0;
    for session in 0..SESSIONS {
        let drawn = PoseError::drawn(session, &mut draw);
        let error = if with_errors { drawn } else { PoseError::default() };
        seconds = drive(&mut store, &trees, session, &error, &mut draw);
        let objects = store.objects().cloned().collect();
        store = KnowledgeStore::restore(config.clone(), store.zone(), store.next_id(), objects);
    }
    score(&store, &trees, seconds)
}

#[test]
fn drawn_pose_errors_change_the_score_by_less_than_a_hundredth() {
    let config = Config::default();
    let unregistered = Config { registration_reach_m: 0.0, ..config.clone() };
    for (seed, stems) in [(1, 130), (2, 130), (3, 220), (4, 220), (5, 400), (6, 600)] {
        let (truth, with_errors) = (run(seed, stems, &config, false), run(seed, stems, &config, true));
        let without = run(seed, stems, &unregistered, true);
        println!(
            "seed {seed}, {stems} trees: F1 {:.4} ({} trees) with true poses, {:.4} ({}) with drawn errors, {:.4} ({}) unregistered",
            truth.0, truth.1, with_errors.0, with_errors.1, without.0, without.1
        );
        assert!(truth.0 > 0.97, "seed {seed}: {truth:?}");
        assert!(with_errors.0 >= truth.0 - 0.01, "seed {seed}: {with_errors:?}, with true poses {truth:?}");
        assert!(without.0 < truth.0 - 0.1, "seed {seed}: the errors are too small to show anything: {without:?}");
    }
}
