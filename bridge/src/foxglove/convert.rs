//! ROS messages as Foxglove ones: FrameTransforms, PointCloud, Grid, SceneUpdate, LaserScan. Pure.
//!
//! In: messages of the translator. Out: the same at the same place, with the colours of the page, so that nothing needs to
//! be set to see it. Stamps before 1970 become 1970.

use crate::ros2::cloud::POINT_BYTES;
use crate::ros2::grid::{BRUSH_DENSITY, BRUSH_HEIGHT};
use crate::ros2::messages::{Detection3DArray, GridMap, Header, OccupancyGrid, PointCloud2, Pose, TfMessage};
use crate::ros2::{messages as ros, messages::Vector3};
use foxglove::messages as fox;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    CubePrimitive, CylinderPrimitive, FrameTransform, FrameTransforms, Grid, LaserScan, PackedElementField, PointCloud,
    SceneEntity, SceneUpdate, TextPrimitive,
};

/// Bytes of a point: three f32, four colours, class, confidence.
const POINT_STRIDE: usize = 18;
/// Bytes of a grid cell: four colours, cost.
const CELL_STRIDE: usize = 5;
/// Bytes of a cell of brush: four colours, decimetres, percent.
const BRUSH_STRIDE: usize = 6;

/// Colours of the classes of [`crate::ros2::cloud::PointClass`], as on the page; what hangs above lets one look through.
const CLASS_COLOURS: [[u8; 4]; 7] = [
    [0xb9, 0xbe, 0xb4, 160],
    [0x8c, 0xbf, 0x63, 255],
    [0x2f, 0x6a, 0x36, 255],
    [0x7a, 0x3f, 0xb0, 255],
    [0x8d, 0x80, 0x78, 255],
    [0xc2, 0x55, 0x2d, 255],
    [0xa7, 0xb3, 0x94, 90],
];

/// An instant.
fn instant(header: &Header) -> Option<fox::Timestamp> {
    fox::Timestamp::new_checked(u32::try_from(header.stamp.sec).unwrap_or(0), header.stamp.nanosec)
}

fn vector(v: &Vector3) -> Option<fox::Vector3> {
    Some(fox::Vector3 { x: v.x, y: v.y, z: v.z })
}

fn quaternion(q: &ros::Quaternion) -> Option<fox::Quaternion> {
    Some(fox::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w })
}

fn pose(pose: &Pose) -> Option<fox::Pose> {
    Some(fox::Pose { position: vector(&pose.position), orientation: quaternion(&pose.orientation) })
}

fn colour([r, g, b, a]: [u8; 4]) -> Option<fox::Color> {
    let share = |byte: u8| f64::from(byte) / 255.0;
    Some(fox::Color { r: share(r), g: share(g), b: share(b), a: share(a) })
}

fn fields(named: &[(&str, NumericType)]) -> Vec<PackedElementField> {
    let mut offset = 0;
    let field = |(name, kind): &(&str, NumericType)| {
        let field = PackedElementField { name: (*name).into(), offset, r#type: *kind as i32 };
        offset += if *kind == NumericType::Float32 { 4 } else { 1 };
        field
    };
    named.iter().map(field).collect()
}

/// The transforms.
pub fn transforms(message: &TfMessage) -> FrameTransforms {
    let transform = |t: &ros::TransformStamped| FrameTransform {
        timestamp: instant(&t.header),
        parent_frame_id: t.header.frame_id.clone(),
        child_frame_id: t.child_frame_id.clone(),
        translation: vector(&t.transform.translation),
        rotation: quaternion(&t.transform.rotation),
    };
    FrameTransforms { transforms: message.transforms.iter().map(transform).collect() }
}

/// The voxels, coloured by class.
pub fn point_cloud(message: &PointCloud2) -> PointCloud {
    let mut data = Vec::with_capacity(message.width as usize * POINT_STRIDE);
    for point in message.data.chunks_exact(POINT_BYTES) {
        let (class, confidence) = (point[12], point[13]);
        data.extend_from_slice(&point[..12]);
        data.extend(CLASS_COLOURS.get(usize::from(class)).unwrap_or(&CLASS_COLOURS[0]));
        data.extend([class, confidence]);
    }
    use NumericType::{Float32, Uint8};
    let named = [("x", Float32), ("y", Float32), ("z", Float32)].into_iter();
    let bytes = ["red", "green", "blue", "alpha", "class", "confidence"].map(|name| (name, Uint8));
    PointCloud {
        timestamp: instant(&message.header),
        frame_id: message.header.frame_id.clone(),
        pose: pose(&crate::ros2::frames::at(0.0, 0.0, 0.0)),
        point_stride: POINT_STRIDE as u32,
        fields: fields(&named.chain(bytes).collect::<Vec<_>>()),
        data: data.into(),
    }
}

/// The costs: green to red, lethal dark, unknown not drawn.
pub fn grid(message: &OccupancyGrid) -> Grid {
    let cell = |cost: &i8| {
        let [r, g, b, a] = cost_colour(*cost);
        [r, g, b, a, cost.cast_unsigned()]
    };
    let edge = f64::from(message.info.resolution);
    Grid {
        timestamp: instant(&message.header),
        frame_id: message.header.frame_id.clone(),
        pose: pose(&message.info.origin),
        column_count: message.info.width,
        cell_size: Some(fox::Vector2 { x: edge, y: edge }),
        row_stride: message.info.width * CELL_STRIDE as u32,
        cell_stride: CELL_STRIDE as u32,
        fields: fields(&["red", "green", "blue", "alpha", "cost"].map(|name| (name, NumericType::Uint8))),
        data: message.data.iter().flat_map(cell).collect::<Vec<_>>().into(),
    }
}

/// The brush of a grid map: green, the denser the less one sees through it; where none is known nothing is drawn.
pub fn brush(message: &GridMap) -> Grid {
    let layer = |name: &str| {
        let at = message.layers.iter().position(|layer| layer == name);
        at.and_then(|at| message.data.get(at)).map_or(&[][..], |layer| &layer.data)
    };
    let cell = |(height_m, density): (&f32, &f32)| {
        let [r, g, b, _] = CLASS_COLOURS[2];
        let alpha = if *height_m > 0.0 { (55.0 + 200.0 * density.max(0.0)) as u8 } else { 0 };
        // Small numbers: messages that wait for a slow client are counted, not weighed.
        let [height_dm, density_pct] = [height_m * 10.0, density * 100.0]
            .map(|value| if value.is_nan() { u8::MAX } else { value.round().min(254.0) as u8 });
        [r, g, b, alpha, height_dm, density_pct]
    };
    let (info, mut corner) = (&message.info, message.info.pose.clone());
    corner.position.x -= info.length_x / 2.0;
    corner.position.y -= info.length_y / 2.0;
    let columns = (info.length_x / info.resolution).round() as u32;
    let names = ["red", "green", "blue", "alpha", "brush_height_dm", "brush_density_pct"];
    // A grid map begins in the north-east and goes west, then south; a grid in the south-west and goes east, then north.
    let cells = layer(BRUSH_HEIGHT).iter().zip(layer(BRUSH_DENSITY)).rev();
    Grid {
        timestamp: instant(&message.header),
        frame_id: message.header.frame_id.clone(),
        pose: pose(&corner),
        column_count: columns,
        cell_size: Some(fox::Vector2 { x: info.resolution, y: info.resolution }),
        row_stride: columns * BRUSH_STRIDE as u32,
        cell_stride: BRUSH_STRIDE as u32,
        fields: fields(&names.map(|name| (name, NumericType::Uint8))),
        data: cells.flat_map(cell).collect::<Vec<_>>().into(),
    }
}

fn cost_colour(cost: i8) -> [u8; 4] {
    match cost {
        0..=99 => {
            let share = cost.cast_unsigned() * 2;
            [55 + share, 200 - share, 60, 150]
        }
        100.. => [90, 20, 30, 200],
        _ => [0, 0, 0, 0],
    }
}

/// The objects as one entity, which replaces the one before: trees as trunks with their number, others as boxes.
pub fn scene(message: &Detection3DArray) -> SceneUpdate {
    let mut entity = SceneEntity {
        timestamp: instant(&message.header),
        frame_id: message.header.frame_id.clone(),
        id: "objects".into(),
        ..SceneEntity::default()
    };
    for object in &message.detections {
        let class = object.results.first().map_or("", |result| result.hypothesis.class_id.as_str());
        let (center, size) = (pose(&object.bbox.center), drawn_size(&object.bbox.size));
        if class == "tree" {
            let color = colour(CLASS_COLOURS[3]);
            entity.cylinders.push(CylinderPrimitive { pose: center, size, bottom_scale: 1.0, top_scale: 0.6, color });
        } else {
            entity.cubes.push(CubePrimitive { pose: center, size, color: colour(CLASS_COLOURS[4]) });
        }
        entity.texts.push(label(object, class));
    }
    SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
}

/// What was not measured is drawn small, and not at all nothing.
fn drawn_size(size: &Vector3) -> Option<fox::Vector3> {
    let at_least = |value: f64, least: f64| if value > 0.0 { value } else { least };
    vector(&Vector3 { x: at_least(size.x, 0.2), y: at_least(size.y, 0.2), z: at_least(size.z, 0.5) })
}

fn label(object: &ros::Detection3D, class: &str) -> TextPrimitive {
    let mut at = object.bbox.center.clone();
    at.position.z += object.bbox.size.z / 2.0 + 0.3;
    let diameter_cm = object.bbox.size.x * 100.0;
    let measured = if diameter_cm > 0.0 { format!(" {diameter_cm:.0} cm") } else { String::new() };
    TextPrimitive {
        pose: pose(&at),
        billboard: true,
        font_size: 0.35,
        scale_invariant: false,
        color: colour([20, 20, 20, 255]),
        text: format!("{class} {}{measured}", object.id),
    }
}

/// A scan in its ladar's own frame.
pub fn scan(message: &ros::LaserScan) -> LaserScan {
    LaserScan {
        timestamp: instant(&message.header),
        frame_id: message.header.frame_id.clone(),
        pose: pose(&crate::ros2::frames::at(0.0, 0.0, 0.0)),
        start_angle: f64::from(message.angle_min),
        end_angle: f64::from(message.angle_max),
        ranges: message.ranges.iter().map(|range| f64::from(*range)).collect(),
        intensities: message.intensities.iter().map(|strength| f64::from(*strength)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::cloud::{PointClass, VoxelPoint};
    use crate::ros2::frames::at;
    use bytemuck::Zeroable;

    #[test]
    fn a_point_keeps_its_place_and_gets_the_colour_of_its_class() {
        let point = VoxelPoint { xyz_m: [1.0, 2.0, 3.0], class: PointClass::Tree, confidence: 9 };
        let cloud = point_cloud(&crate::ros2::cloud::point_cloud(&Zeroable::zeroed(), &[point], "map"));
        assert_eq!(cloud.data.len(), POINT_STRIDE);
        assert_eq!(cloud.data[8..], [0, 0, 0x40, 0x40, 0x7a, 0x3f, 0xb0, 255, 3, 9]);
        let offsets: Vec<_> = cloud.fields.iter().map(|field| field.offset).collect();
        assert_eq!(offsets, [0, 4, 8, 12, 13, 14, 15, 16, 17]);
    }

    #[test]
    fn unknown_cells_are_not_drawn_and_lethal_ones_are() {
        let message = OccupancyGrid { data: vec![-1, 0, 99, 100], ..OccupancyGrid::default() };
        let alphas: Vec<_> = grid(&message).data.chunks(CELL_STRIDE).map(|cell| (cell[3], cell[4])).collect();
        assert_eq!(alphas, [(0, 255), (150, 0), (150, 99), (200, 100)]);
    }

    #[test]
    fn a_tree_is_a_trunk_and_all_objects_are_one_entity() {
        let object = |class: &str| ros::Detection3D {
            results: vec![ros::ObjectHypothesisWithPose {
                hypothesis: ros::ObjectHypothesis { class_id: class.into(), score: 1.0 },
                ..Default::default()
            }],
            bbox: ros::BoundingBox3D { center: at(1.0, 2.0, 4.0), size: Vector3 { x: 0.3, y: 0.3, z: 8.0 } },
            id: "17".into(),
            ..Default::default()
        };
        let message = Detection3DArray { detections: vec![object("tree"), object("rock")], ..Default::default() };
        let entities = scene(&message).entities;
        assert_eq!((entities.len(), entities[0].cylinders.len(), entities[0].cubes.len()), (1, 1, 1));
        assert_eq!(entities[0].texts[0].text, "tree 17 30 cm");
        assert_eq!(entities[0].texts[0].pose.as_ref().unwrap().position.as_ref().unwrap().z, 8.3);
    }
}
