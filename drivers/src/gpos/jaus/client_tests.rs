//! The client against a sensor in plain code, with time as an argument.

use super::*;
use tsense_jaus::judp::{Ack, Broadcast, Packet, Part, Priority};

const SENSOR: Id = Id::new(7, 1, 30);
const US: Id = Id::new(1, 1, 40);
/// The first golden vector: a pose with all fields.
const POSE: [u8; 32] = [
    2, 0x44, 0xff, 1, 0xd2, 2, 0x52, 0xaa, 0xa8, 0x8c, 0x7f, 0x45, 0x5f, 0x73, 0x21, 0x39, 0x9c, 0xc4, 0x20, 0, 0x68,
    0x80, 0x2f, 0x7f, 0x1d, 0xbd, 0x2a, 0, 0xfa, 0x88, 0xb7, 0xa8,
];

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_ns(1_795_229_734_250_000_000).plus_seconds(seconds)
}

struct Bench {
    client: Client,
    sequence: u16,
}

impl Bench {
    fn new(sensor: &str) -> Self {
        let config = Config { sensor: sensor.into(), rate_hz: 10.0, ..Config::default() };
        Self { client: Client::new(&config, 9), sequence: 0 }
    }

    /// What the client says now, message by message.
    fn said(&mut self, now: Timestamp) -> Vec<Vec<u8>> {
        self.client.tick(now);
        let mut said = Vec::new();
        let there = SocketAddr::from(([127, 0, 0, 1], 3794));
        while let Some((to, datagram)) = self.client.next_datagram() {
            assert_eq!(to, there);
            let packet = judp::parse(&datagram).unwrap()[0];
            if packet.ack == Ack::Wanted {
                let (destination, source) = (packet.source, packet.destination);
                let ack = Packet { ack: Ack::Positive, destination, source, body: &[], ..packet };
                self.client.receive(now, there, &ack.datagram());
            }
            said.extend(
                judp::parse(&datagram).unwrap().iter().filter(|p| p.ack != Ack::Positive).map(|p| p.body.to_vec()),
            );
        }
        said
    }

    fn hears(&mut self, now: Timestamp, source: Id, body: &[u8]) -> usize {
        self.sequence += 1;
        let packet = Packet {
            priority: Priority::Standard,
            broadcast: Broadcast::None,
            ack: Ack::None,
            part: Part::Whole,
            destination: US,
            source,
            body,
            sequence: self.sequence,
        };
        self.client.receive(now, SocketAddr::from(([127, 0, 0, 1], 3794)), &packet.datagram()).len()
    }
}

fn event(number: u8) -> Vec<u8> {
    [&[0xf1, 0x41, number, 0, 32, 0, 0, 0][..], &POSE].concat()
}

/// A subsystem with a node 1 whose component 30 is a GlobalPoseSensor.
fn services() -> Vec<u8> {
    [&[0x03, 0x4b, 1, 1, 1, 30, 0, 1, 38][..], SERVICE.as_bytes(), &[1, 0]].concat()
}

#[test]
fn a_sensor_is_found_subscribed_to_and_kept() {
    let mut bench = Bench::new("");
    assert_eq!(bench.said(at(0.0)), [[0x00, 0x2b, 2]]);
    assert!(bench.said(at(1.0)).is_empty(), "not more than once in five seconds");
    bench.hears(at(1.0), Id::new(7, 1, 1), &[0x00, 0x4b, 2, 0x11, 0x27, 0]);
    assert_eq!(bench.said(at(1.1)), [[0x03, 0x2b, 1, 255, 1, 255]]);
    bench.hears(at(1.2), Id::new(7, 1, 1), &services());
    // Create event, periodic, 10 Hz, query global pose with all fields: the golden vector but for its request number.
    let asked = bench.said(at(1.3));
    assert_eq!(asked, [[0xf0, 1, 1, 0, 0x58, 2, 4, 0, 0, 0, 2, 0x24, 0xff, 1]]);
    assert_eq!(bench.client.sensor(), Err("asking 7.1.30 for poses".into()));
    bench.hears(at(1.4), SENSOR, &[0xf3, 1, 1, 5, 0x58, 2]);
    assert_eq!(bench.client.sensor(), Ok(SENSOR));
    let mut poses = 0;
    for i in 0..250 {
        let now = at(1.5 + 0.1 * f64::from(i));
        poses += bench.hears(now, SENSOR, &event(5));
        let said = bench.said(now);
        assert_eq!(said.len(), usize::from(i == 200), "a sign of life after 20 s, here {said:?} after {i}");
    }
    assert_eq!((poses, bench.client.drops().len()), (250, 0));
    bench.client.stop(at(30.0));
    assert_eq!(bench.said(at(30.0))[0], [0xf2, 1, 3, 5]);
}

#[test]
fn a_silent_sensor_is_looked_for_anew() {
    let mut bench = Bench::new("7.1.30");
    bench.said(at(0.0));
    bench.hears(at(0.1), SENSOR, &[0xf3, 1, 1, 5, 0x58, 2]);
    assert_eq!(bench.hears(at(0.2), SENSOR, &event(5)), 1);
    assert!(bench.said(at(3.1)).is_empty());
    // Silent for three seconds: asked again at once, since the configuration names it.
    assert_eq!(bench.said(at(3.3))[0][..3], [0xf0, 1, 1]);
}

#[test]
fn what_others_say_changes_nothing() {
    let mut bench = Bench::new("7.1.30");
    bench.said(at(0.0));
    let other = Id::new(7, 1, 31);
    bench.hears(at(0.1), other, &[0xf3, 1, 1, 5, 0x58, 2]);
    assert_eq!(bench.hears(at(0.1), SENSOR, &event(5)), 0);
    bench.hears(at(0.2), SENSOR, &[0xf3, 1, 1, 5, 0x58, 2]);
    assert_eq!((bench.hears(at(0.3), other, &POSE), bench.hears(at(0.3), SENSOR, &event(6))), (0, 0));
    assert_eq!(bench.hears(at(0.4), SENSOR, &event(5)[..30]), 0);
    let drops: Vec<_> = bench.client.drops().iter().map(|(cause, count)| (*cause, *count)).collect();
    assert_eq!(
        drops,
        [("event that was not asked for", 2), ("message cut short", 1), ("pose that was not asked for", 1)]
    );
}

#[test]
fn a_sensor_without_events_is_asked_for_every_pose() {
    let mut bench = Bench::new("7.1.30");
    bench.said(at(0.0));
    bench.hears(at(0.1), SENSOR, &[0xf4, 1, 1, 1, 1]);
    assert_eq!(bench.said(at(0.2))[0][..4], [0xf0, 1, 1, 1], "events on change instead");
    bench.hears(at(0.3), SENSOR, &[0xf4, 1, 1, 1, 2]);
    let (mut asked, mut poses) = (0, 0);
    for i in 0..100 {
        let now = at(0.4 + 0.01 * f64::from(i));
        for said in bench.said(now) {
            assert_eq!(said, [2, 0x24, 0xff, 1]);
            asked += 1;
            poses += bench.hears(now, SENSOR, &POSE);
        }
    }
    assert_eq!((asked, poses), (10, 10));
}
