//! The motion programme: which position command is due, given where the head is.
//!
//! In: tilt in counts, the instant. Out: at most one command at a time, to go between two polls. The head goes to one
//! end, and when it is there (one count of tolerance) to the other; every turn counts one sweep. The host drives it
//! command by command, so a host that dies leaves a head that stops by itself at its next end.

use super::answer::Axis;
use super::command::Command;
use super::unit::Plan;
use tsense_geometry::Timestamp;

/// Distance from an end at which the head has arrived, counts: the last step may be rounded away.
const ARRIVED_COUNTS: i32 = 1;
/// Beyond the time a way takes at the set speed, how long to wait before a command is repeated, seconds.
const STALL_S: f64 = 2.0;
/// Slower than the set speed by this much is still on its way (ramps, a heavy head).
const STALL_FACTOR: f64 = 1.5;

/// Where the head is going.
#[derive(Debug)]
pub struct Nod {
    ends: [i32; 2],
    speed: f64,
    pan: i32,
    going_to: usize,
    pan_commanded: bool,
    /// Since when the head is on its way, and when it should have arrived.
    due: Option<Timestamp>,
    sweep: u32,
}

impl Nod {
    /// A programme that has not begun. `sweep` goes on counting from an earlier one.
    pub fn new(plan: &Plan, sweep: u32) -> Self {
        Self {
            ends: plan.tilt_counts,
            speed: f64::from(plan.tilt_speed),
            pan: plan.pan_counts,
            going_to: 0,
            pan_commanded: false,
            due: None,
            sweep,
        }
    }

    /// Half nods so far.
    pub fn sweep(&self) -> u32 {
        self.sweep
    }

    /// Where pan is to be, counts.
    pub fn pan_target(&self) -> i32 {
        self.pan
    }

    /// Begins anew: the head was halted or reset.
    pub fn restart(&mut self) {
        self.pan_commanded = false;
        self.due = None;
    }

    /// The command that is due. Once returned it counts as sent.
    pub fn command(&mut self, now: Timestamp, tilt: i32) -> Option<Command> {
        if !self.pan_commanded {
            self.pan_commanded = true;
            return Some(Command::Go(Axis::Pan, self.pan));
        }
        let arrived = (tilt - self.ends[self.going_to]).abs() <= ARRIVED_COUNTS;
        match self.due {
            Some(_) if arrived && self.ends[0] != self.ends[1] => {
                self.sweep += 1;
                self.going_to ^= 1;
            }
            Some(due) if arrived || now < due => return None,
            // The first command, or one that the unit did not follow.
            _ => {}
        }
        let end = self.ends[self.going_to];
        let way_s = f64::from((end - tilt).abs()) / self.speed;
        self.due = Some(now.plus_seconds(way_s * STALL_FACTOR + STALL_S));
        Some(Command::Go(Axis::Tilt, end))
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::Config;
    use super::super::unit::{AxisUnit, Unit};
    use super::*;

    fn nod(config: &Config) -> Nod {
        let axis = AxisUnit { resolution_arcsec: 360.0, ..AxisUnit::default() };
        let unit = Unit { pan: axis, tilt: axis, ..Unit::default() };
        Nod::new(&Plan::new(&unit, config), 0)
    }

    fn s(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(seconds)
    }

    #[test]
    fn the_head_turns_at_each_end_and_counts_a_sweep_a_turn() {
        // 0.1 degrees a count: -300 to 150 counts at 200 counts/s.
        let mut nod = nod(&Config::default());
        assert_eq!(nod.command(s(0.0), 0), Some(Command::Go(Axis::Pan, 0)));
        assert_eq!(nod.command(s(0.0), 0), Some(Command::Go(Axis::Tilt, -300)));
        assert_eq!(nod.command(s(1.0), -200), None);
        assert_eq!(nod.command(s(1.6), -299), Some(Command::Go(Axis::Tilt, 150)));
        assert_eq!((nod.sweep(), nod.command(s(1.7), -299)), (1, None));
        assert_eq!(nod.command(s(4.0), 150), Some(Command::Go(Axis::Tilt, -300)));
        assert_eq!(nod.sweep(), 2);
    }

    #[test]
    fn a_command_the_unit_did_not_follow_is_repeated_but_not_at_once() {
        let mut nod = nod(&Config::default());
        nod.command(s(0.0), 0);
        nod.command(s(0.0), 0);
        // 300 counts at 200/s take 1.5 s; times 1.5 plus 2 s.
        assert_eq!(nod.command(s(4.2), -10), None);
        assert_eq!(nod.command(s(4.3), -10), Some(Command::Go(Axis::Tilt, -300)));
        assert_eq!(nod.sweep(), 0);
    }

    #[test]
    fn a_held_head_is_commanded_once() {
        let mut nod = nod(&Config { nod: false, tilt_hold_deg: -10.0, ..Config::default() });
        nod.command(s(0.0), 0);
        assert_eq!(nod.command(s(0.0), 0), Some(Command::Go(Axis::Tilt, -100)));
        assert_eq!(nod.command(s(9.0), -100), None);
        assert_eq!(nod.sweep(), 0);
    }
}
