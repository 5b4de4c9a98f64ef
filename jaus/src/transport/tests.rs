//! The transport between two ends in one thread, with time and losses as arguments; and against what is hostile.

use super::*;

const US: Id = Id::new(1, 1, 20);
const THEM: Id = Id::new(126, 1, 10);

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_seconds(1_000.0 + seconds)
}

fn address(last: u8) -> SocketAddr {
    SocketAddr::from(([10, 0, 0, last], judp::PORT))
}

fn options(own: Id) -> Options {
    Options { own: vec![own], allowed: vec!["10.0.0.0/24".parse().unwrap()], ..Options::default() }
}

fn us() -> Transport {
    Transport::new(options(US))
}

fn packet(body: &[u8], sequence: u16) -> Packet<'_> {
    Packet {
        priority: Priority::Standard,
        broadcast: Broadcast::None,
        ack: Ack::None,
        part: Part::Whole,
        destination: US,
        source: THEM,
        body,
        sequence,
    }
}

fn messages(transport: &mut Transport) -> Vec<Vec<u8>> {
    std::iter::from_fn(|| transport.next_message()).map(|m| m.body).collect()
}

fn datagrams(transport: &mut Transport) -> Vec<(SocketAddr, Vec<u8>)> {
    std::iter::from_fn(|| transport.next_datagram()).collect()
}

fn drops(transport: &Transport) -> Vec<(&'static str, u64)> {
    transport.drops().iter().map(|(cause, count)| (*cause, *count)).collect()
}

#[test]
fn a_message_that_asks_is_acknowledged_with_its_own_number_and_repeated_ones_again_but_not_delivered() {
    let mut us = us();
    let asks = Packet { ack: Ack::Wanted, ..packet(&[0x0d, 0, 200], 7) }.datagram();
    us.receive(at(0.0), address(9), &asks);
    us.receive(at(0.1), address(9), &asks);
    assert_eq!(messages(&mut us).len(), 1);
    let out = datagrams(&mut us);
    assert_eq!(out.len(), 2);
    for (to, datagram) in out {
        let answer = judp::parse(&datagram).unwrap()[0];
        assert_eq!((to, answer.ack, answer.sequence), (address(9), Ack::Positive, 7));
        assert_eq!((answer.source, answer.destination, answer.body.len()), (US, THEM, 0));
    }
    // Three seconds later the number may be that of a peer that was started again.
    us.receive(at(3.3), address(9), &asks);
    assert_eq!((messages(&mut us).len(), drops(&us)), (1, vec![("repeated packet", 1)]));
}

#[test]
fn a_broadcast_is_delivered_and_not_acknowledged() {
    let mut us = us();
    us.receive(
        at(0.0),
        address(9),
        &Packet { destination: Id::ALL, ack: Ack::Wanted, ..packet(&[0, 0x2b, 2], 1) }.datagram(),
    );
    assert_eq!((messages(&mut us).len(), datagrams(&mut us).len()), (1, 0));
}

#[test]
fn an_unknown_peer_is_looked_for_by_everybody_three_times_and_found_by_its_acknowledgement() {
    let mut us = Transport::new(Options { contacts: vec![address(9)], first_sequence: 65_535, ..options(US) });
    let envelope = Envelope { source: US, destination: THEM, acknowledged: false, body: vec![0x02, 0x22] };
    us.send(at(0.0), &envelope);
    let first = datagrams(&mut us);
    let sent = judp::parse(&first[0].1).unwrap()[0];
    assert_eq!((first.len(), sent.ack, sent.broadcast, sent.sequence), (1, Ack::Wanted, Broadcast::Global, 65_535));
    for (seconds, again) in [(0.05, 0), (0.11, 1), (0.15, 0), (0.22, 1), (0.33, 0), (1.0, 0)] {
        us.tick(at(seconds));
        assert_eq!(datagrams(&mut us).len(), again, "after {seconds} s");
    }
    assert_eq!(drops(&us), [("never acknowledged", 1)]);
    us.send(at(2.0), &envelope);
    datagrams(&mut us);
    us.receive(at(2.01), address(9), &Packet { ack: Ack::Positive, ..packet(&[], 0) }.datagram());
    us.tick(at(2.2));
    assert_eq!(datagrams(&mut us).len(), 0);
    // Now the way is known: no broadcast, no acknowledgement asked.
    us.send(at(3.0), &envelope);
    let direct = datagrams(&mut us);
    let sent = judp::parse(&direct[0].1).unwrap()[0];
    assert_eq!((direct[0].0, sent.ack, sent.broadcast, sent.sequence), (address(9), Ack::None, Broadcast::None, 1));
}

#[test]
fn a_long_message_arrives_whole_in_any_order_of_its_parts() {
    let body: Vec<u8> = (0..10_000).map(|i| (i % 251) as u8).collect();
    let mut them = Transport::new(options(THEM));
    them.receive(at(0.0), address(1), &Packet { source: US, destination: THEM, ..packet(&[0x02, 0x22], 0) }.datagram());
    them.options.first_sequence = 65_534;
    them.send(at(0.0), &Envelope { source: THEM, destination: US, acknowledged: true, body: body.clone() });
    let parts = datagrams(&mut them);
    assert_eq!(parts.len(), 3);
    for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0], [1, 0, 2]] {
        let mut us = us();
        for i in order {
            us.receive(at(0.0), address(9), &parts[i].1);
        }
        assert_eq!(messages(&mut us), std::slice::from_ref(&body), "{order:?}");
        assert_eq!((datagrams(&mut us).len(), us.kept_bytes()), (3, 0));
    }
    let mut us = us();
    us.receive(at(0.0), address(9), &parts[0].1);
    us.receive(at(0.0), address(9), &parts[2].1);
    datagrams(&mut us);
    assert_eq!(us.kept_bytes(), BODY_MAX + 10_000 - 2 * BODY_MAX);
    us.tick(at(2.5));
    assert_eq!((messages(&mut us).len(), us.kept_bytes(), drops(&us)), (0, 0, vec![("message never whole", 1)]));
}

#[test]
fn who_is_not_allowed_or_claims_an_id_from_elsewhere_changes_nothing() {
    let mut us = us();
    us.receive(at(0.0), address(9), &packet(&[0x02, 0x22], 1).datagram());
    us.receive(at(0.0), SocketAddr::from(([10, 0, 1, 9], 3794)), &packet(&[0x02, 0x22], 2).datagram());
    us.receive(at(1.0), address(8), &packet(&[0x02, 0x22], 3).datagram());
    us.receive(at(1.0), address(9), &Packet { source: US, ..packet(&[0x02, 0x22], 4) }.datagram());
    us.receive(at(1.0), address(9), &Packet { source: Id::ALL, ..packet(&[0x02, 0x22], 5) }.datagram());
    us.receive(
        at(1.0),
        address(9),
        &Packet { destination: THEM, source: Id::new(5, 5, 5), ..packet(&[1, 2], 6) }.datagram(),
    );
    assert_eq!((messages(&mut us).len(), us.peers()), (1, 1));
    let expected = [
        "id of another address",
        "impossible source id",
        "not for us",
        "our own id from elsewhere",
        "peer not allowed",
    ];
    assert_eq!(drops(&us), expected.map(|cause| (cause, 1)));
    assert_eq!(us.peers.address(THEM), Some(address(9)));
    // After a silence the peer may have moved.
    us.receive(at(11.0), address(8), &packet(&[0x02, 0x22], 7).datagram());
    assert_eq!(us.peers.address(THEM), Some(address(8)));
}

#[test]
fn a_flood_of_fragments_from_many_sources_stays_within_its_bounds() {
    let mut us = us();
    let body = vec![7; BODY_MAX];
    let mut sent = 0;
    for component in 1..=250_u8 {
        for sequence in 0..20 {
            let part = if sequence == 0 { Part::First } else { Part::Middle };
            let source = Id::new(9, 1, component);
            us.receive(at(0.0), address(9), &Packet { part, source, ..packet(&body, sequence) }.datagram());
            sent += 1;
        }
        assert!(us.kept_bytes() <= 16 * 64 * 1024, "{} bytes", us.kept_bytes());
    }
    assert_eq!(us.peers(), peers::PEERS_MAX);
    let counted: u64 = us.drops().values().sum();
    let (refused, kept) = (us.drops()["too many unfinished messages"], us.kept_bytes() / BODY_MAX);
    assert!(refused > 0 && us.drops()["too many peers"] > 0 && us.drops()["message in parts too long"] > 0);
    assert!(counted as usize + kept <= sent && counted > 4_000, "{counted} of {sent}");
    us.tick(at(2.5));
    assert_eq!(us.kept_bytes(), 0);
}

#[test]
fn what_is_never_taken_away_is_not_kept_without_end() {
    let mut us = us();
    us.receive(at(0.0), address(9), &packet(&[0x02, 0x22], 1).datagram());
    let envelope = Envelope { source: US, destination: THEM, acknowledged: false, body: vec![1; 100_000] };
    for _ in 0..1000 {
        us.send(at(0.0), &envelope);
    }
    assert!(us.kept_bytes() <= OUT_BYTES_MAX && us.kept_bytes() > OUT_BYTES_MAX - 110_000);
    // Messages are queued whole or not at all.
    let parts: Vec<Part> = datagrams(&mut us).iter().map(|(_, d)| judp::parse(d).unwrap()[0].part).collect();
    assert_eq!((parts.first(), parts.last()), (Some(&Part::First), Some(&Part::Last)));
    assert_eq!(us.drops()["send queue full"] as usize + parts.len() / 25, 1000);
}
