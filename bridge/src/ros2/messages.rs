//! The ROS 2 messages that are published, field by field in their order on the wire. Plain data; as JSON they can be
//! compared with what a foreign peer received.
//!
//! Source: the `.msg` files of the packages named by each type; the type hashes are those of REP-2016 and are the same
//! in Jazzy, Kilted and Rolling. A message that changed in a later release would have another hash there.

use super::cdr::{Cdr, CdrWriter};

/// A message with a topic of its own.
pub trait RosMessage: Cdr + Into<AnyMessage> {
    /// Package, `msg`, type.
    const TYPE: &'static str;
    /// REP-2016 hash of its definition.
    const HASH: &'static str;

    /// As it goes over the wire.
    fn to_cdr(&self) -> Vec<u8> {
        let mut out = CdrWriter::new();
        self.write(&mut out);
        out.into_bytes()
    }
}

macro_rules! part {
    ($($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $kind:ty,)+ })+) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
        #[allow(missing_docs, reason = "the fields are documented by ROS")]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $kind,)+
        }

        impl Cdr for $name {
            fn write(&self, out: &mut CdrWriter) {
                $(self.$field.write(out);)+
            }
        }
    )+};
}

macro_rules! top {
    ($($name:ident = $type:literal $hash:literal,)+) => {
        $(impl RosMessage for $name {
            const TYPE: &'static str = $type;
            const HASH: &'static str = concat!("RIHS01_", $hash);
        }

        impl From<$name> for AnyMessage {
            fn from(message: $name) -> Self {
                Self::$name(message)
            }
        }
        )+

        /// A message of any topic.
        #[derive(Clone, Debug, PartialEq)]
        #[allow(missing_docs, reason = "named after the messages")]
        #[allow(clippy::large_enum_variant, reason = "a handful exist at a time; what is large lies in their vectors")]
        pub enum AnyMessage {
            $($name($name),)+
        }

        impl AnyMessage {
            /// As it goes over the wire.
            pub fn to_cdr(&self) -> Vec<u8> {
                match self {
                    $(Self::$name(message) => message.to_cdr(),)+
                }
            }
        }
    };
}

top! {
    OccupancyGrid = "nav_msgs/msg/OccupancyGrid" "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    GridMap = "grid_map_msgs/msg/GridMap" "343b0e72887541beda6b035cc053f2d6fffaad9d6dcb2773c15a808dfca31fde",
    LaserScan = "sensor_msgs/msg/LaserScan" "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    PointCloud2 = "sensor_msgs/msg/PointCloud2" "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    Detection3DArray = "vision_msgs/msg/Detection3DArray" "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018",
    TfMessage = "tf2_msgs/msg/TFMessage" "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    Odometry = "nav_msgs/msg/Odometry" "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray" "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}

part! {
    /// builtin_interfaces/Time
    Time { sec: i32, nanosec: u32, }
    /// std_msgs/Header
    Header { stamp: Time, frame_id: String, }
    /// geometry_msgs/Point and geometry_msgs/Vector3
    Vector3 { x: f64, y: f64, z: f64, }
    /// geometry_msgs/Quaternion
    Quaternion { x: f64, y: f64, z: f64, w: f64, }
    /// geometry_msgs/Transform
    Transform { translation: Vector3, rotation: Quaternion, }
    /// geometry_msgs/Pose
    Pose { position: Vector3, orientation: Quaternion, }
    /// geometry_msgs/PoseWithCovariance
    PoseWithCovariance { pose: Pose, covariance: Covariance, }
    /// geometry_msgs/Twist
    Twist { linear: Vector3, angular: Vector3, }
    /// geometry_msgs/TwistWithCovariance
    TwistWithCovariance { twist: Twist, covariance: Covariance, }
    /// geometry_msgs/TransformStamped
    TransformStamped { header: Header, child_frame_id: String, transform: Transform, }
    /// tf2_msgs/TFMessage
    TfMessage { transforms: Vec<TransformStamped>, }
    /// nav_msgs/Odometry
    Odometry { header: Header, child_frame_id: String, pose: PoseWithCovariance, twist: TwistWithCovariance, }
    /// nav_msgs/MapMetaData
    MapMetaData { map_load_time: Time, resolution: f32, width: u32, height: u32, origin: Pose, }
    /// nav_msgs/OccupancyGrid
    OccupancyGrid { header: Header, info: MapMetaData, data: Vec<i8>, }
    /// grid_map_msgs/GridMapInfo
    GridMapInfo { resolution: f64, length_x: f64, length_y: f64, pose: Pose, }
    /// std_msgs/MultiArrayDimension
    MultiArrayDimension { label: String, size: u32, stride: u32, }
    /// std_msgs/MultiArrayLayout
    MultiArrayLayout { dim: Vec<MultiArrayDimension>, data_offset: u32, }
    /// std_msgs/Float32MultiArray
    Float32MultiArray { layout: MultiArrayLayout, data: Vec<f32>, }
    /// grid_map_msgs/GridMap
    GridMap {
        header: Header,
        info: GridMapInfo,
        layers: Vec<String>,
        basic_layers: Vec<String>,
        data: Vec<Float32MultiArray>,
        outer_start_index: u16,
        inner_start_index: u16,
    }
    /// sensor_msgs/LaserScan
    LaserScan {
        header: Header,
        angle_min: f32,
        angle_max: f32,
        angle_increment: f32,
        time_increment: f32,
        scan_time: f32,
        range_min: f32,
        range_max: f32,
        ranges: Vec<f32>,
        intensities: Vec<f32>,
    }
    /// sensor_msgs/PointField
    PointField { name: String, offset: u32, datatype: u8, count: u32, }
    /// sensor_msgs/PointCloud2
    PointCloud2 {
        header: Header,
        height: u32,
        width: u32,
        fields: Vec<PointField>,
        is_bigendian: bool,
        point_step: u32,
        row_step: u32,
        data: Vec<u8>,
        is_dense: bool,
    }
    /// vision_msgs/ObjectHypothesis
    ObjectHypothesis { class_id: String, score: f64, }
    /// vision_msgs/ObjectHypothesisWithPose
    ObjectHypothesisWithPose { hypothesis: ObjectHypothesis, pose: PoseWithCovariance, }
    /// vision_msgs/BoundingBox3D
    BoundingBox3D { center: Pose, size: Vector3, }
    /// vision_msgs/Detection3D
    Detection3D { header: Header, results: Vec<ObjectHypothesisWithPose>, bbox: BoundingBox3D, id: String, }
    /// vision_msgs/Detection3DArray
    Detection3DArray { header: Header, detections: Vec<Detection3D>, }
    /// diagnostic_msgs/KeyValue
    KeyValue { key: String, value: String, }
    /// diagnostic_msgs/DiagnosticStatus
    DiagnosticStatus { level: u8, name: String, message: String, hardware_id: String, values: Vec<KeyValue>, }
    /// diagnostic_msgs/DiagnosticArray
    DiagnosticArray { header: Header, status: Vec<DiagnosticStatus>, }
}

impl Time {
    /// From nanoseconds since the epoch; an instant that ROS cannot tell saturates.
    pub fn from_ns(ns: i64) -> Self {
        let sec = ns.div_euclid(1_000_000_000);
        let nanosec = ns.rem_euclid(1_000_000_000) as u32;
        Self { sec: i32::try_from(sec).unwrap_or(if sec < 0 { i32::MIN } else { i32::MAX }), nanosec }
    }
}

impl From<Pose> for Transform {
    fn from(pose: Pose) -> Self {
        Self { translation: pose.position, rotation: pose.orientation }
    }
}

impl Header {
    /// Of an instant, in a frame.
    pub fn new(stamp_ns: i64, frame: &str) -> Self {
        Self { stamp: Time::from_ns(stamp_ns), frame_id: frame.into() }
    }
}

/// 6 x 6 row by row: x, y, z, then rotation about x, y, z; zero where nothing is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub [f64; 36]);

impl Covariance {
    /// The diagonal from one sigma each; what is NaN is left zero, which ROS reads as not known.
    pub fn diagonal(sigma: [f32; 6]) -> Self {
        let mut cells = [0.0; 36];
        for (i, sigma) in sigma.into_iter().enumerate().filter(|(_, sigma)| sigma.is_finite()) {
            cells[7 * i] = f64::from(sigma).powi(2);
        }
        Self(cells)
    }
}

impl Default for Covariance {
    fn default() -> Self {
        Self([0.0; 36])
    }
}

impl serde::Serialize for Covariance {
    fn serialize<S: serde::Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
        self.0.as_slice().serialize(out)
    }
}

impl Cdr for Covariance {
    fn write(&self, out: &mut CdrWriter) {
        self.0.write(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_before_the_epoch_and_beyond_2038_stay_ordered() {
        assert_eq!(Time::from_ns(-1), Time { sec: -1, nanosec: 999_999_999 });
        assert_eq!(Time::from_ns(1_700_000_000_123_456_789), Time { sec: 1_700_000_000, nanosec: 123_456_789 });
        assert_eq!(Time::from_ns(i64::MAX).sec, i32::MAX);
    }
}
