//! One message of each type with every field filled, values that are exact and values that are not numbers.

use tsense_bridge::ros2::messages::*;

fn pose(at: f64) -> Pose {
    let position = Vector3 { x: at, y: -at, z: at / 3.0 };
    Pose { position, orientation: Quaternion { x: 0.1, y: -0.2, z: 0.3, w: 0.9 } }
}

fn header(frame: &str) -> Header {
    Header::new(1_700_000_000_123_456_789, frame)
}

fn covariance(first: f32) -> Covariance {
    Covariance::diagonal([first, 0.5, f32::NAN, 0.25, 2.0, 3.0])
}

fn dimension(label: &str, size: u32, stride: u32) -> MultiArrayDimension {
    MultiArrayDimension { label: label.into(), size, stride }
}

fn layer(data: Vec<f32>) -> Float32MultiArray {
    let dim = vec![dimension("column_index", 2, 6), dimension("row_index", 3, 3)];
    Float32MultiArray { layout: MultiArrayLayout { dim, data_offset: 0 }, data }
}

pub fn occupancy_grid() -> OccupancyGrid {
    let info = MapMetaData {
        map_load_time: Time { sec: 5, nanosec: 6 },
        resolution: 0.15,
        width: 3,
        height: 2,
        origin: pose(-12.5),
    };
    OccupancyGrid { header: header("map"), info, data: vec![-1, 0, 1, 50, 99, 100] }
}

pub fn grid_map() -> GridMap {
    GridMap {
        header: header("map"),
        info: GridMapInfo { resolution: 0.15, length_x: 0.45, length_y: 0.3, pose: pose(7.0) },
        layers: vec!["elevation".into(), "tree".into()],
        basic_layers: vec!["elevation".into()],
        data: vec![layer(vec![1.5, f32::NAN, 0.1, -2.0, 0.0, 3.25]), layer(vec![0.0, 1.0, f32::NAN, 1.0, 0.0, 1.0])],
        outer_start_index: 0,
        inner_start_index: 513,
    }
}

pub fn laser_scan() -> LaserScan {
    LaserScan {
        header: header("ladar"),
        angle_min: -2.356,
        angle_max: 2.356,
        angle_increment: 0.0087,
        time_increment: 2.79e-5,
        scan_time: 0.0201,
        range_min: 0.5,
        range_max: 50.0,
        ranges: vec![1.25, f32::INFINITY, f32::NAN, 49.5],
        intensities: vec![0.0, 255.0, 65535.0],
    }
}

pub fn point_cloud() -> PointCloud2 {
    let field = |name: &str, offset| PointField { name: name.into(), offset, datatype: 7, count: 1 };
    PointCloud2 {
        header: header("map"),
        height: 1,
        width: 2,
        fields: vec![field("x", 0), field("class", 12)],
        is_bigendian: false,
        point_step: 5,
        row_step: 10,
        data: (250..=255).chain(0..4).collect(),
        is_dense: true,
    }
}

pub fn detections() -> Detection3DArray {
    let detection = |id: &str| Detection3D {
        header: header("map"),
        results: vec![ObjectHypothesisWithPose {
            hypothesis: ObjectHypothesis { class_id: "tree".into(), score: 0.75 },
            pose: PoseWithCovariance { pose: pose(3.0), covariance: covariance(0.1) },
        }],
        bbox: BoundingBox3D { center: pose(4.0), size: Vector3 { x: 0.3, y: 0.3, z: 9.5 } },
        id: id.into(),
    };
    Detection3DArray { header: header("map"), detections: vec![detection("1"), detection("18446744073709551615")] }
}

pub fn transforms() -> TfMessage {
    let transform = |parent: &str, child: &str| TransformStamped {
        header: header(parent),
        child_frame_id: child.into(),
        transform: pose(-1.0).into(),
    };
    TfMessage { transforms: vec![transform("map", "odom"), transform("odom", "base_link")] }
}

pub fn odometry() -> Odometry {
    let twist = Twist { linear: Vector3 { x: 1.5, y: 0.0, z: -0.1 }, angular: Vector3 { x: 0.0, y: 0.01, z: -0.5 } };
    Odometry {
        header: header("odom"),
        child_frame_id: "base_link".into(),
        pose: PoseWithCovariance { pose: pose(100.25), covariance: covariance(0.02) },
        twist: TwistWithCovariance { twist, covariance: covariance(4.0) },
    }
}

pub fn diagnostics() -> DiagnosticArray {
    let value = |key: &str, value: &str| KeyValue { key: key.into(), value: value.into() };
    let status = DiagnosticStatus {
        level: 3,
        name: "tsense/mapper".into(),
        message: "no pose for 2 s, é".into(),
        hardware_id: String::new(),
        values: vec![value("in_hz", "49.7"), value("", "")],
    };
    DiagnosticArray { header: header(""), status: vec![status, DiagnosticStatus::default()] }
}
