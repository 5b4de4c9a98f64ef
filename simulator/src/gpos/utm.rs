//! Inverse UTM: from easting and northing to latitude, longitude and grid convergence on WGS 84.
//!
//! In: metres, zone 1 to 60, northern hemisphere. Out: radians. Krueger's series to the sixth order in the third
//! flattening n, coefficients from C. F. F. Karney, "Transverse Mercator with an accuracy of a few nanometers",
//! J. Geodesy 85 (2011), equations 36 to 45. Written on purpose apart from the driver's library: the two must agree.

/// A place on the ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// Latitude, radians, north positive.
    pub latitude_rad: f64,
    /// Longitude, radians, east positive.
    pub longitude_rad: f64,
    /// Grid convergence, radians: true heading minus grid heading.
    pub convergence_rad: f64,
}

const A_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const SCALE: f64 = 0.9996;
const FALSE_EASTING_M: f64 = 500_000.0;

/// Third flattening.
const N: f64 = FLATTENING / (2.0 - FLATTENING);

/// Radius of the rectifying sphere, metres.
fn rectifying_radius_m() -> f64 {
    let n2 = N * N;
    A_M / (1.0 + N) * (1.0 + n2 * (0.25 + n2 * (1.0 / 64.0 + n2 / 256.0)))
}

/// Karney (36): coefficients of the inverse series.
fn beta() -> [f64; 6] {
    let [n, n2, n3, n4, n5, n6] = powers();
    [
        n / 2.0 - n2 * 2.0 / 3.0 + n3 * 37.0 / 96.0 - n4 / 360.0 - n5 * 81.0 / 512.0 + n6 * 96_199.0 / 604_800.0,
        n2 / 48.0 + n3 / 15.0 - n4 * 437.0 / 1440.0 + n5 * 46.0 / 105.0 - n6 * 1_118_711.0 / 3_870_720.0,
        n3 * 17.0 / 480.0 - n4 * 37.0 / 840.0 - n5 * 209.0 / 4480.0 + n6 * 5569.0 / 90_720.0,
        n4 * 4397.0 / 161_280.0 - n5 * 11.0 / 504.0 - n6 * 830_251.0 / 7_257_600.0,
        n5 * 4583.0 / 161_280.0 - n6 * 108_847.0 / 3_991_680.0,
        n6 * 20_648_693.0 / 638_668_800.0,
    ]
}

fn powers() -> [f64; 6] {
    let n2 = N * N;
    [N, n2, n2 * N, n2 * n2, n2 * n2 * N, n2 * n2 * n2]
}

/// Latitude, longitude and convergence of a place in a northern UTM zone.
pub fn geodetic_of_utm(easting_m: f64, northing_m: f64, zone: u8) -> Geodetic {
    let radius_m = SCALE * rectifying_radius_m();
    let (xi, eta) = (northing_m / radius_m, (easting_m - FALSE_EASTING_M) / radius_m);
    let (mut xi1, mut eta1, mut p, mut q) = (xi, eta, 1.0, 0.0);
    for (j, b) in beta().into_iter().enumerate() {
        let k = 2.0 * (j as f64 + 1.0);
        let ((sin, cos), (sinh, cosh)) = ((k * xi).sin_cos(), ((k * eta).sinh(), (k * eta).cosh()));
        xi1 -= b * sin * cosh;
        eta1 -= b * cos * sinh;
        p -= k * b * cos * cosh;
        q += k * b * sin * sinh;
    }
    // Karney (42): tangent of the conformal latitude, and the longitude from the central meridian.
    let tau1 = xi1.sin() / eta1.sinh().hypot(xi1.cos());
    let longitude = eta1.sinh().atan2(xi1.cos());
    // Karney (44) and (45): convergence of the sphere's part and of the series' part.
    let convergence_rad = (xi1.tan() * eta1.tanh()).atan() + q.atan2(p);
    let central = (6.0 * f64::from(zone) - 183.0).to_radians();
    Geodetic { latitude_rad: tau_of(tau1).atan(), longitude_rad: central + longitude, convergence_rad }
}

/// Tangent of the geodetic latitude from that of the conformal one: Newton's method, Karney (19) to (21).
fn tau_of(tau1: f64) -> f64 {
    let e2 = FLATTENING * (2.0 - FLATTENING);
    let e = e2.sqrt();
    let mut tau = tau1;
    // Three steps reach the last bit; five cost nothing.
    for _ in 0..5 {
        let sigma = (e * (e * tau / (1.0 + tau * tau).sqrt()).atanh()).sinh();
        let trial = tau * (1.0 + sigma * sigma).sqrt() - sigma * (1.0 + tau * tau).sqrt();
        let slope = (1.0 + (1.0 - e2) * tau * tau) / ((1.0 - e2) * (1.0 + tau * tau).sqrt());
        tau += (tau1 - trial) / (1.0 + trial * trial).sqrt() * slope;
    }
    tau
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_on_the_central_meridian_has_no_convergence() {
        let at = geodetic_of_utm(500_000.0, 3_279_000.0, 17);
        assert!((at.longitude_rad.to_degrees() + 81.0).abs() < 1e-12 && at.convergence_rad.abs() < 1e-15);
        assert_eq!(geodetic_of_utm(500_000.0, 0.0, 31).latitude_rad, 0.0);
    }

    #[test]
    fn the_meridian_arc_to_45_degrees_is_the_published_one() {
        // Length of the WGS 84 meridian from the equator to 45 degrees: 4 984 944.378 m.
        let at = geodetic_of_utm(500_000.0, 4_984_944.377_98 * SCALE, 31);
        assert!((at.latitude_rad.to_degrees() - 45.0).abs() < 1e-9, "{}", at.latitude_rad.to_degrees());
    }

    #[test]
    fn convergence_is_what_a_step_north_on_the_grid_makes_of_true_north() {
        for (easting, northing) in [(369_000.0, 3_279_000.0), (650_000.0, 5_500_000.0)] {
            let a = geodetic_of_utm(easting, northing, 17);
            let b = geodetic_of_utm(easting, northing + 10.0, 17);
            // Metres per radian on the ellipsoid at this latitude.
            let e2 = FLATTENING * (2.0 - FLATTENING);
            let (sin, cos) = a.latitude_rad.sin_cos();
            let w = 1.0 - e2 * sin * sin;
            let (meridian, prime) = (A_M * (1.0 - e2) / w.powf(1.5), A_M / w.sqrt());
            let north = (b.latitude_rad - a.latitude_rad) * meridian;
            let east = (b.longitude_rad - a.longitude_rad) * prime * cos;
            assert!(
                (east.atan2(north) - a.convergence_rad).abs() < 1e-6,
                "{} {}",
                east.atan2(north),
                a.convergence_rad
            );
        }
    }

    #[test]
    fn west_of_the_central_meridian_in_the_north_convergence_is_negative() {
        let at = geodetic_of_utm(369_000.0, 3_279_000.0, 17);
        assert!((at.convergence_rad.to_degrees() + 0.668).abs() < 0.01, "{}", at.convergence_rad.to_degrees());
        assert!((at.latitude_rad.to_degrees() - 29.633).abs() < 0.01);
    }

    #[test]
    fn it_agrees_with_the_library_that_the_drivers_use() {
        let (degrees, mut cases) = (proj4rs::Proj::from_proj_string("+proj=longlat +ellps=WGS84").unwrap(), 0);
        for zone in [1u8, 17, 31, 60] {
            let utm = proj4rs::Proj::from_proj_string(&format!("+proj=utm +zone={zone} +ellps=WGS84")).unwrap();
            for easting in [170_000.0, 369_000.0, 499_999.0, 640_123.4, 830_000.0] {
                for northing in [10.0, 1_000_000.0, 3_279_000.0, 6_400_000.0, 9_000_000.0] {
                    let mut point = (easting, northing, 0.0);
                    proj4rs::transform::transform(&utm, &degrees, &mut point).unwrap();
                    let ours = geodetic_of_utm(easting, northing, zone);
                    let turn = std::f64::consts::TAU;
                    let around = (ours.longitude_rad - point.0 + 1.5 * turn).rem_euclid(turn) - turn / 2.0;
                    // 2e-14 radians are 0.13 micrometres.
                    assert!(
                        around.abs() < 2e-14 && (ours.latitude_rad - point.1).abs() < 2e-14,
                        "{easting} {northing}"
                    );
                    cases += 1;
                }
            }
        }
        assert_eq!(cases, 100);
    }
}
