//! A report of the global pose becomes a fix.
//!
//! In: degrees, metres above the ellipsoid, radians (roll right side down, pitch nose up, yaw clockwise from true north), a
//! time stamp that wraps each month. Out: a [`Fix`] in degrees. A report without position, altitude or yaw is none.

use crate::gpos::calendar::SourceTime;
use crate::gpos::config::Config;
use crate::gpos::fix::Fix;
use crate::gpos::nmea::Reject;
use tsense_contract::PoseQuality;
use tsense_geometry::Timestamp;
use tsense_jaus::message::pose::ReportGlobalPose;
use tsense_jaus::nearest_ns;

/// JAUS does not say how a position came about, only how good it is: one sigma, metres, and what that is called here.
const QUALITIES: [(f64, PoseQuality); 4] = [
    (0.1, PoseQuality::RtkFixed),
    (0.5, PoseQuality::RtkFloat),
    (1.5, PoseQuality::Differential),
    (10.0, PoseQuality::Single),
];

/// The fix of a report that arrived at `arrival`.
pub fn fix_of(report: &ReportGlobalPose, arrival: Timestamp, config: &Config) -> Result<Fix, Reject> {
    let (Some(latitude), Some(longitude)) = (report.latitude, report.longitude) else { return Err("no position") };
    let height_m = report.altitude.ok_or("no altitude")?.0;
    let heading_deg = report.yaw.ok_or("no heading")?.0.to_degrees();
    let ns = match report.time {
        Some(stamp) => nearest_ns(stamp, arrival.ns).ok_or("impossible time stamp")?,
        // Better late than never: the instant of the datagram.
        None => arrival.ns,
    };
    let position_std_m = report.position_rms.map_or(f64::NAN, |rms| rms.0);
    let attitude_std_deg = report.attitude_rms.map_or(f64::NAN, |rms| rms.0.to_degrees());
    // Where the source does not say how it lies, it lies flat as far as anybody knows.
    let tilt = |angle: Option<_>| match angle {
        Some(tsense_jaus::message::scaled::Angle16(rad)) => (rad.to_degrees(), attitude_std_deg),
        None => (0.0, config.unknown_tilt_std_deg),
    };
    let ((roll_deg, roll_std_deg), (pitch_deg, pitch_std_deg)) = (tilt(report.roll), tilt(report.pitch));
    Ok(Fix {
        time: SourceTime { ns },
        position_deg: [latitude.0, longitude.0],
        height_m,
        quality: quality(position_std_m),
        position_std_m: [position_std_m; 3],
        velocity_m_s: None,
        tilt_deg: [roll_deg, pitch_deg],
        heading_deg,
        attitude_std_deg: [roll_std_deg, pitch_std_deg, attitude_std_deg],
    })
}

fn quality(std_m: f64) -> PoseQuality {
    if std_m.is_nan() {
        return PoseQuality::Single;
    }
    QUALITIES.iter().find(|(most_m, _)| std_m <= *most_m).map_or(PoseQuality::Degraded, |(_, quality)| *quality)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_jaus::Message;

    fn hex(text: &str) -> Vec<u8> {
        (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).unwrap()).collect()
    }

    /// 2026-11-21 02:55:35 UTC: three quarters of a second behind the golden vector's stamp.
    const ARRIVAL: Timestamp = Timestamp::from_ns(1_795_229_735_000_000_000);

    #[test]
    fn the_golden_pose_is_a_fix_in_degrees_at_its_own_instant() {
        let bytes = hex("0244ff01d20252aaa88c7f455f7321399cc4200068802f7f1dbd2a00fa88b7a8");
        let fix = fix_of(&ReportGlobalPose::from_bytes(&bytes).unwrap(), ARRIVAL, &Config::default()).unwrap();
        let near = |a: f64, b: f64, off: f64| assert!((a - b).abs() <= off, "{a} is not {b}");
        near(fix.position_deg[0], 29.7565, 5e-8);
        near(fix.position_deg[1], -82.2681, 9e-8);
        near(fix.height_m, 42.5, 1e-5);
        near(fix.tilt_deg[0], 0.01_f64.to_degrees(), 0.003);
        near(fix.tilt_deg[1], -0.02_f64.to_degrees(), 0.003);
        near(fix.heading_deg, 1.5_f64.to_degrees(), 0.003);
        assert_eq!((fix.quality, fix.time.ns), (PoseQuality::RtkFixed, ARRIVAL.ns - 750_000_000));
    }

    #[test]
    fn a_pose_without_tilt_lies_flat_with_its_doubt_and_one_without_place_is_none() {
        let bytes = hex("02444301841dd94fc0e787ebc505fa88b7a8");
        let report = ReportGlobalPose::from_bytes(&bytes).unwrap();
        assert_eq!(fix_of(&report, ARRIVAL, &Config::default()), Err("no altitude"));
        let high = ReportGlobalPose { altitude: Some(Default::default()), ..report.clone() };
        let fix = fix_of(&high, ARRIVAL, &Config::default()).unwrap();
        assert_eq!((fix.tilt_deg, fix.attitude_std_deg[0], fix.quality), ([0.0; 2], 10.0, PoseQuality::Single));
        assert_eq!(
            fix_of(&ReportGlobalPose { latitude: None, ..high.clone() }, ARRIVAL, &Config::default()),
            Err("no position")
        );
        let strange = ReportGlobalPose { time: Some(0), ..high };
        assert_eq!(fix_of(&strange, ARRIVAL, &Config::default()), Err("impossible time stamp"));
    }
}
