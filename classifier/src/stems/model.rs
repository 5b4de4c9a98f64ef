//! A leaning, tapering stem and the finite beam that sees it.
//!
//! A beam of half width w whose middle runs |u| beside the axis of a stem of radius R returns an echo while some of it
//! meets the surface: |u| < R + w. A point-like beam would have w = 0; taking this one for such a beam makes every
//! stem 2 w too thick (12 cm at 10 m). The echo lies at the mean depth of the surface over the part of the footprint that
//! meets it. In: a [`Sight`] and a [`Stem`]. Out: what the beam did there. Metres. docs/equations.md, "Stems".

use super::sight::Sight;

/// Mean and one sigma of the taper: radius gained a metre up.
pub const TAPER: [f64; 2] = [-0.006, 0.006];
/// Number of unknowns of a stem.
pub const UNKNOWNS: usize = 6;

/// A stem relative to its place: the centre line and the radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stem {
    /// Axis at breast height, east of the place, metres.
    pub east_m: f64,
    /// Axis at breast height, north of the place, metres.
    pub north_m: f64,
    /// Radius at breast height, metres.
    pub radius_m: f64,
    /// Lean: metres east and north a metre up.
    pub lean: [f64; 2],
    /// Radius gained a metre up; negative.
    pub taper: f64,
}

impl Stem {
    /// As a vector of unknowns.
    pub fn unknowns(&self) -> [f64; UNKNOWNS] {
        [self.east_m, self.north_m, self.radius_m, self.lean[0], self.lean[1], self.taper]
    }

    /// From a vector of unknowns.
    pub fn from_unknowns([east_m, north_m, radius_m, lean_east, lean_north, taper]: [f64; UNKNOWNS]) -> Self {
        Self { east_m, north_m, radius_m, lean: [lean_east, lean_north], taper }
    }

    /// Radius at a height above breast height.
    pub fn radius_at_m(&self, up_m: f64) -> f64 {
        (self.radius_m + self.taper * up_m).max(0.005)
    }

    /// How a beam meets the stem.
    pub fn meet(&self, sight: &Sight) -> Meeting {
        let east_m = self.east_m + self.lean[0] * sight.up_m;
        let north_m = self.north_m + self.lean[1] * sight.up_m;
        let [x, y] = sight.along;
        Meeting {
            radius_m: self.radius_at_m(sight.up_m),
            left_m: sight.left_m + x * north_m - y * east_m,
            ahead_m: sight.ahead_m + x * east_m + y * north_m,
            half_m: sight.half_m,
            spot_m: sight.spot_m,
        }
    }
}

/// A beam at a stem, in the horizontal plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Radius at the beam's height.
    pub radius_m: f64,
    /// The axis, to the left of the beam.
    pub left_m: f64,
    /// The axis, along the beam.
    pub ahead_m: f64,
    /// Half the beam's width, as far as it sees edges, and as far as its light makes an echo's mean range.
    pub half_m: f64,
    /// See `half_m`.
    pub spot_m: f64,
}

/// Offsets across the footprint, in half widths, and the share of a round footprint at each; the last one is there so that
/// four of them go through one instruction.
const OFFSETS: [f32; 8] = [-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 0.0];
const SHARES: [f32; 8] = [0.436, 0.8, 0.954, 1.0, 0.954, 0.8, 0.436, 0.0];

/// Mean depth of a cylinder's front before its axis over the part of a footprint that meets it, and its derivatives
/// by the offset and by the radius.
pub fn front_depth(aside_m: f64, radius_m: f64, half_m: f64) -> [f64; 3] {
    if aside_m.abs() >= radius_m + half_m {
        return [0.0; 3];
    }
    // Seven digits are enough for a mean, and twice as many go through one instruction.
    let (aside_m, radius_m, half_m) = (aside_m as f32, radius_m as f32, half_m as f32);
    let mut sums = [[0.0; 8]; 4];
    for i in 0..8 {
        let at_m = aside_m + OFFSETS[i] * half_m;
        let square = radius_m * radius_m - at_m * at_m;
        // Written without a branch: the roots then run side by side.
        let share = if square > 0.0 { SHARES[i] } else { 0.0 };
        let depth = square.max(0.0).sqrt();
        // At the rim the depth changes without bound, which an echo's mean does not follow.
        let steep = share / depth.max(0.3 * radius_m);
        sums[0][i] = share * depth;
        sums[1][i] = -steep * at_m;
        sums[2][i] = steep * radius_m;
        sums[3][i] = share;
    }
    let [depth, by_aside, by_radius, weight] = sums.map(|parts| parts.iter().sum::<f32>());
    [depth, by_aside, by_radius].map(|sum| f64::from(sum / (weight + 1e-9)))
}

/// What a beam did at a stem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// It ended at the surface; the echo lies this far behind where the model expects it.
    Hit(f64),
    /// It went on behind the stem.
    Passed,
    /// It ended before the stem, or between the stem and what stands close behind: it says nothing.
    Blocked,
}

impl Meeting {
    /// Depth of the surface before the axis as the beam sees it, and its derivatives by the offset and the radius.
    pub fn depth(&self) -> [f64; 3] {
        front_depth(self.left_m, self.radius_m, self.spot_m)
    }

    /// How far the beam's middle lies inside of the silhouette as the beam sees it; negative outside.
    pub fn inside_m(&self) -> f64 {
        self.radius_m + self.half_m - self.left_m.abs()
    }

    /// What the beam did, an echo within `tolerance_m` of the surface being a hit; and the surface's depth as of
    /// [`Meeting::depth`], which is worked out only where an echo lies near enough.
    pub fn outcome(&self, sight: &Sight, tolerance_m: f64) -> (Outcome, [f64; 3]) {
        // The surface lies between the axis and a radius before it; a micrometre is for rounding.
        let [before_m, behind_m] = [self.radius_m, 0.0].map(|reach_m| reach_m + tolerance_m + 1e-6);
        let may_hit = |echo_m: &f64| (-before_m..behind_m).contains(&(echo_m - self.ahead_m));
        if !sight.echoes_m.iter().any(may_hit) {
            return (self.miss(sight, tolerance_m), [0.0; 3]);
        }
        let depth = self.depth();
        let behind_m = sight.echoes_m.map(|echo_m| echo_m - (self.ahead_m - depth[0]));
        let hit = behind_m.into_iter().find(|behind_m| behind_m.abs() <= tolerance_m);
        (hit.map_or_else(|| self.miss(sight, tolerance_m), Outcome::Hit), depth)
    }

    /// What a beam did that has no echo at the surface.
    fn miss(&self, sight: &Sight, tolerance_m: f64) -> Outcome {
        // Echoes of the stem and of what stands close behind it merge into one between the two.
        let behind_m = self.ahead_m + 0.5 * self.radius_m + tolerance_m;
        if sight.echoes_m[0] > behind_m { Outcome::Passed } else { Outcome::Blocked }
    }

    /// Whether some echo lies close to the stem, on it or not.
    pub fn is_near(&self, sight: &Sight) -> bool {
        sight.echoes_m.iter().any(|echo_m| (echo_m - self.ahead_m).abs() < self.radius_m + 0.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thin_beam_meets_the_circle_and_a_wide_one_its_mean() {
        // 0.13^2 - 0.05^2 = 0.12^2.
        assert!((front_depth(0.05, 0.13, 0.0)[0] - 0.12).abs() < 1e-6);
        let wide = front_depth(0.0, 0.13, 0.05)[0];
        assert!(wide < 0.13 && wide > 0.12, "{wide}");
        assert!(front_depth(0.2, 0.13, 0.05)[0].abs() < 1e-6, "it misses");
    }

    #[test]
    fn derivatives_of_the_depth_are_those_of_small_steps() {
        let at = |aside, radius| front_depth(aside, radius, 0.02)[0];
        let [_, by_aside, by_radius] = front_depth(0.04, 0.15, 0.02);
        assert!((by_aside - (at(0.0401, 0.15) - at(0.0399, 0.15)) / 0.0002).abs() < 1e-3);
        assert!((by_radius - (at(0.04, 0.1501) - at(0.04, 0.1499)) / 0.0002).abs() < 1e-3);
    }

    #[test]
    fn a_beam_that_runs_beside_the_axis_meets_it_as_drawn() {
        let stem = Stem { east_m: 0.1, north_m: 0.0, radius_m: 0.2, lean: [0.0, 0.1], taper: -0.01 };
        let sight = Sight {
            along: [1.0, 0.0],
            ahead_m: 5.0,
            left_m: 0.05,
            up_m: 1.0,
            half_m: 0.03,
            spot_m: 0.03,
            half_std_m: 0.0,
            echoes_m: [4.95, f64::INFINITY],
        };
        let meeting = stem.meet(&sight);
        assert!((meeting.ahead_m - 5.1).abs() < 1e-12 && (meeting.left_m - 0.15).abs() < 1e-12);
        assert!((meeting.radius_m - 0.19).abs() < 1e-12 && (meeting.inside_m() - 0.07).abs() < 1e-12);
        let (hit, [depth_m, ..]) = meeting.outcome(&sight, 0.05);
        assert!((depth_m - front_depth(0.15, 0.19, 0.03)[0]).abs() < 1e-12);
        assert!(matches!(hit, Outcome::Hit(behind) if (behind - (4.95 - 5.1 + depth_m)).abs() < 1e-9));
        let beyond = Sight { echoes_m: [f64::INFINITY; 2], ..sight };
        assert_eq!(meeting.outcome(&beyond, 0.05).0, Outcome::Passed);
        let before = Sight { echoes_m: [3.0, f64::INFINITY], ..sight };
        assert_eq!(meeting.outcome(&before, 0.05).0, Outcome::Blocked);
    }

    #[test]
    fn an_echo_is_a_hit_where_it_lies_near_the_depth_however_that_is_worked_out() {
        let (mut hits, mut misses) = (0, 0);
        for i in 0..20_000 {
            let [a, b, c, d] = [1.0f64, 2.3, 4.1, 7.7].map(|f| (f * f64::from(i)).sin());
            let (radius_m, left_m, ahead_m) = (0.2 + 0.15 * a, 0.4 * b, 5.0);
            let meeting = Meeting { radius_m, left_m, ahead_m, half_m: 0.05, spot_m: 0.06 };
            let echoes_m = [ahead_m + 0.5 * c, ahead_m + 0.5 * c + d.abs()];
            let sight = Sight {
                along: [1.0, 0.0],
                ahead_m,
                left_m,
                up_m: 0.0,
                half_m: 0.05,
                spot_m: 0.06,
                half_std_m: 0.0,
                echoes_m,
            };
            let behind_m = echoes_m.map(|echo_m| echo_m - (ahead_m - meeting.depth()[0]));
            let plain = behind_m.into_iter().find(|behind_m| behind_m.abs() <= 0.07).map(Outcome::Hit);
            match (plain, meeting.outcome(&sight, 0.07)) {
                (Some(hit), found) => {
                    assert_eq!(found, (hit, meeting.depth()));
                    hits += 1;
                }
                (None, (outcome, _)) => {
                    assert!(!matches!(outcome, Outcome::Hit(_)));
                    misses += 1;
                }
            }
        }
        assert!(hits > 2000 && misses > 10_000, "{hits} hits, {misses} misses");
    }
}
