//! The ports of one graph within one process: samples, events, requests, versions, memory. Real shared memory, a
//! private domain per test, and nothing left of it at the end. Processes and kills are tested in the root's `tests/graph.rs`.
#![allow(clippy::disallowed_methods, reason = "tests look at files")]
#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

use bytemuck::Zeroable;
use tsense_contract::*;
use tsense_ports::{Clock, Domain, Host, PortError, Wake};

fn host(name: &str) -> Host {
    let domain = Domain::new(&format!("{name}{}", std::process::id() % 1_000_000)).unwrap();
    Host::open(domain, Clock::start(1.0), &std::env::temp_dir()).unwrap()
}

fn nothing_is_left(host: Host) {
    let domain = host.domain().clone();
    assert!(!domain.leftovers().is_empty());
    drop(host);
    assert_eq!(domain.leftovers(), Vec::<std::path::PathBuf>::new());
}

fn object(id: u64) -> Object {
    Object { id, ..Object::zeroed() }
}

#[test]
fn a_sample_arrives_whole_wakes_its_reader_and_stays_valid_while_held() {
    let mut host = host("a");
    host.offer::<Scan>(Some("front")).unwrap();
    let mut reader = host.observer("reader").unwrap();
    let mut writer = host.observer("writer").unwrap();
    let mut inbox = reader.inbox::<Scan>(Some("front")).unwrap();
    let mut outbox = writer.outbox::<Scan>(Some("front")).unwrap();
    assert_eq!(reader.wait(0.01), Wake::Timeout);
    let mut held = Vec::new();
    for sequence in 0..40_u64 {
        let header = ScanHeader { sequence, ..ScanHeader::zeroed() };
        let items: Vec<Return> =
            (0..1081).map(|i| Return { distance_mm: i + sequence as u32, ..Return::zeroed() }).collect();
        outbox.send(&header, &items).unwrap();
        assert_eq!(reader.wait(1.0), Wake::Data);
        let sample = inbox.take().unwrap().expect("one was sent");
        assert_eq!((sample.header().sequence, sample.items()), (sequence, &items[..]));
        if sequence < 3 {
            held.push(sample);
        }
    }
    assert!(
        held.iter()
            .enumerate()
            .all(|(i, s)| s.header().sequence == i as u64 && s.items()[7].distance_mm == 7 + i as u32)
    );
    drop((held, inbox, outbox, reader, writer));
    nothing_is_left(host);
}

#[test]
fn a_slow_reader_loses_the_oldest_and_a_hoarder_gets_an_error() {
    let mut host = host("b");
    host.offer::<Detections>(None).unwrap();
    let mut process = host.observer("both").unwrap();
    let mut inbox = process.inbox::<Detections>(None).unwrap();
    let mut outbox = process.outbox::<Detections>(None).unwrap();
    for snapshot in 0..20 {
        outbox.send(&DetectionsHeader { snapshot, ..DetectionsHeader::zeroed() }, &[]).unwrap();
    }
    // Eight wait; four may be held.
    let held: Vec<_> = (0..4).map(|_| inbox.take().unwrap().unwrap()).collect();
    assert_eq!(held.iter().map(|s| s.header().snapshot).collect::<Vec<_>>(), [12, 13, 14, 15]);
    let error = inbox.take().map(drop).unwrap_err();
    assert!(error.to_string().contains("at most 4 samples"), "{error}");
    let error = outbox.send(&DetectionsHeader::zeroed(), &[Detection::zeroed(); 1025]).unwrap_err();
    assert!(matches!(error, PortError::TooManyItems { len: 1025, max: 1024, .. }), "{error}");
    drop((held, inbox, outbox, process));
    nothing_is_left(host);
}

#[test]
fn a_late_joiner_gets_the_history_at_the_writers_next_tick() {
    let mut host = host("c");
    host.offer::<Poses>(None).unwrap();
    let mut writer = host.observer("gpos").unwrap();
    let mut outbox = writer.outbox::<Poses>(None).unwrap();
    for stamp_ns in 1..=3 {
        outbox.send(&Pose { stamp_ns, ..Pose::zeroed() }, &[]).unwrap();
    }
    let mut reader = host.observer("mapper").unwrap();
    let mut inbox = reader.inbox::<Poses>(None).unwrap();
    writer.wait(0.25);
    assert_eq!(reader.wait(0.5), Wake::Data);
    assert_eq!(inbox.take().unwrap().unwrap().header().stamp_ns, 3);
    assert!(inbox.take().unwrap().is_none());
    drop((inbox, outbox, reader, writer));
    nothing_is_left(host);
}

#[test]
fn events_coalesce_and_wake() {
    let mut host = host("d");
    host.offer_event(MAP_KEYFRAME).unwrap();
    let mut process = host.observer("mapper").unwrap();
    let mut receiver = process.event_receiver(MAP_KEYFRAME).unwrap();
    let sender = process.event_sender(MAP_KEYFRAME).unwrap();
    assert!(!receiver.drain());
    (0..5).for_each(|_| sender.notify().unwrap());
    assert_eq!(process.wait(1.0), Wake::Data);
    assert!(receiver.drain());
    assert!(!receiver.drain());
    assert_eq!(process.wait(0.01), Wake::Timeout);
    drop((receiver, sender, process));
    nothing_is_left(host);
}

#[test]
fn a_request_is_answered_and_an_absent_server_is_an_error_in_time() {
    let mut host = host("e");
    host.offer_requests::<Store>().unwrap();
    let domain = host.domain().clone();
    let mut process = host.observer("kstore").unwrap();
    let query = StoreQuery { limit: 3, ..StoreQuery::zeroed() };
    let mut client = process.client::<Store>().unwrap();
    let error = client.ask(&query, 0.05).unwrap_err();
    assert!(error.to_string().starts_with("store: no answer within 0.1 s"), "{error}");
    let serving = std::thread::spawn(move || {
        let mut process = tsense_ports::Process::observe(&domain, "server").unwrap();
        let mut server = process.server::<Store>().unwrap();
        let mut served = 0;
        while served < 3 {
            process.wait(1.0);
            served += server
                .serve(|query| {
                    let items = (0..u64::from(query.limit)).map(object).collect();
                    (ObjectsHeader { stored: 77, ..ObjectsHeader::zeroed() }, items)
                })
                .unwrap();
        }
    });
    for _ in 0..3 {
        let (header, items) = client.ask(&query, 2.0).unwrap();
        assert_eq!((header.stored, items.iter().map(|o| o.id).collect::<Vec<_>>()), (77, vec![0, 1, 2]));
    }
    serving.join().unwrap();
    drop((client, process));
    nothing_is_left(host);
}

/// The topic `pose` as another version of this program would have it.
struct ForeignPoses;

impl Topic for ForeignPoses {
    type Header = Joint;
    type Item = Nothing;
    const NAME: &'static str = Poses::NAME;
    const QOS: Qos = Poses::QOS;
    const ITEMS_MAX: usize = 1;
}

#[test]
fn a_foreign_version_of_a_message_is_refused_at_open_and_named() {
    let mut host = host("f");
    host.offer::<Poses>(None).unwrap();
    let mut process = host.observer("old").unwrap();
    let error = process.inbox::<ForeignPoses>(None).map(drop).unwrap_err();
    assert!(matches!(error, PortError::OtherVersion { .. }), "{error}");
    assert!(error.to_string().contains("pose: this program speaks tsense.joint.v1"), "{error}");
    let error = process.outbox::<ForeignPoses>(None).map(drop).unwrap_err();
    assert!(matches!(error, PortError::OtherVersion { .. }), "{error}");
    drop(process);
    nothing_is_left(host);
}

#[test]
fn a_second_writer_of_a_topic_is_refused() {
    let mut host = host("g");
    host.offer::<Joints>(None).unwrap();
    let mut process = host.observer("pan-tilt").unwrap();
    let first = process.outbox::<Joints>(None).unwrap();
    let error = process.outbox::<Joints>(None).map(drop).unwrap_err();
    assert!(matches!(error, PortError::Full { .. }), "{error}");
    drop(first);
    drop(process.outbox::<Joints>(None).unwrap());
    drop(process);
    nothing_is_left(host);
}

#[test]
fn the_map_uses_memory_for_the_blocks_in_use_and_not_for_the_worst_case() {
    let mut host = host("h");
    host.offer::<Map>(None).unwrap();
    let mut process = host.observer("mapper").unwrap();
    let mut inbox = process.inbox::<Map>(None).unwrap();
    let mut outbox = process.outbox::<Map>(None).unwrap();
    let (mut held, mut sent) = (std::collections::VecDeque::new(), 0_u32);
    for version in 0..200 {
        let header = MapHeader { version, ..MapHeader::zeroed() };
        outbox.send_with(&header, BRICKS_PER_BLOCK, |bricks| bricks.fill(Brick::UNKNOWN)).unwrap();
        sent += 1;
        held.push_back(inbox.take().unwrap().unwrap());
        if held.len() > 16 {
            held.pop_front();
        }
    }
    let used = used_bytes(host.domain().prefix());
    println!("{sent} blocks of 0.8 MB sent, 16 held: {:.1} MB of shared memory in use", used as f64 / 1e6);
    // 16 held, one in hand, one loaned, and what the middleware keeps for itself.
    assert!(used < 24 * 800_176, "{used}");
    drop((held, inbox, outbox, process));
    nothing_is_left(host);
}

/// Bytes the graph's shared memory really occupies: blocks of the tmpfs, not lengths.
fn used_bytes(prefix: &str) -> u64 {
    use std::os::unix::fs::MetadataExt;
    let files = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let ours = files.filter(|f| f.file_name().to_string_lossy().starts_with(prefix));
    ours.map(|f| f.metadata().unwrap().blocks() * 512).sum()
}
