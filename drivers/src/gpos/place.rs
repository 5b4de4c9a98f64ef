//! A fix becomes a pose of the vehicle in UTM.
//!
//! In: a [`Fix`] (degrees, true north, ellipsoid) and its stamp. Out: [`Pose`] of thesis (2-7) and (2-8): grid yaw is
//! true heading minus convergence, and the vehicle's origin is the reported point minus the turned lever arm. The zone
//! is pinned by the first fix that is placed, or by the configuration.

use super::config::Config;
use super::fix::Fix;
use super::nmea::Reject;
use super::utm::{Utm, Zone};
use tsense_contract::Pose;
use tsense_geometry::{Attitude, Global, Point, Timestamp, Transform, Vector, Vehicle, global_from_vehicle};

/// Farthest from the central meridian of a zone from before at which it is pinned again, degrees: the middle of the
/// next zone. Farther, the vehicle was carried elsewhere and its old map is of no use there.
const REMEMBERED_MAX_DEG: f64 = 6.0;

/// Places fixes on the grid.
pub struct Placer {
    utm: Option<Utm>,
    remembered: Option<Zone>,
    antenna: Vector<Vehicle>,
    signs: [f64; 2],
    offsets_deg: [f64; 3],
}

impl Placer {
    /// With the zone of the configuration, or none yet.
    pub fn new(config: &Config) -> Self {
        let [x, y, z] = config.antenna_m;
        Self {
            utm: Zone::parse(&config.zone).and_then(|zone| Utm::new(zone).ok()),
            remembered: None,
            antenna: Vector::new(x, y, z),
            signs: [f64::from(config.roll_sign), f64::from(config.pitch_sign)],
            offsets_deg: [config.roll_offset_deg, config.pitch_offset_deg, config.heading_offset_deg],
        }
    }

    /// The pinned zone.
    pub fn zone(&self) -> Option<Zone> {
        self.utm.as_ref().map(Utm::zone)
    }

    /// A zone from before: pinned with the first fix, unless that lies too far from it.
    pub fn remember(&mut self, zone: Zone) {
        self.remembered = Some(zone);
    }

    fn zone_for(&self, [latitude, longitude]: [f64; 2]) -> Zone {
        let near = |zone: &Zone| zone.beyond_deg(longitude).abs() <= REMEMBERED_MAX_DEG;
        self.remembered.filter(near).unwrap_or(Zone::of(latitude, longitude))
    }

    /// The pose of the vehicle at a fix.
    pub fn place(&mut self, fix: &Fix, stamp: Timestamp) -> Result<Pose, Reject> {
        if let Some(utm) = &self.utm {
            return self.place_in(utm, fix, stamp);
        }
        let utm = Utm::new(self.zone_for(fix.position_deg))?;
        let pose = self.place_in(&utm, fix, stamp)?;
        // Only a fix that can be placed pins the zone.
        self.utm = Some(utm);
        Ok(pose)
    }

    fn place_in(&self, utm: &Utm, fix: &Fix, stamp: Timestamp) -> Result<Pose, Reject> {
        let [latitude, longitude] = fix.position_deg;
        let [easting, northing] = utm.project(latitude, longitude)?;
        let convergence_rad = utm.convergence_rad(latitude, longitude)?;
        let attitude = self.attitude(fix, convergence_rad);
        // The point on the vehicle, seen from the vehicle's origin, along the grid's axes.
        let turn: Transform<Global, Vehicle> = global_from_vehicle(attitude, Point::new(0.0, 0.0, 0.0));
        let lever = (turn * self.antenna).xyz;
        let single = |values: [f64; 3]| values.map(|value| value as f32);
        Ok(Pose {
            stamp_ns: stamp.ns,
            easting_m: easting - lever.x,
            northing_m: northing - lever.y,
            altitude_m: fix.height_m - lever.z,
            roll_rad: attitude.roll_rad,
            pitch_rad: attitude.pitch_rad,
            yaw_rad: attitude.yaw_rad,
            convergence_rad,
            velocity_m_s: single(grid_velocity(fix.velocity_m_s.unwrap_or([f64::NAN; 3]), convergence_rad)),
            position_std_m: single(fix.position_std_m),
            attitude_std_rad: single(fix.attitude_std_deg.map(f64::to_radians)),
            zone: utm.zone().number,
            south: u8::from(utm.zone().south),
            quality: fix.quality.to_wire(),
            flags: 0,
        })
    }

    fn attitude(&self, fix: &Fix, convergence_rad: f64) -> Attitude {
        let [roll_deg, pitch_deg] = fix.tilt_deg;
        Attitude {
            roll_rad: (roll_deg * self.signs[0] + self.offsets_deg[0]).to_radians(),
            pitch_rad: (pitch_deg * self.signs[1] + self.offsets_deg[1]).to_radians(),
            yaw_rad: wrapped_rad((fix.heading_deg + self.offsets_deg[2]).to_radians() - convergence_rad),
        }
    }
}

/// From true east and north to the grid's.
fn grid_velocity([east, north, up]: [f64; 3], convergence_rad: f64) -> [f64; 3] {
    let (sin, cos) = convergence_rad.sin_cos();
    [east * cos - north * sin, east * sin + north * cos, up]
}

/// (-pi, pi].
fn wrapped_rad(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    PI - (PI - angle).rem_euclid(TAU)
}

#[cfg(test)]
mod tests {
    use super::super::calendar::SourceTime;
    use super::*;
    use tsense_contract::PoseQuality;

    fn fix(latitude: f64, longitude: f64, heading_deg: f64) -> Fix {
        Fix {
            time: SourceTime { ns: 0 },
            position_deg: [latitude, longitude],
            height_m: 100.0,
            quality: PoseQuality::RtkFixed,
            position_std_m: [0.01, 0.02, 0.03],
            velocity_m_s: None,
            tilt_deg: [0.0, 0.0],
            heading_deg,
            attitude_std_deg: [0.1, 0.2, 0.3],
        }
    }

    fn pose(config: &Config, fix: &Fix) -> Pose {
        Placer::new(config).place(fix, Timestamp::from_ns(5)).unwrap()
    }

    /// Two fixes along the true heading of 37 degrees: the pose must look from the first to the second on the grid.
    #[test]
    fn a_vehicle_that_drives_along_its_heading_looks_where_it_goes_on_the_grid() {
        for (latitude, longitude) in [(60.0_f64, -78.3_f64), (60.0, -83.7), (-45.0, -78.3), (-45.0, -83.7)] {
            let config = Config { zone: "17N".into(), ..Config::default() };
            let heading = 37_f64.to_radians();
            let step_deg = 1e-4;
            // On the ellipsoid a degree of latitude and one of longitude have these lengths.
            let sin2 = latitude.to_radians().sin().powi(2);
            let w = 1.0 - 0.006_694_379_990_14 * sin2;
            let (m, n) = (6_378_137.0 * (1.0 - 0.006_694_379_990_14) / w.powf(1.5), 6_378_137.0 / w.sqrt());
            let east_deg = step_deg * heading.tan() * m / (n * latitude.to_radians().cos());
            let first = pose(&config, &fix(latitude, longitude, 37.0));
            let second = pose(&config, &fix(latitude + step_deg, longitude + east_deg, 37.0));
            let went = (second.easting_m - first.easting_m).atan2(second.northing_m - first.northing_m);
            assert!((went - first.yaw_rad).abs() < 1e-4, "{went} {} at {latitude} {longitude}", first.yaw_rad);
            assert!(first.convergence_rad.abs() > 1.5_f64.to_radians());
        }
    }

    #[test]
    fn the_lever_arm_is_taken_off_along_the_vehicles_axes() {
        // 2 m ahead, 1 m to the right and 3 m above the origin; heading east on the central meridian.
        let config = Config { antenna_m: [2.0, 1.0, -3.0], ..Config::default() };
        let at = fix(45.0, -81.0, 90.0);
        let (bare, levered) = (pose(&Config::default(), &at), pose(&config, &at));
        assert!((levered.easting_m - (bare.easting_m - 2.0)).abs() < 1e-9);
        assert!((levered.northing_m - (bare.northing_m + 1.0)).abs() < 1e-9);
        assert!((levered.altitude_m - 97.0).abs() < 1e-9);
        // The antenna is where the transform of the pose puts it.
        let back = levered.global_from_vehicle() * Point::new(2.0, 1.0, -3.0);
        assert!((back.x() - bare.easting_m).abs() < 1e-6 && (back.z() - 100.0).abs() < 1e-6);
    }

    #[test]
    fn signs_and_offsets_make_the_thesiss_attitude() {
        let config = Config { roll_sign: -1, pitch_offset_deg: 0.5, heading_offset_deg: 180.0, ..Config::default() };
        let pose = pose(&config, &Fix { tilt_deg: [2.0, 3.0], ..fix(0.0, -81.0, 200.0) });
        let degrees = [pose.roll_rad, pose.pitch_rad, pose.yaw_rad].map(f64::to_degrees);
        for (angle, expected) in degrees.into_iter().zip([-2.0, 3.5, 20.0]) {
            assert!((angle - expected).abs() < 1e-6, "{degrees:?}");
        }
    }

    #[test]
    fn the_zone_of_the_first_fix_that_can_be_placed_is_kept_across_the_border() {
        let mut placer = Placer::new(&Config::default());
        assert!(placer.place(&fix(88.0, 3.0, 0.0), Timestamp::default()).is_err());
        assert_eq!(placer.zone(), None);
        let zone = |placer: &mut Placer, longitude: f64| {
            let pose = placer.place(&fix(-33.0, longitude, 0.0), Timestamp::default()).unwrap();
            (pose.zone, pose.south, pose.easting_m)
        };
        let (number, south, west) = zone(&mut placer, 149.9999);
        let (same, _, east) = zone(&mut placer, 150.0001);
        assert_eq!((number, south, same), (55, 1, 55));
        assert!((east - west - 18.7).abs() < 0.1, "{}", east - west);
    }

    #[test]
    fn a_zone_from_before_is_kept_near_its_border_and_forgotten_far_away() {
        let check = |longitude: f64, expected: &str| {
            let mut placer = Placer::new(&Config::default());
            placer.remember(Zone { number: 17, south: false });
            placer.place(&fix(45.0, longitude, 0.0), Timestamp::default()).unwrap();
            assert_eq!(placer.zone().unwrap().to_string(), expected, "at {longitude}");
        };
        check(-77.5, "17N");
        check(-74.0, "18N");
        check(7.0, "32N");
    }

    #[test]
    fn yaw_is_wrapped() {
        use std::f64::consts::PI;
        assert_eq!(wrapped_rad(PI), PI);
        assert!((wrapped_rad(-PI) - PI).abs() < 1e-12);
        assert!((wrapped_rad(5.0) - (5.0 - 2.0 * PI)).abs() < 1e-12);
    }
}
