//! From the grid's UTM to the globe and back, for one zone.
//!
//! In: easting and northing in metres, zone and hemisphere. Out: degrees on WGS 84, and the direction of grid north.

use proj4rs::Proj;
use proj4rs::transform::transform;

/// Half the way along the meridian over which the convergence is taken, degrees: 60 m.
const MERIDIAN_STEP_DEG: f64 = 5e-4;

/// One UTM zone.
pub struct Place {
    zone: (u8, u8),
    geographic: Proj,
    grid: Proj,
}

impl Place {
    /// The zone with this number, south where `south` is not 0; none where there is no such zone.
    pub fn new(zone: u8, south: u8) -> Option<Self> {
        if !(1..=60).contains(&zone) {
            return None;
        }
        let hemisphere = if south == 0 { "" } else { " +south" };
        let grid = format!("+proj=utm +zone={zone}{hemisphere} +ellps=WGS84 +units=m +no_defs");
        let proj = |text: &str| Proj::from_proj_string(text).ok();
        Some(Self { zone: (zone, south), geographic: proj("+proj=longlat +ellps=WGS84 +no_defs")?, grid: proj(&grid)? })
    }

    /// Zone and hemisphere.
    pub fn zone(&self) -> (u8, u8) {
        self.zone
    }

    /// Latitude and longitude, degrees.
    pub fn globe(&self, [easting, northing]: [f64; 2]) -> Option<[f64; 2]> {
        let mut point = (easting, northing, 0.0);
        transform(&self.grid, &self.geographic, &mut point).ok()?;
        let degrees = [point.1.to_degrees(), point.0.to_degrees()];
        degrees.iter().all(|d| d.is_finite()).then_some(degrees)
    }

    /// Easting and northing, metres.
    pub fn utm(&self, [latitude_deg, longitude_deg]: [f64; 2]) -> Option<[f64; 2]> {
        if !(-85.0..=85.0).contains(&latitude_deg) || !longitude_deg.is_finite() {
            return None;
        }
        let mut point = (longitude_deg.to_radians(), latitude_deg.to_radians(), 0.0);
        transform(&self.geographic, &self.grid, &mut point).ok()?;
        (point.0.is_finite() && point.1.is_finite()).then_some([point.0, point.1])
    }

    /// From true north to grid north at a place, clockwise positive, radians: the grid convergence.
    pub fn convergence_rad(&self, [latitude_deg, longitude_deg]: [f64; 2]) -> Option<f64> {
        let [e0, n0] = self.utm([latitude_deg - MERIDIAN_STEP_DEG, longitude_deg])?;
        let [e1, n1] = self.utm([latitude_deg + MERIDIAN_STEP_DEG, longitude_deg])?;
        Some(-(e1 - e0).atan2(n1 - n0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_place_goes_to_the_globe_and_back() {
        // The CN Tower in a gazetteer: 17N 630084 E, 4833438 N is 43.642567 N, 79.387139 W.
        let place = Place::new(17, 0).unwrap();
        let [latitude, longitude] = place.globe([630_084.3, 4_833_438.6]).unwrap();
        assert!((latitude - 43.642_567).abs() < 1e-5 && (longitude + 79.387_139).abs() < 1e-5);
        let [easting, northing] = place.utm([latitude, longitude]).unwrap();
        assert!((easting - 630_084.3).abs() < 1e-3 && (northing - 4_833_438.6).abs() < 1e-3);
        // On a sphere: atan(tan(1.612861 degrees) sin(latitude)), east of the meridian in the north: clockwise.
        let convergence = place.convergence_rad([latitude, longitude]).unwrap().to_degrees();
        assert!((convergence - 1.1132).abs() < 0.002, "{convergence}");
    }

    #[test]
    fn zones_that_are_none_are_refused() {
        assert!(Place::new(0, 0).is_none() && Place::new(61, 0).is_none());
        assert!(Place::new(56, 1).unwrap().utm([f64::NAN, 0.0]).is_none());
    }
}
