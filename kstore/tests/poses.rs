//! Poses that jump between sessions, drift, turn and cross a UTM zone border must not double the trees: a stand of
//! known trees is driven through again and again, with drawn pose errors and without, and both stores are scored.
#![allow(clippy::print_stdout, reason = "tests say what they measured")]

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
        stamp_ns: 0,
        reserved: [0; 7],
    }
}

/// One drive through the stand, from one share of the way to another. Odd sessions work in zone 18, even ones in zone
/// 17, as the vehicle's position system might decide anew each day.
fn drive(
    store: &mut KnowledgeStore,
    trees: &[Tree],
    session: usize,
    way: [f64; 2],
    error: &PoseError,
    draw: &mut Draw,
) {
    let number = 17 + (session % 2) as u8;
    let to_zone = Reprojection::between(zone(17), zone(number)).unwrap();
    let project = |p: [f64; 2]| if number == 17 { p } else { to_zone.apply(p).unwrap() };
    let length_m = STAND_M[0] * 4.0 - 1.0;
    let steps = (length_m * (way[1] - way[0]).abs() / (SPEED_M_S * STEP_S)) as usize;
    for step in 0..steps {
        let done = step as f64 / steps as f64;
        let true_m = vehicle_m(length_m * (way[0] + (way[1] - way[0]) * done));
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
        let stamp = instant(session, step as f64 * STEP_S);
        let snapshot = Snapshot { stamp, vehicle_m: pose_m, zone: zone(number), epoch: session as u64 };
        store.take(&snapshot, &seen, view_without_grid);
        if step % 20 == 0 {
            store.forget(stamp);
        }
    }
    // A restart: only what would be on disk goes on.
    let objects = store.objects().cloned().collect();
    *store = KnowledgeStore::restore(store.config().clone(), store.zone(), store.next_id(), objects);
}

fn instant(session: usize, seconds: f64) -> Timestamp {
    Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(session as f64 * DAY_S + seconds)
}

/// What a store is worth.
#[derive(Clone, Copy, Debug)]
struct Score {
    /// Precision and recall as one number.
    f1: f64,
    /// Objects reported.
    reported: usize,
    /// Of these, the share with an id from the first day.
    of_the_first_day: f64,
}

fn score(store: &KnowledgeStore, trees: &[Tree], session: usize, first_day: u64) -> Score {
    let back = Reprojection::between(store.zone().unwrap(), zone(17)).unwrap();
    let objects = store.query(&Query::all(100_000), instant(session, 300.0)).objects;
    let mut free: Vec<[f64; 2]> = objects.iter().map(|o| back.apply([o.easting_m, o.northing_m]).unwrap()).collect();
    let (reported, mut found) = (free.len(), 0);
    for tree in trees {
        let distance = |i: &usize| distance_m(free[*i], tree.place_m);
        let nearest = (0..free.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(i) = nearest.filter(|i| distance(i) <= MATCH_M) {
            free.swap_remove(i);
            found += 1;
        }
    }
    let old = objects.iter().filter(|o| o.id < first_day).count();
    let f1 = 2.0 * f64::from(found) / (reported + trees.len()) as f64;
    Score { f1, reported, of_the_first_day: old as f64 / reported.max(1) as f64 }
}

/// Drives all sessions, restarting in between.
fn run(seed: u64, stems: usize, config: &Config, with_errors: bool) -> Score {
    let mut draw = Draw(seed);
    let trees = stand(stems, &mut draw);
    let mut store = KnowledgeStore::new(config.clone());
    let mut first_day = 0;
    for session in 0..SESSIONS {
        let drawn = PoseError::drawn(session, &mut draw);
        let error = if with_errors { drawn } else { PoseError::default() };
        drive(&mut store, &trees, session, [0.0, 1.0], &error, &mut draw);
        first_day = if session == 0 { store.next_id() } else { first_day };
    }
    score(&store, &trees, SESSIONS - 1, first_day)
}

fn compare(stands: &[(u64, usize)]) {
    let config = Config::default();
    for (seed, stems) in stands {
        let truth = run(*seed, *stems, &config, false);
        let drawn = run(*seed, *stems, &config, true);
        println!("seed {seed}, {stems} trees: true poses {truth:.4?}, drawn errors {drawn:.4?}");
        assert!(truth.f1 > 0.97, "seed {seed}: {truth:?}");
        assert!(drawn.f1 >= truth.f1 - 0.01, "seed {seed}: {drawn:?}, with true poses {truth:?}");
        assert!(drawn.of_the_first_day > 0.95, "seed {seed}: {drawn:?}");
    }
}

#[test]
fn drawn_pose_errors_change_the_score_by_less_than_a_hundredth_and_ids_stay() {
    compare(&[(1, 130), (4, 220), (5, 400)]);
}

/// `cargo test --release -p tsense-kstore --test poses -- --ignored --nocapture`
#[test]
#[ignore = "a minute"]
fn drawn_pose_errors_over_twenty_stands() {
    let stands: Vec<(u64, usize)> = (10..30).map(|seed| (seed, 100 + 25 * (seed as usize - 10))).collect();
    compare(&stands);
}

#[test]
fn without_registration_the_same_errors_ruin_the_store() {
    let config = Config { registration_reach_m: 0.0, ..Config::default() };
    let ruined = run(1, 130, &config, true);
    println!("{ruined:.4?}");
    assert!(ruined.f1 < 0.5 && ruined.of_the_first_day < 0.5, "{ruined:?}");
}

/// The second day begins on ground that nobody knows, with a pose two metres off, and meets the first day's trees later:
/// what was stored until then moves along, and no tree is there twice.
#[test]
fn a_wrong_pose_is_put_right_where_known_trees_come_into_sight() {
    let mut draw = Draw(7);
    let trees = stand(250, &mut draw);
    let mut store = KnowledgeStore::new(Config::default());
    drive(&mut store, &trees, 0, [0.0, 0.5], &PoseError::default(), &mut draw);
    let first_day = store.next_id();
    let error = PoseError { jump_m: [1.6, -1.1], turn_rad: 0.005, ..PoseError::default() };
    drive(&mut store, &trees, 2, [1.0, 0.0], &error, &mut draw);
    let score = score(&store, &trees, 2, first_day);
    println!("{score:.4?}");
    assert!(score.f1 > 0.97 && score.reported <= 256, "{score:?}");
}
