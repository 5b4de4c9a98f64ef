//! The knowledge store's objects as vector objects of RA 3.x. EXPERIMENTAL.
//!
//! An object is a point with a buffer (half its diameter, else its position's deviation) and feature classes: 1000 plus
//! its class with the confidence, and 2001 to 2006 with what was measured. See `docs/jaus.md`.

use super::place::Place;
use tsense_contract::{Object, ObjectsHeader};
use tsense_jaus::message::objects::{
    Attribute, FeatureClass, ObjectPoint, POINT, QueryVectorObjects, Region, ReportVectorObjects, VectorObject,
};
use tsense_jaus::message::scaled::{SignedLatitude, SignedLongitude};

/// Feature class of a class of objects is this plus the class's number.
const CLASS_BASE: u16 = 1000;

/// What is known of an object; what was not measured is left out.
fn features(object: &Object) -> Vec<FeatureClass> {
    let measured = [
        (CLASS_BASE + u16::from(object.class), object.confidence),
        (2001, object.dbh_m),
        (2002, object.height_m),
        (2003, object.position_std_m),
    ];
    let floats = measured.into_iter().filter(|(_, value)| value.is_finite());
    let mut features: Vec<FeatureClass> =
        floats.map(|(id, value)| FeatureClass { id, attribute: Attribute::Float(value) }).collect();
    features.push(FeatureClass { id: 2004, attribute: Attribute::Double(object.ground_m) });
    features.push(FeatureClass { id: 2005, attribute: Attribute::UnsignedInteger(object.sightings) });
    features.push(FeatureClass { id: 2006, attribute: Attribute::Double(object.last_seen_ns as f64 / 1e9) });
    features
}

fn vector(object: &Object, place: &Place) -> Option<VectorObject> {
    let [latitude, longitude] = place.globe([object.easting_m, object.northing_m])?;
    let buffer_m = if object.dbh_m.is_finite() { object.dbh_m / 2.0 } else { object.position_std_m };
    Some(VectorObject {
        // RA 3.x has 32 bits; the store counts from 1 and has to run for long before these do not do.
        id: u32::try_from(object.id).ok()?,
        kind: POINT,
        buffer_m,
        features: features(object).into(),
        points: vec![ObjectPoint { latitude: SignedLatitude(latitude), longitude: SignedLongitude(longitude) }].into(),
    })
}

/// The objects that a query asks for, as many as a count of 16 bits can name.
pub fn report(
    (_, objects): (&ObjectsHeader, &[Object]),
    query: &QueryVectorObjects,
    place: &Place,
) -> ReportVectorObjects {
    let area = query.region.as_ref().map(|region| Area::of(region, place));
    let wanted = |object: &&Object| {
        query.ids.as_ref().is_none_or(|ids| ids.0.iter().any(|id| u64::from(*id) == object.id))
            && area.as_ref().is_none_or(|area| area.as_ref().is_some_and(|a| a.contains(object)))
            && query.features.as_ref().is_none_or(|ids| features(object).iter().any(|f| ids.0.contains(&f.id)))
    };
    let found = objects.iter().filter(wanted).filter_map(|object| vector(object, place));
    let found: Vec<VectorObject> = found.take(usize::from(u16::MAX)).collect();
    let count = found.len() as u16;
    ReportVectorObjects { request: query.request, count, objects: (query.response & 1 != 0).then_some(found) }
}

/// A rectangle in UTM around a region's points, its buffer added.
struct Area {
    min_m: [f64; 2],
    max_m: [f64; 2],
}

impl Area {
    fn of(region: &Region, place: &Place) -> Option<Self> {
        let mut area = Self { min_m: [f64::INFINITY; 2], max_m: [f64::NEG_INFINITY; 2] };
        for point in &region.points {
            let corner = place.utm([point.latitude.0, point.longitude.0])?;
            for (axis, at) in corner.into_iter().enumerate() {
                area.min_m[axis] = area.min_m[axis].min(at);
                area.max_m[axis] = area.max_m[axis].max(at);
            }
        }
        let buffer_m = region.buffer_m.map_or(0.0, f64::from);
        area.min_m = area.min_m.map(|m| m - buffer_m);
        area.max_m = area.max_m.map(|m| m + buffer_m);
        Some(area)
    }

    fn contains(&self, object: &Object) -> bool {
        let inside = |axis: usize, at: f64| (self.min_m[axis]..=self.max_m[axis]).contains(&at);
        inside(0, object.easting_m) && inside(1, object.northing_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use tsense_contract::Class;
    use tsense_jaus::Message;
    use tsense_jaus::message::List16;

    fn tree(id: u64, easting_m: f64) -> Object {
        let (northing_m, dbh_m) = (4_800_000.0, 0.3);
        let class = Class::Tree.to_wire();
        Object { id, easting_m, northing_m, dbh_m, height_m: f32::NAN, confidence: 4.0, class, ..Object::zeroed() }
    }

    fn ask(query: &QueryVectorObjects) -> ReportVectorObjects {
        let objects = [tree(7, 630_000.0), tree(8, 630_010.0), tree(1 << 40, 630_020.0)];
        let report = report((&ObjectsHeader::zeroed(), &objects), query, &Place::new(17, 0).unwrap());
        assert_eq!(ReportVectorObjects::from_bytes(&report.to_bytes()).unwrap().to_bytes(), report.to_bytes());
        report
    }

    fn ids(report: &ReportVectorObjects) -> Vec<u32> {
        report.objects.iter().flatten().map(|object| object.id).collect()
    }

    #[test]
    fn a_tree_is_a_point_with_half_its_diameter_around_it() {
        let report = ask(&QueryVectorObjects { response: 1, request: 5, ..Default::default() });
        assert_eq!((report.request, report.count, ids(&report)), (5, 2, vec![7, 8]));
        let tree = &report.objects.as_ref().unwrap()[0];
        assert_eq!(
            (tree.buffer_m, tree.features.0[0].clone()),
            (0.15, FeatureClass { id: 1001, attribute: Attribute::Float(4.0) })
        );
        assert!(tree.features.0.iter().all(|feature| feature.id != 2002), "no height was measured");
        let point = &tree.points.0[0];
        let back = Place::new(17, 0).unwrap().utm([point.latitude.0, point.longitude.0]).unwrap();
        assert!((back[0] - 630_000.0).abs() < 0.01 && (back[1] - 4_800_000.0).abs() < 0.01);
    }

    #[test]
    fn ids_regions_and_features_filter_and_without_the_objects_comes_their_number() {
        let ids_only = QueryVectorObjects { response: 1, ids: Some(List16(vec![8, 9])), ..Default::default() };
        assert_eq!(ids(&ask(&ids_only)), [8]);
        let [latitude, longitude] = Place::new(17, 0).unwrap().globe([630_001.0, 4_800_000.0]).unwrap();
        let points = vec![ObjectPoint { latitude: SignedLatitude(latitude), longitude: SignedLongitude(longitude) }];
        let region = Some(Region { kind: POINT, buffer_m: Some(2.0), points });
        assert_eq!(ids(&ask(&QueryVectorObjects { response: 1, region, ..Default::default() })), [7]);
        let rocks = QueryVectorObjects { features: Some(vec![1002].into()), ..Default::default() };
        assert_eq!((ask(&rocks).count, ask(&QueryVectorObjects::default()).objects), (0, None));
        assert_eq!(ask(&QueryVectorObjects::default()).count, 2);
    }
}
