//! A telegram: its verb, its name and its fields, in either dialect.
//!
//! [`Packet`] borrows the payload of one frame and knows where its parts lie; what the fields mean is said in
//! [`super::commands`] and [`super::scan_data`]. [`StreamFramer`] turns a byte stream into payloads, and finds out
//! which dialect it is in where that is not known. Source: protocol notes 1.1 and 1.2.

pub use super::dialect::{Dialect, FrameCounts, PAYLOAD_MAX};
use super::fields::{Malformed, Reader, Writer, latin1};
use super::{cola_a, cola_b};

impl Dialect {
    /// A payload in this dialect's frame.
    pub fn frame(self, payload: &[u8]) -> Vec<u8> {
        match self {
            Self::A => cola_a::encode(payload),
            Self::B => cola_b::encode(payload),
        }
    }
}

/// First word of a telegram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verb {
    /// `sRN`: read a variable.
    Read,
    /// `sRA`: its value.
    ReadAnswer,
    /// `sWN`: write a variable.
    Write,
    /// `sWA`: written.
    WriteAnswer,
    /// `sMN`: call a method.
    Method,
    /// `sAN`: its result.
    MethodAnswer,
    /// `sEN`: subscribe to an event, or cancel.
    Subscribe,
    /// `sEA`: subscribed.
    SubscribeAnswer,
    /// `sSN`: an event.
    Event,
    /// `sFA`: an error answer.
    Fault,
}

const VERBS: [(Verb, &str); 10] = [
    (Verb::Read, "sRN"),
    (Verb::ReadAnswer, "sRA"),
    (Verb::Write, "sWN"),
    (Verb::WriteAnswer, "sWA"),
    (Verb::Method, "sMN"),
    (Verb::MethodAnswer, "sAN"),
    (Verb::Subscribe, "sEN"),
    (Verb::SubscribeAnswer, "sEA"),
    (Verb::Event, "sSN"),
    (Verb::Fault, "sFA"),
];

impl Verb {
    /// Its three letters.
    pub fn as_str(self) -> &'static str {
        VERBS.iter().find(|(verb, _)| *verb == self).map_or("s??", |(_, text)| text)
    }
}

/// One telegram, parts found, fields not yet read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Packet<'a> {
    /// The dialect it came in.
    pub dialect: Dialect,
    /// What kind of telegram.
    pub verb: Verb,
    /// Name of the variable, method or event; empty for a fault.
    pub name: &'a str,
    /// The fields' bytes.
    pub body: &'a [u8],
}

impl<'a> Packet<'a> {
    /// Finds the parts of a payload.
    pub fn parse(dialect: Dialect, payload: &'a [u8]) -> Result<Self, Malformed> {
        let fault = |at, why: &str| Malformed { field: "command", at, why: why.into() };
        let word = payload.get(..3).ok_or_else(|| fault(0, "shorter than a command word"))?;
        let (verb, _) = VERBS
            .iter()
            .find(|(_, text)| text.as_bytes() == word)
            .ok_or_else(|| fault(0, &format!("`{}` is no command word", latin1(word))))?;
        if *verb == Verb::Fault {
            // CoLa-B devices put the code right behind the word, without the space.
            let body = payload[3..].strip_prefix(b" ").filter(|rest| rest.len() != 1 || dialect == Dialect::A);
            return Ok(Self { dialect, verb: *verb, name: "", body: body.unwrap_or(&payload[3..]) });
        }
        let rest = payload[3..].strip_prefix(b" ").ok_or_else(|| fault(3, "no space behind the command word"))?;
        let end = rest.iter().position(|b| *b == b' ').unwrap_or(rest.len());
        let name = std::str::from_utf8(&rest[..end])
            .ok()
            .filter(|name| !name.is_empty() && name.bytes().all(|b| b.is_ascii_graphic()))
            .ok_or_else(|| fault(4, "the name is not plain text"))?;
        Ok(Self { dialect, verb: *verb, name, body: rest.get(end + 1..).unwrap_or(&[]) })
    }

    /// A reader at the first field.
    pub fn fields(&self) -> Reader<'a> {
        Reader::new(self.dialect, self.body)
    }
}

/// A payload from its parts; `fields` appends the fields.
pub fn payload(dialect: Dialect, verb: Verb, name: &str, fields: impl FnOnce(&mut Writer)) -> Vec<u8> {
    let mut writer = Writer::new(dialect);
    fields(&mut writer);
    let body = writer.into_bytes();
    let mut out = format!("{} {name}", verb.as_str()).into_bytes();
    if !body.is_empty() {
        out.push(b' ');
        out.extend(body);
    }
    out
}

/// Finds payloads in a byte stream whose dialect may not be known yet.
#[derive(Clone, Debug)]
pub struct StreamFramer {
    dialect: Option<Dialect>,
    a: cola_a::Framer,
    b: cola_b::Framer,
}

impl StreamFramer {
    /// A framer for one connection; without a dialect the first good telegram decides.
    pub fn new(dialect: Option<Dialect>) -> Self {
        Self { dialect, a: Default::default(), b: Default::default() }
    }

    /// The dialect, once known.
    pub fn dialect(&self) -> Option<Dialect> {
        self.dialect
    }

    /// Takes bytes in and returns the payloads they complete.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut from_a = Vec::new();
        let mut from_b = Vec::new();
        if self.dialect != Some(Dialect::B) {
            self.a.feed(bytes, |p| from_a.push(p.to_vec()));
        }
        if self.dialect != Some(Dialect::A) {
            self.b.feed(bytes, |p| from_b.push(p.to_vec()));
        }
        if self.dialect.is_none() {
            let good = |dialect, found: &[Vec<u8>]| found.iter().any(|p| Packet::parse(dialect, p).is_ok());
            // A right checksum is the stronger evidence, so B is asked first.
            self.dialect = if good(Dialect::B, &from_b) {
                Some(Dialect::B)
            } else if good(Dialect::A, &from_a) {
                Some(Dialect::A)
            } else {
                None
            };
        }
        match self.dialect {
            Some(Dialect::A) => from_a,
            Some(Dialect::B) => from_b,
            None => Vec::new(),
        }
    }

    /// Counts of the dialect in use; zero while it is not known.
    pub fn counts(&self) -> FrameCounts {
        match self.dialect {
            Some(Dialect::A) => self.a.counts(),
            Some(Dialect::B) => self.b.counts(),
            None => FrameCounts::default(),
        }
    }

    /// Bytes held of unfinished frames.
    pub fn held(&self) -> usize {
        self.a.held() + self.b.held()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_read_with_and_without_a_space_in_both_dialects() {
        let code = |dialect, payload: &[u8]| Packet::parse(dialect, payload).unwrap().fields().u16("code").unwrap();
        assert_eq!(code(Dialect::B, b"sFA\x00\x03"), 3);
        assert_eq!(code(Dialect::B, b"sFA \x00\x03"), 3);
        assert_eq!(code(Dialect::B, b"sFA\x20\x03"), 0x2003, "the space may be the code's first byte");
        assert_eq!(code(Dialect::A, b"sFA 1A"), 0x1A);
        assert_eq!(code(Dialect::A, b"sFA D"), 0xD);
    }

    #[test]
    fn a_name_without_fields_and_a_name_with_a_space_behind_it_are_the_same() {
        for payload in [&b"sWA LMDscandatacfg"[..], b"sWA LMDscandatacfg "] {
            let packet = Packet::parse(Dialect::B, payload).unwrap();
            assert_eq!((packet.verb, packet.name, packet.body), (Verb::WriteAnswer, "LMDscandatacfg", &[][..]));
        }
        assert!(Packet::parse(Dialect::A, b"sXX name").is_err());
        assert!(Packet::parse(Dialect::A, b"sRA").is_err());
        assert!(Packet::parse(Dialect::A, b"sRA  1").is_err());
    }

    #[test]
    fn the_first_good_telegram_decides_the_dialect() {
        for dialect in [Dialect::A, Dialect::B] {
            let mut framer = StreamFramer::new(None);
            assert!(framer.feed(b"\x00garbage\x03").is_empty());
            let payload = payload(dialect, Verb::MethodAnswer, "Run", |w| {
                w.u8(1);
            });
            assert_eq!(framer.feed(&dialect.frame(&payload)), [payload]);
            assert_eq!(framer.dialect(), Some(dialect));
        }
    }
}
