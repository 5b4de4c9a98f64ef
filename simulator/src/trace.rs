//! One ray through a scene: what it meets first.
//!
//! In: a ray in the scene's frame, its longest range, a number for its fate in porous bodies. Out: the range and how
//! much light comes back. Walks the metre columns along the ray; inside a column, the ground's cells and the things
//! listed there. Ground is met exactly (a bilinear patch gives a quadratic along the ray).

use crate::rng::{exponential, fraction, mix};
use crate::scene::{Figure, HALF_EXTENT_M, Item, Meeting, NODE_M, Porous, Ray, Scene};
use nalgebra::Vector3;

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The ground.
    Ground,
    /// Grass or a bush.
    Brush,
    /// A trunk.
    Trunk,
    /// A crown.
    Crown,
    /// A rock.
    Rock,
    /// A wall.
    Wall,
    /// A person.
    Person,
}

/// A ray's first meeting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, metres.
    pub range_m: f64,
    /// Share of the light that comes back, 0 to 1, incidence included.
    pub reflectance: f64,
    /// What was met.
    pub kind: Kind,
}

/// Share of the light that the ground sends back at 905 nm.
const GROUND_REFLECTANCE: f64 = 0.35;
/// Share of the light that grass sends back.
const GRASS_REFLECTANCE: f64 = 0.45;
/// Share of the light that clothes send back.
const PERSON_REFLECTANCE: f64 = 0.4;
/// Meetings per metre in grass.
const GRASS_DENSITY_PER_M: f64 = 1.2;
/// Edge of the clumps in porous bodies, metres.
const CLUMP_M: f64 = 0.3;

/// Walks the cells of a square raster along a ray, in the plane.
struct Walk {
    cell: [i64; 2],
    step: [i64; 2],
    /// Range at which the next border is crossed, on each axis.
    next_m: [f64; 2],
    /// Range between borders, on each axis.
    stride_m: [f64; 2],
    from_m: f64,
    to_m: f64,
}

impl Walk {
    #[inline]
    fn new(ray: &Ray, cell_m: f64, from_m: f64, to_m: f64) -> Self {
        let start = ray.at(from_m);
        let axis = |place: f64, direction: f64| {
            let along = (place + HALF_EXTENT_M) / cell_m;
            let cell = along.floor();
            if direction > 0.0 {
                (cell as i64, 1, from_m + (cell + 1.0 - along) * cell_m / direction, cell_m / direction)
            } else if direction < 0.0 {
                (cell as i64, -1, from_m + (cell - along) * cell_m / direction, -cell_m / direction)
            } else {
                (cell as i64, 0, f64::INFINITY, f64::INFINITY)
            }
        };
        let (i, di, ti, si) = axis(start.x, ray.direction.x);
        let (j, dj, tj, sj) = axis(start.y, ray.direction.y);
        Self { cell: [i, j], step: [di, dj], next_m: [ti, tj], stride_m: [si, sj], from_m, to_m }
    }

    /// The cell and the ranges at which the ray enters and leaves it.
    #[inline]
    fn next(&mut self) -> Option<([i64; 2], f64, f64)> {
        if self.from_m >= self.to_m {
            return None;
        }
        let axis = usize::from(self.next_m[1] < self.next_m[0]);
        let (cell, enter_m) = (self.cell, self.from_m);
        let leave_m = self.next_m[axis].min(self.to_m).max(enter_m);
        self.from_m = self.next_m[axis];
        self.next_m[axis] += self.stride_m[axis];
        self.cell[axis] += self.step[axis];
        Some((cell, enter_m, leave_m))
    }
}

/// The part of a ray over the scene, metres: nothing when it never is.
fn over_scene(ray: &Ray, range_max_m: f64) -> Option<(f64, f64)> {
    // A hair inside, so that rounding never names a cell beyond the last.
    let half = HALF_EXTENT_M - 1e-6;
    let (mut near, mut far) = (0.0f64, range_max_m);
    for axis in 0..2 {
        let (o, d) = (ray.origin[axis], ray.direction[axis]);
        if d == 0.0 {
            if o.abs() >= half {
                return None;
            }
        } else {
            let (a, b) = ((-half - o) / d, (half - o) / d);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
    }
    (near < far).then_some((near, far))
}

impl Scene {
    /// What a ray meets first within `range_max_m`. `fate` decides what happens inside porous bodies.
    pub fn trace(&self, ray: &Ray, range_max_m: f64, fate: u64, figure: Option<&Figure>) -> Option<Hit> {
        let person = figure.and_then(|f| f.meet(ray)).map(|m| hit(m, PERSON_REFLECTANCE, Kind::Person));
        let mut best = person.filter(|h| h.range_m < range_max_m);
        let Some((from_m, to_m)) = over_scene(ray, range_max_m) else { return best };
        let mut walk = Walk::new(ray, 1.0, from_m, to_m);
        while let Some((cell, enter_m, leave_m)) = walk.next() {
            if best.is_some_and(|b| b.range_m <= enter_m) {
                break;
            }
            let (z0, z1) = (ray.origin.z + ray.direction.z * enter_m, ray.origin.z + ray.direction.z * leave_m);
            let (low, high) = (z0.min(z1), z0.max(z1));
            if z0 > self.columns.top_m && ray.direction.z >= 0.0 {
                break;
            }
            let column = self.columns.column(cell[0] as usize, cell[1] as usize);
            if low <= f64::from(column.ground_top_m) {
                nearer(&mut best, self.ground(ray, enter_m, leave_m, fate));
            }
            if low <= f64::from(column.high_m) && high >= f64::from(column.low_m) {
                for item in self.columns.items(column) {
                    nearer(&mut best, self.item(ray, *item, (enter_m, leave_m), fate));
                }
            }
        }
        best
    }

    /// Share of light that passes between two places, 0 to 1. Solids stop it, porous bodies and grass thin it. The
    /// trunk `except` is not in the way: it is what is looked at.
    pub fn transmission(&self, from: Vector3<f64>, to: Vector3<f64>, except: usize) -> f64 {
        let range_m = (to - from).norm();
        let ray = Ray { origin: from, direction: (to - from) / range_m };
        let Some((from_m, to_m)) = over_scene(&ray, range_m) else { return 1.0 };
        let mut depth = 0.0;
        let mut walk = Walk::new(&ray, 1.0, from_m, to_m);
        while let Some((cell, enter_m, leave_m)) = walk.next() {
            let column = self.columns.column(cell[0] as usize, cell[1] as usize);
            for item in self.columns.items(column) {
                match self.shade(&ray, *item, (enter_m, leave_m), range_m, except) {
                    Some(thin) => depth += thin,
                    None => return 0.0,
                }
            }
        }
        let steps = (range_m / NODE_M).ceil() as usize;
        for k in 0..steps {
            let place = ray.at((k as f64 + 0.5) * range_m / steps as f64);
            let height_m = place.z - self.terrain.ground_m(place.x, place.y);
            if height_m < 0.0 {
                return 0.0;
            }
            if height_m < self.terrain.grass_m(place.x, place.y) {
                depth += GRASS_DENSITY_PER_M * range_m / steps as f64;
            }
        }
        (-depth).exp()
    }

    /// Optical depth of one thing inside a column; nothing where a solid stops the light before its goal.
    fn shade(&self, ray: &Ray, item: Item, column: (f64, f64), range_m: f64, except: usize) -> Option<f64> {
        let thin = |thing: &Porous| {
            let inside = thing.body.span(ray).map_or(0.0, |(a, b)| b.min(column.1) - a.max(column.0));
            Some(inside.max(0.0) * thing.density_per_m)
        };
        let stops = |met: Option<Meeting>| if met.is_some_and(|m| m.range_m < range_m) { None } else { Some(0.0) };
        match item {
            Item::Trunk(i) if i as usize == except => Some(0.0),
            Item::Trunk(i) => stops(self.trees[i as usize].trunk.meet(ray)),
            Item::Rock(i) => stops(self.rocks[i as usize].body.meet(ray)),
            Item::Wall(i) => stops(self.walls[i as usize].body.meet(ray)),
            Item::Crown(i) => thin(&self.trees[i as usize].crown),
            Item::Bush(i) => thin(&self.bushes[i as usize]),
        }
    }

    /// What a ray meets of one thing. Solids answer wherever they are met, porous bodies only inside the column.
    #[inline]
    fn item(&self, ray: &Ray, item: Item, column: (f64, f64), fate: u64) -> Option<Hit> {
        match item {
            Item::Trunk(i) => {
                let tree = &self.trees[i as usize];
                tree.trunk.meet(ray).map(|m| hit(m, tree.reflectance, Kind::Trunk))
            }
            Item::Rock(i) => {
                let rock = &self.rocks[i as usize];
                rock.body.meet(ray).map(|m| hit(m, rock.reflectance, Kind::Rock))
            }
            Item::Wall(i) => {
                let wall = &self.walls[i as usize];
                wall.body.meet(ray).map(|m| hit(m, wall.reflectance, Kind::Wall))
            }
            Item::Crown(i) => {
                porous(ray, &self.trees[i as usize].crown, Kind::Crown, column, fate ^ u64::from(i) << 32)
            }
            Item::Bush(i) => {
                porous(ray, &self.bushes[i as usize], Kind::Brush, column, fate ^ u64::from(i) << 32 ^ 1 << 63)
            }
        }
    }

    /// Where a ray meets ground or grass between two ranges.
    fn ground(&self, ray: &Ray, from_m: f64, to_m: f64, fate: u64) -> Option<Hit> {
        let mut walk = Walk::new(ray, NODE_M, from_m, to_m);
        while let Some((cell, enter_m, leave_m)) = walk.next() {
            let (i, j) = (cell[0].clamp(0, LAST_CELL) as usize, cell[1].clamp(0, LAST_CELL) as usize);
            let patch = self.terrain.patch(i, j);
            let (start, end) = (ray.at(enter_m), ray.at(leave_m));
            if start.z.min(end.z) > patch.top_m {
                continue;
            }
            let u = (start.x + HALF_EXTENT_M) / NODE_M - i as f64;
            let v = (start.y + HALF_EXTENT_M) / NODE_M - j as f64;
            let (ut, vt) = (ray.direction.x / NODE_M, ray.direction.y / NODE_M);
            // Height of the ray above the patch after t metres: c + b t + a t^2.
            let a = -patch.d * ut * vt;
            let b = ray.direction.z - patch.b * ut - patch.c * vt - patch.d * (u * vt + v * ut);
            let c = start.z - (patch.a + patch.b * u + patch.c * v + patch.d * u * v);
            let length_m = leave_m - enter_m;
            let soil = first_root(a, b, c).filter(|t| *t <= length_m);
            if patch.grass_m > 0.0 {
                let seed = mix(fate ^ (cell[0] as u64) << 20 ^ cell[1] as u64);
                if let Some(t) = self.grass(ray, enter_m, soil.unwrap_or(length_m), (a, b, c), seed) {
                    return Some(Hit { range_m: enter_m + t, reflectance: GRASS_REFLECTANCE, kind: Kind::Brush });
                }
            }
            if let Some(t) = soil {
                let steep = ((patch.b + patch.d * v) / NODE_M, (patch.c + patch.d * u) / NODE_M);
                let slant = -b / (1.0 + steep.0 * steep.0 + steep.1 * steep.1).sqrt();
                let meeting = Meeting { range_m: enter_m + t, cosine: slant.clamp(0.0, 1.0) };
                return Some(hit(meeting, GROUND_REFLECTANCE, Kind::Ground));
            }
        }
        None
    }

    /// Where a ray is stopped by grass within `length_m` of a cell: two half ways, each inside the grass or above it.
    fn grass(&self, ray: &Ray, enter_m: f64, length_m: f64, above: (f64, f64, f64), seed: u64) -> Option<f64> {
        let half_m = length_m / 2.0;
        for k in 0..2 {
            let middle_m = half_m * (f64::from(k) + 0.5);
            let height_m = above.2 + above.1 * middle_m + above.0 * middle_m * middle_m;
            let place = ray.at(enter_m + middle_m);
            if height_m < self.terrain.grass_m(place.x, place.y) {
                let run_m = exponential(mix(seed ^ k as u64)) / GRASS_DENSITY_PER_M;
                if run_m < half_m {
                    return Some(half_m * f64::from(k) + run_m);
                }
            }
        }
        None
    }
}

/// The last ground cell on an axis.
const LAST_CELL: i64 = (2.0 * HALF_EXTENT_M / NODE_M) as i64 - 1;

#[inline]
fn nearer(best: &mut Option<Hit>, other: Option<Hit>) {
    if let Some(other) = other
        && best.is_none_or(|b| other.range_m < b.range_m)
    {
        *best = Some(other);
    }
}

/// Rough natural surfaces send some light back at any incidence, the rest as Lambert's law says.
fn hit(meeting: Meeting, reflectance: f64, kind: Kind) -> Hit {
    Hit { range_m: meeting.range_m, reflectance: reflectance * (0.35 + 0.65 * meeting.cosine), kind }
}

/// The smallest t >= 0 at which `c + b t + a t^2` reaches zero from above; at once where it starts below.
fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    if c <= 0.0 {
        return Some(0.0);
    }
    let discriminant = b * b - 4.0 * a * c;
    if discriminant < 0.0 {
        return None;
    }
    // The stable form for the root that comes first when falling: 2c / (-b + sqrt(..)).
    let divisor = -b + discriminant.sqrt();
    (divisor > 0.0).then(|| 2.0 * c / divisor)
}

/// Where a ray is stopped inside a porous body, within one column: every stretch draws its own free run, scaled by
/// how dense the clump there is. The clumps stay where they are; the run changes from ray to ray.
fn porous(ray: &Ray, thing: &Porous, kind: Kind, column: (f64, f64), seed: u64) -> Option<Hit> {
    let (enter_m, leave_m) = thing.body.span(ray)?;
    let (mut from_m, to_m) = (enter_m.max(column.0), leave_m.min(column.1));
    while from_m < to_m {
        let end_m = (from_m + CLUMP_M).min(to_m);
        let place = ray.at((from_m + end_m) / 2.0) / CLUMP_M;
        let cell = (place.x.floor() as i64 as u64) << 42
            ^ (place.y.floor() as i64 as u64) << 21
            ^ place.z.floor() as i64 as u64;
        let density_per_m = 2.0 * fraction(mix(cell)) * thing.density_per_m;
        let run_m = exponential(mix(seed ^ from_m.to_bits())) / density_per_m;
        if from_m + run_m < end_m {
            return Some(Hit { range_m: from_m + run_m, reflectance: thing.reflectance, kind });
        }
        from_m = end_m;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::scene::{Ellipsoid, Terrain, TerrainSpec, Tree, TreeSpec};

    fn terrain(slope: f64, rolling_m: f64) -> Terrain {
        let spec = TerrainSpec {
            slope,
            uphill_rad: 0.0,
            rolling_m,
            roughness_m: 0.1 * rolling_m,
            grass_cover: 0.0,
            grass_m: 0.0,
            ditch: None,
        };
        Terrain::new(&spec, 5)
    }

    fn bare(slope: f64, rolling_m: f64) -> Scene {
        Scene::from_parts(terrain(slope, rolling_m), vec![], vec![], vec![], vec![])
    }

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: Vector3::from(direction).normalize() }
    }

    #[test]
    fn a_plane_is_met_where_the_formula_says() {
        let (mut cases, mut rng) = (0, Rng::new(1));
        for slope in [0.0, 0.1, -0.3] {
            let scene = bare(slope, 0.0);
            for _ in 0..300 {
                let down = ray(
                    [rng.between(-5.0, 5.0), rng.between(-5.0, 5.0), 3.7],
                    [rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), rng.between(-1.0, -0.05)],
                );
                // Height above the plane z = slope x: h0 = z - slope x, rate = dz - slope dx.
                let rate = down.direction.z - slope * down.direction.x;
                let expected = (down.origin.z - slope * down.origin.x) / -rate;
                if rate < -0.05 && expected < 50.0 {
                    let met = scene.trace(&down, 50.0, 0, None).unwrap();
                    assert!((met.range_m - expected).abs() < 1e-4, "{} {expected}", met.range_m);
                    assert_eq!(met.kind, Kind::Ground);
                    cases += 1;
                }
            }
        }
        assert!(cases > 700, "only {cases} cases");
    }

    #[test]
    fn rolling_ground_is_met_on_its_surface_and_never_passed_through() {
        let (scene, mut rng, mut cases) = (bare(0.05, 0.6), Rng::new(2), 0);
        for _ in 0..2000 {
            let (x, y) = (rng.between(-30.0, 30.0), rng.between(-30.0, 30.0));
            let origin = [x, y, scene.terrain.ground_m(x, y) + 1.8];
            let beam = ray(origin, [rng.normal(1.0), rng.normal(1.0), -rng.between(0.0, 0.8)]);
            let met = scene.trace(&beam, 50.0, 0, None);
            let end_m = met.map_or(50.0, |m| m.range_m);
            for k in 0..200 {
                let p = beam.at(end_m * f64::from(k) / 200.0);
                if p.x.abs() < 79.0 && p.y.abs() < 79.0 {
                    assert!(p.z > scene.terrain.ground_m(p.x, p.y) - 1e-6, "through the ground");
                }
            }
            if let Some(met) = met {
                let p = beam.at(met.range_m);
                assert!((p.z - scene.terrain.ground_m(p.x, p.y)).abs() < 1e-6);
                cases += 1;
            }
        }
        assert!(cases > 1000, "only {cases} cases");
    }

    #[test]
    fn a_trunk_far_away_is_met_as_its_own_formula_says() {
        let spec = TreeSpec {
            base_m: [20.3, 4.2],
            ground_m: 0.0,
            dbh_m: 0.4,
            height_m: 16.0,
            lean: [0.03, -0.02],
            crown_base_m: 8.0,
            crown_radius_m: 2.0,
            reflectance: 0.3,
        };
        let tree = Tree::new(&spec);
        let scene = Scene::from_parts(terrain(0.0, 0.0), vec![tree], vec![], vec![], vec![]);
        let mut met = 0;
        for k in -20..=20 {
            let aim = tree.axis_at(1.3) + Vector3::new(0.0, 0.015 * f64::from(k), 0.0);
            let origin = Vector3::new(0.0, 0.0, 1.8);
            let beam = Ray { origin, direction: (aim - origin).normalize() };
            let expected = tree.trunk.meet(&beam);
            let got = scene.trace(&beam, 50.0, 0, None).filter(|h| h.kind == Kind::Trunk);
            assert_eq!(got.map(|h| h.range_m), expected.map(|m| m.range_m));
            met += usize::from(got.is_some());
        }
        assert!((25..=29).contains(&met), "0.4 m at steps of 15 mm: {met}");
    }

    #[test]
    fn the_share_of_rays_that_pass_a_bush_falls_exponentially() {
        let body = Ellipsoid { center: Vector3::new(5.0, 0.0, 1.5), radii_m: Vector3::new(1.0, 20.0, 1.0) };
        let bush = Porous { body, density_per_m: 0.8, reflectance: 0.4 };
        let scene = Scene::from_parts(terrain(0.0, 0.0), vec![], vec![bush], vec![], vec![]);
        let (mut rng, mut passed) = (Rng::new(3), 0);
        for _ in 0..20_000 {
            let beam = ray([0.0, rng.between(-10.0, 10.0), 1.5], [1.0, 0.0, 0.0]);
            passed += usize::from(scene.trace(&beam, 20.0, rng.bits(), None).is_none());
        }
        // Two metres at 0.8 a metre: exp(-1.6) = 0.202 for an even density. Clumps uniform in [0, 2] let more pass:
        // a stretch of 0.3 m passes (1 - exp(-0.48)) / 0.48 = 0.794, and 2 m are 6.67 of them: 0.215. A row of
        // bushes has only some 470 clumps at one height, so the share scatters by a few hundredths about it.
        let share = passed as f64 / 2e4;
        assert!((share - 0.215).abs() < 0.04, "{share}");
    }
}
