//! One beam past a place where a stem may stand, in the coordinates of that stem.

use super::config::StemsConfig;

/// One beam past a place, in the horizontal plane. Metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Unit vector along the beam: east, north.
    pub along: [f64; 2],
    /// The place, seen along the beam from its origin.
    pub ahead_m: f64,
    /// The place, to the left of the beam.
    pub left_m: f64,
    /// Height of the beam at the place above breast height.
    pub up_m: f64,
    /// Half the beam's width there, as far as it sees edges.
    pub half_m: f64,
    /// Half the beam's width there, as far as its light makes an echo's mean range.
    pub spot_m: f64,
    /// One sigma of `half_m`, where it is an estimate: it makes a stem too thick or too thin as a whole.
    pub half_std_m: f64,
    /// Echoes along the beam, horizontally; the nearest first, infinite where there is none.
    pub echoes_m: [f64; 2],
}

/// Where a stem may stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// East and north of the view's corner, metres.
    pub at_m: [f64; 2],
    /// Ground above the view's base, metres.
    pub ground_m: f64,
    /// One sigma of the ground, metres.
    pub ground_std_m: f64,
    /// Breast height above the view's base, metres.
    pub breast_m: f64,
}

impl Place {
    /// The same place where the view's corner moved: what is added to east, north and up, metres.
    pub fn shift(&mut self, [east_m, north_m, up_m]: [f64; 3]) {
        self.at_m = [self.at_m[0] + east_m, self.at_m[1] + north_m];
        (self.ground_m, self.breast_m) = (self.ground_m + up_m, self.breast_m + up_m);
    }
}

impl Sight {
    /// Another echo of the same beam.
    pub fn add_echo(&mut self, echo_m: f64) {
        let [first, second] = self.echoes_m;
        self.echoes_m = if echo_m < first { [echo_m, first] } else { [first, second.min(echo_m)] };
    }

    /// Whether it passes near enough, at a height that is fitted.
    pub fn is_inside(&self, place: &Place, aside_m: f64, config: &StemsConfig) -> bool {
        let height_m = self.up_m + place.breast_m - place.ground_m;
        self.ahead_m > 0.0 && self.left_m.abs() <= aside_m && (config.fit_m[0]..config.fit_m[1]).contains(&height_m)
    }
}
