//! The fields of a CoLa telegram, one after the other, in either dialect: a reader over bytes and its mirror, a writer.
//!
//! In: the bytes after the command name. Out: numbers, reals and texts. CoLa-A writes numbers as upper-case
//! hexadecimal between single spaces (a number with a sign is decimal), CoLa-B as big-endian bytes. Nothing here knows
//! what a field means. Source: protocol notes 1.1.

use super::dialect::Dialect;

/// A field that could not be read: which one, where, and what stood there.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("field `{field}` at byte {at}: {why}")]
pub struct Malformed {
    /// The field that was expected.
    pub field: &'static str,
    /// Byte offset into the fields.
    pub at: usize,
    /// What stood there instead.
    pub why: String,
}

/// Reads fields from the front.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    dialect: Dialect,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// A reader at the first field.
    pub fn new(dialect: Dialect, bytes: &'a [u8]) -> Self {
        Self { dialect, bytes, at: 0 }
    }

    /// Bytes not read yet; in CoLa-A the separator before the next field is one of them.
    pub fn remaining(&self) -> &'a [u8] {
        &self.bytes[self.at.min(self.bytes.len())..]
    }

    /// The dialect these fields are written in.
    pub fn dialect(&self) -> Dialect {
        self.dialect
    }

    /// An unsigned number of one byte.
    pub fn u8(&mut self, field: &'static str) -> Result<u8, Malformed> {
        self.unsigned(field, 1).map(|n| n as u8)
    }

    /// An unsigned number of two bytes.
    pub fn u16(&mut self, field: &'static str) -> Result<u16, Malformed> {
        self.unsigned(field, 2).map(|n| n as u16)
    }

    /// An unsigned number of four bytes.
    pub fn u32(&mut self, field: &'static str) -> Result<u32, Malformed> {
        self.unsigned(field, 4)
    }

    /// A signed number of two bytes.
    pub fn i16(&mut self, field: &'static str) -> Result<i16, Malformed> {
        // CoLa-A devices write a negative number sign-extended to eight digits or cut to four: both mean the same.
        let at = self.at;
        let number = match self.dialect {
            Dialect::A => self.unsigned(field, 4)?,
            Dialect::B => self.unsigned(field, 2)?,
        };
        let cut = number as u16 as i16;
        if number <= 0xFFFF || cut as i32 as u32 == number {
            return Ok(cut);
        }
        Err(Malformed { field, at, why: format!("{number:X} does not fit 16 bits with a sign") })
    }

    /// A signed number of four bytes.
    pub fn i32(&mut self, field: &'static str) -> Result<i32, Malformed> {
        self.unsigned(field, 4).map(|n| n as i32)
    }

    /// A real of four bytes; CoLa-A writes its bits as eight hexadecimal digits.
    pub fn f32(&mut self, field: &'static str) -> Result<f32, Malformed> {
        self.unsigned(field, 4).map(f32::from_bits)
    }

    /// Exactly `count` characters, without a length before them.
    pub fn chars(&mut self, field: &'static str, count: usize) -> Result<&'a [u8], Malformed> {
        if self.dialect == Dialect::A {
            self.skip_separator(field)?;
        }
        self.take(field, count)
    }

    /// A text after its length, which CoLa-B writes in `length_bytes` bytes. Latin-1: each byte is one character.
    pub fn text(&mut self, field: &'static str, length_bytes: usize) -> Result<String, Malformed> {
        let count = self.unsigned(field, length_bytes)? as usize;
        // CoLa-A: an empty text leaves no separator that could be told from the next field's.
        if count == 0 {
            return Ok(String::new());
        }
        Ok(latin1(self.chars(field, count)?))
    }

    /// Checks that `count` more fields of at least `bytes_each` bytes can be there, before memory is set aside for them.
    pub fn expect_room(&self, field: &'static str, count: usize, bytes_each: usize) -> Result<(), Malformed> {
        // CoLa-A: one digit and one separator are the least a number takes.
        let needed = count * if self.dialect == Dialect::A { 2 } else { bytes_each };
        let left = self.remaining().len();
        if needed <= left {
            return Ok(());
        }
        Err(self.fault(field, format!("{count} values announced, {left} bytes left")))
    }

    /// Nothing but spaces may be left.
    pub fn finish(&self) -> Result<(), Malformed> {
        let left = self.remaining();
        let spare = if self.dialect == Dialect::A { left.trim_ascii() } else { left };
        if spare.is_empty() { Ok(()) } else { Err(self.fault("end", format!("{} bytes left over", spare.len()))) }
    }

    fn unsigned(&mut self, field: &'static str, bytes: usize) -> Result<u32, Malformed> {
        match self.dialect {
            Dialect::A => self.unsigned_text(field, bytes),
            Dialect::B => Ok(self.take(field, bytes)?.iter().fold(0, |n, b| n << 8 | u32::from(*b))),
        }
    }

    fn unsigned_text(&mut self, field: &'static str, bytes: usize) -> Result<u32, Malformed> {
        self.skip_separator(field)?;
        let rest = self.remaining();
        let token = &rest[..rest.iter().position(|b| *b == b' ').unwrap_or(rest.len())];
        let number = parse_number(token, bytes)
            .ok_or_else(|| self.fault(field, format!("`{}` is no number of {bytes} bytes", latin1(token))))?;
        self.at += token.len();
        Ok(number)
    }

    fn skip_separator(&mut self, field: &'static str) -> Result<(), Malformed> {
        // The first field follows the command name's own space, which the packet has already taken.
        if self.at == 0 && self.bytes.first().is_some_and(|b| *b != b' ') {
            return Ok(());
        }
        match self.remaining().first() {
            Some(b' ') => self.at += 1,
            Some(_) => return Err(self.fault(field, "no separator".into())),
            None => return Err(self.fault(field, "the telegram ends".into())),
        }
        Ok(())
    }

    fn take(&mut self, field: &'static str, count: usize) -> Result<&'a [u8], Malformed> {
        let rest = self.remaining();
        let taken =
            rest.get(..count).ok_or_else(|| self.fault(field, format!("{count} bytes needed, {} left", rest.len())))?;
        self.at += count;
        Ok(taken)
    }

    fn fault(&self, field: &'static str, why: String) -> Malformed {
        Malformed { field, at: self.at, why }
    }
}

/// A CoLa-A number that fits `bytes` bytes: hexadecimal, or decimal where it carries a sign.
fn parse_number(token: &[u8], bytes: usize) -> Option<u32> {
    let text = std::str::from_utf8(token).ok()?;
    let bits = 8 * bytes as u32;
    if text.starts_with(['+', '-']) {
        let number: i64 = text.parse().ok()?;
        let fits = number < 1 << bits && number >= -(1 << (bits - 1));
        return fits.then_some((number & ((1 << bits) - 1)) as u32);
    }
    // `from_str_radix` is fine with a leading sign, which the case above has taken.
    let number = u64::from_str_radix(text, 16).ok()?;
    (number < 1 << bits).then_some(number as u32)
}

/// Bytes as characters, one each.
pub fn latin1(bytes: &[u8]) -> String {
    bytes.iter().map(|b| char::from(*b)).collect()
}

/// Writes fields one after the other.
#[derive(Clone, Debug)]
pub struct Writer {
    dialect: Dialect,
    bytes: Vec<u8>,
}

impl Writer {
    /// An empty list of fields.
    pub fn new(dialect: Dialect) -> Self {
        Self { dialect, bytes: Vec::new() }
    }

    /// The fields, without a separator before the first.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// An unsigned number of one byte.
    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.number(&value.to_be_bytes(), format_args!("{value:X}"))
    }

    /// An unsigned number of one byte that CoLa-A writes with two digits (the maker's examples do, for some fields).
    pub fn u8_two_digits(&mut self, value: u8) -> &mut Self {
        self.number(&value.to_be_bytes(), format_args!("{value:02X}"))
    }

    /// An unsigned number of two bytes.
    pub fn u16(&mut self, value: u16) -> &mut Self {
        self.number(&value.to_be_bytes(), format_args!("{value:X}"))
    }

    /// An unsigned number of four bytes.
    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.number(&value.to_be_bytes(), format_args!("{value:X}"))
    }

    /// A signed number of two bytes.
    pub fn i16(&mut self, value: i16) -> &mut Self {
        self.number(&value.to_be_bytes(), format_args!("{value:X}"))
    }

    /// A signed number of four bytes.
    pub fn i32(&mut self, value: i32) -> &mut Self {
        self.number(&value.to_be_bytes(), format_args!("{value:X}"))
    }

    /// A real.
    pub fn f32(&mut self, value: f32) -> &mut Self {
        let bits = value.to_bits();
        self.number(&bits.to_be_bytes(), format_args!("{bits:08X}"))
    }

    /// Characters without a length.
    pub fn chars(&mut self, chars: &[u8]) -> &mut Self {
        self.separate();
        self.bytes.extend_from_slice(chars);
        self
    }

    /// A text after its length (`length_bytes` bytes in CoLa-B); characters beyond Latin-1 become `?`, and what the
    /// length cannot count is cut.
    pub fn text(&mut self, text: &str, length_bytes: usize) -> &mut Self {
        let most = if length_bytes == 1 { 0xFF } else { 0xFFFF };
        let chars: Vec<u8> = text.chars().take(most).map(|c| u8::try_from(c).unwrap_or(b'?')).collect();
        match length_bytes {
            1 => self.u8(chars.len() as u8),
            _ => self.u16(chars.len() as u16),
        };
        if !chars.is_empty() {
            self.chars(&chars);
        }
        self
    }

    fn number(&mut self, binary: &[u8], text: std::fmt::Arguments<'_>) -> &mut Self {
        self.separate();
        match self.dialect {
            Dialect::A => self.bytes.extend_from_slice(text.to_string().as_bytes()),
            Dialect::B => self.bytes.extend_from_slice(binary),
        }
        self
    }

    fn separate(&mut self) {
        if self.dialect == Dialect::A && !self.bytes.is_empty() {
            self.bytes.push(b' ');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ascii_numbers_are_hexadecimal_unless_they_carry_a_sign() {
        let mut r = Reader::new(Dialect::A, b"1388 FFF92230 -450000 +5000 3F800000 FF 5 abc d");
        assert_eq!(r.u16("a").unwrap(), 5000);
        assert_eq!(r.i32("b").unwrap(), -450_000);
        assert_eq!(r.i32("c").unwrap(), -450_000);
        assert_eq!(r.u16("d").unwrap(), 5000);
        assert_eq!(r.f32("e").unwrap(), 1.0);
        assert_eq!(r.u8("f").unwrap(), 255);
        assert_eq!(r.text("g", 2).unwrap(), "abc d");
        r.finish().unwrap();
    }

    #[test]
    fn a_number_too_wide_or_absent_says_which_field_and_what_stood_there() {
        let fault = Reader::new(Dialect::A, b"100").u8("width").unwrap_err();
        assert_eq!(fault.to_string(), "field `width` at byte 0: `100` is no number of 1 bytes");
        let fault = Reader::new(Dialect::B, &[1]).u16("count").unwrap_err();
        assert_eq!(fault.to_string(), "field `count` at byte 0: 2 bytes needed, 1 left");
        assert!(Reader::new(Dialect::A, b"+128").u8("x").is_ok());
        assert!(Reader::new(Dialect::A, b"-129").u8("x").is_err());
        assert!(Reader::new(Dialect::A, b"").u8("x").is_err());
    }

    #[test]
    fn sixteen_bits_with_a_sign_come_cut_or_extended() {
        assert_eq!(Reader::new(Dialect::A, b"FE0C").i16("x").unwrap(), -500);
        assert_eq!(Reader::new(Dialect::A, b"FFFFFE0C").i16("x").unwrap(), -500);
        assert!(Reader::new(Dialect::A, b"1FE0C").i16("x").is_err());
    }

    #[test]
    fn the_writer_mirrors_the_makers_examples() {
        let mut w = Writer::new(Dialect::A);
        w.u8_two_digits(3).u32(0xF472_4744).i32(-450_000).f32(1.0).text("not defined", 2);
        assert_eq!(latin1(&w.into_bytes()), "03 F4724744 FFF92230 3F800000 B not defined");
        let mut w = Writer::new(Dialect::B);
        w.u8_two_digits(3).u32(0xF472_4744).text("ab", 2);
        assert_eq!(w.into_bytes(), [3, 0xF4, 0x72, 0x47, 0x44, 0, 2, b'a', b'b']);
    }
}
