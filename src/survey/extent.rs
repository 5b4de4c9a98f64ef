//! Where a survey's rays are: how many, between which corners, from which sensor positions.

use super::input::Ray;
use tsense_geometry::{Global, Point, Timestamp};

/// Counts and bounds of a survey's rays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Extent {
    /// Rays read.
    pub rays: u64,
    /// Rays with a return.
    pub returns: u64,
    /// Returns of which nobody knows where their beams came from.
    pub points: u64,
    /// First and last stamp.
    pub times: Option<(Timestamp, Timestamp)>,
    origins: Option<Bounds>,
    ends: Option<Bounds>,
}

type Bounds = ([f64; 3], [f64; 3]);

/// The lowest and the highest corner of a box.
pub type Corners = (Point<Global>, Point<Global>);

impl Extent {
    /// Counts a ray in.
    pub fn add(&mut self, ray: &Ray) {
        self.rays += 1;
        grow(&mut self.origins, ray.origin);
        if ray.is_return {
            self.returns += 1;
            self.points += u64::from(ray.is_point());
            grow(&mut self.ends, ray.end);
        }
        let (first, last) = self.times.get_or_insert((ray.stamp, ray.stamp));
        (*first, *last) = ((*first).min(ray.stamp), (*last).max(ray.stamp));
    }

    /// Whether no return says where its beam came from.
    pub fn has_points_only(&self) -> bool {
        self.points == self.returns
    }

    /// The box that holds all returns within `reach_m` of the sensor's positions, horizontally; heights as returned,
    /// but no more than `reach_m` above or below the sensor either. None where no return can lie in it.
    pub fn space(&self, reach_m: f64) -> Option<Corners> {
        let (origins, ends) = (self.origins?, self.ends?);
        let low: [f64; 3] = std::array::from_fn(|axis| ends.0[axis].max(origins.0[axis] - reach_m));
        let high: [f64; 3] = std::array::from_fn(|axis| ends.1[axis].min(origins.1[axis] + reach_m));
        let is_some = low.iter().zip(&high).all(|(low, high)| low <= high);
        is_some.then(|| (Point::new(low[0], low[1], low[2]), Point::new(high[0], high[1], high[2])))
    }
}

fn grow(bounds: &mut Option<Bounds>, point: Point<Global>) {
    let here = point.to_array();
    let (low, high) = bounds.get_or_insert((here, here));
    for axis in 0..3 {
        low[axis] = low[axis].min(here[axis]);
        high[axis] = high[axis].max(here[axis]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_returns_do_not_widen_the_space_beyond_the_reach() {
        let mut extent = Extent::default();
        for (x, is_return) in [(5.0, true), (100.0, true), (400.0, false)] {
            let stamp = Timestamp::from_ns(x as i64);
            extent.add(&Ray { origin: Point::new(0.0, 0.0, 2.0), end: Point::new(x, 1.0, 0.0), is_return, stamp });
        }
        let (low, high) = extent.space(30.0).unwrap();
        assert_eq!((low.to_array(), high.to_array()), ([5.0, 1.0, 0.0], [30.0, 1.0, 0.0]));
        assert_eq!((extent.rays, extent.returns), (3, 2));
        assert_eq!(extent.space(4.0), None, "the nearest return is 5 m away");
    }
}
