//! NovAtel INSPVAX, INSPVA and INSPVAS logs, text and binary, become fixes. Framing and checksums are done before.
//!
//! INSPVAX gives the height above mean sea level and the undulation beside it, INSPVA the ellipsoidal height: what
//! leaves here is ellipsoidal. NovAtel's vehicle frame is x right, y forward, z up: roll is positive with the right
//! side down, pitch with the nose up, azimuth clockwise from true north, which are the signs of thesis (2-7).
//!
//! Source: wire format notes section 4.2 (OEM7 logs 507, 508, 1465).

use super::calendar::SourceTime;
use super::fix::Fix;
use super::nmea::Reject;
use tsense_contract::PoseQuality;

const INSPVA: u16 = 507;
const INSPVAS: u16 = 508;
const INSPVAX: u16 = 1465;
const INSPVA_BYTES: usize = 88;
const INSPVAX_BYTES: usize = 126;

/// INS status values that are used.
mod status {
    pub const HIGH_VARIANCE: u32 = 2;
    pub const GOOD: u32 = 3;
    pub const FREE: u32 = 6;
    pub const ALIGNMENT_COMPLETE: u32 = 7;
}

/// Names of the INS status in text logs, and their numbers.
const STATUS_NAMES: [(&str, u32); 6] = [
    ("INS_INACTIVE", 0),
    ("INS_ALIGNING", 1),
    ("INS_HIGH_VARIANCE", status::HIGH_VARIANCE),
    ("INS_SOLUTION_GOOD", status::GOOD),
    ("INS_SOLUTION_FREE", status::FREE),
    ("INS_ALIGNMENT_COMPLETE", status::ALIGNMENT_COMPLETE),
];
/// Position types of an inertial solution that say less than fixed: single point, differential, float.
const TYPE_NAMES: [(&str, u32); 5] =
    [("INS_SBAS", 52), ("INS_PSRSP", 53), ("INS_PSRDIFF", 54), ("INS_RTKFLOAT", 55), ("INS_RTKFIXED", 56)];

/// The fix in a binary log; none where it is another log.
pub fn from_binary(id: u16, week: u16, week_ms: u32, body: &[u8], gps_minus_utc_s: f64) -> Result<Option<Fix>, Reject> {
    match id {
        INSPVAX => {
            let body: &[u8; INSPVAX_BYTES] = body.try_into().map_err(|_| "INSPVAX of another length")?;
            let week_s = f64::from(week_ms) / 1e3;
            let time = SourceTime::from_gps(u32::from(week), week_s, gps_minus_utc_s).ok_or("impossible GPS time")?;
            inspvax(time, body).checked().map(Some)
        }
        INSPVA | INSPVAS => {
            let body: &[u8; INSPVA_BYTES] = body.try_into().map_err(|_| "INSPVA of another length")?;
            inspva(body, gps_minus_utc_s)?.checked().map(Some)
        }
        _ => Ok(None),
    }
}

fn inspvax(time: SourceTime, body: &[u8; INSPVAX_BYTES]) -> Ins {
    let u32_at = |at: usize| u32::from_le_bytes([body[at], body[at + 1], body[at + 2], body[at + 3]]);
    let f32_at = |at: usize| f64::from(f32::from_bits(u32_at(at)));
    let f64_at = |at: usize| f64::from_bits(u64::from(u32_at(at)) | u64::from(u32_at(at + 4)) << 32);
    Ins {
        time,
        status: u32_at(0),
        position_type: Some(u32_at(4)),
        position_deg: [f64_at(8), f64_at(16)],
        height_m: f64_at(24) + f32_at(32),
        north_east_up_m_s: [f64_at(36), f64_at(44), f64_at(52)],
        roll_pitch_azimuth_deg: [f64_at(60), f64_at(68), f64_at(76)],
        std: std::array::from_fn(|i| f32_at(84 + 4 * i)),
    }
}

fn inspva(body: &[u8; INSPVA_BYTES], gps_minus_utc_s: f64) -> Result<Ins, Reject> {
    let u32_at = |at: usize| u32::from_le_bytes([body[at], body[at + 1], body[at + 2], body[at + 3]]);
    let f64_at = |at: usize| f64::from_bits(u64::from(u32_at(at)) | u64::from(u32_at(at + 4)) << 32);
    Ok(Ins {
        time: SourceTime::from_gps(u32_at(0), f64_at(4), gps_minus_utc_s).ok_or("impossible GPS time")?,
        status: u32_at(84),
        position_type: None,
        position_deg: [f64_at(12), f64_at(20)],
        height_m: f64_at(28),
        north_east_up_m_s: [f64_at(36), f64_at(44), f64_at(52)],
        roll_pitch_azimuth_deg: [f64_at(60), f64_at(68), f64_at(76)],
        std: [f64::NAN; 9],
    })
}

/// The fix in a text log; none where it is another log.
pub fn from_text(text: &str, gps_minus_utc_s: f64) -> Result<Option<Fix>, Reject> {
    let Some((head, body)) = text.split_once(';') else { return Ok(None) };
    let head: Vec<&str> = head.split(',').collect();
    let body: Vec<&str> = body.split(',').collect();
    let ins = match head[0] {
        "INSPVAXA" => inspvax_text(&head, &body, gps_minus_utc_s)?,
        "INSPVAA" | "INSPVASA" => inspva_text(&body, gps_minus_utc_s)?,
        _ => return Ok(None),
    };
    ins.checked().map(Some)
}

fn inspvax_text(head: &[&str], body: &[&str], gps_minus_utc_s: f64) -> Result<Ins, Reject> {
    let number = |at: usize| number(body, at);
    let week = number_of(head.get(5))? as u32;
    Ok(Ins {
        time: SourceTime::from_gps(week, number_of(head.get(6))?, gps_minus_utc_s).ok_or("impossible GPS time")?,
        status: named(&STATUS_NAMES, body.first()),
        position_type: Some(named(&TYPE_NAMES, body.get(1))),
        position_deg: [number(2)?, number(3)?],
        height_m: number(4)? + number(5)?,
        north_east_up_m_s: [number(6)?, number(7)?, number(8)?],
        roll_pitch_azimuth_deg: [number(9)?, number(10)?, number(11)?],
        std: numbers_from(body, 12)?,
    })
}

fn inspva_text(body: &[&str], gps_minus_utc_s: f64) -> Result<Ins, Reject> {
    let number = |at: usize| number(body, at);
    Ok(Ins {
        time: SourceTime::from_gps(number(0)? as u32, number(1)?, gps_minus_utc_s).ok_or("impossible GPS time")?,
        status: named(&STATUS_NAMES, body.get(11)),
        position_type: None,
        position_deg: [number(2)?, number(3)?],
        height_m: number(4)?,
        north_east_up_m_s: [number(5)?, number(6)?, number(7)?],
        roll_pitch_azimuth_deg: [number(8)?, number(9)?, number(10)?],
        std: [f64::NAN; 9],
    })
}

fn number(fields: &[&str], at: usize) -> Result<f64, Reject> {
    number_of(fields.get(at))
}

fn number_of(field: Option<&&str>) -> Result<f64, Reject> {
    field.and_then(|text| text.trim().parse().ok()).ok_or("unreadable number")
}

fn numbers_from(fields: &[&str], first: usize) -> Result<[f64; 9], Reject> {
    let mut numbers = [f64::NAN; 9];
    for (i, slot) in numbers.iter_mut().enumerate() {
        *slot = number(fields, first + i)?;
    }
    Ok(numbers)
}

/// The number of a name; a name that is not known is a number that is not used.
fn named(names: &[(&str, u32)], field: Option<&&str>) -> u32 {
    let name = field.map_or("", |name| name.trim());
    names.iter().find(|(known, _)| *known == name).map_or(u32::MAX, |(_, number)| *number)
}

/// What both forms of all three logs hold.
struct Ins {
    time: SourceTime,
    status: u32,
    /// INSPVA does not say.
    position_type: Option<u32>,
    position_deg: [f64; 2],
    /// Above the ellipsoid.
    height_m: f64,
    north_east_up_m_s: [f64; 3],
    roll_pitch_azimuth_deg: [f64; 3],
    /// Latitude, longitude, height, metres; north, east, up, metres per second; roll, pitch, azimuth, degrees.
    std: [f64; 9],
}

impl Ins {
    fn quality(&self) -> Result<PoseQuality, Reject> {
        match (self.status, self.position_type) {
            (status::HIGH_VARIANCE | status::FREE, _) => Ok(PoseQuality::Degraded),
            (status::GOOD | status::ALIGNMENT_COMPLETE, None) => Ok(PoseQuality::RtkFixed),
            (status::GOOD | status::ALIGNMENT_COMPLETE, Some(kind)) => Ok(match kind {
                53 => PoseQuality::Single,
                // Satellite corrections, differential code, converging and converged precise point.
                52 | 54 | 73 | 74 | 79 | 80 => PoseQuality::Differential,
                55 => PoseQuality::RtkFloat,
                56 => PoseQuality::RtkFixed,
                _ => PoseQuality::Degraded,
            }),
            _ => Err("inertial solution not aligned"),
        }
    }

    fn checked(self) -> Result<Fix, Reject> {
        let quality = self.quality()?;
        let [latitude, longitude] = self.position_deg;
        let [north, east, up] = self.north_east_up_m_s;
        let [roll, pitch, azimuth] = self.roll_pitch_azimuth_deg;
        let all = [latitude, longitude, self.height_m, north, east, up, roll, pitch, azimuth];
        if !all.iter().all(|number| number.is_finite()) {
            return Err("value that is no number");
        }
        if latitude.abs() > 90.0 {
            return Err("latitude beyond 90 degrees");
        }
        if longitude.abs() > 360.0 {
            return Err("longitude beyond 180 degrees");
        }
        Ok(Fix {
            time: self.time,
            position_deg: self.position_deg,
            height_m: self.height_m,
            quality,
            position_std_m: [self.std[1], self.std[0], self.std[2]],
            velocity_m_s: Some([east, north, up]),
            tilt_deg: [roll, pitch],
            heading_deg: azimuth,
            attitude_std_deg: [self.std[6], self.std[7], self.std[8]],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::{Frame, Framer};
    use super::*;
    use proptest::prelude::*;

    #[allow(clippy::disallowed_methods, reason = "a test reads its golden file")]
    fn golden(name: &str) -> Option<Vec<u8>> {
        let path = format!("{}/../../shared/captures/{name}", env!("CARGO_MANIFEST_DIR"));
        let bytes = std::fs::read(&path).ok();
        if bytes.is_none() {
            eprintln!("SKIPPED: {path} not found");
        }
        bytes
    }

    fn decode(bytes: &[u8]) -> Fix {
        let mut framer = Framer::default();
        let frames = framer.push(bytes);
        assert_eq!((frames.len(), framer.losses()), (1, Default::default()));
        match &frames[0].frame {
            Frame::NovatelText(text) => from_text(text, 18.0).unwrap().unwrap(),
            Frame::NovatelBinary { id, week, week_ms, body } => {
                from_binary(*id, *week, *week_ms, body, 18.0).unwrap().unwrap()
            }
            frame => panic!("{frame:?}"),
        }
    }

    #[test]
    fn the_golden_inspvax_decodes_to_the_same_fix_as_text_and_binary() {
        let (Some(mut text), Some(binary)) = (golden("inspvax_golden.txt"), golden("inspvax_golden.bin")) else {
            return;
        };
        if !text.ends_with(b"\n") {
            text.extend(b"\r\n");
        }
        let (text, binary) = (decode(&text), decode(&binary));
        assert_eq!(text.position_deg, [51.116_378_734_03, -114.038_251_149_94]);
        assert_eq!(text.time, SourceTime::from_gps(1695, 309_428.0, 18.0).unwrap());
        assert_eq!(text.time, binary.time);
        assert!((text.height_m - (1063.6093 - 16.9)).abs() < 1e-9);
        assert!((binary.height_m - text.height_m).abs() < 1e-5, "the undulation is single precision");
        assert_eq!((text.quality, binary.quality), (PoseQuality::Single, PoseQuality::Single));
        assert_eq!(text.velocity_m_s, Some([-0.0464, -0.0845, -0.0127]), "east, north, up");
        assert_eq!(text.tilt_deg, [0.138_023_492, 0.069_459_386]);
        assert_eq!(text.heading_deg, 90.000_923_268);
        assert_eq!(text.position_std_m, [0.6688, 0.9428, 1.4746], "east, north, up");
        assert_eq!(text.attitude_std_deg, [0.944_295_466, 0.944_567_084, 1.000_131_845]);
        assert_eq!(binary.position_deg, text.position_deg);
        for i in 0..3 {
            assert!((binary.position_std_m[i] - text.position_std_m[i]).abs() < 1e-7);
            assert!((binary.attitude_std_deg[i] - text.attitude_std_deg[i]).abs() < 1e-7);
            assert_eq!(binary.velocity_m_s.unwrap()[i], text.velocity_m_s.unwrap()[i]);
        }
    }

    #[test]
    fn the_golden_inspva_decodes() {
        let Some(binary) = golden("inspva_golden.bin") else { return };
        let fix = decode(&binary);
        assert_eq!(fix.time, SourceTime::from_gps(2174, 397_710.0, 18.0).unwrap());
        assert_eq!(fix.position_deg, [51.150_445_629_51, -114.030_683_021_83]);
        assert_eq!(fix.height_m, 1079.6234);
        assert_eq!(fix.velocity_m_s, Some([0.0018, 0.002, -0.0026]));
        assert_eq!(fix.tilt_deg, [0.728_127_738, 0.536_322_202]);
        assert_eq!(fix.quality, PoseQuality::RtkFixed);
        assert!(fix.position_std_m.iter().all(|std| std.is_nan()));
    }

    #[test]
    fn the_inertial_status_decides_the_quality() {
        let check = |status: &str, expected: Result<PoseQuality, Reject>| {
            let log = format!("INSPVASA,2174,100.0;2174,100.0,45.0,7.0,500.0,1.0,2.0,0.1,3.0,-4.0,180.0,{status}");
            assert_eq!(from_text(&log, 18.0).map(|fix| fix.unwrap().quality), expected, "{status}");
        };
        check("INS_SOLUTION_GOOD", Ok(PoseQuality::RtkFixed));
        check("INS_ALIGNMENT_COMPLETE", Ok(PoseQuality::RtkFixed));
        check("INS_SOLUTION_FREE", Ok(PoseQuality::Degraded));
        check("INS_ALIGNING", Err("inertial solution not aligned"));
        check("INS_NEW_WORD", Err("inertial solution not aligned"));
    }

    proptest! {
        #[test]
        fn random_bodies_never_panic(id in prop_oneof![Just(507_u16), Just(508), Just(1465), any::<u16>()],
                                     body in proptest::collection::vec(any::<u8>(), 80..130),
                                     text in "INSPVA[XS]?A,.{0,40};.{0,80}") {
            let _ = from_binary(id, 2000, 5, &body, 18.0);
            let _ = from_text(&text, 18.0);
        }

        #[test]
        fn random_bodies_of_the_right_length_never_panic(body in proptest::collection::vec(any::<u8>(), 126)) {
            let _ = from_binary(1465, 2000, 5, &body, 18.0);
            let _ = from_binary(507, 2000, 5, &body[..88], 18.0);
        }
    }
}
