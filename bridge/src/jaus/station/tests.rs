//! The station against a peer made of the same transport, against the capture of the standard's own example, and
//! against what is hostile.

use super::*;
use crate::jaus::cost_map::tests::grid;
use crate::jaus::rig::tests::{joint, place, rig};
use bytemuck::Zeroable;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::cell::Cell;
use tsense_jaus::message::core::{QueryTime, ReportControl, RequestControl};
use tsense_jaus::message::cost_map::{Cells, QueryCostMap2D, ReportCostMap2D};
use tsense_jaus::message::discovery::{NodeQuery, QueryServices, ReportServices};
use tsense_jaus::message::events::{
    ConfirmEventRequest, CreateCommandEvent, CreateEvent, EVERY_CHANGE, Event, PERIODIC, RejectEventRequest,
    UNSUPPORTED,
};
use tsense_jaus::message::objects::{QueryVectorObjects, ReportVectorObjects};
use tsense_jaus::message::pose::{
    QueryPanTiltJointPositions, QueryPanTiltSpecifications, ReportPanTiltJointPositions, ReportPanTiltSpecifications,
};
use tsense_jaus::message::range::{
    ConfirmSensorConfiguration, NATIVE, Placement, QueryRangeSensorData, QuerySensorGeometricProperties, RangeData,
    RangeDataQuery, RangeSensorConfiguration, ReportRangeSensorData, ReportSensorGeometricProperties, SensorMount,
    SetRangeSensorConfiguration, Setting, VEHICLE,
};
use tsense_jaus::message::scaled::{EventRate, Offset, Unit};
use tsense_jaus::message::smart_grid::QuerySmartGrid;

const PEER: Id = Id::new(126, 1, 20);
const MAIN: Id = Id::new(1, 1, 20);
const BRUSH: Id = Id::new(1, 1, 21);

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_ns(1_795_229_734_250_000_000).plus_seconds(seconds)
}

fn our_address() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 3794))
}

fn their_address() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 40_000))
}

fn station(config: &Config) -> Station {
    Station::new(config, &Rig { head: None, ..rig() }, 7)
}

/// A peer with a transport of its own.
struct Peer {
    id: Id,
    transport: Transport,
}

impl Peer {
    fn new(id: Id) -> Self {
        let allowed = vec!["127.0.0.1".parse().unwrap()];
        let options = Options { own: vec![id], allowed, contacts: vec![our_address()], ..Options::default() };
        Self { id, transport: Transport::new(options) }
    }

    /// Sends a message and gives back what is answered.
    fn ask(&mut self, station: &mut Station, now: Timestamp, destination: Id, body: &[u8]) -> Vec<Vec<u8>> {
        let envelope = Envelope { source: self.id, destination, acknowledged: true, body: body.to_vec() };
        self.transport.send(now, &envelope);
        while let Some((_, datagram)) = self.transport.next_datagram() {
            station.receive(now, their_address(), &datagram);
        }
        self.listen(station, now)
    }

    fn listen(&mut self, station: &mut Station, now: Timestamp) -> Vec<Vec<u8>> {
        station.tick(now);
        while let Some((_, datagram)) = station.next_datagram() {
            self.transport.receive(now, our_address(), &datagram);
        }
        std::iter::from_fn(|| self.transport.next_message()).map(|message| message.body).collect()
    }
}

#[test]
fn a_peer_discovers_what_the_components_can_do() {
    let mut station = station(&Config::default());
    let mut peer = Peer::new(PEER);
    let nodes = vec![NodeQuery { node: 255, components: vec![255].into() }].into();
    let answers = peer.ask(&mut station, at(0.0), Id::ALL, &QueryServices { nodes }.to_bytes());
    let report = ReportServices::from_bytes(&answers[0]).unwrap();
    let found = |component: u8, uri: &str| {
        let of = report.nodes.0[0].components.0.iter().find(|c| c.component == component).unwrap();
        of.services.0.iter().any(|s| s.uri == uri)
    };
    assert!(found(20, "urn:jaus:jss:iop:CostMap2D") && found(21, "urn:jaus:jss:iop:CostMap2D"));
    assert!(found(20, "urn:jaus:jss:environmentSensing:RangeSensor"));
    assert_eq!(answers.len(), 1, "one component speaks for both");
    // The instant of the clock: 21 November 2026, 02:55:34.250.
    let time = peer.ask(&mut station, at(0.0), MAIN, &QueryTime { wanted: 3 }.to_bytes());
    assert_eq!(time, [[0x11, 0x40, 3, 0xfa, 0x88, 0xb7, 0xa8, 0x75, 0x35]]);
}

#[test]
fn a_subscriber_gets_every_grid_whole_and_its_cells_are_the_topics() {
    let mut station = station(&Config::default());
    let mut peer = Peer::new(PEER);
    let query = QueryCostMap2D::default().to_bytes();
    let ask = CreateEvent { request: 3, kind: EVERY_CHANGE, rate: EventRate(0.0), query };
    for (component, destination) in [MAIN, BRUSH].into_iter().enumerate() {
        let answers = peer.ask(&mut station, at(0.0), destination, &ask.to_bytes());
        // The first tick sends a heartbeat as well.
        let confirm = answers.iter().find_map(|body| ConfirmEventRequest::from_bytes(body).ok()).unwrap();
        assert_eq!((confirm.request, confirm.event), (3, 1), "component {component}");
    }
    let (header, cells) = grid(200, 200);
    for sequence in 0..3 {
        station.grid(&header, &cells);
        let bodies = peer.listen(&mut station, at(0.1 + f64::from(sequence) * 0.2));
        let events: Vec<Event> = bodies.iter().filter_map(|body| Event::from_bytes(body).ok()).collect();
        assert_eq!(events.iter().map(|e| e.sequence).collect::<Vec<_>>(), [sequence, sequence]);
        let map = ReportCostMap2D::from_bytes(&events[0].report).unwrap();
        let Cells::Costs(costs) = &map.cells else { panic!() };
        for (i, cost) in costs.0.iter().enumerate() {
            let (row, column) = (199 - i / 200, i % 200);
            assert_eq!(*cost, cells[row * 200 + column].cost);
        }
        assert_eq!(costs.0.len(), 40_000);
    }
    assert!(peer.transport.drops().is_empty(), "{:?}", peer.transport.drops());
}

#[test]
fn before_there_is_a_grid_an_event_waits_and_a_query_is_counted() {
    let mut station = station(&Config::default());
    let mut peer = Peer::new(PEER);
    let query = QueryCostMap2D::default().to_bytes();
    assert!(peer.ask(&mut station, at(0.0), MAIN, &query).is_empty());
    let ask = CreateEvent { request: 3, kind: PERIODIC, rate: EventRate(10.0), query };
    assert!(!peer.ask(&mut station, at(0.0), MAIN, &ask.to_bytes()).is_empty());
    let events = |bodies: Vec<Vec<u8>>| bodies.iter().filter(|body| Event::from_bytes(body).is_ok()).count();
    assert_eq!(events(peer.listen(&mut station, at(0.5))), 0);
    // The store says that it is empty before it knows a zone: nothing is lost.
    station.objects(&ObjectsHeader::zeroed(), &[]);
    assert_eq!(station.drops().iter().map(|d| *d.0).collect::<Vec<_>>(), ["asked before there is data"]);
    let (header, cells) = grid(4, 4);
    station.grid(&header, &cells);
    assert_eq!(events(peer.listen(&mut station, at(1.0))), 1);
    // A minute without being kept.
    assert_eq!(events(peer.listen(&mut station, at(61.0))), 0);
    assert_eq!(station.drops()["event not kept"], 1);
}

#[test]
fn events_of_commands_are_refused_in_words() {
    let (mut station, mut peer) = (station(&Config::default()), Peer::new(PEER));
    let ask = CreateCommandEvent { request: 9, duration_max_s: 10, command: vec![3, 0] };
    let answers = peer.ask(&mut station, at(0.0), MAIN, &ask.to_bytes());
    let refusals: Vec<_> = answers.iter().filter_map(|body| RejectEventRequest::from_bytes(body).ok()).collect();
    assert_eq!(refusals.iter().map(|r| (r.request, r.response)).collect::<Vec<_>>(), [(9, Some(UNSUPPORTED))]);
}

#[test]
fn what_is_experimental_is_served_only_where_the_configuration_says_so() {
    let mut out = tsense_jaus::Writer::default();
    out.u16(0xD800);
    tsense_jaus::message::Field::write(&QuerySmartGrid { layers: 1 }, &mut out);
    let queries = [out.into_bytes(), QueryVectorObjects { response: 1, ..Default::default() }.to_bytes()];
    for experimental in [false, true] {
        let mut station = station(&Config { experimental, ..Config::default() });
        let mut peer = Peer::new(PEER);
        let (header, cells) = grid(4, 4);
        station.grid(&header, &cells);
        station.objects(
            &ObjectsHeader { zone: 17, ..ObjectsHeader::zeroed() },
            &[Object { id: 1, easting_m: 5e5, ..Object::zeroed() }],
        );
        let answers: Vec<_> = queries.iter().flat_map(|q| peer.ask(&mut station, at(0.0), MAIN, q)).collect();
        assert_eq!(answers.len(), if experimental { 2 } else { 0 });
        if experimental {
            assert_eq!(answers[0][..2], [0x01, 0xD8]);
            assert_eq!(ReportVectorObjects::from_bytes(&answers[1]).unwrap().count, 1);
        } else {
            assert_eq!(station.drops()["unsupported message"], 2);
        }
    }
}

#[test]
fn objects_come_under_codes_of_the_users_own_and_then_under_no_others() {
    let codes = Config { objects_query_code: 0xD810, objects_report_code: 0xD811, ..Config::default() };
    let mut station = station(&Config { experimental: true, ..codes });
    let mut peer = Peer::new(PEER);
    station.objects(&ObjectsHeader { zone: 17, ..ObjectsHeader::zeroed() }, &[]);
    let usual = QueryVectorObjects { request: 4, ..Default::default() }.to_bytes();
    let own = [&[0x10, 0xD8], &usual[2..]].concat();
    assert_eq!(peer.ask(&mut station, at(0.0), MAIN, &own), [[0x11, 0xD8, 0, 4, 0, 0]]);
    assert!(peer.ask(&mut station, at(0.1), MAIN, &usual).is_empty());
}

/// What a peer needs to place a scan: where the sensor sits on the head, where the head sits, where it looks.
#[test]
fn a_peer_that_places_a_scan_by_the_reported_geometry_gets_the_points_in_the_vehicles_frame() {
    let mut rig = rig();
    let head = rig.head.as_mut().unwrap();
    (head.mount.yaw_deg, head.mount.pitch_deg) = (10.0, -4.0);
    (rig.ladars[0].tilt_from_ladar.roll_deg, rig.ladars[0].tilt_from_ladar.y_m) = (3.0, 0.05);
    let mut station = Station::new(&Config::default(), &rig, 7);
    let mut peer = Peer::new(PEER);
    let joints = QueryPanTiltJointPositions {}.to_bytes();
    assert!(peer.ask(&mut station, at(0.0), MAIN, &joints).is_empty());
    assert_eq!(station.drops().get("asked before there is data"), Some(&1));
    // The head stands still, so one report of its angles fits every beam.
    station.joint(&joint(at(0.9).ns, 0.3, -0.2));
    station.joint(&joint(at(1.1).ns, 0.3, -0.2));
    let (start_rad, step_rad) = (-0.7, 0.01);
    let header =
        ScanHeader { stamp_ns: at(1.0).ns, start_rad, step_rad, beam_interval_ns: 3e4, ..ScanHeader::zeroed() };
    let returns: Vec<Return> = (0..400).map(|i| Return { distance_mm: 900 + 7 * i, ..Return::zeroed() }).collect();
    station.scan(0, &header, &returns);
    let mut one = |body: Vec<u8>| {
        let answers = peer.ask(&mut station, at(1.2), MAIN, &body);
        assert_eq!(answers.len(), 1, "{body:?}");
        answers.into_iter().next().unwrap()
    };
    let unit =
        ReportPanTiltSpecifications::from_bytes(&one(QueryPanTiltSpecifications { wanted: 127 }.to_bytes())).unwrap();
    assert!((unit.tilt_max.0.to_degrees() - 15.0).abs() < 1e-6 && (unit.pan_speed.0.to_degrees() - 20.0).abs() < 1e-6);
    let angles = ReportPanTiltJointPositions::from_bytes(&one(joints)).unwrap();
    let geometry = QuerySensorGeometricProperties::default().to_bytes();
    let geometry = ReportSensorGeometricProperties::from_bytes(&one(geometry)).unwrap().sensors.0.remove(0);
    let SensorMount::OnJoint(on) = geometry.mount else { panic!("{geometry:?}") };
    assert_eq!((Id::new(on.subsystem, on.node, on.component), on.joint), (MAIN, 2));
    let mut scan = |frame| {
        let query = RangeDataQuery { sensor: 1, frame, wanted: 0 };
        let report = one(QueryRangeSensorData { sensors: vec![query].into() }.to_bytes());
        match ReportRangeSensorData::from_bytes(&report).unwrap().sensors.0.remove(0) {
            RangeData::Scan(scan) => scan.points.0,
            RangeData::Error(error) => panic!("{error:?}"),
        }
    };
    let (native, vehicle) = (scan(NATIVE), scan(VEHICLE));
    let vehicle_from_ladar = vehicle_from_ladar(&unit, &angles, &on.place);
    assert_eq!((native.len(), vehicle.len()), (400, 400));
    for (ours, theirs) in native.iter().zip(&vehicle) {
        let off_m = (vehicle_from_ladar * place(ours) - place(theirs)).norm();
        assert!(off_m < 1e-3, "{off_m} m off: {theirs:?}");
    }
}

/// A ladar on the vehicle, by the three reports.
fn vehicle_from_ladar(
    unit: &ReportPanTiltSpecifications,
    angles: &ReportPanTiltJointPositions,
    on: &Placement,
) -> Isometry3<f64> {
    let isometry = |xyz: [Offset; 3], dabc: [Unit; 4]| {
        let [d, a, b, c] = dabc.map(|unit| unit.0);
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(d, a, b, c));
        Isometry3::from_parts(Translation3::from(Vector3::from(xyz.map(|offset| offset.0))), turn)
    };
    let base = [unit.d, unit.a, unit.b, unit.c].map(Option::unwrap);
    let base = isometry([unit.x, unit.y, unit.z].map(Option::unwrap), base);
    let pan = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angles.pan.0);
    let tilt = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angles.tilt.0);
    base * pan * tilt * isometry([on.x, on.y, on.z], [on.d, on.a, on.b, on.c])
}

#[test]
fn ladars_are_not_set_over_jaus_and_malformed_questions_about_them_are_counted() {
    let mut station = station(&Config { allow_control: true, ..Config::default() });
    let mut peer = Peer::new(PEER);
    let off = RangeSensorConfiguration { sensor: 1, state: Some(2), ..RangeSensorConfiguration::default() };
    let set = SetRangeSensorConfiguration { request: 5, sensors: vec![off].into() }.to_bytes();
    let confirm = ConfirmSensorConfiguration::from_bytes(&peer.ask(&mut station, at(0.0), MAIN, &set)[0]).unwrap();
    let Setting::Refused(error) = &confirm.sensors.0[0] else { panic!("{confirm:?}") };
    assert_eq!((confirm.request, error.sensor, error.code), (5, 1, 5), "invalid sensor state");
    assert!(station.drops().is_empty(), "{:?}", station.drops());
    let malformed: [&[u8]; 4] = [&set[..8], &[0x04, 0x28, 1, 0, 1, 0], &[0x05, 0x28, 0, 0, 9], &[0x05, 0x28]];
    for body in malformed {
        assert!(peer.ask(&mut station, at(0.1), MAIN, body).is_empty(), "{body:?}");
    }
    assert_eq!(station.drops().values().sum::<u64>(), 4, "{:?}", station.drops());
    // The other component has no ladars, and without a head nobody has its angles.
    assert!(peer.ask(&mut station, at(0.2), BRUSH, &set).is_empty());
    assert!(peer.ask(&mut station, at(0.2), MAIN, &[0x22, 0x26]).is_empty());
    assert_eq!(station.drops().get("unsupported message"), Some(&2), "{:?}", station.drops());
}

#[test]
fn a_registry_of_our_own_subsystem_is_told_of_our_services_once() {
    let mut station =
        Station::new(&Config { contacts: vec![their_address().to_string()], ..Config::default() }, &Rig::default(), 7);
    let mut registry = Peer::new(Id::new(1, 1, 1));
    let asked = registry.listen(&mut station, at(0.0));
    assert_eq!(asked, [[0x00, 0x2B, 2]]);
    assert!(registry.listen(&mut station, at(4.0)).is_empty());
    assert_eq!(registry.listen(&mut station, at(5.1)).len(), 1);
    let who = ReportIdentification { kind: SUBSYSTEM, type_of: 10_001, name: "vehicle".into() }.to_bytes();
    let told = registry.ask(&mut station, at(6.0), MAIN, &who);
    let counts: Vec<usize> =
        told.iter().map(|body| RegisterServices::from_bytes(body).unwrap().services.0.len()).collect();
    assert_eq!(counts, [9, 7]);
    assert!(registry.ask(&mut station, at(20.0), MAIN, &who).is_empty(), "answered: nobody asks any more");
}

/// The console's datagrams of the capture; our replies must be those of the component that it talked to.
#[test]
#[allow(clippy::disallowed_methods, clippy::print_stdout, reason = "the capture is a file")]
fn to_the_console_of_the_capture_we_answer_as_its_component_did() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/captures/SAE_Management_PacketCapture.pcap");
    let Ok(file) = std::fs::read(path) else { return println!("SKIPPED: capture not found") };
    let peers = vec!["192.168.0.0/24".into()];
    let config = Config { subsystem: 126, component: 10, allow_control: true, peers, ..Config::default() };
    let mut station = station(&config);
    let (mut rest, mut ours, mut theirs) = (&file[24..], Vec::new(), Vec::new());
    let mut now = at(0.0);
    while !rest.is_empty() {
        let length = u32::from_le_bytes(*rest[8..].first_chunk().unwrap()) as usize;
        let ip = &rest[16 + 14..16 + length];
        rest = &rest[16 + length..];
        let datagram = &ip[usize::from(ip[0] & 15) * 4 + 8..usize::from(u16::from_be_bytes([ip[2], ip[3]]))];
        let packet = judp::parse(datagram).unwrap()[0];
        if packet.source == config.main_id() {
            theirs.push((packet.ack, packet.body.to_vec()));
            continue;
        }
        now = now.plus_seconds(0.1);
        station.receive(now, SocketAddr::from(([ip[12], ip[13], ip[14], ip[15]], 3794)), datagram);
        let replies: Vec<Vec<u8>> = std::iter::from_fn(|| station.next_datagram()).map(|(_, d)| d).collect();
        ours.extend(replies.iter().map(|d| judp::parse(d).unwrap()[0]).map(|p| (p.ack, p.body.to_vec())));
        if ours.len() == 2 && station.components[0].controller().is_some() {
            // That component was in standby when the console came.
            station.components[0]
                .take(
                    PEER,
                    &[3, 0],
                    around(&config, &station.cards.clone(), &Products::new(&config, &Rig::default()), now),
                )
                .unwrap();
        }
    }
    // Confirmation and acknowledgement crossed there in the other order.
    ours.swap(0, 1);
    assert_eq!(theirs.len(), 9);
    assert_eq!(sorted(&ours), sorted(&theirs));
    assert_eq!(ours[2..], theirs[2..]);
}

fn sorted(replies: &[(judp::Ack, Vec<u8>)]) -> Vec<String> {
    let mut words: Vec<String> = replies.iter().map(|r| format!("{r:?}")).collect();
    words.sort();
    words
}

fn around<'a>(config: &'a Config, cards: &'a [Card], products: &'a Products, now: Timestamp) -> Surroundings<'a> {
    Surroundings { config, cards, products, now }
}

#[test]
fn read_only_means_that_nothing_a_peer_says_changes_who_controls_or_the_state() {
    let cases = Cell::new(0);
    proptest!(ProptestConfig::with_cases(400), |(code in 0_u16..0x2000, fields in proptest::collection::vec(any::<u8>(), 0..12))| {
        let mut station = station(&Config::default());
        let mut peer = Peer::new(PEER);
        let body = [&code.to_le_bytes()[..], &fields].concat();
        peer.ask(&mut station, at(0.0), MAIN, &RequestControl { authority: 255 }.to_bytes());
        peer.ask(&mut station, at(0.0), MAIN, &body);
        let control = peer.ask(&mut station, at(0.1), MAIN, &[0x0D, 0x20]);
        prop_assert!(control.contains(&ReportControl::default().to_bytes()), "{control:?}");
        prop_assert!(peer.ask(&mut station, at(0.2), MAIN, &[0x02, 0x20]).contains(&vec![2, 0x40, 1, 0, 0, 0, 0]));
        cases.set(cases.get() + 1);
    });
    assert_eq!(cases.get(), 400);
}

#[test]
fn whatever_an_allowed_peer_sends_nothing_panics_and_nothing_grows() {
    let cases = Cell::new(0);
    let known = proptest::sample::select(vec![
        0x0D_u16, 0x01F0, 0x01F1, 0x01F2, 0x01F6, 0x0802, 0x0B00, 0x2002, 0x2011, 0x21F0, 0x2620, 0x2622, 0x2801,
        0x2802, 0x2803, 0x2804, 0x2805, 0x2A23, 0x2B00, 0x2B01, 0x2B02, 0x2B03, 0x2B04, 0x4B00, 0xD738, 0xD800, 0x4402,
    ]);
    let config = Config { experimental: true, allow_control: true, ..Config::default() };
    let mut station = station(&config);
    let (header, cells) = grid(20, 20);
    station.grid(&header, &cells);
    let mut peer = Peer::new(PEER);
    let mut seconds = 0.0;
    let mut step = |code: u16, fields: &[u8], wrapped: bool| {
        seconds += 0.01;
        let mut body = [&code.to_le_bytes()[..], fields].concat();
        if wrapped {
            let (kind, rate) = (fields.first().copied().unwrap_or(0) & 1, EventRate(50.0));
            body = CreateEvent { request: 1, kind, rate, query: body }.to_bytes();
        }
        peer.ask(&mut station, at(seconds), Id::ALL, &body);
        peer.ask(&mut station, at(seconds), BRUSH, &body);
        (station.kept_bytes(), station.components.iter().map(Component::events).sum::<usize>())
    };
    let step = std::cell::RefCell::new(&mut step);
    proptest!(ProptestConfig::with_cases(3000), |(code in known, fields in proptest::collection::vec(any::<u8>(), 0..40), wrapped in any::<bool>())| {
        let (kept, events) = (step.borrow_mut())(code, &fields, wrapped);
        prop_assert!(kept == 0 && events <= 32, "{kept} bytes, {events} events");
        cases.set(cases.get() + 1);
    });
    assert_eq!(cases.get(), 3000);
}
