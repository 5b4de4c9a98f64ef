//! The ground as a raster of node heights with grass on it; between nodes it is bilinear, and that IS the truth.
//!
//! In and out: metres in the scene's own frame (x east, y north, z up from the scene origin). The cast meets the
//! same surface that the truth reports, so a ground error is never the simulator's interpolation.

use crate::rng::{fraction, hash};

/// Half the edge of a scene, metres: the longest beam (50 m) from the path's farthest point stays inside it mostly.
pub const HALF_EXTENT_M: f64 = 80.0;
/// Distance between nodes, metres: two to three voxels of 0.15 m; a ditch wall is steep at this spacing.
pub const NODE_M: f64 = 0.25;
const NODES: usize = (2.0 * HALF_EXTENT_M / NODE_M) as usize + 1;

/// A ditch: a straight trench with sloping walls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ditch {
    /// A place on its centre line, metres in the scene.
    pub at_m: [f64; 2],
    /// Direction of the centre line, radians counter-clockwise from east.
    pub along_rad: f64,
    /// Width at the top, metres.
    pub width_m: f64,
    /// Depth below the ground beside it, metres.
    pub depth_m: f64,
    /// Half its length, metres.
    pub half_length_m: f64,
}

/// Width of a ditch's sloping wall, metres.
const DITCH_WALL_M: f64 = 0.3;

impl Ditch {
    /// Distance from the centre line (signed) and along it from the middle, metres.
    pub fn across_along_m(&self, x: f64, y: f64) -> (f64, f64) {
        let (sin, cos) = self.along_rad.sin_cos();
        let (dx, dy) = (x - self.at_m[0], y - self.at_m[1]);
        (dy * cos - dx * sin, dx * cos + dy * sin)
    }

    /// How far below the ground beside it the ditch is at a place, metres; 0 outside.
    pub fn depth_at_m(&self, x: f64, y: f64) -> f64 {
        let (across, along) = self.across_along_m(x, y);
        let ramp = |inside_m: f64| (inside_m / DITCH_WALL_M).clamp(0.0, 1.0);
        self.depth_m * ramp(self.width_m / 2.0 - across.abs()) * ramp(self.half_length_m - along.abs())
    }
}

/// What the ground looks like.
#[derive(Clone, Debug, PartialEq)]
pub struct TerrainSpec {
    /// Rise per metre towards `uphill_rad`.
    pub slope: f64,
    /// Direction of the rise, radians counter-clockwise from east.
    pub uphill_rad: f64,
    /// Amplitude of the rolling (14 m long waves), metres.
    pub rolling_m: f64,
    /// Amplitude of the roughness (1.3 m long waves), metres.
    pub roughness_m: f64,
    /// Share of the area under grass.
    pub grass_cover: f64,
    /// Mean height of the grass, metres.
    pub grass_m: f64,
    /// The ditch, where there is one.
    pub ditch: Option<Ditch>,
}

/// The ground and the grass on it.
#[derive(Clone, Debug)]
pub struct Terrain {
    ground_m: Vec<f32>,
    grass_m: Vec<f32>,
}

/// One cell between four nodes: `h(u, v) = a + b u + c v + d u v` with u, v in [0, 1].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    pub a: f64,
    pub b: f64,
    pub c: f64,
    pub d: f64,
    pub grass_m: f64,
    pub top_m: f64,
}

impl Terrain {
    /// The ground of a seed.
    pub fn new(spec: &TerrainSpec, seed: u64) -> Self {
        let at = |i: usize| i as f64 * NODE_M - HALF_EXTENT_M;
        let mut terrain =
            Self { ground_m: Vec::with_capacity(NODES * NODES), grass_m: Vec::with_capacity(NODES * NODES) };
        for row in 0..NODES {
            for column in 0..NODES {
                let (x, y) = (at(column), at(row));
                terrain.ground_m.push(ground_height(spec, seed, x, y) as f32);
                terrain.grass_m.push(grass_height(spec, seed, x, y) as f32);
            }
        }
        terrain
    }

    /// Takes the grass away around a place, so that nothing grows where the vehicle starts.
    pub fn mow(&mut self, keep: impl Fn(f64, f64) -> bool) {
        for (i, grass) in self.grass_m.iter_mut().enumerate() {
            let at = |i: usize| i as f64 * NODE_M - HALF_EXTENT_M;
            if *grass > 0.0 && !keep(at(i % NODES), at(i / NODES)) {
                *grass = 0.0;
            }
        }
    }

    /// Height of the ground, metres above the scene origin; clamped to the edge outside.
    pub fn ground_m(&self, x: f64, y: f64) -> f64 {
        bilinear(&self.ground_m, x, y)
    }

    /// Height of the grass above the ground, metres.
    pub fn grass_m(&self, x: f64, y: f64) -> f64 {
        bilinear(&self.grass_m, x, y)
    }

    /// Slope towards east and north, metres per metre, over a stride of a metre.
    pub fn gradient(&self, x: f64, y: f64) -> [f64; 2] {
        [self.ground_m(x + 0.5, y) - self.ground_m(x - 0.5, y), self.ground_m(x, y + 0.5) - self.ground_m(x, y - 0.5)]
    }

    /// The cell (column, row); both below the number of nodes less one.
    #[inline]
    pub(crate) fn patch(&self, column: usize, row: usize) -> Patch {
        let i = row * NODES + column;
        let corner = |i: usize| f64::from(self.ground_m[i]);
        let (h00, h10, h01, h11) = (corner(i), corner(i + 1), corner(i + NODES), corner(i + NODES + 1));
        let g = &self.grass_m;
        let grass_m = f64::from(g[i].max(g[i + 1]).max(g[i + NODES]).max(g[i + NODES + 1]));
        let top_m = h00.max(h10).max(h01).max(h11) + grass_m;
        Patch { a: h00, b: h10 - h00, c: h01 - h00, d: h11 - h10 - h01 + h00, grass_m, top_m }
    }
}

fn bilinear(nodes: &[f32], x: f64, y: f64) -> f64 {
    let place = |c: f64| ((c + HALF_EXTENT_M) / NODE_M).clamp(0.0, (NODES - 1) as f64 - 1e-9);
    let (fx, fy) = (place(x), place(y));
    let (i, j) = (fx as usize, fy as usize);
    let (u, v) = (fx - i as f64, fy - j as f64);
    let at = |i: usize, j: usize| f64::from(nodes[j * NODES + i]);
    (at(i, j) * (1.0 - u) + at(i + 1, j) * u) * (1.0 - v) + (at(i, j + 1) * (1.0 - u) + at(i + 1, j + 1) * u) * v
}

fn ground_height(spec: &TerrainSpec, seed: u64, x: f64, y: f64) -> f64 {
    let (sin, cos) = spec.uphill_rad.sin_cos();
    let rise = spec.slope * (x * cos + y * sin);
    let rolling = spec.rolling_m * (noise(seed, 1, x / 14.0, y / 14.0) + 0.4 * noise(seed, 2, x / 6.0, y / 6.0));
    let roughness = spec.roughness_m * noise(seed, 3, x / 1.3, y / 1.3);
    rise + rolling + roughness - spec.ditch.map_or(0.0, |d| d.depth_at_m(x, y))
}

fn grass_height(spec: &TerrainSpec, seed: u64, x: f64, y: f64) -> f64 {
    if spec.grass_cover <= 0.0 || spec.ditch.is_some_and(|d| d.depth_at_m(x, y) > 0.0) {
        return 0.0;
    }
    // Noise is roughly uniform in [-0.7, 0.7]; a cover of 1 puts the threshold below all of it.
    let patch = noise(seed, 4, x / 5.0, y / 5.0);
    if patch < 0.7 - 1.5 * spec.grass_cover {
        return 0.0;
    }
    spec.grass_m * (1.0 + 0.25 * noise(seed, 5, x / 0.9, y / 0.9))
}

/// Smooth value noise in [-1, 1]: random numbers at whole places, quintic blending between them.
fn noise(seed: u64, layer: u64, x: f64, y: f64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let node = |di: f64, dj: f64| {
        let bits = hash(&[seed, layer, (i + di) as i64 as u64, (j + dj) as i64 as u64]);
        2.0 * fraction(bits) - 1.0
    };
    let ease = |t: f64| t * t * t * (t * (6.0 * t - 15.0) + 10.0);
    let (u, v) = (ease(x - i), ease(y - j));
    let south = node(0.0, 0.0) * (1.0 - u) + node(1.0, 0.0) * u;
    let north = node(0.0, 1.0) * (1.0 - u) + node(1.0, 1.0) * u;
    south * (1.0 - v) + north * v
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec() -> TerrainSpec {
        TerrainSpec {
            slope: 0.1,
            uphill_rad: 0.0,
            rolling_m: 0.0,
            roughness_m: 0.0,
            grass_cover: 0.0,
            grass_m: 0.0,
            ditch: None,
        }
    }

    #[test]
    fn a_slope_of_one_in_ten_rises_one_metre_in_ten() {
        let terrain = Terrain::new(&spec(), 1);
        assert!((terrain.ground_m(10.1, 3.0) - terrain.ground_m(0.1, -3.0) - 1.0).abs() < 1e-5);
        assert!((terrain.gradient(2.0, 2.0)[0] - 0.1).abs() < 1e-5);
    }

    #[test]
    fn a_ditch_is_as_deep_as_said_in_its_middle_and_nothing_beside_it() {
        let ditch = Ditch { at_m: [0.0, 9.0], along_rad: 0.0, width_m: 1.5, depth_m: 0.9, half_length_m: 20.0 };
        let terrain = Terrain::new(&TerrainSpec { slope: 0.0, ditch: Some(ditch), ..spec() }, 1);
        assert!((terrain.ground_m(3.0, 9.0) + 0.9).abs() < 1e-6);
        assert!(terrain.ground_m(3.0, 8.0).abs() < 1e-6);
        assert!(terrain.ground_m(25.0, 9.0).abs() < 1e-6);
    }

    #[test]
    fn the_patch_is_the_bilinear_ground() {
        let terrain = Terrain::new(&TerrainSpec { rolling_m: 0.5, roughness_m: 0.1, ..spec() }, 3);
        let patch = terrain.patch(320, 321);
        let (x, y) = (320.0 * NODE_M - HALF_EXTENT_M + 0.1, 321.0 * NODE_M - HALF_EXTENT_M + 0.2);
        let (u, v) = (0.1 / NODE_M, 0.2 / NODE_M);
        let h = patch.a + patch.b * u + patch.c * v + patch.d * u * v;
        assert!((h - terrain.ground_m(x, y)).abs() < 1e-9);
    }
}
