//! What the knowledge store reports, and what the newest snapshot alone showed.

use super::{Frame, Header, Kind, Writer};
use tsense_contract::{Detection, DetectionsHeader, Object, ObjectsHeader};
use tsense_geometry::Timestamp;

/// Payload: `u32` count, `u32` 1 where the answer was cut, `u64` objects in the store, then 56 bytes an object:
/// `u64` id, `f32[3]` foot, `f32` position sigma, DBH, its sigma, height, confidence, `f32` seconds since it was last
/// seen, `u32` sightings, `u8` class, `u8` reported, zeros.
pub fn objects_frame(head: &ObjectsHeader, objects: &[Object], origin_m: [f64; 3]) -> Frame {
    let header = Header { kind: Kind::Objects, zone: head.zone, south: head.south, stamp_ns: head.stamp_ns, origin_m };
    let mut writer = Writer::new(&header, 16 + 56 * objects.len());
    writer.u32(objects.len() as u32);
    writer.u32(u32::from(head.truncated));
    writer.u64(head.stored);
    for object in objects {
        writer.u64(object.id);
        writer.f32s(&header.relative([object.easting_m, object.northing_m, object.ground_m]));
        writer.f32s(&[object.position_std_m, object.dbh_m, object.dbh_std_m, object.height_m, object.confidence]);
        let seen = Timestamp::from_ns(object.last_seen_ns);
        writer.f32s(&[Timestamp::from_ns(head.stamp_ns).seconds_since(seen) as f32]);
        writer.u32(object.sightings);
        writer.bytes(&[object.class, object.reported, 0, 0, 0, 0, 0, 0]);
    }
    writer.finish()
}

/// Payload: `u32` count, `u32` zero, then 24 bytes a detection: `f32[3]` foot, `f32` DBH, `f32` confidence,
/// `u32` class.
pub fn detections_frame(head: &DetectionsHeader, detections: &[Detection], origin_m: [f64; 3]) -> Frame {
    let header =
        Header { kind: Kind::Detections, zone: head.zone, south: head.south, stamp_ns: head.stamp_ns, origin_m };
    let mut writer = Writer::new(&header, 8 + 24 * detections.len());
    writer.u32(detections.len() as u32);
    writer.u32(0);
    for seen in detections {
        writer.f32s(&header.relative([seen.easting_m, seen.northing_m, seen.ground_m]));
        writer.f32s(&[seen.dbh_m, seen.confidence]);
        writer.u32(u32::from(seen.class));
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn an_object_is_56_bytes_relative_to_the_origin() {
        let mut head = ObjectsHeader::zeroed();
        (head.stamp_ns, head.stored, head.truncated) = (3_500_000_000, 12, 1);
        let mut tree = Object::zeroed();
        (tree.id, tree.last_seen_ns, tree.sightings, tree.class, tree.reported) = (300, 1_000_000_000, 8, 1, 1);
        (tree.easting_m, tree.northing_m, tree.ground_m) = (369_010.25, 3_279_000.0, 31.5);
        (tree.dbh_m, tree.confidence) = (0.31, 2.5);
        let frame = objects_frame(&head, &[tree], [369_000.0, 3_279_000.0, 30.0]);
        let (_, payload) = parse(&frame).unwrap();
        assert_eq!(payload[..16], [1, 0, 0, 0, 1, 0, 0, 0, 12, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(payload[16..24], 300u64.to_le_bytes());
        let f32_at = |at: usize| f32::from_le_bytes(std::array::from_fn(|i| payload[at + i]));
        assert_eq!([24, 28, 32].map(f32_at), [10.25, 0.0, 1.5]);
        assert_eq!([40, 52, 56].map(f32_at), [0.31, 2.5, 2.5]);
        assert_eq!(payload[60..], [8, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn a_detection_is_24_bytes() {
        let mut tree = Detection::zeroed();
        (tree.easting_m, tree.confidence, tree.class) = (2.0, 0.5, 1);
        let frame = detections_frame(&DetectionsHeader::zeroed(), &[tree, tree], [0.0; 3]);
        let (_, payload) = parse(&frame).unwrap();
        assert_eq!(payload.len(), 8 + 2 * 24);
        assert_eq!(payload[24..32], [0, 0, 0, 63, 1, 0, 0, 0]);
    }
}
