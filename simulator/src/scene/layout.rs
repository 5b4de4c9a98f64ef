//! Named scenes: what each one holds, and where chance puts it.
//!
//! In: a name and a seed. Out: the ground and the things on it, clear of both ways through the scene.

use super::name::SceneName;
use super::shapes::{Ellipsoid, Slab};
use super::terrain::{Ditch, Terrain, TerrainSpec};
use super::things::{Person, Porous, Rock, Tree, TreeSpec, Wall};
use crate::path::{Path, Way};
use crate::rng::Rng;
use nalgebra::Vector3;

/// How much of everything a scene holds.
struct Plan {
    terrain: TerrainSpec,
    trees_per_ha: f64,
    dbh_m: [f64; 2],
    tree_spacing_m: f64,
    brush_patches_per_ha: f64,
    rocks_per_ha: f64,
    wall: bool,
    person: bool,
}

/// The things that stand on the ground of a scene.
pub(super) struct Furniture {
    pub terrain: Terrain,
    pub ditch: Option<Ditch>,
    pub trees: Vec<Tree>,
    pub bushes: Vec<Porous>,
    pub rocks: Vec<Rock>,
    pub walls: Vec<Wall>,
    pub person: Option<Person>,
}

/// Trees and bushes stand within this distance of the centre, metres; beams beyond see ground only.
const PLANTED_M: f64 = 62.0;
/// What stands beside a way keeps this distance from the vehicle's centre line, metres: half a width of 0.9 m and room.
const CLEAR_M: f64 = 1.7;

fn plan(name: SceneName) -> Plan {
    let terrain = TerrainSpec {
        slope: 0.04,
        uphill_rad: 0.9,
        rolling_m: 0.35,
        roughness_m: 0.03,
        grass_cover: 0.15,
        grass_m: 0.3,
        ditch: None,
    };
    let ditch = |y| Ditch { at_m: [4.0, y], along_rad: 0.08, width_m: 1.5, depth_m: 0.9, half_length_m: 18.0 };
    let bare = Plan {
        terrain,
        trees_per_ha: 60.0,
        dbh_m: [0.15, 0.45],
        tree_spacing_m: 1.8,
        brush_patches_per_ha: 0.0,
        rocks_per_ha: 0.0,
        wall: false,
        person: false,
    };
    let level =
        || TerrainSpec { slope: 0.0, rolling_m: 0.0, roughness_m: 0.01, grass_cover: 0.0, ..bare.terrain.clone() };
    match name {
        SceneName::Forest | SceneName::Drift => {
            let terrain = TerrainSpec { ditch: Some(ditch(10.5)), ..bare.terrain.clone() };
            Plan { trees_per_ha: 300.0, brush_patches_per_ha: 60.0, rocks_per_ha: 60.0, terrain, ..bare }
        }
        SceneName::Flat => Plan { terrain: level(), ..bare },
        SceneName::Slope => {
            let terrain = TerrainSpec { slope: 0.25, roughness_m: 0.06, ..bare.terrain.clone() };
            Plan { trees_per_ha: 250.0, brush_patches_per_ha: 80.0, rocks_per_ha: 80.0, terrain, ..bare }
        }
        SceneName::Grass => {
            let terrain = TerrainSpec { grass_cover: 0.9, grass_m: 0.8, roughness_m: 0.05, ..bare.terrain.clone() };
            Plan { trees_per_ha: 90.0, terrain, ..bare }
        }
        SceneName::Ditch => Plan { terrain: TerrainSpec { ditch: Some(ditch(9.0)), ..level() }, ..bare },
        SceneName::Wall => Plan { terrain: level(), wall: true, ..bare },
        SceneName::Rocks => Plan { rocks_per_ha: 1000.0, trees_per_ha: 30.0, terrain: level(), ..bare },
        SceneName::Bumps => {
            let terrain = TerrainSpec { rolling_m: 0.45, roughness_m: 0.08, ..bare.terrain.clone() };
            Plan { trees_per_ha: 150.0, terrain, ..bare }
        }
        SceneName::Person => Plan { terrain: level(), person: true, ..bare },
        SceneName::Young => {
            Plan { trees_per_ha: 1500.0, dbh_m: [0.05, 0.2], tree_spacing_m: 1.0, brush_patches_per_ha: 25.0, ..bare }
        }
    }
}

/// Places that must stay free: the ways, the ditch, the wall and the person's walk.
struct Clearings {
    ways: Vec<[f64; 2]>,
    ditch: Option<Ditch>,
}

impl Clearings {
    fn new(ditch: Option<Ditch>) -> Self {
        let ways = [Way::Oval, Way::Line].into_iter().flat_map(|way| Path::new(way).places(0.5));
        Self { ways: ways.map(|p| [p.x_m, p.y_m]).collect(), ditch }
    }

    fn way_m(&self, x: f64, y: f64) -> f64 {
        self.ways.iter().map(|p| (p[0] - x).hypot(p[1] - y)).fold(f64::INFINITY, f64::min)
    }

    fn free(&self, x: f64, y: f64, radius_m: f64) -> bool {
        let beside_ditch = self.ditch.is_none_or(|d| {
            let (across, along) = d.across_along_m(x, y);
            across.abs() > d.width_m / 2.0 + 0.4 + radius_m || along.abs() > d.half_length_m + 0.4 + radius_m
        });
        beside_ditch && self.way_m(x, y) > CLEAR_M + radius_m
    }
}

/// Everything of a scene.
pub(super) fn furnish(name: SceneName, seed: u64) -> Furniture {
    let plan = plan(name);
    let mut terrain = Terrain::new(&plan.terrain, seed);
    let clear = Clearings::new(plan.terrain.ditch);
    // The vehicle has driven its ways before: their grass is down, and the start place is free.
    let near = |x: f64, y: f64| x.abs() < 24.0 && y.abs() < 12.0 && clear.way_m(x, y) < 0.9;
    terrain.mow(|x, y| !near(x, y));
    // One stream a kind, so that more rocks do not move the trees.
    let stream = |kind: u64| Rng::new(crate::rng::hash(&[seed, kind]));
    let wall = plan.wall.then(|| building(&terrain));
    let mut furniture = Furniture {
        ditch: plan.terrain.ditch,
        trees: plant_trees(&plan, &terrain, &clear, &mut stream(11)),
        bushes: plant_brush(&plan, &terrain, &clear, &mut stream(12)),
        rocks: lay_rocks(&plan, &terrain, &clear, &mut stream(13)),
        walls: wall.into_iter().collect(),
        person: plan.person.then_some(Person::WALKER),
        terrain,
    };
    let blocked = |x: f64, y: f64| {
        furniture.walls.iter().any(|w| (x - w.body.center.x).abs() < 14.0 && (y - w.body.center.y).abs() < 5.0)
            || (plan.person && (x - 10.0).abs() < 7.0 && (y - 7.0).abs() < 3.0)
    };
    furniture.trees.retain(|t| !blocked(t.breast_m[0], t.breast_m[1]));
    furniture
}

fn building(terrain: &Terrain) -> Wall {
    let center = Vector3::new(9.0, 10.0, terrain.ground_m(9.0, 10.0) + 1.5);
    Wall { body: Slab { center, half_m: Vector3::new(8.0, 0.15, 2.0), along_rad: 0.12 }, reflectance: 0.5 }
}

/// Number of things on the planted area, from a number a hectare.
fn number(per_ha: f64) -> usize {
    (per_ha * (2.0 * PLANTED_M).powi(2) / 1e4).round() as usize
}

fn somewhere(rng: &mut Rng) -> [f64; 2] {
    [rng.between(-PLANTED_M, PLANTED_M), rng.between(-PLANTED_M, PLANTED_M)]
}

fn plant_trees(plan: &Plan, terrain: &Terrain, clear: &Clearings, rng: &mut Rng) -> Vec<Tree> {
    let wanted = number(plan.trees_per_ha);
    let mut trees: Vec<Tree> = Vec::with_capacity(wanted);
    // Darts until the number stands; a full stand stops after twenty darts a tree.
    for _ in 0..wanted * 20 {
        if trees.len() == wanted {
            break;
        }
        let spec = grow(plan, terrain, rng);
        let [x, y] = spec.base_m;
        let spaced = trees.iter().all(|t| (t.breast_m[0] - x).hypot(t.breast_m[1] - y) > plan.tree_spacing_m);
        if spaced && clear.free(x, y, spec.dbh_m / 2.0) {
            trees.push(Tree::new(&spec));
        }
    }
    trees
}

fn grow(plan: &Plan, terrain: &Terrain, rng: &mut Rng) -> TreeSpec {
    let base_m = somewhere(rng);
    let [low, high] = plan.dbh_m;
    // More thin trees than thick ones: the smaller of two draws, pulled half way back.
    let dbh_m = low + (high - low) * (0.5 * rng.unit() + 0.5 * rng.unit().min(rng.unit()));
    let height_m = 3.0 + 32.0 * dbh_m + rng.between(-1.0, 1.0);
    let lean_rad = rng.normal(0.025).clamp(-0.09, 0.09);
    let (sin, cos) = rng.between(0.0, std::f64::consts::TAU).sin_cos();
    let dark = rng.unit() < 0.06;
    TreeSpec {
        base_m,
        ground_m: terrain.ground_m(base_m[0], base_m[1]),
        dbh_m,
        height_m,
        lean: [lean_rad * cos, lean_rad * sin],
        crown_base_m: height_m * rng.between(0.4, 0.6),
        crown_radius_m: 0.6 + 5.0 * dbh_m,
        reflectance: if dark { 0.07 } else { rng.between(0.2, 0.45) },
    }
}

fn plant_brush(plan: &Plan, terrain: &Terrain, clear: &Clearings, rng: &mut Rng) -> Vec<Porous> {
    let mut bushes = Vec::new();
    for _ in 0..number(plan.brush_patches_per_ha) {
        let [px, py] = somewhere(rng);
        let tall_m = rng.between(0.5, 1.7);
        for _ in 0..rng.count(3, 8) {
            let (x, y) = (px + rng.normal(1.1), py + rng.normal(1.1));
            let (radius_m, height_m) = (rng.between(0.35, 0.9), tall_m * rng.between(0.7, 1.1));
            let density_per_m = rng.between(1.5, 3.5);
            if clear.free(x, y, radius_m - 0.5) {
                // The ellipsoid's centre lies at 0.4 of the height: it is widest above the ground.
                let center = Vector3::new(x, y, terrain.ground_m(x, y) + 0.4 * height_m);
                let radii_m = Vector3::new(radius_m, radius_m, 0.6 * height_m);
                bushes.push(Porous { body: Ellipsoid { center, radii_m }, density_per_m, reflectance: 0.45 });
            }
        }
    }
    bushes
}

fn lay_rocks(plan: &Plan, terrain: &Terrain, clear: &Clearings, rng: &mut Rng) -> Vec<Rock> {
    let mut rocks = Vec::new();
    for _ in 0..number(plan.rocks_per_ha) {
        let [x, y] = somewhere(rng);
        let radii_m = Vector3::new(rng.between(0.2, 0.7), rng.between(0.2, 0.7), rng.between(0.2, 0.55));
        let sunk_m = radii_m.z * rng.between(0.1, 0.4);
        if clear.free(x, y, radii_m.x.max(radii_m.y)) {
            let center = Vector3::new(x, y, terrain.ground_m(x, y) - sunk_m);
            rocks.push(Rock { body: Ellipsoid { center, radii_m }, reflectance: rng.between(0.3, 0.5) });
        }
    }
    rocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_stands_in_the_way_in_any_scene() {
        for name in SceneName::ALL {
            let furniture = furnish(name, 7);
            let ways: Vec<_> = [Way::Oval, Way::Line].into_iter().flat_map(|w| Path::new(w).places(0.25)).collect();
            for tree in &furniture.trees {
                let base = tree.axis_at(0.0);
                let gap = ways.iter().map(|p| (p.x_m - base.x).hypot(p.y_m - base.y)).fold(f64::MAX, f64::min);
                assert!(gap - tree.dbh_m / 2.0 > 1.5, "{name:?}: a tree {gap:.2} m from the way");
            }
        }
    }

    #[test]
    fn the_forest_has_as_many_trees_in_reach_as_promised() {
        for seed in 1..=8 {
            let furniture = furnish(SceneName::Forest, seed);
            let way = Path::new(Way::Oval).places(0.5);
            let near = |t: &&Tree| way.iter().any(|p| (p.x_m - t.breast_m[0]).hypot(p.y_m - t.breast_m[1]) < 12.0);
            let count = furniture.trees.iter().filter(near).count();
            assert!((20..=45).contains(&count), "seed {seed}: {count}");
            assert!(furniture.trees.iter().all(|t| (0.15..=0.45).contains(&t.dbh_m)));
            assert!(furniture.bushes.len() > 100 && furniture.rocks.len() > 20 && furniture.ditch.is_some());
        }
    }
}
