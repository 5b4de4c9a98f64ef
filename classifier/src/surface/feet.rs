//! Feet: the lowest thing seen in each column, finer than a voxel where the returns were kept.
//!
//! In: the returns of the columns, or heights of ground voxels. Out: one foot a column at most, metres from the
//! raster's south-west corner and above the view's base, each with one sigma of its height. A beam of divergence b at
//! range r is b r wide; where it meets ground at a grazing angle g its spot is b r / sin g long. Up to the depth within
//! which echoes melt the range is that of the spot's middle; a longer spot answers from its near part, somewhere within
//! half a beam's width. It does not judge whether a foot is ground.

use super::SurfaceConfig;
use crate::returns::{ColumnReturn, ReturnColumns};
use tsense_geometry::Raster;

/// The lowest thing seen in a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// Where it is: east, north, up, metres.
    pub at_m: [f32; 3],
    /// One sigma of its height, metres.
    pub std_m: f32,
    /// Unit vector towards the ladar that saw it from highest up; upwards where that is not known.
    pub towards: [f32; 3],
}

/// Where a ladar is taken to be that nobody knows of.
pub const UP: [f32; 3] = [0.0, 0.0, 1.0];
/// Least one sigma of a foot, metres: grass blades, mirrors and mounts are no better.
const STD_MIN_M: f32 = 0.006;
/// Least sine of a grazing angle: flatter beams do not come back from ground.
const GRAZING_MIN: f32 = 0.02;
/// Returns of a column that count as independent: what they share (pose, mount) does not average out.
const INDEPENDENT_MAX: f32 = 4.0;

/// The feet of all columns from their returns.
pub fn feet_of_returns(returns: &ReturnColumns, columns: usize, config: &SurfaceConfig) -> Vec<Foot> {
    (0..columns).filter_map(|column| foot_of(returns.column(column), config)).collect()
}

/// The feet of columns from the heights of their ground voxels: known to within a voxel.
pub fn feet_of_heights(heights: &Raster<f32>) -> Vec<Foot> {
    let shape = heights.shape();
    let std_m = (shape.cell_m / 12f64.sqrt()) as f32;
    let center = |i: usize| ((i as f64 + 0.5) * shape.cell_m) as f32;
    let foot = |(i, z): (usize, &f32)| Foot {
        at_m: [center(i % shape.width), center(i / shape.width), *z],
        std_m,
        towards: UP,
    };
    heights.cells().iter().enumerate().filter(|(_, z)| z.is_finite()).map(foot).collect()
}

/// The weighted mean of the returns that the lowest one's uncertainty does not tell from it.
fn foot_of(returns: &[ColumnReturn], config: &SurfaceConfig) -> Option<Foot> {
    let lowest = returns.iter().min_by(|a, b| a.at_m[2].total_cmp(&b.at_m[2]))?;
    let top_m = lowest.at_m[2] + 2.0 * height_std_m(lowest, config) + 0.01;
    let (mut weight, mut count, mut sum, mut towards) = (0.0, 0.0f32, [0.0; 3], [0.0, 0.0, -1.0]);
    for item in returns.iter().filter(|item| item.at_m[2] <= top_m) {
        let w = 1.0 / height_std_m(item, config).powi(2);
        (weight, count) = (weight + w, count + 1.0);
        (0..3).for_each(|axis| sum[axis] += w * item.at_m[axis]);
        let other = direction(item);
        towards = if other[2] > towards[2] { other } else { towards };
    }
    let shared = count / count.min(INDEPENDENT_MAX);
    Some(Foot { at_m: sum.map(|s| s / weight), std_m: (shared / weight).sqrt(), towards })
}

/// Unit vector from a return towards its ladar.
fn direction(item: &ColumnReturn) -> [f32; 3] {
    let range_m = item.range_m().max(0.01);
    std::array::from_fn(|axis| (item.from_m[axis] - item.at_m[axis]) / range_m)
}

/// One sigma of the height of ground that a beam met.
fn height_std_m(item: &ColumnReturn, config: &SurfaceConfig) -> f32 {
    let range_m = item.range_m().max(0.01);
    let grazing = ((item.from_m[2] - item.at_m[2]) / range_m).clamp(GRAZING_MIN, 1.0);
    let half_width_m = 0.5 * config.beam_rad as f32 * range_m;
    let melted = config.echo_depth_m as f32 * grazing / (2.0 * half_width_m).max(1e-6);
    let spot_m = 0.5 * half_width_m * (1.0 - melted).max(0.0);
    let range_m = config.range_std_m as f32 * grazing;
    (range_m * range_m + STD_MIN_M * STD_MIN_M + spot_m * spot_m).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn back(z: f32, range_m: f32, height_m: f32) -> ColumnReturn {
        let flat_m = (range_m.powi(2) - height_m.powi(2)).sqrt();
        ColumnReturn { at_m: [1.0, 2.0, z], from_m: [1.0 + flat_m, 2.0, z + height_m] }
    }

    #[test]
    fn a_foot_is_the_mean_of_what_cannot_be_told_from_the_lowest_return() {
        let config = SurfaceConfig::default();
        let foot = foot_of(&[back(0.5, 3.0, 1.6), back(0.51, 3.0, 1.6), back(0.9, 3.0, 1.6)], &config).unwrap();
        assert!((foot.at_m[2] - 0.505).abs() < 1e-4, "{foot:?}");
        assert_eq!(foot_of(&[], &config), None);
    }

    #[test]
    fn a_grazing_beam_far_away_knows_its_height_to_half_its_width_only() {
        let config = SurfaceConfig::default();
        // 3 m away, sine 0.53: the spot is 0.084 m long and melts. sigma = 12 mm x 0.53 and 6 mm.
        let near = height_std_m(&back(0.0, 3.0, 1.6), &config);
        assert!((near - (0.0064f32).hypot(0.006)).abs() < 1e-4, "{near}");
        // 20 m away, sine 0.08: half a width of 0.15 m; 0.6 x 0.08 / 0.3 = 0.16 of the spot melts.
        let far = height_std_m(&back(0.0, 20.0, 1.6), &config);
        assert!((far - 0.063).abs() < 0.001, "{far}");
    }
}
