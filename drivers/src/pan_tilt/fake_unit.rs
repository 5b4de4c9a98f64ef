//! A scripted pan-tilt unit for tests: a line of 9600 baud, a head that moves, answers that get lost.
//!
//! It is written from the wire format notes alone and shares no code with the driver.
#![allow(missing_docs, clippy::disallowed_methods, reason = "test material, with a real terminal")]

use serialport::{SerialPort, TTYPort};
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Ten bits at 9600 baud.
pub const BYTE_NS: i64 = 1_041_667;
const RESOLUTION: &str = "185.1428";

/// A D46 (or, with `combined`, an E-series) on a 9600 baud line.
pub struct FakeUnit {
    pub echo: bool,
    pub verbose: bool,
    pub combined: bool,
    pub input: String,
    /// Bytes on their way to the host, and when each arrives.
    pub output: VecDeque<(i64, u8)>,
    pub line_free_ns: i64,
    pub position: [f64; 2],
    pub target: [f64; 2],
    pub speed: [f64; 2],
    pub moved_ns: i64,
    /// Answers that will be swallowed.
    pub lose: u32,
    /// Bytes put in front of the next answer.
    pub glue: &'static str,
    pub log: Vec<String>,
}

impl FakeUnit {
    /// A unit as after power-up, tilted up by 100 counts.
    pub fn new(combined: bool) -> Self {
        Self {
            echo: true,
            verbose: true,
            combined,
            input: String::new(),
            output: VecDeque::new(),
            line_free_ns: 0,
            position: [0.0, 100.0],
            target: [0.0, 100.0],
            speed: [1000.0, 1000.0],
            moved_ns: 0,
            lose: 0,
            glue: "",
            log: Vec::new(),
        }
    }

    /// Moves the head to where it is at an instant.
    pub fn move_to(&mut self, now_ns: i64) {
        let dt_s = (now_ns - self.moved_ns).max(0) as f64 / 1e9;
        self.moved_ns = self.moved_ns.max(now_ns);
        for axis in 0..2 {
            let way = self.target[axis] - self.position[axis];
            let step = self.speed[axis] * dt_s;
            self.position[axis] += way.clamp(-step, step);
        }
    }

    /// Takes a byte that arrives at an instant.
    pub fn take(&mut self, at_ns: i64, byte: u8) {
        self.move_to(at_ns);
        if byte != b' ' && byte != b'\r' {
            self.input.push(char::from(byte));
            return;
        }
        let command = std::mem::take(&mut self.input);
        if command.is_empty() {
            return;
        }
        let answer = self.execute(&command);
        self.log.push(command.clone());
        if self.lose > 0 {
            self.lose -= 1;
            return;
        }
        let echo = if self.echo { format!("{command} ") } else { String::new() };
        let glue = std::mem::take(&mut self.glue);
        let line = format!("{echo}{glue}{answer}\r\n");
        // The controller takes a millisecond to answer.
        let mut ns = self.line_free_ns.max(at_ns + 1_000_000);
        for byte in line.bytes() {
            ns += BYTE_NS;
            self.output.push_back((ns, byte));
        }
        self.line_free_ns = ns;
    }

    fn execute(&mut self, command: &str) -> String {
        let axis = usize::from(command.starts_with('T'));
        let counts = |position: f64| position.round() as i32;
        let text =
            |value: String| if self.verbose { format!("* Current value is {value}") } else { format!("* {value}") };
        let argument: Option<f64> = command.get(2..).and_then(|digits| digits.parse().ok());
        match (command.get(..2).unwrap_or(command), argument) {
            ("ED", _) => self.echo = false,
            ("FT", _) => self.verbose = false,
            ("H", _) => self.target = self.position,
            ("PP" | "TP", Some(to)) => self.target[axis] = to,
            ("PS" | "TS", Some(speed)) => self.speed[axis] = speed,
            ("LE" | "I" | "CI", _) => {}
            ("R", _) => {
                (self.position, self.target) = ([0.0; 2], [0.0; 2]);
                return "!T!T!P!P*".into();
            }
            ("PP" | "TP", None) => return text(counts(self.position[axis]).to_string()),
            ("PR" | "TR", _) => return format!("* {RESOLUTION} seconds arc per position"),
            ("PN", _) => return text("-3090".into()),
            ("PX", _) => return text("3090".into()),
            ("TN", _) => return text("-907".into()),
            ("TX", _) => return text("604".into()),
            ("PL" | "TL", _) => return text("31".into()),
            ("PU" | "TU", _) => return text("2902".into()),
            ("V", _) => return "* Pan-Tilt Controller v1.90.0d".into(),
            ("B", _) if self.combined => {
                let [pan, tilt] = self.position.map(counts);
                return format!("* {pan},{tilt},0,389");
            }
            _ => return "! Illegal command entered".into(),
        }
        "*".into()
    }
}

/// Serves the scripted unit on the master's end of a pty, at the pace of a line, until told to stop.
fn serve(mut master: TTYPort, stop: Arc<AtomicBool>) -> FakeUnit {
    let start = Instant::now();
    let mut unit = FakeUnit::new(true);
    master.set_timeout(Duration::from_millis(1)).unwrap();
    while !stop.load(Ordering::Relaxed) {
        let mut buffer = [0; 64];
        let count = master.read(&mut buffer).unwrap_or(0);
        let now_ns = start.elapsed().as_nanos() as i64;
        for (i, byte) in buffer[..count].iter().enumerate() {
            unit.take(now_ns + (i as i64 + 1) * BYTE_NS, *byte);
        }
        while unit.output.front().is_some_and(|(at, _)| *at <= now_ns) {
            let (_, byte) = unit.output.pop_front().unwrap();
            master.write_all(&[byte]).unwrap();
        }
    }
    unit
}

/// A pty with the unit on it; the slave is kept open as a cable is.
pub fn bench(test: impl FnOnce(&str)) -> FakeUnit {
    let (master, slave) = TTYPort::pair().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let stopping = stop.clone();
    let unit = std::thread::spawn(move || serve(master, stopping));
    test(&slave.name().unwrap());
    std::thread::sleep(Duration::from_millis(100));
    stop.store(true, Ordering::Relaxed);
    unit.join().unwrap()
}
