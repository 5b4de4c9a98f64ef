//! Bends a level's surface to its tiles: certain ground pulls from both sides, anything else mainly from below.
//!
//! In: the coarser surface on the level's nodes, and the tiles. Out: the level's surface. What stands above loses
//! weight, what lies below keeps it (Kraus and Pfeifer 1998). Tiles that show no certain ground are ground's upper
//! bound; how far they stand above it, and how much that varies, is learned where certain tiles lie beside them.

use super::thin_plate::{Springs, relax};
use super::tiles::{Sight, Tiles};
use super::trend::Trend;
use super::{Foot, Heights, Level, SurfaceConfig};
use nalgebra::{Matrix3, Vector3};

/// One sigma of what a fine tile's ground is beside its feet's mean, metres.
const FINE_STD_M: f32 = 0.01;
/// Fewest tiles that say how far their kind stands above ground.
const COVER_TILES_MIN: usize = 6;
/// Least spread that is believed, metres.
const COVER_SPREAD_MIN_M: f32 = 0.03;
/// Height above its kind's at which a tile loses half its weight, in spreads.
const COVER_SPREADS: f32 = 2.0;
/// Height above the surface beyond which a certain tile is none, in units of where it loses half its weight.
const ABOVE_END: f32 = 3.0;
/// Passes of the first plane, and the height above it at which a foot loses half its weight there, metres.
const PLANE_PASSES: usize = 8;
const PLANE_ABOVE_M: f64 = 0.5;

/// How far tiles of one kind stand above the ground beside them: the middle one, and half of what most differ, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cover {
    above_m: f32,
    spread_m: f32,
}

/// Covers of lone and of weak tiles, where enough of them are beside certain ones.
type Covers = [Option<Cover>; 2];

/// What a tile does to the surface.
struct Pull {
    /// One over the variance, 1 / m^2.
    weight: f32,
    /// Height to which it pulls, below the tile's own, metres.
    below_m: f32,
}

/// Bends the surface to the tiles.
pub fn fit(surface: &mut Heights, tiles: &Tiles, config: &SurfaceConfig) {
    let ground_m: Vec<f32> = surface.height_m.iter().zip(&tiles.rise_m).map(|(z, rise_m)| z + rise_m).collect();
    raise_to_certain_ground(surface, tiles);
    let level = surface.level;
    let stiffness = 1.0 / (config.bend as f32 * level.node_m).powi(2);
    let half_m = config.above as f32 * level.node_m;
    let beside_m = if level.is_fine() { FINE_STD_M } else { 0.0 };
    let mut covers: Covers = [None; 2];
    let trend = Trend::holding(level, tiles, &ground_m, config);
    for pass in 0..config.passes {
        let (mut weight, mut height_m) = (Vec::with_capacity(level.len()), Vec::with_capacity(level.len()));
        for (node, (ground_m, surface_m)) in ground_m.iter().zip(&surface.height_m).enumerate() {
            let (above_m, std_m) = (ground_m - surface_m, tiles.std_m[node].hypot(beside_m));
            let pull = match tiles.sight[node] {
                Sight::Nothing => Pull { weight: 0.0, below_m: 0.0 },
                Sight::Strong if pass == 0 => Pull::of_ground(std_m, 0.0, half_m),
                Sight::Strong => Pull::of_ground(std_m, above_m, half_m),
                Sight::Lone => Pull::of_cover(std_m, above_m, covers[0], config),
                Sight::Weak => Pull::of_cover(std_m, above_m, covers[1], config),
            };
            let held = trend.as_ref().filter(|_| tiles.sight[node] != Sight::Strong);
            let (hold, trend_m) = held.map_or((0.0, 0.0), |trend| trend.spring(level, node, config));
            let pulled_m = pull.weight * (ground_m - pull.below_m) + hold * trend_m;
            weight.push(pull.weight + hold);
            height_m.push(pulled_m / (pull.weight + hold).max(f32::MIN_POSITIVE));
        }
        let springs = Springs { height_m: &height_m, weight: &weight };
        relax(&mut surface.height_m, level.nodes, &springs, stiffness, config.steps);
        covers = [Sight::Lone, Sight::Weak].map(|sight| cover_of(sight, surface, tiles, &ground_m));
    }
}

impl Pull {
    /// Certain ground loses its weight only where it stands above what its neighbours agree on: a log, a stump.
    fn of_ground(std_m: f32, above_m: f32, half_m: f32) -> Self {
        let share = match above_m / half_m {
            above if above <= 0.0 => 1.0,
            above if above > ABOVE_END => 0.0,
            above => 1.0 / (1.0 + above.powi(4)),
        };
        Self { weight: share / (std_m * std_m), below_m: 0.0 }
    }

    /// What may be cover pulls the surface down, as sure as one of its feet is, and up only as far as its kind is known.
    fn of_cover(std_m: f32, above_m: f32, cover: Option<Cover>, config: &SurfaceConfig) -> Self {
        let Some(Cover { above_m: cover_m, spread_m }) = cover.filter(|_| above_m >= 0.0) else {
            let std_m = std_m.hypot(config.cover_std_m as f32);
            let weight = if above_m < 0.0 { 1.0 / (std_m * std_m) } else { 0.0 };
            return Self { weight, below_m: 0.0 };
        };
        let doubt_m = config.distrust as f32 * (cover_m + spread_m).powi(2);
        let excess = ((above_m - cover_m) / (COVER_SPREADS * spread_m)).max(0.0);
        let weight = 1.0 / (1.0 + excess.powi(4)) / (std_m * std_m + doubt_m * doubt_m);
        Self { weight, below_m: cover_m }
    }
}

/// Lowest feet lie lower than the ground around them, by more in wide tiles: the coarser surface is raised by as much as
/// certain tiles rise above it, everywhere.
fn raise_to_certain_ground(surface: &mut Heights, tiles: &Tiles) {
    let certain = tiles.rise_m.iter().zip(&tiles.sight).filter(|(_, sight)| **sight == Sight::Strong);
    let mut rises: Vec<f32> = certain.map(|(rise_m, _)| *rise_m).collect();
    if rises.len() >= COVER_TILES_MIN {
        let raise_m = quantile(&mut rises, 0.5);
        surface.height_m.iter_mut().for_each(|z| *z += raise_m);
    }
}

/// How tiles of a kind stand above the surface beside at least two certain tiles.
fn cover_of(kind: Sight, surface: &Heights, tiles: &Tiles, ground_m: &[f32]) -> Option<Cover> {
    let nodes = surface.level.nodes;
    let is_beside_ground = |node: usize| nodes.around(node).filter(|&i| tiles.sight[i] == Sight::Strong).count() >= 2;
    let beside = (0..ground_m.len()).filter(|&node| tiles.sight[node] == kind && is_beside_ground(node));
    let mut above: Vec<f32> = beside.map(|node| ground_m[node] - surface.height_m[node]).collect();
    if above.len() < COVER_TILES_MIN {
        return None;
    }
    let [low, middle, high] = [0.1, 0.5, 0.84].map(|share| quantile(&mut above, share));
    Some(Cover { above_m: middle.max(0.0), spread_m: ((high - low) / 2.0).max(COVER_SPREAD_MIN_M) })
}

fn quantile(values: &mut [f32], share: f32) -> f32 {
    let at = ((values.len() - 1) as f32 * share) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}

/// The plane below the lowest foot of each tile: what the coarsest level starts from.
pub fn plane(feet: &[Foot], level: Level) -> Heights {
    let mut lowest: Vec<Option<&Foot>> = vec![None; level.len()];
    for foot in feet {
        let slot = &mut lowest[level.node_at(foot.at_m[0], foot.at_m[1])];
        if slot.is_none_or(|low| foot.at_m[2] < low.at_m[2]) {
            *slot = Some(foot);
        }
    }
    let lowest: Vec<(Vector3<f64>, f64)> = lowest
        .into_iter()
        .flatten()
        .map(|foot| foot.at_m.map(f64::from))
        .map(|[x, y, z]| (Vector3::new(1.0, x, y), z))
        .collect();
    let mut plane = Vector3::zeros();
    let mut share = vec![1.0; lowest.len()];
    for _ in 0..PLANE_PASSES {
        let (mut normal, mut right) = (Matrix3::identity() * 1e-6, Vector3::zeros());
        for ((place, z), share) in lowest.iter().zip(&share) {
            normal += place * place.transpose() * *share;
            right += place * (*share * *z);
        }
        plane = normal.try_inverse().unwrap_or_default() * right;
        for ((place, z), share) in lowest.iter().zip(&mut share) {
            let above_m = z - plane.dot(place);
            *share = if above_m < 0.0 { 1.0 } else { 1.0 / (1.0 + (above_m / PLANE_ABOVE_M).powi(2)) };
        }
    }
    let at = |[x, y]: [f32; 2]| plane.dot(&Vector3::new(1.0, f64::from(x), f64::from(y))) as f32;
    Heights { level, height_m: (0..level.len()).map(|node| at(level.place_of(node))).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_low_tile_of_cover_pulls_as_surely_as_its_feet_lie_low_and_a_high_one_of_an_unknown_kind_not_at_all() {
        let config = SurfaceConfig { cover_std_m: 0.02, ..SurfaceConfig::default() };
        let weight = |above_m: f32, config: &SurfaceConfig| Pull::of_cover(0.01, above_m, None, config).weight;
        // 1 / (0.01^2 + 0.02^2), and 1 / 0.01^2 without.
        assert!((weight(-0.05, &config) - 2000.0).abs() < 0.1);
        assert!((weight(-0.05, &SurfaceConfig::default()) - 10_000.0).abs() < 0.5);
        assert_eq!(weight(0.05, &config), 0.0);
    }
}
