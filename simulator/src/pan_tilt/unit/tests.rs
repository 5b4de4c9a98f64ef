//! Dialogues with the unit, as its manual and the shared notes give them.

use super::*;

struct Bench {
    unit: Unit,
    head: Head,
}

fn t(s: f64) -> Timestamp {
    Timestamp::from_seconds(1e9 + s)
}

impl Bench {
    fn new(resolution_arcsec: f64) -> Self {
        let options = PanTiltOptions { resolution_arcsec, ..PanTiltOptions::default() };
        Self { unit: Unit::new(&options), head: Head::new(resolution_arcsec) }
    }

    fn terse(resolution_arcsec: f64) -> Self {
        let mut bench = Self::new(resolution_arcsec);
        bench.say("ED FT ", 0.0);
        bench
    }

    fn replies(&mut self, text: &str, at_s: f64) -> Vec<Reply> {
        text.bytes().flat_map(|b| self.unit.input(&mut self.head, b, t(at_s))).collect()
    }

    fn say(&mut self, text: &str, at_s: f64) -> String {
        self.replies(text, at_s).into_iter().map(|r| r.text).collect()
    }
}

#[test]
fn at_power_up_it_echoes_and_speaks_in_sentences() {
    let mut bench = Bench::new(185.1428);
    bench.say("pp22 ", 0.0);
    assert_eq!(bench.say("PP ", 5.0), "PP * Current Pan position is 22\r\n");
    assert_eq!(bench.say("TR\r", 5.0), "TR\r* 185.1428 seconds arc per position\r\n");
    assert_eq!(bench.say("ED ", 5.0), "ED *\r\n");
    assert_eq!(bench.say("FT ", 5.0), "*\r\n");
    assert_eq!(bench.say("PP ", 5.0), "* 22\r\n");
    assert_eq!(bench.say("PR ", 5.0), "* 185.1428\r\n");
}

#[test]
fn limits_are_those_of_the_d46_and_refuse_what_lies_beyond() {
    let mut bench = Bench::terse(185.1428);
    assert_eq!(bench.say("PN PX TN TX ", 0.0), "* -3090\r\n* 3090\r\n* -907\r\n* 604\r\n");
    assert_eq!(bench.say("PP4000 ", 0.0), "! Maximum allowable Pan position is 3090\r\n");
    assert_eq!(bench.say("TP-1000 ", 0.0), "! Minimum allowable Tilt position is -907\r\n");
    assert_eq!(bench.say("PS9999 ", 0.0), "! Pan speed cannot exceed 2902 positions/sec\r\n");
    assert_eq!(bench.say("TS5 ", 0.0), "! Motor speed cannot be less than 31 pos/sec\r\n");
    assert_eq!(bench.say("QQ ", 0.0), "! Illegal command entered\r\n");
    assert_eq!(bench.say("PPx ", 0.0), "! Illegal command entered\r\n");
    let mut fine = Bench::terse(46.2857);
    assert_eq!(fine.say("PX ", 0.0), "* 12360\r\n");
}

#[test]
fn positions_turn_into_angles_with_the_makers_signs() {
    let mut bench = Bench::terse(46.2857);
    bench.say("PP7000 TP-2333 ", 0.0);
    let angles = bench.head.angles(t(20.0));
    assert!((angles.pan_rad.to_degrees() + 90.0).abs() < 0.01, "positive pan is to the left");
    assert!((angles.tilt_rad.to_degrees() + 30.0).abs() < 0.01, "positive tilt is up");
}

#[test]
fn slaved_positions_wait_for_a_and_a_answers_when_motion_ends() {
    let mut bench = Bench::terse(185.1428);
    assert_eq!(bench.say("S PP1000 ", 0.0), "*\r\n*\r\n");
    assert_eq!(bench.say("PP ", 5.0), "* 0\r\n");
    let replies = bench.replies("A ", 5.0);
    // 1000 positions at 1000 a second, starting at 57 a second with 2000 a second squared: about 1.4 s.
    let wait_s = replies[0].at.seconds_since(t(5.0));
    assert!((1.35..1.5).contains(&wait_s), "{wait_s}");
    assert_eq!(bench.say("PP ", 7.0), "* 1000\r\n");
}

#[test]
fn pure_velocity_runs_to_the_limit_and_says_so() {
    let mut bench = Bench::terse(185.1428);
    bench.say("CV TS-500 ", 0.0);
    assert!(bench.unit.events(&mut bench.head, t(1.0)).is_empty());
    assert_eq!(bench.say("TD ", 1.0), "* -500\r\n");
    let events = bench.unit.events(&mut bench.head, t(4.0));
    assert_eq!(events.iter().map(|e| e.text.as_str()).collect::<Vec<_>>(), ["!T"]);
    assert_eq!(bench.say("TP ", 4.0), "* -907\r\n");
}

#[test]
fn the_monitor_scans_until_any_character_sends_it_home() {
    let mut bench = Bench::terse(185.1428);
    bench.say("M-500,500 ", 0.0);
    for k in 0..100 {
        bench.unit.events(&mut bench.head, t(0.1 * f64::from(k)));
    }
    assert!(bench.head.axes[0].target().abs() > 400.0);
    bench.say("P", 10.0);
    assert_eq!(bench.head.axes[0].target(), 0.0);
}

#[test]
fn one_answer_tells_everything_and_a_halt_stops_it() {
    let mut bench = Bench::terse(46.2857);
    bench.say("B1000,-500,2000,2000 ", 0.0);
    assert_eq!(bench.say("B ", 5.0), "* 1000,-500,0,0\r\n");
    bench.say("PP9000 ", 6.0);
    assert_eq!(bench.say("H ", 7.0), "*\r\n");
    let stopped = bench.say("PP ", 9.0);
    assert_ne!(stopped, "* 9000\r\n");
    assert_eq!(bench.say("PP ", 19.0), stopped);
    assert_eq!(bench.say("R ", 20.0), "!T!T!P!P*\r\n");
}

#[test]
fn no_bytes_make_it_fail() {
    let mut rng = crate::rng::Rng::new(6);
    let mut bench = Bench::new(46.2857);
    let letters = b"PTSABORDMCLHEVF0123456789-,+ .\r\n_\xff";
    for k in 0..50_000 {
        let byte = letters[(rng.bits() % letters.len() as u64) as usize];
        bench.unit.input(&mut bench.head, byte, t(f64::from(k) * 0.001));
        bench.unit.events(&mut bench.head, t(f64::from(k) * 0.001));
    }
    assert!(bench.head.axes[0].at(t(60.0)).0.is_finite());
}
