//! Answers of the pan-tilt unit: bytes in, answers and limit marks out.
//!
//! An answer is a line: `* value` or `! message`, with anything before the `*` or `!` being the echo of the request.
//! The marks `!P` and `!T` (an axis hit its limit) have no line end and may stand anywhere, also inside another
//! answer; they are taken out of the stream first. `! P...` with a space is an error message, not a mark.
//!
//! Source: wire format notes section 3.2 (Directed Perception command reference).

/// One of the two axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// theta1.
    Pan,
    /// theta2.
    Tilt,
}

impl std::fmt::Display for Axis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Pan => "pan",
            Self::Tilt => "tilt",
        })
    }
}

/// What the unit said.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// `* text`: done, or the value asked for.
    Done(Line),
    /// `! text`: refused, with the unit's reason.
    Refused(Line),
    /// `!P` or `!T`: the axis ran into its limit.
    Limit(Axis),
    /// A line that is neither: a banner, a lone echo, or line noise.
    Noise(Line),
}

/// One line of the unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// The text behind the `*` or `!`, trimmed.
    pub text: String,
    /// Bytes the whole line took on the wire, echo and line end included.
    pub wire_bytes: usize,
}

/// Longest line that is kept, bytes: four times the longest verbose answer known.
const LINE_MAX: usize = 256;
/// Carriage return and line feed.
const LINE_END_BYTES: usize = 2;

/// Finds answers in a stream of bytes.
#[derive(Debug, Default)]
pub struct AnswerScanner {
    line: Vec<u8>,
    bang: bool,
    overlong: bool,
}

impl AnswerScanner {
    /// Forgets a half line: the line was drained or opened anew.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Takes one byte; returns what it completes.
    pub fn push(&mut self, byte: u8) -> Option<Answer> {
        if std::mem::take(&mut self.bang) {
            match byte {
                b'P' => return Some(Answer::Limit(Axis::Pan)),
                b'T' => return Some(Answer::Limit(Axis::Tilt)),
                _ => self.keep(b'!'),
            }
        }
        match byte {
            b'!' => {
                self.bang = true;
                None
            }
            b'\r' | b'\n' => self.end(),
            _ => {
                self.keep(byte);
                None
            }
        }
    }

    fn keep(&mut self, byte: u8) {
        if self.line.len() < LINE_MAX {
            self.line.push(byte);
        } else {
            self.overlong = true;
        }
    }

    fn end(&mut self) -> Option<Answer> {
        let line = std::mem::take(&mut self.line);
        let overlong = std::mem::take(&mut self.overlong);
        // The line feed behind a carriage return, or an empty line.
        if line.is_empty() {
            return None;
        }
        let wire_bytes = line.len() + LINE_END_BYTES;
        let mark = line.iter().position(|b| matches!(b, b'*' | b'!'));
        let text = String::from_utf8_lossy(&line[mark.map_or(0, |at| at + 1)..]).trim().to_string();
        let line_out = Line { text, wire_bytes };
        Some(match mark.map(|at| line[at]) {
            Some(b'*') if !overlong => Answer::Done(line_out),
            Some(b'!') if !overlong => Answer::Refused(line_out),
            _ => Answer::Noise(line_out),
        })
    }
}

/// All numbers in a text, in order: `-1234`, `185.1428`; a minus counts only in front of a digit. At most eight.
pub fn numbers(text: &str) -> Vec<f64> {
    const NUMBERS_MAX: usize = 8;
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() && found.len() < NUMBERS_MAX {
        let negative = bytes[at] == b'-' && bytes.get(at + 1).is_some_and(u8::is_ascii_digit);
        if !negative && !bytes[at].is_ascii_digit() {
            at += 1;
            continue;
        }
        let digits_from = at + usize::from(negative);
        let length = bytes[digits_from..].iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
        let end = digits_from + length;
        if let Some(number) = text.get(at..end).and_then(|number| number.trim_end_matches('.').parse().ok()) {
            found.push(number);
        }
        at = end;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(bytes: &str, expected: &[Answer]) {
        let mut scanner = AnswerScanner::default();
        let answers: Vec<Answer> = bytes.bytes().filter_map(|b| scanner.push(b)).collect();
        assert_eq!(answers, expected, "{bytes:?}");
    }

    fn done(text: &str, wire_bytes: usize) -> Answer {
        Answer::Done(Line { text: text.into(), wire_bytes })
    }

    #[test]
    fn terse_verbose_and_echoed_answers_are_the_same_answer() {
        check("* -1234\r\n", &[done("-1234", 9)]);
        check("PP * Current Pan position is 22\r\n", &[done("Current Pan position is 22", 33)]);
        check("*\r\n", &[done("", 3)]);
    }

    #[test]
    fn a_limit_mark_is_found_glued_in_front_and_inside_an_answer() {
        check("!T* 604\r\n", &[Answer::Limit(Axis::Tilt), done("604", 7)]);
        check("* 6!P04\r\n", &[Answer::Limit(Axis::Pan), done("604", 7)]);
        let marks = [Axis::Tilt, Axis::Tilt, Axis::Pan, Axis::Pan].map(Answer::Limit);
        check("!T!T!P!P*\r\n", &[&marks[..], &[done("", 3)]].concat());
    }

    #[test]
    fn an_error_text_with_a_space_is_no_limit_mark() {
        let text = "Pan speed cannot exceed 2902 positions/sec";
        check(&format!("! {text}\r\n"), &[Answer::Refused(Line { text: text.into(), wire_bytes: text.len() + 4 })]);
    }

    #[test]
    fn numbers_are_found_in_every_form_of_answer() {
        assert_eq!(numbers("-1234"), [-1234.0]);
        assert_eq!(numbers("185.1428 seconds arc per position"), [185.1428]);
        assert_eq!(numbers("P(-500,20) S-(1000, 2000)"), [-500.0, 20.0, 1000.0, 2000.0]);
        assert_eq!(numbers("Maximum is 31."), [31.0]);
        assert_eq!(numbers("1.2.3 -- é 4"), [4.0]);
    }

    proptest! {
        #[test]
        fn random_bytes_never_panic_and_a_good_answer_after_a_line_end_is_found(
            noise in proptest::collection::vec(any::<u8>(), 0..600),
        ) {
            let mut scanner = AnswerScanner::default();
            for byte in noise {
                if let Some(Answer::Done(line)) = scanner.push(byte) {
                    numbers(&line.text);
                }
            }
            scanner.push(b'\r');
            let answers: Vec<Answer> = b"* 7\r\n".iter().filter_map(|b| scanner.push(*b)).collect();
            prop_assert_eq!(answers, vec![done("7", 5)]);
        }
    }
}
