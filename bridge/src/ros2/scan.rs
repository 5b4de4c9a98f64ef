//! A scan as sensor_msgs/LaserScan. Pure.
//!
//! In: topic `scan`, device angles counter-clockwise from the right. Out: angles counter-clockwise from straight ahead in
//! the ladar's own frame (x ahead, y left), the stamp of the first beam, and ranges as REP-117 wants them: +inf for a beam
//! without an echo, NaN for one that says nothing.

use super::messages::{Header, LaserScan};
use std::f64::consts::FRAC_PI_2;
use tsense_contract::{Return, ReturnKind, ScanHeader};

/// What a scan does not say of its device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanLimits {
    /// Nearest range that is a measurement, metres.
    pub range_min_m: f64,
    /// Farthest, metres.
    pub range_max_m: f64,
}

/// One mirror turn. The time between two scans is that of a full turn at the measured beam interval.
pub fn laser_scan(header: &ScanHeader, returns: &[Return], limits: ScanLimits, frame: &str) -> LaserScan {
    let steps = returns.len().saturating_sub(1) as f64;
    let first_rad = header.start_rad - FRAC_PI_2;
    let beams_per_turn = std::f64::consts::TAU / header.step_rad;
    LaserScan {
        header: Header::new(header.stamp_ns, frame),
        angle_min: first_rad as f32,
        angle_max: (first_rad + steps * header.step_rad) as f32,
        angle_increment: header.step_rad as f32,
        time_increment: (header.beam_interval_ns * 1e-9) as f32,
        scan_time: (beams_per_turn * header.beam_interval_ns * 1e-9) as f32,
        range_min: limits.range_min_m as f32,
        range_max: limits.range_max_m as f32,
        ranges: returns.iter().map(range_m).collect(),
        intensities: match header.has_remission {
            0 => Vec::new(),
            _ => returns.iter().map(|beam| f32::from(beam.remission)).collect(),
        },
    }
}

fn range_m(beam: &Return) -> f32 {
    match beam.kind() {
        ReturnKind::Echo => beam.distance_mm as f32 * 1e-3,
        ReturnKind::NoReturn => f32::INFINITY,
        ReturnKind::Dazzled | ReturnKind::TooWeak | ReturnKind::Reserved => f32::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_scan_of_541_beams_looks_from_135_right_to_135_left() {
        let mut header = ScanHeader::zeroed();
        header.start_rad = (-45.0_f64).to_radians();
        header.step_rad = 0.5_f64.to_radians();
        header.beam_interval_ns = 27_937.0;
        header.has_remission = 1;
        let mut returns = vec![Return { distance_mm: 2500, remission: 80, kind: 0, code: 0 }; 541];
        returns[1].kind = ReturnKind::NoReturn.to_wire();
        returns[2].kind = ReturnKind::TooWeak.to_wire();
        let scan = laser_scan(&header, &returns, ScanLimits { range_min_m: 0.5, range_max_m: 50.0 }, "ladar");
        let degrees = |rad: f32| f64::from(rad).to_degrees();
        assert!((degrees(scan.angle_min) + 135.0).abs() < 1e-4 && (degrees(scan.angle_max) - 135.0).abs() < 1e-4);
        assert!((scan.scan_time - 0.020_114_64).abs() < 1e-7, "{}", scan.scan_time);
        assert_eq!((scan.ranges[0], scan.ranges[1]), (2.5, f32::INFINITY));
        assert!(scan.ranges[2].is_nan());
        assert_eq!(scan.intensities[0], 80.0);
    }
}
