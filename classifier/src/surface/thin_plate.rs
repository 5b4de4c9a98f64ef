//! The smoothest surface through weighted heights: a bent plate on springs, solved on a grid of nodes.
//!
//! In: per node a height and a weight (one over its variance, 0 where nothing is known), and how stiff the plate is.
//! Out: the heights z that make `sum w (z - h)^2 + stiffness * sum (z_xx^2 + 2 z_xy^2 + z_yy^2)` least, with second
//! differences between neighbouring nodes. The plate's edges are free. It is the Gauss-Markov estimate for ground whose
//! second differences are independent, with variance `1 / stiffness`. Conjugate gradients from a start that is near
//! (the coarser level's surface), with the diagonal as preconditioner. Source: Terzopoulos 1988 (discrete thin plate).

/// Residual, as a share of the first one, at which the solver stops.
const ENOUGH: f64 = 1e-3;

/// A grid of nodes, row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Nodes {
    /// Nodes along east.
    pub width: usize,
    /// Nodes along north.
    pub height: usize,
}

impl Nodes {
    /// The up to eight nodes around one.
    pub fn around(self, node: usize) -> impl Iterator<Item = usize> {
        let (x, y) = (node % self.width, node / self.width);
        let rows = y.saturating_sub(1)..(y + 2).min(self.height);
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        rows.flat_map(move |y| columns.clone().map(move |x| y * self.width + x)).filter(move |&other| other != node)
    }
}

/// Heights and their weights, node by node.
pub struct Springs<'a> {
    /// Heights; of no meaning where the weight is 0.
    pub height_m: &'a [f32],
    /// One over the variance, 1 / m^2; 0 where nothing is known.
    pub weight: &'a [f32],
}

/// Bends `surface` towards the springs; at most `steps` steps.
pub fn relax(surface: &mut [f32], nodes: Nodes, springs: &Springs, stiffness: f32, steps: usize) {
    let plate = Plate { nodes, weight: springs.weight, stiffness };
    let n = surface.len();
    let scale = plate.diagonal();
    // r = W h - A z
    let mut r = vec![0.0f32; n];
    plate.apply(surface, &mut r);
    for (r, (w, h)) in r.iter_mut().zip(springs.weight.iter().zip(springs.height_m)) {
        *r = w * h - *r;
    }
    let mut preconditioned: Vec<f32> = r.iter().zip(&scale).map(|(r, d)| r / d).collect();
    let mut along = preconditioned.clone();
    let mut pushed = vec![0.0f32; n];
    let mut left = dot(&r, &preconditioned);
    let enough = left * ENOUGH * ENOUGH;
    for _ in 0..steps {
        if left <= enough || left <= f64::MIN_POSITIVE {
            return;
        }
        plate.apply(&along, &mut pushed);
        let step = (left / dot(&along, &pushed)) as f32;
        for i in 0..n {
            surface[i] += step * along[i];
            r[i] -= step * pushed[i];
            preconditioned[i] = r[i] / scale[i];
        }
        let next = dot(&r, &preconditioned);
        let keep = (next / left) as f32;
        left = next;
        for i in 0..n {
            along[i] = preconditioned[i] + keep * along[i];
        }
    }
}

struct Plate<'a> {
    nodes: Nodes,
    weight: &'a [f32],
    stiffness: f32,
}

impl Plate<'_> {
    /// `out = (W + stiffness * bending) z`.
    fn apply(&self, z: &[f32], out: &mut [f32]) {
        let (k, width) = (self.stiffness, self.nodes.width);
        for ((out, z), w) in out.iter_mut().zip(z).zip(self.weight) {
            *out = w * z;
        }
        let rows = || z.chunks_exact(width);
        // Second differences along a row, those of its ends being none; each acts on three nodes.
        let mut bends = vec![0.0f32; width + 2];
        for (z, out) in rows().zip(out.chunks_exact_mut(width)) {
            for (d, z) in bends[2..width].iter_mut().zip(z.windows(3)) {
                *d = k * (z[0] - 2.0 * z[1] + z[2]);
            }
            for (out, d) in out.iter_mut().zip(bends.windows(3)) {
                *out += d[0] - 2.0 * d[1] + d[2];
            }
        }
        for (row, ((a, b), c)) in rows().zip(rows().skip(1)).zip(rows().skip(2)).enumerate() {
            let (out_a, rest) = out[row * width..(row + 3) * width].split_at_mut(width);
            let (out_b, out_c) = rest.split_at_mut(width);
            for i in 0..width {
                let d = k * (a[i] - 2.0 * b[i] + c[i]);
                out_a[i] += d;
                out_b[i] -= 2.0 * d;
                out_c[i] += d;
            }
        }
        // Twists between two rows; each acts on four nodes.
        let mut twists = vec![0.0f32; width + 1];
        for (row, (a, b)) in rows().zip(rows().skip(1)).enumerate() {
            for (d, (a, b)) in twists[1..width].iter_mut().zip(a.windows(2).zip(b.windows(2))) {
                *d = 2.0 * k * (a[0] - a[1] - b[0] + b[1]);
            }
            let (out_a, out_b) = out[row * width..(row + 2) * width].split_at_mut(width);
            for ((out_a, out_b), d) in out_a.iter_mut().zip(out_b).zip(twists.windows(2)) {
                *out_a += d[1] - d[0];
                *out_b += d[0] - d[1];
            }
        }
    }

    /// The diagonal of the matrix; a floor keeps lone nodes without any neighbour solvable.
    fn diagonal(&self) -> Vec<f32> {
        let Nodes { width, height } = self.nodes;
        let bends = |i: usize, n: usize| {
            let ends = usize::from(i >= 2) + usize::from(i + 2 < n);
            let middle = usize::from(i >= 1 && i + 1 < n);
            (ends + 4 * middle) as f32
        };
        let twists = |i: usize, n: usize| (usize::from(i >= 1) + usize::from(i + 1 < n)) as f32;
        let node = |(i, w): (usize, &f32)| {
            let (x, y) = (i % width, i / width);
            let bent = bends(x, width) + bends(y, height) + 2.0 * twists(x, width) * twists(y, height);
            (w + self.stiffness * bent).max(1e-6)
        };
        self.weight.iter().enumerate().map(node).collect()
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    // Eight sums side by side: the order is fixed, and it runs in parallel lanes.
    let mut sums = [0.0f32; 8];
    let mut total = 0.0f64;
    for (a, b) in a.chunks(512).zip(b.chunks(512)) {
        for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
            for lane in 0..8 {
                sums[lane] += a[lane] * b[lane];
            }
        }
        let tail = a.len() / 8 * 8;
        total += a[tail..].iter().zip(&b[tail..]).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        total += sums.iter().map(|s| f64::from(*s)).sum::<f64>();
        sums = [0.0; 8];
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plate_on_three_corners_is_the_plane_through_them() {
        let nodes = Nodes { width: 7, height: 5 };
        let plane = |i: usize| 2.0 + 0.3 * (i % 7) as f32 - 0.1 * (i / 7) as f32;
        let mut weight = vec![0.0; 35];
        for corner in [0, 6, 28] {
            weight[corner] = 1e4;
        }
        let height_m: Vec<f32> = (0..35).map(plane).collect();
        let mut surface = vec![0.0; 35];
        relax(&mut surface, nodes, &Springs { height_m: &height_m, weight: &weight }, 100.0, 2000);
        for (i, z) in surface.iter().enumerate() {
            assert!((z - plane(i)).abs() < 0.01, "node {i}: {z} instead of {}", plane(i));
        }
    }

    #[test]
    fn a_soft_plate_follows_a_bump_that_a_stiff_one_smooths_away() {
        let nodes = Nodes { width: 9, height: 9 };
        let mut height_m = vec![0.0; 81];
        height_m[40] = 1.0;
        let weight = vec![1.0; 81];
        let at_bump = |stiffness| {
            let mut surface = vec![0.0; 81];
            relax(&mut surface, nodes, &Springs { height_m: &height_m, weight: &weight }, stiffness, 200);
            surface[40]
        };
        assert!(at_bump(1e-4) > 0.95 && at_bump(100.0) < 0.1, "{} {}", at_bump(1e-4), at_bump(100.0));
    }

    /// The plain version of the matrix: the energy's second derivative, by differences.
    #[test]
    fn the_diagonal_is_that_of_the_matrix() {
        let nodes = Nodes { width: 5, height: 4 };
        let weight: Vec<f32> = (0..20).map(|i| (i % 3) as f32).collect();
        let plate = Plate { nodes, weight: &weight, stiffness: 0.5 };
        for (i, diagonal) in plate.diagonal().into_iter().enumerate() {
            let (mut unit, mut column) = (vec![0.0; 20], vec![0.0; 20]);
            unit[i] = 1.0;
            plate.apply(&unit, &mut column);
            assert!((column[i] - diagonal).abs() < 1e-5, "node {i}: {} and {diagonal}", column[i]);
        }
    }

    #[test]
    fn a_corner_has_three_nodes_around_it_and_the_middle_eight() {
        let nodes = Nodes { width: 3, height: 3 };
        assert_eq!(nodes.around(0).collect::<Vec<_>>(), [1, 3, 4]);
        assert_eq!(nodes.around(4).count(), 8);
    }
}
