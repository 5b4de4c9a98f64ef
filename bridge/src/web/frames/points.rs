//! The newest scan of one ladar, already placed in the world by the mapper.

use super::{Frame, Header, Kind, Writer};
use tsense_contract::{PlacedReturn, PointsHeader};

/// Payload: `f32[3]` the ladar, `u32` its index, `u32` count, `u32` zero, then `f32[3]` and `u32` a beam: the low
/// byte is its kind (contract `ReturnKind`), the high half its remission. Beams without an echo end at the usable
/// range: they belong to the fan, not to the points.
pub fn points_frame(points: &PointsHeader, beams: &[PlacedReturn]) -> Frame {
    let header = Header {
        kind: Kind::Points,
        zone: points.zone,
        south: points.south,
        stamp_ns: points.stamp_ns,
        origin_m: points.origin_m,
    };
    let mut writer = Writer::new(&header, 24 + 16 * beams.len());
    writer.f32s(&points.ladar_m);
    writer.u32(u32::from(points.ladar));
    writer.u32(beams.len() as u32);
    writer.u32(0);
    for beam in beams {
        writer.f32s(&beam.xyz_m);
        writer.u32(u32::from(beam.kind) | u32::from(beam.remission) << 16);
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn beams_keep_their_origin_kind_and_remission() {
        let mut header = PointsHeader::zeroed();
        (header.origin_m, header.ladar) = ([369_000.5, 3_279_000.25, 30.0], 1);
        let beam = PlacedReturn { xyz_m: [1.5, 0.0, -2.0], remission: 0x0102, kind: 1, reserved: 0 };
        let frame = points_frame(&header, &[beam]);
        let (head, payload) = parse(&frame).unwrap();
        assert_eq!(head.origin_m, header.origin_m);
        assert_eq!(payload[12..24], [1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(payload[24..28], 1.5f32.to_le_bytes());
        assert_eq!(payload[36..], [1, 0, 2, 1]);
    }
}
