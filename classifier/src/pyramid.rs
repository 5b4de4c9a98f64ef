//! Ground surface voxels by the inverted pyramid test: occupied, and nothing known below within a pyramid.
//!
//! In: a [`View`]. Out: the set of ground voxels. The pyramid's tip is the candidate; `k` levels below it, it reaches
//! `(k - 1) / slope` columns out: the surface may lie anywhere in a voxel, so a neighbour one level down is still even
//! ground, and without that one level half of every slope would fail. The first levels below the tip may be left out: range noise
//! lets beams end, and pass, a little below a surface that lies low in its voxel. All candidates are tested at once: the set of voxels that have something known in their
//! pyramid is built by Horner's rule over the levels, each step one shift up and, where the pyramid widens, one
//! dilation by a column. It does not judge whether the surface is the ground; see [`crate::under_surface`].
//! Source: thesis, "Finding Ground Surface", figures 2-8 and 2-9.

use crate::column_bits::ColumnBits;
use crate::columns::View;
use crate::config::GroundConfig;

/// The voxels that pass the pyramid test.
pub fn ground_voxels(view: &View, config: &GroundConfig) -> ColumnBits {
    let mut known = view.occupied.clone();
    for (bits, free) in known.bits_mut().iter_mut().zip(view.free.bits()) {
        *bits |= free;
    }
    let depth = (config.pyramid_depth_m / view.shape.cell_m).round().max(1.0) as usize;
    let skip = (config.pyramid_start_m / view.shape.cell_m).round().max(0.0) as usize;
    let spoiled = above_something(&known, view.shape.width, skip + 1..depth + 1, config.pyramid_slope);
    let mut ground = view.occupied.clone();
    for (bits, spoiled) in ground.bits_mut().iter_mut().zip(spoiled.bits()) {
        *bits &= !spoiled;
    }
    ground
}

/// The voxels that have a voxel of `known` in the pyramid below them, at one of `depths` levels.
fn above_something(known: &ColumnBits, width: usize, depths: std::ops::Range<usize>, slope: f64) -> ColumnBits {
    let reach = |k: usize| (k.saturating_sub(1) as f64 / slope + 1e-9).floor() as usize;
    let mut found = ColumnBits::empty(known.columns(), known.words() * 64);
    for k in (1..depths.end).rev() {
        if depths.contains(&k) {
            for (bits, known) in found.bits_mut().iter_mut().zip(known.bits()) {
                *bits |= known;
            }
        }
        for _ in 0..reach(k) - reach(k - 1) {
            dilate(&mut found, width);
        }
        raise(&mut found);
    }
    found
}

/// Moves every voxel of the set up one level.
fn raise(bits: &mut ColumnBits) {
    let columns = bits.columns();
    for word in (0..bits.words()).rev() {
        let (below, from_here) = bits.bits_mut().split_at_mut(word * columns);
        let here = &mut from_here[..columns];
        here.iter_mut().for_each(|bits| *bits <<= 1);
        if word > 0 {
            for (here, below) in here.iter_mut().zip(&below[(word - 1) * columns..]) {
                *here |= below >> 63;
            }
        }
    }
}

/// Adds the eight neighbouring columns of every voxel of the set, level by level.
fn dilate(bits: &mut ColumnBits, width: usize) {
    let mut wide = vec![0; bits.columns()];
    for word in 0..bits.words() {
        let plane = bits.plane_mut(word);
        for (out, row) in wide.chunks_exact_mut(width).zip(plane.chunks_exact(width)) {
            out.copy_from_slice(row);
            for (out, left) in out[1..].iter_mut().zip(row) {
                *out |= left;
            }
            for (out, right) in out.iter_mut().zip(&row[1..]) {
                *out |= right;
            }
        }
        plane.copy_from_slice(&wide);
        let end = plane.len();
        for (out, below) in plane[width..].iter_mut().zip(&wide) {
            *out |= below;
        }
        for (out, above) in plane[..end - width].iter_mut().zip(&wide[width..]) {
            *out |= above;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Window;
    use tsense_geometry::VoxelGrid;

    fn view(size: [usize; 3]) -> View {
        View::unknown(Window { first: [0; 3], size }, VoxelGrid::new(0.15).unwrap())
    }

    fn config(start_m: f64, depth_m: f64, slope: f64) -> GroundConfig {
        GroundConfig {
            pyramid_start_m: start_m,
            pyramid_depth_m: depth_m,
            pyramid_slope: slope,
            ..GroundConfig::default()
        }
    }

    /// The plain version: every voxel of every pyramid.
    fn passes(view: &View, [x, y, z]: [i32; 3], depths: std::ops::RangeInclusive<i32>, slope: f64) -> bool {
        let (width, height) = (view.shape.width as i32, view.shape.height as i32);
        let known = |x: i32, y: i32, z: i32| {
            let inside = x >= 0 && y >= 0 && z >= 0 && x < width && y < height;
            let column = (y * width + x) as usize;
            inside && (view.occupied.contains(column, z as usize) || view.free.contains(column, z as usize))
        };
        if !view.occupied.contains((y * width + x) as usize, z as usize) {
            return false;
        }
        depths.clone().all(|k| {
            let reach = (f64::from(k - 1) / slope + 1e-9).floor() as i32;
            (-reach..=reach).all(|dy| (-reach..=reach).all(|dx| !known(x + dx, y + dy, z - k)))
        })
    }

    #[test]
    fn the_fast_test_equals_the_plain_one() {
        let (mut seed, mut compared, mut ground) = (7u64, 0, 0);
        for (skip, depth, slope) in [(0, 1, 1.0), (0, 4, 1.0), (0, 5, 0.5), (1, 7, 1.7), (2, 12, 0.8)] {
            let mut view = view([24, 20, 80]);
            for _ in 0..260 {
                seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let (column, level) = ((seed >> 33) as usize % 480, (seed >> 20) as usize % 80);
                if seed >> 63 == 0 { view.occupied.insert(column, level) } else { view.free.insert(column, level) }
            }
            let fast = ground_voxels(&view, &config(f64::from(skip) * 0.15, f64::from(depth) * 0.15, slope));
            for (x, y, z) in (0..24).flat_map(|x| (0..20).flat_map(move |y| (0..80).map(move |z| (x, y, z)))) {
                let plain = passes(&view, [x, y, z], skip + 1..=depth, slope);
                assert_eq!(fast.contains((y * 24 + x) as usize, z as usize), plain, "{x} {y} {z} depth {depth}");
                (compared, ground) = (compared + 1, ground + usize::from(plain));
            }
        }
        assert!(compared == 192_000 && ground > 50, "{compared} compared, {ground} ground");
    }

    #[test]
    fn a_slope_below_the_pyramids_passes_and_a_shrub_over_free_space_does_not() {
        let mut view = view([20, 20, 80]);
        for column in 0..400 {
            view.occupied.insert(column, 20 + (column % 20) / 2);
        }
        view.occupied.insert(210, 35);
        view.free.insert(210, 34);
        let ground = ground_voxels(&view, &config(0.0, 1.5, 1.0));
        assert!((0..400).all(|column| ground.contains(column, 20 + (column % 20) / 2)));
        assert!(!ground.contains(210, 35));
    }
}
