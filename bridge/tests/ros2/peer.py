"""A foreign ROS 2 peer for the tests: PyPI `rosbags` reads and writes our bytes, PyPI `cyclonedds` receives them.

rosbags             lines `type hex` in; lines of JSON out: the values it reads, and the bytes it writes of them
decode              lines `topic type hex` in, as `fastdds_peer` writes them; lines of JSON out: the values of each sample
subscribe DOMAIN    JSON lines of every sample of every topic named on standard input (lines `topic type`), until it ends
"""

import json
import math
import struct
import sys
import time

# Field tables, one type a line: facts of the ROS packages, written down again.
TYPES = """
builtin_interfaces/msg/Time: int32 sec, uint32 nanosec
std_msgs/msg/Header: builtin_interfaces/msg/Time stamp, string frame_id
geometry_msgs/msg/Point: float64 x, float64 y, float64 z
geometry_msgs/msg/Vector3: float64 x, float64 y, float64 z
geometry_msgs/msg/Quaternion: float64 x, float64 y, float64 z, float64 w
geometry_msgs/msg/Pose: geometry_msgs/msg/Point position, geometry_msgs/msg/Quaternion orientation
geometry_msgs/msg/PoseWithCovariance: geometry_msgs/msg/Pose pose, float64[36] covariance
geometry_msgs/msg/Twist: geometry_msgs/msg/Vector3 linear, geometry_msgs/msg/Vector3 angular
geometry_msgs/msg/TwistWithCovariance: geometry_msgs/msg/Twist twist, float64[36] covariance
geometry_msgs/msg/Transform: geometry_msgs/msg/Vector3 translation, geometry_msgs/msg/Quaternion rotation
geometry_msgs/msg/TransformStamped: std_msgs/msg/Header header, string child_frame_id, geometry_msgs/msg/Transform transform
tf2_msgs/msg/TFMessage: geometry_msgs/msg/TransformStamped[] transforms
nav_msgs/msg/Odometry: std_msgs/msg/Header header, string child_frame_id, geometry_msgs/msg/PoseWithCovariance pose, geometry_msgs/msg/TwistWithCovariance twist
nav_msgs/msg/MapMetaData: builtin_interfaces/msg/Time map_load_time, float32 resolution, uint32 width, uint32 height, geometry_msgs/msg/Pose origin
nav_msgs/msg/OccupancyGrid: std_msgs/msg/Header header, nav_msgs/msg/MapMetaData info, int8[] data
grid_map_msgs/msg/GridMapInfo: float64 resolution, float64 length_x, float64 length_y, geometry_msgs/msg/Pose pose
std_msgs/msg/MultiArrayDimension: string label, uint32 size, uint32 stride
std_msgs/msg/MultiArrayLayout: std_msgs/msg/MultiArrayDimension[] dim, uint32 data_offset
std_msgs/msg/Float32MultiArray: std_msgs/msg/MultiArrayLayout layout, float32[] data
grid_map_msgs/msg/GridMap: std_msgs/msg/Header header, grid_map_msgs/msg/GridMapInfo info, string[] layers, string[] basic_layers, std_msgs/msg/Float32MultiArray[] data, uint16 outer_start_index, uint16 inner_start_index
sensor_msgs/msg/LaserScan: std_msgs/msg/Header header, float32 angle_min, float32 angle_max, float32 angle_increment, float32 time_increment, float32 scan_time, float32 range_min, float32 range_max, float32[] ranges, float32[] intensities
sensor_msgs/msg/PointField: string name, uint32 offset, uint8 datatype, uint32 count
sensor_msgs/msg/PointCloud2: std_msgs/msg/Header header, uint32 height, uint32 width, sensor_msgs/msg/PointField[] fields, bool is_bigendian, uint32 point_step, uint32 row_step, uint8[] data, bool is_dense
vision_msgs/msg/ObjectHypothesis: string class_id, float64 score
vision_msgs/msg/ObjectHypothesisWithPose: vision_msgs/msg/ObjectHypothesis hypothesis, geometry_msgs/msg/PoseWithCovariance pose
vision_msgs/msg/BoundingBox3D: geometry_msgs/msg/Pose center, geometry_msgs/msg/Vector3 size
vision_msgs/msg/Detection3D: std_msgs/msg/Header header, vision_msgs/msg/ObjectHypothesisWithPose[] results, vision_msgs/msg/BoundingBox3D bbox, string id
vision_msgs/msg/Detection3DArray: std_msgs/msg/Header header, vision_msgs/msg/Detection3D[] detections
diagnostic_msgs/msg/KeyValue: string key, string value
diagnostic_msgs/msg/DiagnosticStatus: byte level, string name, string message, string hardware_id, diagnostic_msgs/msg/KeyValue[] values
diagnostic_msgs/msg/DiagnosticArray: std_msgs/msg/Header header, diagnostic_msgs/msg/DiagnosticStatus[] status
"""


def tables():
    """Type name to a list of (field type, field name)."""
    lines = [line.split(": ") for line in TYPES.strip().splitlines()]
    return {name: [tuple(field.split(" ")) for field in fields.split(", ")] for name, fields in lines}


def plain(value):
    """Values as JSON has them; a float by its bits, so that no reader rounds it, and null where it is not finite."""
    if isinstance(value, float):
        return "f64:" + struct.pack(">d", value).hex() if math.isfinite(value) else None
    if isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    names = getattr(value, "__dataclass_fields__", None) or vars(value)
    return {name: plain(getattr(value, name)) for name in names if not name.startswith("__") and not name.isupper()}


def known_types():
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, fields in tables().items():
        if name not in store.types:
            store.register(get_types_from_msg("\n".join(" ".join(field) for field in fields), name))
    return store


def rosbags():
    store = known_types()
    for line in sys.stdin:
        name, text = line.split()
        message = store.deserialize_cdr(bytes.fromhex(text), name)
        written = bytes(store.serialize_cdr(message, name))
        digest = store.hash_rihs01(name)
        print(json.dumps({"values": plain(message), "hex": written.hex(), "hash": digest}), flush=True)


def decode():
    store = known_types()
    print(json.dumps({"ready": sys.stdin.readline().strip()}), flush=True)
    for line in sys.stdin:
        topic, name, text = line.split()
        values = plain(store.deserialize_cdr(bytes.fromhex(text), name))
        print(json.dumps({"topic": topic, "values": values}), flush=True)


def dds_types():
    from cyclonedds.idl import make_idl_struct, types

    primitives = {"string": str, "bool": bool, "byte": types.uint8}
    for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"):
        primitives[name] = getattr(types, name)
    known = {}

    def field_type(text):
        if text.endswith("[]"):
            return types.sequence[field_type(text[:-2])]
        if text.endswith("]"):
            base, count = text[:-1].split("[")
            return types.array[field_type(base), int(count)]
        return primitives.get(text) or known[text]

    for name, fields in tables().items():
        package, _, short = name.split("/")
        typed = {field: field_type(kind) for kind, field in fields}
        known[name] = make_idl_struct(short + "_", f"{package}.msg.dds_.{short}_", typed)
    return known


def subscribe(domain):
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    known = dds_types()
    participant = DomainParticipant(domain)
    readers = []
    for line in sys.stdin:
        topic, kind, reliable, latched = line.split()
        qos = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)) if reliable == "1" else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched == "1" else Policy.Durability.Volatile,
            Policy.History.KeepLast(10),
        )
        reader = DataReader(participant, Topic(participant, "rt" + topic, known[kind], qos=qos), qos=qos)
        readers.append((topic, reader))
    print(json.dumps({"ready": len(readers)}), flush=True)
    while True:
        for topic, reader in readers:
            for sample in reader.take(N=20):
                if sample.sample_info.valid_data:
                    print(json.dumps({"topic": topic, "values": plain(sample)}), flush=True)
        time.sleep(0.01)


if __name__ == "__main__":
    if sys.argv[1] == "rosbags":
        rosbags()
    elif sys.argv[1] == "decode":
        decode()
    else:
        subscribe(int(sys.argv[2]))
