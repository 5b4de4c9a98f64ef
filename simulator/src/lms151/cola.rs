//! CoLa-A and CoLa-B: framing, and one way to write and read a telegram's fields in either dialect.
//!
//! In: bytes of a TCP stream. Out: frames without their envelope, and telegrams as bytes. CoLa-A is `02 text 03`,
//! numbers in upper-case hexadecimal (decimal when signed); CoLa-B is `02 02 02 02`, a big-endian length, the payload
//! and the XOR of its bytes, numbers big-endian. Source: shared protocol notes, 1.1 and 1.2.

/// The two dialects of SOPAS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dialect {
    /// CoLa-A: text.
    A,
    /// CoLa-B: binary.
    B,
}

const STX: u8 = 0x02;
const ETX: u8 = 0x03;
/// No command is longer; a claim of more is a broken frame.
const PAYLOAD_MAX: usize = 4096;
const B_START: [u8; 4] = [STX; 4];
const B_OVERHEAD: usize = 9;

/// Takes frames out of a stream; the dialect is the one of the newest frame.
#[derive(Debug, Default)]
pub(crate) struct Deframer {
    buffer: Vec<u8>,
    /// Frames and stray bytes that made no sense.
    pub broken: u64,
}

impl Deframer {
    /// Bytes as they came.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The next whole frame's dialect and payload.
    pub fn next_frame(&mut self) -> Option<(Dialect, Vec<u8>)> {
        loop {
            let start = self.buffer.iter().position(|b| *b == STX).unwrap_or(self.buffer.len());
            if start > 0 {
                self.discard(start);
            }
            let starts_as_b = self.buffer.iter().take(4).all(|b| *b == STX);
            if starts_as_b && self.buffer.len() < 4 {
                return None;
            }
            match if starts_as_b { self.binary() } else { self.text() } {
                Some(Ok(frame)) => return Some(frame),
                Some(Err(())) => continue,
                None => return None,
            }
        }
    }

    fn discard(&mut self, count: usize) {
        self.broken += 1;
        self.buffer.drain(..count);
    }

    fn text(&mut self) -> Option<Result<(Dialect, Vec<u8>), ()>> {
        let end = self.buffer.iter().position(|b| *b == ETX);
        let Some(end) = end.filter(|e| *e <= PAYLOAD_MAX) else {
            if self.buffer.len() <= PAYLOAD_MAX {
                return None;
            }
            self.discard(1);
            return Some(Err(()));
        };
        let payload = self.buffer[1..end].to_vec();
        self.buffer.drain(..=end);
        Some(Ok((Dialect::A, payload)))
    }

    fn binary(&mut self) -> Option<Result<(Dialect, Vec<u8>), ()>> {
        let length = self.buffer.get(4..8)?.iter().fold(0usize, |n, b| n << 8 | usize::from(*b));
        if length > PAYLOAD_MAX {
            self.discard(1);
            return Some(Err(()));
        }
        let payload = self.buffer.get(8..8 + length)?.to_vec();
        let checksum = *self.buffer.get(8 + length)?;
        if checksum != xor(&payload) {
            self.discard(4);
            return Some(Err(()));
        }
        self.buffer.drain(..length + B_OVERHEAD);
        Some(Ok((Dialect::B, payload)))
    }
}

fn xor(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |x, b| x ^ b)
}

/// Writes one telegram.
#[derive(Debug)]
pub(crate) struct Writer {
    dialect: Dialect,
    payload: Vec<u8>,
}

impl Writer {
    /// A telegram that begins with a command word and a name: `sRA STlms`.
    pub fn new(dialect: Dialect, word: &str, name: &str) -> Self {
        let mut payload = format!("{word} {name}").into_bytes();
        if dialect == Dialect::B {
            payload.push(b' ');
        }
        Self { dialect, payload }
    }

    /// The answer to what cannot be answered: `sFA` and an error code; no space in CoLa-B.
    pub fn error(dialect: Dialect, code: u16) -> Vec<u8> {
        let mut telegram = Self { dialect, payload: b"sFA".to_vec() };
        telegram.u16(code);
        telegram.framed()
    }

    fn number(&mut self, value: u64, bytes: usize) {
        match self.dialect {
            Dialect::A => self.payload.extend_from_slice(format!(" {value:X}").as_bytes()),
            Dialect::B => self.payload.extend_from_slice(&value.to_be_bytes()[8 - bytes..]),
        }
    }

    /// An 8-bit number.
    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.number(value.into(), 1);
        self
    }
    /// A 16-bit number.
    pub fn u16(&mut self, value: u16) -> &mut Self {
        self.number(value.into(), 2);
        self
    }
    /// A 32-bit number.
    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.number(value.into(), 4);
        self
    }
    /// A signed 32-bit number; in text as two's complement.
    pub fn i32(&mut self, value: i32) -> &mut Self {
        self.u32(value as u32)
    }
    /// A single-precision number; in text always eight digits.
    pub fn f32(&mut self, value: f32) -> &mut Self {
        match self.dialect {
            Dialect::A => self.payload.extend_from_slice(format!(" {:08X}", value.to_bits()).as_bytes()),
            Dialect::B => self.payload.extend_from_slice(&value.to_be_bytes()),
        }
        self
    }
    /// Characters without a count.
    pub fn text(&mut self, value: &str) -> &mut Self {
        if self.dialect == Dialect::A {
            self.payload.push(b' ');
        }
        self.payload.extend_from_slice(value.as_bytes());
        self
    }
    /// Characters after their 16-bit count.
    pub fn string(&mut self, value: &str) -> &mut Self {
        self.u16(value.len() as u16).text(value)
    }

    /// The telegram in its envelope.
    pub fn framed(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.payload.len() + B_OVERHEAD);
        match self.dialect {
            Dialect::A => {
                out.push(STX);
                out.extend_from_slice(&self.payload);
                out.push(ETX);
            }
            Dialect::B => {
                out.extend_from_slice(&B_START);
                out.extend_from_slice(&(self.payload.len() as u32).to_be_bytes());
                out.extend_from_slice(&self.payload);
                out.push(xor(&self.payload));
            }
        }
        out
    }
}

/// Reads a request's parameters; nothing where one is missing or does not fit.
#[derive(Debug)]
pub(crate) struct Reader<'a> {
    dialect: Dialect,
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Splits a payload into command word, name and the parameters.
    pub fn new(dialect: Dialect, payload: &'a [u8]) -> Option<(&'a str, &'a str, Self)> {
        let (word, rest) = split(payload);
        let (name, rest) = split(rest);
        let words = (std::str::from_utf8(word).ok()?, std::str::from_utf8(name).ok()?);
        Some((words.0, words.1, Self { dialect, rest }))
    }

    fn number(&mut self, bytes: usize) -> Option<i64> {
        match self.dialect {
            Dialect::A => {
                let (token, rest) = split(self.rest);
                self.rest = rest;
                parse(std::str::from_utf8(token).ok()?)
            }
            Dialect::B => {
                let field = self.rest.get(..bytes)?;
                self.rest = &self.rest[bytes..];
                Some(field.iter().fold(0, |n, b| n << 8 | i64::from(*b)))
            }
        }
    }

    /// An 8-bit number.
    pub fn u8(&mut self) -> Option<u8> {
        self.number(1)?.try_into().ok()
    }
    /// A 16-bit number.
    pub fn u16(&mut self) -> Option<u16> {
        self.number(2)?.try_into().ok()
    }
    /// A 32-bit number.
    pub fn u32(&mut self) -> Option<u32> {
        self.number(4)?.try_into().ok()
    }
    /// A signed 32-bit number: two's complement, or decimal with a sign.
    pub fn i32(&mut self) -> Option<i32> {
        let value = self.number(4)?;
        i32::try_from(value).ok().or_else(|| u32::try_from(value).ok().map(|v| v as i32))
    }
    /// True when every parameter was read.
    pub fn is_done(&self) -> bool {
        self.rest.iter().all(|b| *b == b' ')
    }
}

/// A text number: signed ones are decimal, the others hexadecimal.
fn parse(token: &str) -> Option<i64> {
    if token.starts_with(['+', '-']) { token.parse().ok() } else { i64::from_str_radix(token, 16).ok() }
}

fn split(bytes: &[u8]) -> (&[u8], &[u8]) {
    match bytes.iter().position(|b| *b == b' ') {
        Some(at) => (&bytes[..at], &bytes[at + 1..]),
        None => (bytes, &[]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_in_of_the_notes_frames_and_reads_in_both_dialects() {
        let a = b"\x02sMN SetAccessMode 03 F4724744\x03".to_vec();
        let b = [b"\x02\x02\x02\x02\x00\x00\x00\x17sMN SetAccessMode \x03\xf4rGD".as_slice(), &[0xb3]].concat();
        let mut deframer = Deframer::default();
        deframer.push(&a);
        deframer.push(&b);
        for dialect in [Dialect::A, Dialect::B] {
            let (found, payload) = deframer.next_frame().unwrap();
            let (word, name, mut fields) = Reader::new(found, &payload).unwrap();
            assert_eq!((found, word, name), (dialect, "sMN", "SetAccessMode"));
            assert_eq!((fields.u8(), fields.u32()), (Some(3), Some(0xF472_4744)));
            assert!(fields.is_done());
        }
        assert!(deframer.next_frame().is_none());
        assert_eq!(deframer.broken, 0);
    }

    #[test]
    fn the_answer_to_a_log_in_is_that_of_a_real_device() {
        let mut answer = Writer::new(Dialect::B, "sAN", "SetAccessMode");
        assert_eq!(answer.u8(1).framed(), b"\x02\x02\x02\x02\x00\x00\x00\x13sAN SetAccessMode \x018");
        assert_eq!(Writer::error(Dialect::B, 3), b"\x02\x02\x02\x02\x00\x00\x00\x05sFA\x00\x03\x77");
        assert_eq!(Writer::error(Dialect::A, 3), b"\x02sFA 3\x03");
    }

    #[test]
    fn negative_numbers_are_twos_complement_or_signed_decimal() {
        let mut out = Writer::new(Dialect::A, "sRA", "LMPscancfg");
        assert_eq!(
            out.u32(5000).u16(1).u32(5000).i32(-450_000).i32(2_250_000).framed(),
            b"\x02sRA LMPscancfg 1388 1 1388 FFF92230 225510\x03"
        );
        let mut fields = Reader { dialect: Dialect::A, rest: b"FFF92230 -450000 +5000" };
        assert_eq!([fields.i32(), fields.i32(), fields.i32()], [Some(-450_000), Some(-450_000), Some(5000)]);
        assert_eq!(fields.u8(), None);
    }

    #[test]
    fn frames_split_anywhere_and_noise_between_them_do_no_harm() {
        let mut stream = b"noise".to_vec();
        let mut good = Writer::new(Dialect::B, "sRN", "STlms").framed();
        let mut bad = good.clone();
        *bad.last_mut().unwrap() ^= 1;
        stream.append(&mut bad);
        stream.append(&mut good);
        stream.extend_from_slice(b"\x02sRN STlms\x03\x02\x02\x02\x02\xff\xff\xff\xff");
        for cut in 0..stream.len() {
            let mut deframer = Deframer::default();
            let mut frames = 0;
            for part in [&stream[..cut], &stream[cut..]] {
                deframer.push(part);
                while let Some((_, payload)) = deframer.next_frame() {
                    assert!(payload.starts_with(b"sRN STlms"));
                    frames += 1;
                }
            }
            assert_eq!(frames, 2, "cut at {cut}");
            assert!(deframer.broken >= 2);
        }
    }
}
