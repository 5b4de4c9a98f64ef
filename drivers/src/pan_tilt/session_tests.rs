//! Sessions against the scripted unit of `fake_unit.rs`, in simulated time.

use super::fake_unit::{BYTE_NS, FakeUnit};
use super::*;
use std::collections::VecDeque;
use tsense_contract::{JOINT_HALTED, JOINT_LIMIT_HIT, Joint, ProcessState};
use tsense_geometry::Timestamp;

const STEP_NS: i64 = 250_000;

/// One driver, one unit, one line, in simulated time.
struct Bench {
    session: Session,
    unit: FakeUnit,
    now_ns: i64,
    open: bool,
    to_unit: VecDeque<(i64, u8)>,
    joints: Vec<(Joint, f64)>,
    events: Vec<Event>,
    opened: u32,
}

impl Bench {
    fn new(config: Config, unit: FakeUnit) -> Self {
        let session = Session::new(&config, Purpose::Drive);
        Self {
            session,
            unit,
            now_ns: 0,
            open: false,
            to_unit: VecDeque::new(),
            joints: vec![],
            events: vec![],
            opened: 0,
        }
    }

    fn now(&self) -> Timestamp {
        Timestamp::from_ns(self.now_ns)
    }

    fn run(&mut self, seconds: f64) {
        let end_ns = self.now_ns + (seconds * 1e9) as i64;
        while self.now_ns < end_ns {
            self.now_ns += STEP_NS;
            self.deliver();
            self.session.tick(self.now());
            self.handle_events();
            self.write();
        }
    }

    fn deliver(&mut self) {
        while self.to_unit.front().is_some_and(|(ns, _)| *ns <= self.now_ns) {
            let (ns, byte) = self.to_unit.pop_front().unwrap();
            self.unit.take(ns, byte);
        }
        let mut bytes = Vec::new();
        while self.unit.output.front().is_some_and(|(ns, _)| *ns <= self.now_ns) {
            bytes.push(self.unit.output.pop_front().unwrap().1);
        }
        if self.open && !bytes.is_empty() {
            self.session.receive(self.now(), &bytes);
        }
    }

    fn handle_events(&mut self) {
        while let Some(event) = self.session.event() {
            match &event {
                Event::Open => {
                    self.open = true;
                    self.opened += 1;
                    self.session.opened(self.now());
                }
                Event::Close => self.open = false,
                Event::Joint(joint) => {
                    self.unit.move_to(self.now_ns);
                    self.joints.push((*joint, self.now_ns as f64 / 1e9));
                }
                _ => {}
            }
            self.events.push(event);
        }
    }

    fn write(&mut self) {
        if let Some(bytes) = self.session.take_outgoing() {
            let mut ns = self.now_ns;
            for byte in bytes {
                ns += BYTE_NS;
                self.to_unit.push_back((ns, byte));
            }
            self.session.written(self.now());
        }
    }

    fn dropped(&self, cause: &str) -> usize {
        self.events.iter().filter(|event| matches!(event, Event::Dropped(c) if *c == cause)).count()
    }

    fn flags(&self) -> u8 {
        self.joints.last().unwrap().0.flags
    }
}

fn nodding(combined: bool) -> Bench {
    let mut bench = Bench::new(Config::default(), FakeUnit::new(combined));
    bench.run(2.0);
    assert_eq!(bench.session.condition().0, ProcessState::Running, "{:?}", bench.events);
    bench
}

#[test]
fn the_unit_is_woken_asked_and_set_up_before_it_moves() {
    let bench = nodding(false);
    let log = bench.unit.log.join(" ");
    assert_eq!(
        &log[..log.find("TP-583").unwrap()],
        "ED FT V PR TR PN TN PX TX PL TL PU TU PP TP B H LE I CI PS389 TS389 TP PP0 ",
    );
    let Some(Event::Surveyed(unit)) = bench.events.iter().find(|e| matches!(e, Event::Surveyed(_))) else { panic!() };
    assert_eq!((unit.tilt.least, unit.tilt.greatest, unit.combined_query), (Some(-907), Some(604), false));
}

#[test]
fn angles_are_true_at_their_stamps_and_turns_do_not_break_the_cadence() {
    for combined in [false, true] {
        let mut bench = nodding(combined);
        bench.joints.clear();
        bench.run(10.0);
        // 45 degrees at 20 degrees/s: a turn every 2.25 s.
        let sweep = bench.joints.last().unwrap().0.sweep;
        assert!((4..=6).contains(&sweep), "{sweep} sweeps");
        let mut widest_s = 0.0_f64;
        for pair in bench.joints.windows(2) {
            let [(a, _), (b, read_s)] = pair else { unreachable!() };
            widest_s = widest_s.max((b.stamp_ns - a.stamp_ns) as f64 / 1e9);
            assert!(*read_s > b.stamp_ns as f64 / 1e9, "stamped after it was read");
        }
        let rate_hz = bench.joints.len() as f64 / 10.0;
        let (least_hz, gap_s) = if combined { (30.0, 0.075) } else { (60.0, 0.045) };
        assert!(rate_hz > least_hz, "{rate_hz} Hz with B: {combined}");
        assert!(widest_s < gap_s, "widest gap {widest_s} s with B: {combined}");
    }
}

/// The head moves at a constant rate, so tilt over stamp must be a straight line: its residual is the stamp's error.
#[test]
fn stamps_follow_a_moving_head_within_a_millisecond() {
    let mut bench = nodding(false);
    bench.run(1.2);
    bench.joints.clear();
    bench.run(0.5);
    let rate = f64::from(bench.joints[10].0.tilt_rate_rad_s).signum() * 389.0 * (185.1428_f64 / 3600.0).to_radians();
    let mut compared = 0;
    bench.unit.move_to(bench.now_ns);
    let truth_rad = bench.unit.position[1] * (185.1428_f64 / 3600.0).to_radians();
    for (joint, _) in &bench.joints {
        let back_s = (bench.now_ns - joint.stamp_ns) as f64 / 1e9;
        let lag_s = (joint.tilt_rad - (truth_rad - rate * back_s)) / rate;
        // The unit here samples at the delimiter, the driver believes 1 ms later; a count is 2.6 ms of motion, the
        // step of this simulation 0.25 ms.
        assert!((lag_s + 0.001).abs() < 0.0021, "{lag_s} s");
        assert!(joint.stamp_std_ns < 1_500_000, "{} ns", joint.stamp_std_ns);
        compared += 1;
    }
    assert!(compared > 30);
}

#[test]
fn a_limit_mark_glued_to_an_answer_marks_the_angles_and_halts_the_head_until_told_otherwise() {
    let mut bench = nodding(false);
    bench.unit.glue = "!P";
    bench.run(1.0);
    assert_eq!(bench.flags(), JOINT_LIMIT_HIT | JOINT_HALTED);
    assert_eq!(bench.session.condition().0, ProcessState::Degraded);
    let stood = bench.unit.position[1];
    bench.run(30.0);
    assert_eq!(bench.unit.position[1], stood, "the head was left standing");
    assert!(!bench.unit.log.contains(&"R".into()), "never reset by itself");
    assert_eq!(bench.flags(), JOINT_LIMIT_HIT | JOINT_HALTED);
    assert_eq!(bench.opened, 1, "the answer behind the mark was not lost");
}

#[test]
fn with_consent_a_limit_is_followed_by_a_reset_and_the_nod_goes_on() {
    let mut bench = Bench::new(Config { reset_allowed: true, ..Config::default() }, FakeUnit::new(false));
    bench.run(2.0);
    bench.unit.glue = "!T";
    bench.run(3.0);
    assert_eq!(bench.unit.log.iter().filter(|command| *command == "R").count(), 1);
    assert_eq!((bench.flags(), bench.session.condition().0), (0, ProcessState::Running));
}

#[test]
fn one_lost_answer_costs_a_gap_and_never_mixes_up_the_axes() {
    let mut bench = nodding(false);
    for round in 0..20 {
        bench.unit.lose = 1;
        bench.run(0.3 + f64::from(round) * 0.001);
    }
    assert_eq!(bench.opened, 1);
    assert_eq!(bench.dropped("answer timeout"), 20);
    assert!(bench.joints.iter().all(|(joint, _)| joint.pan_rad.abs() < 1e-9), "pan stands at 0");
    assert_eq!(bench.session.condition().0, ProcessState::Running);
}

#[test]
fn an_answer_that_was_read_too_late_to_tell_its_instant_is_dropped() {
    let mut bench = nodding(false);
    let before = bench.joints.len();
    while bench.joints.len() == before {
        bench.run(0.001);
    }
    // The next poll is on its way when the process is not let run for 60 ms: half of that is the uncertainty of the answer that waited.
    bench.now_ns += 60_000_000;
    bench.run(0.5);
    assert_eq!(bench.dropped("instant too uncertain"), 1);
    assert!(bench.joints.len() > before + 20);
    assert!(bench.joints.iter().all(|(joint, _)| joint.stamp_std_ns <= 15_000_000));
}

#[test]
fn a_silent_unit_is_opened_again_with_growing_pauses() {
    let mut bench = nodding(false);
    bench.unit.lose = u32::MAX;
    bench.run(1.0);
    assert_eq!(bench.session.condition().0, ProcessState::Stale);
    bench.run(59.0);
    // 0.5, 1, 2, 4, 8, 8 ... seconds plus about a second each to find it silent.
    assert!((7..=10).contains(&bench.opened), "{} times", bench.opened);
    bench.unit.lose = 0;
    bench.run(10.0);
    assert_eq!(bench.session.condition().0, ProcessState::Running);
}

#[test]
fn the_head_halts_on_loss_of_control_and_nods_again_when_it_is_back() {
    let mut bench = nodding(true);
    bench.session.set_may_move(Err("no pose for 5 s".into()));
    bench.run(0.2);
    let stood = bench.unit.position[1];
    bench.run(2.0);
    assert_eq!((bench.unit.position[1], bench.flags()), (stood, JOINT_HALTED));
    assert_eq!(bench.session.condition(), (ProcessState::Degraded, "halted: no pose for 5 s".into()));
    bench.session.set_may_move(Ok(()));
    bench.run(1.0);
    assert_ne!(bench.unit.position[1], stood);
    assert_eq!(bench.flags(), 0);
}

#[test]
fn a_stopped_session_halts_the_head_and_says_when_it_did() {
    let mut bench = nodding(false);
    bench.session.stop();
    bench.run(0.3);
    assert_eq!(bench.unit.log.last().unwrap(), "H");
    assert!(bench.events.contains(&Event::Stopped));
    let sent = bench.unit.log.len();
    bench.run(1.0);
    assert_eq!(bench.unit.log.len(), sent, "silent after the halt");
}

#[test]
fn a_range_beyond_the_unit_is_not_driven_but_still_measured() {
    let mut bench = Bench::new(Config { tilt_max_deg: 40.0, ..Config::default() }, FakeUnit::new(false));
    bench.run(3.0);
    let (state, reason) = bench.session.condition();
    assert_eq!(state, ProcessState::Degraded);
    assert!(reason.contains("778 counts of tilt"), "{reason}");
    assert_eq!(bench.unit.position, [0.0, 100.0]);
    assert!(bench.joints.len() > 50);
}

#[test]
fn a_look_moves_nothing() {
    let mut bench = Bench::new(Config::default(), FakeUnit::new(true));
    bench.session = Session::new(&Config::default(), Purpose::Look);
    bench.run(2.0);
    assert!(bench.events.contains(&Event::Stopped));
    assert!(bench.unit.log.iter().all(|command| !command.contains(|c: char| c.is_ascii_digit()) && command != "H"));
    let Some(Event::Surveyed(unit)) = bench.events.iter().find(|e| matches!(e, Event::Surveyed(_))) else { panic!() };
    assert!(unit.combined_query);
    assert!(
        unit.to_string().contains("tilt: 185.1428 arcsec a count, at 5.14 deg, from -46.65 to 31.06 deg"),
        "{unit}"
    );
}

proptest::proptest! {
    #[test]
    fn random_bytes_at_random_times_never_panic(
        chunks in proptest::collection::vec((0_i64..200, proptest::collection::vec(proptest::prelude::any::<u8>(), 0..40)), 0..40),
    ) {
        let mut bench = nodding(false);
        for (ms, bytes) in chunks {
            bench.session.receive(bench.now(), &bytes);
            bench.run(ms as f64 / 1e3);
        }
        while bench.session.event().is_some() {}
    }
}
