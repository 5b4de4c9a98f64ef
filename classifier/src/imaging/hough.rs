//! Planes by the Hough transform. Thesis (2-17): rho = u(theta, phi) . p.
//!
//! In: points, metres, relative to an origin near them (not UTM: rho would then turn on the last digit of an angle),
//! and the width of a bin of rho. Out: the strongest planes first. theta, the direction of the normal's projection, has
//! 40 bins in [0, 2 pi); phi, the normal's angle from the z axis, has 20 in [0, pi/2); an angle is its bin's lower end.
//! At phi = 0 all thetas are one plane, so only the first votes there. A plane that is the neighbour of a stronger one
//! in all three bins is left out. A large plane still fills many bins around its own; [`planes_in_turn`] therefore takes
//! the points of a plane out before it looks for the next.

/// Bins of theta.
pub const THETA_BINS: usize = 40;
/// Bins of phi.
pub const PHI_BINS: usize = 20;

/// A plane u(theta, phi) . p = rho and the points that voted for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoughPlane {
    /// Direction of the normal's projection from the x axis, radians.
    pub theta_rad: f64,
    /// Angle of the normal from the z axis, radians.
    pub phi_rad: f64,
    /// Distance from the origin along the normal (the middle of its bin), metres.
    pub rho_m: f64,
    /// Points in the bin.
    pub votes: usize,
}

impl HoughPlane {
    /// The unit normal.
    pub fn normal(&self) -> [f64; 3] {
        normal(self.theta_rad, self.phi_rad)
    }
    /// Signed distance of a point from the plane, metres.
    pub fn distance_m(&self, point: [f64; 3]) -> f64 {
        dot(self.normal(), point) - self.rho_m
    }
}

fn normal(theta_rad: f64, phi_rad: f64) -> [f64; 3] {
    [theta_rad.cos() * phi_rad.sin(), theta_rad.sin() * phi_rad.sin(), phi_rad.cos()]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A bin: theta, phi, rho.
type Bin = [i64; 3];

/// Bins of rho on either side of the origin: 1.2 km at 0.15 m, 50 MB of votes. Points beyond do not vote.
const RHO_BINS: i64 = 8192;

/// The `count` strongest planes through `points`; none where the bin width is not above zero.
pub fn hough_planes(points: &[[f64; 3]], rho_bin_m: f64, count: usize) -> Vec<HoughPlane> {
    let mut bins = votes(points, rho_bin_m);
    bins.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut strongest: Vec<(Bin, usize)> = Vec::new();
    for (bin, votes) in bins {
        if strongest.len() >= count {
            break;
        }
        if !strongest.iter().any(|(stronger, _)| are_neighbours(bin, *stronger)) {
            strongest.push((bin, votes));
        }
    }
    strongest.into_iter().map(|(bin, votes)| plane_of(bin, votes, rho_bin_m)).collect()
}

/// Up to `count` planes, strongest first; points within a bin's width of a plane do not vote for those after it. Ends
/// where fewer than `votes_min` points are left on a plane.
pub fn planes_in_turn(points: &[[f64; 3]], rho_bin_m: f64, count: usize, votes_min: usize) -> Vec<HoughPlane> {
    let (mut left, mut planes) = (points.to_vec(), Vec::new());
    while planes.len() < count {
        let Some(plane) = hough_planes(&left, rho_bin_m, 1).pop().filter(|plane| plane.votes >= votes_min.max(1))
        else {
            break;
        };
        left.retain(|point| plane.distance_m(*point).abs() > rho_bin_m);
        planes.push(plane);
    }
    planes
}

/// The bins that have votes, with their votes.
fn votes(points: &[[f64; 3]], rho_bin_m: f64) -> Vec<(Bin, usize)> {
    if rho_bin_m.is_nan() || rho_bin_m <= 0.0 {
        return Vec::new();
    }
    let mut found = Vec::new();
    let mut counts: Vec<usize> = Vec::new();
    for phi in 0..PHI_BINS as i64 {
        let thetas = if phi == 0 { 1 } else { THETA_BINS as i64 };
        for theta in 0..thetas {
            let u = normal(theta_rad(theta), phi_rad(phi));
            counts.clear();
            counts.resize(2 * RHO_BINS as usize, 0);
            for point in points {
                // Thesis (2-17)
                let bin = (dot(u, *point) / rho_bin_m).floor() + RHO_BINS as f64;
                if (0.0..2.0 * RHO_BINS as f64).contains(&bin) {
                    counts[bin as usize] += 1;
                }
            }
            let filled = counts.iter().enumerate().filter(|(_, votes)| **votes > 0);
            found.extend(filled.map(|(rho, votes)| ([theta, phi, rho as i64 - RHO_BINS], *votes)));
        }
    }
    found
}

fn theta_rad(bin: i64) -> f64 {
    bin as f64 / THETA_BINS as f64 * std::f64::consts::TAU
}

fn phi_rad(bin: i64) -> f64 {
    bin as f64 / PHI_BINS as f64 * std::f64::consts::FRAC_PI_2
}

fn are_neighbours(a: Bin, b: Bin) -> bool {
    let around = (a[0] - b[0]).rem_euclid(THETA_BINS as i64);
    let theta_near = a[1].min(b[1]) == 0 || around <= 1 || around == THETA_BINS as i64 - 1;
    theta_near && (a[1] - b[1]).abs() <= 1 && (a[2] - b[2]).abs() <= 1
}

fn plane_of([theta, phi, rho]: Bin, votes: usize, rho_bin_m: f64) -> HoughPlane {
    HoughPlane { theta_rad: theta_rad(theta), phi_rad: phi_rad(phi), rho_m: (rho as f64 + 0.5) * rho_bin_m, votes }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane_points(u: [f64; 3], rho: f64) -> Vec<[f64; 3]> {
        // Two directions in the plane, from any vector that is not along the normal.
        let a = if u[2].abs() < 0.9 { [-u[1], u[0], 0.0] } else { [1.0, 0.0, -u[0] / u[2]] };
        let b = [u[1] * a[2] - u[2] * a[1], u[2] * a[0] - u[0] * a[2], u[0] * a[1] - u[1] * a[0]];
        let at = |s: f64, t: f64| [0, 1, 2].map(|i: usize| u[i] * rho + a[i] * s + b[i] * t);
        (0..400).map(|i| at((i % 20) as f64 * 0.3 - 3.0, (i / 20) as f64 * 0.3 - 3.0)).collect()
    }

    #[test]
    fn level_ground_and_a_wall_are_the_two_strongest_planes() {
        let mut points = plane_points([0.0, 0.0, 1.0], 1.05);
        // A steep wall: theta bin 5 (45 degrees), phi bin 18 (81 degrees).
        points.extend(plane_points(normal(theta_rad(5), phi_rad(18)), 2.5).into_iter().take(300));
        let planes = hough_planes(&points, 0.1, 2);
        assert_eq!((planes[0].phi_rad, planes[0].votes), (0.0, 400));
        assert!((planes[0].rho_m - 1.05).abs() <= 0.05 + 1e-9);
        assert!((planes[1].theta_rad - theta_rad(5)).abs() < 1e-9 && (planes[1].phi_rad - phi_rad(18)).abs() < 1e-9);
        assert!(planes[1].votes >= 290 && planes[1].distance_m(points[500]).abs() <= 0.1);
    }

    /// The thesis's finding: a plane fits a part of curved ground and departs from the rest.
    #[test]
    fn curved_ground_is_no_plane() {
        let ground: Vec<_> =
            (0..900).map(|i| [(i % 30) as f64, (i / 30) as f64, 0.01 * ((i % 30) as f64).powi(2)]).collect();
        let plane = hough_planes(&ground, 0.15, 1)[0];
        assert!(plane.votes < 450, "{} of 900", plane.votes);
        assert!(ground.iter().any(|point| plane.distance_m(*point).abs() > 2.0));
    }

    #[test]
    fn in_turn_a_second_plane_is_another_and_not_the_first_ones_shoulder() {
        let mut points = plane_points([0.0, 0.0, 1.0], 1.05);
        points.extend(plane_points(normal(theta_rad(5), phi_rad(18)), 2.5).into_iter().take(100));
        let planes = planes_in_turn(&points, 0.1, 5, 50);
        assert_eq!(planes.len(), 2, "{planes:?}");
        assert!((planes[1].phi_rad - phi_rad(18)).abs() < 1e-9 && planes[1].votes >= 90);
    }

    #[test]
    fn nonsense_gives_no_plane_and_never_panics() {
        assert!(hough_planes(&[], 0.1, 3).is_empty());
        assert!(hough_planes(&[[0.0; 3]], f64::NAN, 3).is_empty());
        assert!(hough_planes(&[[f64::NAN; 3], [f64::INFINITY, 0.0, 0.0]], 0.1, 3).iter().all(|p| p.votes <= 1));
    }
}
