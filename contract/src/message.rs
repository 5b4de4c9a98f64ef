//! What a message is: plain data with a versioned name and a recorded layout.
//!
//! Every message is `#[repr(C)]`, without padding or pointers, and every bit pattern is valid (`bytemuck::Pod`).
//! Enumerations travel as `u8` and are parsed by an accessor. The recorded layout feeds the golden file
//! `contract/layout.txt`: changing a field without bumping the version fails a test there.

use bytemuck::{Pod, Zeroable};

/// One field of a message, for the golden layout and for readers in other languages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// The field's name, unit last.
    pub name: &'static str,
    /// The field's type as written here.
    pub kind: &'static str,
    /// Bytes from the start of the message.
    pub offset: usize,
}

/// Plain data that crosses a process border.
pub trait Message: Pod + Send + Sync + std::fmt::Debug {
    /// Versioned name; a process built against another one is refused when it opens the topic.
    const TYPE_NAME: &'static str;
    /// The fields in order.
    const FIELDS: &'static [Field];
}

/// Declares a message: the struct, its derives, its versioned name and its recorded layout.
macro_rules! message {
    ($(#[$doc:meta])* $name:ident = $type_name:literal {
        $($(#[$field_doc:meta])* $field:ident: $kind:ty,)+
    }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $kind,)+
        }

        impl $crate::message::Message for $name {
            const TYPE_NAME: &'static str = $type_name;
            const FIELDS: &'static [$crate::message::Field] = &[$($crate::message::Field {
                name: stringify!($field),
                kind: stringify!($kind),
                offset: std::mem::offset_of!($name, $field),
            },)+];
        }
    };
}

/// Declares an enumeration that travels as a `u8`; an unknown byte parses to the given fallback.
macro_rules! wire_enum {
    ($(#[$doc:meta])* $name:ident, unknown = $fallback:ident {
        $($(#[$variant_doc:meta])* $variant:ident = $value:literal $text:literal,)+
    }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum $name { $($(#[$variant_doc])* $variant = $value,)+ }

        impl $name {
            /// All values.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];
            /// From its byte on the wire; an unknown byte is the stated fallback.
            pub fn from_wire(byte: u8) -> Self {
                match byte { $($value => Self::$variant,)+ _ => Self::$fallback }
            }
            /// Its byte on the wire.
            pub const fn to_wire(self) -> u8 { self as u8 }
            /// Its name for people and JSON.
            pub const fn as_str(self) -> &'static str {
                match self { $(Self::$variant => $text,)+ }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.as_str())
            }
        }
    };
}

pub(crate) use {message, wire_enum};

/// UTF-8 text of at most `N` bytes, padded with zeros. Longer text is cut at a character border.
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Text<const N: usize>([u8; N]);

// `derive` cannot see that an array of bytes of any length is plain data behind a transparent struct.
#[allow(unsafe_code, reason = "a transparent wrapper of [u8; N] is as plain as the array itself")]
unsafe impl<const N: usize> Zeroable for Text<N> {}
#[allow(unsafe_code, reason = "a transparent wrapper of [u8; N] is as plain as the array itself")]
unsafe impl<const N: usize> Pod for Text<N> {}

impl<const N: usize> Text<N> {
    /// The longest start of `text` that fits.
    pub fn new(text: &str) -> Self {
        let mut end = text.len().min(N);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut bytes = [0; N];
        bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self(bytes)
    }

    /// The text up to the first zero byte; bytes that are not UTF-8 read as the replacement character.
    pub fn to_text(&self) -> std::borrow::Cow<'_, str> {
        let end = self.0.iter().position(|b| *b == 0).unwrap_or(N);
        String::from_utf8_lossy(&self.0[..end])
    }
}

impl<const N: usize> std::fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?}", self.to_text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_cut_at_a_character_and_survives_foreign_bytes() {
        assert_eq!(Text::<4>::new("abcé").to_text(), "abc");
        assert_eq!(Text::<5>::new("abcé").to_text(), "abcé");
        assert_eq!(Text::<3>([0xff, b'a', 0]).to_text(), "\u{fffd}a");
    }
}
