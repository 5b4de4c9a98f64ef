//! The messages, as values. Each has a code, and reads and writes its fields in the order of the standard.
//!
//! Scaled integers are types with their range and unit ([`scaled`]); a presence vector is written from which fields
//! are there. A message reads all of its bytes or is refused. Lists allocate no more than their bytes make up.

#[macro_use]
mod macros;
pub mod core;
pub mod cost_map;
pub mod discovery;
pub mod events;
pub mod objects;
pub mod pose;
pub mod range;
pub mod scaled;
pub mod smart_grid;

use crate::bytes::{Malformed, Reader, Writer};

/// A message of this system.
pub trait Message: Sized {
    /// Its code.
    const CODE: u16;
    /// Its fields from bytes.
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed>;
    /// Its fields to bytes.
    fn write(&self, out: &mut Writer);

    /// Code and fields.
    fn to_bytes(&self) -> Vec<u8> {
        let mut out = Writer::default();
        out.u16(Self::CODE);
        self.write(&mut out);
        out.into_bytes()
    }

    /// From code and fields; the code must be this message's, and nothing may be left over.
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(bytes);
        if reader.u16()? != Self::CODE {
            return Err(Malformed::Value);
        }
        let message = Self::read(&mut reader)?;
        reader.end().map(|()| message)
    }
}

/// The code that bytes begin with.
pub fn code_of(bytes: &[u8]) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.first_chunk()?))
}

/// A value within a message.
pub trait Field: Sized {
    /// From bytes.
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed>;
    /// To bytes.
    fn write(&self, out: &mut Writer);
}

macro_rules! numbers {
    ($($name:ident)+) => {$(
        impl Field for $name {
            fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
                reader.$name()
            }
            fn write(&self, out: &mut Writer) {
                out.$name(*self);
            }
        }
    )+};
}

numbers! { u8 u16 u32 i16 i32 f32 f64 }

/// Text after its length in one byte.
impl Field for String {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        reader.text8()
    }
    fn write(&self, out: &mut Writer) {
        out.text8(self);
    }
}

/// A message within a message, after its length in four bytes.
impl Field for Vec<u8> {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        let count = reader.u32()?;
        let count = usize::try_from(count).map_err(|_| Malformed::Truncated)?;
        Ok(reader.bytes(count)?.to_vec())
    }
    fn write(&self, out: &mut Writer) {
        out.u32(self.len() as u32);
        out.bytes(self);
    }
}

macro_rules! lists {
    ($($(#[$doc:meta])* $name:ident: $count:ident,)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name<T>(pub Vec<T>);

        impl<T> Default for $name<T> {
            fn default() -> Self {
                Self(Vec::new())
            }
        }

        impl<T: Field> Field for $name<T> {
            fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
                let count = reader.$count()?;
                // No capacity from the wire: an element has at least a byte, so the bytes bound the list.
                (0..count).map(|_| T::read(reader)).collect::<Result<_, _>>().map(Self)
            }
            fn write(&self, out: &mut Writer) {
                let count = self.0.len().min(usize::from($count::MAX));
                out.$count(count as $count);
                self.0[..count].iter().for_each(|element| element.write(out));
            }
        }

        impl<T> From<Vec<T>> for $name<T> {
            fn from(elements: Vec<T>) -> Self {
                Self(elements)
            }
        }
    )+};
}

lists! {
    /// Elements after their number in one byte; more than 255 are not written.
    List8: u8,
    /// Elements after their number in two bytes; more than 65535 are not written.
    List16: u16,
}
