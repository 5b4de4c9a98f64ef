//! Little-endian bytes: a [`Reader`] that never reads past the end, a [`Writer`] that only grows.

/// Why bytes are not the message they claim to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Malformed {
    /// They end too early.
    Truncated,
    /// There are more than the message has.
    Trailing,
    /// A variant's tag that does not exist.
    Tag,
    /// A value that cannot be.
    Value,
}

impl Malformed {
    /// In a few words, as a cause to count by.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Truncated => "message cut short",
            Self::Trailing => "message too long",
            Self::Tag => "unknown variant",
            Self::Value => "impossible value",
        }
    }
}

/// Takes values from the front of a slice.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Reads from the start of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// The next `count` bytes.
    pub fn bytes(&mut self, count: usize) -> Result<&'a [u8], Malformed> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(Malformed::Truncated)?;
        self.rest = rest;
        Ok(taken)
    }

    /// What is left.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// An error where something is left.
    pub fn end(&self) -> Result<(), Malformed> {
        if self.rest.is_empty() { Ok(()) } else { Err(Malformed::Trailing) }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let (taken, rest) = self.rest.split_first_chunk().ok_or(Malformed::Truncated)?;
        self.rest = rest;
        Ok(*taken)
    }

    /// Text after its length in one byte; bytes that are not UTF-8 read as the replacement character.
    pub fn text8(&mut self) -> Result<String, Malformed> {
        let count = self.u8()?;
        Ok(String::from_utf8_lossy(self.bytes(usize::from(count))?).into_owned())
    }
}

/// Collects values.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// What was written.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Bytes as they are.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// Text after its length in one byte; longer text is cut at a character border.
    pub fn text8(&mut self, text: &str) {
        let end = (0..=text.len().min(255)).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0);
        self.u8(end as u8);
        self.bytes(&text.as_bytes()[..end]);
    }
}

macro_rules! numbers {
    ($($name:ident)+) => {
        impl Reader<'_> {
            $(#[doc = concat!("A little-endian `", stringify!($name), "`.")]
            pub fn $name(&mut self) -> Result<$name, Malformed> {
                self.array().map($name::from_le_bytes)
            })+
        }
        impl Writer {
            $(#[doc = concat!("A little-endian `", stringify!($name), "`.")]
            pub fn $name(&mut self, value: $name) {
                self.bytes(&value.to_le_bytes());
            })+
        }
    };
}

numbers! { u8 u16 u32 i16 i32 f32 f64 }

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_and_not_one_byte_more() {
        let mut out = Writer::default();
        out.u16(0x4402);
        out.f64(-1.5);
        out.text8("é");
        let bytes = out.into_bytes();
        assert_eq!(bytes[..2], [0x02, 0x44]);
        let mut reader = Reader::new(&bytes);
        assert_eq!((reader.u16(), reader.f64(), reader.text8()), (Ok(0x4402), Ok(-1.5), Ok("é".into())));
        assert_eq!((reader.end(), reader.u8()), (Ok(()), Err(Malformed::Truncated)));
    }

    #[test]
    fn long_text_is_cut_at_a_character() {
        let mut out = Writer::default();
        out.text8(&"é".repeat(200));
        assert_eq!(out.into_bytes().len(), 1 + 254);
    }
}
