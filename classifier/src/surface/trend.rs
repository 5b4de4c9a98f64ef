//! What ground does where it was not seen: it returns to the plane of the ground that was.
//!
//! In: a level's tiles and the ground that they show. Out: a [`Trend`]: the plane through certain tiles, how far those stray
//! from it, and the spring with which it holds a node that shows no certain ground. A thin plate alone continues every slope
//! at its rim for ever. Ground strays from the plane as one over `trend_m`, so a node stands for as much of that as its tile
//! covers. Metres.

use super::tiles::{Sight, Tiles};
use super::{Level, SurfaceConfig};
use nalgebra::{Matrix3, Vector3};

/// Fewest certain tiles that say what the trend is.
const TILES_MIN: usize = 12;
/// Least deviation that is believed, metres.
const STD_MIN_M: f32 = 0.05;

/// The plane of certain ground.
#[derive(Clone, Copy, Debug)]
pub struct Trend {
    plane: Vector3<f64>,
    /// One sigma of certain ground around it, metres.
    pub std_m: f32,
}

impl Trend {
    /// The trend of a level's certain tiles; nothing where they are few.
    pub fn of(level: Level, sight: &[Sight], ground_m: &[f32]) -> Option<Self> {
        let certain = || (0..sight.len()).filter(|node| sight[*node] == Sight::Strong);
        let count = certain().count();
        if count < TILES_MIN {
            return None;
        }
        let (mut normal, mut right) = (Matrix3::identity() * 1e-6, Vector3::zeros());
        for node in certain() {
            let at = place(level, node);
            normal += at * at.transpose();
            right += at * f64::from(ground_m[node]);
        }
        let plane = normal.try_inverse()? * right;
        let off_m = |node: usize| f64::from(ground_m[node]) - plane.dot(&place(level, node));
        let square = certain().map(|node| off_m(node).powi(2)).sum::<f64>() / count as f64;
        Some(Self { plane, std_m: (square.sqrt() as f32).max(STD_MIN_M) })
    }

    /// The trend that holds a level: fine tiles are held by the coarser surface already.
    pub fn holding(level: Level, tiles: &Tiles, ground_m: &[f32], config: &SurfaceConfig) -> Option<Self> {
        (config.trend_m > 0.0 && !level.is_fine()).then(|| Self::of(level, &tiles.sight, ground_m)).flatten()
    }

    /// Weight of its spring at a node, 1 / m^2, and the height that it pulls to.
    pub fn spring(&self, level: Level, node: usize, config: &SurfaceConfig) -> (f32, f32) {
        let share = (level.node_m / config.trend_m as f32).powi(2);
        (share / (self.std_m * self.std_m), self.plane.dot(&place(level, node)) as f32)
    }
}

fn place(level: Level, node: usize) -> Vector3<f64> {
    let [x, y] = level.place_of(node);
    Vector3::new(1.0, f64::from(x), f64::from(y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::thin_plate::Nodes;

    #[test]
    fn the_trend_is_the_plane_of_certain_tiles_and_holds_the_others_by_how_far_those_stray() {
        let level = Level { nodes: Nodes { width: 6, height: 6 }, node_m: 1.2 };
        let plane = |node: usize| 2.0 + 0.3 * place(level, node)[1] as f32;
        let sight: Vec<Sight> = (0..36).map(|i| if i < 24 { Sight::Strong } else { Sight::Lone }).collect();
        // Certain tiles stray by a decimetre, to and fro; the others stand a metre above.
        let stray = |i: usize| if (i % 6 + i / 6).is_multiple_of(2) { 0.1 } else { -0.1 };
        let ground_m: Vec<f32> = (0..36).map(|i| plane(i) + if i < 24 { stray(i) } else { 1.0 }).collect();
        let trend = Trend::of(level, &sight, &ground_m).unwrap();
        assert!((trend.std_m - 0.1).abs() < 0.01, "{trend:?}");
        let config = SurfaceConfig { trend_m: 2.4, ..SurfaceConfig::default() };
        let (weight, height_m) = trend.spring(level, 35, &config);
        assert!((weight - 0.25 / trend.std_m.powi(2)).abs() < 1e-3 && (height_m - plane(35)).abs() < 0.1, "{height_m}");
        assert!(Trend::of(level, &sight[13..], &ground_m[13..]).is_none(), "eleven tiles are too few");
    }
}
