//! One request and its answer at a time over a slow line: time limits, one retry, and staying in step.
//!
//! In: commands, bytes, instants. Out: bytes to write, reports, deadlines. It does not know what commands are for.
//! When an answer fails to come, or does not fit its request, answers and requests may be one off from then on, and a
//! pan angle would be read as a tilt angle. So before the retry the line is drained and a *marker* is asked for: a
//! query whose answer is known. Everything before the marker's answer belongs to older requests.
//!
//! Source: wire format notes section 3.5 (limits and stamps).

use super::answer::{Answer, AnswerScanner, Axis, numbers};
use super::command::{Command, Expect};
use tsense_geometry::Timestamp;

/// The line's rate and the time limits on it.
#[derive(Clone, Copy, Debug)]
pub struct LineTiming {
    /// Bits per second; 0 where the line takes no time.
    pub baud: u32,
    /// How long an answer may take beyond twice the line's time, seconds.
    pub margin_s: f64,
}

/// Start, eight data and stop bits.
const BITS_PER_BYTE: f64 = 10.0;

impl LineTiming {
    /// How long this many bytes take on the line, seconds.
    pub fn seconds(&self, bytes: usize) -> f64 {
        if self.baud == 0 { 0.0 } else { bytes as f64 * BITS_PER_BYTE / f64::from(self.baud) }
    }
}

/// When an exchange took place, and how much it carried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// The request was handed to the line.
    pub written: Timestamp,
    /// The answer's end was read.
    pub received: Timestamp,
    /// The request's time on the line, seconds.
    pub request_s: f64,
    /// The answer's time on the line, seconds.
    pub answer_s: f64,
}

/// Smallest uncertainty of a stamp, seconds: what a scheduler adds to the instant a write returns.
const STAMP_STD_MIN_S: f64 = 1e-4;

impl Timing {
    /// The instant the unit sampled its position: the request's end, plus the unit's own delay.
    pub fn stamp(&self, sample_delay_s: f64) -> Timestamp {
        self.written.plus_seconds(self.request_s + sample_delay_s)
    }

    /// One sigma of that instant, seconds: half of what the round trip leaves unexplained.
    pub fn stamp_std_s(&self) -> f64 {
        let unexplained_s = self.received.seconds_since(self.written) - self.request_s - self.answer_s;
        (unexplained_s.abs() / 2.0).max(STAMP_STD_MIN_S)
    }
}

/// What became of a request, or what the unit said on its own.
#[derive(Clone, Debug, PartialEq)]
pub enum Report {
    /// Done, with the text behind the `*`.
    Answered(Command, String, Timing),
    /// Refused, with the unit's reason.
    Refused(Command, String),
    /// No answer, twice: the line is of no use any more.
    Lost(Command),
    /// An axis ran into its limit.
    Limit(Axis),
    /// Something was thrown away, and why.
    Dropped(&'static str),
}

#[derive(Debug)]
struct Flight {
    command: Command,
    retried: bool,
}

#[derive(Debug)]
enum State {
    /// Nothing is asked.
    Idle,
    /// Asked; `written` and the deadline follow once the shell has written it.
    Waiting(Flight, Option<(Timestamp, Timestamp)>),
    /// Everything that comes in is thrown away until then; afterwards the flight, if any, is tried again.
    Draining(Timestamp, Option<Flight>),
    /// The marker is asked for; answers are thrown away until its own comes.
    Marking(Flight, Option<Timestamp>),
}

/// A bare delimiter: ends a half command that may be left in the unit.
const BARE_DELIMITER: &[u8] = b" ";

/// The requests and answers of one line.
#[derive(Debug)]
pub struct Exchange {
    timing: LineTiming,
    scanner: AnswerScanner,
    state: State,
    outgoing: Option<Vec<u8>>,
    marker: Option<(Command, f64)>,
}

impl Exchange {
    /// A line with nothing asked.
    pub fn new(timing: LineTiming) -> Self {
        Self { timing, scanner: AnswerScanner::default(), state: State::Idle, outgoing: None, marker: None }
    }

    /// Forgets what was asked: the line was closed.
    pub fn clear(&mut self) {
        *self = Self::new(self.timing);
    }

    /// A query whose answer is known from now on: its number.
    pub fn set_marker(&mut self, command: Command, number: f64) {
        self.marker = Some((command, number));
    }

    /// Whether a command may be started.
    pub fn is_idle(&self) -> bool {
        matches!(self.state, State::Idle)
    }

    /// How long this many bytes take on the line, seconds.
    pub fn line_s(&self, bytes: usize) -> f64 {
        self.timing.seconds(bytes)
    }

    /// Asks; replaces whatever was asked before.
    pub fn start(&mut self, command: Command) {
        self.send(Flight { command, retried: false });
    }

    /// Throws away what comes in for `seconds`; with `poke`, a bare delimiter goes out first.
    pub fn drain(&mut self, now: Timestamp, seconds: f64, poke: bool) {
        self.outgoing = poke.then(|| BARE_DELIMITER.to_vec());
        self.state = State::Draining(now.plus_seconds(seconds), None);
    }

    fn send(&mut self, flight: Flight) {
        self.outgoing = Some(flight.command.to_bytes());
        self.state = State::Waiting(flight, None);
    }

    /// Bytes to write now; call [`Exchange::written`] when they are.
    pub fn take_outgoing(&mut self) -> Option<Vec<u8>> {
        self.outgoing.take()
    }

    /// The bytes of [`Exchange::take_outgoing`] were handed to the line.
    pub fn written(&mut self, at: Timestamp) {
        let limit_s = |c: Command, timing: &LineTiming| {
            2.0 * timing.seconds(c.to_bytes().len() + c.answer_bytes()) + timing.margin_s + c.patience_s()
        };
        match (&mut self.state, self.marker) {
            (State::Waiting(flight, times @ None), _) => {
                *times = Some((at, at.plus_seconds(limit_s(flight.command, &self.timing))));
            }
            (State::Marking(_, deadline @ None), Some((marker, _))) => {
                *deadline = Some(at.plus_seconds(limit_s(marker, &self.timing)));
            }
            _ => {}
        }
    }

    /// When [`Exchange::tick`] has something to do.
    pub fn deadline(&self) -> Option<Timestamp> {
        match &self.state {
            State::Waiting(_, times) => times.map(|(_, deadline)| deadline),
            State::Marking(_, deadline) => *deadline,
            State::Draining(until, _) => Some(*until),
            State::Idle => None,
        }
    }

    /// Takes bytes that were read at `now`.
    pub fn receive(&mut self, now: Timestamp, bytes: &[u8]) -> Vec<Report> {
        let mut reports = Vec::new();
        for byte in bytes {
            if let Some(answer) = self.scanner.push(*byte) {
                reports.extend(self.take(now, answer));
            }
        }
        reports
    }

    fn take(&mut self, now: Timestamp, answer: Answer) -> Option<Report> {
        if let Answer::Limit(axis) = answer {
            return Some(Report::Limit(axis));
        }
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Waiting(flight, Some((written, deadline))) => self.settle(now, flight, (written, deadline), answer),
            State::Marking(flight, deadline) => self.look_for_marker(flight, deadline, &answer),
            State::Draining(until, flight) => {
                self.state = State::Draining(until, flight);
                None
            }
            state => {
                self.state = state;
                Some(Report::Dropped("answer nobody asked for"))
            }
        }
    }

    fn settle(
        &mut self,
        now: Timestamp,
        flight: Flight,
        times: (Timestamp, Timestamp),
        answer: Answer,
    ) -> Option<Report> {
        match answer {
            Answer::Done(line) if fits(flight.command, &line.text) => {
                let request_s = self.timing.seconds(flight.command.to_bytes().len());
                let answer_s = self.timing.seconds(line.wire_bytes);
                let timing = Timing { written: times.0, received: now, request_s, answer_s };
                Some(Report::Answered(flight.command, line.text, timing))
            }
            Answer::Refused(line) => Some(Report::Refused(flight.command, line.text)),
            Answer::Done(_) => {
                let report = self.recover(now, flight);
                Some(report.unwrap_or(Report::Dropped("answer to another request")))
            }
            Answer::Noise(_) | Answer::Limit(_) => {
                self.state = State::Waiting(flight, Some(times));
                Some(Report::Dropped("line that is no answer"))
            }
        }
    }

    fn look_for_marker(&mut self, flight: Flight, deadline: Option<Timestamp>, answer: &Answer) -> Option<Report> {
        let known = self.marker.map(|(_, number)| number);
        let seen = match answer {
            Answer::Done(line) => numbers(&line.text).first().copied(),
            _ => None,
        };
        if known.is_some() && known == seen {
            self.send(flight);
            return None;
        }
        self.state = State::Marking(flight, deadline);
        Some(Report::Dropped("answer out of step"))
    }

    /// Takes note of the time.
    pub fn tick(&mut self, now: Timestamp) -> Option<Report> {
        if self.deadline().is_none_or(|deadline| now < deadline) {
            return None;
        }
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Waiting(flight, _) => Some(self.recover(now, flight).unwrap_or(Report::Dropped("answer timeout"))),
            State::Marking(flight, _) => Some(Report::Lost(flight.command)),
            State::Draining(_, flight) => {
                self.scanner.clear();
                match (flight, self.marker) {
                    (Some(flight), Some((marker, _))) => {
                        self.outgoing = Some(marker.to_bytes());
                        self.state = State::Marking(flight, None);
                    }
                    (Some(flight), None) => self.send(flight),
                    (None, _) => {}
                }
                None
            }
            State::Idle => None,
        }
    }

    /// Drains for a second try; after that the request is lost.
    fn recover(&mut self, now: Timestamp, flight: Flight) -> Option<Report> {
        if flight.retried {
            return Some(Report::Lost(flight.command));
        }
        // With a marker the drain need not outlast a late answer: whatever comes before the marker's is thrown away.
        let margin_s = if self.marker.is_some() { 0.0 } else { self.timing.margin_s };
        let longest_s = self.timing.seconds(flight.command.answer_bytes());
        self.drain(now, longest_s + margin_s, true);
        if let State::Draining(_, again) = &mut self.state {
            *again = Some(Flight { retried: true, ..flight });
        }
        None
    }
}

/// Whether this text can be the answer to this command.
fn fits(command: Command, text: &str) -> bool {
    match command.expect() {
        Expect::Text => true,
        Expect::Done => numbers(text).is_empty(),
        Expect::Numbers(least) => numbers(text).len() >= least,
    }
}

#[cfg(test)]
mod tests {
    use super::super::command::Item;
    use super::*;

    const TILT: Command = Command::Ask(Axis::Tilt, Item::Position);
    const MARKER: Command = Command::Ask(Axis::Tilt, Item::Resolution);

    fn ms(ms: f64) -> Timestamp {
        Timestamp::from_ns((ms * 1e6) as i64)
    }

    fn at_9600() -> Exchange {
        let mut exchange = Exchange::new(LineTiming { baud: 9600, margin_s: 0.05 });
        exchange.set_marker(MARKER, 185.1428);
        exchange
    }

    fn write(exchange: &mut Exchange, at_ms: f64) -> String {
        let bytes = exchange.take_outgoing().unwrap();
        exchange.written(ms(at_ms));
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn the_stamp_is_the_end_of_the_request_and_its_sigma_half_of_what_is_unexplained() {
        let mut exchange = at_9600();
        exchange.start(TILT);
        assert_eq!(write(&mut exchange, 100.0), "TP ");
        // 3 + 9 bytes of 1.0417 ms are 12.5 ms; the answer ends after 14.5 ms.
        let reports = exchange.receive(ms(114.5), b"* -1234\r\n");
        let [Report::Answered(TILT, text, timing)] = &reports[..] else { panic!("{reports:?}") };
        assert_eq!(text, "-1234");
        assert_eq!(timing.stamp(0.001).ns, 104_125_000);
        assert!((timing.stamp_std_s() - 0.001).abs() < 1e-9);
        assert!(exchange.is_idle());
    }

    #[test]
    fn a_lost_answer_is_asked_for_again_behind_a_marker_and_only_twice() {
        let mut exchange = at_9600();
        exchange.start(TILT);
        write(&mut exchange, 0.0);
        // 2 x 13 bytes x 1.0417 ms + 50 ms.
        let first = exchange.deadline().unwrap();
        assert!((first.seconds_since(ms(0.0)) - 0.07708).abs() < 1e-4);
        assert_eq!(exchange.tick(first), Some(Report::Dropped("answer timeout")));
        assert_eq!(write(&mut exchange, 78.0), " ", "a bare delimiter");
        let drained = exchange.deadline().unwrap();
        assert_eq!(exchange.tick(drained), None);
        assert_eq!(write(&mut exchange, 140.0), "TR ", "the marker");
        // The late answer to the first request is not the marker's.
        assert_eq!(exchange.receive(ms(145.0), b"* -7\r\n"), [Report::Dropped("answer out of step")]);
        exchange.receive(ms(150.0), b"* 185.1428 seconds arc per position\r\n");
        assert_eq!(write(&mut exchange, 151.0), "TP ");
        let second = exchange.deadline().unwrap();
        assert_eq!(exchange.tick(second), Some(Report::Lost(TILT)));
    }

    #[test]
    fn an_answer_without_a_number_is_no_answer_to_a_query() {
        let mut exchange = at_9600();
        exchange.start(TILT);
        write(&mut exchange, 0.0);
        assert_eq!(exchange.receive(ms(9.0), b"*\r\n"), [Report::Dropped("answer to another request")]);
        assert_eq!(write(&mut exchange, 9.0), " ");
    }

    #[test]
    fn a_limit_mark_does_not_disturb_the_answer_it_is_glued_to() {
        let mut exchange = at_9600();
        exchange.start(TILT);
        write(&mut exchange, 0.0);
        let reports = exchange.receive(ms(14.0), b"!T* 604\r\n");
        assert_eq!(reports[0], Report::Limit(Axis::Tilt));
        assert!(matches!(&reports[1], Report::Answered(TILT, text, _) if text == "604"), "{reports:?}");
    }
}
