//! What the feet of each tile say of the ground: how high it is, and how surely they stand on it.
//!
//! In: feet and the surface of the coarser level. Out: per tile a height, one sigma and a [`Sight`]. Ground shows as an
//! onset: many feet at one lowest height above the expected surface, while the lowest blades of grass and the lowest
//! leaves of a bush are all at different heights. A tile of 1.2 m with eight feet in the lowest 6 cm stood on ground in
//! every tall-grass plot tried, one with fewer stood on it in every second.

use super::{Foot, Heights, Level, SurfaceConfig};

/// How surely a tile's feet stand on ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// Nothing was seen there.
    Nothing,
    /// Something was, which may be anything above ground.
    Lone,
    /// A few feet at one height.
    Weak,
    /// Ground.
    Strong,
}

/// The tiles of a level.
pub struct Tiles {
    /// Height of the ground above the coarser surface as the feet say, metres.
    pub rise_m: Vec<f32>,
    /// One sigma of it, if the feet stand on ground, metres.
    pub std_m: Vec<f32>,
    /// How surely they do.
    pub sight: Vec<Sight>,
}

/// Where a level showed ground.
pub struct Proof {
    /// Its tiles.
    pub level: Level,
    /// How surely each one did.
    pub sight: Vec<Sight>,
}

impl Level {
    /// Whether its tiles must stay near the coarser surface.
    pub fn is_fine(&self) -> bool {
        self.node_m <= FREE_M
    }
}

impl Proof {
    /// What the tiles of a level prove to finer ones; nothing where it is fine itself.
    pub fn of(level: Level, tiles: &Tiles) -> Option<Self> {
        (!level.is_fine()).then(|| Self { level, sight: tiles.sight.clone() })
    }
}

/// Tiles at least this wide are judged by their lowest foot: the coarser surface is too rough for an onset, metres.
const ROUGH_M: f32 = 2.0;
/// Tiles at least this wide may rise as they like above the coarser surface, metres; finer ones must stay near it.
const FREE_M: f32 = 1.0;
/// One sigma of the lowest foot of a rough tile and of the onset of a free one as heights of the tile, metres.
const ROUGH_STD_M: f32 = 0.1;
const FREE_STD_M: f32 = 0.03;
/// How far ground may rise above the coarser surface in a fine tile: at least, and a share of the tile, metres.
const GATE_M: f32 = 0.06;
const GATE_PER_M: f32 = 0.1;

impl Tiles {
    /// Judges the feet against the coarser surface. Fine tiles are certain only within certain ones of a free level.
    pub fn of(feet: &[Foot], coarse: &Heights, free: Option<&Proof>, config: &SurfaceConfig) -> Self {
        let level = coarse.level;
        let rises: Vec<(usize, f32)> = feet.iter().map(|foot| rise_of(foot, coarse)).collect();
        let mut lowest = vec![f32::INFINITY; level.len()];
        rises.iter().for_each(|&(node, rise_m)| lowest[node] = lowest[node].min(rise_m));
        let mut onsets = vec![Onset::default(); level.len()];
        let gate_m = if !level.is_fine() { f32::INFINITY } else { GATE_M.max(GATE_PER_M * level.node_m) };
        for (&(node, rise_m), foot) in rises.iter().zip(feet) {
            let (onset_m, doubt_m) = (lowest[node] + config.onset_m as f32, 2.0 * foot.std_m);
            if rise_m <= onset_m + doubt_m && rise_m < gate_m + doubt_m {
                let counts = rise_m <= onset_m;
                onsets[node].add(rise_m, foot.std_m, counts);
                // Fine tiles are certain only where a wider one is.
                onsets[node].reaching += usize::from(counts && (level.is_fine() || reaches(foot, coarse, config)));
            }
        }
        let mut tiles = Self { rise_m: Vec::new(), std_m: Vec::new(), sight: Vec::new() };
        for (onset, lowest_m) in onsets.iter().zip(&lowest) {
            tiles.push(onset, *lowest_m, level, config);
        }
        if let Some(free) = free {
            tiles.doubt_outside(level, free);
        }
        tiles
    }

    fn doubt_outside(&mut self, level: Level, free: &Proof) {
        for (node, sight) in self.sight.iter_mut().enumerate().filter(|(_, sight)| **sight == Sight::Strong) {
            let [x, y] = level.place_of(node);
            if free.sight[free.level.node_at(x, y)] != Sight::Strong {
                *sight = Sight::Lone;
            }
        }
    }

    fn push(&mut self, onset: &Onset, lowest_m: f32, level: Level, config: &SurfaceConfig) {
        let is_rough = level.node_m > ROUGH_M;
        let (rise_m, std_m) = match onset.weight > 0.0 {
            false => (0.0, 0.0),
            true if is_rough => (lowest_m, ROUGH_STD_M),
            true if !level.is_fine() => (onset.mean_m(), FREE_STD_M),
            true => (onset.mean_m(), (1.0 / onset.weight).sqrt()),
        };
        self.rise_m.push(rise_m);
        self.std_m.push(std_m);
        self.sight.push(onset.sight(level, config));
    }
}

/// Tile and height above the coarser surface of a foot.
fn rise_of(foot: &Foot, coarse: &Heights) -> (usize, f32) {
    let [x, y, z] = foot.at_m;
    (coarse.level.node_at(x, y), z - coarse.at(x, y))
}

/// Whether beams came to a foot steeply enough, against the surface there, to reach the ground through what grows on it.
fn reaches(foot: &Foot, surface: &Heights, config: &SurfaceConfig) -> bool {
    let ([x, y, _], half_m) = (foot.at_m, 0.5 * surface.level.node_m);
    let east = (surface.at(x + half_m, y) - surface.at(x - half_m, y)) / surface.level.node_m;
    let north = (surface.at(x, y + half_m) - surface.at(x, y - half_m)) / surface.level.node_m;
    let facing = foot.towards[2] - east * foot.towards[0] - north * foot.towards[1];
    facing >= config.facing_min as f32 * (1.0 + east * east + north * north).sqrt()
}

/// The feet at and just above the lowest one of a tile.
#[derive(Clone, Copy, Debug, Default)]
struct Onset {
    feet: usize,
    /// Those of them at which beams reach the ground through what grows on it.
    reaching: usize,
    weight: f32,
    sum: f32,
}

impl Onset {
    fn add(&mut self, rise_m: f32, std_m: f32, counts: bool) {
        let weight = 1.0 / (std_m * std_m);
        self.feet += usize::from(counts);
        self.weight += weight;
        self.sum += weight * rise_m;
    }

    fn mean_m(&self) -> f32 {
        self.sum / self.weight
    }

    /// Fine tiles have fewer columns, and lie near a surface that coarser ones made sure of.
    fn sight(&self, level: Level, config: &SurfaceConfig) -> Sight {
        let columns_share = (level.node_m / FREE_M).min(1.0);
        let strong = match level.is_fine() {
            false => config.onset_strong,
            true => ((config.onset_strong as f32 * columns_share * 0.8).round() as usize).max(2),
        };
        match self.feet {
            _ if self.weight == 0.0 => Sight::Nothing,
            _ if self.reaching >= strong => Sight::Strong,
            feet if feet >= config.onset_weak && !level.is_fine() => Sight::Weak,
            _ => Sight::Lone,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::UP;
    use crate::surface::thin_plate::Nodes;

    /// Two tiles of 1.2 m side by side, 8 x 8 columns each, over a level surface at 1 m.
    fn sights(height_m: impl Fn(usize) -> f32) -> Tiles {
        let level = Level { nodes: Nodes { width: 2, height: 1 }, node_m: 1.2 };
        let coarse = Heights { level, height_m: vec![1.0; 2] };
        let foot = |i: usize| {
            let (x, y) = (0.15 * (i % 16) as f32 + 0.075, 0.15 * (i / 16) as f32 + 0.075);
            Foot { at_m: [x, y, height_m(i)], std_m: 0.01, towards: UP }
        };
        let feet: Vec<Foot> = (0..128).map(foot).filter(|foot| foot.at_m[2].is_finite()).collect();
        Tiles::of(&feet, &coarse, None, &SurfaceConfig::default())
    }

    #[test]
    fn ten_feet_at_one_height_are_ground_and_as_many_in_grass_are_not() {
        // West: every seventh foot on ground at 1.05 m, grass above. East: grass only, from 1.3 m up.
        let tiles = sights(|i| match i % 16 < 8 {
            true if i % 7 == 0 => 1.05,
            true => 1.2 + 0.01 * (i / 16) as f32,
            false => 1.3 + 0.02 * ((i * 37) % 61) as f32,
        });
        assert_eq!(tiles.sight, [Sight::Strong, Sight::Lone]);
        assert!((tiles.rise_m[0] - 0.05).abs() < 1e-3 && tiles.rise_m[1] >= 0.3, "{:?}", tiles.rise_m);
    }

    #[test]
    fn beams_that_graze_prove_no_ground_unless_it_rises_towards_them() {
        let level = Level { nodes: Nodes { width: 2, height: 1 }, node_m: 1.2 };
        let foot = |i: usize, rise: f32| {
            let (x, y) = (0.15 * (i % 16) as f32 + 0.075, 0.15 * (i / 16) as f32 + 0.075);
            // The ladar stands to the west, at a sine of 0.08.
            Foot { at_m: [x, y, 1.0 + rise * x], std_m: 0.01, towards: [-0.997, 0.0, 0.08] }
        };
        let sights = |rise: f32| {
            let feet: Vec<Foot> = (0..128).map(|i| foot(i, rise)).collect();
            let coarse = Heights { level, height_m: vec![1.0 + 0.6 * rise, 1.0 + 1.8 * rise] };
            Tiles::of(&feet, &coarse, None, &SurfaceConfig::default()).sight
        };
        assert_eq!([0.0, 0.1, -0.1].map(sights), [[Sight::Weak; 2], [Sight::Strong; 2], [Sight::Weak; 2]]);
        let survey = SurfaceConfig::for_survey();
        let feet: Vec<Foot> = (0..128).map(|i| foot(i, 0.0)).collect();
        let flat = Heights { level, height_m: vec![1.0; 2] };
        assert_eq!(Tiles::of(&feet, &flat, None, &survey).sight, [Sight::Strong; 2], "a survey asks for no angle");
    }

    #[test]
    fn a_tile_without_a_foot_says_nothing() {
        let tiles = sights(|i| if i % 16 < 8 { 1.0 } else { f32::NAN });
        assert_eq!(tiles.sight, [Sight::Strong, Sight::Nothing]);
        assert_eq!((tiles.rise_m[1], tiles.std_m[1]), (0.0, 0.0));
    }
}
