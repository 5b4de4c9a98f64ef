//! Bytes made by others: the golden vectors of an independent encoder, and the capture of the standard's own example.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "tests read files and tell what they skipped")]

use serde_json::Value;
use std::net::SocketAddr;
use tsense_geometry::Timestamp;
use tsense_jaus::message::objects::{
    Attribute, FeatureClass, ObjectPoint, POINT, QueryVectorObjects, Region, ReportVectorObjects, VectorObject,
};
use tsense_jaus::message::scaled::{JointSpeed, Offset, SignedLatitude, SignedLongitude, Unit};
use tsense_jaus::message::smart_grid::{SmartGrid, SmartGridHeader};
use tsense_jaus::message::{core, cost_map, discovery, events, pose, range};
use tsense_jaus::transport::{Network, Options};
use tsense_jaus::{Id, Message, Transport, code_of, judp};

const SHARED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");

fn hex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).unwrap()).collect()
}

/// Decodes, encodes, and gives back the value as it prints.
fn through<M: Message + std::fmt::Debug>(bytes: &[u8]) -> (Vec<u8>, String) {
    let message = M::from_bytes(bytes).unwrap_or_else(|fault| panic!("{}", fault.as_str()));
    (message.to_bytes(), format!("{message:?}"))
}

fn by_name(name: &str, bytes: &[u8]) -> (Vec<u8>, String) {
    match name {
        "ReportGlobalPose" | "ReportGlobalPose_2" => through::<pose::ReportGlobalPose>(bytes),
        "QueryGlobalPose" => through::<pose::QueryGlobalPose>(bytes),
        "ReportVelocityState" => through::<pose::ReportVelocityState>(bytes),
        "CreateEvent" => through::<events::CreateEvent>(bytes),
        "ConfirmEventRequest" => through::<events::ConfirmEventRequest>(bytes),
        "Event" => through::<events::Event>(bytes),
        "RejectEventRequest" => through::<events::RejectEventRequest>(bytes),
        "RequestControl" => through::<core::RequestControl>(bytes),
        "ConfirmControl" => through::<core::ConfirmControl>(bytes),
        "QueryIdentification" => through::<discovery::QueryIdentification>(bytes),
        "ReportIdentification" => through::<discovery::ReportIdentification>(bytes),
        "RegisterServices" => through::<discovery::RegisterServices>(bytes),
        "QueryServices" => through::<discovery::QueryServices>(bytes),
        "ReportServices" => through::<discovery::ReportServices>(bytes),
        "ReportHeartbeatPulse" => through::<core::ReportHeartbeatPulse>(bytes),
        "ReportPanTiltJointPositions" => through::<pose::ReportPanTiltJointPositions>(bytes),
        "ReportRangeSensorData" => through::<range::ReportRangeSensorData>(bytes),
        "ReportCostMap2D" => through::<cost_map::ReportCostMap2D>(bytes),
        other => panic!("no message for {other}"),
    }
}

/// Every real number in a golden vector's fields; stamps and bytes are compared by the bytes alone.
fn reals(value: &Value, out: &mut Vec<f64>) {
    match value {
        Value::Number(number) if number.is_f64() => out.push(number.as_f64().unwrap()),
        Value::Array(list) => list.iter().for_each(|v| reals(v, out)),
        Value::Object(map) => map.values().for_each(|v| reals(v, out)),
        _ => {}
    }
}

/// Every number in the printed value.
fn printed(text: &str) -> Vec<f64> {
    text.split(|c: char| !(c.is_ascii_digit() || "-.e".contains(c))).filter_map(|t| t.parse().ok()).collect()
}

#[test]
fn all_golden_vectors_decode_to_their_values_and_encode_byte_for_byte() {
    let path = format!("{SHARED}/protocols/jaus_golden_vectors.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        return println!("SKIPPED: golden vectors not found");
    };
    let vectors: Value = serde_json::from_str(&text).unwrap();
    let (mut compared, mut values) = (0, 0);
    for (name, vector) in vectors.as_object().unwrap() {
        let bytes = hex(vector["hex"].as_str().unwrap());
        let (again, text) = by_name(name, &bytes);
        assert_eq!(again, bytes, "{name}");
        let numbers = printed(&text);
        let mut wanted = Vec::new();
        reals(&vector["fields"], &mut wanted);
        for value in wanted {
            // Half the step of the coarsest fields: a map's width, an event's rate, a range.
            let step = match name.as_str() {
                "ReportCostMap2D" if value >= 20.0 => 0.08,
                _ if value == 10.0 => 0.0084,
                _ => 1.2e-4,
            };
            assert!(numbers.iter().any(|n| (n - value).abs() <= step), "{name}: {value} is not in {text}");
            values += 1;
        }
        compared += 1;
    }
    println!("{compared} vectors byte for byte, {values} values");
    assert_eq!(compared, 19);
    assert_eq!(values, 30);
}

#[test]
fn the_datagrams_of_the_capture_are_read_and_written_byte_for_byte() {
    let Ok(file) = std::fs::read(format!("{SHARED}/captures/SAE_Management_PacketCapture.pcap")) else {
        return println!("SKIPPED: capture not found");
    };
    let controlled = Id::new(126, 1, 10);
    let allowed: Vec<Network> = vec!["192.168.0.0/24".parse().unwrap()];
    let mut transport = Transport::new(Options { own: vec![controlled], allowed, ..Options::default() });
    let (mut read, mut codes) = (0, Vec::new());
    let mut rest = &file[24..];
    while !rest.is_empty() {
        let length = u32::from_le_bytes(*rest[8..].first_chunk().unwrap()) as usize;
        let frame = &rest[16..16 + length];
        rest = &rest[16 + length..];
        // Ethernet with its padding, IPv4 of this header length, UDP.
        let ip = &frame[14..];
        let datagram = &ip[usize::from(ip[0] & 15) * 4 + 8..usize::from(u16::from_be_bytes([ip[2], ip[3]]))];
        let packets = judp::parse(datagram).unwrap();
        assert_eq!(packets[0].datagram(), datagram, "datagram {read}");
        let from = SocketAddr::from(([ip[12], ip[13], ip[14], ip[15]], judp::PORT));
        transport.receive(Timestamp::from_seconds(read as f64 * 0.1), from, datagram);
        codes.extend(std::iter::from_fn(|| transport.next_message()).filter_map(|m| code_of(&m.body)));
        read += 1;
    }
    assert_eq!(read, 22);
    // What reaches the component under control, in the capture's order.
    let expected = [0x0d, 0x2002, 4, 0x2002, 6, 0x2002, 7, 0x2002, 4, 3, 0x0e, 0x0d, 0x2002];
    assert_eq!(codes, expected);
}

/// Put together by hand from the layout in `docs/jaus.md`.
#[test]
fn the_experimental_grid_has_these_bytes() {
    let header = SmartGridHeader {
        version: 1,
        time: 0xa8b7_88fa,
        date: 0x3575,
        latitude_deg: 0.5,
        longitude_deg: -2.0,
        rotation_rad: 0.25,
        cell_m: 0.125,
        west_column: 3,
        south_row: -2,
        zone: 17,
        south: 1,
        base_m: 1.0,
        vegetation_step_m: 0.5,
        rows: 1,
        columns: 3,
        layers: 31,
    };
    let (traversability, vegetation, class, ground) =
        (vec![2, 12, 14], vec![1, 2, 255], vec![1, 3, 0], vec![-1, 256, i16::MIN]);
    let grid = SmartGrid { header, traversability, vegetation, class, ground, density: vec![0, 100, 255] };
    let golden = concat!(
        "01d8",
        "01",
        "fa88b7a8",
        "7535",
        "000000000000e03f",
        "00000000000000c0",
        "0000803e",
        "000000000000c03f",
        "03000000",
        "feffffff",
        "11",
        "01",
        "000000000000f03f",
        "0000003f",
        "0100",
        "0300",
        "1f",
        "c20e",
        "0102ff",
        "010300",
        "ffff00010080",
        "0064ff"
    );
    assert_eq!(grid.to_bytes(0xD801), hex(golden));
}

/// Put together by hand from the layout of RA 3.x: latitudes and longitudes are signed, their zero is 0.
#[test]
fn the_experimental_objects_have_these_bytes() {
    let place = ObjectPoint { latitude: SignedLatitude(45.0), longitude: SignedLongitude(-180.0) };
    let features = vec![
        FeatureClass { id: 1001, attribute: Attribute::Float(2.0) },
        FeatureClass { id: 2005, attribute: Attribute::UnsignedInteger(7) },
    ];
    let tree = VectorObject {
        id: 258,
        kind: POINT,
        buffer_m: 0.5,
        features: features.into(),
        points: vec![place.clone()].into(),
    };
    let report = ReportVectorObjects { request: 9, count: 1, objects: Some(vec![tree]) };
    // Half of 2147483647, rounded away from zero, is 40000000h.
    let golden = concat!(
        "234a", "01", "09", "0100", "02010000", "00", "0000003f", "02", "e903", "07", "00000040", "d507", "05",
        "07000000", "0100", "00000040", "01000080"
    );
    assert_eq!(report.to_bytes(), hex(golden));
    assert_eq!(ReportVectorObjects::from_bytes(&report.to_bytes()).unwrap().to_bytes(), report.to_bytes());
    let region = Some(Region { kind: POINT, buffer_m: Some(1.0), points: vec![place] });
    let query = QueryVectorObjects { response: 1, request: 9, region, ..Default::default() };
    assert_eq!(query.to_bytes(), hex("232a460109000000803f01000000004001000080"));
}

/// Put together by hand from the published fields of AS6060: 1.5 m of -30 to 30 is 0.525 of 4294967295.
#[test]
fn where_sensors_sit_has_these_bytes() {
    use range::{OnJoint, Placement, SensorGeometry, SensorMount};
    let place =
        || Placement { x: Offset(1.5), y: Offset(-30.0), z: Offset(30.0), d: Unit(1.0), ..Placement::default() };
    let on_joint = OnJoint { subsystem: 0x0201, node: 3, component: 20, joint: 2, place: place() };
    let mounts = [SensorMount::Unknown(0), SensorMount::OnVehicle(place()), SensorMount::OnJoint(on_joint)];
    let sensors = mounts.into_iter().zip(1..).map(|(mount, sensor)| SensorGeometry { sensor, mount });
    let report = range::ReportSensorGeometricProperties { sensors: sensors.collect::<Vec<_>>().into() }.to_bytes();
    let placed = concat!("66666686", "00000000", "ffffffff", "ffffffff", "00000080", "00000080", "00000080");
    let golden = ["054803000100", "0000", "0200", "01", placed, "0300", "02", "0102", "03", "14", "02", placed];
    assert_eq!(report, hex(&golden.concat()));
    assert_eq!(through::<range::ReportSensorGeometricProperties>(&report).0, report);
    let query = range::QuerySensorGeometricProperties { sensors: vec![0, 258].into() };
    assert_eq!(query.to_bytes(), hex("0528020000000201"));
}

/// The same for settings, points as bytes, and the pan-tilt unit of AS6057.
#[test]
fn settings_compressed_points_and_the_pan_tilt_unit_have_these_bytes() {
    use range::{CompressedData, CompressedScan, RangeError, RangeSensorConfiguration, Setting};
    let off = RangeSensorConfiguration { sensor: 1, state: Some(2), ..RangeSensorConfiguration::default() };
    let set = range::SetRangeSensorConfiguration { request: 9, sensors: vec![off].into() };
    assert_eq!(set.to_bytes(), hex("02080901008000010002"));
    let error = || RangeError { sensor: 2, code: 1, words: "no".into() };
    let sensors = vec![Setting::Done(1), Setting::Refused(error())].into();
    let confirm = range::ConfirmSensorConfiguration { request: 9, sensors }.to_bytes();
    assert_eq!(confirm, hex("010809020000010001020001026e6f"));
    let scan = CompressedScan { sensor: 2, frame: 1, time: 0xa8b7_88fa, compression: 0, points: vec![0, 0] };
    let sensors = vec![CompressedData::Error(error()), CompressedData::Scan(scan)].into();
    let report = range::ReportRangeSensorCompressedData { sensors }.to_bytes();
    assert_eq!(report, hex("0448020000020001026e6f01020001fa88b7a800020000000000"));
    let unit =
        pose::ReportPanTiltSpecifications { x: Some(Offset(1.5)), tilt_speed: JointSpeed(100.0), ..Default::default() };
    let golden =
        concat!("2046", "01", "66666686", "00000080", "00000080", "00000000", "00000080", "00000080", "ffffffff");
    assert_eq!(unit.to_bytes(), hex(golden));
    assert_eq!(pose::QueryPanTiltSpecifications { wanted: 127 }.to_bytes(), hex("20267f"));
}
