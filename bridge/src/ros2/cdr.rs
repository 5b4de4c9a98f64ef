//! The one CDR writer: values in, the bytes of a serialised ROS 2 message out. Pure.
//!
//! Plain CDR (XCDR1), little-endian, with the encapsulation header `00 01 00 00` in front. A primitive is aligned to
//! its own size, counted from behind the header; a string is its length with the closing zero, its bytes and that zero;
//! a sequence is its length and its items; a fixed array is its items alone. Source: OMG DDS-XTYPES 1.3, section 7.4.

/// The encapsulation header: plain CDR, little-endian, no options.
pub const HEADER: [u8; 4] = [0, 1, 0, 0];

/// A message being written.
#[derive(Debug)]
pub struct CdrWriter {
    bytes: Vec<u8>,
}

impl CdrWriter {
    /// An empty message.
    pub fn new() -> Self {
        Self { bytes: HEADER.to_vec() }
    }

    /// The message with its header.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Fills up with zeros until the next value of this size is aligned.
    fn align(&mut self, size: usize) {
        let body = self.bytes.len() - HEADER.len();
        self.bytes.resize(HEADER.len() + body.next_multiple_of(size), 0);
    }

    fn primitive<const N: usize>(&mut self, little_endian: [u8; N]) {
        self.align(N);
        self.bytes.extend_from_slice(&little_endian);
    }

    /// A count in front of a sequence or a string. No message of ours comes near 4 G items; a longer one is cut by its
    /// own count, never read beyond.
    fn count(&mut self, count: usize) {
        self.primitive(u32::try_from(count).unwrap_or(u32::MAX).to_le_bytes());
    }
}

impl Default for CdrWriter {
    fn default() -> Self {
        Self::new()
    }
}

/// What can stand in a message.
pub trait Cdr: Sized {
    /// Appends the value.
    fn write(&self, out: &mut CdrWriter);

    /// Appends items one after the other.
    fn write_all(items: &[Self], out: &mut CdrWriter) {
        for item in items {
            item.write(out);
        }
    }
}

macro_rules! primitives {
    ($($kind:ty),+) => {$(
        impl Cdr for $kind {
            fn write(&self, out: &mut CdrWriter) {
                out.primitive(self.to_le_bytes());
            }

            fn write_all(items: &[Self], out: &mut CdrWriter) {
                if items.is_empty() {
                    return;
                }
                out.align(size_of::<Self>());
                out.bytes.reserve(size_of_val(items));
                for item in items {
                    out.bytes.extend_from_slice(&item.to_le_bytes());
                }
            }
        }
    )+};
}

primitives!(u8, i8, u16, u32, i32, f32, f64);

impl Cdr for bool {
    fn write(&self, out: &mut CdrWriter) {
        u8::from(*self).write(out);
    }
}

impl Cdr for String {
    fn write(&self, out: &mut CdrWriter) {
        out.count(self.len() + 1);
        out.bytes.extend_from_slice(self.as_bytes());
        out.bytes.push(0);
    }
}

impl<T: Cdr> Cdr for Vec<T> {
    fn write(&self, out: &mut CdrWriter) {
        out.count(self.len());
        T::write_all(self, out);
    }
}

impl<T: Cdr, const N: usize> Cdr for [T; N] {
    fn write(&self, out: &mut CdrWriter) {
        T::write_all(self, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_aligned_to_their_size_behind_the_header() {
        let mut out = CdrWriter::new();
        7_u8.write(&mut out);
        1.0_f64.write(&mut out);
        2_u16.write(&mut out);
        String::from("ab").write(&mut out);
        vec![1.0_f64].write(&mut out);
        Vec::<f64>::new().write(&mut out);
        let expected = [
            &[0, 1, 0, 0][..],
            &[7, 0, 0, 0, 0, 0, 0, 0],
            &[0, 0, 0, 0, 0, 0, 0xf0, 0x3f],
            &[2, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0],
            &[1, 0, 0, 0],
            &[0, 0, 0, 0, 0, 0, 0xf0, 0x3f],
            &[0, 0, 0, 0],
        ];
        assert_eq!(out.into_bytes(), expected.concat());
    }
}
