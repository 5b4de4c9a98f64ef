//! One axis of a pan-tilt unit: a stepper that starts at a base speed, accelerates, cruises and slows down again.
//!
//! Unit: positions (steps of the unit's resolution) and seconds. In: commands with the instant they take effect.
//! Out: where the axis is and how fast it turns at any instant of the last few motions, so that beams cast a little
//! later than they were sent still find the angle of their own time.

use std::collections::VecDeque;
use tsense_geometry::Timestamp;

/// How an axis may move: positions, positions per second, positions per second squared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dynamics {
    /// Speed at which it starts and stops at once.
    pub base: f64,
    /// Acceleration above the base speed.
    pub acceleration: f64,
    /// Speed it cruises at.
    pub speed: f64,
}

/// A stretch of even acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Phase {
    duration_s: f64,
    velocity: f64,
    acceleration: f64,
}

impl Phase {
    fn travelled(&self, s: f64) -> f64 {
        self.velocity * s + 0.5 * self.acceleration * s * s
    }
}

/// A motion: phases back to back, then rest.
#[derive(Clone, Debug)]
struct Profile {
    start: Timestamp,
    from: f64,
    phases: Vec<Phase>,
    target: f64,
}

/// Motions remembered: beams are cast within a fraction of a second, a busy host sends a few commands in that time.
const PROFILES: usize = 64;

/// One axis.
#[derive(Clone, Debug)]
pub struct Axis {
    profiles: VecDeque<Profile>,
}

impl Profile {
    fn at(&self, instant: Timestamp) -> (f64, f64) {
        let mut left_s = instant.seconds_since(self.start).max(0.0);
        let mut position = self.from;
        for phase in &self.phases {
            if left_s < phase.duration_s {
                return (position + phase.travelled(left_s), phase.velocity + phase.acceleration * left_s);
            }
            position += phase.travelled(phase.duration_s);
            left_s -= phase.duration_s;
        }
        (self.target, 0.0)
    }

    fn duration_s(&self) -> f64 {
        self.phases.iter().map(|p| p.duration_s).sum()
    }
}

impl Default for Axis {
    fn default() -> Self {
        let rest = Profile { start: Timestamp::from_ns(i64::MIN), from: 0.0, phases: Vec::new(), target: 0.0 };
        Self { profiles: VecDeque::from([rest]) }
    }
}

impl Axis {
    /// Position and velocity at an instant.
    pub fn at(&self, instant: Timestamp) -> (f64, f64) {
        let newest_before = self.profiles.iter().rev().find(|p| p.start <= instant);
        newest_before.or(self.profiles.front()).map_or((0.0, 0.0), |p| p.at(instant))
    }

    /// Where the newest motion ends.
    pub fn target(&self) -> f64 {
        self.profiles.back().map_or(0.0, |p| p.target)
    }

    /// When the newest motion ends.
    pub fn arrival(&self) -> Timestamp {
        self.profiles.back().map_or(Timestamp::default(), |p| p.start.plus_seconds(p.duration_s()))
    }

    /// Moves to a position from wherever it is, whatever its velocity.
    pub fn go_to(&mut self, now: Timestamp, target: f64, dynamics: &Dynamics) {
        let (from, velocity) = self.at(now);
        let mut phases = Vec::with_capacity(5);
        plan(from, velocity, target, dynamics, &mut phases);
        self.remember(Profile { start: now, from, phases, target });
    }

    /// Slows down and stops.
    pub fn halt(&mut self, now: Timestamp, dynamics: &Dynamics) {
        let (from, velocity) = self.at(now);
        let brake = braking(velocity, dynamics);
        let target = from + brake.travelled(brake.duration_s);
        self.remember(Profile { start: now, from, phases: vec![brake], target });
    }

    fn remember(&mut self, profile: Profile) {
        if self.profiles.len() >= PROFILES {
            self.profiles.pop_front();
        }
        self.profiles.push_back(profile);
    }
}

/// From a velocity down to the base speed, where the stepper stops at once.
fn braking(velocity: f64, dynamics: &Dynamics) -> Phase {
    let excess = (velocity.abs() - dynamics.base).max(0.0);
    let acceleration = -velocity.signum() * dynamics.acceleration;
    Phase { duration_s: excess / dynamics.acceleration, velocity, acceleration }
}

/// The phases of a motion. At most: brake, accelerate, cruise, slow down; once more when it must turn back.
fn plan(from: f64, velocity: f64, target: f64, d: &Dynamics, phases: &mut Vec<Phase>) {
    let distance = (target - from).abs();
    let direction = (target - from).signum();
    let speed = velocity * direction;
    let brake = braking(velocity, d);
    let stopping = brake.travelled(brake.duration_s).abs();
    let away = velocity != 0.0 && (speed < 0.0 || stopping > distance + 1e-9);
    if away && phases.len() < 2 {
        phases.push(brake);
        let stopped = from + brake.travelled(brake.duration_s);
        return plan(stopped, 0.0, target, d, phases);
    }
    if distance < 1e-9 {
        return;
    }
    let push = |phases: &mut Vec<Phase>, duration_s: f64, speed: f64, acceleration: f64| {
        if duration_s > 0.0 {
            phases.push(Phase { duration_s, velocity: speed * direction, acceleration: acceleration * direction });
        }
    };
    let base = d.base.min(d.speed);
    let start = speed.max(base);
    if start > d.speed {
        // Told to go slower on the way.
        let slowing = (start * start - d.speed * d.speed) / (2.0 * d.acceleration);
        let ending = (d.speed * d.speed - base * base) / (2.0 * d.acceleration);
        push(phases, (start - d.speed) / d.acceleration, start, -d.acceleration);
        push(phases, (distance - slowing - ending).max(0.0) / d.speed, d.speed, 0.0);
        push(phases, (d.speed - base) / d.acceleration, d.speed, -d.acceleration);
        return;
    }
    // Distance up to a peak and down again: (peak^2 - start^2 + peak^2 - base^2) / 2a.
    let peak = (d.acceleration * distance + (start * start + base * base) / 2.0).sqrt().min(d.speed).max(start);
    let rising = (peak * peak - start * start) / (2.0 * d.acceleration);
    let falling = (peak * peak - base * base) / (2.0 * d.acceleration);
    push(phases, (peak - start) / d.acceleration, start, d.acceleration);
    push(phases, (distance - rising - falling).max(0.0) / peak, peak, 0.0);
    push(phases, (peak - base) / d.acceleration, peak, -d.acceleration);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    const D: Dynamics = Dynamics { base: 0.0, acceleration: 100.0, speed: 50.0 };

    fn t(s: f64) -> Timestamp {
        Timestamp::from_seconds(1000.0 + s)
    }

    #[test]
    fn a_long_move_is_a_trapezoid() {
        let mut axis = Axis::default();
        axis.go_to(t(0.0), 100.0, &D);
        // 0.5 s and 12.5 positions up, the same down, 75 positions at 50 a second between: 2.5 s in all.
        assert!((axis.at(t(0.5)).0 - 12.5).abs() < 1e-6 && (axis.at(t(0.5)).1 - 50.0).abs() < 1e-6);
        assert!((axis.at(t(1.0)).0 - 37.5).abs() < 1e-6);
        assert!((axis.at(t(2.0)).0 - 87.5).abs() < 1e-6);
        assert!((axis.arrival().seconds_since(t(0.0)) - 2.5).abs() < 1e-6);
        assert_eq!(axis.at(t(3.0)), (100.0, 0.0));
    }

    #[test]
    fn a_short_move_is_a_triangle_and_a_base_speed_starts_at_once() {
        let mut axis = Axis::default();
        axis.go_to(t(0.0), -4.0, &D);
        assert!((axis.arrival().seconds_since(t(0.0)) - 0.4).abs() < 1e-6, "peak 20, 0.2 s each way");
        assert!((axis.at(t(0.2)).1 + 20.0).abs() < 1e-6);
        axis.go_to(t(1.0), 4.0, &Dynamics { base: 10.0, speed: 10.0, ..D });
        assert!((axis.at(t(1.4)).0 - 0.0).abs() < 1e-6, "8 positions at 10 a second, from the first instant");
    }

    #[test]
    fn turning_back_on_the_way_brakes_first() {
        let mut axis = Axis::default();
        axis.go_to(t(0.0), 100.0, &D);
        axis.go_to(t(1.0), 0.0, &D);
        // At 1 s: position 37.5, 50 a second. Braking takes 0.5 s and 12.5 positions: turns at 50.
        let (position, velocity) = axis.at(t(1.5));
        assert!((position - 50.0).abs() < 1e-6 && velocity.abs() < 1e-6);
        assert!((axis.at(t(0.5)).0 - 12.5).abs() < 1e-6, "the past stays as it was");
        assert_eq!(axis.at(t(9.0)), (0.0, 0.0));
    }

    #[test]
    fn a_halt_stops_where_braking_ends() {
        let mut axis = Axis::default();
        axis.go_to(t(0.0), 100.0, &D);
        axis.halt(t(1.0), &D);
        assert_eq!(axis.at(t(5.0)), (50.0, 0.0));
    }

    #[test]
    fn no_command_makes_the_axis_jump_or_exceed_its_speed_and_acceleration() {
        let (mut rng, mut axis, mut now, mut cases) = (Rng::new(4), Axis::default(), 0.0, 0);
        let mut last = 0.0;
        for _ in 0..500 {
            let speed = rng.between(20.0, 60.0);
            axis.go_to(t(now), rng.between(-80.0, 80.0).round(), &Dynamics { speed, ..D });
            for _ in 0..rng.count(1, 200) {
                now += 0.005;
                let (position, velocity) = axis.at(t(now));
                assert!((position - last).abs() <= 60.0 * 0.005 + 1e-3, "a jump from {last} to {position}");
                assert!(velocity.abs() <= 60.0 + 1e-6);
                (last, cases) = (position, cases + 1);
            }
        }
        assert!(cases > 30_000, "only {cases} cases");
    }
}
