//! UTM: latitude and longitude to easting and northing of one pinned zone, and the grid convergence there.
//!
//! In: degrees on WGS 84. Out: metres in the pinned zone, also beyond its borders, and radians between grid north and
//! true north. The projection is proj4rs; the convergence is the direction in which true north runs on the grid.
//!
//! Source: wire format notes section 4.3.

use super::nmea::Reject;
use proj4rs::Proj;
use proj4rs::transform::transform;

/// A UTM zone and hemisphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Zone {
    /// 1 to 60.
    pub number: u8,
    /// Whether northings count from the southern false origin.
    pub south: bool,
}

/// Farthest from the central meridian that is projected, degrees: two zones. Farther is another place, not a border.
const BEYOND_MAX_DEG: f64 = 12.0;
/// Beyond these latitudes UTM is not defined, degrees (half a degree of grace).
const LATITUDES_DEG: std::ops::RangeInclusive<f64> = -80.5..=84.5;
/// Half the way along the meridian over which the convergence is taken, degrees: 60 m, rounding 1e-11 rad.
const MERIDIAN_STEP_DEG: f64 = 5e-4;

impl Zone {
    /// The zone of a place, without the exceptions of Norway and Svalbard: a pinned zone needs none.
    pub fn of(latitude_deg: f64, longitude_deg: f64) -> Self {
        let number = ((wrapped_deg(longitude_deg) + 180.0) / 6.0).floor() as i32 + 1;
        Self { number: number.clamp(1, 60) as u8, south: latitude_deg < 0.0 }
    }

    /// From `17N` or `56S`.
    pub fn parse(text: &str) -> Option<Self> {
        let (number, south) = match text.strip_suffix('N') {
            Some(number) => (number, false),
            None => (text.strip_suffix('S')?, true),
        };
        let number = number.parse().ok()?;
        (1..=60).contains(&number).then_some(Self { number, south })
    }

    /// Longitude of the zone's central meridian, degrees.
    pub fn central_meridian_deg(&self) -> f64 {
        f64::from(self.number) * 6.0 - 183.0
    }

    /// Degrees of longitude from the central meridian, -180 to 180.
    pub fn beyond_deg(&self, longitude_deg: f64) -> f64 {
        wrapped_deg(longitude_deg - self.central_meridian_deg())
    }
}

impl std::fmt::Display for Zone {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{}", self.number, if self.south { 'S' } else { 'N' })
    }
}

/// -180 (included) to 180.
fn wrapped_deg(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

/// The projection of one zone.
pub struct Utm {
    zone: Zone,
    geographic: Proj,
    grid: Proj,
}

impl Utm {
    /// The projection of this zone.
    pub fn new(zone: Zone) -> Result<Self, Reject> {
        let south = if zone.south { " +south" } else { "" };
        let grid = format!("+proj=utm +zone={}{south} +ellps=WGS84 +units=m +no_defs", zone.number);
        let proj = |text: &str| Proj::from_proj_string(text).map_err(|_| "the projection cannot be set up");
        Ok(Self { zone, geographic: proj("+proj=longlat +ellps=WGS84 +no_defs")?, grid: proj(&grid)? })
    }

    /// The pinned zone.
    pub fn zone(&self) -> Zone {
        self.zone
    }

    /// Easting and northing, metres.
    pub fn project(&self, latitude_deg: f64, longitude_deg: f64) -> Result<[f64; 2], Reject> {
        if !LATITUDES_DEG.contains(&latitude_deg) {
            return Err("latitude outside of UTM");
        }
        let beyond_deg = self.zone.beyond_deg(longitude_deg);
        if !(-BEYOND_MAX_DEG..=BEYOND_MAX_DEG).contains(&beyond_deg) {
            return Err("two zones away from the pinned one");
        }
        let longitude_deg = self.zone.central_meridian_deg() + beyond_deg;
        let mut point = (longitude_deg.to_radians(), latitude_deg.to_radians(), 0.0);
        transform(&self.geographic, &self.grid, &mut point).map_err(|_| "the projection failed")?;
        let [easting, northing] = [point.0, point.1];
        if easting.is_finite() && northing.is_finite() { Ok([easting, northing]) } else { Err("the projection failed") }
    }

    /// Grid convergence, radians: what is subtracted from a true heading to get a grid heading. Positive east of the
    /// central meridian in the north, where true north runs to the left of grid north.
    pub fn convergence_rad(&self, latitude_deg: f64, longitude_deg: f64) -> Result<f64, Reject> {
        let [e0, n0] = self.project(latitude_deg - MERIDIAN_STEP_DEG, longitude_deg)?;
        let [e1, n1] = self.project(latitude_deg + MERIDIAN_STEP_DEG, longitude_deg)?;
        Ok(-(e1 - e0).atan2(n1 - n0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Krueger's series to the sixth order in the third flattening, with the convergence of the same series.
    /// An independent way to the same numbers: conformal latitude, Gauss-Schreiber, then sines of multiples.
    fn krueger(zone: Zone, latitude_deg: f64, longitude_deg: f64) -> ([f64; 2], f64) {
        const A_M: f64 = 6_378_137.0;
        const F: f64 = 1.0 / 298.257_223_563;
        let n = F / (2.0 - F);
        let (n2, n3) = (n * n, n * n * n);
        let (n4, n5, n6) = (n2 * n2, n2 * n3, n3 * n3);
        let alpha = [
            n / 2.0 - 2.0 / 3.0 * n2 + 5.0 / 16.0 * n3 + 41.0 / 180.0 * n4 - 127.0 / 288.0 * n5 + 7891.0 / 37800.0 * n6,
            13.0 / 48.0 * n2 - 3.0 / 5.0 * n3 + 557.0 / 1440.0 * n4 + 281.0 / 630.0 * n5
                - 1_983_433.0 / 1_935_360.0 * n6,
            61.0 / 240.0 * n3 - 103.0 / 140.0 * n4 + 15061.0 / 26880.0 * n5 + 167_603.0 / 181_440.0 * n6,
            49561.0 / 161_280.0 * n4 - 179.0 / 168.0 * n5 + 6_601_661.0 / 7_257_600.0 * n6,
            34729.0 / 80640.0 * n5 - 3_418_889.0 / 1_995_840.0 * n6,
            212_378_941.0 / 319_334_400.0 * n6,
        ];
        let radius_m = A_M / (1.0 + n) * (1.0 + n2 / 4.0 + n4 / 64.0 + n6 / 256.0);
        let e = (F * (2.0 - F)).sqrt();
        let phi = latitude_deg.to_radians();
        let lambda = (longitude_deg - zone.central_meridian_deg()).to_radians();
        let tau = phi.tan();
        let sigma = (e * (e * phi.sin()).atanh()).sinh();
        let tau1 = tau * (1.0 + sigma * sigma).sqrt() - sigma * (1.0 + tau * tau).sqrt();
        let xi1 = tau1.atan2(lambda.cos());
        let eta1 = (lambda.sin() / (tau1 * tau1 + lambda.cos() * lambda.cos()).sqrt()).asinh();
        let (mut xi, mut eta, mut p, mut q) = (xi1, eta1, 1.0, 0.0);
        for (j, a) in alpha.iter().enumerate() {
            let m = 2.0 * (j + 1) as f64;
            xi += a * (m * xi1).sin() * (m * eta1).cosh();
            eta += a * (m * xi1).cos() * (m * eta1).sinh();
            p += m * a * (m * xi1).cos() * (m * eta1).cosh();
            q += m * a * (m * xi1).sin() * (m * eta1).sinh();
        }
        let k = 0.9996 * radius_m;
        let convergence = (tau1 / (1.0 + tau1 * tau1).sqrt() * lambda.tan()).atan() + q.atan2(p);
        let false_northing_m = if zone.south { 10_000_000.0 } else { 0.0 };
        ([500_000.0 + k * eta, false_northing_m + k * xi], convergence)
    }

    #[test]
    fn the_projection_agrees_with_krueger_within_a_millimetre_inside_and_beyond_the_zone() {
        let mut compared = 0;
        for (number, south) in [(17, false), (17, true), (1, false), (60, true), (32, false)] {
            let zone = Zone { number, south };
            let utm = Utm::new(zone).unwrap();
            for latitude in -32..=33 {
                for beyond in -7..=7 {
                    let (latitude, longitude) =
                        (f64::from(latitude) * 2.5, zone.central_meridian_deg() + f64::from(beyond));
                    let ([easting, northing], convergence) = krueger(zone, latitude, longitude);
                    let [e, n] = utm.project(latitude, longitude).unwrap();
                    let off_m = (e - easting).hypot(n - northing);
                    assert!(off_m < 1e-3, "{off_m} m at {latitude} {longitude} in {zone}");
                    let gamma = utm.convergence_rad(latitude, longitude).unwrap();
                    assert!((gamma - convergence).abs() < 1e-8, "{gamma} {convergence} at {latitude} {longitude}");
                    compared += 1;
                }
            }
        }
        assert_eq!(compared, 5 * 66 * 15);
    }

    #[test]
    fn convergence_is_positive_east_of_the_meridian_in_the_north_and_turns_with_either() {
        let north = Utm::new(Zone { number: 17, south: false }).unwrap();
        let check = |latitude: f64, longitude: f64, expected_deg: f64| {
            let gamma = north.convergence_rad(latitude, longitude).unwrap().to_degrees();
            // On a sphere: atan(tan(lambda) sin(phi)).
            assert!((gamma - expected_deg).abs() < 0.01, "{gamma} at {latitude} {longitude}");
        };
        check(30.0, -79.0, 1.0003);
        check(30.0, -83.0, -1.0003);
        check(-30.0, -79.0, -1.0003);
        check(45.0, -81.0, 0.0);
        check(0.0, -78.5, 0.0);
    }

    #[test]
    fn a_known_place_has_its_known_coordinates() {
        // The CN Tower in a gazetteer: 43.642567 N, 79.387139 W is 17N 630084 E, 4833438 N.
        let utm = Utm::new(Zone::of(43.642_567, -79.387_139)).unwrap();
        assert_eq!(utm.zone().to_string(), "17N");
        let [easting, northing] = utm.project(43.642_567, -79.387_139).unwrap();
        assert!((easting - 630_084.3).abs() < 1.0 && (northing - 4_833_438.6).abs() < 1.0, "{easting} {northing}");
    }

    #[test]
    fn zones_are_named_and_the_date_line_belongs_to_zone_one() {
        assert_eq!(Zone::parse("56S"), Some(Zone { number: 56, south: true }));
        assert_eq!([Zone::parse("0N"), Zone::parse("61N"), Zone::parse("17"), Zone::parse("")], [None; 4]);
        assert_eq!(
            (Zone::of(1.0, 180.0).number, Zone::of(1.0, 179.9).number, Zone::of(-1.0, -180.0).number),
            (1, 60, 1)
        );
    }

    #[test]
    fn the_zone_holds_across_its_border_and_across_the_date_line_and_ends_far_away() {
        let utm = Utm::new(Zone { number: 60, south: false }).unwrap();
        let [west, _] = utm.project(10.0, 179.9999).unwrap();
        let [east, _] = utm.project(10.0, -179.9999).unwrap();
        assert!((east - west - 21.9).abs() < 0.2, "{west} {east}");
        assert_eq!(utm.project(10.0, 150.0), Err("two zones away from the pinned one"));
        assert_eq!(utm.project(85.0, 177.0), Err("latitude outside of UTM"));
        assert_eq!(utm.project(f64::NAN, 177.0), Err("latitude outside of UTM"));
        assert_eq!(utm.project(10.0, f64::NAN), Err("two zones away from the pinned one"));
    }
}
