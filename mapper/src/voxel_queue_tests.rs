//! Other sensors' voxels through the whole mapper: when they count, and what is refused.

use crate::config::Config;
use crate::drops::DropCause;
use crate::ladar_mount::LadarMount;
use crate::mapper::Mapper;
use crate::testing::{pose_at, scan_at, voxel_at};
use crate::voxel_map::Voxel;
use crate::voxel_sensor::VoxelSensor;
use proptest::prelude::*;
use tsense_contract::{SensedVoxel, VoxelState, VoxelsHeader, VoxelsKind};
use tsense_geometry::{Point, Timestamp};

const AT: [f64; 3] = [500_000.05, 5_000_000.05, 100.05];
/// Three metres from the vehicle, where no beam of the tests passes.
const ABOVE: [f64; 3] = [500_000.05, 5_000_000.05, 103.05];

fn sensor(name: &str) -> VoxelSensor {
    VoxelSensor { name: name.into(), weight: 0.25, ..VoxelSensor::default() }
}

/// A mapper with two sensors and windows of 0.3 s, and the first pose at second 1000.
fn mapper(mounts: Vec<LadarMount>) -> Mapper {
    let config = Config { voxel_sensor: vec![sensor("stereo"), sensor("radar")], ..Config::default() };
    let mut mapper = Mapper::new(&config, mounts, 1).unwrap();
    assert!(mapper.add_pose(&pose_at(1000.0, AT)));
    mapper
}

fn fixed_ladar() -> Vec<LadarMount> {
    vec![LadarMount { on_pan_tilt: false, ..LadarMount::default() }]
}

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_seconds(seconds)
}

fn trace_all(mapper: &mut Mapper, now_s: f64) {
    while mapper.trace_next(at(now_s)).is_some() {}
}

/// A pose and a scan; what waits is traced.
fn scan(mapper: &mut Mapper, seconds: f64) {
    assert!(mapper.add_pose(&pose_at(seconds + 0.01, AT)));
    let (header, returns) = scan_at(seconds);
    assert!(mapper.add_scan(0, &header, &returns, at(seconds + 0.01)));
    trace_all(mapper, seconds + 0.01);
}

fn there(mapper: &Mapper, place_m: [f64; 3]) -> Voxel {
    let [x, y, z] = place_m;
    mapper.map().voxel(mapper.map().grid().index_of(Point::new(x, y, z)).unwrap())
}

fn add(mapper: &mut Mapper, sensor: usize, seconds: f64, now_s: f64) -> bool {
    let (header, items) = voxel_at(seconds, ABOVE, VoxelState::Occupied);
    mapper.add_voxels(sensor, &header, &items, at(now_s))
}

#[test]
fn voxels_count_in_the_window_of_their_own_time_however_late_they_come() {
    // The window opens with the scan at 0.1 and ends before that at 0.5: one measurement lies in each, two in the second.
    let confidences = |arrivals: &[(usize, f64, f64)]| {
        let (mut mapper, mut left) = (mapper(fixed_ladar()), arrivals.to_vec());
        let mut confidences = Vec::new();
        for i in 1..=9 {
            let now_s = 1000.0 + f64::from(i) * 0.1;
            for (sensor, seconds, _) in left.extract_if(.., |(_, _, arrives_s)| *arrives_s <= now_s) {
                assert!(add(&mut mapper, sensor, seconds, now_s));
            }
            scan(&mut mapper, now_s);
            confidences.push(there(&mapper, ABOVE).confidence);
        }
        assert_eq!((left.len(), mapper.placer().drops().total()), (0, 0));
        confidences
    };
    let expected = [0, 2, 2, 2, 2, 4, 4, 4, 4];
    // As they are measured, and the second one before its time: it waits for the scans.
    assert_eq!(confidences(&[(0, 1000.15, 1000.2), (0, 1000.55, 1000.55), (1, 1000.57, 1000.6)]), expected);
    assert_eq!(confidences(&[(0, 1000.15, 1000.2), (1, 1000.57, 1000.57), (0, 1000.55, 1000.57)]), expected);
}

#[test]
fn without_ladars_another_sensor_makes_a_map_of_its_own_and_a_prior_makes_it_no_newer() {
    let mut mapper = mapper(vec![]);
    for i in 0..10 {
        let now_s = 1000.0 + f64::from(i) * 0.1;
        assert!(add(&mut mapper, 0, now_s, now_s));
        trace_all(&mut mapper, now_s + 0.001);
    }
    // Windows of 0.3 s: three have ended, and the fourth is open.
    assert_eq!((there(&mapper, ABOVE).confidence, mapper.newest()), (8, Some(at(1000.9))));
    let (header, items) = voxel_at(1001.0, AT, VoxelState::Occupied);
    let prior = VoxelsHeader { kind: VoxelsKind::Prior.to_wire(), ..header };
    assert!(mapper.add_voxels(1, &prior, &items, at(1001.0)));
    trace_all(&mut mapper, 1001.1);
    assert_eq!((there(&mapper, AT).state, mapper.newest()), (VoxelState::Occupied, Some(at(1000.9))));
    assert_eq!(mapper.placer().drops().total(), 0);
}

#[test]
fn voxels_wait_for_scans_no_longer_than_scans_do_for_poses() {
    let mut mapper = mapper(fixed_ladar());
    assert!(add(&mut mapper, 0, 1000.1, 1000.1));
    trace_all(&mut mapper, 1000.55);
    assert_eq!(there(&mapper, ABOVE).state, VoxelState::Unknown);
    trace_all(&mut mapper, 1000.65);
    assert_eq!(there(&mapper, ABOVE).state, VoxelState::Occupied);
}

#[test]
fn what_cannot_be_meant_is_dropped_by_cause() {
    let (good, items) = voxel_at(1000.1, AT, VoxelState::Occupied);
    let far = VoxelsHeader { origin_m: [AT[0] + 5e3, AT[1], AT[2]], ..good };
    let of = |header: VoxelsHeader| {
        let mut mapper = mapper(fixed_ladar());
        let taken = mapper.add_voxels(0, &header, &items, at(1000.2));
        trace_all(&mut mapper, 1001.0);
        let drops = mapper.placer().drops();
        let causes: Vec<DropCause> = DropCause::ALL.into_iter().filter(|cause| drops.of(*cause) > 0).collect();
        (taken, causes)
    };
    assert_eq!(of(good), (true, vec![]));
    let stamped = |s: f64| VoxelsHeader { stamp_ns: at(s).ns, ..good };
    let sized = |voxel_size_m: f64| VoxelsHeader { voxel_size_m, ..good };
    for (header, taken, cause) in [
        (VoxelsHeader { origin_m: [0.0, f64::NAN, 0.0], ..good }, false, DropCause::VoxelsInvalid),
        (VoxelsHeader { origin_m: [1e300, 0.0, 0.0], ..good }, false, DropCause::VoxelsInvalid),
        (sized(f64::NAN), false, DropCause::VoxelsSize),
        (sized(0.0), false, DropCause::VoxelsSize),
        (sized(0.61), false, DropCause::VoxelsSize),
        (VoxelsHeader { zone: 33, ..good }, false, DropCause::VoxelsZone),
        (VoxelsHeader { south: 1, ..good }, false, DropCause::VoxelsZone),
        (stamped(999.1), false, DropCause::VoxelsOld),
        (VoxelsHeader { stamp_ns: i64::MIN, ..good }, false, DropCause::VoxelsOld),
        (stamped(1000.3), false, DropCause::VoxelsAhead),
        (VoxelsHeader { stamp_ns: i64::MAX, ..good }, false, DropCause::VoxelsAhead),
        (far, true, DropCause::VoxelsOutside),
    ] {
        assert_eq!(of(header), (taken, vec![cause]), "{header:?}");
    }
}

#[test]
fn order_gaps_and_numbers_of_sensors_are_minded_and_the_queue_is_bounded() {
    let mut mapper = mapper(fixed_ladar());
    let (good, items) = voxel_at(1000.1, AT, VoxelState::Free);
    let mut add = |sensor, sequence, stamp_s| {
        let header = VoxelsHeader { stamp_ns: at(stamp_s).ns, sequence, ..good };
        mapper.add_voxels(sensor, &header, &items, at(1000.2))
    };
    assert!(add(0, 5, 1000.1) && add(0, 6, 1000.1), "several samples of one stamp");
    assert!(add(1, 99, 1000.05), "each sensor by itself");
    assert!(!add(0, 7, 1000.05), "earlier than those before");
    assert!(add(0, 10, 1000.15), "8 and 9 were overtaken");
    assert!(add(0, 0, 1000.15) && add(0, u64::MAX, 1000.15), "started anew");
    assert!(!add(2, 0, 1000.15), "there is no sensor 2");
    (0..30).for_each(|i| assert!(add(1, 100 + i, 1000.16)));
    let drops = *mapper.placer().drops();
    let counted = [DropCause::VoxelsOutOfOrder, DropCause::VoxelsOvertaken, DropCause::VoxelsInvalid];
    assert_eq!(counted.map(|cause| drops.of(cause)), [1, 2, 1]);
    assert_eq!((drops.of(DropCause::VoxelsQueueFull), drops.total()), (4, 8));
    let mut early = Mapper::new(&Config { voxel_sensor: vec![sensor("a")], ..Config::default() }, vec![], 1).unwrap();
    assert!(!early.add_voxels(0, &good, &items, at(1000.2)));
    assert_eq!(early.placer().drops().of(DropCause::VoxelsNoPose), 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]
    #[test]
    fn no_bytes_of_the_topic_end_the_mapper_and_each_sample_is_taken_or_counted(
        samples in prop::collection::vec(
            (prop::array::uniform32(any::<u8>()), prop::array::uniform32(any::<u8>()), any::<[bool; 6]>(), 0..200usize),
            1..8,
        ),
        bytes in prop::collection::vec(any::<u8>(), 16 * 200),
    ) {
        let mut mapper = mapper(fixed_ladar());
        for (i, (head, tail, sane, len)) in samples.iter().enumerate() {
            let now_s = 1000.1 + i as f64 * 0.1;
            let mut header: VoxelsHeader = bytemuck::pod_read_unaligned(&[head.as_slice(), tail].concat()[..size_of::<VoxelsHeader>()]);
            // Header by header something makes sense, or nothing would come as far as the map.
            if sane[0] { header.stamp_ns = at(now_s).ns; }
            if sane[1] { header.origin_m = AT; }
            if sane[2] { header.voxel_size_m = [0.15, 0.6, 0.01][len % 3]; }
            if sane[3] { (header.zone, header.south) = (32, 0); }
            let mut items: Vec<SensedVoxel> = bytemuck::cast_slice(&bytes).to_vec();
            items.truncate(*len);
            if sane[4] { items.iter_mut().for_each(|item| item.xyz_m = item.xyz_m.map(|c| c % 20.0)); }
            if sane[5] { items.iter_mut().for_each(|item| item.state %= 3); }
            let before = mapper.placer().drops().total();
            let taken = mapper.add_voxels(i % 3, &header, &items, at(now_s));
            prop_assert!(taken || mapper.placer().drops().total() > before);
            scan(&mut mapper, now_s);
        }
        prop_assert!(mapper.map().block_slots() == 27);
    }
}
