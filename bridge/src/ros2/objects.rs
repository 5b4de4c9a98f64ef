//! What the knowledge store believes as vision_msgs/Detection3DArray. Pure.
//!
//! In: topic `objects`. Out: one detection an object in the frame `map`, with its class, its position's variance and a box
//! that stands on the ground. What was not measured (a diameter, a height) is zero in the box.

use super::frames::at;
use super::messages::{
    BoundingBox3D, Covariance, Detection3D, Detection3DArray, Header, ObjectHypothesis, ObjectHypothesisWithPose,
    PoseWithCovariance, Vector3,
};
use tsense_contract::{Class, Object, ObjectsHeader};

/// The reported objects.
pub fn detections(header: &ObjectsHeader, objects: &[Object], origin_m: [f64; 3], frame: &str) -> Detection3DArray {
    let header = Header::new(header.stamp_ns, frame);
    let detections = objects.iter().map(|object| detection(object, &header, origin_m)).collect();
    Detection3DArray { detections, header }
}

fn detection(object: &Object, header: &Header, origin_m: [f64; 3]) -> Detection3D {
    let measured = |value: f32| if value.is_finite() { f64::from(value) } else { 0.0 };
    let (diameter_m, height_m) = (measured(object.dbh_m), measured(object.height_m));
    let foot = [object.easting_m - origin_m[0], object.northing_m - origin_m[1], object.ground_m - origin_m[2]];
    let center = at(foot[0], foot[1], foot[2] + height_m / 2.0);
    let (sigma, unknown) = (object.position_std_m, f32::NAN);
    let pose = PoseWithCovariance {
        pose: at(foot[0], foot[1], foot[2]),
        covariance: Covariance::diagonal([sigma, sigma, unknown, unknown, unknown, unknown]),
    };
    // The store sums confidences, so that they pass 1; ROS wants a score.
    let score = measured(object.confidence).clamp(0.0, 1.0);
    let hypothesis = ObjectHypothesis { class_id: Class::from_wire(object.class).as_str().into(), score };
    Detection3D {
        header: header.clone(),
        results: vec![ObjectHypothesisWithPose { hypothesis, pose }],
        bbox: BoundingBox3D { center, size: Vector3 { x: diameter_m, y: diameter_m, z: height_m } },
        id: object.id.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_tree_stands_with_its_foot_on_the_ground_and_its_box_around_it() {
        let object = Object {
            id: 17,
            easting_m: 500_003.0,
            northing_m: 4_000_001.0,
            ground_m: 102.0,
            position_std_m: 0.1,
            dbh_m: 0.4,
            height_m: 8.0,
            confidence: 2.5,
            class: Class::Tree.to_wire(),
            ..Object::zeroed()
        };
        let unmeasured = Object { height_m: f32::NAN, dbh_m: f32::NAN, ..object };
        let list = detections(&ObjectsHeader::zeroed(), &[object, unmeasured], [500_000.0, 4_000_000.0, 100.0], "map");
        let tree = &list.detections[0];
        assert_eq!((tree.id.as_str(), tree.results[0].hypothesis.class_id.as_str()), ("17", "tree"));
        assert_eq!(tree.results[0].hypothesis.score, 1.0);
        assert_eq!(tree.results[0].pose.pose, at(3.0, 1.0, 2.0));
        assert!((tree.results[0].pose.covariance.0[7] - 0.01).abs() < 1e-8);
        assert_eq!(tree.bbox.center, at(3.0, 1.0, 6.0));
        assert!((tree.bbox.size.x - 0.4).abs() < 1e-7 && tree.bbox.size.z == 8.0);
        assert_eq!(list.detections[1].bbox.size, Vector3::default());
        assert_eq!(list.detections[1].bbox.center, at(3.0, 1.0, 2.0));
    }
}
