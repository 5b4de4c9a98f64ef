//! Bytes that nobody meant well: seeded properties over the transport and every message. Nothing panics, nothing grows,
//! and what is refused is counted and changes nothing.

use proptest::prelude::*;
use std::cell::Cell;
use std::net::SocketAddr;
use tsense_geometry::Timestamp;
use tsense_jaus::judp::{self, Ack, Broadcast, Packet, Part, Priority};
use tsense_jaus::message::{core, cost_map, discovery, events, objects, pose, range};
use tsense_jaus::transport::Options;
use tsense_jaus::{Id, Malformed, Message, Transport};

const US: Id = Id::new(1, 1, 20);

fn us() -> Transport {
    Transport::new(Options { own: vec![US], allowed: vec!["0.0.0.0/0".parse().unwrap()], ..Options::default() })
}

/// Reads bytes as a message; where that works, they must be written again as they were.
fn read<M: Message>(bytes: &[u8]) -> bool {
    match M::from_bytes(bytes) {
        Ok(message) => {
            // Text that is not UTF-8 is repaired, so it may come out longer; all else is the same.
            let again = M::from_bytes(&message.to_bytes()).map(|m| m.to_bytes());
            again == Ok(message.to_bytes())
        }
        Err(Malformed::Truncated | Malformed::Trailing | Malformed::Tag | Malformed::Value) => true,
    }
}

fn read_all(bytes: &[u8]) -> bool {
    macro_rules! all {
        ($($kind:ty),+ $(,)?) => { [$({
            let mut with_code = <$kind>::CODE.to_le_bytes().to_vec();
            with_code.extend_from_slice(bytes);
            read::<$kind>(&with_code)
        }),+].iter().all(|good| *good) };
    }
    all!(
        core::RequestControl,
        core::ReportTime,
        events::CreateEvent,
        events::RejectEventRequest,
        events::QueryEvents,
        events::ReportEvents,
        events::Event,
        discovery::ReportServices,
        discovery::QueryServiceList,
        discovery::ReportServiceList,
        discovery::ReportConfiguration,
        pose::ReportGlobalPose,
        pose::ReportVelocityState,
        pose::ReportPanTiltSpecifications,
        cost_map::QueryCostMap2D,
        cost_map::ReportCostMap2D,
        range::QueryRangeSensorData,
        range::ReportRangeSensorData,
        range::ReportRangeSensorCapabilities,
        range::QueryRangeSensorCompressedData,
        range::ReportRangeSensorCompressedData,
        range::QuerySensorGeometricProperties,
        range::ReportSensorGeometricProperties,
        range::SetRangeSensorConfiguration,
        range::ConfirmSensorConfiguration,
        objects::QueryVectorObjects,
        objects::ReportVectorObjects,
    )
}

#[test]
fn any_bytes_are_a_message_that_returns_or_a_counted_fault() {
    let cases = Cell::new(0);
    proptest!(ProptestConfig::with_cases(2000), |(bytes in proptest::collection::vec(any::<u8>(), 0..120))| {
        prop_assert!(read_all(&bytes));
        cases.set(cases.get() + 1);
    });
    assert_eq!(cases.get(), 2000);
}

#[test]
fn any_datagram_is_taken_or_counted() {
    let cases = Cell::new(0);
    proptest!(ProptestConfig::with_cases(3000), |(bytes in proptest::collection::vec(any::<u8>(), 0..200), head in any::<bool>())| {
        let mut us = us();
        let bytes = if head { [&[2, 0][..], &bytes].concat() } else { bytes };
        us.receive(Timestamp::from_seconds(1.0), SocketAddr::from(([10, 0, 0, 9], 3794)), &bytes);
        let taken = us.next_message().is_some();
        prop_assert!(taken || us.kept_bytes() > 0 || us.drops().values().sum::<u64>() > 0 || us.peers() > 0);
        cases.set(cases.get() + 1);
    });
    assert_eq!(cases.get(), 3000);
}

#[test]
fn every_cut_of_a_good_datagram_changes_nothing_but_a_counter() {
    let body = events::CreateEvent {
        request: 7,
        kind: 0,
        rate: tsense_jaus::message::scaled::EventRate(10.0),
        query: pose::QueryGlobalPose { wanted: 511 }.to_bytes(),
    }
    .to_bytes();
    let good = Packet {
        priority: Priority::Standard,
        broadcast: Broadcast::None,
        ack: Ack::Wanted,
        part: Part::Whole,
        destination: US,
        source: Id::new(9, 1, 1),
        body: &body,
        sequence: 3,
    }
    .datagram();
    let mut us = us();
    let from = SocketAddr::from(([10, 0, 0, 9], 3794));
    for end in 0..good.len() {
        us.receive(Timestamp::from_seconds(1.0), from, &good[..end]);
    }
    let counted: u64 = us.drops().values().sum();
    assert_eq!((counted as usize, us.peers(), us.kept_bytes()), (good.len(), 0, 0));
    assert!(us.next_message().is_none() && us.next_datagram().is_none());
    us.receive(Timestamp::from_seconds(1.0), from, &good);
    assert_eq!(us.next_message().unwrap().body, body);
    // The body cut at every byte is refused as a message, too.
    let refused = (0..body.len()).filter(|end| events::CreateEvent::from_bytes(&body[..*end]).is_err()).count();
    assert_eq!(refused, body.len());
}

#[test]
fn a_datagram_full_of_tiny_messages_is_bounded() {
    let tiny = Packet {
        priority: Priority::Low,
        broadcast: Broadcast::None,
        ack: Ack::None,
        part: Part::Whole,
        destination: US,
        source: Id::new(9, 1, 1),
        body: &[0x02, 0x22],
        sequence: 0,
    };
    let mut datagram = vec![2];
    for sequence in 0..4000 {
        datagram.extend_from_slice(&Packet { sequence, ..tiny }.datagram()[1..]);
    }
    assert_eq!(judp::parse(&datagram).unwrap().len(), 4000);
    let mut us = us();
    us.receive(Timestamp::from_seconds(1.0), SocketAddr::from(([10, 0, 0, 9], 3794)), &datagram);
    let taken = std::iter::from_fn(|| us.next_message()).count();
    assert_eq!((taken, us.drops()["too many messages at once"]), (256, 3744));
}
