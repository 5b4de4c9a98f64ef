//! Where the vehicle is and where its head looks.

use super::{Frame, Header, Kind, Writer};
use tsense_contract::{Joint, Pose};

/// Payload, 64 bytes: `f32[3]` position, `f32[3]` roll, pitch, yaw (radians, yaw from grid north clockwise),
/// `f32[3]` velocity east, north, up, `f32[3]` position sigma, `f32` pan, `f32` tilt (radians), `u8` pose quality,
/// `u8` pose flags, `u8` joint flags, `u8` 1 where there is a joint, `u32` sweeps.
pub fn vehicle_frame(pose: &Pose, joint: Option<&Joint>, origin_m: [f64; 3]) -> Frame {
    let header = Header { kind: Kind::Vehicle, zone: pose.zone, south: pose.south, stamp_ns: pose.stamp_ns, origin_m };
    let mut writer = Writer::new(&header, 64);
    writer.f32s(&header.relative([pose.easting_m, pose.northing_m, pose.altitude_m]));
    writer.f32s(&[pose.roll_rad as f32, pose.pitch_rad as f32, pose.yaw_rad as f32]);
    writer.f32s(&pose.velocity_m_s);
    writer.f32s(&pose.position_std_m);
    let (pan_rad, tilt_rad) = joint.map_or((0.0, 0.0), |j| (j.pan_rad as f32, j.tilt_rad as f32));
    writer.f32s(&[pan_rad, tilt_rad]);
    writer.bytes(&[pose.quality, pose.flags, joint.map_or(0, |j| j.flags), u8::from(joint.is_some())]);
    writer.u32(joint.map_or(0, |j| j.sweep));
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn the_vehicle_is_64_bytes_and_a_missing_head_is_said() {
        let mut pose = Pose::zeroed();
        (pose.easting_m, pose.yaw_rad, pose.quality) = (369_001.5, 0.5, 5);
        let mut joint = Joint::zeroed();
        (joint.tilt_rad, joint.sweep) = (-0.25, 9);
        let frame = vehicle_frame(&pose, Some(&joint), [369_000.0, 0.0, 0.0]);
        let (_, payload) = parse(&frame).unwrap();
        assert_eq!(payload.len(), 64);
        assert_eq!(payload[..4], 1.5f32.to_le_bytes());
        assert_eq!(payload[20..24], 0.5f32.to_le_bytes());
        assert_eq!(payload[52..56], (-0.25f32).to_le_bytes());
        assert_eq!(payload[56..], [5, 0, 0, 1, 9, 0, 0, 0]);
        assert_eq!(parse(&vehicle_frame(&pose, None, [0.0; 3])).unwrap().1[59], 0);
    }
}
