//! The unit's command interpreter: bytes with their instants in, answers with theirs out.
//!
//! Commands end with a space or a carriage return; a line feed is tolerated. Echo is on and answers are verbose until
//! told otherwise, as after power-up. Source: shared protocol notes, 3.2 and 3.3.

use super::axis::Dynamics;
use super::{Head, PanTiltOptions};
use tsense_geometry::Timestamp;

/// What leaves the unit, and not before which instant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Reply {
    pub text: String,
    pub at: Timestamp,
    /// False for an echo: a lost answer is never half an echo.
    pub is_answer: bool,
}

/// Arc-seconds per position of the classic D46, for which the manuals give their numbers.
const CLASSIC_ARCSEC: f64 = 185.1428;
/// No command is longer; what is gets an error.
const COMMAND_MAX: usize = 64;
/// How long a reset takes, seconds.
const RESET_S: f64 = 3.0;

/// Settings of one axis, in positions and seconds.
#[derive(Clone, Copy, Debug)]
struct Settings {
    dynamics: Dynamics,
    upper: i64,
    lower: i64,
    min: i64,
    max: i64,
    /// Velocity wanted in pure velocity mode.
    velocity: i64,
    /// A position that waits for `A` in slaved mode.
    held: Option<i64>,
    /// Running towards a limit, which is to be told.
    towards_limit: bool,
}

/// An autonomous scan between positions.
#[derive(Clone, Copy, Debug)]
struct Monitor {
    legs: [[i64; 2]; 2],
    next: usize,
}

/// The unit.
#[derive(Debug)]
pub(crate) struct Unit {
    axes: [Settings; 2],
    resolution_arcsec: f64,
    controller_s: f64,
    command: String,
    echo: bool,
    verbose: bool,
    slaved: bool,
    velocity_mode: bool,
    limits: bool,
    monitor: Option<Monitor>,
}

const NAMES: [&str; 2] = ["Pan", "Tilt"];

impl Unit {
    pub fn new(options: &PanTiltOptions) -> Self {
        let scale = CLASSIC_ARCSEC / options.resolution_arcsec;
        let positions = |classic: f64| (classic * scale).round() as i64;
        let axis = |min: f64, max: f64| Settings {
            dynamics: Dynamics { base: 57.0 * scale, acceleration: 2000.0 * scale, speed: 1000.0 * scale },
            upper: positions(2902.0),
            lower: positions(31.0),
            min: positions(min),
            max: positions(max),
            velocity: 0,
            held: None,
            towards_limit: false,
        };
        Self {
            axes: [axis(-3090.0, 3090.0), axis(-907.0, 604.0)],
            resolution_arcsec: options.resolution_arcsec,
            controller_s: options.controller_s,
            command: String::new(),
            echo: true,
            verbose: true,
            slaved: false,
            velocity_mode: false,
            limits: true,
            monitor: None,
        }
    }

    /// One byte from the line.
    pub fn input(&mut self, head: &mut Head, byte: u8, now: Timestamp) -> Vec<Reply> {
        let mut replies = Vec::new();
        if self.echo {
            replies.push(Reply { text: char::from(byte & 0x7F).to_string(), at: now, is_answer: false });
        }
        if self.monitor.take().is_some() {
            // Any character ends the autonomous scan and sends the head home.
            (0..2).for_each(|i| self.go(head, i, 0, now));
        }
        match byte {
            b' ' | b'\r' | b'\n' => {
                let command = std::mem::take(&mut self.command).to_ascii_uppercase();
                if !command.is_empty() {
                    replies.push(self.execute(head, &command, now));
                }
            }
            _ if self.command.len() < COMMAND_MAX => self.command.push(char::from(byte & 0x7F)),
            _ => {}
        }
        replies
    }

    /// Messages that come by themselves: `!P` and `!T` when an axis reaches its limit. Keeps the monitor going.
    pub fn events(&mut self, head: &mut Head, now: Timestamp) -> Vec<Reply> {
        let mut events = Vec::new();
        for (i, text) in ["!P", "!T"].into_iter().enumerate() {
            if self.axes[i].towards_limit && now >= head.axes[i].arrival() {
                self.axes[i].towards_limit = false;
                events.push(Reply { text: text.to_owned(), at: now, is_answer: true });
            }
        }
        if let Some(mut monitor) = self.monitor.filter(|_| (0..2).all(|i| now >= head.axes[i].arrival())) {
            (0..2).for_each(|i| self.go(head, i, monitor.legs[i][monitor.next], now));
            monitor.next = 1 - monitor.next;
            self.monitor = Some(monitor);
        }
        events
    }

    fn execute(&mut self, head: &mut Head, command: &str, now: Timestamp) -> Reply {
        let at = now.plus_seconds(self.controller_s);
        let split = command.find(|c: char| c.is_ascii_digit() || "+-_.".contains(c)).unwrap_or(command.len());
        let (name, argument) = command.split_at(split);
        let (text, at) = match name {
            "A" => (Ok(String::new()), self.begin_held(head, now).max(at)),
            "R" | "RE" | "RP" | "RT" => {
                (0..2).for_each(|i| self.go(head, i, 0, now));
                let text = format!("!T!T!P!P*{}", "\r\n");
                return Reply { text, at: now.plus_seconds(RESET_S).max(at), is_answer: true };
            }
            _ => (self.dispatch(head, name, argument, now), at),
        };
        let text = match text {
            Ok(value) if value.is_empty() => "*\r\n".to_owned(),
            Ok(value) => format!("* {value}\r\n"),
            Err(message) => format!("! {message}\r\n"),
        };
        Reply { text, at, is_answer: true }
    }

    fn dispatch(&mut self, head: &mut Head, name: &str, argument: &str, now: Timestamp) -> Result<String, String> {
        if self.switch(head, name, now) {
            return Ok(String::new());
        }
        let either = |on: bool, yes: &str, no: &str| Ok(if on { yes } else { no }.to_owned());
        match name {
            "E" => either(self.echo, "Echo is on", "Echo is off"),
            "F" => either(self.verbose, "ASCII verbose mode", "ASCII terse mode"),
            "C" => either(self.velocity_mode, "PTU is in Pure Velocity Mode", "PTU is in Independent Mode"),
            "L" => either(self.limits, "Limit bounds are ENABLED", "Limit bounds are DISABLED"),
            "V" | "VV" => Ok("Pan-Tilt Controller v3.30.0 (simulated), Terrain Smart Sensor".to_owned()),
            "VM" => Ok("PTU-E46-17P70T".to_owned()),
            "VS" => Ok("SIM0001".to_owned()),
            "O" => Ok("24.0,91,84,84".to_owned()),
            "M" => self.monitor(argument, head, now),
            "B" => self.both(argument, head, now),
            _ => self.axis_command(head, name, argument, now),
        }
    }

    /// Commands that change a mode or stop; false for any other.
    fn switch(&mut self, head: &mut Head, name: &str, now: Timestamp) -> bool {
        match name {
            "EE" => self.echo = true,
            "ED" => self.echo = false,
            "FV" => self.verbose = true,
            "FT" => self.verbose = false,
            "I" => self.slaved = false,
            "S" => self.slaved = true,
            "CI" => {
                self.stop(head, &[0, 1], now);
                self.velocity_mode = false;
            }
            "CV" => self.velocity_mode = true,
            "LE" => self.limits = true,
            "LD" => self.limits = false,
            "H" => self.stop(head, &[0, 1], now),
            "HP" => self.stop(head, &[0], now),
            "HT" => self.stop(head, &[1], now),
            // Saving, defaults, and what concerns power-up: nothing to do.
            "DS" | "DR" | "DF" | "RD" | "ME" | "MD" => {}
            _ => return false,
        }
        true
    }

    /// Commands of one axis: `P` or `T`, then what it is about.
    fn axis_command(&mut self, head: &mut Head, name: &str, argument: &str, now: Timestamp) -> Result<String, String> {
        let illegal = || "Illegal command entered".to_owned();
        let mut letters = name.chars();
        let axis = match letters.next() {
            Some('P') => 0,
            Some('T') => 1,
            _ => return Err(illegal()),
        };
        if argument.is_empty() {
            return self.query(head, axis, letters.as_str(), now).ok_or_else(illegal);
        }
        let value: i64 = argument.parse().map_err(|_| "Illegal argument".to_owned())?;
        let s = &mut self.axes[axis];
        match letters.as_str() {
            "P" => return self.position(head, axis, value, now),
            "O" => {
                let from = head.axes[axis].target().round() as i64;
                return self.position(head, axis, from.saturating_add(value), now);
            }
            "S" if self.velocity_mode => return self.velocity(head, axis, value, now),
            "S" => return self.speed(head, axis, value, now),
            "D" => {
                let speed = s.dynamics.speed as i64;
                return self.speed(head, axis, speed.saturating_add(value), now);
            }
            "U" if value > 0 => s.upper = value,
            "L" if value >= 0 => s.lower = value,
            "B" if value > 0 => s.dynamics.base = value as f64,
            "A" if value > 0 => s.dynamics.acceleration = value as f64,
            "NU" => s.min = value,
            "XU" => s.max = value,
            "U" | "L" | "B" | "A" => return Err("Illegal argument".to_owned()),
            _ => return Err(illegal()),
        }
        Ok(String::new())
    }

    fn query(&self, head: &Head, axis: usize, what: &str, now: Timestamp) -> Option<String> {
        let (s, name) = (&self.axes[axis], NAMES[axis]);
        let (position, velocity) = head.axes[axis].at(now);
        let value = |label: &str, value: i64| {
            if self.verbose { format!("{label} is {value}") } else { value.to_string() }
        };
        Some(match what {
            "P" => value(&format!("Current {name} position"), position.round() as i64),
            "O" => value(&format!("Target {name} position"), head.axes[axis].target().round() as i64),
            "R" if self.verbose => format!("{:.4} seconds arc per position", self.resolution_arcsec),
            "R" => format!("{:.4}", self.resolution_arcsec),
            "N" => value(&format!("Minimum {name} position"), s.min),
            "X" => value(&format!("Maximum {name} position"), s.max),
            "NU" => value(&format!("User minimum {name} position"), s.min),
            "XU" => value(&format!("User maximum {name} position"), s.max),
            "S" => value(&format!("Target {name} speed"), s.dynamics.speed as i64),
            "D" => value(&format!("Current {name} speed"), velocity.round() as i64),
            "U" => value(&format!("Maximum {name} speed"), s.upper),
            "L" => value(&format!("Minimum {name} speed"), s.lower),
            "B" => value(&format!("{name} base speed"), s.dynamics.base as i64),
            "A" => value(&format!("{name} acceleration"), s.dynamics.acceleration as i64),
            "HR" | "HL" | "HO" | "MR" | "MH" | "ML" => String::new(),
            _ => return None,
        })
    }

    fn position(&mut self, head: &mut Head, axis: usize, value: i64, now: Timestamp) -> Result<String, String> {
        let (s, name) = (&mut self.axes[axis], NAMES[axis]);
        if self.limits && value > s.max {
            return Err(format!("Maximum allowable {name} position is {}", s.max));
        }
        if self.limits && value < s.min {
            return Err(format!("Minimum allowable {name} position is {}", s.min));
        }
        if self.slaved {
            s.held = Some(value);
        } else {
            self.go(head, axis, value, now);
        }
        Ok(String::new())
    }

    fn speed(&mut self, head: &mut Head, axis: usize, value: i64, now: Timestamp) -> Result<String, String> {
        let (s, name) = (&mut self.axes[axis], NAMES[axis]);
        if value > s.upper {
            return Err(format!("{name} speed cannot exceed {} positions/sec", s.upper));
        }
        if value < s.lower {
            return Err(format!("Motor speed cannot be less than {} pos/sec", s.lower));
        }
        s.dynamics.speed = value as f64;
        // A new speed takes effect on the way, without an end to the motion.
        if now < head.axes[axis].arrival() {
            let target = head.axes[axis].target();
            head.axes[axis].go_to(now, target, &s.dynamics);
        }
        Ok(String::new())
    }

    /// Pure velocity mode: run at a signed speed until the limit.
    fn velocity(&mut self, head: &mut Head, axis: usize, value: i64, now: Timestamp) -> Result<String, String> {
        let (s, name) = (&mut self.axes[axis], NAMES[axis]);
        if value.saturating_abs() > s.upper {
            return Err(format!("{name} speed cannot exceed {} positions/sec", s.upper));
        }
        s.velocity = value;
        if value == 0 {
            s.towards_limit = false;
            head.axes[axis].halt(now, &s.dynamics);
        } else {
            s.dynamics.speed = value.abs().max(s.lower) as f64;
            let limit = if value > 0 { s.max } else { s.min };
            head.axes[axis].go_to(now, limit as f64, &s.dynamics);
            s.towards_limit = true;
        }
        Ok(String::new())
    }

    /// Position, and with the limits off perhaps the mechanical stop, which is told.
    fn go(&mut self, head: &mut Head, axis: usize, value: i64, now: Timestamp) {
        let s = &mut self.axes[axis];
        let reachable = value.clamp(s.min, s.max);
        s.towards_limit = reachable != value;
        head.axes[axis].go_to(now, reachable as f64, &s.dynamics);
    }

    fn stop(&mut self, head: &mut Head, axes: &[usize], now: Timestamp) {
        for &i in axes {
            self.axes[i].towards_limit = false;
            self.axes[i].held = None;
            head.axes[i].halt(now, &self.axes[i].dynamics);
        }
    }

    /// Begins what slaved mode held back; says when all motion ends.
    fn begin_held(&mut self, head: &mut Head, now: Timestamp) -> Timestamp {
        for i in 0..2 {
            if let Some(value) = self.axes[i].held.take() {
                self.go(head, i, value, now);
            }
        }
        head.axes[0].arrival().max(head.axes[1].arrival())
    }

    /// `M<p1>,<p2>[,<t1>,<t2>]`.
    fn monitor(&mut self, argument: &str, head: &mut Head, now: Timestamp) -> Result<String, String> {
        let numbers = numbers(argument)?;
        let here = |i: usize| head.axes[i].at(now).0.round() as i64;
        let legs = match numbers[..] {
            [p1, p2] => [[p1, p2], [here(1), here(1)]],
            [p1, p2, t1, t2] => [[p1, p2], [t1, t2]],
            [] => [[self.axes[0].min / 2, self.axes[0].max / 2], [here(1), here(1)]],
            _ => return Err("Illegal argument".to_owned()),
        };
        self.monitor = Some(Monitor { legs, next: 0 });
        Ok(String::new())
    }

    /// `B`: position and speed of both axes in one answer; with four numbers, both at once.
    fn both(&mut self, argument: &str, head: &mut Head, now: Timestamp) -> Result<String, String> {
        if argument.is_empty() {
            let [(pan, pan_speed), (tilt, tilt_speed)] = [0, 1].map(|i: usize| head.axes[i].at(now));
            return Ok([pan, tilt, pan_speed, tilt_speed].map(|v| (v.round() as i64).to_string()).join(","));
        }
        let [pan, tilt, pan_speed, tilt_speed] = numbers(argument)?[..] else {
            return Err("Illegal argument".to_owned());
        };
        self.speed(head, 0, pan_speed, now)?;
        self.speed(head, 1, tilt_speed, now)?;
        self.position(head, 0, pan, now)?;
        self.position(head, 1, tilt, now)
    }
}

fn numbers(argument: &str) -> Result<Vec<i64>, String> {
    let parts = argument.split(',').filter(|p| !p.is_empty());
    parts.map(|p| p.parse().map_err(|_| "Illegal argument".to_owned())).collect()
}

#[cfg(test)]
mod tests;
