//! One sigma of the surface: what its feet left open, and what ground may do between and beyond them.
//!
//! In: the finest level's heights, how surely each node's feet stand on ground, and one sigma of those. Out: one sigma a
//! node, metres. Away from certain ground it grows with the distance, by as much as the ground itself bends where it was
//! seen: the second difference of heights over a stated stride, in the root mean square. Where the surface is held by the
//! trend it grows no further than that allows. Calibrated on plots with truth.

use super::tiles::Sight;
use super::trend::Trend;
use super::{Heights, Level, SurfaceConfig};
use crate::distance::nearest;

/// Stride over which the ground's bending is measured, metres: wide enough that noise does not count.
const STRIDE_M: f32 = 1.2;
/// Bending that is assumed where too little was seen, and the least that is believed, metres per metre of stride.
const BENDING_M: f32 = 0.08;
const BENDING_MIN_M: f32 = 0.02;
/// Fewest second differences that say how ground bends.
const BENDINGS_MIN: usize = 50;
/// What a tile's own sigma is multiplied by, and what the plate lacks besides: ground that is rougher than its nodes, metres.
const OWN_SCALE: f32 = 1.2;
const ROUGH_M: f32 = 0.002;
/// Most that one sigma grows to where the trend holds, in deviations of certain ground from it.
const FAR_SHARE: f32 = 0.9;

/// One sigma of every node.
pub fn deviations(heights: &Heights, sight: &[Sight], own_std_m: &[f32], config: &SurfaceConfig) -> Vec<f32> {
    let is_certain = |node: usize| sight[node] == Sight::Strong;
    let Level { nodes, node_m } = heights.level;
    let (distance, source) = nearest((0..sight.len()).map(is_certain), nodes.width);
    let growth = config.growth as f32 * bending(heights, is_certain) * node_m;
    let trend = (config.trend_m > 0.0).then(|| Trend::of(heights.level, sight, &heights.height_m)).flatten();
    // Together with the trend, what grows tells more than alone.
    let held = |grown_m: f32| match &trend {
        Some(trend) => grown_m / (grown_m / (FAR_SHARE * trend.std_m)).hypot(1.0),
        None => grown_m,
    };
    let node = |(distance, source): (&f32, &u32)| {
        // A raster without any certain ground is infinitely far from it.
        let own_m = (OWN_SCALE * own_std_m[*source as usize]).hypot(ROUGH_M);
        own_m.hypot(held(growth * distance))
    };
    distance.iter().zip(&source).map(node).collect()
}

/// Root mean square of the second differences of certain ground over the stride, metres per metre.
fn bending(heights: &Heights, is_certain: impl Fn(usize) -> bool) -> f32 {
    let Level { nodes, node_m } = heights.level;
    let stride = ((STRIDE_M / node_m).round() as usize).max(1);
    let (mut sum, mut count) = (0.0f64, 0usize);
    let mut add = |[a, b, c]: [usize; 3]| {
        if is_certain(a) && is_certain(b) && is_certain(c) {
            let z = |i: usize| f64::from(heights.height_m[i]);
            sum += (z(a) - 2.0 * z(b) + z(c)).powi(2);
            count += 1;
        }
    };
    for row in 0..nodes.height {
        for column in 0..nodes.width {
            let at = row * nodes.width + column;
            if column >= 2 * stride {
                add([at - 2 * stride, at - stride, at]);
            }
            if row >= 2 * stride {
                add([at - 2 * stride * nodes.width, at - stride * nodes.width, at]);
            }
        }
    }
    if count < BENDINGS_MIN {
        return BENDING_M;
    }
    ((sum / count as f64).sqrt() as f32 / (stride as f32 * node_m)).max(BENDING_MIN_M)
}
